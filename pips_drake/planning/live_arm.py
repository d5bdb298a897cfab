"""An arm on a snake that an operator handles, a tick at a time (CMU-92 sections 3.5.1 and 3.7.1).

The arm lies on the snake as follow-the-leader has it, its base end on the base line, its tip some
way along. In a tick the snake makes a small move, the rules of `extension` say whether the tip goes
out or back, and the arm is fitted anew. What comes out is safe because nothing else is taken: a
posture is accepted only if

- follow-the-leader has a solution and every joint is within its limits,
- every body's capsule keeps `clearance` from every obstacle (`arm_envelope`, a bound),
- no drive goes faster than its limit, from the posture before, and
- no body goes farther than `clearance`.

Otherwise the tip stays, or the snake does, or both: then the arm keeps its last posture, which was
accepted. A tick that asks too much is scaled down. Between two accepted postures joints go
straight, and a point of a body is no farther from where it is in one of them than half of the way
between (but for what its body turns on that way, which is less than a hundredth of it): so between
ticks, clearance is short of `clearance` by half of a tick's motion, some 2 mm at the default
speeds, and by half of itself at most.

A snake that moves while the arm cannot be fitted onto it waits, and the tip comes back along the
present one until it can (section 3.5.1). That there is a way back is looked at before the snake is
moved: joints bend most where they pass a bend's middle, so that the arm must fit not only where it
is, but wherever it is drawn back to. Speeds begin and end with ramps; a tick that is refused
stops the arm at once.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError, NotFollowableError
from pips_drake.planning.arm_envelope import clearance_bound, make_envelope
from pips_drake.planning.extension import Extending, Situation, approach, where_to
from pips_drake.planning.live_path import rounded_path, with_lead
from pips_drake.planning.live_snake import (
    LiveSnake,
    Move,
    Wish,
    lay_snake,
    let_go,
    listen,
    propose,
    take,
)
from pips_drake.planning.live_state import LiveArmSettings, LiveState, Refusal
from pips_drake.scene.signed_distance import SignedDistanceField
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.drives import drive_limits, drives_from_joints
from pips_drake.serpentine.follow_the_leader import FollowTheLeader
from pips_drake.serpentine.motion_words import HOLD, RETRACT
from pips_drake.serpentine.plan import LIMIT_TOLERANCE
from pips_drake.serpentine.tip_path import TipPath

Array = NDArray[np.float64]

#: Places within a link's length at which the way back along a snake that moves is looked at, and
#: what is left of the joints' ranges there, for what is between them.
_PHASES, _RESERVE = 24, 0.02


@dataclass(frozen=True)
class _Fitted:
    """A posture that may be taken, or why it may not."""

    refusal: Refusal
    path: TipPath
    joints: Array
    clearance: float
    excess: float  # of the fastest drive over its limit
    bend: float


class LiveArm:
    """What does not change while an operator works: the arm, the scene, how things move.

    Args:
        arm: the arm.
        obstacles: the scene's shapes.
        rail_shift: from the scene's frame to the arm's frame {0}, along z, m (`anchoring`).
        settings: how things move.
    """

    def __init__(
        self,
        arm: SerpentineArm,
        obstacles: SignedDistanceField,
        *,
        rail_shift: float = 0.0,
        settings: LiveArmSettings | None = None,
    ) -> None:
        self.arm = arm
        self.obstacles = obstacles
        self.settings = settings or LiveArmSettings()
        self._shift = np.array([0.0, 0.0, rail_shift])
        self._envelope = make_envelope(arm)
        self._solver = FollowTheLeader(arm)
        self._reach = self.settings.drive_share * drive_limits(arm)[2] * self.settings.period
        at_home = kinematics.spine_points(arm, arm.joint_home)[0]
        way = at_home[-1] - at_home[0]
        self._along: Array = way / np.linalg.norm(way)
        self._back = float(arm.average_module_length.max()) * np.arange(_PHASES + 1) / _PHASES
        self._hinges = slice(arm.first_actuated_joint - 1, arm.joints - 1)
        ways = np.stack([arm.joint_lower, arm.joint_upper]) - arm.joint_home
        # At home some joints may stand at their limit: that is looked at elsewhere.
        ways = np.where(ways == 0.0, np.inf, ways)[:, None, self._hinges]
        self._home, self._ways = arm.joint_home[self._hinges], ways
        self._length = float(np.linalg.norm(way)) + float(arm.average_module_length[0])

    @property
    def shift(self) -> Array:
        """From frame {0} to the scene's frame, (3,) m."""
        return self._shift

    def among(self, obstacles: SignedDistanceField) -> LiveArm:
        """The same arm among other obstacles, for example with one that an operator has moved.

        A state goes on from one to the other. Where the arm already is nearer to a new obstacle
        than it may come, no posture is taken until that is moved away.
        """
        other = copy(self)
        other.obstacles = obstacles
        return other

    def lay(self, path: ArrayLike, *, extended: float = 0.0, settled: bool = False) -> LiveState:
        """An arm on a path of the tip.

        Args:
            path: (P, 3) m in the scene's frame; begins with the home tip, from which the arm goes
                straight on for the lead.
            extended: how far out along it the tip is, m.
            settled: whether the snake is let go before the arm is laid on it.

        Raises:
            InputError: the path means nothing, or its beginning is not the home tip.
            NotFollowableError: the arm cannot be there, and why.
        """
        points = np.array(path, dtype=np.float64)
        live = lay_snake(
            with_lead(points, self._along, self.settings.lead),
            self.settings.snake,
            lead=self.settings.lead,
        )
        home = kinematics.spine_points(self.arm, self.arm.joint_home)[0, -1] + self._shift
        if np.linalg.norm(live.snake.points[0] - home) > 1e-3:
            raise InputError(
                f"snake begins at {live.snake.points[0].tolist()} m; must be at the home tip, "
                f"{home.tolist()} m"
            )
        if settled:
            live = let_go(live, self.obstacles, self.settings.snake)
        trace = self._path_along(live.snake.points)
        tip = trace.home_arc_length + extended
        found = self._fit(live.snake.points, tip, before=None)
        if found.refusal != Refusal.NONE:
            raise NotFollowableError(
                f"the arm cannot lie on the snake with its tip {extended:.3f} m out: "
                f"{_REASONS[found.refusal]}"
            )
        return LiveState(
            live=live,
            path=found.path,
            tip=tip,
            tip_rate=0.0,
            shift_rate=0.0,
            joints=found.joints,
            rates=np.zeros(self.arm.joints),
            clearance=found.clearance,
            fits=True,
            extending=Extending.WAITING,
            refusal=Refusal.NONE,
            near_rest=False,
            bend=0.0,
        )

    def tick(self, state: LiveState, wish: Wish, *, speed_share: float = 1.0) -> LiveState:
        """The next state.

        Args:
            speed_share: of the speeds, 0 .. 1: a supervisor's.
        """
        settings, live = self.settings, state.live
        period = settings.period
        move = None
        near_rest = state.near_rest
        stands = wish.word in (HOLD, RETRACT)
        if not stands:
            live = listen(live, wish, self.obstacles, settings.snake)
        # Held, or taken back, the snake comes to rest over its ramp, as the tip does.
        step = settings.shift_acceleration * period
        shift_rate = state.shift_rate - step
        if not stands:
            shift_rate = min(state.shift_rate + step, settings.shift_speed * speed_share)
        if shift_rate > 0.0:
            move = propose(live, wish, self.obstacles, settings.snake, limit=shift_rate * period)
            near_rest = move.near_rest
        extending, target = where_to(
            Situation(
                word=wish.word,
                near_rest=near_rest,
                fits=state.fits,
                tip=state.tip,
                home=state.path.home_arc_length,
                end=state.path.length,
                reach=wish.reach,
            )
        )
        tip, _ = approach(
            state.tip,
            state.tip_rate,
            target,
            speed=settings.tip_speed * speed_share,
            acceleration=settings.tip_acceleration,
            period=period,
        )
        tip = max(tip, state.path.home_arc_length)
        taken, share, part, refusal, fits = self._take(state, live, move, tip)
        after = replace(
            state,
            live=live,
            fits=fits,
            extending=extending,
            refusal=refusal,
            near_rest=near_rest,
            tip_rate=0.0,
            shift_rate=0.0,
            rates=np.zeros(self.arm.joints),
        )
        if taken is None:
            return after
        if move is not None and share > 0.0:
            after = replace(after, live=self._moved(live, move, share))
            went = np.linalg.norm(move.points - live.snake.points, axis=1).max()
            after = replace(after, shift_rate=share * float(went) / period)
        rate = part * (tip - state.tip) / period
        return replace(
            after,
            path=taken.path,
            tip=state.tip + part * (tip - state.tip) if part != 1.0 else tip,
            tip_rate=rate,
            joints=taken.joints,
            rates=(taken.joints - state.joints) / period,
            clearance=taken.clearance,
            bend=taken.bend,
        )

    def _take(
        self, state: LiveState, live: LiveSnake, move: Move | None, tip: float
    ) -> tuple[_Fitted | None, float, float, Refusal, bool]:
        """The first of the tick's moves that may be taken.

        Returns:
            What is taken, the shares of the snake's move and of the tip's, why the first choice was
            not taken whole, and whether the arm fits onto the snake's move.
        """
        tip_moves = tip != state.tip
        choices = [(1.0, 1.0)] if move is not None or tip_moves else []
        if move is not None and tip_moves:
            choices += [(1.0, 0.0), (0.0, 1.0)]
        if move is None:
            choices = [(0.0, part) for _, part in choices]
        first, fits = Refusal.NONE, state.fits if move is None else True
        for share, part in choices:
            found = self._try(state, live, move, tip, share, part)
            if found.refusal == Refusal.TOO_FAST:
                # Drives move as much less as the move is smaller, but for a little curvature.
                small = 0.9 / found.excess
                share, part = share * small, part * small
                found = self._try(state, live, move, tip, share, part)
            if found.refusal == Refusal.NONE:
                return found, share, part, first, fits
            first = first or found.refusal
            if part == 0.0 or not tip_moves:
                fits = found.refusal not in (Refusal.JOINT_LIMIT, Refusal.NOT_FITTED)
        return None, 0.0, 0.0, first, fits

    def _try(
        self,
        state: LiveState,
        live: LiveSnake,
        move: Move | None,
        tip: float,
        share: float,
        part: float,
    ) -> _Fitted:
        snake = live.snake if move is None else self._moved(live, move, share).snake
        return self._fit(
            snake.points,
            state.tip + part * (tip - state.tip),
            before=state,
            moved=move is not None and share > 0.0,
        )

    def _moved(self, live: LiveSnake, move: Move, share: float) -> LiveSnake:
        return take(live, move, share) if share > 0.0 else live

    def _fit(
        self, points: Array, tip: float, *, before: LiveState | None, moved: bool = False
    ) -> _Fitted:
        """The arm on a snake's points, judged.

        Args:
            moved: whether the snake is another one than before; then the way back along it is
                looked at too, over a link's length, after which every joint has been everywhere.
        """
        arm, path = self.arm, self._path_along(points)
        excess, bend = 0.0, 0.0 if before is None else before.bend

        def judged(refusal: Refusal, clearance: float = 0.0) -> _Fitted:
            return _Fitted(refusal, path, joints[0], clearance, excess, bend)

        tips = np.maximum(tip - (self._back if moved else 0.0), path.home_arc_length)
        found = self._solver.solve(path, tips)
        joints = np.clip(found.joints, arm.joint_lower, arm.joint_upper)
        if not found.solved.all():
            return judged(Refusal.NOT_FITTED)
        # At home the feed stands at its limit, but for rounding.
        if np.abs(joints - found.joints).max() > LIMIT_TOLERANCE:
            return judged(Refusal.JOINT_LIMIT)
        if moved:
            most = float(((joints[:, self._hinges] - self._home) / self._ways).max())
            if most > max(1.0 - _RESERVE, bend):
                return judged(Refusal.JOINT_LIMIT)
            bend = most
        axes = self._envelope.axes(arm, joints[0], self._shift)
        if before is not None:
            drives = drives_from_joints(arm, np.stack([before.joints, joints[0]]))
            excess = float((np.abs(drives[1] - drives[0]) / self._reach).max())
            went = np.stack(axes) - self._envelope.axes(arm, before.joints, self._shift)
            farthest = float(np.linalg.norm(went, axis=-1).max())
            excess = max(excess, farthest / self.settings.clearance)
            if excess > 1.0:
                return judged(Refusal.TOO_FAST)
        clearance = self._bound(*axes)
        near = clearance < self.settings.clearance
        if moved and not near:
            near = self.clearance(joints[len(tips) // 2]) < self.settings.clearance
        return judged(Refusal.TOO_NEAR if near else Refusal.NONE, clearance)

    def clearance(self, joints: Array) -> float:
        """Lower bound of the arm's distance to obstacles in a posture (J,), m.

        It is no better than `settings.clearance` asks for.
        """
        return self._bound(*self._envelope.axes(self.arm, joints, self._shift))

    def _bound(self, first: Array, last: Array) -> float:
        """The same, from both ends of the capsules' axes (B, 3) m."""
        enough = self.settings.clearance
        return clearance_bound(self.obstacles, first, last, self._envelope.radii, enough=enough)

    def _path_along(self, points: Array) -> TipPath:
        base = points[0] - self._length * self._along
        return rounded_path(np.vstack([base, points]) - self._shift, "live")


_REASONS = {
    Refusal.NONE: "",
    Refusal.TOO_NEAR: "it would be too near to an obstacle",
    Refusal.JOINT_LIMIT: "a joint would leave its limits",
    Refusal.NOT_FITTED: "follow-the-leader has no solution",
    Refusal.TOO_FAST: "a drive would be too fast",
}
