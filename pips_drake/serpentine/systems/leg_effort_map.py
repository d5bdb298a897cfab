"""From actuator forces to joint efforts: the inverse of `ActuatorForceMap`."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.drives import levers


class LegEffortMap(LeafSystem):
    """Forces along the actuators to the efforts that they make at the joints.

    .. pydrake_system::

        name: LegEffortMap
        input_ports:
        - joint_state
        - base_effort
        - leg_force
        output_ports:
        - joint_effort

    Input ports:

    - `joint_state`, (2 J,): joint values, m and rad, and their rates (not used).
    - `base_effort`, (2,): of the drives that act on their joints directly, N and Nm.
    - `leg_force`, (A,): of the actuators, N; a pushing one is positive.

    Output port, with feedthrough:

    - `joint_effort`, (J,): N and Nm. By virtual work tau = L'(theta) F.

    State: none.
    """

    def __init__(self, arm: SerpentineArm) -> None:
        super().__init__()
        self._arm = arm
        legs = len(arm.actuator_names)
        self._joint_port = self.DeclareVectorInputPort("joint_state", 2 * arm.joints)
        self._base_port = self.DeclareVectorInputPort("base_effort", arm.joints - legs)
        self._force_port = self.DeclareVectorInputPort("leg_force", legs)
        self.DeclareVectorOutputPort("joint_effort", arm.joints, self._calc_joint_effort)

    def _calc_joint_effort(self, context: Context, output: BasicVector) -> None:
        joints, _ = np.split(self._joint_port.Eval(context), 2)
        drives = np.append(self._base_port.Eval(context), self._force_port.Eval(context))
        output.SetFromVector(levers(self._arm, joints) * drives)
