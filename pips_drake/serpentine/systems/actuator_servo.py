"""What the actuators' servos make of a length command."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.drives import cut_to_stroke, drive_limits, step_servos
from pips_drake.serpentine.faults import (
    Fault,
    limits_with_faults,
    misses_update,
    override_setpoints,
)
from pips_drake.twin.systems.inputs import input_values

Array = NDArray[np.float64]


class ActuatorServo(LeafSystem):
    """Follows drive commands within stroke and speed: the set-point that the stiffness pulls to.

    .. pydrake_system::

        name: ActuatorServo
        input_ports:
        - drive_state
        - drive_offset
        - brake
        output_ports:
        - setpoint
        - saturation

    Input ports:

    - `drive_state`, (2 J,): commanded drive coordinates (`drives.drive_columns`), m and rad, and
      their rates (not used: the set-point's own motion is what the speed limit acts on).
    - `drive_offset`, (J,): added to the command, m and rad; optional, zero when unconnected.
    - `brake`, (1,): 0 lets the drives go; any other number sets their brakes; optional, let go when
      unconnected.

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

    A fault changes the limits, or the set-point of its drive, from the first update at its start.
    In an update that is missed all drives stand.

    Brakes act from the first update that sees them: every set-point stands where it is then,
    whatever its command or its fault. Latency: the set-point of that update, at most one period
    after the brake is set, is the last. They need no power, and so no servo's clock. What a spring
    or a force limit between drive and joint lets the arm do is not theirs to hold.

    Args:
        arm: whose drives they are.
        faults: of the drives (`faults.make_drive_faults`).
    """

    def __init__(
        self, arm: SerpentineArm, *, faults: Sequence[Fault] = (), period: float = 1.0 / 64.0
    ) -> None:
        super().__init__()
        self._faults = tuple(faults)
        self._period = period
        self._lower, self._upper, self._speed, _ = drive_limits(arm)
        # The base's rail and crane have mechanical play beyond their limits, as the stroke has.
        first = arm.first_actuated_joint
        self._lower[:first] -= arm.base_overtravel
        self._upper[:first] += arm.base_overtravel
        self._no_offset = np.zeros(arm.joints)
        command_port = self.DeclareVectorInputPort("drive_state", 2 * arm.joints)
        offset_port = self.DeclareVectorInputPort("drive_offset", arm.joints)
        brake_port = self.DeclareVectorInputPort("brake", 1)
        self._brake_index = int(brake_port.get_index())
        self._command_index = int(command_port.get_index())
        self._offset_index = int(offset_port.get_index())
        self._setpoint = self.DeclareDiscreteState(2 * arm.joints)
        self._saturation = self.DeclareDiscreteState(2)
        self.DeclareStateOutputPort("setpoint", self._setpoint)
        self.DeclareStateOutputPort("saturation", self._saturation)
        self.DeclareInitializationDiscreteUpdateEvent(self._initialize)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _wanted(self, context: Context) -> tuple[Array, Array]:
        """Command and offset, (at least J,) each."""
        offset = self.EvalVectorInput(context, self._offset_index)
        return (
            input_values(self, context, self._command_index),
            self._no_offset if offset is None else offset.value(),
        )

    def _initialize(self, context: Context, values: DiscreteValues) -> None:
        setpoint = values.get_mutable_vector(self._setpoint).get_mutable_value()
        setpoint[:] = 0.0
        cut_to_stroke(
            self._lower, self._upper, *self._wanted(context), setpoint[: self._lower.size]
        )

    def _update(self, context: Context, values: DiscreteValues) -> None:
        # It holds the present values.
        setpoint = values.get_mutable_vector(self._setpoint).get_mutable_value()
        saturation = values.get_mutable_vector(self._saturation).get_mutable_value()
        brake = self.EvalVectorInput(context, self._brake_index)
        # Written so that a NaN brakes.
        if brake is not None and brake[0] != 0.0:
            setpoint[self._lower.size :] = saturation[:] = 0.0
            return
        limits = self._lower, self._upper, self._speed
        if not self._faults:
            step_servos(*limits, self._period, *self._wanted(context), setpoint, saturation)
            return
        time, before = context.get_time(), setpoint[: self._lower.size].copy()
        if misses_update(self._faults, time, self._period):
            setpoint[before.size :] = 0.0
        else:
            left = limits_with_faults(self._faults, time, *limits)
            step_servos(*left, self._period, *self._wanted(context), setpoint, saturation)
        override_setpoints(self._faults, time, self._period, limits, before, setpoint)
