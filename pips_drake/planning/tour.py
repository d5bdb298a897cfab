"""Goals in order: out to one, back to where the way to the next begins, and on (CMU-92, 3.3).

Each leg is a path of the tip from home to its goal. Up to its origin it is exactly the leg before
it, on which the arm still lies when it has drawn back to there (`kept_path`): so the joints are the
same on both, and the arm changes from one to the other at rest, without moving.

The rule says where a leg begins (`origins`). A way that turns too sharply there for the joints is
tried again from farther back, by more and more links, and then from home.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError, NotFollowableError
from pips_drake.planning.attempts import Judge
from pips_drake.planning.feasible import (
    MOST_ATTEMPTS,
    FeasiblePlan,
    make_feasible,
    plan_feasibly,
)
from pips_drake.planning.kept_path import cut_path
from pips_drake.planning.occupancy import Occupancy
from pips_drake.planning.origins import OriginRule, extend
from pips_drake.planning.planner import ROUGHLY, PlannerSettings, route_through
from pips_drake.serpentine.anchoring import anchor_path
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.follow_the_leader import FollowTheLeader
from pips_drake.serpentine.joint_motion import JointMotion
from pips_drake.serpentine.motion_profile import RestToRestProfile
from pips_drake.serpentine.tip_path import TipPath

Array = NDArray[np.float64]

#: Points of a line that origins are looked for on are so far apart, m.
_LINE_STEP = 0.02
# An origin that is nearer to the end than this is the end, m.
_SAME = 1e-3
# By so many links the arm is drawn back farther, before it begins at home.
_FARTHER_BACK = (0, 1, 2, 3, 4, 6, 8, 11, 14)
# From such an origin, so many attempts: another origin may be better than much bending.
_FEW_ATTEMPTS = 4
# A way that begins more than this away from where the tip points is none, rad.
_TURNED_BACK = math.radians(100.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Goal:
    """Where the tip shall go.

    Attributes:
        point: (3,) m in frame_0.
        name: for messages.
        nails: places that the way there goes through, such as the middle of an opening, (3,) each.
        end_direction: along which it shall arrive, (3,); None where that does not matter.
    """

    point: ArrayLike
    name: str = ""
    nails: Sequence[ArrayLike] = ()
    end_direction: ArrayLike | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Leg:
    """From an origin on the leg before to a goal.

    Attributes:
        path: of the tip, from home to the goal, in frame_0.
        origin: where the tip is when it leaves the leg before, m of arc length; home's for the
            first.
        rule: that the origin is by; None for the first, and where the arm had to be drawn back
            farther.
        made: the verdict and all that was tried.
    """

    goal: Goal
    path: TipPath
    origin: float
    rule: OriginRule | None
    made: FeasiblePlan


@dataclass(frozen=True, kw_only=True, eq=False)
class Tour:
    """Legs to goals in order. `failures` is empty if and only if all are there and good.

    Attributes:
        legs: those that were made, in order; a last one may be no good, and `failures` says why.
        back_home: whether the arm is drawn back to home in the end.
    """

    arm: SerpentineArm
    legs: tuple[Leg, ...]
    failures: tuple[str, ...]
    back_home: bool = False
    _solver: FollowTheLeader = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_solver", FollowTheLeader(self.arm))

    @property
    def feasible(self) -> bool:
        """Whether all goals are there and good."""
        return not self.failures

    @property
    def shift(self) -> Array:
        """Where the arm's frame {0} stands in frame_0, (3,) m: the same for all legs."""
        return self.legs[0].made.best.shift

    @property
    def tip_travel(self) -> float:
        """How far the tip goes, out and back, m."""
        return sum(abs(last - first) for _, first, last in self.strokes())

    def strokes(self) -> Iterator[tuple[Leg, float, float]]:
        """What the tip does: along a leg's path from one arc length to another, m."""
        for k, leg in enumerate(self.legs):
            yield leg, leg.origin, leg.path.length
            if k + 1 < len(self.legs):
                back = self.legs[k + 1].origin
            elif self.back_home:
                back = leg.path.home_arc_length
            else:
                return
            if leg.path.length > back:
                yield leg, leg.path.length, back

    def joint_motion(
        self, *, speed: float, ramp: float, rate_hz: float, dwell: float = 0.0
    ) -> JointMotion:
        """The joints over time: each stroke of the tip from rest to rest.

        Args:
            speed: of the tip, m/s.
            ramp: in which it reaches that, s.
            rate_hz: of the rows, 1/s.
            dwell: that the arm rests at each goal, s.

        Raises:
            InputError: a number that is not positive, or a tour without legs.
            NotFollowableError: a leg that the arm cannot follow.
        """
        if not (math.isfinite(rate_hz) and rate_hz > 0.0):
            raise InputError(f"rate = {rate_hz} 1/s; must be > 0")
        if not (math.isfinite(dwell) and dwell >= 0.0):
            raise InputError(f"dwell = {dwell} s; must be 0 or more")
        if not self.legs:
            raise InputError("tour without a leg; must have one or more")
        times, now = [np.zeros(1)], 0.0
        joints: list[Array] = []
        for leg, first, last in self.strokes():
            profile = RestToRestProfile.make(travel=abs(last - first), speed=speed, ramp=ramp)
            count = max(2, math.ceil(profile.duration * rate_hz) + 1)
            t = np.linspace(0.0, profile.duration, count)
            done = np.array([profile(float(one))[0] for one in t])
            done[-1] = abs(last - first)
            q = self._joints_at(leg, first + math.copysign(1.0, last - first) * done)
            if not joints:
                joints.append(q[:1])
            times.append(now + t[1:])
            joints.append(q[1:])
            now += profile.duration
            if dwell > 0.0 and last == leg.path.length:
                now += dwell
                times.append(np.array([now]))
                joints.append(q[-1:])
        return JointMotion(times=np.concatenate(times), joints=np.concatenate(joints))

    def _joints_at(self, leg: Leg, s: Array) -> Array:
        path, _ = anchor_path(self.arm, leg.path)
        solution = self._solver.solve(path, s)
        if not solution.solved.all():
            row = int(np.argmin(solution.solved))
            raise NotFollowableError(self._solver.explain(path, solution, row), float(s[row]))
        return solution.joints


