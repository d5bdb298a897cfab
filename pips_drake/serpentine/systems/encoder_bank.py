"""What the joints' encoders read."""

from __future__ import annotations

from collections.abc import Sequence

from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.faults import Fault, read_encoders
from pips_drake.twin.systems.inputs import input_values


class EncoderBank(LeafSystem):
    """Joint values as encoders with faults read them.

    .. pydrake_system::

        name: EncoderBank
        input_ports:
        - joint_state
        output_ports:
        - reading
        - health

    Input port:

    - `joint_state`, (2 J,): where the joints are, m and rad, and their rates, m/s and rad/s.

    Output ports, both from state (no feedthrough):

    - `reading`, (2 J,): the same as the encoders have it; rates of a dead or stuck one are zero.
    - `health`, (J,): 1 for an encoder that says it can be trusted, 0 for a dead one. A stuck,
      biased or quantised one does not know of its fault.

    State, discrete, updated every `period` s (default 1/64 s) and at initialization: the outputs.
    Latency: a period at most. Without faults the readings are the sampled input, exactly.

    In the station the supervisor reads them: its tracking error is that of the readings. The
    servos' loops do not close on them (the drives' stiffness is the plant's), so that a fault of an
    encoder alone moves nothing.

    Args:
        arm: whose joints they are.
        faults: of the encoders (`faults.make_encoder_faults`).
    """

    def __init__(
        self, arm: SerpentineArm, *, faults: Sequence[Fault] = (), period: float = 1.0 / 64.0
    ) -> None:
        super().__init__()
        self._faults = tuple(faults)
        port = self.DeclareVectorInputPort("joint_state", 2 * arm.joints)
        self._joint_index = int(port.get_index())
        self._reading = self.DeclareDiscreteState(2 * arm.joints)
        self._health = self.DeclareDiscreteState([1.0] * arm.joints)
        self.DeclareStateOutputPort("reading", self._reading)
        self.DeclareStateOutputPort("health", self._health)
        self.DeclareInitializationDiscreteUpdateEvent(self._initialize)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _initialize(self, context: Context, values: DiscreteValues) -> None:
        # What is stuck from the beginning is stuck where the arm then is.
        values.set_value(self._reading, input_values(self, context, self._joint_index))

    def _update(self, context: Context, values: DiscreteValues) -> None:
        reading, health = read_encoders(
            self._faults,
            context.get_time(),
            context.get_discrete_state(self._reading).value(),
            input_values(self, context, self._joint_index),
        )
        values.set_value(self._reading, reading)
        values.set_value(self._health, health)
