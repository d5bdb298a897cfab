"""The fastest motion along a given path within limits of speed and of what is linear in force.

Travel s(t) is the only unknown. With x = s'^2 (by time) and u = s'' every limit along the path is
either a bound of speed, |s'| <= v(s), or a band that is linear in both,

    -1 <= slope(s) u + curve(s) x + offset(s) <= 1,

which is what accelerations and forces become (`motion_limits`). On a grid of travel, u is constant
in an interval, so that x is linear there and the bands are kept at its middle. Two passes find the
largest x everywhere (reachability analysis after Pham and Pham, "A new approach to time-optimal
path parameterization based on reachability analysis", IEEE Transactions on Robotics, 2018):

1. from the end back: the largest x at each point from which the end can still be reached at rest;
2. from the start on: the largest x that the next interval can reach, at most that.
"""

from __future__ import annotations

import bisect
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError, NotFollowableError

Array = NDArray[np.float64]

#: A band at rest may exceed its limit by this share: roundings of what stands exactly at it.
_ROUNDING = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class TravelLimits:
    """Limits of a motion on N points of a path; V bounds of speed, B bands.

    Attributes:
        travel: the points, (N,) m, rising from 0.
        speed: bounds of speed at the points, (N, V) m/s; infinite where there is none.
        slope, curve, offset: of the bands in the middle of the intervals, (N - 1, B): in s^2/m, in
            s^2/m^2, and without unit, as shares of their limits.
        names: what each bound and then each band is called, (V + B).
    """

    travel: Array
    speed: Array
    slope: Array
    curve: Array
    offset: Array
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        rising = np.ndim(self.travel) == 1 and len(self.travel) >= 2 and self.travel[0] == 0.0
        if not (rising and np.all(np.diff(self.travel) > 0.0)):
            raise InputError("TravelLimits.travel: must rise from 0, two points or more")
        points, names = len(self.travel), len(self.names)
        bands = self.slope.shape[1:]
        for name, values, shape in (
            ("speed", self.speed, (points, *self.speed.shape[1:2])),
            ("slope", self.slope, (points - 1, *bands)),
            ("curve", self.curve, (points - 1, *bands)),
            ("offset", self.offset, (points - 1, *bands)),
        ):
            if values.shape != shape:
                raise InputError(f"TravelLimits.{name} of shape {values.shape}; must be {shape}")
        if self.speed.shape[1] + self.slope.shape[1] != names:
            raise InputError(f"TravelLimits.names: {names} names; must be one a bound and a band")
        for values in (self.slope, self.curve, self.offset):
            if not np.all(np.isfinite(values)):
                raise InputError("TravelLimits: bands must be finite numbers")
        if not np.all(self.speed > 0.0):
            raise InputError("TravelLimits.speed: must be > 0")
        if not np.all(np.isfinite(self.speed.min(axis=1, initial=math.inf))):
            raise InputError("TravelLimits.speed: nothing bounds the speed at some point")

    @cached_property
    def speed_bound(self) -> Array:
        """The lowest bound of speed at each point, (N,) m/s."""
        return np.asarray(self.speed.min(axis=1))

    def shares(self, squared_speed: Array) -> Array:
        """How much of each limit a motion x (N,) m^2/s^2 uses in each interval, (N - 1, V + B).

        Of a bound of speed the mean at the interval's two ends; of a band its size in the middle.
        """
        speed = np.sqrt(squared_speed)[:, None] / self.speed
        bands = self.band_values(squared_speed)
        return np.hstack([0.5 * (speed[:-1] + speed[1:]), np.abs(bands)])

    def band_values(self, squared_speed: Array) -> Array:
        """The bands of a motion x (N,) m^2/s^2, (N - 1, B); within -1 .. 1 where they are kept."""
        x = squared_speed
        u = 0.5 * np.diff(x) / np.diff(self.travel)
        middle = 0.5 * (x[1:] + x[:-1])
        return np.asarray(self.slope * u[:, None] + self.curve * middle[:, None] + self.offset)


