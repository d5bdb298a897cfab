"""An operator at a browser's page as a system."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from pips_drake.remote_manipulator.analog_inputs import angle_scaling, decode_frame, encode_frame
from pips_drake.remote_manipulator.configuration import STATIONS
from pips_drake.remote_manipulator.meshcat_controls import MeshcatControls
from pips_drake.remote_manipulator.operator_inputs import OperatorInputs
from pips_drake.remote_manipulator.phases import TABLE, Phase
from pips_drake.remote_manipulator.program_state import FRAME_PERIOD, GAP
from pips_drake.twin.systems.inputs import input_values


class MeshcatOperator(LeafSystem):
    """Gives what a person wants who works with sliders, keys or a gamepad in Meshcat's page.

    The keys are listed in `meshcat_controls.MeshcatControls`.

    .. pydrake_system::

        name: MeshcatOperator
        input_ports:
        - phase
        - arm_measured
        output_ports:
        - channels

    Input ports:

    - `phase`, (1,): number of the `phases.Phase`.
    - `arm_measured`, (8,): height of the shoulder m, six angles rad, gap of the prong m.

    Output port:

    - `channels`, (17,): the operator's analog channels, V, from state (no feedthrough).

    State: discrete, updated every 0.05 s: the channels. What sliders and buttons were at last is in
    the page's own hands, so that a run with a person cannot be repeated but by its recording.
    Latency: what is pressed in a frame is acted on in the next.

    Args:
        controls: in the page.
        angles: of the master arm at first, (6,) rad.
        station: camera station at first, a number.
    """

    def __init__(self, controls: MeshcatControls, *, angles: ArrayLike, station: int = 0) -> None:
        super().__init__()
        self._controls = controls
        self._scaling = angle_scaling(controls.config.arm)
        self._phase, self._arm = (
            int(self.DeclareVectorInputPort(name, size).get_index())
            for name, size in (("phase", 1), ("arm_measured", GAP + 1))
        )
        still = OperatorInputs(angles=np.array(angles, dtype=np.float64), station=STATIONS[station])
        self._channels = self.DeclareDiscreteState(encode_frame(still, self._scaling))
        self.DeclareStateOutputPort("channels", self._channels)
        self.DeclarePeriodicDiscreteUpdateEvent(FRAME_PERIOD, 0.0, self._update)

    def _update(self, context: Context, values: DiscreteValues) -> None:
        volts = context.get_discrete_state(self._channels).value()
        phase = Phase(round(float(input_values(self, context, self._phase)[0])))
        inputs = self._controls.read(
            decode_frame(volts, self._scaling).angles,
            input_values(self, context, self._arm),
            grasped=TABLE[phase].grasped,
        )
        values.set_value(self._channels, encode_frame(inputs, self._scaling))
