"""`pips plan`: from goals to a motion, and its verdict."""

from __future__ import annotations

import shutil
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pips_drake.config import dump_yaml
from pips_drake.errors import NotFollowableError
from pips_drake.planning.planner import GoalPlan, plan_to_goal
from pips_drake.planning.runs.workspace import Workspace, load_workspace
from pips_drake.planning.scenario import PlannerScenario, goal_point, serpentine_scenario
from pips_drake.scene.packages import find_arm_file, list_names
from pips_drake.serpentine.runs.check import check
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.twin.output_folder import output_folder, write_whole
from pips_drake.twin.summary import versions, write_summary
from pips_drake.twin.verdict import Verdict

Array = NDArray[np.float64]

#: The planned path, and the scenario that runs it, in a plan's folder.
PATH_FILE, RUN_FILE = "path.csv", "simulate.yaml"


@dataclass(frozen=True, kw_only=True, eq=False)
class Planned:
    """What was planned.

    Attributes:
        goals: a plan for each of the scenario's goals that was reached, in their order.
        failures: why there is no motion to all of them; empty if there is.
        wall_s: how long it took, s.
    """

    goals: tuple[GoalPlan, ...]
    failures: tuple[str, ...]
    wall_s: float


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
        planned = plan_motion(scenario, workspace)
        (partial / "figures").mkdir()
        summary: dict[str, Any] = {}
        failures = list(planned.failures)
        if planned.goals:
            run = write_motion(partial, scenario, planned, folder_of_names=folder)
            verdict = check(run, name=name, folder=partial, scene_file=workspace.scene_file)
            summary |= dict(verdict.summary)
            failures += verdict.failures
        summary |= {
            "scenario": name,
            "planning_wall_s": planned.wall_s,
            "verdict": "fail" if failures else "pass",
            "failures": failures,
            "versions": versions(),
        }
        write_whole(partial / "scenario.yaml", dump_yaml(scenario))
        write_summary(partial / "summary.json", summary)
    return Verdict(failures=tuple(failures), summary=summary, folder=out)


def plan_motion(scenario: PlannerScenario, workspace: Workspace) -> Planned:
    """Plans a scenario's motion.

    Raises:
        InputError: a goal is outside the workspace, or inside an obstacle.
    """
    began = time.perf_counter()
    goals, failures = [], []
    try:
        goals.append(
            plan_to_goal(
                workspace.arm,
                workspace.occupancy,
                goal_point(scenario, scenario.goals[0]),
                home_tip=workspace.home_tip,
                settings=workspace.settings,
            )
        )
    except NotFollowableError as error:
        failures.append(str(error))
    return Planned(goals=tuple(goals), failures=tuple(failures), wall_s=time.perf_counter() - began)


def write_motion(
    folder: Path, scenario: PlannerScenario, planned: Planned, *, folder_of_names: Path | None
) -> SerpentineScenario:
    """Writes what was planned, and the scenario that runs it, which is returned.

    Args:
        folder_of_names: where the scenario's relative file names start.
    """
    points = planned.goals[0].points
    header = "x_m,y_m,z_m"
    np.savetxt(folder / PATH_FILE, points, delimiter=",", header=header, comments="", fmt="%.12g")
    run = serpentine_scenario(scenario, path=PATH_FILE)
    if scenario.arm not in list_names("arm"):
        # A plan's folder needs nothing beside it.
        file = find_arm_file(scenario.arm, inside=folder_of_names)
        shutil.copy(file, folder / file.name)
        run = replace(run, arm=file.name)
    write_whole(folder / RUN_FILE, dump_yaml(run))
    return run
