"""Several goals of a scenario in order: out to one, back to where the next way begins, and on."""

from __future__ import annotations

from typing import Any

import numpy as np

from pips_drake.planning.attempts import Judge
from pips_drake.planning.origins import OriginRule
from pips_drake.planning.runs.goal import attempts_made, look_back, overload, viewing_of
from pips_drake.planning.runs.planned import Planned
from pips_drake.planning.runs.workspace import Workspace
from pips_drake.planning.scenario import PlannerScenario, goal_point
from pips_drake.planning.tour import Goal, Leg, plan_tour

#: Rows of a tour's joints, 1/s: at 25 mm/s they stand 3 mm of the tip's way apart.
RATE_HZ = 8.0


def plan_goals(scenario: PlannerScenario, workspace: Workspace, judge: Judge | None) -> Planned:
    """A tour of a scenario's goals.

    Raises:
        InputError: a goal is outside the workspace, or too near to an obstacle.
    """
    views = [viewing_of(scenario, workspace, goal) for goal in scenario.goals]
    goals = []
    for goal, view in zip(scenario.goals, views, strict=True):
        nails = [np.array(nail) for nail in goal.nails_m]
        goals.append(
            Goal(
                point=goal_point(scenario, goal),
                name=goal.name,
                nails=nails if view is None else [*nails, view.approach],
                end_direction=None if view is None else view.direction,
            )
        )
    tour = plan_tour(
        workspace.arm,
        workspace.occupancy,
        goals,
        OriginRule(scenario.origin),
        home_tip=workspace.home_tip,
        settings=workspace.settings,
        margin=scenario.checks.clearance_min_mm * 1e-3,
        judge=judge,
        back_home=scenario.motion.retract,
    )
    failures = list(tour.failures)
    looks = []
    for leg, view in zip(tour.legs, views, strict=False):
        failures += overload(scenario, workspace, leg.made.best)
        if view is not None and leg.made.feasible:
            numbers, more = look_back(workspace, leg.made.best, view)
            looks.append(numbers)
            failures += more
    good = len(tour.legs) == len(goals) and all(leg.made.feasible for leg in tour.legs)
    motion = None
    if good:
        motion = tour.joint_motion(
            speed=scenario.motion.tip_speed_mm_per_s * 1e-3,
            ramp=scenario.motion.ramp_s,
            rate_hz=RATE_HZ,
            dwell=scenario.motion.dwell_s,
        )
    numbers = {
        "legs": [_leg_numbers(leg) for leg in tour.legs],
        "tour_tip_travel_m": tour.tip_travel,
    }
    return Planned(
        plans=tuple(leg.made.best for leg in tour.legs),
        motion=motion,
        failures=tuple(failures),
        numbers=numbers | ({"goal_views": looks} if looks else {}),
    )


def _leg_numbers(leg: Leg) -> dict[str, Any]:
    """For `summary.json`."""
    return {
        "goal": leg.goal.name,
        "drawn_back_to_m": leg.origin - leg.path.home_arc_length,
        "rule": leg.rule.value if leg.rule else "",
        "exposed_length_m": leg.path.travel,
        "attempts": attempts_made(leg.made),
    }
