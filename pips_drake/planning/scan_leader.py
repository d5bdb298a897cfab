"""An arm that is led by its snake's end, posture by posture (`scan_motion` says what for)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.planning.grid_search import NoPathError
from pips_drake.planning.occupancy import Occupancy
from pips_drake.planning.planner import GoalPlan, PlannerSettings, home_of, plan_to_goal
from pips_drake.planning.snake import Snake, move_goal
from pips_drake.planning.snake_motion import settle
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.follow_the_leader import FollowTheLeader
from pips_drake.serpentine.plan import joint_margins
from pips_drake.serpentine.pointing import make_mount
from pips_drake.serpentine.tip_path import TipPath, polyline_path

Array = NDArray[np.float64]
Stages = NDArray[np.int64]

#: What the arm does at a row of its motion.
APPROACH, SCAN, DETOUR, CHANGE, LEAP = range(5)
STAGE_NAMES = ("approach", "scan", "detour", "change-over", "leap")
#: Of rows along a path, m.
ROW_STEP = 0.07
#: Between rows the arm moves straight in its joints: by so much its centre line may come nearer to
#: an obstacle than the workspace's radius, m. What its bodies keep is said in the end.
_CHORD = 0.01
#: And the camera head, beside its own half diagonal, at least so far, m.
_HEAD_MARGIN = 0.02
#: Points on a link whose distances are looked at.
_ON_LINK = 6
#: Steps are halved so often where the arm would move too far at once.
_MOST_HALVINGS = 3
#: No hinge turns more than this from one row to the next of a leap that is taken slowly, rad.
_SLOW = math.radians(2.0)
#: Rows by which an arm that changes over draws back farther before it tries to go over.
_DRAW_BACK = 3
#: To which of its earlier snakes it goes back if it cannot draw back along the last one.
_BACK = (1, 2, 4, 8, 16, 32, 64)
#: A snake has so many steps to follow its end, which moves on before it rests in every digit: ten
#: are typical, and one that creeps along an obstacle takes thousands.
_SETTLING = 60
#: It has followed when no point moves farther in a step, m.
_SETTLED = 1e-4
#: Ways from home are laid with snakes so many times as stiff, until the arm can lie on one: a stiff
#: snake bends less sharply, and keeps a smaller distance from obstacles.
_STIFFNESSES = (1.0, 3.0, 10.0)
#: Beyond its limit a joint is told to be by more than this, m and rad.
_ROUNDING = 1e-9


class StuckError(Exception):
    """The arm cannot go on; the text says why."""


class Leader:
    """Leads an arm by its snake's end, and records the joints.

    The arm lies on the polyline of the snake's points: rounding its corners would cost ten times as
    much as the settling, and changes joints by about 0.1 deg at a spacing of 0.1 m.

    Args:
        home_tip: as of `plan_to_goal`.
        lag: how far the tip trails behind the snake's end, m.
        leap: more than this no hinge turns from one row to the next, rad.

    Attributes:
        shift: where the arm's frame {0} stands in frame_0, (3,) m.
        reach, head_radius: of the camera head: how far it goes on beyond the tip, and how far its
            middle must be from obstacles, m.
        swings: how far a hinge turned where the snake went from one rest to another, rad each.
    """

    def __init__(
        self,
        arm: SerpentineArm,
        occupancy: Occupancy,
        *,
        home_tip: ArrayLike | None,
        settings: PlannerSettings,
        lag: float,
        leap: float,
    ) -> None:
        self.arm, self.occupancy, self.settings, self.lag = arm, occupancy, settings, lag
        self.leap = leap
        self.swings: list[float] = []
        self._home_tip = home_tip
        self._home, self._along, self._base = home_of(arm, home_tip)
        self.shift = np.zeros(3)
        self._solver = FollowTheLeader(arm)
        self.reach = make_mount(arm).reach
        self.head_radius = 0.5 * math.hypot(*arm.bodies[-1].size[1:]) + _HEAD_MARGIN
        self._rows: list[tuple[Array, int, int]] = []
        self._snake: Snake | None = None
        # Snakes that the arm lay on, and how many rows there were then.
        self._history: list[tuple[int, Snake]] = []

    @property
    def snake_points(self) -> Array:
        """Of the snake, from the home tip, (N, 3) m in frame_0."""
        assert self._snake is not None
        return self._snake.points[1:].copy()

    @property
    def joints(self) -> Array:
        """The last ones recorded, (J,)."""
        return self._rows[-1][0]

    def recorded(self) -> tuple[Array, Stages, Stages]:
        """Joints (K, J), stages (K,) and rows of the pattern (K,); rows that rest are left out."""
        joints, stages, rows = map(np.array, zip(*self._rows, strict=True))
        kept = np.append(True, np.abs(np.diff(joints, axis=0)).max(axis=1) > 1e-12)
        return joints[kept], stages[kept], rows[kept]

    def begin(self, place: Array) -> GoalPlan:
        """Goes from home to a place (3,) m.

        Raises:
            InputError, NoPathError: as of `plan_to_goal`.
            StuckError: the arm cannot.
        """
        reasons = []
        for stiffness in _STIFFNESSES:
            plan = self._plan(place, stiffness)
            self.shift = plan.shift
            snake = self._headed(plan.settled.snake)
            path = self._path(snake.points[1:])
            try:
                tips = self._marks(path.home_arc_length, self._tip(path))
                joints = self._checked(self._solved(path, tips))
            except StuckError as reason:
                reasons.append(str(reason))
                continue
            self._record(joints, APPROACH)
            self._rows[-1] = (self.joints, SCAN, 0)
            self._snake = snake
            self._history.append((len(self._rows), snake))
            return plan
        raise StuckError(reasons[0])

    def advance(self, place: Array, stage: int, row: int, halvings: int = 0) -> None:
        """Moves the snake's end to a place (3,) m, in several steps where the arm moves far.

        Raises:
            StuckError: the arm cannot; what was done of the way is recorded.
        """
        assert self._snake is not None
        snake = self._settled(move_goal(self._snake, place))
        path = self._path(snake.points[1:])
        joints = self._solved(path, np.array([self._tip(path)]))[0]
        turn = float(np.abs(joints - self.joints)[1:].max())
        if turn > self.leap and halvings < _MOST_HALVINGS:
            middle = 0.5 * (self._snake.points[-1] + place)
            self.advance(middle, stage, -1, halvings + 1)
            self.advance(place, stage, row, halvings + 1)
            return
        if turn > self.leap:
            # The snake has gone from one rest to another: over the saddle as slowly as wanted.
            between = self._checked(_straight(self.joints, joints))
            self._record(between, LEAP)
            self.swings.append(turn)
            self._rows[-1] = (joints, stage, row)
        else:
            self._checked(np.stack([0.5 * (self.joints + joints), joints]))
            self._record(joints[None], stage, row)
        self._snake = snake
        self._history.append((len(self._rows), snake))

    def change_over(self, place: Array, row: int) -> None:
        """Draws back as far as need be, and goes to a place along the shortest way from home.

        Raises:
            StuckError: there is no such way, or the arm cannot; nothing is recorded then.
        """
        reasons = []
        for stiffness in _STIFFNESSES:
            try:
                plan = self._plan(place, stiffness)
                self._change_to(self._headed(plan.settled.snake))
            except (InputError, NoPathError, StuckError) as reason:
                reasons.append(str(reason))
                continue
            self._rows[-1] = (self.joints, SCAN, row)
            return
        raise StuckError(f"along the shortest way from home: {reasons[0]}")

    def _change_to(self, snake: Snake) -> None:
        """Draws back along the snake, or goes back to an earlier one that lets it, and over."""
        new = self._path(snake.points[1:])
        home, goal = new.home_arc_length, self._tip(new)
        # The way there first: if the arm cannot lie on it, nothing else matters.
        self._checked(self._solved(new, self._marks(home, goal)))
        for back in _BACK:
            if back > len(self._history):
                break
            count, earlier = self._history[-back]
            old = self._path(earlier.points[1:])
            tips = self._marks(self._tip(old), home)
            drawn = self._as_far_as_it_can(old, tips)
            for k in range(0, len(drawn), _DRAW_BACK):
                if tips[k] > goal:
                    continue
                try:
                    across = self._checked(
                        _straight(drawn[k], self._solved(new, tips[k : k + 1])[0])
                    )
                except StuckError:
                    continue
                again = np.array([q for q, _, _ in self._rows[count - 1 :]])[::-1]
                forth = self._solved(new, self._marks(float(tips[k]), goal))
                for part in (again, drawn[: k + 1], across, forth):
                    self._record(part, CHANGE)
                self._snake = snake
                self._history.append((len(self._rows), snake))
                return
        raise StuckError("the arm cannot draw back along its own way")

    def _as_far_as_it_can(self, path: TipPath, tips: Array) -> Array:
        """Joints (K, J) with the tip at the first K places (m) of a path that the arm can be at."""
        solution = self._solver.solve(path, tips)
        for k, joints in enumerate(solution.joints):
            try:
                if not solution.solved[k]:
                    break
                self._checked(joints[None])
            except StuckError:
                break
        else:
            k = len(tips)
        found: Array = solution.joints[:k]
        return found

    def _plan(self, place: Array, stiffness: float) -> GoalPlan:
        """From home, with a snake so many times as stiff as the settings have it."""
        soft = self.settings.snake
        snake = replace(soft, bending_stiffness=stiffness * soft.bending_stiffness)
        return plan_to_goal(
            self.arm,
            self.occupancy,
            place,
            home_tip=self._home_tip,
            settings=replace(self.settings, snake=snake),
        )

    def _record(self, joints: Array, stage: int, row: int = -1) -> None:
        self._rows += [(q, stage, row) for q in joints]

    def _settled(self, snake: Snake) -> Snake:
        repulsion, blend = self.settings.repulsion, self.settings.blend

        def distances(points: Array) -> tuple[Array, Array]:
            return self.occupancy.field.blended(points, blend=blend, within=repulsion.reach)

        return settle(snake, distances, repulsion, max_steps=_SETTLING, tolerance=_SETTLED).snake

    def _headed(self, snake: Snake) -> Snake:
        """The snake with a point before home, which says where it heads there."""
        before = self._home - self.settings.snake.spacing * self._along
        return replace(
            snake,
            points=np.vstack([before, snake.points]),
            nailed=np.append(True, snake.nailed),
            tension=np.append(snake.tension[0], snake.tension),
            bending_stiffness=np.append(snake.bending_stiffness[0], snake.bending_stiffness),
        )

    def _path(self, points: Array) -> TipPath:
        """In the arm's own frame {0}."""
        return polyline_path(np.vstack([self._base, points]) - self.shift, "scan")

    def _tip(self, path: TipPath) -> float:
        return max(path.length - self.lag, path.home_arc_length)

    def _marks(self, first: float, last: float) -> Array:
        count = max(1, math.ceil(abs(last - first) / ROW_STEP))
        return np.linspace(first, last, count + 1)

    def _solved(self, path: TipPath, tips: ArrayLike) -> Array:
        solution = self._solver.solve(path, tips)
        failed = np.flatnonzero(~solution.solved)
        if failed.size:
            raise StuckError(self._solver.explain(path, solution, int(failed[0])))
        return solution.joints

    def _checked(self, joints: Array) -> Array:
        """The joints (K, J), if they are within their limits and the centre line is clear."""
        margins = joint_margins(self.arm, joints)
        if margins.min() < -_ROUNDING:
            row, j = (int(k) for k in np.unravel_index(np.argmin(margins), margins.shape))
            raise StuckError(self._limit_words(j, float(joints[row, j])))
        poses = kinematics.frames(self.arm, joints)
        corners = poses[:, self.arm.first_actuated_joint :, :3, 3] + self.shift
        # The camera head goes on where the last link points, and is thinner.
        head = corners[:, -1] + self.reach * poses[:, -1, :3, 0]
        corners = np.concatenate([corners, head[:, None]], axis=1)
        shares = (np.arange(1, _ON_LINK + 1) / _ON_LINK)[:, None]
        points = corners[:, :-1, None] + shares * np.diff(corners, axis=1)[:, :, None]
        near = self.occupancy.field.nearest(points.reshape(-1, 3))
        needed = np.full(points.shape[:3], self.occupancy.radius - _CHORD)
        needed[:, -1] = self.head_radius
        k = int(np.argmin(near.distances - needed.ravel()))
        if near.distances[k] < needed.ravel()[k]:
            raise StuckError(
                f"its centre line would be {near.distances[k]:.3f} m from "
                f"{self.occupancy.field.label(int(near.indices[k]))}; must be "
                f"{needed.ravel()[k]:.3f} m or more"
            )
        return joints

    def _limit_words(self, j: int, value: float) -> str:
        arm = self.arm
        limits = f"{arm.joint_lower[j]:.3f} .. {arm.joint_upper[j]:.3f} m"
        if arm.is_prismatic[j]:
            return f"the arm is too short: {arm.joint_names[j]} = {value:.3f} m; must be {limits}"
        degrees = np.degrees([value, arm.joint_lower[j], arm.joint_upper[j]])
        return (
            f"joint {arm.joint_names[j]} = {degrees[0]:.1f} deg; must be {degrees[1]:.1f} .. "
            f"{degrees[2]:.1f} deg"
        )


def _straight(first: Array, last: Array) -> Array:
    """Joints (K, J) from one posture to another, both included."""
    count = max(1, math.ceil(float(np.abs(last - first).max()) / _SLOW))
    return first + np.linspace(0.0, 1.0, count + 1)[:, None] * (last - first)
