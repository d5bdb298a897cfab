"""Where on itself an arm that reached one goal begins its way to the next (CMU-92 section 3.3).

The arm lies on a line (in the document: the snake) from its base to its tip, of length L. It may
draw back until only the first s metres are exposed, and go on from there on the shortest path, d(s)
long. Two things can be kept small:

- the tip's way, (L - s) back and d(s) on: for scanning, and to save time;
- the exposed length, s + d(s): for small loads, and less to collide with.

The line itself is a way for the arm, so that d(s) <= (t - s) + d(t) for s < t. Hence the first
never grows with s, and the second never falls: the least tip travel is from where the tip is
(s = L), the least exposed length from the base (s = 0). But the latter would draw the arm back even
where that gains nothing: so it is drawn back no farther than to where the exposed length is the
least but for a small share, which halving finds. (Where ways slide into each other, `retraction`,
an arm need not be drawn back even so far: but only if it moves sideways with its snake, which makes
what is kept of the line as short as it would be from the base. Here the line stays as it lies; who
wants the document's rule all the same has it as `OriginRule.SAME_CLASS`.) When the way from there
needs more arm than there is, the arm is drawn back after all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError, NotFollowableError
from pips_drake.planning.grid_search import NoPathError, find_path, nearest_free_cells
from pips_drake.planning.occupancy import Occupancy
from pips_drake.planning.quick_pull import pull_quickly
from pips_drake.planning.retraction import retraction_point

Array = NDArray[np.float64]

#: Exposed lengths that differ by less than this share count as equal.
SAME_LENGTH = 0.02
_HALVINGS = 6


class OriginRule(Enum):
    """What is kept small when an arm goes from one goal to the next."""

    LEAST_TIP_TRAVEL = "least_tip_travel"
    LEAST_EXPOSED_LENGTH = "least_exposed_length"
    #: Not farther out than where the base's own way begins to differ (`retraction`, Figure 3.3).
    SAME_CLASS = "same_class"


@dataclass(frozen=True, eq=False)
class Extension:
    """How an arm on a line gets to a goal.

    Attributes:
        rule: what was kept small; the other one than asked for if the arm was too short for that.
        origin: length of the line that the arm keeps, m from its base.
        path: from there to the goal, pulled tight, (N, 3) m in the world.
        line: from the base to the goal, (M, 3) m.
        exposed_length: of that line, m.
        tip_travel: how far the tip goes, back and on, m.
    """

    rule: OriginRule
    origin: float
    path: Array
    line: Array
    exposed_length: float
    tip_travel: float


def extend(
    occupancy: Occupancy,
    line: ArrayLike,
    goal: ArrayLike,
    *,
    rule: OriginRule,
    arm_length: float = math.inf,
) -> Extension:
    """How an arm that lies on a line gets to a goal.

    Args:
        occupancy: where it may go.
        line: from its base to its tip, (N, 3) m in the world; clear. What of it lies outside the
            grid, before a port for example, is kept.
        goal: (3,) m.
        rule: what to keep small.
        arm_length: the most that can be exposed, m.

    Raises:
        InputError: the line, or the goal, is not one for this workspace.
        NoPathError: there is no way to the goal.
        NotFollowableError: the arm is too short for the shortest way from its base.
    """
    points = np.asarray(line, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 1:
        raise InputError(f"arm's line of shape {points.shape}; must be (N, 3)")
    search = _Search(occupancy, points, np.asarray(goal, dtype=np.float64))
    if rule is OriginRule.LEAST_TIP_TRAVEL:
        found = search.begin_at(search.length, rule)
        if found.exposed_length <= arm_length:
            return found
    if rule is OriginRule.SAME_CLASS and len(points) > 1:
        where = retraction_point(occupancy, points, goal).origin
        found = search.begin_at(where, rule)
        if found.exposed_length <= arm_length:
            return found
    rule = OriginRule.LEAST_EXPOSED_LENGTH
    first = search.first_inside()
    found = search.begin_at(first, rule)
    if found.exposed_length > arm_length:
        raise NotFollowableError(
            f"the goal needs {found.exposed_length:.4g} m of arm from its base, by the shortest "
            f"way; must be {arm_length:.4g} m or less, which is what there is"
        )
    most = min((1.0 + SAME_LENGTH) * found.exposed_length, arm_length)
    low, high = first, search.length
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        try:
            other = search.begin_at(middle, rule)
        except (InputError, NoPathError):  # nearer to an obstacle than this grid lets one begin
            other = None
        if other is not None and other.exposed_length <= most:
            low, found = middle, other
        else:
            high = middle
    return found


class _Search:
    """Ways to a goal from points of a line."""

    def __init__(self, occupancy: Occupancy, line: Array, goal: Array) -> None:
        self._occupancy = occupancy
        self._line = line
        self._goal = goal
        steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
        self._arc_lengths = np.concatenate([[0.0], np.cumsum(steps)])

    @property
    def length(self) -> float:
        """Of the line, m."""
        return float(self._arc_lengths[-1])

    def begin_at(self, origin: float, rule: OriginRule) -> Extension:
        """The way that leaves the line at an arc length, m."""
        kept = self._kept(origin)
        path = find_path(self._occupancy, kept[-1], self._goal)
        pulled = pull_quickly(self._occupancy.field, path.points, self._occupancy.radius)
        length = float(np.linalg.norm(np.diff(pulled, axis=0), axis=1).sum())
        return Extension(
            rule=rule,
            origin=origin,
            path=pulled,
            line=np.concatenate([kept, pulled[1:]]),
            exposed_length=origin + length,
            tip_travel=self.length - origin + length,
        )

    def first_inside(self) -> float:
        """Where the line first is in the grid and sees a free cell, m; at cells' distances."""
        spacing = float(self._occupancy.grid.least_lengths.min())
        count = max(2, int(self.length / spacing) + 2)
        arcs = np.linspace(0.0, self.length, count)
        points = np.stack([self._point(arc) for arc in arcs])
        inside = nearest_free_cells(self._occupancy, points)[:, 0] >= 0
        return float(arcs[np.argmax(inside)]) if inside.any() else self.length

    def _point(self, arc: float) -> Array:
        return np.array([np.interp(arc, self._arc_lengths, x) for x in self._line.T])

    def _kept(self, origin: float) -> Array:
        """The line up to an arc length, (N, 3) m."""
        before = self._line[self._arc_lengths < origin]
        return np.concatenate([before, self._point(origin)[None]])
