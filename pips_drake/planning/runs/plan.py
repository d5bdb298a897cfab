"""`pips plan`: from goals to a motion, and its verdict."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pips_drake.config import dump_yaml
from pips_drake.planning.runs.motion import plan_motion
from pips_drake.planning.runs.pictures import write_coverage, write_plan_replay, write_views
from pips_drake.planning.runs.planned import Planned
from pips_drake.planning.runs.workspace import Workspace, load_workspace
from pips_drake.planning.scenario import PlannerScenario, serpentine_scenario
from pips_drake.scene.packages import find_arm_file, list_names
from pips_drake.serpentine.joint_motion_file import write_joint_motion
from pips_drake.serpentine.runs.check import check_into
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import load_setup
from pips_drake.twin.output_folder import output_folder, write_whole
from pips_drake.twin.summary import versions, write_summary
from pips_drake.twin.verdict import Verdict

Array = NDArray[np.float64]

#: The planned path, or the planned joints, and the scenario that runs it, in a plan's folder.
PATH_FILE, JOINTS_FILE, RUN_FILE = "path.csv", "joints.npz", "simulate.yaml"


def plan(
    scenario: PlannerScenario,
    *,
    name: str,
    out: Path,
    force: bool = False,
    folder: Path | None = None,
    scene_file: Path | None = None,
) -> Verdict:
    """Plans a scenario's motion, judges it, and writes its folder.

    Args:
        name: the scenario's name, for the summary and titles.
        out: the folder to write; it appears whole or not at all.
        force: replace an earlier result there.
        folder: where the scenario's relative file names start.
        scene_file: stands for the scenario's scene.

    Raises:
        InputError: something that the scenario names cannot be used; nothing is written.
    """
    workspace = load_workspace(scenario, folder=folder, scene_file=scene_file)
    with output_folder(out, force=force) as partial:
        planned = plan_motion(scenario, workspace, folder=folder)
        (partial / "figures").mkdir()
        summary: dict[str, Any] = {}
        failures = list(planned.failures)
        if planned.plans:
            run, files = write_motion(partial, scenario, workspace, planned, folder=folder)
            setup = load_setup(run, folder=partial, **files)
            verdict = check_into(partial, run, setup, name=name)
            page = partial / "replay.html"
            write_plan_replay(page, name, scenario, workspace, planned, run, setup)
            write_coverage(partial / "figures" / "coverage.png", planned)
            summary |= dict(verdict.summary)
            failures += [said for said in verdict.failures if said not in failures]
        write_views(partial / "figures" / "views.png", name, scenario, workspace, planned)
        summary |= planned.numbers | {
            "scenario": name,
            "notes": list(planned.notes),
            "planning_wall_s": planned.wall_s,
            "verdict": "fail" if failures else "pass",
            "failures": failures,
            "versions": versions(),
        }
        write_whole(partial / "scenario.yaml", dump_yaml(scenario))
        write_summary(partial / "summary.json", summary)
    return Verdict(failures=tuple(failures), summary=summary, folder=out)


def write_motion(
    to: Path,
    scenario: PlannerScenario,
    workspace: Workspace,
    planned: Planned,
    *,
    folder: Path | None,
) -> tuple[SerpentineScenario, dict[str, Any]]:
    """Writes what was planned and the scenario that runs it.

    Args:
        to: where to.
        folder: where the planner's scenario's relative file names start.

    Returns:
        The scenario, and what else `check` and `simulate` of it want: `scene_file`.
    """
    names: dict[str, Any] = {}
    if planned.motion is None:
        _write_path(to / PATH_FILE, planned.plans[0].points)
        names["path"] = PATH_FILE
    else:
        write_joint_motion(to / JOINTS_FILE, workspace.arm, planned.motion)
        names |= {"joints": JOINTS_FILE, "rail_shift": float(planned.plans[0].shift[2])}
        for number, made in enumerate(planned.plans, start=1):
            _write_path(to / f"path_{number}.csv", made.points)
    run = serpentine_scenario(scenario, **names)
    if planned.motion is not None and planned.scan is None:
        # A tour dwells at its goals and comes home by itself.
        run = replace(run, motion=replace(run.motion, dwell_s=0.0, retract=False))
    if scenario.arm not in list_names("arm"):
        # A plan's folder needs nothing beside it.
        file = find_arm_file(scenario.arm, inside=folder)
        shutil.copy(file, to / file.name)
        run = replace(run, arm=file.name)
    scene_file = workspace.scene_file
    if workspace.obstacles.configs:
        shipped = scenario.scene in list_names("scene")
        scene = scenario.scene if shipped or scene_file is None else str(scene_file)
        scene_file = workspace.obstacles.write_scene(to, scene)
        run = replace(run, scene=scene_file.name)
    write_whole(to / RUN_FILE, dump_yaml(run))
    return run, {"scene_file": scene_file}


def _write_path(file: Path, points: Array) -> None:
    """A path's points as `pips follow`, `check` and `simulate` read them."""
    header = "x_m,y_m,z_m"
    np.savetxt(file, points, delimiter=",", header=header, comments="", fmt="%.12g")
