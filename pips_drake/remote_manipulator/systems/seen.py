"""What an operator who watches the task sees, as input ports of a system."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import Context, LeafSystem

from pips_drake.remote_manipulator.autopilot import Seen
from pips_drake.remote_manipulator.phases import Phase
from pips_drake.remote_manipulator.program_state import GAP, pose_of
from pips_drake.twin.systems.inputs import input_values

#: Ports and their sizes, in order.
SEEN_PORTS = (("phase", 1), ("arm_measured", GAP + 1), ("payload_pose", 7), ("cae_pose", 7))


def declare_seen_ports(system: LeafSystem) -> tuple[int, ...]:
    """Declares `SEEN_PORTS` as inputs of a system; their indices."""
    return tuple(
        int(system.DeclareVectorInputPort(name, size).get_index()) for name, size in SEEN_PORTS
    )


def read_seen(system: LeafSystem, context: Context, ports: tuple[int, ...]) -> Seen:
    """What the inputs that `declare_seen_ports` declared say."""
    phase, arm, payload, cae = (input_values(system, context, port) for port in ports)
    return Seen(
        phase=Phase(round(float(phase[0]))),
        arm=np.array(arm),
        X_RP=pose_of(payload),
        X_RC=pose_of(cae),
    )
