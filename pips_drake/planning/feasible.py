"""Paths that the arm can follow, clear of everything: bent until joints and clearance allow it.

A snake is a compromise. Its bending stiffness makes its bends wide, the obstacles' repulsion keeps
it away from them; which of both a place needs is known only after the arm was laid along it. So the
path is laid, followed and measured, and where something is short, that is given more weight:

- a hinge beyond its limit: the bending stiffness is doubled about the bend, then everywhere, and
  the lead is let go where the bend is at its nail;
- too little clearance: the repulsion is doubled; at the goal the path is made to arrive along the
  surface that is too near, and straighter;
- too little feed: the tension is doubled, which shortens the path.

Each weight is only raised, by less each time that hinges and obstacles want the opposite, and a
bounded number of attempts is made, so that it ends, and sooner where clearance no longer grows.
What was tried is kept. If no attempt is good, the best one comes back with sentences that say which
limit stops it and where.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from pips_drake.errors import InputError
from pips_drake.planning.arm_clearance import ClearanceBound
from pips_drake.planning.attempts import SHARES, TOLD, Attempt, Judge, Tried, Weights
from pips_drake.planning.bending import PathWork
from pips_drake.planning.occupancy import Occupancy
from pips_drake.planning.planner import ROUGHLY, GoalPlan, PlannerSettings, choose_route
from pips_drake.scene.signed_distance import SignedDistanceField
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.tip_path import TipPath

#: At most so many paths are laid; each takes some hundredths of a second.
MOST_ATTEMPTS = 12


@dataclass(frozen=True, kw_only=True, eq=False)
class FeasiblePlan:
    """The best of some attempts. `failures` is empty if and only if it is good.

    Attributes:
        best: the path and its postures.
        clearance: the arm's to the obstacles; None where it cannot follow.
        margin: that was wanted, m.
        failures: which limits stop it and where, in sentences.
        attempts: in the order in which they were made.
    """

    best: GoalPlan
    clearance: ClearanceBound | None
    margin: float
    failures: tuple[str, ...]
    attempts: tuple[Attempt, ...]

    @property
    def feasible(self) -> bool:
        """Whether the arm can follow it with the margin."""
        return not self.failures


def plan_feasibly(
    arm: SerpentineArm,
    occupancy: Occupancy,
    goal: ArrayLike,
    *,
    home_tip: ArrayLike | None = None,
    nails: Sequence[ArrayLike] = (),
    end_direction: ArrayLike | None = None,
    settings: PlannerSettings | None = None,
    margin: float,
    judge: Judge | None = None,
    most_attempts: int = MOST_ATTEMPTS,
) -> FeasiblePlan:
    """The shortest way to a goal, bent until the arm can follow it with a clearance.

    Args:
        occupancy, goal, home_tip: as of `planner.plan_to_goal`.
        nails, end_direction: as of `planner.plan_along`.
        margin: clearance that the arm's bodies must keep, m.
        judge: asked for the clearance of a path that is good otherwise, for example a certificate.
        most_attempts: 1 or more.

    Raises:
        InputError: a goal, home or nail that cannot be; the arm collides before it begins.
        NoPathError: there is no way.
        NotFollowableError: the arm is too short for the shortest way.
    """
    found, pulled = choose_route(
        arm,
        occupancy,
        goal,
        home_tip=home_tip,
        nails=nails,
        settings=settings,
        most_rounds=ROUGHLY,
    )
    made = make_feasible(
        arm,
        occupancy.field,
        pulled,
        home_tip=home_tip,
        nails=nails,
        end_direction=end_direction,
        settings=settings,
        margin=margin,
        judge=judge,
        most_attempts=most_attempts,
    )
    return replace(made, best=replace(made.best, found=found))


def make_feasible(
    arm: SerpentineArm,
    field: SignedDistanceField,
    route: ArrayLike,
    *,
    home_tip: ArrayLike | None = None,
    nails: Sequence[ArrayLike] = (),
    keep: TipPath | None = None,
    end_direction: ArrayLike | None = None,
    settings: PlannerSettings | None = None,
    margin: float,
    judge: Judge | None = None,
    most_attempts: int = MOST_ATTEMPTS,
    rough: bool = False,
) -> FeasiblePlan:
    """A route, bent until the arm can follow it with a clearance.

    Args:
        route, home_tip, nails, keep, end_direction, settings: as of `planner.plan_along`. With
            `keep`, what is judged begins where that ends.
        margin, judge, most_attempts: as of `plan_feasibly`.
        rough: the route is somebody's sketch: it begins beyond the home tip without a lead, and how
            long it is says nothing yet.

    Raises:
        InputError, NotFollowableError: as of `plan_feasibly`.
    """
    if not (math.isfinite(margin) and margin >= 0.0):
        raise InputError(f"clearance margin = {margin} m; must be 0 or more")
    if most_attempts < 1:
        raise InputError(f"most_attempts = {most_attempts}; must be 1 or more")
    work = PathWork(
        arm=arm,
        field=field,
        route=np.asarray(route, dtype=np.float64),
        home_tip=home_tip,
        nails=tuple(nails),
        keep=keep,
        margin=margin,
        weights=Weights(
            settings=settings or PlannerSettings(),
            end_direction=end_direction,
            shares=np.ones(SHARES),
            nail_lead=not rough,
        ),
    )
    if keep is None:
        work.check_start()
    if not rough:
        work.check_length()
    tried: list[Tried] = []
    for _ in range(most_attempts):
        tried.append(work.try_once(judge))
        if tried[-1].short is None or not work.give_more(tried[-1]):
            break
    best = min(tried, key=lambda one: one.badness)
    plan = best.plan or work.plan_of(best.laid)
    failures = list(plan.plan.failures)
    if best.short and not (failures and best.short.kind in TOLD):
        failures.append(best.short.sentence)
    # What is gained on one limit is lost on another: say so.
    others = [one for one in tried if best.short and one.short and one.kind != best.kind]
    for kind in dict.fromkeys(one.kind for one in others):
        other = min((one for one in others if one.kind == kind), key=lambda one: one.badness)
        assert other.short is not None
        failures.append(f"with other weights instead: {other.short.sentence}")
    return FeasiblePlan(
        best=plan,
        clearance=best.clearance,
        margin=margin,
        failures=tuple(failures),
        attempts=tuple(one.attempt for one in tried),
    )
