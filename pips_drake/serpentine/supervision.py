"""When a moving arm must hold, go back or stop: the decisions, as plain functions.

What is watched is a *cause*: clearance to the scene, clearance to itself, tracking error, actuator
force, health of the encoders. A cause is active from where it passes its hold threshold until it
has come back past its resume threshold. An active cause bars directions along the path: the tip's
own direction when it arose if going back on the same way undoes it (clearances, force), or both
(tracking, encoders: nobody knows where the arm would go). What is not barred is let through as the
operator wants it, at full speed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum

from pips_drake.serpentine.motion_words import (
    DONE,
    DWELLING,
    EXTENDING,
    HOLD,
    RETRACT,
    RETRACTING,
    RUN,
)

#: Directions along the path, as bits of what is barred.
FORWARD, BACK = 1, 2
#: Below this rate the tip stands, m/s.
_STANDING = 1e-6


class Mode(IntEnum):
    """What the supervisor does."""

    #: The operator's command passes.
    PERMIT = 0
    #: Motion in barred directions is held; the rest passes.
    HOLD = 1
    #: Back along the path, at the safe speed unless the operator retracts; not left again.
    RETRACT = 2
    #: Nothing moves any more; not left again.
    STOP = 3


class Cause(IntEnum):
    """Why the supervisor does it."""

    NONE = 0
    CLEARANCE = 1
    SELF_CLEARANCE = 2
    TRACKING = 3
    FORCE = 4
    ENCODER = 5
    #: A measurement is not a finite number, or the operator's command is no word.
    INVALID = 6


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
        force_hold, force_resume: largest share of its limit that a drive needs.
        closing_speed: a clearance that falls by less, m/s, is taken to stand: the arm swings.
        give_way: how much a clearance may fall on the way out of a hold before that way is barred
            too, m.
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
    force_hold: float
    force_resume: float
    closing_speed: float
    give_way: float
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
        own_clearance, own_rate: of the arm to itself, m and m/s.
        tracking_error: farthest spine point from its command, m.
        force_share: largest share of its limit that a drive needs.
        healthy: whether every encoder is.
        tip_rate: along the path, m/s.
        phase: `EXTENDING`, `DWELLING`, `RETRACTING` or `DONE`.
        wish: the operator's `RUN`, `HOLD` or `RETRACT`.
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

    def is_valid(self) -> bool:
        """Whether every measured number is finite and the wish is a word."""
        return self.wish in (RUN, HOLD, RETRACT) and all(
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


def _nothing_barred() -> dict[Cause, int]:
    return dict.fromkeys(BY_GRAVITY, 0)


@dataclass(frozen=True, kw_only=True)
class Decision:
    """What a supervisor has decided, and what it remembers until the next decision.

    Attributes:
        mode, cause: what it does, and why.
        barred: directions by cause, bits `FORWARD` and `BACK`; 0 for a cause that is not active.
        least, own_least: clearances when the arm set out from a hold, m; infinite without one.
        waited: how long barred motion has been asked for, s.
    """

    mode: Mode = Mode.PERMIT
    cause: Cause = Cause.NONE
    barred: Mapping[Cause, int] = field(default_factory=_nothing_barred)
    least: float = math.inf
    own_least: float = math.inf
    waited: float = 0.0

    @property
    def barred_directions(self) -> int:
        """Bits of all that is barred, by whatever cause."""
        directions = 0
        for bits in self.barred.values():
            directions |= bits
        return directions


def command_of(
    decision: Decision, wish: float, phase: float, safe_share: float
) -> tuple[float, float]:
    """What the path source is told: command, and share of the profile's speed."""
    if decision.mode == Mode.STOP:
        return HOLD, 1.0
    if decision.mode == Mode.RETRACT:
        # Holding is always safe, and who goes back on his own may do so at full speed.
        return (wish, 1.0) if wish in (HOLD, RETRACT) else (RETRACT, safe_share)
    return (HOLD, 1.0) if _is_barred(decision, wish, phase) else (wish, 1.0)


