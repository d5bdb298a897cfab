"""The autopilot as a system: an operator that works through a script."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from pips_drake.remote_manipulator.analog_inputs import angle_scaling, encode_frame
from pips_drake.remote_manipulator.autopilot import Autopilot as Pilot
from pips_drake.remote_manipulator.autopilot import AutopilotState
from pips_drake.remote_manipulator.operator_inputs import OperatorInputs
from pips_drake.remote_manipulator.program_state import FRAME_PERIOD
from pips_drake.remote_manipulator.systems.seen import declare_seen_ports, read_seen

Array = NDArray[np.float64]


class Autopilot(LeafSystem):
    """Does what a script says, and waits for what it must see first.

    .. pydrake_system::

        name: Autopilot
        input_ports:
        - phase
        - arm_measured
        - payload_pose
        - cae_pose
        output_ports:
        - channels
        - step
        - finished

    Input ports:

    - `phase`, (1,): number of the `phases.Phase`.
    - `arm_measured`, (8,): height of the shoulder m, six angles rad, gap of the prong m.
    - `payload_pose`, (7,): X_RP, quaternion w x y z and position m.
    - `cae_pose`, (7,): X_RC, the same way.

    Output ports, all from state (no feedthrough):

    - `channels`, (17,): the operator's analog channels, V.
    - `step`, (1,): number of the script's step, from 0.
    - `finished`, (1,): 1 when all steps are done.

    State: discrete, updated every 0.05 s: `autopilot.AutopilotState`, and the channels. Latency:
    what is seen in a frame is acted on in the next.

    Args:
        pilot: the script and the machine.
        angles: of the master arm at first, (6,) rad.
    """

    def __init__(self, pilot: Pilot, *, angles: ArrayLike) -> None:
        super().__init__()
        self._pilot = pilot
        self._scaling = angle_scaling(pilot.config.arm)
        self._ports = declare_seen_ports(self)
        first = pilot.first_state(angles)
        self._state = self.DeclareDiscreteState(first.vector())
        still = OperatorInputs(angles=first.angles, station=pilot.station)
        self._channels = self.DeclareDiscreteState(encode_frame(still, self._scaling))
        self.DeclareStateOutputPort("channels", self._channels)
        from_state = {self.discrete_state_ticket(self._state)}
        for name, calc in (("step", self._calc_step), ("finished", self._calc_finished)):
            self.DeclareVectorOutputPort(name, 1, calc, prerequisites_of_calc=from_state)
        self.DeclarePeriodicDiscreteUpdateEvent(FRAME_PERIOD, 0.0, self._update)

    def _read(self, context: Context) -> AutopilotState:
        return AutopilotState.of_vector(context.get_discrete_state(self._state).value())

    def _update(self, context: Context, values: DiscreteValues) -> None:
        seen = read_seen(self, context, self._ports)
        state, inputs = self._pilot.advance(self._read(context), seen)
        values.set_value(self._state, state.vector())
        values.set_value(self._channels, encode_frame(inputs, self._scaling))

    def _calc_step(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, float(self._read(context).step))

    def _calc_finished(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, float(self._pilot.finished(self._read(context))))
