"""Lays a path again and again, and gives more weight to what was short (`feasible`)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError, NotFollowableError
from pips_drake.planning.arm_clearance import arm_bodies, least_clearance, too_near
from pips_drake.planning.attempts import SHARES, Attempt, Judge, Short, Tried, Weights
from pips_drake.planning.planner import GoalPlan, Laid, home_of, judged, lay
from pips_drake.scene.signed_distance import SignedDistanceField
from pips_drake.serpentine.anchoring import anchor_path
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.follow_the_leader import FollowTheLeader, Solution
from pips_drake.serpentine.plan import check_start, fold_failures, joint_margins, make_plan
from pips_drake.serpentine.tip_path import TipPath
from pips_drake.units import DEGREE

Array = NDArray[np.float64]

#: Of the tip between postures that are looked at while the path is bent, m. Hinges turn by up to
#: some tenths of a degree more in between, which `_HINGE_ROOM` is for.
COARSE_STEP = 0.05
_HINGE_ROOM = 0.3 * DEGREE
# Clearance is looked for this far beyond the margin, m: what is farther is as good.
_BEYOND = 0.075
#: Between postures at which clearance is looked at first, m.
_CLEARANCE_STEP = 0.2
# What weights are raised by: everywhere, and about a bend so many times at most.
_MORE, _MUCH_MORE, _MOST_LOCAL = 2.0, 3.0, 4
# Raising them by less than this is of no use.
_LEAST_FACTOR = 1.02
# A path that heads for a surface so squarely has no way along it to arrive by.
_LEAST_ASIDE = 0.05
# An arm's chords are shorter than the path by this share at most, without hinges at their limits.
_CHORDS = 0.97
# A bend is at the lead's nail, or a contact at the goal, within so many links; what is done for the
# goal's sake before obstacles are made to repel more.
_NEAR, _MOST_AT_END = 1.5, 3
# A snake that does not rest within so many steps is taken as it is.
_MOST_STEPS = 600
# What is short and has not become less than this share of it has gained nothing; so often in a row,
# and it is given up.
_GAINED, _MOST_USELESS = 0.98, 5


class PathWork:
    """One path that is laid again and again."""

    def __init__(
        self,
        *,
        arm: SerpentineArm,
        field: SignedDistanceField,
        route: Array,
        home_tip: ArrayLike | None,
        nails: tuple[ArrayLike, ...],
        keep: TipPath | None,
        margin: float,
        weights: Weights,
    ) -> None:
        self._arm, self._field, self._route = arm, field, route
        self._home_tip, self._nails, self._keep = home_tip, nails, keep
        self._margin, self._weights = margin, weights
        self._solver = FollowTheLeader(arm)
        self._bodies = arm_bodies(arm)
        self._link = float(arm.average_module_length.mean())
        self._local = self._at_end = self._useless = 0
        self._least_short: dict[str, float] = {}
        # Where hinges and obstacles want the opposite, less and less is changed.
        self._factor, self._last_kind = _MORE, ""

    def check_start(self) -> None:
        """Refuses an arm that is too near to an obstacle before it begins."""
        arm = self._arm
        tip, along, _ = home_of(arm, self._home_tip)
        ahead, joints = tip - home_of(arm, None)[0], arm.joint_home.copy()
        if not arm.rail_is_placed_for_the_path:
            joints[0] += ahead @ along
            ahead = np.zeros(3)
        found = least_clearance(
            arm,
            self._field,
            lambda s: np.tile(joints, (len(s), 1)),
            [0.0, 0.0],
            shift=ahead,
            within=self._margin + _BEYOND,
            bodies=self._bodies,
        )
        if found.lower < self._margin:
            raise InputError(f"start: {too_near(self._field, found, self._margin)}")

    def check_length(self) -> None:
        """Refuses what is too far however the path is laid."""
        arm = self._arm
        tip, along, _ = home_of(arm, self._home_tip)
        there = float(arm.joint_upper[0] - arm.joint_home[0])
        if not arm.rail_is_placed_for_the_path:
            there -= float((tip - home_of(arm, None)[0]) @ along)
        way = np.linalg.norm(np.diff(self._route, axis=0), axis=1).sum()
        if self._keep is None:
            way += np.linalg.norm(self._route[0] - tip)
        else:
            way += self._keep.length - self._keep.home_arc_length
        if _CHORDS * way > there:
            goal = ", ".join(f"{x:.4g}" for x in self._route[-1])
            raise NotFollowableError(
                f"the goal ({goal}) m needs {way:.4g} m of arm beyond home by the way that was "
                f"chosen; must be {there:.4g} m or less, which is what arm '{arm.name}' feeds"
            )

    def try_once(self, judge: Judge | None) -> Tried:
        """Lays the path with the present weights, follows it, and measures."""
        weights = self._weights
        laid = lay(
            self._arm,
            self._field,
            self._route,
            home_tip=self._home_tip,
            nails=self._nails,
            keep=self._keep,
            end_direction=weights.end_direction,
            settings=weights.settings,
            nail_lead=weights.nail_lead,
            stiffness=weights.stiffness,
            max_steps=_MOST_STEPS,
        )
        path, _ = anchor_path(self._arm, laid.path)
        check_start(self._arm, path)
        begin = self._begin(path)
        count = max(2, math.ceil((path.length - begin) / COARSE_STEP) + 1)
        tips = np.linspace(begin, path.length, count)
        solution = self._solver.solve(path, tips)
        attempt = Attempt(
            change=weights.change,
            bending_stiffness=float(weights.stiffness.max()),
            tension=weights.settings.snake.tension,
            repulsion=weights.settings.repulsion.strength,
        )
        tried = Tried(attempt=attempt, laid=laid, short=self._no_posture(path, solution))
        if tried.short:
            return tried
        margins = joint_margins(self._arm, solution.joints)
        hinge, feed = float(margins[:, 1:].min()), float(margins[1:, 0].min())
        attempt = replace(attempt, hinge_margin=hinge, feed_margin=feed)
        tried = replace(tried, attempt=attempt)
        if hinge < _HINGE_ROOM:
            row, j = divmod(int(np.argmin(margins[:, 1:])), self._arm.joints - 1)
            arcs = solution.spine_arc_lengths[row]
            at = float(arcs[max(0, (j + 2 - self._arm.spine_indices[0]) // 2)])
            name = self._arm.joint_names[j + 1]
            sentence = self._hinge_sentence(name, hinge / DEGREE, path, tips[row])
            return replace(tried, short=Short("hinge", -hinge, at, sentence))
        if feed < 0.0:
            there = float(self._arm.joint_upper[0] - solution.joints[0, 0])
            sentence = (
                f"the feed of {there:.4g} m is {-1e3 * feed:.3g} mm too short for the path, which "
                f"is {path.length - path.home_arc_length:.4g} m long from home"
            )
            return replace(tried, short=Short("feed", -feed, path.length, sentence))
        return self._measured(tried, path, tips, judge)

    def plan_of(self, laid: Laid) -> GoalPlan:
        """With postures as fine as limits are checked."""
        return judged(self._arm, laid, make_plan(self._arm, anchor_path(self._arm, laid.path)[0]))

    def give_more(self, tried: Tried) -> bool:
        """Raises what an attempt was short of; whether that may be of use."""
        short = tried.short
        assert short is not None
        kind = {"posture": "bends", "hinge": "bends", "judge": "clearance"}.get(
            short.kind, short.kind
        )
        if self._last_kind and kind != self._last_kind:
            self._factor = math.sqrt(self._factor)
        self._last_kind = kind
        least = self._least_short.get(short.kind, math.inf)
        self._useless = 0 if short.amount < _GAINED * least else self._useless + 1
        self._least_short[short.kind] = min(least, short.amount)
        if kind == "bends":
            self._straighten(tried.laid.path, short.at)
        elif kind == "feed":
            change = f"tension x {_MORE:g}: the path is too long"
            self._weights = self._weights.tenser(_MORE, change)
        else:
            self._clear(tried.laid.path, short.at)
        return self._factor > _LEAST_FACTOR and self._useless < _MOST_USELESS

    def _straighten(self, path: TipPath, at: float) -> None:
        weights, begin = self._weights, self._begin(path)
        lead = begin + float(np.linalg.norm(self._route[0] - path.point(begin)))
        if self._keep is None and weights.nail_lead and abs(at - lead) < _NEAR * self._link:
            change = "the lead is let go: the sharpest bend is at its nail"
            self._weights = replace(weights, nail_lead=False, change=change)
        elif self._local < _MOST_LOCAL:
            self._local += 1
            self._stiffen(path, at)
        else:
            change = f"bending stiffness x {self._factor:.3g}"
            self._weights = weights.stiffer(self._factor, change)

    def _clear(self, path: TipPath, at: float) -> None:
        weights, goal = self._weights, self._route[-1]
        if path.length - at < _NEAR * self._link and self._at_end < _MOST_AT_END:
            self._at_end += 1
            # Along the surface that is nearest to the goal.
            out = self._field.nearest(goal[None]).gradients[0]
            heading = path.tangent(path.length)
            aside = heading - (heading @ out) * out
            if weights.end_direction is None and np.linalg.norm(aside) > _LEAST_ASIDE:
                change = "the path arrives along the surface that is nearest to the goal"
                self._weights = replace(weights, end_direction=aside, change=change)
            else:
                self._stiffen(path, path.length)
            return
        change = f"repulsion x {self._factor:.3g}"
        self._weights = weights.more_repelled(self._factor, change)

    def _stiffen(self, path: TipPath, at: float) -> None:
        """About a place."""
        begin = self._begin(path)
        length = path.length - begin
        away = (np.linspace(0.0, 1.0, SHARES) * length - (at - begin)) / self._link
        shares = self._weights.shares * (1.0 + (_MUCH_MORE - 1.0) * np.exp(-(away**2)))
        change = f"bending stiffness x {_MUCH_MORE:g} about {at - begin:.3g} m"
        self._weights = replace(self._weights, shares=shares, change=change)

    def _measured(self, tried: Tried, path: TipPath, tips: Array, judge: Judge | None) -> Tried:
        """The attempt with its clearance, and the plan if it is good."""
        laid = tried.laid
        count = max(2, math.ceil((tips[-1] - tips[0]) / _CLEARANCE_STEP) + 1)
        found = least_clearance(
            self._arm,
            self._field,
            lambda s: self._solver.solve(path, s).joints,
            np.linspace(tips[0], tips[-1], count),
            shift=laid.path.point(0.0) - path.point(0.0),
            within=self._margin + _BEYOND,
            enough=self._margin,
            bodies=self._bodies,
        )
        attempt = replace(tried.attempt, clearance=found.lower)
        tried = replace(tried, attempt=attempt, clearance=found)
        at = tips[-1]
        if found.obstacle >= 0:
            _, where = laid.path.nearest(found.point, tips[0], tips[-1])
            at = float(where[0])
        if found.lower < self._margin:
            ahead = found.tip_arc_length - path.home_arc_length
            sentence = too_near(self._field, found, self._margin, ahead)
            short = Short("clearance", self._margin - found.lower, at, sentence)
            return replace(tried, short=short)
        plan = self.plan_of(laid)
        tried = replace(tried, plan=plan)
        if not plan.plan.followable:  # what hides between coarse postures
            worst = float(np.nanmin(plan.plan.joint_margins[:, 1:]))
            return replace(tried, short=Short("hinge", -worst, at, plan.plan.failures[0]))
        if judge is not None:
            said, sentence = judge(plan)
            tried = replace(tried, attempt=replace(attempt, judged=said))
            if said < self._margin:
                return replace(tried, short=Short("judge", self._margin - said, at, sentence))
        return tried

    def _begin(self, path: TipPath) -> float:
        return path.home_arc_length if self._keep is None else self._keep.length

    def _no_posture(self, path: TipPath, solution: Solution) -> Short | None:
        """Where the arm cannot lie at all, or a spine point would go back."""
        amount = float((~solution.solved).mean())
        if amount > 0.0:
            row = int(np.argmin(solution.solved))
            sentence = self._solver.explain(path, solution, row)
            return Short("posture", amount, float(solution.tip_arc_lengths[row]), sentence)
        for failure in fold_failures(self._arm, path, solution):
            return Short("posture", 0.0, failure.tip_arc_length, failure.sentence)
        return None

    def _hinge_sentence(self, name: str, margin: float, path: TipPath, tip: float) -> str:
        """For attempts of which there is no fine plan, whose sentences say more; margin in deg."""
        how = f"is {-margin:.3g} deg beyond its limit"
        if margin >= 0.0:
            how = f"comes within {margin:.3g} deg of its limit"
        return f"joint {name} {how}, with the tip {tip - path.home_arc_length:.4g} m from home"
