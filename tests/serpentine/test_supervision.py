"""Decisions of the supervisor: when it holds, lets go, takes back and stops, and what it names."""

from __future__ import annotations

import itertools
import math
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pips_drake.errors import InputError
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.drives import drive_limits
from pips_drake.serpentine.motion_words import (
    DONE,
    DWELLING,
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
    command_of,
    decide,
)
from pips_drake.serpentine.supervisor_config import SupervisorConfig
from pips_drake.serpentine.tracking import largest_share, tracking_error

PERIOD = 1.0 / 32.0
LATENCY = 0.1
SPEED = 0.025
#: Hold at 20 mm, resume at 25, retract at 10; own 5 and 8; tracking 40 and 25; force 0.98 and 0.8.
CONFIG = SupervisorConfig()
THRESHOLDS = CONFIG.thresholds(LATENCY)
#: Latency and half of the half second's ramp.
STOPPING_TIME = 0.35

#: An arm that moves on in free space.
FREE = Measurement(
    clearance=0.5,
    clearance_rate=0.0,
    own_clearance=0.17,
    own_rate=0.0,
    tracking_error=0.5e-3,
    force_share=0.4,
    healthy=True,
    tip_rate=SPEED,
    phase=EXTENDING,
    wish=RUN,
)
STANDING = replace(FREE, tip_rate=0.0)
#: What makes each lasting cause active, and what is between its thresholds, and clear of both.
TRIGGERS = {
    Cause.CLEARANCE: [
        {"clearance": 0.009},
        {"clearance": 0.022},
        {"clearance": 0.026},
    ],
    Cause.SELF_CLEARANCE: [
        {"own_clearance": 0.002},
        {"own_clearance": 0.006},
        {"own_clearance": 0.009},
    ],
    Cause.TRACKING: [
        {"tracking_error": 0.041},
        {"tracking_error": 0.030},
        {"tracking_error": 0.024},
    ],
    Cause.FORCE: [{"force_share": 0.99}, {"force_share": 0.9}, {"force_share": 0.79}],
    Cause.ENCODER: [{"healthy": False}],
}


def after(*seen, before=None, thresholds=THRESHOLDS):
    """The decision after a sequence of measurements."""
    decision = before or Decision()
    for one in seen:
        decision = decide(decision, one, thresholds, PERIOD)
    return decision


def command(decision, seen):
    return command_of(decision, seen.wish, seen.phase, THRESHOLDS.safe_share)


def held_ahead():
    """Held at rest, 20 mm before something that lies ahead."""
    closing = replace(FREE, clearance=0.028, clearance_rate=-SPEED)
    return after(closing, replace(STANDING, clearance=0.020))


def test_in_order_every_wish_passes_at_full_speed():
    for wish, phase in itertools.product(
        (RUN, HOLD, RETRACT), (EXTENDING, DWELLING, RETRACTING, DONE)
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
    free = after(clear, before=still, thresholds=calm)
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
    decision = after(replace(both, tracking_error=0.0), before=decision)
    assert (decision.mode, decision.cause) == (Mode.HOLD, Cause.FORCE)


def wait(decision, seen, seconds):
    return after(*[seen] * round(seconds / PERIOD), before=decision)


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
    free = after(replace(leaving[-1], clearance=0.0251), before=out)
    assert (free.mode, free.least) == (Mode.PERMIT, math.inf)


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
    for wish, phase in itertools.product((RUN, HOLD, RETRACT), (EXTENDING, RETRACTING, DONE)):
        seen = replace(FREE, wish=wish, phase=phase)
        assert after(seen, before=stopped) == stopped
        assert command(stopped, seen) == (HOLD, 1.0)


#: Urgent ones may be unknown.
NOT_NUMBERS = ("healthy", "phase", "urgent_clearance", "urgent_rate")
NUMBERS = [f.name for f in fields(Measurement) if f.name not in NOT_NUMBERS]


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("mode", [Mode.PERMIT, Mode.HOLD, Mode.RETRACT])
def test_what_is_no_number_stops(name, value, mode):
    stopped = after(replace(FREE, **{name: value}), before=Decision(mode=mode))
    assert (stopped.mode, stopped.cause) == (Mode.STOP, Cause.INVALID)


def test_a_command_that_is_no_word_stops():
    for wish in (0.5, 2.0, -0.1):
        assert after(replace(FREE, wish=wish)).cause == Cause.INVALID


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
    wish=st.sampled_from([RUN, HOLD, RETRACT]),
)


