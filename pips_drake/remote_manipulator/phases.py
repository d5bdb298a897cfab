"""The task's phases and what leads from one to another: the machine's table.

RMS-71 runs one way: modes 1 (acquisition), 2 (extraction), 3 (manoeuvring), 4 (docked). Its section
VII asks for free flyers, release and insertion, so that each mode can be left the way it was
entered. A phase is a mode, whether the effector holds the payload, and what else does. The diagram
of the documentation is made of the same table (`phase_diagram`).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class Phase(IntEnum):
    """Where the task is."""

    STOWED = 0
    DOCKED = 1
    FREE_FLYING = 2
    EXTRACTION = 3
    MANOEUVRING = 4
    DOCKED_HELD = 5


@dataclass(frozen=True)
class PhaseFacts:
    """What a phase means.

    Attributes:
        mode: 1 to 4, as in the control word (RMS-71, Table II).
        grasped: the effector holds the payload.
        support: what else holds it: bay, port or none.
    """

    mode: int
    grasped: bool
    support: str


TABLE: dict[Phase, PhaseFacts] = {
    Phase.STOWED: PhaseFacts(1, False, "bay"),
    Phase.DOCKED: PhaseFacts(1, False, "port"),
    Phase.FREE_FLYING: PhaseFacts(1, False, "none"),
    Phase.EXTRACTION: PhaseFacts(2, True, "none"),
    Phase.MANOEUVRING: PhaseFacts(3, True, "none"),
    Phase.DOCKED_HELD: PhaseFacts(4, True, "port"),
}
#: Names of the phases, in the order of `Phase`.
PHASES = tuple(phase.name.lower() for phase in Phase)
#: Supports, by the number that the collision program's `attachment` output has.
SUPPORTS = ("none", "bay", "port")


class Event(IntEnum):
    """What may change the phase in a frame; NONE changes nothing."""

    NONE = 0
    RESET = 1
    ACQUIRED = 2
    LEFT_BAY = 3
    ENTERED_BAY = 4
    DOCKED = 5
    RELEASED = 6
    UNDOCKED = 7


@dataclass(frozen=True)
class Transition:
    """One arrow of the table.

    Attributes:
        source, event, target: what they say.
        guard: "", inside_bay, outside_bay, berthed or adrift: which of two targets an event has.
    """

    source: Phase
    event: Event
    target: Phase
    guard: str = ""


#: Every change of phase there is, but `RESET`, which leads from any phase to the scenario's first.
TRANSITIONS: tuple[Transition, ...] = (
    Transition(Phase.STOWED, Event.ACQUIRED, Phase.EXTRACTION),
    Transition(Phase.FREE_FLYING, Event.ACQUIRED, Phase.EXTRACTION, "inside_bay"),
    Transition(Phase.FREE_FLYING, Event.ACQUIRED, Phase.MANOEUVRING, "outside_bay"),
    Transition(Phase.DOCKED, Event.ACQUIRED, Phase.DOCKED_HELD),
    Transition(Phase.EXTRACTION, Event.LEFT_BAY, Phase.MANOEUVRING),
    Transition(Phase.MANOEUVRING, Event.ENTERED_BAY, Phase.EXTRACTION),
    Transition(Phase.MANOEUVRING, Event.DOCKED, Phase.DOCKED_HELD),
    Transition(Phase.EXTRACTION, Event.RELEASED, Phase.STOWED, "berthed"),
    Transition(Phase.EXTRACTION, Event.RELEASED, Phase.FREE_FLYING, "adrift"),
    Transition(Phase.MANOEUVRING, Event.RELEASED, Phase.FREE_FLYING),
    Transition(Phase.DOCKED_HELD, Event.RELEASED, Phase.DOCKED),
    Transition(Phase.DOCKED_HELD, Event.UNDOCKED, Phase.MANOEUVRING),
)


@dataclass(frozen=True)
class Situation:
    """What the measured world says of the phase.

    Attributes:
        acquirable: all conditions of acquisition hold, and the operator does not open the prong.
        prong_open: the prong is farther open than holds a bar.
        latch_open: the operator opens the docking port's latch.
        dockable: the payload is within docking's tolerances, and the port is armed.
        above_bay: all of the payload is above the bay's face c.
        inside_bay: some of it is below face c, within the bay's opening.
        entering_bay: the same, by more than a play, so that a payload that hovers at face c is not
            in and out by turns.
        berthed: it is within the tolerances of the bay's latches.
    """

    acquirable: bool = False
    prong_open: bool = False
    latch_open: bool = False
    dockable: bool = False
    above_bay: bool = False
    inside_bay: bool = False
    entering_bay: bool = False
    berthed: bool = False

    def guards(self) -> frozenset[str]:
        """The guards that are open; of each of the two pairs, one."""
        bay = "inside_bay" if self.inside_bay else "outside_bay"
        return frozenset(("", bay, "berthed" if self.berthed else "adrift"))


def event_of(phase: Phase, situation: Situation) -> Event:
    """The one event that happens in this frame; letting go comes before all else."""
    facts = TABLE[phase]
    if not facts.grasped:
        return Event.ACQUIRED if situation.acquirable else Event.NONE
    if situation.prong_open:
        return Event.RELEASED
    if phase is Phase.DOCKED_HELD:
        return Event.UNDOCKED if situation.latch_open else Event.NONE
    if phase is Phase.EXTRACTION:
        return Event.LEFT_BAY if situation.above_bay else Event.NONE
    if situation.dockable and not situation.latch_open:
        return Event.DOCKED
    return Event.ENTERED_BAY if situation.entering_bay else Event.NONE


def next_phase(phase: Phase, event: Event, situation: Situation, *, first: Phase) -> Phase:
    """Where an event leads.

    Args:
        first: the scenario's first phase, where `RESET` leads.

    Raises:
        ValueError: the table has no such arrow.
    """
    if event is Event.NONE:
        return phase
    if event is Event.RESET:
        return first
    guards = situation.guards()
    for arrow in TRANSITIONS:
        if arrow.source is phase and arrow.event is event and arrow.guard in guards:
            return arrow.target
    raise ValueError(f"no {event.name.lower()} in phase {phase.name.lower()}")
