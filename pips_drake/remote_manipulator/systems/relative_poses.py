"""What the program measures of the modelled hardware."""

from __future__ import annotations

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from pips_drake.remote_manipulator.drives import ARM_JOINTS
from pips_drake.twin.systems.inputs import input_object, input_values


class RelativePoses(LeafSystem):
    """Poses of payload and CAE seen from the orbiter, and the arm vector.

    .. pydrake_system::

        name: RelativePoses
        input_ports:
        - body_poses
        - arm_state
        output_ports:
        - payload_pose
        - cae_pose
        - arm_measured

    Input ports:

    - `body_poses`: abstract list of `RigidTransform` X_WB, from the plant.
    - `arm_state`, (16,): the arm's joint positions (m, 6 rad, m) and rates, from the plant.

    Output ports, all with feedthrough, computed when somebody asks:

    - `payload_pose`, (7,): X_RP: quaternion w x y z with w >= 0, then position, m.
    - `cae_pose`, (7,): X_RC, likewise.
    - `arm_measured`, (8,): the arm vector: m, 6 rad, m.

    State: none.

    Args:
        orbiter_index, payload_index, cae_index: of the bodies, in the plant.
    """

    def __init__(self, *, orbiter_index: int, payload_index: int, cae_index: int) -> None:
        super().__init__()
        self._orbiter = int(orbiter_index)
        poses_port = self.DeclareAbstractInputPort(
            "body_poses", AbstractValue.Make([RigidTransform()])
        )
        state_port = self.DeclareVectorInputPort("arm_state", 2 * len(ARM_JOINTS))
        self._poses_index = int(poses_port.get_index())
        self._state_index = int(state_port.get_index())
        poses = {self.input_port_ticket(poses_port.get_index())}
        for name, body in (("payload_pose", payload_index), ("cae_pose", cae_index)):
            self.DeclareVectorOutputPort(
                name,
                7,
                lambda context, output, body=int(body): self._calc_pose(context, body, output),
                prerequisites_of_calc=poses,
            )
        self.DeclareVectorOutputPort(
            "arm_measured",
            len(ARM_JOINTS),
            self._calc_arm_measured,
            prerequisites_of_calc={self.input_port_ticket(state_port.get_index())},
        )

    def _calc_pose(self, context: Context, body: int, output: BasicVector) -> None:
        poses = input_object(self, context, self._poses_index)
        X_RB = poses[self._orbiter].inverse().multiply(poses[body])
        values = output.get_mutable_value()
        values[:4] = X_RB.rotation().ToQuaternion().wxyz()
        # One of the two quaternions of a rotation: recordings then have no jumps of sign but one.
        if values[0] < 0.0:
            np.negative(values[:4], out=values[:4])
        values[4:] = X_RB.translation()

    def _calc_arm_measured(self, context: Context, output: BasicVector) -> None:
        state = input_values(self, context, self._state_index)
        output.get_mutable_value()[:] = state[: len(ARM_JOINTS)]
