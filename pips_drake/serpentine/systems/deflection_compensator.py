"""How much farther the drives are sent so that gravity's sag brings the arm where it is wanted."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from pips_drake.errors import InputError
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.statics import (
    deflection_terms,
    leg_deflection_terms,
    write_deflection_offset,
    write_leg_deflection_offset,
)
from pips_drake.twin.systems.inputs import input_values


class DeflectionCompensator(LeafSystem):
    """The drives' offsets that cancel the static deflection of a wanted posture.

    .. pydrake_system::

        name: DeflectionCompensator
        input_ports:
        - joint_state
        output_ports:
        - drive_offset

    Input port:

    - `joint_state`, (2 J,): wanted joint values, m and rad, and their rates (not used).

    Output port, with feedthrough:

    - `drive_offset`, (J,): `drives.drive_columns`, m and rad: what statics asks of each joint, over
      its stiffness, as a length of its drive (`along_legs`: of each actuator, over its own).

    State: none.

    Args:
        arm: the arm.
        gravity: in frame {0}, (3,) m/s^2.
        along_legs: the actuators are the springs (fidelities `leg` and `truss`), so that a joint's
            stiffness follows the posture; else the joints are, with the stiffness that they have
            where the hinge is straight (fidelity `joint`).
    """

    def __init__(self, arm: SerpentineArm, *, gravity: ArrayLike, along_legs: bool = False) -> None:
        super().__init__()
        vector = np.asarray(gravity, dtype=np.float64)
        if vector.shape != (3,) or not np.all(np.isfinite(vector)):
            raise InputError(f"gravity = {vector}; must be three finite numbers, m/s^2")
        self._along_legs = along_legs
        make_terms = leg_deflection_terms if along_legs else deflection_terms
        self._terms = make_terms(arm, vector)
        joint_port = self.DeclareVectorInputPort("joint_state", 2 * arm.joints)
        self._joint_index = int(joint_port.get_index())
        self.DeclareVectorOutputPort("drive_offset", arm.joints, self._calc_drive_offset)

    def _calc_drive_offset(self, context: Context, output: BasicVector) -> None:
        joints = input_values(self, context, self._joint_index)
        write = write_leg_deflection_offset if self._along_legs else write_deflection_offset
        write(*self._terms, joints, output.get_mutable_value())
