"""A retraction is left by the operator: held at rest with nothing wrong, and then run."""

from __future__ import annotations

from dataclasses import replace

import pytest

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
from pips_drake.serpentine.supervision import BY_GRAVITY, Cause, Decision, Mode, Release

from .supervised_moments import CONFIG, FREE, SPEED, STANDING, TRIGGERS, after, command, wait

#: Taken back, and nothing is wrong any more.
BACK = Decision(mode=Mode.RETRACT, cause=Cause.CLEARANCE)


def told(wish, phase=RETRACTING, **changed):
    return replace(STANDING, wish=wish, phase=phase, **changed)


@pytest.mark.parametrize("phase", [RETRACTING, DONE])
@pytest.mark.parametrize("word", [RUN, EXTEND])
def test_hold_and_then_run_lets_the_arm_go_out_again_from_home_and_on_the_way(phase, word):
    ready = after(told(HOLD, phase), before=BACK)
    assert (ready.mode, ready.release) == (Mode.RETRACT, Release.READY)
    assert command(ready, told(HOLD, phase)) == (HOLD, 1.0)
    out = after(told(word, phase), before=ready)
    assert (out.mode, out.cause) == (Mode.PERMIT, Cause.NONE)
    assert command(out, told(word, phase)) == (EXTEND, 1.0)


def test_once_the_tip_has_turned_running_is_running():
    out = after(told(HOLD), told(RUN), before=BACK)
    for phase in (EXTENDING, DWELLING):
        turned = after(told(RUN, phase), before=out)
        assert turned.release == Release.NONE
        assert command(turned, told(RUN, phase)) == (RUN, 1.0)
    # A hold before it has turned is only a hold; going back again is a change of mind.
    held = after(told(HOLD), before=out)
    assert command(held, told(HOLD)) == (HOLD, 1.0)
    assert command(after(told(RUN), before=held), told(RUN)) == (EXTEND, 1.0)
    changed = after(told(RETRACT), before=out)
    assert command(after(told(RUN), before=changed), told(RUN)) == (RUN, 1.0)


@pytest.mark.parametrize("wishes", [[RUN], [RETRACT, RUN], [EXTEND], [HOLD, RETRACT, RUN]])
def test_nothing_else_releases(wishes):
    still = after(*map(told, wishes), before=BACK)
    assert still.mode == Mode.RETRACT
    assert command(still, told(wishes[-1])) == (RETRACT, CONFIG.safe_speed_fraction)


@pytest.mark.parametrize(
    "changed", [{"tip_rate": -SPEED}, {"tracking_error": 0.026}], ids=["moving", "out of place"]
)
def test_an_arm_that_is_not_at_rest_in_its_place_is_not_released(changed):
    assert after(told(HOLD, **changed), told(RUN), before=BACK).mode == Mode.RETRACT
    # Nor when that comes after the hold.
    late = after(told(HOLD), told(RUN, **changed), told(RUN), before=BACK)
    assert late.mode == Mode.RETRACT


def test_what_is_still_near_is_not_released():
    near = {"clearance": 0.009}
    fled = after(replace(STANDING, **near))
    assert fled.mode == Mode.RETRACT
    assert after(told(HOLD, **near), told(RUN, **near), before=fled).mode == Mode.RETRACT
    # Clear, and quiet for half a second.
    assert after(told(RUN), before=wait(fled, told(HOLD), 0.25)).mode == Mode.RETRACT
    assert after(told(RUN), before=wait(fled, told(HOLD), 0.75)).mode == Mode.PERMIT


@pytest.mark.parametrize("cause", BY_GRAVITY)
def test_a_retraction_that_meets_anything_stops_ready_or_not(cause):
    ready = after(told(HOLD), before=BACK)
    wrong = told(RUN, **TRIGGERS[cause][0])
    stopped = after(wrong, before=ready)
    assert (stopped.mode, stopped.cause) == (Mode.STOP, cause)
    assert after(told(HOLD), told(RUN), before=stopped) == stopped


def test_released_it_is_held_before_the_same_obstacle_again():
    out = after(told(HOLD), told(RUN), before=BACK)
    closing = replace(FREE, clearance=0.028, clearance_rate=-SPEED)
    held = after(replace(FREE, phase=EXTENDING), closing, before=out)
    assert (held.mode, held.cause) == (Mode.HOLD, Cause.CLEARANCE)
    assert command(held, closing) == (HOLD, 1.0)


def test_the_operators_own_way_back_is_turned_with_a_word_that_is_barred_where_forward_is():
    assert command(after(told(EXTEND)), told(EXTEND)) == (EXTEND, 1.0)
    held = after(replace(FREE, clearance=0.028, clearance_rate=-SPEED))
    assert command(held, told(EXTEND)) == (HOLD, 1.0)
