"""The dynamic collision program: one frame of 20 Hz (RMS-71, section IV).

The program follows the master arm with a command, and the scene (and the slave arm) follow the
command as long as it is free. Collisions, flags and phases are found for the command; acquisition
and docking look at what the hardware really does.

In collision: the first frame sets a collision flag only. The second successive one raises the
motion inhibit flag: the scene is given the last free command, and is held there until the collision
is relieved. In mode 1 a prong that collides by its own motion raises the finger's flag alone, and
only the prong is held; palm, finger, or a prong that the arm has moved into something raise the
arm's flag, and all is held. With a payload, both flags are raised.

How a collision is relieved: `literal`, as in the report, the command goes on after the master arm,
into the wall, and the scene waits until it is out again. `direction_aware`, the command starts in
every frame from where the scene is held: as soon as the master arm is on the free side of that
place, the step towards it is free and taken. If it is the world that has moved (the orbiter, a
flying payload), so that even the held pose collides, steps that do not lessen the separation are
let through.

What channel 1 (initialize) does, by channel 2: `full` and `mode_1`, everything is as at the
beginning: phase, arm, stand, prong, orbiter and, by the count of `resets`, what is modelled of the
hardware; a scenario begins in mode 1, so that both are the same. `mode_2_or_3`, with a payload that
is held: flags are cleared, and the command is back where the scene is; without one, as `mode_1`.
While channel 1 is on, nothing moves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.remote_manipulator.acquisition import Acquisition, AcquisitionTest, held_pose
from pips_drake.remote_manipulator.bodies import Placement
from pips_drake.remote_manipulator.configuration import RemoteManipulatorConfig
from pips_drake.remote_manipulator.control_word import ControlWord, control_word
from pips_drake.remote_manipulator.docking import Berthing, Docking, DockingTest, berthing
from pips_drake.remote_manipulator.inhibit import Hits, follow_up, hits_of
from pips_drake.remote_manipulator.limits_warnings import LimitWarnings, limit_warnings
from pips_drake.remote_manipulator.operator_inputs import OperatorInputs
from pips_drake.remote_manipulator.phases import (
    TABLE,
    Event,
    Phase,
    Situation,
    event_of,
    next_phase,
)
from pips_drake.remote_manipulator.program_collisions import CollisionTest, Contact
from pips_drake.remote_manipulator.program_motion import (
    MasterFollower,
    WallSlider,
    effector_pose,
)
from pips_drake.remote_manipulator.program_state import (
    ANGLES,
    COMMAND,
    GAP,
    HEIGHT,
    OFFSET,
    ProgramSettings,
    ProgramState,
    cleared,
    first_state,
    pose_of,
    vector_of,
)

Array = NDArray[np.float64]
Pose = tuple[Array, Array]

#: The payload counts as entering the bay when it is so far below face c, m; so it cannot be in and
#: out by turns.
ENTRY_PLAY = 0.05
#: The prong lets go when it is so much farther open than acquisition asks, m; the same.
RELEASE_PLAY = 0.005
#: A step that is let through must gain more than rounding, m.
_GAIN = 1e-9


class Measured(NamedTuple):
    """What the hardware does.

    Attributes:
        X_RP, X_RC: poses of payload and CAE in {R}.
        arm: height, six angles, gap, (8,); None: as it was last sent.
    """

    X_RP: Pose
    X_RC: Pose
    arm: Array | None = None


@dataclass(frozen=True, eq=False)
class Frame:
    """What a frame shows.

    Attributes:
        word: the scene generator's control word.
        contact: collisions of the command, `held` whether among the pairs of a held payload.
        acquisition, docking, berthing: how far the task is, by what is measured.
        warnings: limits and reach.
    """

    word: ControlWord
    contact: Contact
    held: bool
    acquisition: Acquisition
    docking: Docking
    berthing: Berthing
    warnings: LimitWarnings


class CollisionProgram:
    """The program of one machine and one scenario.

    Args:
        config: the machine.
        settings: choices.
        phase: the first one: stowed, docked or free_flying.
        arm: the first pose, (8,): height m, angles rad, gap m; None: the machine's home, the stand
            down and the prong open.
    """

    def __init__(
        self,
        config: RemoteManipulatorConfig,
        settings: ProgramSettings | None = None,
        *,
        phase: Phase = Phase.STOWED,
        arm: ArrayLike | None = None,
    ) -> None:
        self.config = config
        self.settings = settings or ProgramSettings()
        self.first_phase = phase
        home = [config.stand.lower_m, *config.arm.home, config.effector.prong_open_gap_m]
        self.first_command = np.zeros(COMMAND)
        self.first_command[: GAP + 1] = home if arm is None else np.asarray(arm, dtype=float)
        self.collisions = CollisionTest(config, report=self.settings.collision == "report")
        self._follower = MasterFollower(config, limit_rates=self.settings.limit_master_rates)
        self._slider = WallSlider(config, self.collisions)
        self._acquisition = AcquisitionTest(config)
        self._docking = DockingTest(config)
        machine, names = self.collisions.machine, ("hull", "probe")
        self._corners = np.concatenate(
            [machine.bodies.bodies[machine.names.index(name)].vertices for name in names]
        )
        bay = config.cargo_bay
        x, y, self._deck = bay.location_m
        self._opening = np.array(
            [[x, y - 0.5 * bay.width_m], [x + bay.length_m, y + 0.5 * bay.width_m]]
        )

    def first_state(self) -> ProgramState:
        """The state before the first frame."""
        return first_state(self.first_phase, self.first_command)

    def first_frame(
        self, state: ProgramState, inputs: OperatorInputs, measured: Measured
    ) -> tuple[ProgramState, Frame]:
        """What is shown before the first frame: nothing moves, and nothing happens."""
        contact = self._contact(state, state.command, measured)
        state = self._with_planes(state, contact)
        return state, self._frame(state, inputs, measured, contact)

    def advance(
        self, state: ProgramState, inputs: OperatorInputs, measured: Measured
    ) -> tuple[ProgramState, Frame]:
        """One frame.

        Args:
            state: after the last one.
            inputs: what the operator wants.
            measured: what the hardware does.
        """
        if measured.arm is None:
            measured = measured._replace(arm=state.sent[: GAP + 1])
        if inputs.initialize:
            state = self._initialized(state, inputs)
            contact = self._contact(state, state.command, measured)
        else:
            state = replace(state, initializing=False, event=Event.NONE)
            state, contact = self._moved(state, inputs, measured)
        state = self._with_planes(state, contact)
        frame = self._frame(state, inputs, measured, contact)
        if not inputs.initialize:
            state = self._with_event(state, inputs, measured, frame)
            word = control_word(
                inputs,
                mode=TABLE[state.phase].mode,
                finger_inhibit=state.finger_inhibit,
                arm_inhibit=state.arm_inhibit,
            )
            frame = replace(frame, word=word)
        return replace(state, frames=state.frames + 1), frame

    # What moves.

    def _moved(
        self, state: ProgramState, inputs: OperatorInputs, measured: Measured
    ) -> tuple[ProgramState, Contact]:
        """The command's step, its collisions, and what the scene is given."""
        literal = self.settings.inhibit == "literal"
        base = state.command if literal or not state.inhibited else state.free
        frozen = state.phase is Phase.DOCKED_HELD
        command = self._follower.step(base, inputs, gap_only=frozen)
        contact = self._contact(state, command, measured)
        if contact.any and self.settings.slide_along_walls and state.phase is Phase.EXTRACTION:
            command, contact = self._slid(state, command, contact, inputs, measured)
        held = TABLE[state.phase].grasped
        hits = hits_of(contact, held=held)
        if hits.finger and not held:
            # Is it the prong's own motion, or the arm's?
            alone = command.copy()
            alone[GAP] = state.free[GAP]
            hits = Hits(arm=self._contact(state, alone, measured).any, finger=True)
        after = follow_up(state, command, hits, literal=literal)
        if not literal and hits.arm and state.inhibited and self._gains(state, contact, measured):
            after = replace(after, free=command, command=command, sent=command)
        return after, contact

    def _gains(self, state: ProgramState, contact: Contact, measured: Measured) -> bool:
        """The held pose collides too, and more than the command does."""
        held = self._contact(state, state.free, measured)
        return held.any and contact.separation > held.separation + _GAIN

    def _slid(
        self,
        state: ProgramState,
        command: Array,
        contact: Contact,
        inputs: OperatorInputs,
        measured: Measured,
    ) -> tuple[Array, Contact]:
        """The command beside the bay's side walls, if that is all that it takes."""
        before = self._contact(state, state.free, measured)
        p_2P = state.held[4:]
        moved = self._slider(contact, before, command, state.free, inputs.angles, p_2P)
        if moved is None:
            return command, contact
        after = self._contact(state, moved, measured)
        return (command, contact) if after.any else (moved, after)

    def _placement(self, state: ProgramState, command: Array, measured: Measured) -> Placement:
        """Where everything is when the arm is as commanded."""
        X_R2 = effector_pose(self.config.arm, command)
        facts = TABLE[state.phase]
        # What stands still in space moves against an orbiter that is sent on.
        shift = command[OFFSET] - state.sent[OFFSET]
        R, p = measured.X_RC
        X_RC = R, p - shift
        if facts.grasped:
            R, p = pose_of(state.held)
            X_RP = X_R2[0] @ R, X_R2[0] @ p + X_R2[1]
        else:
            R, p = measured.X_RP
            X_RP = (R, p) if facts.support == "bay" else (R, p - shift)
        return Placement(X_R2, X_RP, X_RC, float(command[GAP]), float(command[HEIGHT]))

    def _contact(self, state: ProgramState, command: Array, measured: Measured) -> Contact:
        return self.collisions(state.phase, self._placement(state, command, measured))

    def _with_planes(self, state: ProgramState, contact: Contact) -> ProgramState:
        """The new separating planes; where there is none, the old one stays, as in the report."""
        good = np.isfinite(contact.planes[:, :1])
        return replace(state, planes=np.where(good, contact.planes, state.planes))

    # What happens.

    def _initialized(self, state: ProgramState, inputs: OperatorInputs) -> ProgramState:
        """The state while channel 1 is on."""
        if state.initializing:
            return replace(state, event=Event.NONE)
        if inputs.initialize_select == "mode_2_or_3" and TABLE[state.phase].grasped:
            back = replace(cleared(state), command=state.sent, free=state.sent)
            return replace(back, initializing=True, event=Event.NONE)
        return replace(
            self.first_state(),
            initializing=True,
            event=Event.RESET,
            frames=state.frames,
            inhibits=state.inhibits,
            resets=state.resets + 1,
        )

    def _with_event(
        self, state: ProgramState, inputs: OperatorInputs, measured: Measured, frame: Frame
    ) -> ProgramState:
        """The phase's change, if there is one."""
        docked = frame.docking.docked
        situation = self._situation(state, inputs, measured, frame)
        event = event_of(state.phase, situation)
        armed = state.armed or (not docked and not inputs.open_latch)
        armed = armed and event is not Event.UNDOCKED
        after = replace(state, armed=armed, event=event)
        if event is Event.NONE:
            return after
        phase = next_phase(state.phase, event, situation, first=self.first_phase)
        after = replace(after, phase=phase)
        if event in (Event.LEFT_BAY, Event.ENTERED_BAY):
            return after
        # Flags are of the mode that is left; an arm that was held starts from there.
        command = after.sent.copy()
        if phase is Phase.DOCKED_HELD:
            # Held at both ends: the drives are not left pulling at what they had not reached.
            reached = self._measured_arm(state, measured)
            command[:GAP] = reached[:GAP]
        after = replace(cleared(after), command=command, free=command, sent=command)
        if event is Event.ACQUIRED:
            X_R2 = self._measured_effector(state, measured)
            sign, snap = frame.acquisition.sign, self.settings.snap_to_right_angles
            held = vector_of(held_pose(X_R2, measured.X_RP, sign, snap=snap))
            after = replace(after, held=held, sign=sign)
        return after

    def _situation(
        self, state: ProgramState, inputs: OperatorInputs, measured: Measured, frame: Frame
    ) -> Situation:
        R, p = measured.X_RP
        corners = self._corners @ R.T + p
        low, high = self._opening
        inside = ((corners[:, :2] > low) & (corners[:, :2] < high)).all(axis=1)
        depth = corners[:, 2] - self._deck
        opened = self.config.acquisition.prong_gap_m + RELEASE_PLAY
        return Situation(
            acquirable=frame.acquisition.acquired and inputs.prong != -1,
            prong_open=float(self._measured_arm(state, measured)[GAP]) > opened,
            latch_open=inputs.open_latch,
            dockable=frame.docking.docked and state.armed,
            above_bay=bool((depth < 0.0).all()),
            inside_bay=bool((inside & (depth > 0.0)).any()),
            entering_bay=bool((inside & (depth > ENTRY_PLAY)).any()),
            berthed=frame.berthing.berthed,
        )

    # What is shown.

    def _measured_arm(self, state: ProgramState, measured: Measured) -> Array:
        return state.sent[: GAP + 1] if measured.arm is None else measured.arm

    def _measured_effector(self, state: ProgramState, measured: Measured) -> Pose:
        return effector_pose(self.config.arm, self._measured_arm(state, measured))

    def _frame(
        self, state: ProgramState, inputs: OperatorInputs, measured: Measured, contact: Contact
    ) -> Frame:
        gap = float(self._measured_arm(state, measured)[GAP])
        X_R2 = self._measured_effector(state, measured)
        stand, prong = self._follower.stopped(state.command, inputs)
        facts = TABLE[state.phase]
        return Frame(
            word=control_word(
                inputs,
                mode=facts.mode,
                finger_inhibit=state.finger_inhibit,
                arm_inhibit=state.arm_inhibit,
            ),
            contact=contact,
            held=facts.grasped,
            acquisition=self._acquisition(X_R2, gap, measured.X_RP),
            docking=self._docking(measured.X_RP, measured.X_RC),
            berthing=berthing(self.config, measured.X_RP),
            warnings=limit_warnings(
                self.config.arm, state.command[ANGLES], inputs.angles, stand=stand, prong=prong
            ),
        )
