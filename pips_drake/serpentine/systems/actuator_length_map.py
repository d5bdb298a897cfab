"""From hinge angles to actuator lengths."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.drives import drives_from_joints, levers


class ActuatorLengthMap(LeafSystem):
    """Joint values and rates to drive lengths and rates (L3, L4, ...; the base's joints pass by).

    .. pydrake_system::

        name: ActuatorLengthMap
        input_ports:
        - joint_state
        output_ports:
        - drive_state

    Input port:

    - `joint_state`, (2 J,): joint values, m and rad, and their rates, m/s and rad/s.

    Output port, with feedthrough:

    - `drive_state`, (2 J,): drive coordinates (`drives.drive_columns`), m and rad, and their rates,
      L'(theta) times the joint's, m/s and rad/s.

    State: none.
    """

    def __init__(self, arm: SerpentineArm) -> None:
        super().__init__()
        self._arm = arm
        self._joint_port = self.DeclareVectorInputPort("joint_state", 2 * arm.joints)
        self.DeclareVectorOutputPort("drive_state", 2 * arm.joints, self._calc_drive_state)

    def _calc_drive_state(self, context: Context, output: BasicVector) -> None:
        q, v = np.split(self._joint_port.Eval(context), 2)
        drives = drives_from_joints(self._arm, q)
        output.SetFromVector(np.concatenate([drives, levers(self._arm, q) * v]))
