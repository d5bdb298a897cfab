"""The supervisor holds and lets go: which ways it bars, for how long, and what it names."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pips_drake.serpentine.motion_words import (
    DONE,
    DWELLING,
    EXTEND,
    EXTENDING,
    HOLD,
    RETRACT,
    RETRACTING,
    RUN,
)
from pips_drake.serpentine.supervision import (
    BACK,
    BY_GRAVITY,
    FORWARD,
    Cause,
    Decision,
    Measurement,
    Mode,
    Release,
    brakes,
    decide,
)

from .supervised_moments import (
    CONFIG,
    FREE,
    LATENCY,
    PERIOD,
    SPEED,
    STANDING,
    THRESHOLDS,
    TRIGGERS,
    after,
    command,
    held_ahead,
    wait,
)


def test_in_order_every_wish_passes_at_full_speed():
    for wish, phase in itertools.product(
        (RUN, HOLD, RETRACT, EXTEND), (EXTENDING, DWELLING, RETRACTING, DONE)
    ):
        seen = replace(FREE, wish=wish, phase=phase)
        decision = after(seen)
        assert (decision.mode, decision.cause) == (Mode.PERMIT, Cause.NONE)
        assert command(decision, seen) == (wish, 1.0)


@pytest.mark.parametrize("rate", [-0.005, -SPEED, -0.2])
def test_the_tip_is_held_where_the_stopping_distance_reaches_the_threshold(rate):
    # Latency v t and braking v^2 / (2 a) with a = v / ramp.
    speed, deceleration = -rate, -rate / CONFIG.hold_ramp_s
    stop = speed * LATENCY + speed**2 / (2.0 * deceleration)
    for beyond, mode in ((1e-6, Mode.PERMIT), (-1e-6, Mode.HOLD)):
        seen = replace(FREE, clearance=0.020 + stop + beyond, clearance_rate=rate)
        assert after(seen).mode == mode


@pytest.mark.parametrize("distance", [0.011, 0.019, 0.021])
@pytest.mark.parametrize("rate", [SPEED, 0.002])
def test_what_opens_is_not_held_however_near(distance, rate):
    seen = replace(FREE, clearance=distance, clearance_rate=rate)
    assert after(seen).mode == Mode.PERMIT
    too_near = replace(seen, clearance=0.001)
    assert after(too_near).mode == Mode.PERMIT


def test_a_swing_of_a_standing_arm_is_no_closing_in():
    for rate in (-0.9e-3, 0.0, 0.9e-3):
        assert after(replace(STANDING, clearance=0.0195, clearance_rate=rate)).mode == Mode.PERMIT


def test_what_is_too_near_acts_without_closing():
    # At rest, extending: the way on is barred, and there is no waiting.
    near = replace(STANDING, clearance=0.0099)
    assert (after(near).mode, after(near).cause) == (Mode.RETRACT, Cause.CLEARANCE)


def test_motion_towards_is_barred_and_away_passes_at_full_speed():
    held = held_ahead()
    assert (held.mode, held.cause) == (Mode.HOLD, Cause.CLEARANCE)
    assert held.barred[Cause.CLEARANCE] == FORWARD
    assert command(held, STANDING) == (HOLD, 1.0)
    away = replace(STANDING, clearance=0.020, wish=RETRACT)
    assert command(after(away, before=held), away) == (RETRACT, 1.0)


def test_on_the_way_back_it_is_the_way_back_that_is_barred():
    closing = replace(
        FREE, clearance=0.02, clearance_rate=-SPEED, tip_rate=-SPEED, phase=RETRACTING
    )
    held = after(closing)
    assert held.barred[Cause.CLEARANCE] == BACK
    for wish in (RUN, RETRACT):
        assert command(held, replace(closing, wish=wish)) == (HOLD, 1.0)


def test_while_the_arm_brakes_a_hold_is_not_left():
    # At speed, 28 mm are less than they look: above the resume threshold, and yet to be lost.
    closing = replace(FREE, clearance=0.028, clearance_rate=-SPEED)
    assert after(closing, closing, closing).mode == Mode.HOLD


@pytest.mark.parametrize("cause", list(Cause)[1:5])
def test_a_cause_lasts_until_its_resume_threshold(cause):
    active, between, clear = (replace(STANDING, **change) for change in TRIGGERS[cause])
    assert after(between).mode == Mode.PERMIT, "from below it is not active yet"
    # Without patience or nearness: what is looked at here is whether it holds.
    calm = replace(THRESHOLDS, patience=math.inf, retract_clearance=0.0)
    start = after(active, thresholds=THRESHOLDS)
    held = replace(start, mode=Mode.HOLD)
    assert (start.cause, held.barred_directions & FORWARD) == (cause, FORWARD)
    still = after(between, between, before=held, thresholds=calm)
    assert (still.mode, still.cause) == (Mode.HOLD, cause)
    free = wait(still, clear, 0.5, thresholds=calm)
    assert (free.mode, free.cause, free.barred_directions) == (Mode.PERMIT, Cause.NONE, 0)
    again = after(between, before=free, thresholds=calm)
    assert again.mode == Mode.PERMIT


@pytest.mark.parametrize("cause", [Cause.TRACKING, Cause.ENCODER])
@pytest.mark.parametrize("wish", [RUN, RETRACT])
def test_an_arm_that_is_not_where_it_should_be_moves_nowhere(cause, wish):
    seen = replace(FREE, wish=wish, **TRIGGERS[cause][0])
    held = after(seen)
    assert (held.mode, held.cause) == (Mode.HOLD, cause)
    for phase in (EXTENDING, DWELLING, RETRACTING):
        assert command(held, replace(seen, phase=phase)) == (HOLD, 1.0)


def test_a_dwell_goes_on_before_something_that_lies_ahead_but_not_if_the_way_back_is_barred():
    dwelling = replace(STANDING, phase=DWELLING)
    assert command(held_ahead(), dwelling) == (RUN, 1.0)
    both = after(replace(dwelling, **TRIGGERS[Cause.ENCODER][0]))
    assert command(both, dwelling) == (HOLD, 1.0)


@pytest.mark.parametrize(
    "causes", [pair for n in (2, 3, 5) for pair in itertools.combinations(BY_GRAVITY, n)]
)
def test_of_several_causes_the_gravest_is_named(causes):
    changes = {name: value for cause in causes for name, value in TRIGGERS[cause][0].items()}
    decision = after(replace(STANDING, **changes))
    order = [Cause.ENCODER, Cause.TRACKING, Cause.CLEARANCE, Cause.SELF_CLEARANCE, Cause.FORCE]
    assert decision.cause == min(causes, key=order.index)
    assert {cause for cause in BY_GRAVITY if decision.barred[cause]} == set(causes)


def test_when_the_gravest_cause_goes_the_next_is_named():
    both = replace(STANDING, **TRIGGERS[Cause.FORCE][0], **TRIGGERS[Cause.TRACKING][0])
    decision = after(both)
    assert decision.cause == Cause.TRACKING
    decision = wait(decision, replace(both, tracking_error=0.0), 0.5)
    assert (decision.mode, decision.cause) == (Mode.HOLD, Cause.FORCE)


def test_a_way_out_that_leads_nearer_is_barred_too():
    held = held_ahead()
    assert held.least == 0.020
    leaving = replace(STANDING, tip_rate=-SPEED, wish=RETRACT)
    out = after(replace(leaving, clearance=0.0151), before=held)
    assert out.mode == Mode.HOLD and command(out, leaving) == (RETRACT, 1.0)
    nearer = after(replace(leaving, clearance=0.0149), before=out)
    assert nearer.barred[Cause.CLEARANCE] == FORWARD | BACK
    assert command(nearer, leaving) == (HOLD, 1.0)


def test_a_way_out_is_left_to_the_operator_until_it_is_clear():
    leaving = [
        replace(STANDING, tip_rate=-SPEED, wish=RETRACT, clearance=d, clearance_rate=SPEED)
        for d in (0.0205, 0.022, 0.0249)
    ]
    out = after(*leaving, before=held_ahead())
    assert (out.mode, out.cause) == (Mode.HOLD, Cause.CLEARANCE)
    free = wait(out, replace(leaving[-1], clearance=0.0251), 0.5)
    assert (free.mode, free.least) == (Mode.PERMIT, math.inf)


MEASUREMENTS = st.builds(
    Measurement,
    clearance=st.floats(-0.01, 0.5),
    clearance_rate=st.floats(-0.2, 0.2),
    own_clearance=st.floats(-0.01, 0.2),
    own_rate=st.floats(-0.2, 0.2),
    tracking_error=st.floats(0.0, 0.06),
    force_share=st.floats(0.0, 1.2),
    healthy=st.booleans(),
    tip_rate=st.sampled_from([-SPEED, 0.0, SPEED]),
    phase=st.sampled_from([EXTENDING, DWELLING, RETRACTING, DONE]),
    wish=st.sampled_from([RUN, HOLD, RETRACT, EXTEND]),
)


@settings(derandomize=True, max_examples=300, deadline=None)
@given(st.lists(MEASUREMENTS, min_size=1, max_size=12))
def test_whatever_is_measured_the_command_never_goes_where_it_is_barred(sequence):
    decision = Decision()
    for seen in sequence:
        before, decision = decision, decide(decision, seen, THRESHOLDS, PERIOD)
        word, share = command(decision, seen)
        assert word in (RUN, HOLD, RETRACT, EXTEND) and 0.0 < share <= 1.0
        barred = decision.barred_directions
        forward = word == EXTEND or (word == RUN and seen.phase == EXTENDING)
        back = word == RETRACT or (word == RUN and seen.phase == RETRACTING)
        assert not (forward and barred & FORWARD) and not (back and barred & BACK)
        # The operator's hold is never overridden, and no motion is invented but a retraction's, and
        # the way out when that is released.
        released = seen.wish == RUN and decision.release == Release.OUT
        assert word in (seen.wish, HOLD, EXTEND if released else HOLD) or (
            decision.mode == Mode.RETRACT
        )
        assert seen.wish != HOLD or word == HOLD
        assert brakes(decision) == (decision.mode == Mode.STOP)
        assert (decision.mode == Mode.PERMIT) == (decision.cause == Cause.NONE)
        # Modes are left in one direction only, but for holds.
        assert before.mode != Mode.STOP or decision.mode == Mode.STOP
        assert before.mode != Mode.RETRACT or (
            decision.mode in (Mode.RETRACT, Mode.STOP) or before.release == Release.READY
        )
