"""Simulates a serpentine scenario and writes what it found."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import (
    Meshcat,
)

from pips_drake.errors import NotFollowableError
from pips_drake.serpentine.joint_motion import JointMotion
from pips_drake.serpentine.runs.assessment import Assessment
from pips_drake.serpentine.runs.film import film_run
from pips_drake.serpentine.runs.judgement import judge_run
from pips_drake.serpentine.runs.pictures import (
    run_bookmarks,
    run_phases,
    write_run_pictures,
    write_run_replay,
)
from pips_drake.serpentine.runs.planned import PlannedRun, planned_run
from pips_drake.serpentine.runs.run import run_station
from pips_drake.serpentine.runs.run_files import (
    write_gaps,
    write_run_figures,
    write_series,
)
from pips_drake.serpentine.runs.scene_report import (
    report_scene,
    scenario_text,
    with_joint_motion_file,
    without_lost_target,
)
from pips_drake.serpentine.runs.sheet import write_run_sheet
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import (
    SerpentineSetup,
    load_setup,
    motion_names,
    plant_time_step,
)
from pips_drake.twin.diagram_file import write_diagram
from pips_drake.twin.output_folder import output_folder, write_whole
from pips_drake.twin.recording import write_csv
from pips_drake.twin.replay_panel import ReplayPanel
from pips_drake.twin.simulation import DivergedError
from pips_drake.twin.summary import versions, write_summary
from pips_drake.twin.verdict import Verdict

Array = NDArray[np.float64]
#: Makes the flat view of a page from what was recorded: times (T,) s, joints (T, J) m and rad.
MakePanel = Callable[[Array, Array], ReplayPanel | None]


def simulate(
    scenario: SerpentineScenario,
    *,
    name: str,
    out: Path,
    force: bool = False,
    folder: Path | None = None,
    scene_file: Path | None = None,
    meshcat: Meshcat | None = None,
    joint_motion: JointMotion | None = None,
    panel: MakePanel | None = None,
) -> Verdict:
    """Plans, simulates and judges a scenario, and writes its folder.

    Args:
        name: the scenario's name, for the summary and titles.
        out: the folder to write; it appears whole or not at all.
        force: replace an earlier result there.
        folder: where the scenario's relative file names start.
        scene_file: stands for the scenario's scene; a camera whose target it lacks is left out.
        meshcat: shows the run while it goes on.
        joint_motion: stands for the scenario's path or joints; the rail then stands at the
            scenario's `rail_shift_m`.
        panel: makes the flat view of the replay's page.

    Raises:
        InputError: something that the scenario names cannot be used; nothing is written.
    """
    setup = load_setup(scenario, folder=folder, scene_file=scene_file, joint_motion=joint_motion)
    lost: list[str] = []
    if scene_file is not None:
        scenario, lost = without_lost_target(scenario, setup)
    with output_folder(out, force=force) as partial:
        (partial / "figures").mkdir()
        scene = report_scene(scenario, setup, figures=partial / "figures")
        plan = planned_run(scenario, setup)
        summary, failures = plan.numbers(), list(plan.failures)
        if not failures:
            # The plan is converged; a scenario's own tolerance and limit act in the run alone.
            try:
                summary, failures = _simulate_into(
                    partial, scenario, setup, plan, name, meshcat, panel
                )
            except (NotFollowableError, DivergedError) as error:
                failures = [f"the run was given up: {error}"]
            failures += plan.warnings
        plan.write_figures(partial / "figures")
        summary = scene | summary
        if lost:
            summary["scene_warnings"] = summary.get("scene_warnings", []) + lost
        summary |= {
            "rail_shift_m": setup.rail_shift,
            "scenario": name,
            "verdict": "fail" if failures else "pass",
            "failures": failures,
            "versions": versions(),
        }
        scenario = with_joint_motion_file(scenario, setup, partial)
        write_whole(partial / "scenario.yaml", scenario_text(scenario))
        write_summary(partial / "summary.json", summary)
        write_run_sheet(partial, summary, failures, scenario.checks)
    return Verdict(failures=tuple(failures), summary=summary, folder=out)


def _simulate_into(
    folder: Path,
    scenario: SerpentineScenario,
    setup: SerpentineSetup,
    plan: PlannedRun,
    name: str,
    meshcat: Meshcat | None,
    panel: MakePanel | None,
) -> tuple[dict[str, Any], list[str]]:
    """Runs a followable scenario and writes everything but the summary."""
    run = run_station(scenario, setup, meshcat=meshcat)
    numbers = plan.numbers() | plan.run_numbers(folder / "figures")
    supervised, sagging = run.supervised, None
    if scenario.actuation.show_uncompensated and scenario.actuation.compensate_deflection:
        sagging = _uncompensated(scenario, setup)
    judgement = judge_run(scenario, setup, run, proofs=folder)
    assessment = judgement.assessment
    write_series(folder, assessment)
    write_run_figures(folder, assessment, sagging, judgement.certified)
    no_pictures = write_run_pictures(folder / "figures", scenario, setup, assessment)
    film = None
    if run.pan_tilt is not None:
        film = film_run(folder, scenario, setup, data=run.data, pan_tilt=run.pan_tilt)
    write_run_replay(
        folder / "replay.html",
        scenario,
        setup,
        title=f"{name}: {setup.arm.name} on {setup.motion.title}",
        time=run.data.time,
        joints=run.data.joints,
        legs=None if run.legs is None else run.legs.positions,
        bookmarks=run_bookmarks(assessment, supervised.decisions if supervised else ()),
        phases=run_phases(run.data, setup.motion),
        note="" if film is None else film.note,
        seen=None if film is None else film.patches,
        panel=None if panel is None else panel(run.data.time, run.data.joints),
    )
    write_diagram(folder, run.diagram)
    summary = (
        numbers
        | judgement.summary
        | {
            "simulated_s": run.run_time.simulated_s,
            "wall_s": run.run_time.wall_s,
            "real_time_rate": run.run_time.real_time_rate,
            "actuation_fidelity": scenario.actuation.fidelity,
            "faults": [dataclasses.asdict(fault) for fault in scenario.faults],
            "cycle_returns": scenario.motion.retract,
            "cycle_time_s": run.station.GetSubsystemByName(
                motion_names(setup.motion).source
            ).duration,
            "cycle_completed": (
                scenario.duration_s <= 0.0 or run.run_time.simulated_s < scenario.duration_s
            )
            and (supervised is None or supervised.completed),
        }
    )
    if supervised is not None:
        write_csv(supervised.log.series(), folder / "supervisor.csv")
    if run.legs is not None:
        write_gaps(folder, setup.arm, run.data.time, run.legs.gaps)
        step = plant_time_step(scenario)
        summary |= {"loop_gap_max_m": run.legs.gaps.max(), "plant_step_s": step}
    if film is not None:
        summary |= film.summary
    if no_pictures is not None:
        summary["renderings_missing"] = no_pictures
    if sagging is not None:
        summary["spine_error_max_uncompensated_m"] = sagging.spine_errors.max()
    return summary, list(judgement.failures)


def _uncompensated(scenario: SerpentineScenario, setup: SerpentineSetup) -> Assessment:
    """The way out alone, without compensation of the deflection."""
    other: SerpentineScenario = copy.deepcopy(scenario)
    other.actuation.compensate_deflection = False
    # It shows what would happen, however far off.
    other.supervisor.enabled = False
    other.motion.retract = False
    other.faults = []
    run = run_station(other, setup, label="simulating without compensation")
    return Assessment.of(scenario, setup, run.data)