def fastest_squared_speed(limits: TravelLimits) -> Array:
    """x = s'^2 (N,) m^2/s^2 of the fastest motion from rest to rest within limits.

    Raises:
        NotFollowableError: a band is broken already at rest, so that no motion keeps it; the
            message says which, where and by how much. Its data are the travel in m.
    """
    rest = np.abs(limits.offset)
    if rest.size and rest.max() > 1.0 + _ROUNDING:
        i, b = np.unravel_index(int(np.argmax(rest)), rest.shape)
        name = limits.names[limits.speed.shape[1] + int(b)]
        where = float(limits.travel[i])
        raise NotFollowableError(
            f"no motion keeps the limits: at rest {where:.4f} m from home, {name} stands at "
            f"{100.0 * rest[i, b]:.1f} % of what the motion may use",
            where,
        )
    # In terms of the x at both ends of an interval, before X <= ... <= after Y, a band reads
    # p X + q Y <= r, twice: for its upper and for its lower limit.
    inverse = 0.5 / np.diff(limits.travel)[:, None]
    p = 0.5 * limits.curve - inverse * limits.slope
    q = 0.5 * limits.curve + inverse * limits.slope
    rows = (
        np.hstack([p, -p]),
        np.hstack([q, -q]),
        np.maximum(np.hstack([1.0 - limits.offset, 1.0 + limits.offset]), 0.0),
    )
    return np.asarray(_two_passes(limits.speed_bound**2, *rows))


@numba.njit(cache=True)
def _range_of_next(p, q, r, before, most):
    """Which Y in [0, most] have p X + q Y <= r at X = before.

    Returns:
        the least and the largest Y, and how fast both change with X. The rows that decide move with
        X, so the range is a concave function of it.
    """
    low, high, low_rate, high_rate = 0.0, most, 0.0, 0.0
    for k in range(p.size):
        if q[k] > 0.0:
            bound = (r[k] - p[k] * before) / q[k]
            if bound < high:
                high, high_rate = bound, -p[k] / q[k]
        elif q[k] < 0.0:
            bound = (r[k] - p[k] * before) / q[k]
            if bound > low:
                low, low_rate = bound, -p[k] / q[k]
    return low, high, low_rate, high_rate


@numba.njit(cache=True)
def _largest_before(p, q, r, most_before, most_after):
    """The largest X <= most_before for which some Y in [0, most_after] has p X + q Y <= r.

    X = 0 with Y = 0 is always one (r >= 0). The range of Y shrinks as a concave function of X:
    Newton's method from the right, on lines that lie above it, ends at its root in a few steps.
    """
    before = most_before
    for k in range(p.size):
        if q[k] == 0.0 and p[k] > 0.0:
            before = min(before, r[k] / p[k])
    for _ in range(2 * p.size + 2):
        low, high, low_rate, high_rate = _range_of_next(p, q, r, before, most_after)
        gap = high - low
        if gap >= 0.0 or before <= 0.0:
            return max(before, 0.0)
        rate = high_rate - low_rate
        lower = before - gap / rate if rate < 0.0 else 0.0
        if not lower < before:
            return max(before, 0.0)
        before = max(lower, 0.0)
    return before


@numba.njit(cache=True)
def _two_passes(bound, p, q, r):
    """x (N,) from rows (N - 1, K) and upper bounds (N,) of it; both ends at rest."""
    points = bound.size
    most = np.empty(points)
    most[points - 1] = 0.0
    for i in range(points - 2, -1, -1):
        most[i] = _largest_before(p[i], q[i], r[i], bound[i], most[i + 1])
    x = np.empty(points)
    x[0] = 0.0
    for i in range(points - 1):
        low, high, _, _ = _range_of_next(p[i], q[i], r[i], x[i], most[i + 1])
        # Where the first pass's answer is met exactly, roundings may leave no room between them.
        x[i + 1] = min(max(high, low), most[i + 1])
    return x


