"""A supervisor keeps calm: an arm that swings is held once, by one name, until it is quiet."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pips_drake.serpentine.motion_words import HOLD, RETRACT
from pips_drake.serpentine.supervision import (
    BACK,
    FORWARD,
    Cause,
    Decision,
    Mode,
    brakes,
    command_of,
    decide,
)

from .supervised_moments import (
    CONFIG,
    FREE,
    LATENCY,
    PERIOD,
    STANDING,
    THRESHOLDS,
    TRIGGERS,
    after,
    calm,
    command,
    wait,
)

#: The arm's lowest mode, Hz.
MODE = 3.0
QUIET = CONFIG.quiet_s


def changes(sequence, thresholds=THRESHOLDS):
    """(mode, cause) each time that one of them changes."""
    decision, found = Decision(), []
    for seen in sequence:
        before, decision = decision, decide(decision, seen, thresholds, PERIOD)
        if (decision.mode, decision.cause) != (before.mode, before.cause):
            found.append((decision.mode, decision.cause))
    return found


def swinging(seconds, amplitude, decay):
    """A standing arm that was pushed out of its place and swings back: error, and drives' load."""
    for time in np.arange(0.0, seconds, PERIOD):
        left = math.exp(-decay * time)
        wave = math.cos(2.0 * math.pi * MODE * time)
        yield replace(
            STANDING,
            tracking_error=amplitude * left * abs(wave),
            force_share=0.4 + 0.9 * left * abs(wave),
        )


@pytest.mark.parametrize("amplitude", [0.05, 0.1, 0.2])
def test_an_arm_that_swings_is_held_once_and_let_go_once_it_is_quiet(amplitude):
    pushed = list(swinging(6.0, amplitude, decay=1.5))
    found = changes([FREE, *pushed])
    assert found == [(Mode.HOLD, Cause.TRACKING), (Mode.PERMIT, Cause.NONE)]
    # What the quiet time is for: without it the tip starts and stops on.
    nervous = replace(THRESHOLDS, quiet_time=0.0)
    assert len(changes([FREE, *pushed], nervous)) >= 4


@pytest.mark.parametrize("cause", list(Cause)[1:6])
def test_motion_is_free_again_after_the_quiet_time_and_not_before(cause):
    held = replace(after(replace(STANDING, **TRIGGERS[cause][0])), mode=Mode.HOLD)
    nearly = wait(held, STANDING, QUIET - PERIOD)
    assert (nearly.mode, nearly.cause) == (Mode.HOLD, cause)
    assert after(STANDING, before=nearly).mode == Mode.PERMIT
    # What comes back in between begins anew.
    between = replace(STANDING, **TRIGGERS[cause][0 if cause == Cause.ENCODER else 1])
    again = after(between, before=nearly)
    assert wait(again, STANDING, QUIET - PERIOD).mode == Mode.HOLD
    assert calm(again).mode == Mode.PERMIT


def test_an_arm_that_is_not_yet_in_its_place_is_not_let_go():
    held = after(replace(STANDING, **TRIGGERS[Cause.FORCE][0]))
    # 26 mm: not enough to be held for, and too much to be let go.
    away = replace(STANDING, tracking_error=0.026)
    assert wait(held, away, 4.0).mode == Mode.HOLD
    assert calm(wait(held, away, 4.0)).mode == Mode.PERMIT


def test_what_clears_while_something_else_is_wrong_loses_its_bars_but_not_the_hold():
    # Out of its place, both ways are barred; back in it, the operator may leave the obstacle.
    both = replace(STANDING, clearance=0.02, tracking_error=0.05)
    closing = replace(both, clearance_rate=-0.025, tip_rate=0.025)
    held = after(closing)
    assert held.barred_directions == FORWARD | BACK
    left = wait(held, replace(both, tracking_error=0.001), QUIET)
    assert (left.mode, left.cause) == (Mode.HOLD, Cause.CLEARANCE)
    assert left.barred_directions == FORWARD
    leaving = replace(both, tracking_error=0.001, wish=RETRACT)
    assert command(left, leaving) == (RETRACT, 1.0)


def test_a_lesser_cause_does_not_take_the_name_and_a_graver_one_does():
    force = replace(STANDING, **TRIGGERS[Cause.FORCE][0])
    both = replace(force, **TRIGGERS[Cause.TRACKING][0])
    found = changes([force, both, force, both, *[STANDING] * 17])
    assert found == [
        (Mode.HOLD, Cause.FORCE),
        (Mode.HOLD, Cause.TRACKING),
        (Mode.PERMIT, Cause.NONE),
    ]