def plan_tour(
    arm: SerpentineArm,
    occupancy: Occupancy,
    goals: Sequence[Goal],
    rule: OriginRule,
    *,
    home_tip: ArrayLike | None = None,
    settings: PlannerSettings | None = None,
    margin: float,
    judge: Judge | None = None,
    most_attempts: int = MOST_ATTEMPTS,
    back_home: bool = False,
) -> Tour:
    """Paths to goals in order, each bent until the arm can follow it with a clearance.

    The first leg that is no good is the last one.

    Args:
        goals: one or more. An intermediate goal, at an access port for example, is a goal.
        rule: what is kept small from one goal to the next.
        occupancy, home_tip, settings, margin, judge, most_attempts: as of
            `feasible.plan_feasibly`.
        back_home: whether the arm is drawn back to home in the end.

    Raises:
        InputError: no goal, or one that cannot be; the arm collides before it begins.
    """
    if not goals:
        raise InputError("tour without a goal; must have one or more")
    work = _Legs(
        arm=arm,
        occupancy=occupancy,
        rule=rule,
        home_tip=home_tip,
        settings=settings,
        margin=margin,
        judge=judge,
        most_attempts=most_attempts,
    )
    legs: list[Leg] = []
    failures: list[str] = []
    for number, goal in enumerate(goals, start=1):
        name = f"goal {number}" + (f" ({goal.name})" if goal.name else "")
        try:
            leg = work.next_one(legs[-1].path, goal) if legs else work.from_home(goal)
        except NotFollowableError as error:
            failures.append(f"{name}: {error}")
            break
        except InputError as error:
            raise InputError(f"{name}: {error}") from None
        legs.append(leg)
        if not leg.made.feasible:
            failures += [f"{name}: {words}" for words in leg.made.failures]
            break
    return Tour(arm=arm, legs=tuple(legs), failures=tuple(failures), back_home=back_home)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Legs:
    """Makes legs; attributes as the arguments of `plan_tour`."""

    arm: SerpentineArm
    occupancy: Occupancy
    rule: OriginRule
    home_tip: ArrayLike | None
    settings: PlannerSettings | None
    margin: float
    judge: Judge | None
    most_attempts: int

    def from_home(self, goal: Goal) -> Leg:
        made = plan_feasibly(
            self.arm,
            self.occupancy,
            goal.point,
            home_tip=self.home_tip,
            nails=goal.nails,
            end_direction=goal.end_direction,
            settings=self.settings,
            margin=self.margin,
            judge=self.judge,
            most_attempts=self.most_attempts,
        )
        path = made.best.path
        return Leg(goal=goal, path=path, origin=path.home_arc_length, rule=None, made=made)

    def next_one(self, path: TipPath, goal: Goal) -> Leg:
        """From where the rule has it; if that is no good, from farther back."""
        best: Leg | None = None
        for origin, route, rule in self._beginnings(path, goal):
            try:
                made = make_feasible(
                    self.arm,
                    self.occupancy.field,
                    route,
                    keep=cut_path(path, origin),
                    home_tip=self.home_tip,
                    nails=goal.nails,
                    end_direction=goal.end_direction,
                    settings=self.settings,
                    margin=self.margin,
                    judge=self.judge,
                    most_attempts=min(_FEW_ATTEMPTS, self.most_attempts),
                )
            except NotFollowableError:  # too long from there
                continue
            leg = Leg(goal=goal, path=made.best.path, origin=origin, rule=rule, made=made)
            if made.feasible:
                return leg
            best = best or leg
        try:
            leg = self.from_home(goal)
        except NotFollowableError:
            if best is None:
                raise
            return best
        return leg if leg.made.feasible or best is None else best

    def _beginnings(
        self, path: TipPath, goal: Goal
    ) -> Iterator[tuple[float, Array, OriginRule | None]]:
        """Where on a path a way to the goal may begin, m of arc length, and that way."""
        home, places = path.home_arc_length, [*goal.nails, goal.point]
        count = max(2, math.ceil((path.length - home) / _LINE_STEP) + 1)
        arcs = np.linspace(home, path.length, count)
        found = extend(
            self.occupancy,
            path.point(arcs),
            places[0],
            rule=self.rule,
            arm_length=float(self.arm.joint_upper[0] - self.arm.joint_home[0]),
        )
        rest = None
        if len(places) > 1:
            rest = route_through(self.occupancy, places, most_rounds=ROUGHLY)[1][1:]
        origin = home + found.origin
        if origin > path.length - _SAME:  # the line's chords are shorter
            origin = path.length
        link = float(self.arm.average_module_length.mean())
        for back in _FARTHER_BACK:
            s = origin - back * link
            if s <= home + link:  # as well from home
                return
            way = found.path
            if back:
                try:
                    begin = [path.point(s), places[0]]
                    _, way = route_through(self.occupancy, begin, most_rounds=ROUGHLY)
                except (InputError, NotFollowableError):  # too near to an obstacle to begin there
                    continue
            ahead = way[int(np.argmax(np.linalg.norm(way - way[0], axis=1) > 0.5 * link))] - way[0]
            cosine = float(ahead @ path.tangent(s)) / max(float(np.linalg.norm(ahead)), 1e-12)
            if cosine < math.cos(_TURNED_BACK):
                continue
            whole = way if rest is None else np.vstack([way, rest])
            yield s, whole, None if back else found.rule