@settings(derandomize=True, max_examples=300, deadline=None)
@given(st.lists(MEASUREMENTS, min_size=1, max_size=12))
def test_whatever_is_measured_the_command_never_goes_where_it_is_barred(sequence):
    decision = Decision()
    for seen in sequence:
        before, decision = decision, decide(decision, seen, THRESHOLDS, PERIOD)
        word, share = command(decision, seen)
        assert word in (RUN, HOLD, RETRACT) and 0.0 < share <= 1.0
        barred = decision.barred_directions
        forward = word == RUN and seen.phase == EXTENDING
        back = word == RETRACT or (word == RUN and seen.phase == RETRACTING)
        assert not (forward and barred & FORWARD) and not (back and barred & BACK)
        # The operator's hold is never overridden, and no motion is invented but a retraction's.
        assert word in (seen.wish, HOLD) or decision.mode == Mode.RETRACT
        assert seen.wish != HOLD or word == HOLD
        assert (decision.mode == Mode.PERMIT) == (decision.cause == Cause.NONE)
        # Modes are left in one direction only, but for holds.
        assert before.mode != Mode.STOP or decision.mode == Mode.STOP
        assert before.mode != Mode.RETRACT or decision.mode in (Mode.RETRACT, Mode.STOP)


def test_the_tracking_error_is_the_farthest_spine_points(arm, random_postures):
    wanted, reached = random_postures(arm, 20), random_postures(arm, 40)[20:]
    points = [kinematics.spine_points(arm, q) for q in (wanted, reached)]
    distances = np.linalg.norm(points[0] - points[1], axis=-1)
    spine = np.array(arm.spine_indices)
    for i in range(20):
        error, joint = tracking_error(arm.dh_table, spine, wanted[i], reached[i])
        # Metres of sums of products.
        assert error == pytest.approx(distances[i].max(), abs=1e-13)
        assert joint == spine[np.argmax(distances[i])]


def test_one_nan_among_many_numbers_is_not_lost(arm):
    q, spine = np.zeros(18), np.array(arm.spine_indices)
    limits = drive_limits(arm)[3]
    for j in range(17):  # the last joint turns about its own spine point
        bad = q.copy()
        bad[j] = np.nan
        assert math.isnan(tracking_error(arm.dh_table, spine, q, bad)[0]), j
        share, drive = largest_share(np.where(np.arange(18) == j, np.nan, 2.0 * limits), limits)
        assert math.isnan(share) and drive == j


def test_the_largest_share_is_found_whatever_its_sign(arm):
    limits = drive_limits(arm)[3]
    efforts = 0.3 * limits
    efforts[7] = -0.9 * limits[7]
    share, drive = largest_share(efforts, limits)
    assert (share, drive) == (pytest.approx(0.9, rel=1e-15), 7)


BAD = {
    "hold_clearance_mm": (9.0, r"supervisor.hold_clearance_mm = 9.0; must be > retract_clearance"),
    "resume_clearance_mm": (20.0, "> hold_clearance_mm"),
    "retract_clearance_mm": (-1.0, ">= 0"),
    "own_resume_clearance_mm": (5.0, "> own_hold_clearance_mm"),
    "tracking_resume_mm": (0.0, "> 0"),
    "tracking_hold_mm": (25.0, "> tracking_resume_mm"),
    "force_fraction_hold": (0.8, "> force_fraction_resume"),
    "closing_speed_mm_per_s": (-1.0, ">= 0"),
    "give_way_mm": (-1.0, ">= 0"),
    "hold_ramp_s": (0.0, "> 0"),
    "patience_s": (-1.0, ">= 0"),
    "safe_speed_fraction": (0.0, "0.01 .. 1"),
    "overtime_s": (1e6, "<= 86400"),
}


@pytest.mark.parametrize("name", sorted(BAD))
def test_thresholds_that_make_no_sense_are_refused(name):
    value, message = BAD[name]
    with pytest.raises(InputError, match=message):
        replace(CONFIG, **{name: value}).validate()


def test_thresholds_are_the_scenarios_in_si():
    assert THRESHOLDS.hold_clearance == pytest.approx(0.020)
    assert THRESHOLDS.stopping_time == pytest.approx(STOPPING_TIME)
    assert THRESHOLDS.patience == 5.0
