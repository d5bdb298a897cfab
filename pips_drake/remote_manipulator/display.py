"""What the operator is shown in a frame, as numbers with names."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pips_drake.remote_manipulator.phases import SUPPORTS, TABLE
from pips_drake.remote_manipulator.program import Frame
from pips_drake.remote_manipulator.program_state import ProgramState

Array = NDArray[np.float64]

#: Entries of the collision program's `display` output.
DISPLAY = (
    # Least separation of effector and payload from everything else (of a docked payload, but for
    # the CAE), m, negative in collision; and its pair, `CollisionTest.pair_names`.
    "separation_m",
    "pair",
    # The pair is of a payload that is held (1), or of a free effector (0).
    "held",
    # What is still missing to acquisition; and its conditions, bit k for the k-th of
    # `acquisition.CONDITIONS`.
    "acquisition_distance_m",
    "acquisition_angle_rad",
    "acquisition_conditions",
    # Of the probe from the port, and whether the port would take the payload.
    "docking_distance_m",
    "docking_angle_rad",
    "docking_in_envelope",
    "docking_armed",
    # Of the payload from its stowed pose.
    "berthing_distance_m",
    "berthing_angle_rad",
    # `LimitWarnings`.
    "warning_hard",
    "warning_soft",
    "warning_reach",
    # `phases.Event` of the frame; how many frames, resets and inhibits there have been.
    "event",
    "frames",
    "resets",
    "inhibits",
)


def display(state: ProgramState, frame: Frame) -> Array:
    """The entries of `DISPLAY`, (19,)."""
    contact, warnings = frame.contact, frame.warnings
    return np.array(
        [
            contact.separation,
            contact.pair,
            frame.held,
            frame.acquisition.distance,
            frame.acquisition.angle,
            _bits(frame.acquisition.conditions),
            frame.docking.distance,
            frame.docking.angle,
            frame.docking.in_envelope,
            state.armed,
            frame.berthing.distance,
            frame.berthing.angle,
            warnings.hard,
            warnings.soft,
            warnings.reach,
            state.event,
            state.frames,
            state.resets,
            state.inhibits,
        ],
        dtype=np.float64,
    )


def flags(state: ProgramState) -> Array:
    """Collision flags of arm and finger, motion inhibit flags of arm and finger, (4,)."""
    return np.array(
        [state.arm_collision, state.finger_collision, state.arm_inhibit, state.finger_inhibit],
        dtype=np.float64,
    )


def attachment(state: ProgramState) -> Array:
    """What holds the payload: grasped, the number of its support in `SUPPORTS`; resets, (3,)."""
    facts = TABLE[state.phase]
    support = SUPPORTS.index(facts.support)
    return np.array([facts.grasped, support, state.resets], dtype=np.float64)


def _bits(truths: Sequence[bool]) -> int:
    return sum(1 << k for k, true in enumerate(truths) if true)
