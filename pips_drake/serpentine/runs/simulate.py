"""Simulates a serpentine scenario and writes what it found."""

from __future__ import annotations

import copy
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import (
    DrakeVisualizer,
    DrakeVisualizerParams,
    Meshcat,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
)
from pydrake.lcm import DrakeLcm
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, VectorLogSink

from pips_drake.errors import NotFollowableError
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.drives import drive_columns, effort_columns
from pips_drake.serpentine.plan import Plan, make_plan
from pips_drake.serpentine.runs import figures
from pips_drake.serpentine.runs.assessment import Assessment, RunData
from pips_drake.serpentine.runs.certified import (
    CertifiedMotion,
    certified_clearance,
    certify_commanded,
    certify_simulated,
    write_proof,
)
from pips_drake.serpentine.runs.film import film_run
from pips_drake.serpentine.runs.follow import plan_numbers, write_plan_figures
from pips_drake.serpentine.runs.motion_report import motion_report
from pips_drake.serpentine.runs.pictures import (
    run_bookmarks,
    run_phases,
    write_run_pictures,
    write_run_replay,
)
from pips_drake.serpentine.runs.scene_report import (
    report_scene,
    scenario_text,
    without_lost_target,
)
from pips_drake.serpentine.runs.sheet import write_run_sheet
from pips_drake.serpentine.runs.supervised import RunEnd, Supervised, log_supervisor, read_log
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import (
    VISUAL_PERIOD,
    MakeSerpentineStation,
    MakeSimulator,
    SerpentineSetup,
    load_setup,
    make_plant,
    plant_time_step,
)
from pips_drake.twin.motion_record import MotionRecorder, RecordedMotion
from pips_drake.twin.output_folder import output_folder, write_whole
from pips_drake.twin.recording import Series, write_csv
from pips_drake.twin.run_figures import clearance_figure, tracking_figure
from pips_drake.twin.simulation import DivergedError, RunTime, advance
from pips_drake.twin.summary import versions, write_summary
from pips_drake.twin.verdict import Verdict

Array = NDArray[np.float64]

