"""From hinge angles to actuator lengths."""

from __future__ import annotations

from pydrake.systems.framework import BasicVector, Context, LeafSystem

from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.drives import write_drive_state
from pips_drake.twin.systems.inputs import input_values


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
        self._triangles = arm.linkage.triangles
        joint_port = self.DeclareVectorInputPort("joint_state", 2 * arm.joints)
        self._joint_index = int(joint_port.get_index())
        self.DeclareVectorOutputPort("drive_state", 2 * arm.joints, self._calc_drive_state)

    def _calc_drive_state(self, context: Context, output: BasicVector) -> None:
        joint_state = input_values(self, context, self._joint_index)
        write_drive_state(self._triangles, joint_state, output.get_mutable_value())
