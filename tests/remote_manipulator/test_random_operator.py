"""The random operator is one hand: repeatable, no faster than a hand, everywhere at the desk."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pips_drake.remote_manipulator import random_operator
from pips_drake.remote_manipulator.analog_inputs import angle_scaling, encode_channels
from pips_drake.remote_manipulator.autopilot import Seen
from pips_drake.remote_manipulator.operator_inputs import (
    FIELDS,
    OperatorFrames,
    frames_of,
)
from pips_drake.remote_manipulator.phases import Phase
from pips_drake.remote_manipulator.random_operator import HAND_RATE, RandomOperator, RandomState

from .program_world import CONFIG, STOWED, arm_over, cae_pose

ARM = arm_over(STOWED, up=0.3)
SEEN = Seen(phase=Phase.STOWED, arm=ARM, X_RP=STOWED, X_RC=cae_pose())
FRAME = 0.05
#: Ten minutes and a half: some thirty decisions.
FRAMES = 12600


def worked(seed: int, frames: int, *, seen: Seen = SEEN) -> OperatorFrames:
    hand = RandomOperator(CONFIG, seed, station=3)
    state, done = hand.first_state(ARM[1:7]), []
    for _ in range(frames):
        state, inputs = hand.advance(state, seen)
        done.append(inputs)
    return frames_of(done)


@pytest.fixture(scope="module")
def long() -> OperatorFrames:
    return worked(1, FRAMES)


def test_the_same_seed_does_the_same_and_another_does_not():
    one, same, other = (worked(seed, 400) for seed in (5, 5, 6))
    assert one.angles.tobytes() == same.angles.tobytes()
    assert one.switches.tobytes() == same.switches.tobytes()
    assert not np.array_equal(one.angles, other.angles)


def test_what_it_does_depends_on_the_state_alone():
    hand = RandomOperator(CONFIG, 5)
    state = hand.first_state(ARM[1:7])
    for _ in range(50):
        state, _ = hand.advance(state, SEEN)
    again = RandomState.of_vector(state.vector())
    for _ in range(50):
        (state, one), (again, other) = hand.advance(state, SEEN), hand.advance(again, SEEN)
        assert dataclasses.astuple(one)[1:] == dataclasses.astuple(other)[1:]
        assert one.angles.tobytes() == other.angles.tobytes()


def test_angles_go_no_faster_than_a_hand_and_are_within_full_scale(long):
    rates = np.abs(np.diff(long.angles, axis=0)) / FRAME
    # Rounding of sums of steps.
    assert rates.max() <= HAND_RATE * (1.0 + 1e-9)
    # It does use what it may.
    assert rates.max() > 0.99 * HAND_RATE
    assert np.isfinite(encode_channels(long, angle_scaling(CONFIG.arm))).all()
    beyond = (long.angles > CONFIG.arm.upper) | (long.angles < CONFIG.arm.lower)
    assert beyond.any()


@pytest.fixture(scope="module")
def decisions() -> OperatorFrames:
    """A thousand decisions, each left as soon as it is made."""
    hand = RandomOperator(CONFIG, 3)
    state, done = hand.first_state(ARM[1:7]), []
    for _ in range(1000):
        state, inputs = hand.advance(dataclasses.replace(state, left=0), SEEN)
        done.append(inputs)
    return frames_of(done)


@pytest.mark.parametrize("field", [name for name in FIELDS if "initialize" not in name])
def test_every_switch_is_put_in_every_place(decisions, field):
    places = set(decisions.column(field).tolist())
    if field == "station":
        assert places == set(range(13))
    else:
        assert places == ({0, 1} if field == "open_latch" else {-1, 0, 1})


def test_initializations_are_seldom(long):
    # One in ten thousand frames is meant: seven of 12,600 have a chance below 1e-3.
    assert long.column("initialize").sum() < 7


def test_initializations_are_of_every_kind(monkeypatch):
    monkeypatch.setattr(random_operator, "_INITIALIZES", 0.05)
    done = worked(1, 400)
    on = done.column("initialize") == 1
    assert set(done.column("initialize_select")[on].tolist()) == {0, 1, 2}
    assert not done.column("initialize_select")[~on].any()


def test_what_is_held_decides_what_is_done():
    held = dataclasses.replace(SEEN, phase=Phase.MANOEUVRING)
    done = worked(2, 4000, seen=held)
    free = worked(2, 4000)
    assert not np.array_equal(done.angles, free.angles)
    # Who holds a payload does not keep the prong open.
    opened = np.mean(done.column("prong") == -1)
    assert opened < 0.3 < np.mean(free.column("prong") == -1)
