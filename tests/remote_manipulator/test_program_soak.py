"""A random operator, ten times ten minutes: nothing outside of the table, no wall passed."""

from __future__ import annotations

import collections
import functools
from dataclasses import dataclass, field

import numpy as np
import pytest

from pips_drake.remote_manipulator.control_word import decode, encode
from pips_drake.remote_manipulator.display import display
from pips_drake.remote_manipulator.phases import TRANSITIONS, Event, Phase
from pips_drake.remote_manipulator.program_state import ProgramSettings

from .program_world import CONFIG, STOWED, arm_over, docked_payload, world
from .random_operator import RandomOperator, least_separation, motion_bound

#: Ten minutes of frames.
TEN_MINUTES = 12000
SEEDS = range(10)
#: Nearer than this, what was sent is tested again, m.
NEAR = 0.05
STARTS = {
    Phase.STOWED: STOWED,
    Phase.DOCKED: docked_payload(away=0.03),
    Phase.FREE_FLYING: docked_payload(away=2.0),
}
ARROWS = {(arrow.source, arrow.event, arrow.target) for arrow in TRANSITIONS}


@dataclass
class Soak:
    """What a random operator did, and the worst that came of it."""

    phases: collections.Counter[Phase] = field(default_factory=collections.Counter)
    events: collections.Counter[Event] = field(default_factory=collections.Counter)
    inhibits: int = 0
    # Deepest penetration of what the scene was sent, in frames of motion; and how often looked at.
    deepest: float = 0.0
    looked: int = 0


def soak(seed: int, frames: int, settings: ProgramSettings | None = None) -> Soak:
    """Runs, and checks every frame."""
    first = tuple(STARTS)[seed % 3]
    there = world(
        settings, phase=first, payload=STARTS[first], arm=arm_over(STARTS[first], up=0.05)
    )
    operator, found = RandomOperator(there, seed), Soak()
    lower, upper = CONFIG.arm.lower, CONFIG.arm.upper
    for _ in range(frames):
        before = there.state
        state = there.frame(**operator.inputs())
        assert np.isfinite(state.vector()).all()
        frame = there.shown
        assert np.isfinite(display(state, frame)).all()
        if state.event in (Event.NONE, Event.RESET):
            expected = first if state.event is Event.RESET else before.phase
            assert state.phase is expected
        else:
            assert (before.phase, state.event, state.phase) in ARROWS
        assert np.all((state.sent[1:7] >= lower) & (state.sent[1:7] <= upper))
        # Inhibited on the second successive frame in collision, and on no other.
        if state.event is Event.NONE and not state.initializing:
            assert state.arm_inhibit == (state.arm_collision and before.arm_collision)
            assert state.finger_inhibit == (state.finger_collision and before.finger_collision)
        word = frame.word
        assert decode(encode(word)) == word
        found.phases[state.phase] += 1
        found.events[state.event] += 1
        if state.phase is not Phase.DOCKED_HELD and frame.contact.separation < NEAR:
            found.looked += 1
            gap = least_separation(there)
            if gap < 0.0:
                found.deepest = max(found.deepest, -gap / motion_bound(there))
    found.inhibits = there.state.inhibits
    return found


@functools.cache
def ten_minutes(seed: int) -> Soak:
    return soak(seed, TEN_MINUTES)


def test_half_a_minute_of_a_random_operator():
    found = soak(8, 600)
    assert found.looked > 20
    assert found.deepest <= 2.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_ten_minutes_of_a_random_operator(seed):
    found = ten_minutes(seed)
    assert sum(found.phases.values()) == TEN_MINUTES
    assert found.looked > 1000
    assert found.inhibits > 5
    # Two frames of motion are asked. One frame is what the program lets through by design.
    assert found.deepest <= 1.0


@pytest.mark.slow
def test_the_ten_operators_went_through_all_phases_and_events():
    phases = sum((ten_minutes(seed).phases for seed in SEEDS), collections.Counter())
    events = sum((ten_minutes(seed).events for seed in SEEDS), collections.Counter())
    assert set(phases) == set(Phase)
    assert set(events) == set(Event)


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [
        ProgramSettings(inhibit="literal"),
        ProgramSettings(slide_along_walls=True),
        ProgramSettings(snap_to_right_angles=True),
        ProgramSettings(collision="report"),
    ],
    ids=["literal", "slide", "snap", "report"],
)
def test_every_option_survives_a_random_operator(settings):
    # Of the seeds, the one that holds the payload in the bay for longest.
    found = soak(6, 4000, settings)
    assert found.inhibits > 5
    # The report's tests miss whole contacts, and a snapped payload jumps.
    if settings.collision == "exact" and not settings.snap_to_right_angles:
        assert found.deepest <= 1.0
