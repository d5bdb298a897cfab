"""From joint efforts to actuator forces."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.drives import drive_efforts


class ActuatorForceMap(LeafSystem):
    """Efforts at the joints to the forces that the drives make them with.

    .. pydrake_system::

        name: ActuatorForceMap
        input_ports:
        - joint_state
        - joint_effort
        output_ports:
        - drive_effort

    Input ports:

    - `joint_state`, (2 J,): joint values, m and rad, and their rates (not used).
    - `joint_effort`, (J,): N and Nm, such as a plant's `net_actuation`.

    Output port, with feedthrough:

    - `drive_effort`, (J,): `drives.effort_columns`, N and Nm. By virtual work F = tau / L'(theta);
      a pushing actuator is positive.

    State: none.
    """

    def __init__(self, arm: SerpentineArm) -> None:
        super().__init__()
        self._arm = arm
        self._joint_port = self.DeclareVectorInputPort("joint_state", 2 * arm.joints)
        self._effort_port = self.DeclareVectorInputPort("joint_effort", arm.joints)
        self.DeclareVectorOutputPort("drive_effort", arm.joints, self._calc_drive_effort)

    def _calc_drive_effort(self, context: Context, output: BasicVector) -> None:
        q, _ = np.split(self._joint_port.Eval(context), 2)
        output.SetFromVector(drive_efforts(self._arm, q, self._effort_port.Eval(context)))
