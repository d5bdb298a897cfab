"""When a moving arm must hold, go back or stop: the decisions, as plain functions.

What is watched, and which ways along the path it bars, is `supervision_causes`. What is not barred
is let through as the operator wants it, at full speed. Of several active causes the gravest is
named, and keeps its name until the hold ends or something else alone is wrong: a graver one takes
over, a lesser one waits.

A hold ends when every cause has ended, which takes the quiet time. Held for longer than the
patience while motion is asked for, the arm goes back along its path, or stops where that way is
barred too. It stops at once when it goes on leaving its place although it is held (`runs_away`),
when its retraction meets anything, and when what it measures is no number. At a stop the drives'
brakes are set (`brakes`); a stop is never left.

A retraction is left by the operator alone: `HOLD`, seen while the tip is at rest, the arm in its
place and nothing wrong, makes it ready, and `RUN` (or `EXTEND`) after it lets the arm go out again,
from home or from wherever it stands. Before that `RUN` means the way back. Should something be
wrong or move in between, it must be held again. An operator who went back without the supervisor
goes out again with the word `EXTEND`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum

from pips_drake.serpentine.motion_words import (
    DWELLING,
    EXTEND,
    EXTENDING,
    HOLD,
    RETRACT,
    RETRACTING,
    RUN,
)
from pips_drake.serpentine.supervision_causes import (
    BACK,
    BY_GRAVITY,
    FORWARD,
    Cause,
    Measurement,
    Thresholds,
    Watch,
    runs_away,
    stopping_clearance,
    watch,
)

__all__ = [
    "BACK",
    "BY_GRAVITY",
    "FORWARD",
    "Cause",
    "Decision",
    "Measurement",
    "Mode",
    "Release",
    "Thresholds",
    "brakes",
    "command_of",
    "decide",
    "stopping_clearance",
]


class Mode(IntEnum):
    """What the supervisor does."""

    #: The operator's command passes.
    PERMIT = 0
    #: Motion in barred directions is held; the rest passes.
    HOLD = 1
    #: Back along the path, at the safe speed unless the operator retracts; left by the operator.
    RETRACT = 2
    #: Nothing moves any more, the drives are braked; not left again.
    STOP = 3


class Release(IntEnum):
    """How far the operator has come with letting a retracted arm go out again."""

    NONE = 0
    #: Held at rest with nothing wrong: `RUN` will do it.
    READY = 1
    #: Done, and the tip's way is not yet turned.
    OUT = 2


@dataclass(frozen=True, kw_only=True)
class Decision(Watch):
    """What a supervisor has decided, and what it remembers until the next decision.

    Attributes:
        mode, cause: what it does, and why.
        waited: how long barred motion has been asked for, s.
        release: of a retraction.
    """

    mode: Mode = Mode.PERMIT
    cause: Cause = Cause.NONE
    waited: float = 0.0
    release: Release = Release.NONE


def command_of(
    decision: Decision, wish: float, phase: float, safe_share: float
) -> tuple[float, float]:
    """What the path source is told: command, and share of the profile's speed."""
    if decision.mode == Mode.STOP:
        return HOLD, 1.0
    if decision.mode == Mode.RETRACT:
        # Holding is always safe, and who goes back on his own may do so at full speed.
        return (wish, 1.0) if wish in (HOLD, RETRACT) else (RETRACT, safe_share)
    return (HOLD if _is_barred(decision, wish, phase) else _meant(decision, wish)), 1.0


def brakes(decision: Decision) -> bool:
    """Whether the drives' brakes are set, whatever they are told."""
    return decision.mode == Mode.STOP


def decide(before: Decision, seen: Measurement, thresholds: Thresholds, period: float) -> Decision:
    """The next decision.

    Args:
        period: since the decision before, s.
    """
    if before.mode == Mode.STOP:
        return before
    if not seen.is_valid():
        return replace(before, mode=Mode.STOP, cause=Cause.INVALID)
    after = watch(before, seen, thresholds, period)
    if runs_away(before, seen, thresholds, period):
        return replace(after, mode=Mode.STOP, cause=Cause.RUNAWAY)
    after = _release(after, seen, thresholds)
    cause = _name(before.cause, after)
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
    if waited >= thresholds.patience and not after.is_waiting:
        return replace(after, mode=Mode.RETRACT if free_back else Mode.STOP)
    return after


def _name(before: Cause, now: Watch) -> Cause:
    """The cause that is named, of those that are active."""
    active = [cause for cause in BY_GRAVITY if now.barred[cause]]
    if not active:
        return Cause.NONE
    if before in BY_GRAVITY and now.is_waiting:
        # All of it is over but for the quiet time: no news.
        return min(before, active[0], key=BY_GRAVITY.index)
    return active[0]


def _release(now: Decision, seen: Measurement, thresholds: Thresholds) -> Decision:
    """Lets the operator out of a retraction."""
    if now.mode != Mode.RETRACT:
        turned = seen.phase in (EXTENDING, DWELLING) or seen.wish == RETRACT
        return replace(now, release=Release.NONE) if now.release and turned else now
    in_order = (
        not seen.moves
        and not now.barred_directions
        and seen.tracking_error < thresholds.tracking_resume
    )
    if in_order and seen.wish == HOLD:
        return replace(now, release=Release.READY)
    if in_order and seen.wish in (RUN, EXTEND) and now.release == Release.READY:
        return replace(now, mode=Mode.PERMIT, release=Release.OUT)
    return replace(now, release=Release.NONE)


def _meant(decision: Decision, wish: float) -> float:
    """The operator's word: after a release `RUN` is the way out."""
    return EXTEND if wish == RUN and decision.release == Release.OUT else wish


def _direction(word: float, phase: float) -> int:
    """Where a word would move the tip: `FORWARD`, `BACK`, or 0 for nowhere."""
    if word == RETRACT:
        return BACK
    if word == EXTEND:
        return FORWARD
    if word == RUN:
        return {EXTENDING: FORWARD, RETRACTING: BACK}.get(phase, 0)
    return 0


def _is_barred(decision: Decision, wish: float, phase: float) -> bool:
    """Whether a wish would move the tip where it must not, now or once it has dwelled."""
    directions, word = decision.barred_directions, _meant(decision, wish)
    if word == RUN and phase == DWELLING:
        # The way back begins without a word.
        return bool(directions & BACK)
    return bool(directions & _direction(word, phase))
