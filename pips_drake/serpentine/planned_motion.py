"""What an arm is told to do: follow a path, or move its joints as they are given over time.

Everything that plans, runs, judges and draws asks through `PlannedMotion`, and need not know which
it is. How either moves over time is the station's matter (`station.motion`).
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.follow_the_leader import FollowTheLeader
from pips_drake.serpentine.joint_motion import JointMotion
from pips_drake.serpentine.plan import posture_deviation
from pips_drake.serpentine.tip_path import TipPath

Array = NDArray[np.float64]

#: Points at which the tip's way is drawn.
LINE_POINTS = 300
#: Between two looks at where the tip is, s, and at most so many of them besides the rows.
_LOOK, _MOST_LOOKS = 1.0 / 16.0, 20_000
#: How far the hand reaches aside of the last joint's axis, m: what turns there goes that way.
_HAND = 0.1


class PlannedMotion(Protocol):
    """A motion from home to its end; how far along it is, is a way in m."""

    @property
    def name(self) -> str:
        """For titles and messages."""

    @property
    def title(self) -> str:
        """What it is and its name, for a figure's title."""

    @property
    def mark_label(self) -> str:
        """What `marks` are, for a legend."""

    @property
    def version(self) -> str:
        """A fingerprint: equal if and only if the motion is the same."""

    @property
    def home(self) -> Array:
        """Joints (J,) m and rad at the beginning.

        Raises:
            InputError: there is no posture.
        """

    @property
    def start(self) -> float:
        """The way at the beginning, m."""

    @property
    def end(self) -> float:
        """The way at the end, m."""

    @property
    def tip_travel(self) -> float:
        """How far the tip goes, m."""

    @property
    def line(self) -> Array:
        """Points on the tip's way, to be drawn, (P, 3) m in frame {0}."""

    @property
    def marks(self) -> Array:
        """The points of it that were given, (R, 3) m in frame {0}."""

    def path_deviation(self, arm: SerpentineArm, joints: Array, ways: Array) -> Array | None:
        """Farthest point of the centre line from the path, (N,) m; None where there is no path.

        Args:
            arm: as it stands.
            joints: its postures, (N, J) m and rad.
            ways: where on its way it was sent, (N,) m.
        """


@dataclass(frozen=True, kw_only=True, eq=False)
class FollowedPath:
    """The tip goes along a path, and the arm follows it. A way is an arc length of the path."""

    path: TipPath
    solver: FollowTheLeader

    @property
    def name(self) -> str:
        return self.path.name

    @property
    def title(self) -> str:
        return f"path {self.path.name}"

    @property
    def mark_label(self) -> str:
        return "its points from home on"

    @property
    def version(self) -> str:
        return self.path.version

    @property
    def home(self) -> Array:
        home = self.solver.solve(self.path, [self.path.home_arc_length])
        if not home.solved[0]:
            raise InputError(self.solver.explain(self.path, home, 0))
        joints: Array = home.joints[0]
        return joints

    @property
    def start(self) -> float:
        return self.path.home_arc_length

    @property
    def end(self) -> float:
        return self.path.length

    @property
    def tip_travel(self) -> float:
        return self.path.travel

    @property
    def line(self) -> Array:
        return self.path.point(np.linspace(0.0, self.path.length, LINE_POINTS))

    @property
    def marks(self) -> Array:
        return self.path.point(self.path.marks)

    def path_deviation(self, arm: SerpentineArm, joints: Array, ways: Array) -> Array | None:
        solution = self.solver.solve(self.path, ways)
        return posture_deviation(arm, self.path, joints, solution.spine_arc_lengths)


@dataclass(frozen=True, kw_only=True, eq=False)
class GivenJoints:
    """The joints move as they are given. A way is what the fastest point of the arm has gone.

    That is some spine point, or the hand where it turns about the last axis: it goes on while
    anything moves, also where the tip rests.
    """

    arm: SerpentineArm
    motion: JointMotion
    name: str

    def __post_init__(self) -> None:
        joints = self.motion.joints.shape[1]
        if joints != self.arm.joints:
            raise InputError(
                f"joint motion '{self.name}': {joints} joints; must be the {self.arm.joints} of "
                f"arm '{self.arm.name}'"
            )

    @property
    def title(self) -> str:
        return f"joint motion {self.name}"

    @property
    def mark_label(self) -> str:
        return "where it begins and ends"

    @property
    def version(self) -> str:
        rows = np.ascontiguousarray(np.column_stack([self.motion.times, self.motion.joints]))
        return hashlib.sha256(rows.tobytes()).hexdigest()[:16]

    @property
    def home(self) -> Array:
        return self.motion.joints[0]

    @property
    def start(self) -> float:
        return 0.0

    @property
    def end(self) -> float:
        return float(self._ways[1][-1])

    @property
    def tip_travel(self) -> float:
        steps = np.diff(self._ways[2], axis=0)
        return float(np.linalg.norm(steps, axis=1).sum())

    @property
    def line(self) -> Array:
        times = np.linspace(0.0, self.motion.duration, 2 * LINE_POINTS)
        return self.spine(times)[:, -1]

    @property
    def marks(self) -> Array:
        # Rows are many and were not placed one by one; the ends are.
        return self._ways[2][[0, -1]]

    def path_deviation(self, arm: SerpentineArm, joints: Array, ways: Array) -> Array | None:
        return None

    def spine(self, times: ArrayLike) -> Array:
        """Spine points (N, M + 1, 3) m in frame {0} at times (N,) s."""
        return kinematics.spine_points(self.arm, self.motion.at(times))

    def way(self, time: float) -> tuple[float, float]:
        """How far along it is at a time (s), m, and its rate, m/s (at a row, that before it)."""
        times, ways, _ = self._ways
        row = min(max(int(np.searchsorted(times, time)) - 1, 0), len(times) - 2)
        rate = (ways[row + 1] - ways[row]) / (times[row + 1] - times[row])
        inside = min(max(time, 0.0), float(times[-1]))
        return float(ways[row] + rate * (inside - times[row])), float(rate)

    def times_at(self, ways: ArrayLike) -> Array:
        """When it has come so far (N,) m, (N,) s."""
        times, gone, _ = self._ways
        return np.interp(np.asarray(ways), gone, times)

    @cached_property
    def _ways(self) -> tuple[Array, Array, Array]:
        """Times (L,) s, ways (L,) m and tips (L, 3) m, close enough for chords to be arcs."""
        duration = self.motion.duration
        looks = min(_MOST_LOOKS, math.ceil(duration / _LOOK)) + 1
        times = np.union1d(self.motion.times, np.linspace(0.0, duration, looks))
        gone, tips = [np.zeros(1)], []
        before: Array | None = None
        # In parts: a long motion's frames would fill the memory.
        for part in np.array_split(times, max(1, len(times) // 5000)):
            spine, hand = self.spine(part), _HAND * self.motion.at(part)[:, -1:]
            tips.append(spine[:, -1])
            whole = np.concatenate([spine.reshape(len(part), -1), hand], axis=1)
            rows = whole if before is None else np.vstack([before, whole])
            steps, before = np.diff(rows, axis=0), rows[-1]
            points = np.linalg.norm(steps[:, :-1].reshape(len(steps), -1, 3), axis=2)
            gone.append(np.maximum(points.max(axis=1), np.abs(steps[:, -1])))
        return times, np.cumsum(np.concatenate(gone)), np.concatenate(tips)
