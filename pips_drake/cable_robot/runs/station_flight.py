"""A survey flown by the station: winches, elastic cables, a platform with mass, estimated poses."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.analysis import Simulator
from scipy.spatial.transform import Rotation
from tqdm import tqdm

from pips_drake.cable_robot.cablings import bay_obstacles
from pips_drake.cable_robot.configuration import CableRobotConfig
from pips_drake.cable_robot.kinematics import Poses
from pips_drake.cable_robot.platform_motion import MotionLimits
from pips_drake.cable_robot.raster import Raster
from pips_drake.cable_robot.runs.survey_flight import Flight, calibration_errors, flight_motion
from pips_drake.cable_robot.scenario import StationConfig
from pips_drake.cable_robot.station import (
    BoxObstacle,
    DisturbanceSettings,
    MakeCableRobotStation,
    StationSettings,
)
from pips_drake.twin.simulation import DivergedError

Array = NDArray[np.float64]

#: A picture is taken when this share of the rest at a view is over: what still swings has settled.
SHUTTER = 0.8


def station_settings(
    config: CableRobotConfig, asked: StationConfig, calibration: ArrayLike = 0.0
) -> StationSettings:
    """The station's settings: winches and sensors from the robot's file, the rest as asked.

    Args:
        calibration: what is reeled out beyond what the encoders say, (M,) m or one for all.
    """
    winch = config.winch
    weight = config.rope.mass_per_length_kg_m * float(np.linalg.norm(config.gravity_m_s2))
    disturbance = None
    if asked.disturbance_N:
        disturbance = DisturbanceSettings(
            wrench=asked.disturbance_N,
            start=asked.disturbance_start_s,
            end=asked.disturbance_end_s,
        )
    return StationSettings(
        disturbance=disturbance,
        control=asked.control,
        feedback="estimated",
        cable_weight=weight if asked.sag else 0.0,
        speed=winch.speed_m_s,
        force_limit=config.rope.tension_max_N,
        encoder_step=1e-3 * winch.encoder_step_mm,
        force_step=winch.force_step_N,
        calibration_error=calibration,
    )


def bay_boxes() -> list[BoxObstacle]:
    """Doors and bay as the station takes them."""
    # A door's boxes are one body: few bodies make a fast simulation.
    return [
        BoxObstacle(
            name=box.name, size=box.size, X_WB=box.X_WB, body=box.name.rstrip(" 0123456789")
        )
        for box in bay_obstacles()
    ]


def poses_of(states: ArrayLike) -> Poses:
    """Poses of free bodies' states (N, >= 7): quaternion w x y z and position."""
    rows = np.asarray(states, dtype=np.float64)
    rotation = Rotation.from_quat(np.roll(rows[:, :4], -1, axis=1)).as_matrix()
    return Poses(rows[:, 4:7].copy(), rotation)


def station_flight(
    config: CableRobotConfig,
    raster: Raster,
    limits: MotionLimits,
    *,
    asked: StationConfig,
    seed: int,
    label: str = "flight",
) -> Flight:
    """Simulates the whole flight, and notes what is so at each picture.

    Args:
        asked: how the station is to work.
        seed: of the calibration's errors.
        label: of the progress bar.

    Raises:
        DivergedError: the simulation has.
    """
    robot = config.robot()
    error = calibration_errors(config, seed)
    motion, views = flight_motion(raster, limits)
    # A length that reads too much by `error` is reeled out too little by it.
    settings = station_settings(config, asked, -error)
    station = MakeCableRobotStation(robot, motion, settings, obstacles=bay_boxes())
    diagram = station.diagram
    ports = [
        diagram.GetOutputPort(name)
        for name in ("plant.platform_state", "pose_estimator.estimated_state",
                     "cable_forces.tensions")
    ]  # fmt: skip
    shutter = motion.arrivals[views] + SHUTTER * limits.dwell
    simulator = Simulator(diagram)
    simulator.Initialize()
    context = simulator.get_context()
    rows: list[list[Array]] = []
    for time in tqdm(shutter, desc=label, unit="view", disable=None, leave=False):
        simulator.AdvanceTo(time)
        rows.append([port.Eval(context).copy() for port in ports])
        if not all(np.all(np.isfinite(part)) for part in rows[-1]):
            raise DivergedError(context.get_time())
    true, estimated, tensions = (np.array(column) for column in zip(*rows, strict=True))
    return Flight(
        time=shutter,
        wanted=raster.platform,
        true=poses_of(true),
        estimated=poses_of(estimated),
        length_errors=error,
        tensions=tensions,
        held=np.all(tensions <= robot.tension_max, axis=1),
        duration=motion.duration,
    )
