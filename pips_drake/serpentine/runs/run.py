"""Runs the station of a scenario, and collects what it did."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Meshcat
from pydrake.lcm import DrakeLcm
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, VectorLogSink

from pips_drake.serpentine.runs.assessment import RunData
from pips_drake.serpentine.runs.hit import ContactWatch, steps_to_keep
from pips_drake.serpentine.runs.supervised import RunEnd, Supervised, log_supervisor, read_log
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import (
    VISUAL_PERIOD,
    MakeSerpentineStation,
    MakeSimulator,
    MotionNames,
    SerpentineSetup,
    built_arm,
    motion_names,
)
from pips_drake.twin.motion_record import MotionRecorder, RecordedMotion, RecordedSteps
from pips_drake.twin.simulation import RunTime, advance
from pips_drake.twin.visualizers import AddVisualizers

Array = NDArray[np.float64]

_LOGGED = (
    "plant.state",
    "plant.net_actuation",
    "clearance_monitor.clearance",
    "clearance_monitor.witness",
)


@dataclass(frozen=True, kw_only=True)
class RunDiagram:
    """A station with logs around it, not yet simulated.

    Attributes:
        logs: by the names of the station's ports.
        duration: from start to end, s, unless a supervisor intervenes.
        end: says when a run is over.
        recorder: of the plant's motion.
    """

    diagram: Diagram
    station: Diagram
    logs: dict[str, VectorLogSink]
    duration: float
    end: RunEnd
    recorder: MotionRecorder


@dataclass(frozen=True, kw_only=True)
class LegData:
    """What was recorded of legs that are bodies.

    Attributes:
        positions: of their model, (N, 3 A).
        gaps: of the loops that they close, (N, A) m.
    """

    positions: Array
    gaps: Array


@dataclass(frozen=True, kw_only=True)
class Run:
    """A finished run: the station, what it recorded, and how long it took.

    Attributes:
        motion: of the plant, at every instant.
        pan_tilt: of the camera at the data's times, (N, 2) rad; None without a camera.
        legs: at the data's times; None but with the fidelity `truss`.
        supervised: what the supervisor decided; None without one.
        steps: the arm's state at every step of the plant, around the first contact that the monitor
            saw, or all of them if asked for; None if there was no contact.
    """

    diagram: Diagram
    station: Diagram
    data: RunData
    motion: RecordedMotion
    run_time: RunTime
    steps: RecordedSteps | None = None
    pan_tilt: Array | None = None
    legs: LegData | None = None
    supervised: Supervised | None = None


def commanded_port(scenario: SerpentineScenario, names: MotionNames) -> str:
    """The station's port whose joints the drives follow."""
    return "camera_pointer.joint_state" if scenario.camera.enabled else names.joint_state


def make_run_diagram(
    scenario: SerpentineScenario,
    setup: SerpentineSetup,
    *,
    meshcat: Meshcat | None = None,
    lcm: DrakeLcm | None = None,
    every_step: bool = False,
) -> RunDiagram:
    """Builds a scenario's station with logs around it.

    Args:
        every_step: the recorder keeps every step of the plant, not only the latest ones.
        meshcat: shows the run while it goes on.
        lcm: where Meldis is told of it; Drake's default address without it.
    """
    station, names = MakeSerpentineStation(scenario, setup=setup), motion_names(setup.motion)
    builder = DiagramBuilder()
    builder.AddNamedSystem("station", station)
    period = 1.0 / scenario.clocks.record_hz
    logs: dict[str, VectorLogSink] = {}
    camera = ("camera_pointer.joint_state", "camera_pointer.pan_tilt")
    legs = ("plant.legs_state", "loop_gap_meter.gap")
    for port in (
        *_LOGGED,
        *(port for port in names.ports if port != names.phase),
        *(camera if scenario.camera.enabled else ()),
        *(legs if scenario.actuation.fidelity == "truss" else ()),
    ):
        logs[port] = LogVectorOutput(station.GetOutputPort(port), builder, period)
        logs[port].set_name(f"log.{port}")
    decisions = log_supervisor(builder, station, scenario)
    logs |= decisions
    recorder = MotionRecorder(
        builder,
        station.GetOutputPort("plant.state"),
        positions=setup.arm.joints,
        stride=scenario.clocks.plant_hz // scenario.clocks.control_hz,
        recent=math.inf if every_step else steps_to_keep(scenario),
    )
    query = station.GetOutputPort("scene_graph.query")
    AddVisualizers(builder, query, period=VISUAL_PERIOD, meshcat=meshcat, lcm=lcm)
    diagram = builder.Build()
    diagram.set_name("serpentine_run")
    duration = station.GetSubsystemByName(names.source).duration + scenario.motion.settle_s
    if scenario.duration_s > 0.0:
        duration = min(duration, scenario.duration_s)
    return RunDiagram(
        diagram=diagram,
        station=station,
        logs=logs,
        duration=duration,
        end=RunEnd(
            station, decisions.get("motion_supervisor.mode"), scenario, duration, names=names
        ),
        recorder=recorder,
    )


