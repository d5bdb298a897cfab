"""When motion is inhibited: collision flags, motion inhibit flags and the frame that is held.

RMS-71, section IV.B: "If the collision exists for two successive frames a motion inhibit flag is
sent to the VISUAL SCENE program on the second frame, and on each succeeding frame until the
collision is relieved."
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pips_drake.remote_manipulator.program_collisions import Contact
from pips_drake.remote_manipulator.program_state import GAP, ProgramState

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Hits:
    """What a frame's collision is about.

    Attributes:
        arm: the whole effector's, or the payload's that it holds.
        finger: the movable prong's, or the payload's.
    """

    arm: bool
    finger: bool


def hits_of(contact: Contact, *, held: bool) -> Hits:
    """The hits of a frame: with a payload, always both (section IV.B)."""
    if held:
        return Hits(arm=contact.any, finger=contact.any)
    return Hits(arm=contact.any, finger=contact.effector[2])


def follow_up(state: ProgramState, command: Array, hits: Hits, *, literal: bool) -> ProgramState:
    """The state after a frame in which `command` was tested.

    Args:
        state: after the last frame.
        command: that was tested, (11,).
        hits: what it hits.
        literal: the command goes on into the wall; otherwise it stays where the scene is held.
    """
    arm_inhibit = hits.arm and state.arm_collision
    finger_inhibit = hits.finger and state.finger_collision
    # The last free command: the prong that hits alone is left where it was free.
    free = state.free
    if not hits.arm:
        free = command.copy()
        if hits.finger:
            free[GAP] = state.free[GAP]
    sent = command
    if arm_inhibit:
        sent = free
    elif finger_inhibit:
        sent = command.copy()
        sent[GAP] = free[GAP]
    inhibited = arm_inhibit or finger_inhibit
    return replace(
        state,
        command=np.asarray(command if literal or not inhibited else sent),
        free=free,
        sent=sent,
        arm_collision=hits.arm,
        finger_collision=hits.finger,
        arm_inhibit=arm_inhibit,
        finger_inhibit=finger_inhibit,
        inhibits=state.inhibits + int(inhibited and not state.inhibited),
    )
