"""Builds a scenario's station, runs it, and collects what it did."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, System
from pydrake.systems.primitives import LogVectorOutput

from pips_drake.config import require
from pips_drake.errors import InputError, NotFollowableError
from pips_drake.remote_manipulator.configuration import (
    HEAVIEST_PAYLOAD,
    STATIONS,
    RemoteManipulatorConfig,
    load_configuration,
)
from pips_drake.remote_manipulator.display import DISPLAY
from pips_drake.remote_manipulator.priority_stations import check_cameras
from pips_drake.remote_manipulator.program_state import FRAME_PERIOD, ProgramSettings
from pips_drake.remote_manipulator.runs.data import RunData
from pips_drake.remote_manipulator.scenario import RemoteManipulatorScenario
from pips_drake.remote_manipulator.station.attachments import AttachmentEvent
from pips_drake.remote_manipulator.station.plant import PlantSettings, home_arm_vector
from pips_drake.remote_manipulator.station.station import (
    JetConfig,
    MakeRemoteManipulatorStation,
    Station,
)
from pips_drake.twin.simulation import RunTime, advance
from pips_drake.twin.visualizers import AddVisualizers

Array = NDArray[np.float64]

#: Between two pictures of a running station, s: a multiple of its frame.
VISUAL_PERIOD = 5.0 * FRAME_PERIOD
#: A run may not begin with bodies deeper in each other than this, m.
DEEPEST_AT_FIRST = 1e-3
#: Ports that a run records, by what `RunData` makes of them.
_LOGGED = (
    "collision_program.setpoint",
    "collision_program.control_word",
    "collision_program.phase",
    "collision_program.flags",
    "collision_program.display",
    "relative_poses.payload_pose",
    "relative_poses.cae_pose",
    "plant.state",
    "plant.arm_state",
    "plant.arm_effort",
    "clearance_monitor.clearance",
    "clearance_monitor.witness",
    "operator.channels",
    "visual_scene_program.station",
    "visual_scene_program.camera",
)


@dataclass(frozen=True, kw_only=True)
class Setup:
    """A scenario with what it names, loaded.

    Attributes:
        config: the machine, with the scenario's payload mass.
        plant: the plant's settings.
        program: the collision program's.
        jets: of a limit cycling payload.
    """

    config: RemoteManipulatorConfig
    plant: PlantSettings
    program: ProgramSettings
    jets: JetConfig | None


@dataclass(frozen=True, kw_only=True)
class Run:
    """A finished run.

    Attributes:
        station: that ran; its plant draws pictures.
        diagram: the whole, with logs.
        data: what was recorded.
        attachments: what the welds did.
        slip_max: farthest that a weld's sides were apart when it was let go, m.
        finished: the operator said that all is done.
        stopped: why the operator cannot go on; empty if it can.
    """

    station: Station
    diagram: Diagram
    data: RunData
    run_time: RunTime
    attachments: list[AttachmentEvent]
    slip_max: float
    finished: bool
    stopped: str = ""


def load_setup(scenario: RemoteManipulatorScenario, *, folder: Path | None = None) -> Setup:
    """Loads what a scenario names.

    Args:
        folder: where its relative file names start.

    Raises:
        InputError: something cannot be used.
    """
    config = load_configuration(scenario.manipulator, inside=folder)
    if scenario.payload_mass_kg > 0.0:
        mass = scenario.payload_mass_kg
        allowed = f"0 .. {HEAVIEST_PAYLOAD:g} kg"
        require(mass <= HEAVIEST_PAYLOAD, "payload_mass_kg", f"{mass:g} kg", allowed)
        config.payload.mass_kg = mass
    check_cameras(config)
    payload, start = scenario.payload, home_arm_vector(config)
    if scenario.stand_height_m > 0.0:
        start[0] = scenario.stand_height_m
    if scenario.angles_deg:
        start[1:7] = np.radians(scenario.angles_deg)
    X_RP = None
    if payload.support == "none":
        position = payload.position_m or config.payload.location_m
        X_RP = RigidTransform(RollPitchYaw(np.radians(payload.rpy_deg)), position)
    jets = None
    if payload.limit_cycle.enabled and payload.support == "none":
        cycle = payload.limit_cycle
        jets = JetConfig(dead_band=math.radians(cycle.dead_band_deg), torque=cycle.torque_N_m)
    return Setup(
        config=config,
        plant=PlantSettings(
            time_step=1.0 / scenario.dynamics.plant_hz,
            support=payload.support,
            X_RP=X_RP,
            spin=[math.radians(rate) for rate in payload.spin_deg_s],
            velocity=payload.velocity_m_s,
            arm_vector=start,
            cae_offset=scenario.cae_offset_m,
            orbiter_translates=scenario.dynamics.orbiter_translates,
        ),
        program=ProgramSettings(**vars(scenario.program)),
        jets=jets,
    )


def make_station(setup: Setup, operator: System | None, *, camera: str = STATIONS[0]) -> Station:
    """The station of a loaded scenario; `camera` is where the operator looks from at first."""
    return MakeRemoteManipulatorStation(
        setup.config,
        settings=setup.plant,
        program_settings=setup.program,
        operator=operator,
        jets=setup.jets,
        camera=camera,
    )


def run_station(
    station: Station,
    *,
    duration: float,
    meshcat: Meshcat | None = None,
    real_time: bool = False,
    label: str = "simulating",
) -> Run:
    """Runs a station, which has an operator, and records every frame.

    Args:
        duration: s; an operator with the output `finished` may end it before.
        meshcat: shows the run while it goes on.
        real_time: a second takes one at least, as a person needs it who works with the arm.
        label: of the progress bar.
    """
    builder = DiagramBuilder()
    builder.AddNamedSystem("station", station.diagram)
    logs = {}
    for port in _LOGGED:
        output = station.diagram.GetOutputPort(port)
        logs[port] = LogVectorOutput(output, builder, FRAME_PERIOD)
        logs[port].set_name(f"log.{port}")
    query = station.diagram.GetOutputPort("scene_graph.query")
    # A person sees every other frame; a run that is twenty times as fast needs fewer.
    period = 2.0 * FRAME_PERIOD if real_time else VISUAL_PERIOD
    AddVisualizers(builder, query, period=period, meshcat=meshcat)
    diagram = builder.Build()
    diagram.set_name("remote_manipulator_run")
    simulator = Simulator(diagram)
    station.attachments.initialize(simulator.get_mutable_context())
    _check_start(station, simulator.get_context())
    simulator.set_monitor(station.attachments.monitor)
    if real_time:
        simulator.set_target_realtime_rate(1.0)
    ends = station.diagram.HasOutputPort("operator.finished")

    def finished(root: Context) -> bool:
        mine = station.diagram.GetMyContextFromRoot(root)
        return ends and bool(station.diagram.GetOutputPort("operator.finished").Eval(mine)[0] > 0.5)

    context, began, stopped = simulator.get_context(), perf_counter(), ""
    try:
        run_time = advance(simulator, duration, label=label, finished=finished)
    except NotFollowableError as error:
        # What has been recorded shows where.
        stopped = str(error)
        run_time = RunTime(simulated_s=context.get_time(), wall_s=perf_counter() - began)
    rows = {port: log.FindLog(context).data().T for port, log in logs.items()}
    time = logs["plant.state"].FindLog(context).sample_times()
    events = list(station.attachments.events)
    slips = [event.slip for event in events] + [station.attachments.slip(context)]
    return Run(
        station=station,
        diagram=diagram,
        data=_collect(station, time, rows),
        run_time=run_time,
        attachments=events,
        slip_max=max(slips),
        finished=finished(context),
        stopped=stopped,
    )


def _check_start(station: Station, root: Context) -> None:
    """Refuses a run that begins with bodies in each other: contact would throw them apart.

    Raises:
        InputError: names the two that are deepest in each other.
    """
    query = station.diagram.GetOutputPort("scene_graph.query").Eval(
        station.diagram.GetMyContextFromRoot(root)
    )
    pairs = query.ComputePointPairPenetration()
    deepest = max(pairs, key=lambda pair: pair.depth, default=None)
    if deepest is None or deepest.depth <= DEEPEST_AT_FIRST:
        return
    inspector, plant = query.inspector(), station.machine.plant
    names = [
        plant.GetBodyFromFrameId(inspector.GetFrameId(geometry)).name()
        for geometry in (deepest.id_A, deepest.id_B)
    ]
    raise InputError(
        f"at first {names[0]} and {names[1]} are {deepest.depth:.3g} m in each other; must be "
        "apart: give angles_deg, stand_height_m or payload.position_m"
    )


def _collect(station: Station, time: Array, rows: Mapping[str, Array]) -> RunData:
    monitor = station.diagram.GetSubsystemByName("clearance_monitor")
    arm = rows["plant.arm_state"]
    half = arm.shape[1] // 2
    efforts = rows["plant.arm_effort"].copy()
    efforts[0] = np.nan  # the plant has made no step yet, so nothing has acted
    clearance = rows["clearance_monitor.clearance"]
    shown = rows["collision_program.display"]
    positions = station.machine.plant.num_positions()
    return RunData(
        time=time,
        setpoint=rows["collision_program.setpoint"],
        arm=arm[:, :half],
        arm_rates=arm[:, half:],
        arm_efforts=efforts,
        payload=rows["relative_poses.payload_pose"],
        cae=rows["relative_poses.cae_pose"],
        phase=np.rint(rows["collision_program.phase"][:, 0]).astype(int),
        flags=rows["collision_program.flags"] > 0.5,
        display={name: shown[:, column] for column, name in enumerate(DISPLAY)},
        control_word=np.rint(rows["collision_program.control_word"][:, 0]).astype(int),
        station=np.rint(rows["visual_scene_program.station"][:, 0]).astype(int),
        camera=rows["visual_scene_program.camera"],
        clearance=clearance[:, 0],
        pairs=tuple(monitor.pair_name(row[0]) for row in rows["clearance_monitor.witness"]),
        penetration=np.maximum(0.0, -np.minimum(clearance[:, 0], clearance[:, 2])),
        positions=rows["plant.state"][:, :positions],
        channels=rows["operator.channels"],
    )
