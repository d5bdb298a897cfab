"""From actuator lengths to hinge angles: the inverse of `ActuatorLengthMap`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from pips_drake.errors import InputError
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.drives import drive_columns, write_joint_state
from pips_drake.twin.systems.inputs import input_values

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
        self._columns = drive_columns(arm)
        self._triangles = arm.linkage.triangles
        self._period = 0.0 if period is None else period
        drive_port = self.DeclareVectorInputPort("drive_state", 2 * arm.joints)
        self._drive_index = int(drive_port.get_index())
        self.DeclareVectorOutputPort("joint_state", 2 * arm.joints, self._calc_joint_state)

    def _calc_joint_state(self, context: Context, output: BasicVector) -> None:
        drive_state = input_values(self, context, self._drive_index)
        joint_state = output.get_mutable_value()
        write_joint_state(self._triangles, self._period, drive_state, joint_state)
        if not math.isfinite(joint_state.sum()):
            self._refuse(drive_state, joint_state)

    def _refuse(self, drive_state: Array, joint_state: Array) -> None:
        """Raises an error that names the first drive with which no triangle closes, if any."""
        drives, rates = np.split(drive_state, 2)
        joints, joint_rates = np.split(joint_state, 2)
        before = drives - rates * self._period
        for wrong, lengths in ((~np.isfinite(joints), drives), (~np.isfinite(joint_rates), before)):
            if wrong.any():
                worst = int(np.flatnonzero(wrong)[0])
                raise InputError(
                    f"{self._columns[worst]} = {lengths[worst]:.4f}; must be a length with which "
                    "the actuator and its two anchors close a triangle"
                )