def decide(before: Decision, seen: Measurement, thresholds: Thresholds, period: float) -> Decision:
    """The next decision.

    Args:
        period: since the decision before, s.
    """
    if before.mode == Mode.STOP:
        return before
    if not seen.is_valid():
        return replace(before, mode=Mode.STOP, cause=Cause.INVALID)
    after = _watch(before, seen, thresholds)
    cause = next((one for one in BY_GRAVITY if after.barred[one]), Cause.NONE)
    if after.mode == Mode.RETRACT:
        if after.barred_directions & BACK:
            return replace(after, mode=Mode.STOP, cause=cause)
        return after
    if cause == Cause.NONE:
        return replace(after, mode=Mode.PERMIT, cause=cause, waited=0.0)
    waited = after.waited + period if _is_barred(after, seen.wish, seen.phase) else 0.0
    after = replace(after, mode=Mode.HOLD, cause=cause, waited=waited)
    free_back = not after.barred_directions & BACK
    near = after.barred[Cause.CLEARANCE] and seen.clearance < thresholds.retract_clearance
    if near and free_back:
        return replace(after, mode=Mode.RETRACT, cause=Cause.CLEARANCE)
    if waited >= thresholds.patience:
        return replace(after, mode=Mode.RETRACT if free_back else Mode.STOP)
    return after


def stopping_clearance(clearance: float, rate: float, stopping_time: float) -> float:
    """What is left of a clearance (m) that changes at a rate (m/s) once the arm rests, m."""
    return clearance + min(rate, 0.0) * stopping_time


def _direction(wish: float, phase: float) -> int:
    """Where a wish would move the tip: `FORWARD`, `BACK`, or 0 for nowhere."""
    if wish == RETRACT:
        return BACK
    if wish == RUN:
        return {EXTENDING: FORWARD, RETRACTING: BACK}.get(phase, 0)
    return 0


def _is_barred(decision: Decision, wish: float, phase: float) -> bool:
    """Whether a wish would move the tip where it must not, now or once it has dwelled."""
    directions = decision.barred_directions
    if wish == RUN and phase == DWELLING:
        # The way back begins without a word.
        return bool(directions & BACK)
    return bool(directions & _direction(wish, phase))


def _watch(before: Decision, seen: Measurement, thresholds: Thresholds) -> Decision:
    """Which causes are active, and what they bar."""
    moving = abs(seen.tip_rate) > _STANDING
    if moving:
        onward = FORWARD if seen.tip_rate > 0.0 else BACK
    else:
        onward = BACK if seen.phase in (RETRACTING, DONE) else FORWARD
    barred = dict(before.barred)
    barred[Cause.ENCODER] = 0 if seen.healthy else FORWARD | BACK
    barred[Cause.TRACKING] = _latch(
        before.barred[Cause.TRACKING],
        seen.tracking_error >= thresholds.tracking_hold,
        seen.tracking_error < thresholds.tracking_resume,
        FORWARD | BACK,
    )
    barred[Cause.FORCE] = _latch(
        before.barred[Cause.FORCE],
        seen.force_share >= thresholds.force_hold,
        seen.force_share < thresholds.force_resume,
        onward,
    )
    way = onward if moving else 0
    barred[Cause.CLEARANCE], least = _watch_distance(
        (before.barred[Cause.CLEARANCE], before.least),
        (seen.clearance, seen.clearance_rate),
        (thresholds.hold_clearance, thresholds.resume_clearance, thresholds.retract_clearance),
        (onward, way),
        thresholds,
    )
    if not barred[Cause.CLEARANCE] and seen.urgent_rate < -thresholds.closing_speed:
        # Comparisons with NaN are false: what is not known is not acted on.
        rest = stopping_clearance(seen.urgent_clearance, seen.urgent_rate, thresholds.stopping_time)
        if rest < thresholds.hold_clearance:
            barred[Cause.CLEARANCE], least = onward, seen.clearance
    own_hold = thresholds.own_hold_clearance
    barred[Cause.SELF_CLEARANCE], own_least = _watch_distance(
        (before.barred[Cause.SELF_CLEARANCE], before.own_least),
        (seen.own_clearance, seen.own_rate),
        (own_hold, thresholds.own_resume_clearance, 0.5 * own_hold),
        (onward, way),
        thresholds,
    )
    return replace(before, barred=barred, least=least, own_least=own_least)


def _latch(bits: int, sets: bool, clears: bool, directions: int) -> int:
    """Bits of a cause with hysteresis: kept until it clears."""
    if bits:
        return 0 if clears else bits
    return directions if sets else 0


def _watch_distance(
    before: tuple[int, float],
    measured: tuple[float, float],
    limits: tuple[float, float, float],
    ways: tuple[int, int],
    thresholds: Thresholds,
) -> tuple[int, float]:
    """What a clearance bars, and the least of it that the way out of a hold started from.

    Args:
        before: the same at the decision before.
        measured: distance (m) and rate (m/s).
        limits: to hold at, to resume from, and that is too near whatever the rate, m.
        ways: where the tip is going or would go on to, and where it is going (0: it stands).
    """
    (bits, least), (distance, rate), (hold, resume, too_near) = before, measured, limits
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