_LOGGED = (
    "plant.state",
    "plant.net_actuation",
    "tip_path_source.tip",
    "follow_the_leader.joint_state",
    "follow_the_leader.solution",
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
    """

    diagram: Diagram
    station: Diagram
    data: RunData
    motion: RecordedMotion
    run_time: RunTime
    pan_tilt: Array | None = None
    legs: LegData | None = None
    supervised: Supervised | None = None


def simulate(
    scenario: SerpentineScenario,
    *,
    name: str,
    out: Path,
    force: bool = False,
    folder: Path | None = None,
    scene_file: Path | None = None,
    meshcat: Meshcat | None = None,
) -> Verdict:
    """Plans, simulates and judges a scenario, and writes its folder.

    Args:
        name: the scenario's name, for the summary and titles.
        out: the folder to write; it appears whole or not at all.
        force: replace an earlier result there.
        folder: where the scenario's relative file names start.
        scene_file: stands for the scenario's scene; a camera whose target it lacks is left out.
        meshcat: shows the run while it goes on.

    Raises:
        InputError: something that the scenario names cannot be used; nothing is written.
    """
    setup = load_setup(scenario, folder=folder, scene_file=scene_file)
    lost: list[str] = []
    if scene_file is not None:
        scenario, lost = without_lost_target(scenario, setup)
    with output_folder(out, force=force) as partial:
        (partial / "figures").mkdir()
        scene = report_scene(scenario, setup, figures=partial / "figures")
        plan = make_plan(setup.arm, setup.path)
        summary, failures = plan_numbers(plan), list(plan.failures)
        if plan.followable:
            # The plan is converged; a scenario's own tolerance and limit act in the run alone.
            try:
                summary, failures = _simulate_into(partial, scenario, setup, plan, name, meshcat)
            except (NotFollowableError, DivergedError) as error:
                failures = [f"the run was given up: {error}"]
        write_plan_figures(partial / "figures", plan)
        summary = {"arm": setup.arm.name, "path": setup.path.name} | scene | summary
        if lost:
            summary["scene_warnings"] = summary.get("scene_warnings", []) + lost
        summary |= {
            "path_version": setup.path.version,
            "rail_shift_m": setup.rail_shift,
            "scenario": name,
            "path_corner_deviation_m": setup.path.deviation,
            "verdict": "fail" if failures else "pass",
            "failures": failures,
            "versions": versions(),
        }
        write_whole(partial / "scenario.yaml", scenario_text(scenario))
        write_summary(partial / "summary.json", summary)
        write_run_sheet(partial, summary, failures, scenario.checks)
    return Verdict(failures=tuple(failures), summary=summary, folder=out)


def commanded_port(scenario: SerpentineScenario) -> str:
    """The station's port whose joints the drives follow."""
    return (
        "camera_pointer.joint_state" if scenario.camera.enabled else "follow_the_leader.joint_state"
    )


def make_run_diagram(
    scenario: SerpentineScenario,
    setup: SerpentineSetup,
    *,
    meshcat: Meshcat | None = None,
    lcm: DrakeLcm | None = None,
) -> RunDiagram:
    """Builds a scenario's station with logs around it.

    Args:
        meshcat: shows the run while it goes on.
        lcm: where Meldis is told of it; Drake's default address without it.
    """
    station = MakeSerpentineStation(scenario, setup=setup)
    builder = DiagramBuilder()
    builder.AddNamedSystem("station", station)
    period = 1.0 / scenario.clocks.record_hz
    logs: dict[str, VectorLogSink] = {}
    camera = ("camera_pointer.joint_state", "camera_pointer.pan_tilt")
    legs = ("plant.legs_state", "loop_gap_meter.gap")
    for port in (
        *_LOGGED,
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
    )
    query = station.GetOutputPort("scene_graph.query")
    # Meldis listens on LCM: it shows whatever runs.
    DrakeVisualizer.AddToBuilder(
        builder, query, lcm=lcm, params=DrakeVisualizerParams(publish_period=VISUAL_PERIOD)
    )
    if meshcat is not None:
        MeshcatVisualizer.AddToBuilder(
            builder, query, meshcat, MeshcatVisualizerParams(publish_period=VISUAL_PERIOD)
        )
    diagram = builder.Build()
    diagram.set_name("serpentine_run")
    duration = station.GetSubsystemByName("tip_path_source").duration + scenario.motion.settle_s
    if scenario.duration_s > 0.0:
        duration = min(duration, scenario.duration_s)
    return RunDiagram(
        diagram=diagram,
        station=station,
        logs=logs,
        duration=duration,
        end=RunEnd(station, decisions.get("motion_supervisor.mode"), scenario, duration),
        recorder=recorder,
    )


def run_station(
    scenario: SerpentineScenario,
    setup: SerpentineSetup,
    *,
    meshcat: Meshcat | None = None,
    lcm: DrakeLcm | None = None,
    label: str = "simulating",
) -> Run:
    """Runs a scenario's station (`make_run_diagram`) from start to end.

    Args:
        label: of the progress bar.
    """
    built = make_run_diagram(scenario, setup, meshcat=meshcat, lcm=lcm)
    station = built.station
    simulator = MakeSimulator(built.diagram, scenario)
    run_time = advance(
        simulator,
        built.duration,
        label=label,
        watch=built.recorder.collect,
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
        tip_arc_lengths=rows["tip_path_source.tip"][:, 0],
        commanded_joints=rows[commanded_port(scenario)][:, :joints],
        joints=rows["plant.state"][:, :joints],
        joint_rates=rows["plant.state"][:, joints:],
        joint_efforts=efforts,
        clearance=rows["clearance_monitor.clearance"][:, 0],
        self_clearance=rows["clearance_monitor.clearance"][:, 2],
        witness=rows["clearance_monitor.witness"][:, 1:].reshape(-1, 2, 3),
        pairs=tuple(monitor.pair_name(row[0]) for row in rows["clearance_monitor.witness"]),
        solution=rows["follow_the_leader.solution"],
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
            phase=float(station.GetOutputPort("tip_path_source.phase").Eval(mine)[0]),
            whole=scenario.duration_s <= 0.0,
        )
    return Run(
        supervised=supervised,
        legs=legs,
        diagram=built.diagram,
        station=station,
        data=data,
        motion=built.recorder.motion(),
        run_time=run_time,
        pan_tilt=rows.get("camera_pointer.pan_tilt"),
    )


def _simulate_into(
    folder: Path,
    scenario: SerpentineScenario,
    setup: SerpentineSetup,
    plan: Plan,
    name: str,
    meshcat: Meshcat | None,
) -> tuple[dict[str, Any], list[str]]:
    """Runs a followable scenario and writes everything but the summary."""
    run = run_station(scenario, setup, meshcat=meshcat)
    is_fastest = scenario.motion.profile == "fastest"
    picture = folder / "figures" / "fastest_motion.png" if is_fastest else None
    motion, _ = motion_report(scenario, setup, figure=picture)
    assessment = Assessment(
        arm=setup.arm,
        path=setup.path,
        solver=setup.solver,
        checks=scenario.checks,
        data=run.data,
        clearance_range=scenario.clearance_range_m,
    )
    supervised, sagging = run.supervised, None
    if scenario.actuation.show_uncompensated and scenario.actuation.compensate_deflection:
        sagging = _uncompensated(scenario, setup)
    certified, proved, failures = _certify(folder, scenario, setup, assessment, run.motion)
    _write_series(folder, assessment)
    _write_run_figures(folder, assessment, sagging, certified)
    no_pictures = write_run_pictures(folder / "figures", scenario, setup, assessment)
    film = None
    if run.pan_tilt is not None:
        film = film_run(folder, scenario, setup, data=run.data, pan_tilt=run.pan_tilt)
    write_run_replay(
        folder / "replay.html",
        scenario,
        setup,
        title=f"{name}: {setup.arm.name} on {setup.path.name}",
        time=run.data.time,
        joints=run.data.joints,
        legs=None if run.legs is None else run.legs.positions,
        bookmarks=run_bookmarks(assessment, supervised.decisions if supervised else ()),
        phases=run_phases(run.data, setup.path),
        note="" if film is None else film.note,
        seen=None if film is None else film.patches,
    )
    _write_diagram(folder, run.diagram)
    summary = (
        plan_numbers(plan)
        | motion
        | assessment.summary()
        | proved
        | {
            "plan_path_deviation_max_m": plan.centre_line_deviation.max(),
            "simulated_s": run.run_time.simulated_s,
            "wall_s": run.run_time.wall_s,
            "real_time_rate": run.run_time.real_time_rate,
            "actuation_fidelity": scenario.actuation.fidelity,
            "cycle_time_s": run.station.GetSubsystemByName("tip_path_source").duration,
            "cycle_completed": (
                scenario.duration_s <= 0.0 or run.run_time.simulated_s < scenario.duration_s
            )
            and (supervised is None or supervised.completed),
        }
    )
    if supervised is not None:
        summary |= supervised.summary()
        failures = supervised.failures() + failures
        write_csv(supervised.log.series(), folder / "supervisor.csv")
    if run.legs is not None:
        _write_gaps(folder, setup.arm, run.data.time, run.legs.gaps)
        step = plant_time_step(scenario)
        summary |= {"loop_gap_max_m": run.legs.gaps.max(), "plant_step_s": step}
    if film is not None:
        summary |= film.summary
    if no_pictures is not None:
        summary["renderings_missing"] = no_pictures
    if sagging is not None:
        summary["spine_error_max_uncompensated_m"] = sagging.spine_errors.max()
    return summary, assessment.failures() + failures


def _certify(
    folder: Path,
    scenario: SerpentineScenario,
    setup: SerpentineSetup,
    assessment: Assessment,
    motion: RecordedMotion,
) -> tuple[CertifiedMotion | None, dict[str, Any], list[str]]:
    """Certifies the commanded and the simulated motion and writes their proofs.

    Returns:
        what is proved of the simulated one; the summary's part; what fails the verdict.
    """
    if not scenario.certificate.enabled:
        return None, {}, []
    builder = DiagramBuilder()
    plant, scene_graph, model = make_plant(builder, setup, scenario, visual_period=VISUAL_PERIOD)
    diagram = builder.Build()  # owns the plant
    placed = {"plant": plant, "scene_graph": scene_graph, "model": model}
    # The verdict is that of the simulated motion.
    commanded, summary, _ = certify_commanded(scenario, setup, **placed, sampled={})
    sampled = {
        "clearance": float(assessment.data.clearance.min()),
        "self_clearance": float(assessment.data.self_clearance.min()),
    }
    simulated, more, failures = certify_simulated(
        scenario, setup, motion, **placed, sampled=sampled
    )
    del diagram
    for name, certified in (("commanded", commanded), ("simulated", simulated)):
        if certified is not None:
            write_proof(folder / f"proof_{name}.npz", certified)
    return simulated, summary | more, failures


def _uncompensated(scenario: SerpentineScenario, setup: SerpentineSetup) -> Assessment:
    """The way out alone, without compensation of the deflection."""
    other: SerpentineScenario = copy.deepcopy(scenario)
    other.actuation.compensate_deflection = False
    # It shows what would happen, however far off.
    other.supervisor.enabled = False
    other.motion.retract = False
    run = run_station(other, setup, label="simulating without compensation")
    return Assessment(
        arm=setup.arm,
        path=setup.path,
        solver=setup.solver,
        checks=scenario.checks,
        data=run.data,
        clearance_range=scenario.clearance_range_m,
    )


def _write_series(folder: Path, assessment: Assessment) -> None:
    arm, data = assessment.arm, assessment.data
    tip = np.column_stack(
        [
            data.tip_arc_lengths,
            assessment.spine_errors[:, -1],
            assessment.spine_errors.max(axis=1),
            assessment.deviation,
        ]
    )
    clearance = np.column_stack([data.clearance, data.self_clearance])
    for name, values, columns in (
        ("joints", data.joints, arm.joint_columns),
        ("joints_commanded", data.commanded_joints, arm.joint_columns),
        (
            "actuators",
            np.hstack([assessment.drive_coordinates, assessment.drive_efforts]),
            drive_columns(arm) + effort_columns(arm),
        ),
        ("clearance", clearance, ("clearance_m", "self_clearance_m")),
        (
            "tip",
            tip,
            ("tip_arc_length_m", "tip_error_m", "spine_error_m", "path_deviation_m"),
        ),
    ):
        series = Series(time=data.time, values=values, columns=columns)
        write_csv(series, folder / f"{name}.csv")


def _write_gaps(folder: Path, arm: SerpentineArm, time: Array, gaps: Array) -> None:
    """How far the legs' loops stood open."""
    columns = tuple(f"{name}_gap_m" for name in arm.actuator_names)
    write_csv(Series(time=time, values=gaps, columns=columns), folder / "loop_gaps.csv")


def _write_run_figures(
    folder: Path,
    assessment: Assessment,
    sagging: Assessment | None,
    certified: CertifiedMotion | None,
) -> None:
    pictures = folder / "figures"
    pictures.mkdir(exist_ok=True)
    arm, data, first = assessment.arm, assessment.data, assessment.arm.first_actuated_joint
    figures.actuators_figure(
        pictures / "actuators.png",
        arm,
        figures.time_axis(data.time),
        assessment.drive_coordinates[:, first:],
        assessment.drive_efforts[:, first:],
    )
    clearance_figure(
        pictures / "clearance.png",
        data.time,
        data.clearance,
        pair=data.pairs[assessment.nearest] or (),
        threshold=assessment.checks.clearance_min_mm * 1e-3,
        max_distance=assessment.clearance_range,
        own_distance=data.self_clearance,
        certified=certified_clearance(certified),
    )
    uncompensated = None
    if sagging is not None:
        errors = sagging.spine_errors
        uncompensated = (sagging.data.time, errors.max(axis=1), errors[:, -1])
    tracking_figure(
        pictures / "tracking.png",
        data.time,
        assessment.spine_errors.max(axis=1),
        assessment.spine_errors[:, -1],
        uncompensated=uncompensated,
        limit=assessment.checks.tracking_error_max_mm * 1e-3,
    )


def _write_diagram(folder: Path, diagram: Diagram) -> None:
    """`diagram.dot`, and `diagram.svg` where Graphviz is installed."""
    dot = folder / "diagram.dot"
    write_whole(dot, diagram.GetGraphvizString(max_depth=2))
    renderer = shutil.which("dot")
    if renderer is not None:
        subprocess.run(
            [renderer, "-Tsvg", str(dot), "-o", str(folder / "diagram.svg")],
            check=False,
            capture_output=True,
            timeout=60,
        )
