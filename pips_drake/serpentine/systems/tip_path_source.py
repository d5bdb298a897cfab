"""Where the tip should be on its path, over time."""

from __future__ import annotations

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from pips_drake.config import require
from pips_drake.serpentine.motion_clock import MotionClock
from pips_drake.serpentine.motion_profile import MotionProfile
from pips_drake.serpentine.motion_words import (
    DONE,
    DWELLING,
    EXTEND,
    EXTENDING,
    HOLD,
    RETRACT,
    RETRACTING,
    RUN,
)
from pips_drake.serpentine.systems.clock_inputs import heard_share, heard_word
from pips_drake.serpentine.tip_path import TipPath

__all__ = [
    "DONE",
    "DWELLING",
    "EXTEND",
    "EXTENDING",
    "HOLD",
    "RETRACT",
    "RETRACTING",
    "RUN",
    "TipPathSource",
]


class TipPathSource(LeafSystem):
    """Moves the tip along a path: out, dwell, and back; holds, resumes and retracts on command.

    .. pydrake_system::

        name: TipPathSource
        input_ports:
        - command
        - speed_share
        output_ports:
        - tip
        - path
        - phase

    Input ports:

    - `command`, (1,): `RUN` (1), `HOLD` (0), `RETRACT` (-1) or `EXTEND` (2); optional, `RUN` when
      unconnected. Another number raises `InputError`. After `RETRACT` the way is back: `RUN` goes
      on with it. `EXTEND` turns it: the way is out again, to the end of the path, where the tip
      stands until it hears another word, and dwells anew after `RUN`.
    - `speed_share`, (1,): at which share of the profile's speed, above 0 and at most 1; optional, 1
      when unconnected.

    Output ports, all from state or constant (no feedthrough):

    - `tip`, (2,): arc length of the tip on the path, m, and its rate, m/s.
    - `path`: abstract `Value[object]` that holds the `TipPath`.
    - `phase`, (1,): `EXTENDING`, `DWELLING`, `RETRACTING` or `DONE`.

    State: (4,) time on the speed profile, s; its rate (1 forward, 0 hold, -1 back); phase; time
    left to dwell, s. Updated every `period` s (default 1/64 s).

    A hold slows the profile's own clock to rest over `hold_ramp` s and a resume speeds it up again,
    so the tip follows the same speeds along the same path; going back runs the clock backwards. A
    share of the speed is a share of the clock's rate, and is reached in the same way. At both ends
    of the profile the tip is at rest, and the clock stops, starts and turns at once. Latency: a
    command acts at the next update.

    Args:
        path: the path.
        profile: travel from the path's home, against time.
        dwell: time at the end of the path before the way back, s; without that, the end is the end.
        retract: whether to come back after the dwell without being told.
        hold_ramp: time to come to a hold, s.
        period: s.
    """

    def __init__(
        self,
        path: TipPath,
        profile: MotionProfile,
        *,
        dwell: float = 0.0,
        retract: bool = True,
        hold_ramp: float = 1.0,
        period: float = 1.0 / 64.0,
    ) -> None:
        super().__init__()
        require(dwell >= 0.0, "TipPathSource: dwell", f"{dwell} s", ">= 0")
        require(hold_ramp > 0.0, "TipPathSource: hold_ramp", f"{hold_ramp} s", "> 0")
        self._path = path
        self._profile = profile
        self._clock = MotionClock(
            end=profile.duration,
            dwell=dwell,
            retract=retract,
            ramp=hold_ramp,
            period=period,
            rests_at_ends=True,
        )
        self._command_port = self.DeclareVectorInputPort("command", 1)
        self._share_port = self.DeclareVectorInputPort("speed_share", 1)
        self._state = self.DeclareDiscreteState(list(self._clock.start))
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update_state)
        state_only = {self.discrete_state_ticket(self._state)}
        self.DeclareVectorOutputPort("tip", 2, self._calc_tip, prerequisites_of_calc=state_only)
        self.DeclareAbstractOutputPort(
            "path",
            lambda: AbstractValue.Make(path),
            self._calc_path,
            prerequisites_of_calc={self.nothing_ticket()},
        )
        self.DeclareVectorOutputPort("phase", 1, self._calc_phase, prerequisites_of_calc=state_only)

    @property
    def duration(self) -> float:
        """Time to do it all without a hold, s; updates make it up to two periods more."""
        return self._clock.duration

    def _update_state(self, context: Context, values: DiscreteValues) -> None:
        word = heard_word("TipPathSource.command", self._command_port, context)
        share = heard_share("TipPathSource.speed_share", self._share_port, context)
        time, rate, phase, dwell = context.get_discrete_state(self._state).value().tolist()
        after = self._clock.step((time, rate, phase, dwell), word, share)
        values.get_mutable_vector(self._state).SetFromVector(np.array(after))

    def _calc_tip(self, context: Context, output: BasicVector) -> None:
        time, rate = context.get_discrete_state(self._state).value().tolist()[:2]
        travel, speed = self._profile(time)
        output.SetFromVector([self._path.home_arc_length + travel, speed * rate])

    def _calc_path(self, context: Context, output: Value) -> None:
        output.set_value(self._path)

    def _calc_phase(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(context.get_discrete_state(self._state).value()[2:3])