def test_the_name_stays_while_the_last_of_several_causes_becomes_quiet():
    # The force goes on a little longer, below the threshold that would name it alone.
    both = replace(STANDING, **TRIGGERS[Cause.FORCE][0], **TRIGGERS[Cause.TRACKING][0])
    loaded = replace(STANDING, **TRIGGERS[Cause.FORCE][1])
    found = changes([both, *[loaded] * 8, *[STANDING] * 17])
    assert found == [(Mode.HOLD, Cause.TRACKING), (Mode.PERMIT, Cause.NONE)]


def test_patience_does_not_run_out_on_what_is_over():
    error = replace(STANDING, **TRIGGERS[Cause.TRACKING][0])
    held = wait(Decision(), error, CONFIG.patience_s - 0.25)
    assert held.mode == Mode.HOLD
    quiet = wait(held, STANDING, QUIET - PERIOD)
    # Longer than the patience, but nothing is wrong any more.
    assert quiet.mode == Mode.HOLD and quiet.waited > CONFIG.patience_s
    assert calm(quiet).mode == Mode.PERMIT


def lost(error, **changed):
    return replace(STANDING, tracking_error=error, **changed)


def test_a_held_arm_that_goes_on_leaving_its_place_is_stopped_at_once():
    # Held at 42 mm; 20 more are one too many.
    held = after(lost(0.042))
    assert held.mode == Mode.HOLD
    assert after(lost(0.0619), before=held).mode == Mode.HOLD
    stopped = after(lost(0.0621), before=held)
    assert (stopped.mode, stopped.cause) == (Mode.STOP, Cause.RUNAWAY)
    assert command(stopped, STANDING) == (HOLD, 1.0)
    # Whatever the operator does: holding lets the patience wait, but not this.
    assert after(lost(0.0621, wish=HOLD), before=held).mode == Mode.STOP


@pytest.mark.parametrize("share", [0.81, 1.2])
def test_an_arm_that_is_pushed_out_of_its_place_is_held_and_not_stopped(share):
    # Its drives are at their limits, or it leans on what it was pushed against.
    held = after(lost(0.042, force_share=share))
    pushed = after(*(lost(error, force_share=share) for error in (0.1, 0.2)), before=held)
    assert pushed.mode == Mode.HOLD
    # Let go, it is still far off, drives no longer at their limits: on its way back, and beyond.
    back = after(*map(lost, (0.15, 0.02, 0.06, 0.03)), before=pushed)
    assert back.mode == Mode.HOLD
    # Pushed first, and then running away: drives that are not at their limits move it themselves.
    assert after(lost(0.07), before=back).mode == Mode.STOP
    # A single look at which they need little, as where it strikes, does not say so.
    once = after(lost(0.21), before=pushed)
    assert once.mode == Mode.HOLD
    assert after(lost(0.22), before=once).mode == Mode.STOP


def test_an_arm_that_stays_out_of_its_place_waits_for_its_patience():
    # 1 mm/s over 1/32 s is what it may creep.
    held = after(lost(0.042), lost(0.1, force_share=1.0), lost(0.1))
    assert after(lost(0.10003), before=held).mode == Mode.HOLD
    assert after(lost(0.10004), before=held).mode == Mode.STOP


def test_what_comes_back_and_leaves_again_is_measured_from_anew():
    held = calm(after(lost(0.055)))
    assert held.mode == Mode.PERMIT and held.lost_at == math.inf
    again = after(lost(0.041), before=held)
    assert again.lost_at == 0.041
    assert after(lost(0.0609), before=again).mode == Mode.HOLD
    assert after(lost(0.0611), before=again).mode == Mode.STOP


def test_a_part_of_the_arm_that_closes_in_on_another_is_held_before_it_is_the_nearest():
    # 40 mm at 0.1 m/s over 0.35 s: 5 mm are left. Another pair stands nearer and does not move.
    near = replace(FREE, own_clearance=0.02, own_urgent_clearance=0.0401, own_urgent_rate=-0.1)
    assert THRESHOLDS.stopping_time == pytest.approx(LATENCY + 0.25)
    assert after(near).mode == Mode.PERMIT
    held = after(replace(near, own_urgent_clearance=0.0399))
    assert (held.mode, held.cause) == (Mode.HOLD, Cause.SELF_CLEARANCE)
    assert held.own_least == 0.02
    # Slower than a swing, it stands.
    assert after(replace(near, own_urgent_clearance=0.004, own_urgent_rate=-0.9e-3)).mode == (
        Mode.PERMIT
    )


def test_an_arm_is_braked_at_a_stop_only():
    assert [mode for mode in Mode if brakes(Decision(mode=mode))] == [Mode.STOP]
    assert command_of(Decision(mode=Mode.STOP), RETRACT, 0.0, 0.5) == (HOLD, 1.0)
