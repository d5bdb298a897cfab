"""What the actuators' servos make of a length command."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.drives import drive_limits

Array = NDArray[np.float64]


class ActuatorServo(LeafSystem):
    """Follows drive commands within stroke and speed: the set-point that the stiffness pulls to.

    .. pydrake_system::

        name: ActuatorServo
        input_ports:
        - drive_state
        - drive_offset
        output_ports:
        - setpoint
        - saturation

    Input ports:

    - `drive_state`, (2 J,): commanded drive coordinates (`drives.drive_columns`), m and rad, and
      their rates (not used: the set-point's own motion is what the speed limit acts on).
    - `drive_offset`, (J,): added to the command, m and rad; optional, zero when unconnected.

    Output ports, both from state (no feedthrough):

    - `setpoint`, (2 J,): drive coordinates as the servos have them at the end of the present
      period, m and rad, and their rates over it, m/s and rad/s.
    - `saturation`, (2,): how many drives stand at the end of their stroke, and how many at their
      speed limit.

    State, discrete, updated every `period` s (default 1/64 s) and at initialization: the outputs.
    Latency: a command is reached one period after the update that sees it.

    An update goes towards min(max(command + offset, stroke's ends)) by at most speed limit times
    period. The actuators' stiffness and force limit are the plant's (its controller gains and
    effort limits; fidelity `joint`).
    """

    def __init__(self, arm: SerpentineArm, *, period: float = 1.0 / 64.0) -> None:
        super().__init__()
        self._drives = arm.joints
        self._period = period
        self._lower, self._upper, self._speed, _ = drive_limits(arm)
        # The base's rail and crane have mechanical play beyond their limits, as the stroke has.
        first = arm.first_actuated_joint
        self._lower[:first] -= arm.base_overtravel
        self._upper[:first] += arm.base_overtravel
        self._command_port = self.DeclareVectorInputPort("drive_state", 2 * arm.joints)
        self._offset_port = self.DeclareVectorInputPort("drive_offset", arm.joints)
        setpoint = self.DeclareDiscreteState(2 * arm.joints)
        saturation = self.DeclareDiscreteState(2)
        self.DeclareStateOutputPort("setpoint", setpoint)
        self.DeclareStateOutputPort("saturation", saturation)
        self.DeclareInitializationDiscreteUpdateEvent(self._initialize)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _target(self, context: Context) -> Array:
        """Where the drives are sent, within the stroke."""
        command = self._command_port.Eval(context)[: self._drives]
        if self._offset_port.HasValue(context):
            command = command + self._offset_port.Eval(context)
        target: Array = np.clip(command, self._lower, self._upper)
        return target

    def _initialize(self, context: Context, values: DiscreteValues) -> None:
        start = np.append(self._target(context), np.zeros(self._drives))
        values.get_mutable_vector(0).SetFromVector(start)

    def _update(self, context: Context, values: DiscreteValues) -> None:
        target = self._target(context)
        before = context.get_discrete_state(0).CopyToVector()[: self._drives]
        reach = self._speed * self._period
        step = np.clip(target - before, -reach, reach)
        at_end = (target <= self._lower) | (target >= self._upper)
        too_fast = np.abs(target - before) > reach
        values.get_mutable_vector(0).SetFromVector(np.append(before + step, step / self._period))
        values.get_mutable_vector(1).SetFromVector([np.sum(at_end), np.sum(too_fast)])
