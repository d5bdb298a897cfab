"""From actuator lengths to hinge angles: the inverse of `ActuatorLengthMap`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from pips_drake.errors import InputError
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.drives import drive_columns, joints_from_drives, levers

Array = NDArray[np.float64]


class ActuatorAngleMap(LeafSystem):
    """Drive lengths and rates to the joint state that they hold.

    .. pydrake_system::

        name: ActuatorAngleMap
        input_ports:
        - drive_state
        output_ports:
        - joint_state

    Input port:

    - `drive_state`, (2 J,): drive coordinates (`drives.drive_columns`), m and rad, and their rates.

    Output port, with feedthrough:

    - `joint_state`, (2 J,): joint values, m and rad, and their rates, m/s and rad/s: what a plant's
      `desired_state` port takes.

    State: none. A length with which no triangle closes raises `InputError`.

    Args:
        arm: the arm.
        period: if given, the joint rates are the mean ones over the last `period` s of the lengths'
            motion at their rates. A sum of those meets the joint values exactly, which a
            derivative's does not.
    """

    def __init__(self, arm: SerpentineArm, *, period: float | None = None) -> None:
        super().__init__()
        self._arm = arm
        self._period = period
        self._drive_port = self.DeclareVectorInputPort("drive_state", 2 * arm.joints)
        self.DeclareVectorOutputPort("joint_state", 2 * arm.joints, self._calc_joint_state)

    def _calc_joint_state(self, context: Context, output: BasicVector) -> None:
        drives, rates = np.split(self._drive_port.Eval(context), 2)
        q = self._joints(drives)
        if self._period is None:
            v = rates / levers(self._arm, q)
        else:
            v = (q - self._joints(drives - rates * self._period)) / self._period
        output.SetFromVector(np.concatenate([q, v]))

    def _joints(self, drives: Array) -> Array:
        q = joints_from_drives(self._arm, drives)
        if not np.all(np.isfinite(q)):
            worst = int(np.flatnonzero(~np.isfinite(q))[0])
            raise InputError(
                f"{drive_columns(self._arm)[worst]} = {drives[worst]:.4f}; must be a length with "
                "which the actuator and its two anchors close a triangle"
            )
        return q
