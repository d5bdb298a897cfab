"""The machine's table, and the world that goes through it."""

from __future__ import annotations

import itertools

import pytest

from pips_drake.remote_manipulator.phase_diagram import phase_diagram
from pips_drake.remote_manipulator.phases import (
    PHASES,
    TABLE,
    TRANSITIONS,
    Event,
    Phase,
    Situation,
    event_of,
    next_phase,
)

FIELDS = tuple(Situation.__dataclass_fields__)
SITUATIONS = [
    Situation(**dict(zip(FIELDS, truths, strict=True)))
    for truths in itertools.product((False, True), repeat=len(FIELDS))
]


def test_every_phase_has_a_mode_and_the_payload_is_held_by_something_unless_it_flies():
    assert set(TABLE) == set(Phase)
    assert {facts.mode for facts in TABLE.values()} == {1, 2, 3, 4}
    for phase, facts in TABLE.items():
        assert facts.grasped == (facts.mode > 1)
        loose = not facts.grasped and facts.support == "none"
        assert loose == (phase is Phase.FREE_FLYING)


def test_no_two_phases_are_told_by_the_same_facts():
    assert len(set(TABLE.values())) == len(TABLE)


@pytest.mark.parametrize("phase", Phase)
def test_whatever_the_world_is_like_the_table_says_where_to_go(phase):
    reached = set()
    for situation in SITUATIONS:
        event = event_of(phase, situation)
        reached.add(next_phase(phase, event, situation, first=Phase.STOWED))
    allowed = {arrow.target for arrow in TRANSITIONS if arrow.source is phase}
    assert reached == allowed | {phase}


def test_what_holds_the_payload_changes_one_at_a_time_except_where_a_support_takes_or_gives_it():
    for arrow in TRANSITIONS:
        source, target = TABLE[arrow.source], TABLE[arrow.target]
        # Nothing goes from the bay to the port, or back, without being carried.
        assert "none" in (source.support, target.support) or source.support == target.support
        if arrow.event in (Event.ACQUIRED, Event.RELEASED):
            assert source.grasped != target.grasped


def test_every_phase_can_be_left_and_reached():
    assert {arrow.source for arrow in TRANSITIONS} == set(Phase)
    assert {arrow.target for arrow in TRANSITIONS} == set(Phase)


def test_letting_go_comes_before_all_else():
    everything = Situation(**dict.fromkeys(FIELDS, True))
    for phase in (Phase.EXTRACTION, Phase.MANOEUVRING, Phase.DOCKED_HELD):
        assert event_of(phase, everything) is Event.RELEASED


def test_a_port_whose_latch_is_held_open_takes_nothing():
    assert event_of(Phase.MANOEUVRING, Situation(dockable=True)) is Event.DOCKED
    assert event_of(Phase.MANOEUVRING, Situation(dockable=True, latch_open=True)) is Event.NONE


def test_a_reset_leads_to_the_scenarios_first_phase_from_everywhere():
    for phase, first in itertools.product(Phase, (Phase.STOWED, Phase.DOCKED, Phase.FREE_FLYING)):
        assert next_phase(phase, Event.RESET, Situation(), first=first) is first


def test_an_arrow_that_the_table_lacks_is_refused():
    with pytest.raises(ValueError, match="no docked in phase stowed"):
        next_phase(Phase.STOWED, Event.DOCKED, Situation(), first=Phase.STOWED)


def test_the_diagram_has_all_phases_and_arrows_and_no_more():
    lines = phase_diagram().splitlines()
    assert lines[0] == "stateDiagram-v2"
    states = [line for line in lines if "(mode" in line]
    assert [line.split(":")[0].strip() for line in states] == list(PHASES)
    arrows = [line for line in lines if "-->" in line and "[*]" not in line]
    drawn = {tuple(line.split(":")[0].split("-->")) for line in arrows}
    expected = {(PHASES[arrow.source], PHASES[arrow.target]) for arrow in TRANSITIONS}
    assert {(a.strip(), b.strip()) for a, b in drawn} == expected
    assert len(arrows) == len(TRANSITIONS)
