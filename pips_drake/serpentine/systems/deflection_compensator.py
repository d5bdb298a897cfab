"""How much farther the drives are sent so that gravity's sag brings the arm where it is wanted."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from pips_drake.errors import InputError
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.drives import deflection_offset
from pips_drake.serpentine.statics import holding_efforts


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
      its stiffness, as a length of its drive.

    State: none.

    Args:
        arm: the arm.
        gravity: in frame {0}, (3,) m/s^2.
    """

    def __init__(self, arm: SerpentineArm, *, gravity: ArrayLike) -> None:
        super().__init__()
        self._arm = arm
        self._gravity = np.asarray(gravity, dtype=np.float64)
        if self._gravity.shape != (3,) or not np.all(np.isfinite(self._gravity)):
            raise InputError(f"gravity = {self._gravity}; must be three finite numbers, m/s^2")
        self._joint_port = self.DeclareVectorInputPort("joint_state", 2 * arm.joints)
        self.DeclareVectorOutputPort("drive_offset", arm.joints, self._calc_drive_offset)

    def _calc_drive_offset(self, context: Context, output: BasicVector) -> None:
        q, _ = np.split(self._joint_port.Eval(context), 2)
        efforts = holding_efforts(self._arm, q, self._gravity)[0]
        output.SetFromVector(deflection_offset(self._arm, q, efforts))