def travel_time(travel: ArrayLike, squared_speed: ArrayLike) -> Array:
    """When a motion x (N,) m^2/s^2 that is linear between points (N,) m is where, (N,) s."""
    speed = np.sqrt(np.asarray(squared_speed))
    with np.errstate(divide="ignore"):
        steps = 2.0 * np.diff(travel) / (speed[1:] + speed[:-1])
    return np.concatenate([[0.0], np.cumsum(steps)])


@dataclass(frozen=True, kw_only=True, eq=False)
class TimeOptimalProfile:
    """Travel as a function of time, from x = s'^2 that is linear between points; from rest to rest.

    The acceleration is constant between points. With a `smoothing` of w > 0 the travel is averaged
    over a window of w: the acceleration is then continuous and zero at both ends, its rate of
    change at most 2 / w times the largest acceleration, and the motion takes w longer. A vibration
    whose period divides w is not excited at all by such an average. With 0 the acceleration jumps
    wherever the limit that binds changes. `slowdown` stretches time.

    Attributes:
        points: of travel, (N,) m.
        squared_speed: (N,) m^2/s^2, zero at both ends.
        smoothing: w, s, before the slowdown.
        slowdown: 1 or more.
    """

    points: Array
    squared_speed: Array
    smoothing: float = 0.0
    slowdown: float = 1.0

    def __post_init__(self) -> None:
        if not (self.smoothing >= 0.0 and math.isfinite(self.smoothing)):
            raise InputError(f"TimeOptimalProfile.smoothing = {self.smoothing} s; must be >= 0")
        if not (self.slowdown >= 1.0 and math.isfinite(self.slowdown)):
            raise InputError(f"TimeOptimalProfile.slowdown = {self.slowdown}; must be >= 1")
        x = self.squared_speed
        if not (np.all(x[1:-1] > 0.0) and x[0] == 0.0 and x[-1] == 0.0 and len(x) >= 3):
            raise InputError("TimeOptimalProfile.squared_speed: must be zero at both ends alone")

    @cached_property
    def _table(self) -> tuple[Array, Array, Array, Array]:
        """Times (N,) s, speeds (N,), accelerations (N - 1,), integral of travel by time (N,)."""
        time = travel_time(self.points, self.squared_speed)
        speed = np.sqrt(self.squared_speed)
        acceleration = 0.5 * np.diff(self.squared_speed) / np.diff(self.points)
        step = np.diff(time)
        area = self.points[:-1] * step + speed[:-1] * step**2 / 2 + acceleration * step**3 / 6
        return time, speed, acceleration, np.concatenate([[0.0], np.cumsum(area)])

    @property
    def travel(self) -> float:
        """m."""
        return float(self.points[-1])

    @property
    def duration(self) -> float:
        """s."""
        return self.slowdown * float(self._table[0][-1] + self.smoothing)

    def __call__(self, time: float) -> tuple[float, float]:
        """Travel (m) and speed (m/s) at a time (s); at rest before and after."""
        # A control loop asks: without arrays it is thirty times as fast as `motion`.
        clock, w = time / self.slowdown, self.smoothing
        if time <= 0.0:
            return 0.0, 0.0
        if time >= self.duration:
            return self.travel, 0.0
        _, travel, speed = self._unsmoothed_at(clock)
        if w > 0.0:
            area, late, _ = self._unsmoothed_at(clock)
            before, early, _ = self._unsmoothed_at(clock - w)
            travel, speed = (area - before) / w, (late - early) / w
        return min(max(travel, 0.0), self.travel), speed / self.slowdown

    @cached_property
    def _lists(self) -> tuple[list[float], ...]:
        """The table and the points, for looking one instant up."""
        return tuple(column.tolist() for column in (*self._table, self.points))

    def _unsmoothed_at(self, time: float) -> tuple[float, float, float]:
        """Integral of travel, travel and speed at one time, s."""
        times, speeds, accelerations, areas, points = self._lists
        if time <= 0.0:
            return 0.0, 0.0, 0.0
        if time >= times[-1]:
            return areas[-1] + points[-1] * (time - times[-1]), points[-1], 0.0
        i = bisect.bisect_right(times, time) - 1
        t, a, v, s = time - times[i], accelerations[i], speeds[i], points[i]
        area = areas[i] + t * (s + t * (v / 2.0 + t * a / 6.0))
        return area, s + t * (v + t * a / 2.0), v + a * t

    def motion(self, time: ArrayLike) -> tuple[Array, Array, Array]:
        """Travel (m), speed (m/s) and acceleration (m/s^2) at times (...) s."""
        clock = np.asarray(time, dtype=np.float64) / self.slowdown
        w = self.smoothing
        if w == 0.0:
            _, travel, speed, acceleration = self._unsmoothed(clock)
        else:
            now, before = self._unsmoothed(clock), self._unsmoothed(clock - w)
            travel, speed, acceleration = (
                (late - early) / w for late, early in zip(now[:3], before[:3], strict=True)
            )
            # Differences of large integrals: no farther than the ends, and there exactly.
            travel = np.clip(travel, 0.0, self.travel)
            over = clock * self.slowdown >= self.duration
            travel, speed = np.where(over, self.travel, travel), np.where(over, 0.0, speed)
        k = self.slowdown
        return np.asarray(travel), np.asarray(speed / k), np.asarray(acceleration / k**2)

    def _unsmoothed(self, time: Array) -> tuple[Array, Array, Array, Array]:
        """Integral of travel, travel, speed and acceleration at times (...) s."""
        times, speeds, accelerations, areas = self._table
        i = np.clip(np.searchsorted(times, time, side="right") - 1, 0, len(accelerations) - 1)
        inside = (time >= 0.0) & (time < times[-1])
        t = np.where(inside, time - times[i], 0.0)
        a, v, s = accelerations[i], speeds[i], self.points[i]
        beyond = np.maximum(time - times[-1], 0.0)
        after = time >= times[-1]
        area = areas[i] + s * t + v * t**2 / 2 + a * t**3 / 6
        area = np.where(after, areas[-1] + self.travel * beyond, np.where(time < 0.0, 0.0, area))
        travel = np.where(after, self.travel, np.where(time < 0.0, 0.0, s + v * t + a * t**2 / 2))
        return area, travel, np.where(inside, v + a * t, 0.0), np.where(inside, a, 0.0)


