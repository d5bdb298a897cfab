"""The operator at random as a system: what a station survives when anybody is at its desk."""

from __future__ import annotations

from numpy.typing import ArrayLike
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from pips_drake.remote_manipulator.analog_inputs import angle_scaling, encode_frame
from pips_drake.remote_manipulator.program_state import FRAME_PERIOD
from pips_drake.remote_manipulator.random_operator import RandomOperator as Hand
from pips_drake.remote_manipulator.random_operator import RandomState
from pips_drake.remote_manipulator.systems.seen import declare_seen_ports, read_seen


class RandomOperator(LeafSystem):
    """Works the desk at random, the same way with the same seed.

    .. pydrake_system::

        name: RandomOperator
        input_ports:
        - phase
        - arm_measured
        - payload_pose
        - cae_pose
        output_ports:
        - channels

    Input ports:

    - `phase`, (1,): number of the `phases.Phase`.
    - `arm_measured`, (8,): height of the shoulder m, six angles rad, gap of the prong m.
    - `payload_pose`, (7,): X_RP, quaternion w x y z and position m.
    - `cae_pose`, (7,): X_RC, the same way.

    Output port:

    - `channels`, (17,): the operator's analog channels, V, from state (no feedthrough).

    State: discrete, updated every 0.05 s: `random_operator.RandomState`, and the channels. Latency:
    what is seen in a frame is acted on in the next.

    Args:
        hand: the operator.
        angles: of the master arm at first, (6,) rad.
    """

    def __init__(self, hand: Hand, *, angles: ArrayLike) -> None:
        super().__init__()
        self._hand = hand
        self._scaling = angle_scaling(hand.config.arm)
        self._ports = declare_seen_ports(self)
        first = hand.first_state(angles)
        self._state = self.DeclareDiscreteState(first.vector())
        self._channels = self.DeclareDiscreteState(encode_frame(hand.inputs(first), self._scaling))
        self.DeclareStateOutputPort("channels", self._channels)
        self.DeclarePeriodicDiscreteUpdateEvent(FRAME_PERIOD, 0.0, self._update)

    def _update(self, context: Context, values: DiscreteValues) -> None:
        seen = read_seen(self, context, self._ports)
        state = RandomState.of_vector(context.get_discrete_state(self._state).value())
        state, inputs = self._hand.advance(state, seen)
        values.set_value(self._state, state.vector())
        values.set_value(self._channels, encode_frame(inputs, self._scaling))
