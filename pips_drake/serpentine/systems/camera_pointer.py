"""Keeps the camera on its target while the arm follows its leader."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.math import RigidTransform
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from pips_drake.errors import InputError
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.pointing import (
    CameraMount,
    make_mount,
    pan_tilt_towards,
    step_pointing,
    target_before_last,
)
from pips_drake.twin.systems.inputs import input_values

Array = NDArray[np.float64]

#: How fast the last joint closes in on where it should be, 1/s: it trails a motion by half a
#: second, which the pan takes over.
_GAIN = 2.0


class CameraPointer(LeafSystem):
    """Points the camera at a target with the last joint, and with pan and tilt for the rest.

    .. pydrake_system::

        name: CameraPointer
        input_ports:
        - joint_state
        - target
        output_ports:
        - joint_state
        - pan_tilt

    Input ports:

    - `joint_state`, (2 J,): joint values, m and rad, and their rates, as follow-the-leader has
      them; the last joint's are not used but to start from.
    - `target`, (3,): in the world, m; optional if the system was given a target.

    Output ports:

    - `joint_state`, (2 J,): the input with another last joint and its rate; feedthrough for the
      others, from state for the last.
    - `pan_tilt`, (2,): of the camera, rad, from state.

    State, discrete, updated every `period` s (default 1/64 s) and at initialization: last joint,
    rad; its rate over the period that ends, rad/s; pan and tilt, rad.

    An update goes towards `pointing.joint_towards` by rate = gain times what is missing, within the
    mount's speed and an acceleration of gain times that speed, so that it comes to rest without
    overshoot. Pan and tilt go where the camera then looks at the target, within their speed: what
    the joint lags behind, they take over. The aim is that of the commanded joints; latency one
    period.

    Args:
        arm: the arm.
        mount: its camera; `pointing.make_mount(arm)` by default.
        target: in the world, (3,) m, while the port is unconnected.
        X_W0: pose of the arm's frame {0} in the world; the identity by default.
        period: s.
    """

    def __init__(
        self,
        arm: SerpentineArm,
        *,
        mount: CameraMount | None = None,
        target: ArrayLike | None = None,
        X_W0: RigidTransform | None = None,
        period: float = 1.0 / 64.0,
    ) -> None:
        super().__init__()
        self._arm = arm
        self._mount = mount or make_mount(arm)
        self._X_0W = (X_W0 or RigidTransform()).inverse()
        self._period = period
        self._chain, self._mirror = arm.dh_table[:-1], arm.mirror
        self._fixed_target: Array | None = None
        if target is not None:
            point = np.asarray(target, dtype=np.float64)
            if point.shape != (3,) or not np.all(np.isfinite(point)):
                raise InputError(f"camera target = {point}; must be three finite numbers, m")
            self._fixed_target = self._X_0W @ point
        joint_port = self.DeclareVectorInputPort("joint_state", 2 * arm.joints)
        self._joint_index = int(joint_port.get_index())
        self._target_index = int(self.DeclareVectorInputPort("target", 3).get_index())
        self._state = self.DeclareDiscreteState(4)
        self.DeclareVectorOutputPort(
            "joint_state",
            2 * arm.joints,
            self._calc_joint_state,
            prerequisites_of_calc={
                self.input_port_ticket(joint_port.get_index()),
                self.discrete_state_ticket(self._state),
            },
        )
        self.DeclareVectorOutputPort(
            "pan_tilt",
            2,
            self._calc_pan_tilt,
            prerequisites_of_calc={self.discrete_state_ticket(self._state)},
        )
        self.DeclareInitializationDiscreteUpdateEvent(self._initialize)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _target_in_0(self, context: Context) -> Array:
        """The target in frame {0}, (3,) m."""
        target = self.EvalVectorInput(context, self._target_index)
        if target is not None:
            moved: Array = self._X_0W.multiply(target.value())
            return moved
        if self._fixed_target is None:
            raise InputError("CameraPointer has no target; connect its port or give it one")
        return self._fixed_target

    def _initialize(self, context: Context, values: DiscreteValues) -> None:
        joints = input_values(self, context, self._joint_index)[: self._arm.joints]
        local = target_before_last(self._arm, joints, self._target_in_0(context))
        joint = float(joints[-1])
        pan, tilt = pan_tilt_towards(self._arm, self._mount, local, joint)
        values.get_mutable_vector(self._state).SetFromVector([joint, 0.0, pan, tilt])

    def _update(self, context: Context, values: DiscreteValues) -> None:
        step_pointing(
            self._chain,
            self._mirror,
            self._mount.numbers,
            _GAIN,
            self._period,
            input_values(self, context, self._joint_index),
            self._target_in_0(context),
            # It holds the present values.
            values.get_mutable_vector(self._state).get_mutable_value(),
        )

    def _calc_joint_state(self, context: Context, output: BasicVector) -> None:
        joint_state = output.get_mutable_value()
        joint_state[:] = input_values(self, context, self._joint_index)
        joint, rate = context.get_discrete_state(self._state).value()[:2]
        joint_state[self._arm.joints - 1], joint_state[-1] = joint, rate

    def _calc_pan_tilt(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(context.get_discrete_state(self._state).value()[2:])
