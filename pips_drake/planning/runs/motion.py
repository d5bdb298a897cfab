"""What a scenario's goals become: paths that the arm follows, or joints over time."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

from pips_drake.errors import NotFollowableError
from pips_drake.planning.attempts import Judge
from pips_drake.planning.runs.goal import plan_goal
from pips_drake.planning.runs.improve import plan_improved
from pips_drake.planning.runs.planned import Planned
from pips_drake.planning.runs.prover import Prover
from pips_drake.planning.runs.scan import plan_surface
from pips_drake.planning.runs.tour import plan_goals
from pips_drake.planning.runs.workspace import Workspace
from pips_drake.planning.scenario import PlannerScenario


def plan_motion(
    scenario: PlannerScenario,
    workspace: Workspace,
    *,
    judge: Judge | None = None,
    folder: Path | None = None,
) -> Planned:
    """Plans a scenario's motion.

    Args:
        judge: asked for a plan's clearance; a `Prover` by default, unless the scenario's
            certificate is off.
        folder: where the scenario's relative file names start.

    Raises:
        InputError: a goal is outside the workspace or too near to an obstacle, a file cannot be
            used.
    """
    began = time.perf_counter()
    if judge is None and scenario.certificate.enabled:
        judge = Prover(scenario, workspace)
    try:
        if scenario.scan.pattern:
            planned = plan_surface(scenario, workspace, folder=folder)
        elif scenario.improve:
            planned = plan_improved(scenario, workspace, judge, folder=folder)
        elif len(scenario.goals) > 1:
            planned = plan_goals(scenario, workspace, judge)
        else:
            planned = plan_goal(scenario, workspace, scenario.goals[0], judge)
    except NotFollowableError as error:
        planned = Planned(failures=(str(error),))
    return replace(planned, wall_s=time.perf_counter() - began)
