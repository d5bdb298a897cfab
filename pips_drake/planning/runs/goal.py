"""A single goal of a scenario: the path there, and the arm's postures along it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pips_drake.errors import InputError, NotFollowableError
from pips_drake.planning.alternatives import Alternative, find_alternatives
from pips_drake.planning.attempts import Judge
from pips_drake.planning.feasible import FeasiblePlan, make_feasible
from pips_drake.planning.planner import ROUGHLY, GoalPlan, choose_route, home_of
from pips_drake.planning.runs.planned import Planned
from pips_drake.planning.runs.workspace import Workspace
from pips_drake.planning.scenario import GoalConfig, PlannerScenario, goal_point
from pips_drake.planning.viewing import Viewing, approach_along
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.drives import drive_efforts, drive_limits
from pips_drake.serpentine.mounting import mounting_gravity
from pips_drake.serpentine.statics import holding_efforts

Array = NDArray[np.float64]


def plan_goal(
    scenario: PlannerScenario, workspace: Workspace, goal: GoalConfig, judge: Judge | None
) -> Planned:
    """A single goal: the tip goes there, and the arm follows.

    Of several ways the shortest is taken that the arm can follow and its drives can hold, or that
    which the scenario chooses. If none is good, the shortest comes back with what is wrong with it.

    Raises:
        InputError: the goal is outside the workspace, or too near to an obstacle.
        NotFollowableError: there is no way, or the arm is too short for every one.
    """
    view = viewing_of(scenario, workspace, goal)
    alternatives = _alternatives(scenario, workspace, goal, view)
    if scenario.choose > max(len(alternatives), 1):
        raise NotFollowableError(
            f"choose = {scenario.choose}: there are {len(alternatives)} paths of different "
            f"homotopy to the goal; must be {len(alternatives)} or less"
        )
    routes = [one.pulled for one in alternatives]
    if not routes:
        routes = [_route(scenario, workspace, goal, view)]
    tried: dict[int, Planned] = {}
    notes: list[str] = []
    refused: NotFollowableError | None = None
    for number in range(len(routes)) if not scenario.choose else [scenario.choose - 1]:
        try:
            tried[number] = _plan_along(scenario, workspace, goal, view, routes[number], judge)
        except NotFollowableError as error:
            refused = refused or error
            notes.append(f"way {number + 1} was not taken: {error}")
            continue
        if not tried[number].failures:
            break
        notes.append(f"way {number + 1} was not taken: {tried[number].failures[0]}")
    if not tried:
        assert refused is not None
        raise refused
    good = [number for number, one in tried.items() if not one.failures]
    chosen = good[0] if good else min(tried)
    return replace(
        tried[chosen],
        alternatives=tuple(alternatives),
        chosen=chosen,
        notes=tuple(notes) if good else (),
        numbers=tried[chosen].numbers | _alternative_numbers(alternatives, chosen),
    )


def _plan_along(
    scenario: PlannerScenario,
    workspace: Workspace,
    goal: GoalConfig,
    view: Viewing | None,
    route: Array,
    judge: Judge | None,
) -> Planned:
    """The plan of one way."""
    nails = [np.array(nail) for nail in goal.nails_m]
    if view is not None:
        route = np.vstack([route, view.goal])
        nails += straight_end(view, workspace)
    found = make_feasible(
        workspace.arm,
        workspace.occupancy.field,
        route,
        home_tip=workspace.home_tip,
        nails=nails,
        end_direction=None if view is None else view.direction,
        settings=workspace.settings,
        margin=scenario.checks.clearance_min_mm * 1e-3,
        judge=judge,
    )
    numbers: dict[str, Any] = {"attempts": attempts_made(found)}
    failures = [*found.failures, *overload(scenario, workspace, found.best)]
    if view is not None:
        looks, more = look_back(workspace, found.best, view)
        numbers["goal_views"] = [looks]
        failures += more
    return Planned(plans=(found.best,), failures=tuple(failures), numbers=numbers)


def overload(scenario: PlannerScenario, workspace: Workspace, plan: GoalPlan) -> list[str]:
    """A sentence if a drive cannot hold the arm still somewhere on its way."""
    arm, solution = workspace.arm, plan.plan.solution
    joints = plan.plan.joints[solution.solved]
    if not len(joints):
        return []
    holding = holding_efforts(arm, joints, mounting_gravity(scenario.mounting))
    efforts = drive_efforts(arm, joints, holding)
    shares = np.abs(efforts) / drive_limits(arm)[3]
    row, drive = np.unravel_index(int(shares.argmax()), shares.shape)
    if shares[row, drive] <= scenario.checks.force_fraction_max:
        return []
    tip = float(solution.tip_arc_lengths[solution.solved][row])
    return [
        f"a drive needs {100.0 * shares[row, drive]:.0f} % of its effort limit to hold joint "
        f"{arm.joint_names[drive]} still with the tip at {tip:.3f} m of the path; must be <= "
        f"{100.0 * scenario.checks.force_fraction_max:g} %"
    ]


def viewing_of(scenario: PlannerScenario, workspace: Workspace, goal: GoalConfig) -> Viewing | None:
    """How the last link comes to lie in a goal's viewing direction; None if it has none."""
    if not goal.looks_along:
        return None
    # The arcs that round the path's corners take a little of the straight end.
    length = float(workspace.arm.average_module_length[-1]) + workspace.settings.snake.spacing
    return approach_along(
        workspace.occupancy.field,
        goal_point(scenario, goal),
        goal.looks_along,
        length=length,
        radius=workspace.occupancy.radius,
        within=math.radians(goal.looks_within_deg),
    )


