"""The operator who did all this before: a recording as a system."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from pips_drake.remote_manipulator.analog_inputs import AngleScaling, encode_channels, encode_frame
from pips_drake.remote_manipulator.operator_recording import OperatorRecording
from pips_drake.remote_manipulator.program_state import FRAME_PERIOD

#: A row counts for the frame that it is so near to, s: written times are rounded.
_SAME_TIME = 1e-6


class RecordedOperator(LeafSystem):
    """Does again what a recording says; after its last row, nothing changes any more.

    .. pydrake_system::

        name: RecordedOperator
        output_ports:
        - channels
        - finished

    Output ports, both from state (no feedthrough):

    - `channels`, (17,): the operator's analog channels, V: at every frame, what the recording has
      at that time.
    - `finished`, (1,): 1 from the time of the recording's last row on.

    State: discrete, updated every 0.05 s: the channels, and the frame's number.

    Args:
        recording: from time 0.
        scaling: what volts mean.

    Raises:
        InputError: an angle of the recording is beyond full scale.
    """

    def __init__(self, recording: OperatorRecording, scaling: AngleScaling) -> None:
        super().__init__()
        encode_channels(recording.frames, scaling)  # refuses what could not be said later
        self._recording, self._scaling = recording, scaling
        self._channels = self.DeclareDiscreteState(encode_frame(recording.at(0.0), scaling))
        self._frame = self.DeclareDiscreteState([0.0])
        self.DeclareStateOutputPort("channels", self._channels)
        self.DeclareVectorOutputPort(
            "finished",
            1,
            self._calc_finished,
            prerequisites_of_calc={self.discrete_state_ticket(self._frame)},
        )
        self.DeclarePeriodicDiscreteUpdateEvent(FRAME_PERIOD, 0.0, self._update)

    def _update(self, context: Context, values: DiscreteValues) -> None:
        # The frame that begins when this one is over.
        frame = round(context.get_time() / FRAME_PERIOD) + 1
        time, times = frame * FRAME_PERIOD, self._recording.times
        row = int(np.searchsorted(times, time - _SAME_TIME))
        if row < len(times) and times[row] <= time + _SAME_TIME:
            time = float(times[row])
        values.set_value(self._channels, encode_frame(self._recording.at(time), self._scaling))
        values.set_value(self._frame, [float(frame)])

    def _calc_finished(self, context: Context, output: BasicVector) -> None:
        frame = float(context.get_discrete_state(self._frame).value()[0])
        over = frame * FRAME_PERIOD >= self._recording.duration - _SAME_TIME
        output.SetAtIndex(0, float(over))