def run_station(
    scenario: SerpentineScenario,
    setup: SerpentineSetup,
    *,
    meshcat: Meshcat | None = None,
    lcm: DrakeLcm | None = None,
    label: str = "simulating",
    every_step: bool = False,
    prepare: Callable[[Diagram, Context], None] | None = None,
) -> Run:
    """Runs a scenario's station (`make_run_diagram`) from start to end.

    Args:
        label: of the progress bar.
        every_step: keep every step of the plant.
        prepare: called with the station and the root context before the run: begins it elsewhere.
    """
    built = make_run_diagram(scenario, setup, meshcat=meshcat, lcm=lcm, every_step=every_step)
    station, names = built.station, motion_names(setup.motion)
    simulator = MakeSimulator(built.diagram, scenario)
    if prepare is not None:
        prepare(station, simulator.get_mutable_context())
    watch = ContactWatch(built.recorder, built.logs["clearance_monitor.clearance"])
    run_time = advance(
        simulator,
        built.duration,
        label=label,
        watch=watch,
        finished=built.end,
        latest=built.end.latest,
    )
    context = simulator.get_context()
    recorded = {port: log.FindLog(context) for port, log in built.logs.items()}
    monitor = station.GetSubsystemByName("clearance_monitor")
    rows = {port: log.data().T for port, log in recorded.items()}
    joints = setup.arm.joints
    efforts = rows["plant.net_actuation"].copy()
    efforts[0] = np.nan  # the plant has made no step yet, so nothing has acted
    data = RunData(
        time=recorded["plant.state"].sample_times(),
        tip_arc_lengths=rows[names.tip][:, 0],
        commanded_joints=rows[commanded_port(scenario, names)][:, :joints],
        joints=rows["plant.state"][:, :joints],
        joint_rates=rows["plant.state"][:, joints:],
        joint_efforts=efforts,
        clearance=rows["clearance_monitor.clearance"][:, 0],
        self_clearance=rows["clearance_monitor.clearance"][:, 2],
        witness=rows["clearance_monitor.witness"][:, 1:].reshape(-1, 2, 3),
        pairs=tuple(monitor.pair_name(row[0]) for row in rows["clearance_monitor.witness"]),
        solution=rows.get("follow_the_leader.solution"),
        built=built_arm(setup, scenario.faults),
    )
    legs = None
    if "plant.legs_state" in rows:
        state, gaps = rows["plant.legs_state"], rows["loop_gap_meter.gap"]
        legs = LegData(positions=state[:, : state.shape[1] // 2], gaps=gaps)
    supervised = None
    if scenario.supervisor.enabled:
        mine = station.GetMyContextFromRoot(context)
        supervised = Supervised(
            arm=setup.arm,
            config=scenario.supervisor,
            log=read_log(built.logs, context, scenario.clocks),
            stopping_time=station.GetSubsystemByName("motion_supervisor").thresholds.stopping_time,
            data=data,
            phase=float(station.GetOutputPort(names.phase).Eval(mine)[0]),
            whole=scenario.duration_s <= 0.0,
            pair_name=monitor.pair_name,
        )
    return Run(
        supervised=supervised,
        legs=legs,
        diagram=built.diagram,
        station=station,
        data=data,
        motion=built.recorder.motion(),
        run_time=run_time,
        steps=built.recorder.steps() if every_step or watch.touched else None,
        pan_tilt=rows.get("camera_pointer.pan_tilt"),
    )