def straight_end(view: Viewing, workspace: Workspace) -> list[Array]:
    """Nails along the path's straight end, a snake's spacing apart."""
    count = max(2, math.ceil(view.length / workspace.settings.snake.spacing))
    shares = np.arange(count) / count
    return [view.approach + share * (view.goal - view.approach) for share in shares]


def look_back(
    workspace: Workspace, plan: GoalPlan, view: Viewing
) -> tuple[dict[str, Any], list[str]]:
    """Where the last link looks at the goal: numbers, and a sentence if that is too far off."""
    spine = kinematics.spine_points(workspace.arm, plan.plan.joints[-1])[0]
    link = (spine[-1] - spine[-2]) / np.linalg.norm(spine[-1] - spine[-2])
    off = math.atan2(float(np.linalg.norm(np.cross(link, view.wanted))), float(link @ view.wanted))
    numbers = {"direction": link.tolist(), "off_rad": off, "within_rad": view.within}
    if off <= view.within:
        return numbers, []
    words = view.words if not view.possible else "the path does not come in straight enough"
    return numbers, [
        f"at the goal the last link looks {math.degrees(off):.1f} deg off; must be "
        f"{math.degrees(view.within):.3g} deg or less: {words}"
    ]


def _alternatives(
    scenario: PlannerScenario, workspace: Workspace, goal: GoalConfig, view: Viewing | None
) -> list[Alternative]:
    """Paths of different homotopy to choose from; none if one is enough."""
    if scenario.alternatives == 1:
        return []
    if goal.nails_m:
        raise InputError("alternatives = more than 1; must be 1 with nails, which choose the way")
    tip, along, _ = home_of(workspace.arm, workspace.home_tip)
    lead = tip + workspace.settings.lead * along
    there = goal_point(scenario, goal) if view is None else view.approach
    return find_alternatives(workspace.occupancy, lead, there, scenario.alternatives)


def _alternative_numbers(alternatives: Sequence[Alternative], chosen: int) -> dict[str, Any]:
    if not alternatives:
        return {}
    return {
        "alternative_chosen": chosen + 1,
        "alternatives": [
            {"choose": number, "length_m": one.length, "words": one.words}
            for number, one in enumerate(alternatives, start=1)
        ],
    }


def _route(
    scenario: PlannerScenario, workspace: Workspace, goal: GoalConfig, view: Viewing | None
) -> Array:
    """The shortest way to a goal, or to where the way looks along its view; through its nails."""
    there = goal_point(scenario, goal) if view is None else view.approach
    _, route = choose_route(
        workspace.arm,
        workspace.occupancy,
        there,
        home_tip=workspace.home_tip,
        nails=goal.nails_m,
        settings=workspace.settings,
        most_rounds=ROUGHLY,
    )
    return route


def attempts_made(found: FeasiblePlan) -> list[dict[str, Any]]:
    """What was tried, for `summary.json`."""
    return [
        {
            "change": attempt.change,
            "bending_stiffness_Nm2": attempt.bending_stiffness,
            "tension_N": attempt.tension,
            "repulsion_Nm2": attempt.repulsion,
            "hinge_margin_min_rad": attempt.hinge_margin,
            "rail_margin_min_m": attempt.feed_margin,
            "clearance_lower_m": attempt.clearance,
            "clearance_proved_m": attempt.judged,
        }
        for attempt in found.attempts
    ]