@dataclass(frozen=True, kw_only=True)
class BindingSegment:
    """A part of the path where one limit binds.

    Attributes:
        name: of the limit.
        start, end: travel, m.
        duration: s, of the motion at the limit (without smoothing).
    """

    name: str
    start: float
    end: float
    duration: float


def binding_limits(limits: TravelLimits, squared_speed: Array) -> tuple[NDArray[np.int_], Array]:
    """The limit that binds in each interval, and the share of it that is used, (N - 1,) each."""
    shares = limits.shares(squared_speed)
    which = shares.argmax(axis=1)
    return which, shares[np.arange(len(shares)), which]


def binding_segments(
    limits: TravelLimits, squared_speed: Array, which: Sequence[int] | NDArray[np.int_]
) -> tuple[BindingSegment, ...]:
    """Neighbouring intervals with the same binding limit as one segment each."""
    which = np.asarray(which)
    time = travel_time(limits.travel, squared_speed)
    cuts = np.concatenate([[0], np.flatnonzero(np.diff(which)) + 1, [len(which)]])
    return tuple(
        BindingSegment(
            name=limits.names[int(which[first])],
            start=float(limits.travel[first]),
            end=float(limits.travel[last]),
            duration=float(time[last] - time[first]),
        )
        for first, last in itertools.pairwise(cuts)
    )
