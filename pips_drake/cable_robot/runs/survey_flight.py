"""Where the camera really is when it takes each picture, and where it is thought to be.

The platform is sent from view to view and waits at each for the picture. Its winches hold the
tensions that `statics` chooses and close the loop on the pose that the measured lengths give. So
what is off is what is measured wrong: a length by its calibration, always by the same, and by the
encoder's steps. At rest the *estimated* pose is the wanted one; the true one is where lengths with
these errors look like that, to first order x - L^+ e.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pips_drake.cable_robot.configuration import CableRobotConfig
from pips_drake.cable_robot.kinematics import (
    Poses,
    cable_lengths,
    forward_kinematics,
    jacobian,
    make_poses,
)
from pips_drake.cable_robot.platform_motion import MotionLimits, PlatformMotion
from pips_drake.cable_robot.raster import Raster
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.statics import distribute_tensions
from pips_drake.errors import NotFollowableError

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: How high the platform's origin is above the hinges while it changes sides, m.
TRANSFER_HEIGHT = 1.0
_MOST_STEPS = 30
_MET = 1e-11


@dataclass(frozen=True, kw_only=True, eq=False)
class Flight:
    """A survey's N views as they were flown.

    Attributes:
        time: when each picture is taken, (N,) s.
        wanted, true, estimated: poses of the platform.
        length_errors: by which lengths read too much, (M,) m.
        tensions: of the cables, (N, M) N.
        held: at which views the platform is held, no cable overloaded, (N,).
        duration: of the whole survey, s.
    """

    time: Array
    wanted: Poses
    true: Poses
    estimated: Poses
    length_errors: Array
    tensions: Array
    held: NDArray[np.bool_]
    duration: float


def flight_motion(raster: Raster, limits: MotionLimits) -> tuple[PlatformMotion, Indices]:
    """The platform's way through all views, straight and from rest to rest.

    From one side to the other the way goes up, over the bay and down.

    Returns:
        The motion, and which of its way points are the views, (N,).
    """
    places = raster.platform.position
    side = np.array([panel.side for panel in raster.panels])[raster.panel]
    corners, tilts, views = [places[0]], [raster.tilt[0]], [0]
    for k in range(1, len(places)):
        if side[k] != side[k - 1]:
            for end in (k - 1, k):
                x, y, z = places[end]
                corners.append(np.array([x, y, max(TRANSFER_HEIGHT, z)]))
                tilts.append(raster.tilt[end])
        corners.append(places[k])
        tilts.append(raster.tilt[k])
        views.append(len(corners) - 1)
    return PlatformMotion(make_poses(np.array(corners)), np.array(tilts), limits), np.array(views)


def calibration_errors(config: CableRobotConfig, seed: int) -> Array:
    """What each length always reads too much: uniform within the winches' error, (M,) m."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-1.0, 1.0, len(config.cables)) * 1e-3 * config.winch.length_error_mm


def rest_flight(
    config: CableRobotConfig, raster: Raster, limits: MotionLimits, *, seed: int
) -> Flight:
    """A flight without dynamics: at rest at every view, as the loop over the estimate leaves it.

    Raises:
        NotFollowableError: no pose looks like the wanted one with these errors.
    """
    robot = config.robot()
    error = calibration_errors(config, seed)
    true = _true_poses(robot, raster.platform, error)
    read = cable_lengths(robot, true) + error
    step = 1e-3 * config.winch.encoder_step_mm
    if step > 0.0:
        read = step * np.round(read / step)
    motion, views = flight_motion(raster, limits)
    chosen = distribute_tensions(robot, true, "analytic_center")
    return Flight(
        time=motion.arrivals[views] + 0.5 * limits.dwell,
        wanted=raster.platform,
        true=true,
        estimated=forward_kinematics(robot, read, raster.platform),
        length_errors=error,
        tensions=chosen.tensions,
        held=chosen.feasible,
        duration=motion.duration,
    )


def _true_poses(robot: CableRobot, wanted: Poses, error: Array) -> Poses:
    """Poses x with L(wanted)^+ (l(x) + error - l(wanted)) = 0: there least squares say `wanted`."""
    inverse = np.linalg.pinv(jacobian(robot, wanted))
    lengths = cable_lengths(robot, wanted)
    position, rotation = wanted.position.copy(), np.array(wanted.rotation)
    for _ in range(_MOST_STEPS):
        here = Poses(position, rotation)
        miss = inverse @ (cable_lengths(robot, here) + error - lengths)[..., None]
        slope = inverse @ jacobian(robot, here)
        step = np.zeros((len(wanted), 6))
        step[:, list(robot.freedoms)] = -np.linalg.solve(slope, miss)[..., 0]
        position = position + step[:, :3]
        rotation = Rotation.from_rotvec(step[:, 3:]).as_matrix() @ rotation
        if np.abs(step).max() < _MET:
            return Poses(position, rotation)
    raise NotFollowableError(
        f"{robot.name}: with length errors up to {1e3 * np.abs(error).max():.3g} mm the platform "
        "finds no rest near its views"
    )
