"""The dynamic collision program as a system: one frame of 20 Hz at a time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from pips_drake.remote_manipulator.analog_inputs import (
    CHANNELS,
    AngleScaling,
    angle_scaling,
    decode_frame,
)
from pips_drake.remote_manipulator.control_word import encode
from pips_drake.remote_manipulator.display import DISPLAY, attachment, display, flags
from pips_drake.remote_manipulator.operator_inputs import OperatorInputs
from pips_drake.remote_manipulator.output_block import BLOCK_WORDS, encode_block
from pips_drake.remote_manipulator.program import CollisionProgram as Program
from pips_drake.remote_manipulator.program import Frame, Measured
from pips_drake.remote_manipulator.program_state import (
    ANGLES,
    FRAME_PERIOD,
    GAP,
    ProgramState,
    pose_of,
)
from pips_drake.twin.systems.inputs import input_values

Array = NDArray[np.float64]


class CollisionProgram(LeafSystem):
    """Follows the master arm, finds collisions, inhibits motion and leads through the phases.

    .. pydrake_system::

        name: CollisionProgram
        input_ports:
        - channels
        - payload_pose
        - cae_pose
        - arm_measured
        output_ports:
        - setpoint
        - control_word
        - output_block
        - phase
        - flags
        - display
        - attachment

    Input ports:

    - `channels`, (17,): the operator's analog channels, V (RMS-71, Table I, and section VII's).
    - `payload_pose`, (7,): X_RP, quaternion w x y z and position m.
    - `cae_pose`, (7,): X_RC, the same.
    - `arm_measured`, (8,): height of the shoulder m, six angles rad, gap of the prong m; optional,
      where the arm was last sent when unconnected.

    Output ports, all from state (no feedthrough):

    - `setpoint`, (11,): where the slave arm and the scene go: as `arm_measured`, then the orbiter's
      translation along x, y, z of {R}, m.
    - `control_word`, (1,): the 24 bits of Table II, a whole number.
    - `output_block`, (32,): words of 24 bits for the scene program, whole numbers.
    - `phase`, (1,): number of the `phases.Phase`.
    - `flags`, (4,): collision flag of arm and of finger, motion inhibit flag of arm and of finger.
    - `display`, (19,): what the operator is shown; `display.DISPLAY` names it.
    - `attachment`, (3,): whether the effector holds the payload, what else does (number in
      `phases.SUPPORTS`), and how often everything has been put back to the beginning.

    State: discrete, updated every 0.05 s from 0 s on; the outputs, and the program's own
    (`program_state.ProgramState`). At initialization the outputs are those of the beginning, with
    collisions and measures of that time, and no frame passes.
    Latency: what comes in at a frame's time goes out right after it.

    The frame itself is `program.CollisionProgram.advance`.

    Args:
        program: the machine's and the scenario's.
        scaling: analog adjustments of the angles' channels; None: `angle_scaling` of the arm.

    Attributes:
        program: as given.
    """

    def __init__(self, program: Program, *, scaling: AngleScaling | None = None) -> None:
        super().__init__()
        self.program = program
        self._scaling = scaling or angle_scaling(program.config.arm)
        self._channels, self._payload, self._cae, self._arm = (
            int(self.DeclareVectorInputPort(name, size).get_index())
            for name, size in (
                ("channels", CHANNELS),
                ("payload_pose", 7),
                ("cae_pose", 7),
                ("arm_measured", GAP + 1),
            )
        )
        state = program.first_state()
        self._state = self.DeclareDiscreteState(state.vector())
        # Systems that are initialized at the same time see these, not what the initialization sets.
        self._outputs = [
            (name, self.DeclareDiscreteState(size))
            for name, size in (
                ("setpoint", state.sent),
                ("control_word", 1),
                ("output_block", BLOCK_WORDS),
                ("phase", [float(state.phase)]),
                ("flags", 4),
                ("display", len(DISPLAY)),
                ("attachment", attachment(state)),
            )
        ]
        for name, index in self._outputs:
            self.DeclareStateOutputPort(name, index)
        self.DeclareInitializationDiscreteUpdateEvent(self._update_first)
        self.DeclarePeriodicDiscreteUpdateEvent(FRAME_PERIOD, 0.0, self._update_frame)

    def held_pose(self, context: Context) -> Array:
        """Pose X_2P that the payload was given at acquisition, quaternion w x y z and m, (7,).

        Args:
            context: this system's own.
        """
        vector = context.get_discrete_state(self._state).value()
        return ProgramState.of_vector(vector).held

    def _inputs(self, context: Context) -> tuple[OperatorInputs, Measured]:
        channels = input_values(self, context, self._channels)
        payload = pose_of(input_values(self, context, self._payload))
        cae = pose_of(input_values(self, context, self._cae))
        arm = self.EvalVectorInput(context, self._arm)
        measured = Measured(payload, cae, None if arm is None else arm.value().copy())
        return decode_frame(channels, self._scaling), measured

    def _update_first(self, context: Context, values: DiscreteValues) -> None:
        state = ProgramState.of_vector(context.get_discrete_state(self._state).value())
        self._set(values, *self.program.first_frame(state, *self._inputs(context)))

    def _update_frame(self, context: Context, values: DiscreteValues) -> None:
        state = ProgramState.of_vector(context.get_discrete_state(self._state).value())
        self._set(values, *self.program.advance(state, *self._inputs(context)))

    def _set(self, values: DiscreteValues, state: ProgramState, frame: Frame) -> None:
        normals, distances = state.planes[:, :3], state.planes[:, 3]
        block = encode_block(frame.word, state.sent[ANGLES], normals, distances)
        outputs = {
            "setpoint": state.sent,
            "control_word": [encode(frame.word)],
            "output_block": block,
            "phase": [state.phase],
            "flags": flags(state),
            "display": display(state, frame),
            "attachment": attachment(state),
        }
        values.set_value(self._state, state.vector())
        for name, index in self._outputs:
            values.set_value(index, outputs[name])
