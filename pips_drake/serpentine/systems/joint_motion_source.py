"""Where the joints should be, over time, in a motion that they are given for."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from pips_drake.config import require
from pips_drake.serpentine.motion_clock import MotionClock
from pips_drake.serpentine.planned_motion import GivenJoints
from pips_drake.serpentine.systems.clock_inputs import heard_share, heard_word


class JointMotionSource(LeafSystem):
    """Moves the joints as they are given: out, dwell, and back; holds, resumes and retracts.

    .. pydrake_system::

        name: JointMotionSource
        input_ports:
        - command
        - speed_share
        output_ports:
        - joint_state
        - tip
        - phase

    It stands in place of `TipPathSource` and `FollowTheLeaderController` where no single path of
    the tip describes a motion.

    Input ports:

    - `command`, (1,): `RUN` (1), `HOLD` (0), `RETRACT` (-1) or `EXTEND` (2), as of `TipPathSource`;
      optional, `RUN` when unconnected. Another number raises `InputError`. The way back is the
      motion backwards.
    - `speed_share`, (1,): at which share of its speed, above 0 and at most 1; optional, 1 when
      unconnected.

    Output ports, all from state (no feedthrough):

    - `joint_state`, (2 J,): joint values, m and rad, and their rates, m/s and rad/s. At a row of
      the motion the rates are those of the line that leads to it.
    - `tip`, (2,): how far along the motion is, m, and its rate, m/s: the way that its fastest point
      has gone, which mostly is the tip (`GivenJoints`); not 0 while anything moves.
    - `phase`, (1,): `EXTENDING`, `DWELLING`, `RETRACTING` or `DONE`.

    State: (4,) time on the motion's clock, s; its rate (1 forward, 0 hold, -1 back); phase; time
    left to dwell, s. Updated every `period` s (default 1/64 s).

    A motion need not begin or end at rest, so the clock itself comes up to its rate, and down from
    it, over `hold_ramp` s: at both ends as in a hold (`MotionClock`). The joints pass through the
    same postures whatever the clock does. Latency: a command acts at the next update.

    Args:
        given: the motion.
        dwell: time at the end before the way back, s; without that, the end is the end.
        retract: whether to come back after the dwell without being told.
        hold_ramp: time to come to a hold, and to start and stop, s.
        period: s.
    """

    def __init__(
        self,
        given: GivenJoints,
        *,
        dwell: float = 0.0,
        retract: bool = False,
        hold_ramp: float = 1.0,
        period: float = 1.0 / 64.0,
    ) -> None:
        super().__init__()
        require(dwell >= 0.0, "JointMotionSource: dwell", f"{dwell} s", ">= 0")
        require(hold_ramp > 0.0, "JointMotionSource: hold_ramp", f"{hold_ramp} s", "> 0")
        self._given = given
        self._clock = MotionClock(
            end=given.motion.duration,
            dwell=dwell,
            retract=retract,
            ramp=hold_ramp,
            period=period,
            rests_at_ends=False,
        )
        self._command_port = self.DeclareVectorInputPort("command", 1)
        self._share_port = self.DeclareVectorInputPort("speed_share", 1)
        self._state = self.DeclareDiscreteState(list(self._clock.start))
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update_state)
        state_only = {self.discrete_state_ticket(self._state)}
        for name, size, calc in (
            ("joint_state", 2 * given.arm.joints, self._calc_joint_state),
            ("tip", 2, self._calc_tip),
            ("phase", 1, self._calc_phase),
        ):
            self.DeclareVectorOutputPort(name, size, calc, prerequisites_of_calc=state_only)

    @property
    def duration(self) -> float:
        """Time to do it all without a hold, s; updates make it up to two periods more."""
        return self._clock.duration

    def _update_state(self, context: Context, values: DiscreteValues) -> None:
        word = heard_word("JointMotionSource.command", self._command_port, context)
        share = heard_share("JointMotionSource.speed_share", self._share_port, context)
        time, rate, phase, dwell = context.get_discrete_state(self._state).value().tolist()
        after = self._clock.step((time, rate, phase, dwell), word, share)
        values.get_mutable_vector(self._state).SetFromVector(np.array(after))

    def _calc_joint_state(self, context: Context, output: BasicVector) -> None:
        time, rate = context.get_discrete_state(self._state).value().tolist()[:2]
        joints, slopes = self._given.motion.state(time)
        output.SetFromVector(np.concatenate([joints, slopes * rate]))

    def _calc_tip(self, context: Context, output: BasicVector) -> None:
        time, rate = context.get_discrete_state(self._state).value().tolist()[:2]
        way, speed = self._given.way(time)
        output.SetFromVector([way, speed * rate])

    def _calc_phase(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(context.get_discrete_state(self._state).value()[2:3])
