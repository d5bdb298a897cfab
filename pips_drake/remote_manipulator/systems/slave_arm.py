"""The slave arm's servo: from the program's set-points at 20 Hz to what the drives are sent to."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from pips_drake.errors import InputError
from pips_drake.remote_manipulator.configuration import RemoteManipulatorConfig
from pips_drake.remote_manipulator.drives import ARM_JOINTS, make_drives
from pips_drake.twin.systems.inputs import input_values

Array = NDArray[np.float64]

ARM, OFFSET = len(ARM_JOINTS), 3


class SlaveArm(LeafSystem):
    """Goes from one set-point to the next in a frame, within the joints' rates.

    .. pydrake_system::

        name: SlaveArm
        input_ports:
        - setpoint
        output_ports:
        - arm_desired_state
        - orbiter_desired_state

    Input port:

    - `setpoint`, (11,): the arm vector (m, 6 rad, m), then the orbiter's offset in {R}, m.

    Output ports, both from state (no feedthrough):

    - `arm_desired_state`, (16,): arm vector at the end of the present control period, and its
      rates.
    - `orbiter_desired_state`, (6,): the orbiter's offset then, m, and its velocity, m/s.

    State, discrete, updated every `period` s and at initialization: the outputs; where the frame's
    straight way is and its rates, (22,); how many updates of the frame are left, (1,).

    Every frame, one update after the program has written its set-point, takes rates that reach it
    in a frame, within the limits; without a limit on acceleration they are taken at once. Latency:
    a set-point is reached one frame and one period after it is written, by a straight way in the
    arm vector.

    With accelerations, every update changes the rates by no more than they allow, towards the
    frame's rates and what is left of the way: v = v_frame + sign(e) sqrt(2 a |e|), with e what is
    missing to where the frame would be without that limit.

    Args:
        config: for the limits of rate.
        frame: of the program, s.
        period: s, a whole part of the frame.
        accelerations: limits, (11,) m/s^2 and rad/s^2; None: none.
        start: where the drives are sent first, (11,); None: what `setpoint` says before anything is
            initialized, which is not what its system makes of its own initialization.
    """

    def __init__(
        self,
        config: RemoteManipulatorConfig,
        *,
        frame: float = 0.05,
        period: float = 0.01,
        accelerations: ArrayLike | None = None,
        start: ArrayLike | None = None,
    ) -> None:
        super().__init__()
        self._updates = round(frame / period)
        if abs(self._updates * period - frame) > 1e-9:
            raise InputError(f"period = {period:g} s; must be a whole part of {frame:g} s")
        self._period, self._frame = period, frame
        self._rate = np.concatenate(
            [make_drives(config).rate, np.full(OFFSET, config.orbiter.rate_m_s)]
        )
        self._acceleration = None
        if accelerations is not None:
            self._acceleration = np.array(accelerations, dtype=np.float64)
            if self._acceleration.shape != (ARM + OFFSET,) or not np.all(self._acceleration > 0.0):
                raise InputError(f"accelerations must be {ARM + OFFSET} positive numbers")
        self._start = None if start is None else np.array(start, dtype=np.float64)
        if self._start is not None and self._start.shape != (ARM + OFFSET,):
            raise InputError(f"start of shape {self._start.shape}; must be ({ARM + OFFSET},)")
        port = self.DeclareVectorInputPort("setpoint", ARM + OFFSET)
        self._setpoint_index = int(port.get_index())
        self._arm = self.DeclareDiscreteState(2 * ARM)
        self._orbiter = self.DeclareDiscreteState(2 * OFFSET)
        self._way = self.DeclareDiscreteState(2 * (ARM + OFFSET))
        self._left = self.DeclareDiscreteState(1)
        self.DeclareStateOutputPort("arm_desired_state", self._arm)
        self.DeclareStateOutputPort("orbiter_desired_state", self._orbiter)
        self.DeclareInitializationDiscreteUpdateEvent(self._initialize)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def place(self, context: Context, setpoint: ArrayLike) -> None:
        """Sends the drives to a set-point (11,) at once, at rest: for a reset between two steps.

        Args:
            context: this system's own.
        """
        self._place(context.get_mutable_discrete_state(), np.asarray(setpoint, dtype=np.float64))

    def _place(self, values: DiscreteValues, setpoint: Array) -> None:
        arm = values.get_mutable_vector(self._arm).get_mutable_value()
        orbiter = values.get_mutable_vector(self._orbiter).get_mutable_value()
        way = values.get_mutable_vector(self._way).get_mutable_value()
        arm[:ARM], arm[ARM:] = setpoint[:ARM], 0.0
        orbiter[:OFFSET], orbiter[OFFSET:] = setpoint[ARM:], 0.0
        way[: setpoint.size], way[setpoint.size :] = setpoint, 0.0

    def _initialize(self, context: Context, values: DiscreteValues) -> None:
        start = self._start
        self._place(
            values,
            input_values(self, context, self._setpoint_index) if start is None else start,
        )
        # The first frame begins one update after the program's.
        values.get_mutable_vector(self._left).get_mutable_value()[0] = 1.0

    def _update(self, context: Context, values: DiscreteValues) -> None:
        # They hold the present values.
        way = values.get_mutable_vector(self._way).get_mutable_value()
        left = values.get_mutable_vector(self._left).get_mutable_value()
        count = ARM + OFFSET
        if left[0] < 0.5:
            missing = input_values(self, context, self._setpoint_index) - way[:count]
            way[count:] = np.clip(missing / self._frame, -self._rate, self._rate)
            left[0] = self._updates
        left[0] -= 1.0
        way[:count] += way[count:] * self._period
        arm = values.get_mutable_vector(self._arm).get_mutable_value()
        orbiter = values.get_mutable_vector(self._orbiter).get_mutable_value()
        if self._acceleration is None:
            arm[:ARM], arm[ARM:] = way[:ARM], way[count : count + ARM]
            orbiter[:OFFSET], orbiter[OFFSET:] = way[ARM:count], way[count + ARM :]
            return
        position = np.concatenate([arm[:ARM], orbiter[:OFFSET]])
        rate = np.concatenate([arm[ARM:], orbiter[OFFSET:]])
        step = self._acceleration * self._period
        missing = way[:count] - position - rate * self._period
        # As fast as it can still brake from; what is left in one update is taken as it is.
        closing = np.minimum(
            np.sqrt(2.0 * self._acceleration * np.abs(missing)), np.abs(missing) / self._period
        )
        wanted = np.clip(way[count:] + np.sign(missing) * closing, -self._rate, self._rate)
        rate += np.clip(wanted - rate, -step, step)
        position += rate * self._period
        arm[:ARM], arm[ARM:] = position[:ARM], rate[:ARM]
        orbiter[:OFFSET], orbiter[OFFSET:] = position[ARM:], rate[ARM:]
