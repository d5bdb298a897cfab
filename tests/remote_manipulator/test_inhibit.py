"""Motion inhibit: on the second successive frame in collision, never the first, until relieved."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from pips_drake.remote_manipulator.inhibit import Hits, follow_up
from pips_drake.remote_manipulator.phases import Phase
from pips_drake.remote_manipulator.program_state import (
    ANGLES,
    GAP,
    HEIGHT,
    ProgramSettings,
    first_state,
)

from .program_world import CONFIG, STOWED, World, arm_over, world

STEP = CONFIG.stand.rate_m_s * 0.05


def flags(state) -> tuple[bool, bool, bool, bool]:
    return (
        state.arm_collision,
        state.finger_collision,
        state.arm_inhibit,
        state.finger_inhibit,
    )


def sequence(hits: str, finger: str | None = None) -> list[tuple[bool, bool]]:
    """Inhibit flags (arm, finger) of frames in which x stands for a hit."""
    state = first_state(Phase.STOWED, np.zeros(11))
    found = []
    for frame, (arm, prong) in enumerate(zip(hits, finger or hits, strict=True)):
        command = state.command.copy()
        command[HEIGHT] += 0.001 * (frame + 1)
        state = follow_up(state, command, Hits(arm == "x", prong == "x"), literal=True)
        found.append((state.arm_inhibit, state.finger_inhibit))
    return found


@pytest.mark.parametrize("length", [6])
def test_a_flag_is_raised_on_every_second_successive_hit_and_on_no_other_frame(length):
    # All sequences of hits there are: the rule is the definition, frame by frame.
    for hits in itertools.product(".x", repeat=length):
        raised = [one[0] for one in sequence("".join(hits))]
        expected = [k > 0 and hits[k] == "x" and hits[k - 1] == "x" for k in range(length)]
        assert raised == expected


def test_the_fingers_flag_can_be_raised_alone():
    assert sequence("....", ".xx.") == [
        (False, False),
        (False, False),
        (False, True),
        (False, False),
    ]


def lowered(inhibit: str = "direction_aware") -> World:
    """The effector over the bar, to be lowered by the stand."""
    return world(ProgramSettings(inhibit=inhibit), arm=arm_over(STOWED, height=3.5))


@pytest.mark.parametrize("inhibit", ["direction_aware", "literal"])
def test_the_palm_on_the_bar_inhibits_the_arm_on_the_second_frame(inhibit):
    there = lowered(inhibit)
    sent, seen = [], []
    for _ in range(12):
        state = there.frame(telescope=-1)
        sent.append(state.sent[HEIGHT])
        seen.append(flags(state))
    # 10 mm of gap and 3 mm a frame: free, free, free, collision, inhibit.
    assert seen[:3] == [(False,) * 4] * 3
    assert seen[3] == (True, False, False, False)
    assert all(one == (True, False, True, False) for one in seen[4:])
    # The first frame in collision is still shown; then the last free one is.
    assert sent[3] == pytest.approx(3.5 - 4 * STEP)
    assert sent[4:] == [sent[2]] * 8
    assert there.state.inhibits == 1


def test_literal_the_command_goes_on_and_must_come_back():
    there = lowered("literal")
    for _ in range(10):
        there.frame(telescope=-1)
    assert there.state.command[HEIGHT] == pytest.approx(3.5 - 10 * STEP)
    # Free again above 3.49 m: seven steps up from 3.47 m.
    raised = [there.frame(telescope=1).arm_inhibit for _ in range(8)]
    assert raised == [True] * 6 + [False] * 2
    assert there.state.sent[HEIGHT] == pytest.approx(there.state.command[HEIGHT])


def test_direction_aware_a_reversal_relieves_at_once():
    there = lowered()
    for _ in range(10):
        there.frame(telescope=-1)
    held = there.state.sent[HEIGHT]
    assert there.state.arm_inhibit
    state = there.frame(telescope=1)
    assert flags(state) == (False,) * 4
    assert state.sent[HEIGHT] == pytest.approx(held + STEP)


def test_direction_aware_an_operator_who_waits_is_relieved_as_what_is_held_is_free():
    there = lowered()
    for _ in range(10):
        there.frame(telescope=-1)
    assert flags(there.frame()) == (False,) * 4


def test_a_prong_that_closes_on_the_bar_raises_the_fingers_flag_alone():
    # Move the effector so that the prong meets the bar before it is shut.
    there = world(arm=arm_over((STOWED[0], STOWED[1] + [0.0, 0.06, 0.0])))
    seen = []
    for _ in range(160):
        seen.append(flags(there.frame(prong=1)))
        if seen[-1][3]:
            break
    first = next(k for k, one in enumerate(seen) if one[1])
    assert seen[first] == (False, True, False, False)
    assert seen[first + 1] == (False, True, False, True)
    assert there.state.phase is Phase.STOWED
    # The prong is held where it was free; the arm is not.
    gap = there.state.sent[GAP]
    up = there.frame(prong=1, telescope=-1)
    assert up.sent[GAP] == gap
    assert flags(up)[2:] == (False, True)
    # Opened, it is free.
    assert flags(there.frame(prong=-1)) == (False,) * 4


def test_a_prong_that_the_arm_pushes_into_the_bar_inhibits_all():
    there = world(arm=arm_over((STOWED[0], STOWED[1] + [0.0, 0.06, 0.0]), gap=0.305))
    aside = arm_over((STOWED[0], STOWED[1] + [0.0, 0.2, 0.0]), gap=0.305)
    for _ in range(200):
        state = there.frame(angles=aside[ANGLES])
        if state.arm_inhibit:
            break
    assert flags(state) == (True, True, True, True)
    assert there.shown is not None
    assert there.shown.contact.effector == (False, False, True)


@pytest.mark.parametrize("prong", [0, -1])
def test_an_inhibited_arm_inhibits_the_prong_too(prong):
    there = lowered()
    for _ in range(10):
        there.frame(telescope=-1)
    gap = there.state.sent[GAP]
    assert there.frame(telescope=-1, prong=prong).sent[GAP] == gap


@pytest.mark.parametrize("inhibit", ["direction_aware", "literal"])
def test_a_payload_in_a_wall_raises_both_flags_on_the_second_frame(inhibit):
    there = world(ProgramSettings(inhibit=inhibit), arm=arm_over(STOWED, height=3.5, gap=0.25))
    there.frame()
    assert there.state.phase is Phase.EXTRACTION
    there.go(arm_over((STOWED[0], STOWED[1] - [0.0, 0.0, 0.2]), height=3.5, gap=0.25))
    aside = arm_over((STOWED[0], STOWED[1] + [0.0, 0.6, -0.2]), height=3.5, gap=0.25)
    seen, sent = [], []
    for _ in range(400):
        state = there.frame(angles=aside[ANGLES])
        seen.append(flags(state))
        sent.append(state.sent)
        if len([one for one in seen if one[2]]) == 5:
            break
    first = next(k for k, one in enumerate(seen) if one[0])
    assert seen[first] == (True, True, False, False)
    assert seen[first + 1 :] == [(True, True, True, True)] * 5
    for one in sent[first + 1 :]:
        np.testing.assert_array_equal(one, sent[first - 1])
    assert there.shown is not None
    pair = there.program.collisions.pair_names(there.shown.contact.pair, held=True)
    assert pair == ("hull", "wall_port")
