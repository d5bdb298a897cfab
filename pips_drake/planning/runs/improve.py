"""A path of the user's own, made into one that the arm can follow."""

from __future__ import annotations

from pathlib import Path

from pips_drake.planning.assisted import improve_path
from pips_drake.planning.attempts import Judge
from pips_drake.planning.runs.goal import attempts_made, overload
from pips_drake.planning.runs.planned import Planned
from pips_drake.planning.runs.workspace import Workspace
from pips_drake.planning.scenario import PlannerScenario
from pips_drake.scene.packages import find_path_file
from pips_drake.serpentine.path_file import read_points


def plan_improved(
    scenario: PlannerScenario,
    workspace: Workspace,
    judge: Judge | None,
    *,
    folder: Path | None = None,
) -> Planned:
    """The scenario's own path, improved.

    Args:
        folder: where the scenario's relative file names start.

    Raises:
        InputError: the file cannot be used, or its path does not begin on the arm's base line.
    """
    points = read_points(find_path_file(scenario.improve, inside=folder))
    found = improve_path(
        workspace.arm,
        workspace.occupancy.field,
        points,
        settings=workspace.settings,
        margin=scenario.checks.clearance_min_mm * 1e-3,
        judge=judge,
    )
    return Planned(
        plans=(found.made.best,),
        rough=points,
        failures=(*found.made.failures, *overload(scenario, workspace, found.made.best)),
        notes=(*(f"your path: {words}" for words in found.before), *found.crossed),
        numbers={
            "attempts": attempts_made(found.made),
            "moved_max_m": found.moved,
            "moved_max_at_m": found.moved_at.tolist(),
            "same_side": found.same_side,
            "failures_before": list(found.before),
        },
    )
