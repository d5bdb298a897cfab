"""The supervisor takes back and stops: out of patience, what comes nearer, what is no number."""

from __future__ import annotations

import itertools
import math
from dataclasses import fields, replace

import pytest

from pips_drake.serpentine.motion_words import (
    DONE,
    EXTEND,
    EXTENDING,
    HOLD,
    RETRACT,
    RETRACTING,
    RUN,
)
from pips_drake.serpentine.supervision import BY_GRAVITY, Cause, Decision, Measurement, Mode

from .supervised_moments import (
    CONFIG,
    FREE,
    LATENCY,
    PERIOD,
    SPEED,
    STANDING,
    TRIGGERS,
    after,
    command,
    held_ahead,
    wait,
)


@pytest.mark.parametrize("cause", [Cause.CLEARANCE, Cause.SELF_CLEARANCE, Cause.FORCE])
def test_out_of_patience_it_goes_back_at_the_safe_speed(cause):
    between = replace(STANDING, **TRIGGERS[cause][1])
    start = after(replace(STANDING, **TRIGGERS[cause][0]))
    held = replace(start, mode=Mode.HOLD, waited=0.0)
    held = wait(held, between, CONFIG.patience_s - PERIOD)
    assert held.mode == Mode.HOLD
    back = wait(held, between, PERIOD)
    assert (back.mode, back.cause) == (Mode.RETRACT, cause)
    assert command(back, between) == (RETRACT, CONFIG.safe_speed_fraction)


@pytest.mark.parametrize("cause", [Cause.TRACKING, Cause.ENCODER])
def test_out_of_patience_it_stops_where_no_way_is_safe(cause):
    active = replace(STANDING, **TRIGGERS[cause][0])
    stopped = wait(Decision(), active, CONFIG.patience_s + PERIOD)
    assert (stopped.mode, stopped.cause) == (Mode.STOP, cause)


def test_out_of_patience_on_the_way_back_it_stops():
    closing = replace(
        FREE, clearance=0.02, clearance_rate=-SPEED, tip_rate=-SPEED, phase=RETRACTING
    )
    rest = replace(closing, clearance=0.015, clearance_rate=0.0, tip_rate=0.0)
    stopped = wait(after(closing), rest, CONFIG.patience_s + PERIOD)
    assert (stopped.mode, stopped.cause) == (Mode.STOP, Cause.CLEARANCE)


def test_it_waits_for_an_operator_who_holds_and_for_ever_without_patience():
    rest = replace(STANDING, clearance=0.020, wish=HOLD)
    assert wait(held_ahead(), rest, 60.0).mode == Mode.HOLD
    endless = replace(CONFIG, patience_s=0.0).thresholds(LATENCY)
    rest = replace(rest, wish=RUN)
    assert after(*[rest] * 2000, before=held_ahead(), thresholds=endless).mode == Mode.HOLD


def test_what_comes_nearer_is_fled_without_waiting():
    coming = [replace(STANDING, clearance=d) for d in (0.018, 0.014, 0.0101)]
    held = after(*coming, before=held_ahead())
    assert held.mode == Mode.HOLD
    back = after(replace(STANDING, clearance=0.0099), before=held)
    assert (back.mode, back.cause) == (Mode.RETRACT, Cause.CLEARANCE)


def retracting():
    return replace(held_ahead(), mode=Mode.RETRACT)


def test_a_retraction_is_not_left_and_the_operator_may_hold_or_hurry_it():
    clear = replace(STANDING, tip_rate=-0.5 * SPEED, phase=RETRACTING)
    back = after(clear, clear, before=retracting())
    assert (back.mode, back.cause) == (Mode.RETRACT, Cause.CLEARANCE)
    assert command(back, clear) == (RETRACT, CONFIG.safe_speed_fraction)
    for wish in (HOLD, RETRACT):
        assert command(back, replace(clear, wish=wish)) == (wish, 1.0)


@pytest.mark.parametrize("cause", BY_GRAVITY)
def test_a_retraction_that_meets_anything_stops(cause):
    seen = replace(STANDING, tip_rate=-0.5 * SPEED, phase=RETRACTING, **TRIGGERS[cause][0])
    # Nothing but the hold's own cause was active, and it has gone.
    back = replace(Decision(), mode=Mode.RETRACT, cause=Cause.CLEARANCE)
    stopped = after(seen, before=back)
    assert (stopped.mode, stopped.cause) == (Mode.STOP, cause)
    assert command(stopped, seen) == (HOLD, 1.0)


def test_a_stop_is_not_left_whatever_happens():
    stopped = Decision(mode=Mode.STOP, cause=Cause.ENCODER)
    for wish, phase in itertools.product(
        (RUN, HOLD, RETRACT, EXTEND), (EXTENDING, RETRACTING, DONE)
    ):
        seen = replace(FREE, wish=wish, phase=phase)
        assert after(seen, before=stopped) == stopped
        assert command(stopped, seen) == (HOLD, 1.0)


#: Urgent ones may be unknown.
NUMBERS = [
    f.name
    for f in fields(Measurement)
    if f.name not in ("healthy", "phase") and "urgent" not in f.name
]


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("mode", [Mode.PERMIT, Mode.HOLD, Mode.RETRACT])
def test_what_is_no_number_stops(name, value, mode):
    stopped = after(replace(FREE, **{name: value}), before=Decision(mode=mode))
    assert (stopped.mode, stopped.cause) == (Mode.STOP, Cause.INVALID)


def test_a_command_that_is_no_word_stops():
    for wish in (0.5, 2.5, -0.1):
        assert after(replace(FREE, wish=wish)).cause == Cause.INVALID
