"""What may be wrong with a moving arm, and which ways along its path that bars.

A *cause* is active from where it passes its hold threshold until it has come back past its resume
threshold and stayed there for the quiet time, with the arm in its place (tracking error below its
resume threshold) all the while: an arm that swings after a push passes thresholds several times a
second. An active cause bars directions along the path: the tip's own direction when it arose if
going back on the same way undoes it (clearances, force), or both (tracking, encoders: nobody knows
where the arm would go).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import TypeVar

from pips_drake.serpentine.motion_words import DONE, RETRACTING, WORDS

#: Directions along the path, as bits of what is barred.
FORWARD, BACK = 1, 2
#: Below this rate the tip stands, m/s.
_STANDING = 1e-6


class Cause(IntEnum):
    """Why a supervisor does what it does."""

    NONE = 0
    CLEARANCE = 1
    SELF_CLEARANCE = 2
    TRACKING = 3
    FORCE = 4
    ENCODER = 5
    #: A measurement is not a finite number, or the operator's command is no word.
    INVALID = 6
    #: The arm goes on leaving its place although it is held.
    RUNAWAY = 7


#: The causes that last, gravest first: of several active ones this order says which is named.
BY_GRAVITY = (
    Cause.ENCODER,
    Cause.TRACKING,
    Cause.CLEARANCE,
    Cause.SELF_CLEARANCE,
    Cause.FORCE,
)


@dataclass(frozen=True, kw_only=True)
class Thresholds:
    """Where a supervisor acts. SI.

    Attributes:
        hold_clearance: what must be left once the arm has come to rest, m.
        resume_clearance: from where motion is free again, m.
        retract_clearance: below this the arm goes back without waiting, m.
        own_hold_clearance, own_resume_clearance: the same of the arm to itself, m.
        tracking_hold, tracking_resume: farthest spine point from its command, m.
        tracking_growth: how much farther it may come after `tracking_hold`, m.
        force_hold, force_resume: largest share of its limit that a drive needs.
        closing_speed: a clearance that falls by less, m/s, is taken to stand: the arm swings; so is
            a tracking error that grows by less.
        give_way: how much a clearance may fall on the way out of a hold before that way is barred
            too, m.
        quiet_time: how long a cause must be past its resume threshold, the arm in its place, s.
        stopping_time: with which a closing rate becomes the clearance lost until rest, s:
            latency, and half of the ramp to rest.
        patience: how long barred motion is asked for before the arm goes back or stops, s; infinite
            waits for the operator.
        safe_share: of the profile's speed, at which the arm goes back.
    """

    hold_clearance: float
    resume_clearance: float
    retract_clearance: float
    own_hold_clearance: float
    own_resume_clearance: float
    tracking_hold: float
    tracking_resume: float
    tracking_growth: float
    force_hold: float
    force_resume: float
    closing_speed: float
    give_way: float
    quiet_time: float
    stopping_time: float
    patience: float
    safe_share: float


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """What a supervisor sees at an instant. SI.

    Attributes:
        clearance, clearance_rate: of the arm to the scene, m and m/s.
        urgent_clearance, urgent_rate: of the pair that will be nearest when the arm has come to
            rest, which need not be the nearest one now, m and m/s; NaN if that is not known.
        own_clearance, own_rate, own_urgent_clearance, own_urgent_rate: the same of the arm to
            itself.
        tracking_error: farthest spine point from its command, m.
        force_share: largest share of its limit that a drive needs.
        healthy: whether every encoder is.
        tip_rate: along the path, m/s.
        phase: `EXTENDING`, `DWELLING`, `RETRACTING` or `DONE`.
        wish: the operator's `RUN`, `HOLD`, `RETRACT` or `EXTEND`.
    """

    clearance: float
    clearance_rate: float
    own_clearance: float
    own_rate: float
    tracking_error: float
    force_share: float
    healthy: bool
    tip_rate: float
    phase: float
    wish: float
    urgent_clearance: float = math.nan
    urgent_rate: float = math.nan
    own_urgent_clearance: float = math.nan
    own_urgent_rate: float = math.nan

    def is_valid(self) -> bool:
        """Whether every measured number is finite and the wish is a word."""
        return self.wish in WORDS and all(
            map(
                math.isfinite,
                (
                    self.clearance,
                    self.clearance_rate,
                    self.own_clearance,
                    self.own_rate,
                    self.tracking_error,
                    self.force_share,
                    self.tip_rate,
                ),
            )
        )

    @property
    def moves(self) -> bool:
        """Whether the tip does."""
        return abs(self.tip_rate) > _STANDING


def _nothing_barred() -> dict[Cause, int]:
    return dict.fromkeys(BY_GRAVITY, 0)


def _no_time() -> dict[Cause, float]:
    return dict.fromkeys(BY_GRAVITY, 0.0)


@dataclass(frozen=True, kw_only=True)
class Watch:
    """Which causes are active, and what of the past that rests on.

    Attributes:
        barred: directions by cause, bits `FORWARD` and `BACK`; 0 for a cause that is not active.
        clear_for: how long each active cause has been past its resume threshold, s.
        least, own_least: clearances when the arm set out from a hold, m; infinite without one.
        error, load: tracking error, m, and largest share of its limit that a drive needed; infinite
            before the first.
        lost_at: tracking error when that became a cause, m; infinite when it is none.
    """

    barred: Mapping[Cause, int] = field(default_factory=_nothing_barred)
    clear_for: Mapping[Cause, float] = field(default_factory=_no_time)
    least: float = math.inf
    own_least: float = math.inf
    error: float = math.inf
    load: float = math.inf
    lost_at: float = math.inf

    @property
    def barred_directions(self) -> int:
        """Bits of all that is barred, by whatever cause."""
        directions = 0
        for bits in self.barred.values():
            directions |= bits
        return directions

    @property
    def is_waiting(self) -> bool:
        """Whether every active cause has passed its resume threshold, and time alone is missing."""
        return all(self.clear_for[cause] > 0.0 for cause in BY_GRAVITY if self.barred[cause])


_Watch = TypeVar("_Watch", bound=Watch)


def watch(before: _Watch, seen: Measurement, thresholds: Thresholds, period: float) -> _Watch:
    """The next of a watch.

    Args:
        period: since `before`, s.
    """
    if seen.moves:
        onward = FORWARD if seen.tip_rate > 0.0 else BACK
    else:
        onward = BACK if seen.phase in (RETRACTING, DONE) else FORWARD
    ways = onward, onward if seen.moves else 0
    clearance, least = _watch_distance(
        (before.barred[Cause.CLEARANCE], before.least),
        (seen.clearance, seen.clearance_rate),
        (seen.urgent_clearance, seen.urgent_rate),
        (thresholds.hold_clearance, thresholds.resume_clearance, thresholds.retract_clearance),
        ways,
        thresholds,
    )
    own_hold = thresholds.own_hold_clearance
    own, own_least = _watch_distance(
        (before.barred[Cause.SELF_CLEARANCE], before.own_least),
        (seen.own_clearance, seen.own_rate),
        (seen.own_urgent_clearance, seen.own_urgent_rate),
        (own_hold, thresholds.own_resume_clearance, 0.5 * own_hold),
        ways,
        thresholds,
    )
    barred = {
        Cause.ENCODER: 0 if seen.healthy else FORWARD | BACK,
        Cause.TRACKING: _latch(
            before.barred[Cause.TRACKING],
            seen.tracking_error >= thresholds.tracking_hold,
            seen.tracking_error < thresholds.tracking_resume,
            FORWARD | BACK,
        ),
        Cause.CLEARANCE: clearance,
        Cause.SELF_CLEARANCE: own,
        Cause.FORCE: _latch(
            before.barred[Cause.FORCE],
            seen.force_share >= thresholds.force_hold,
            seen.force_share < thresholds.force_resume,
            onward,
        ),
    }
    clear_for = _keep(before, seen, barred, thresholds, period)
    lost_at = math.inf
    if barred[Cause.TRACKING]:
        lost_at = before.lost_at if before.barred[Cause.TRACKING] else seen.tracking_error
    return replace(
        before,
        barred=barred,
        clear_for=clear_for,
        least=before.least if barred[Cause.CLEARANCE] and not clearance else least,
        own_least=before.own_least if barred[Cause.SELF_CLEARANCE] and not own else own_least,
        error=seen.tracking_error,
        load=seen.force_share,
        lost_at=lost_at,
    )


def runs_away(before: Watch, seen: Measurement, thresholds: Thresholds, period: float) -> bool:
    """Whether the arm goes on leaving its place although it is held for that.

    Its error has grown since and still grows, and at this look and the one before no drive needed
    more force than motion is resumed with. An arm that is pushed as far has drives at their limits,
    or leans on what stopped it, and comes back when it is let go: it is not stopped for that.
    """
    return (
        seen.tracking_error > before.lost_at + thresholds.tracking_growth
        and seen.tracking_error > before.error + thresholds.closing_speed * period
        and max(seen.force_share, before.load) < thresholds.force_resume
    )


def stopping_clearance(clearance: float, rate: float, stopping_time: float) -> float:
    """What is left of a clearance (m) that changes at a rate (m/s) once the arm rests, m."""
    return clearance + min(rate, 0.0) * stopping_time


def _keep(
    before: Watch,
    seen: Measurement,
    barred: dict[Cause, int],
    thresholds: Thresholds,
    period: float,
) -> dict[Cause, float]:
    """Keeps what has cleared until it is quiet; returns for how long each has been clear, s.

    Args:
        barred: in and out.
    """
    in_place = seen.tracking_error < thresholds.tracking_resume
    clear_for = _no_time()
    for cause in BY_GRAVITY:
        if barred[cause] or not before.barred[cause]:
            continue
        clear = before.clear_for[cause] + period if in_place else 0.0
        if not in_place or clear < thresholds.quiet_time:
            barred[cause], clear_for[cause] = before.barred[cause], clear
    return clear_for


def _latch(bits: int, sets: bool, clears: bool, directions: int) -> int:
    """Bits of a cause with hysteresis: kept until it clears."""
    if bits:
        return 0 if clears else bits
    return directions if sets else 0


def _watch_distance(
    before: tuple[int, float],
    nearest: tuple[float, float],
    urgent: tuple[float, float],
    limits: tuple[float, float, float],
    ways: tuple[int, int],
    thresholds: Thresholds,
) -> tuple[int, float]:
    """What a clearance bars, and the least of it that the way out of a hold started from.

    Args:
        before: the same at the decision before.
        nearest, urgent: distances (m) and rates (m/s) of the nearest pair, and of the one that will
            be when the arm rests.
        limits: to hold at, to resume from, and that is too near whatever the rate, m.
        ways: where the tip is going or would go on to, and where it is going (0: it stands).
    """
    bits, least = _watch_nearest(before, nearest, limits, ways, thresholds)
    # Comparisons with NaN are false: what is not known is not acted on.
    if not bits and urgent[1] < -thresholds.closing_speed:
        left = stopping_clearance(*urgent, thresholds.stopping_time)
        if left < limits[0]:
            return ways[0], nearest[0]
    return bits, least


def _watch_nearest(
    before: tuple[int, float],
    nearest: tuple[float, float],
    limits: tuple[float, float, float],
    ways: tuple[int, int],
    thresholds: Thresholds,
) -> tuple[int, float]:
    """The same of the nearest pair alone."""
    (bits, least), (distance, rate), (hold, resume, too_near) = before, nearest, limits
    onward, way = ways
    if not bits:
        closing, opening = rate < -thresholds.closing_speed, rate > thresholds.closing_speed
        left = stopping_clearance(distance, rate, thresholds.stopping_time)
        if (closing and left < hold) or (not opening and distance < too_near):
            return onward, distance
        return 0, math.inf
    if distance >= resume and not (way & bits):
        return 0, math.inf
    if way and not way & bits:
        # On the way out of the hold: it must lead out.
        return (FORWARD | BACK if distance < least - thresholds.give_way else bits), least
    return bits, min(least, distance)
