"""An operator's hand on the snake, an arm on it, and a clock."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from pips_drake.config import require
from pips_drake.errors import InputError
from pips_drake.planning.extension import Extending
from pips_drake.planning.live_arm import LiveArm
from pips_drake.planning.live_snake import Wish
from pips_drake.planning.live_state import LiveState
from pips_drake.scene.signed_distance import SignedDistanceField
from pips_drake.serpentine.motion_words import EXTENDING, RETRACTING, RUN

Array = NDArray[np.float64]

#: What the `status` output holds, with units.
STATUS = (
    "extending",
    "refusal",
    "goal_refused",
    "nails_refused",
    "near_rest",
    "clearance_m",
    "to_the_end_m",
)
#: What the rules of extension say when the tip goes back.
_BACKWARDS = (Extending.BACK, Extending.PROTRUDING, Extending.UNFITTED)


class SnakeTeleoperator(LeafSystem):
    """Moves a snake and the arm on it as an operator wishes (CMU-92 sections 3.5.1 and 3.7.1).

    .. pydrake_system::

        name: SnakeTeleoperator
        input_ports:
        - goal
        - pull
        - nails
        - obstacles
        - tension
        - bending_stiffness
        - reach
        - command
        - speed_share
        output_ports:
        - joint_state
        - tip
        - phase
        - tip_path
        - snake
        - status

    Input ports, all optional; places and forces in the scene's frame, `frame_0`:

    - `goal`, (3,): where the snake should end, m; where it ends when unconnected.
    - `pull`, (6,): a place, m, whose nearest point of the snake is pulled, and the force there, N.
    - `nails`: abstract `Value[object]` that holds places (K, 3), m, to which the nearest points of
      the snake go, and where they stay; a place that is left out lets its point go.
    - `obstacles`: abstract `Value[object]` that holds a `SignedDistanceField` in the scene's frame:
      the scene as it is now, with obstacles placed, moved or removed (`planning.obstacles`); the
      live arm's own when unconnected.
    - `tension`, (1,): elasticity, N, of all of the snake.
    - `bending_stiffness`, (1,): rigidity, N m^2, of all of the snake.
    - `reach`, (1,): how far from home the tip may go, m.
    - `command`, (1,): run (1): out, back or wait as the rules of section 3.5.1 have it; hold (0):
      snake and tip come to rest; retract (-1): back along the snake, which comes to rest; extend
      (2): out without waiting for the snake to rest. Run when unconnected.
    - `speed_share`, (1,): at which share of its speeds, above 0 and at most 1; 1 when unconnected.

    Output ports, all from state (no feedthrough):

    - `joint_state`, (2 J,): joints, m and rad, and their rates, m/s and rad/s. Between two updates
      they go straight from the posture before to the present one.
    - `tip`, (2,): arc length of the tip on `tip_path`, m, and its mean rate, m/s.
    - `phase`, (1,): `motion_words.EXTENDING`, or `RETRACTING` while the tip goes back.
    - `tip_path`: abstract `TipPath` in the arm's frame {0}, which begins with the base line.
    - `snake`: abstract `Snake` in the scene's frame.
    - `status`, (7,): `STATUS`: `extension.Extending`; why the last tick was not taken as wished
      (`live_state.Refusal`); 1 if the goal asked for is refused; 1 if a nail is; 1 if the snake is
      near rest; lower bound of the clearance, m; from the tip to the snake's end along it, m.

    State: abstract, the time of the last update, s, and a `LiveState`; updated every
    `live_arm.settings.period` s. Nothing in it is ever changed in place, so that copies of a
    context share it.

    Latency: what is wished acts at the next update, and is reached a period after it.

    Args:
        live_arm: arm, scene and how things move.
        start: where it begins (`LiveArm.lay`).

    A wish that is no number raises `InputError` from the update.
    """

    def __init__(self, live_arm: LiveArm, start: LiveState) -> None:
        super().__init__()
        self._live_arm = live_arm
        joints, period = live_arm.arm.joints, live_arm.settings.period
        self._goal = self.DeclareVectorInputPort("goal", 3)
        self._pull = self.DeclareVectorInputPort("pull", 6)
        self._nails = self.DeclareAbstractInputPort("nails", AbstractValue.Make(object()))
        self._obstacles = self.DeclareAbstractInputPort("obstacles", AbstractValue.Make(object()))
        self._numbers = {
            name: self.DeclareVectorInputPort(name, 1)
            for name in ("tension", "bending_stiffness", "reach", "command", "speed_share")
        }
        self._state = self.DeclareAbstractState(Value[object]((0.0, start)))
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update_state)
        of_state = {self.abstract_state_ticket(self._state)}
        self.DeclareVectorOutputPort(
            "joint_state",
            2 * joints,
            self._calc_joint_state,
            prerequisites_of_calc=of_state | {self.time_ticket()},
        )
        for name, size, calc in (("tip", 2, self._calc_tip), ("phase", 1, self._calc_phase)):
            self.DeclareVectorOutputPort(name, size, calc, prerequisites_of_calc=of_state)
        for name, value, calc_value in (
            ("tip_path", start.path, self._calc_tip_path),
            ("snake", start.live.snake, self._calc_snake),
        ):
            self.DeclareAbstractOutputPort(
                name,
                lambda value=value: AbstractValue.Make(value),
                calc_value,
                prerequisites_of_calc=of_state,
            )
        self.DeclareVectorOutputPort(
            "status", len(STATUS), self._calc_status, prerequisites_of_calc=of_state
        )

    def live_state(self, context: Context) -> LiveState:
        """The arm and its snake in a context of this system."""
        return self._read(context)[1]

    def _read(self, context: Context) -> tuple[float, LiveState]:
        time, state = context.get_abstract_state(int(self._state)).get_value()
        return time, state

    def _wish(self, context: Context) -> Wish:
        number = {
            name: float(port.Eval(context)[0])
            for name, port in self._numbers.items()
            if port.HasValue(context)
        }
        pull = self._pull.Eval(context).copy() if self._pull.HasValue(context) else None
        nails = self._nails.Eval(context) if self._nails.HasValue(context) else ()
        return Wish(
            goal=self._goal.Eval(context).copy() if self._goal.HasValue(context) else None,
            pulls=() if pull is None or not pull[3:].any() else ((pull[:3], pull[3:]),),
            nails=_places(nails),
            tension=number.get("tension"),
            bending_stiffness=number.get("bending_stiffness"),
            reach=number.get("reach", math.inf),
            word=number.get("command", RUN),
        )

    def _update_state(self, context: Context, state: State) -> None:
        share = 1.0
        if self._numbers["speed_share"].HasValue(context):
            share = float(self._numbers["speed_share"].Eval(context)[0])
            require(0.0 < share <= 1.0, "SnakeTeleoperator.speed_share", share, "> 0 and <= 1")
        _, before = self._read(context)
        live_arm = self._live_arm
        if self._obstacles.HasValue(context):
            field = self._obstacles.Eval(context)
            if not isinstance(field, SignedDistanceField):
                raise InputError(
                    f"SnakeTeleoperator.obstacles = {type(field).__name__}; must be a "
                    "SignedDistanceField"
                )
            live_arm = live_arm.among(field)
        after = live_arm.tick(before, self._wish(context), speed_share=share)
        value = state.get_mutable_abstract_state(int(self._state))
        value.set_value((context.get_time(), after))

    def _calc_joint_state(self, context: Context, output: BasicVector) -> None:
        time, state = self._read(context)
        period = self._live_arm.settings.period
        left = min(max(time + period - context.get_time(), 0.0), period)
        output.SetFromVector(np.concatenate([state.joints - left * state.rates, state.rates]))

    def _calc_tip(self, context: Context, output: BasicVector) -> None:
        state = self.live_state(context)
        output.SetFromVector([state.tip, state.tip_rate])

    def _calc_phase(self, context: Context, output: BasicVector) -> None:
        backwards = self.live_state(context).extending in _BACKWARDS
        output.SetFromVector([RETRACTING if backwards else EXTENDING])

    def _calc_tip_path(self, context: Context, output: Value) -> None:
        output.set_value(self.live_state(context).path)

    def _calc_snake(self, context: Context, output: Value) -> None:
        output.set_value(self.live_state(context).live.snake)

    def _calc_status(self, context: Context, output: BasicVector) -> None:
        state = self.live_state(context)
        output.SetFromVector(
            [
                float(state.extending),
                float(state.refusal),
                float(state.live.goal_refused),
                float(state.live.nails_refused),
                float(state.near_rest),
                state.clearance,
                state.path.length - state.tip,
            ]
        )


def _places(nails: object) -> Array:
    """Places (K, 3) m that a port holds.

    Raises:
        InputError: they are none.
    """
    try:
        return np.array(nails, dtype=np.float64).reshape(-1, 3)
    except (TypeError, ValueError):
        raise InputError(f"SnakeTeleoperator.nails = {nails!r}; must be (K, 3), m") from None
