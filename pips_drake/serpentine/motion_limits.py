"""The limits of an arm's drives as limits of the tip's motion along a path.

Follow-the-leader makes the joints functions of the tip's arc length, q(s). With drive coordinates
y(q), joint rates are q' s', drive speeds y' s', drive accelerations y' s'' + y'' s'^2, and efforts

    tau = M q' s'' + (M q'' + C(q, q') q') s'^2 + g(q),

over the levers dy/dq those of the drives. Primes of q and y are by arc length, of s by time. q' is
exact (`joint_rates`); q'' and y'' are differences of the exact q' and y' over an interval, the mean
of what they are in it: on a smooth path of lines and arcs q'' jumps where a spine point passes from
one to the other, and has no value there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError, NotFollowableError
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.drives import drive_limits, drive_names, levers
from pips_drake.serpentine.dynamics import inverse_dynamics
from pips_drake.serpentine.follow_the_leader import FollowTheLeader
from pips_drake.serpentine.time_optimal import (
    BindingSegment,
    TimeOptimalProfile,
    TravelLimits,
    binding_limits,
    binding_segments,
    fastest_squared_speed,
)
from pips_drake.serpentine.tip_path import TipPath

Array = NDArray[np.float64]

#: Spacing of the grid on which the fastest motion is found, m.
GRID_STEP = 1e-3
#: At most this many intervals: longer paths get a wider grid.
MOST_INTERVALS = 20_000
#: At least this many: of a short path too.
LEAST_INTERVALS = 200
#: Share of a limit that is left for motion at least where rest all but uses it up: there, smoothing
#: may cost this much more than the limit, and stretches time without end if nothing is left.
_NO_ROOM = 1e-3
#: How often a smoothed motion is corrected where it breaks limits; more gains less than 0.1 %.
_SMOOTHING_ROUNDS = 4
#: Kinds of a drive's limits, in the order of `motion_limits`: a bound of speed, then the bands.
KINDS = ("speed", "acceleration", "force")
#: No tip is faster, whatever the drives allow, m/s.
FASTEST_TIP = 10.0


@dataclass(frozen=True, kw_only=True, eq=False)
class PathMotion:
    """Joints and drives along a path: at N points and in the middle of the N - 1 intervals.

    Attributes:
        travel: the tip's, from home, (N,) m.
        drive_rates: y' at the points, (N, J), over m.
        middle_rates, middle_changes: y' and y'' in the middles, (N - 1, J).
        inertia, swing, hold: drive efforts M q', M q'' + C q' and g in the middles over the levers,
            (N - 1, J): times s'', times s'^2, and at rest.
    """

    arm: SerpentineArm
    travel: Array
    drive_rates: Array
    middle_rates: Array
    middle_changes: Array
    inertia: Array
    swing: Array
    hold: Array


def path_motion(
    arm: SerpentineArm, path: TipPath, gravity: ArrayLike, *, step: float = GRID_STEP
) -> PathMotion:
    """Solves a path and its dynamics on a grid of the tip's arc length.

    Args:
        gravity: in frame {0}, (3,) m/s^2.
        step: of the grid, m.

    Raises:
        InputError: the path has corners, where the drives' speeds would have to jump.
        NotFollowableError: a tip position has no solution.
    """
    if not path.is_smooth:
        corner = math.degrees(float(path.corner_angles().max()))
        raise InputError(
            f"path '{path.name}' has corners (up to {corner:.3g} deg), where only rest keeps a "
            "limit of acceleration; must be smooth (corner_deviation_in > 0)"
        )
    count = math.ceil(path.travel / step)
    count = min(max(count, LEAST_INTERVALS), MOST_INTERVALS)
    travel = np.linspace(0.0, path.travel, 2 * count + 1)
    tips = np.minimum(path.home_arc_length + travel, path.length)
    solver = FollowTheLeader(arm)
    solution = solver.solve(path, tips)
    failed = np.flatnonzero(~solution.solved)
    if failed.size:
        i = int(failed[0])
        raise NotFollowableError(solver.explain(path, solution, i), float(tips[i]))
    rates = solver.rates(path, solution.joints, solution.spine_arc_lengths)
    lever = levers(arm, solution.joints)
    drive_rates = lever * rates
    points = travel[::2]
    interval = np.diff(points)[:, None]
    middle, changes = solution.joints[1::2], np.diff(rates[::2], axis=0) / interval
    still = np.zeros_like(middle)
    hold = inverse_dynamics(arm, middle, still, still, gravity)
    return PathMotion(
        arm=arm,
        travel=points,
        drive_rates=drive_rates[::2],
        middle_rates=drive_rates[1::2],
        middle_changes=np.diff(drive_rates[::2], axis=0) / interval,
        inertia=(inverse_dynamics(arm, middle, still, rates[1::2], gravity) - hold) / lever[1::2],
        swing=(inverse_dynamics(arm, middle, rates[1::2], changes, gravity) - hold) / lever[1::2],
        hold=hold / lever[1::2],
    )


def motion_limits(
    motion: PathMotion,
    *,
    share: float = 1.0,
    tip_speed: float = math.inf,
) -> TravelLimits:
    """The limits of a motion along a path.

    Args:
        share: of each drive's limits of speed, acceleration and effort that the motion may use.
        tip_speed: limit of the tip's speed, m/s.

    Raises:
        InputError: a share outside (0, 1], or a tip speed that is not > 0.
    """
    if not 0.0 < share <= 1.0:
        raise InputError(f"share of the drives' limits = {share}; must be > 0 and <= 1")
    if not tip_speed > 0.0:
        raise InputError(f"tip speed limit = {tip_speed} m/s; must be > 0")
    arm = motion.arm
    _, _, speed_limit, effort_limit = drive_limits(arm)
    speed, effort = share * speed_limit, share * effort_limit
    acceleration = share * speed_limit / arm.drive_acceleration_time
    with np.errstate(divide="ignore"):
        speeds = speed / np.abs(motion.drive_rates)
    tip = np.full((len(motion.travel), 1), min(tip_speed, FASTEST_TIP))
    return TravelLimits(
        travel=motion.travel,
        speed=np.hstack([tip, speeds]),
        slope=np.hstack([motion.middle_rates / acceleration, motion.inertia / effort]),
        curve=np.hstack([motion.middle_changes / acceleration, motion.swing / effort]),
        offset=np.hstack([np.zeros_like(motion.middle_rates), motion.hold / effort]),
        names=("tip speed", *(f"{drive} {kind}" for kind in KINDS for drive in drive_names(arm))),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class FastestMotion:
    """The fastest motion along a path, what it is held back by, and the smooth profile of it.

    Attributes:
        share: of the drives' limits that it may use; `limits` are those shares.
        squared_speed: of the motion at the limits, before it is smoothed, (N,) m^2/s^2.
    """

    motion: PathMotion
    share: float
    limits: TravelLimits
    squared_speed: Array
    profile: TimeOptimalProfile

    @cached_property
    def binding(self) -> tuple[NDArray[np.int_], Array]:
        """Index of the limit that binds in each interval, and the share of it used, (N - 1,)."""
        return binding_limits(self.limits, self.squared_speed)

    @cached_property
    def segments(self) -> tuple[BindingSegment, ...]:
        """Where which limit binds, in order."""
        return binding_segments(self.limits, self.squared_speed, self.binding[0])

    @cached_property
    def binding_time(self) -> dict[str, float]:
        """For how long each limit binds that does, s, the longest first."""
        found: dict[str, float] = {}
        for segment in self.segments:
            found[segment.name] = found.get(segment.name, 0.0) + segment.duration
        return dict(sorted(found.items(), key=lambda item: -item[1]))


def fastest_motion(
    motion: PathMotion,
    *,
    share: float = 1.0,
    tip_speed: float = math.inf,
    smoothing: float = 0.0,
) -> FastestMotion:
    """The fastest motion within limits (`motion_limits`), smoothed, and slowed until it keeps them.

    Args:
        smoothing: window of the average over time, s (`TimeOptimalProfile`).

    Raises:
        NotFollowableError: the arm cannot even be held still within the limits.
    """
    limits = motion_limits(motion, share=share, tip_speed=tip_speed)
    x = fastest_squared_speed(limits)
    if smoothing > 0.0:
        profile = smooth_within_limits(limits, x, smoothing)
    else:
        profile = TimeOptimalProfile(points=limits.travel, squared_speed=x)
    return FastestMotion(
        motion=motion, share=share, limits=limits, squared_speed=x, profile=profile
    )


def profile_shares(
    limits: TravelLimits, profile: TimeOptimalProfile, time: ArrayLike
) -> tuple[Array, Array]:
    """What a profile uses at times (T,) s of speed limits, (T, V), and of bands, signed, (T, B)."""
    travel, speed, acceleration = profile.motion(time)
    i = _intervals(limits, travel)
    speeds = speed[:, None] / np.minimum(limits.speed[i], limits.speed[i + 1])
    x = speed[:, None] ** 2
    bands = limits.slope[i] * acceleration[:, None] + limits.curve[i] * x + limits.offset[i]
    return speeds, bands


def _intervals(limits: TravelLimits, travel: Array) -> NDArray[np.int_]:
    """In which interval each travel (T,) m is."""
    found = np.searchsorted(limits.travel, travel, side="right") - 1
    return np.clip(found, 0, len(limits.travel) - 2)


def _excess(limits: TravelLimits, profile: TimeOptimalProfile, time: Array) -> Array:
    """By how much the motion at times (T,) s must be slower to keep its limits, (T,); 1 if it does.

    Time stretched by k divides speeds by k and what moves the bands by k^2, so every limit that is
    kept at rest is kept by some k.
    """
    speeds, bands = profile_shares(limits, profile, time)
    rest = limits.offset[_intervals(limits, profile.motion(time)[0])]
    moving = bands - rest
    room = np.maximum(1.0 - np.sign(moving) * rest, _NO_ROOM)
    squared = np.max(np.abs(moving) / room, axis=1, initial=1.0)
    return np.asarray(np.maximum(speeds.max(axis=1), np.sqrt(squared)))


def smooth_within_limits(
    limits: TravelLimits, squared_speed: Array, smoothing: float
) -> TimeOptimalProfile:
    """The fastest motion averaged over a window (s), and slowed where it then breaks its limits.

    An average over time leaves its place on the path, so it may use more than the limits there.
    Wherever it does, everything that entered the average is made slower by as much, and the fastest
    motion below that is found, a few times over; what is left is made good by stretching time.
    """
    best, cap = None, limits.speed_bound
    x = squared_speed
    for _ in range(_SMOOTHING_ROUNDS):
        profile = TimeOptimalProfile(points=limits.travel, squared_speed=x, smoothing=smoothing)
        time = np.linspace(0.0, profile.duration, 4 * len(limits.travel) + 1)
        excess = _excess(limits, profile, time)
        slowed = replace(profile, slowdown=max(1.0, float(excess.max())))
        if best is None or slowed.duration < best.duration:
            best = slowed
        over = np.flatnonzero(excess > 1.0)
        if over.size == 0:
            break
        plain = replace(profile, smoothing=0.0)
        first = _intervals(limits, plain.motion(time - smoothing)[0])
        last = _intervals(limits, plain.motion(time)[0]) + 1
        slower = np.ones(len(x))
        for k in over.tolist():
            part = slice(first[k], last[k] + 1)
            slower[part] = np.maximum(slower[part], excess[k])
        # Both ends are at rest already.
        cap = np.where(x > 0.0, np.minimum(cap, np.sqrt(x) / slower), cap)
        x = fastest_squared_speed(replace(limits, speed=np.minimum(limits.speed, cap[:, None])))
    assert best is not None
    return best
