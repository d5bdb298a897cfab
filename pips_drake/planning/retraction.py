"""How far an arm draws back before it goes on to a new goal (CMU-92 section 3.3, Figure 3.3).

The arm may leave its present line at any place of it; the farther back, the less of it is exposed,
and the farther the tip travels. From places along the line, the base's first, the shortest paths to
the new goal are sought. A snake from the base, over the part of the line that is kept, to the goal
comes to rest at the same place from any two neighbouring ones as long as nothing stands between
them. So all places up to the first pair with something between give the snake that the base gives,
which is the shortest, and of these the one farthest out costs the least way of the tip: the arm
draws back to there. Beyond, the snake would come to lie on the other side of something.

That is the rule for an arm that moves with its snake while that settles. An arm that only follows
its own tip keeps the line as it lies, bends and all: for that, `origins.extend` looks at the length
of the line itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.planning.grid_search import NoPathError, find_path
from pips_drake.planning.occupancy import Occupancy
from pips_drake.planning.path_classes import Surface
from pips_drake.planning.quick_pull import pull_quickly
from pips_drake.planning.sliding import Met, what_they_meet

Array = NDArray[np.float64]

#: Places along the arm's line from which paths are sought.
PLACES = 8


@dataclass(frozen=True, eq=False)
class Candidate:
    """A way to the goal from a place on the arm's line.

    Attributes:
        origin: where the line is left, m from its beginning.
        path: from there to the goal, (N, 3) m: as the search found it, not pulled tight.
        line: the part of the arm's line that is kept, and the path, (M, 3) m.
    """

    origin: float
    path: Array
    line: Array


@dataclass(frozen=True, eq=False)
class Neighbours:
    """Two candidates one after the other, with the ends of the one farther back.

    Attributes:
        near, far: their origins, m along the line, near < far.
        path_near, path_far: from the place at `near` to the goal: straight away, and along the line
            to the place at `far` first; (N, 3), (M, 3) m.
        met: what is between them; None if they slide into each other.
    """

    near: float
    far: float
    path_near: Array
    path_far: Array
    met: Met | None

    @property
    def same(self) -> bool:
        """Whether snakes laid on them are predicted to come to rest at the same place."""
        return self.met is None


@dataclass(frozen=True, eq=False)
class Retraction:
    """How far an arm draws back.

    Attributes:
        origin: length of the line that it keeps, m.
        chosen: the way from there, pulled tight.
        stopped_by: what stands between the chosen way and that from the next place farther out;
            None where the arm need not draw back.
        candidates: all the ways that were looked at, from the base's on, not pulled; what was
            chosen is the last or, with something beyond it, the last but one.
    """

    origin: float
    chosen: Candidate
    stopped_by: Met | None
    candidates: tuple[Candidate, ...]


def retraction_point(
    occupancy: Occupancy,
    line: ArrayLike,
    goal: ArrayLike,
    *,
    places: int = PLACES,
    clearance: float = 0.0,
) -> Retraction:
    """How far an arm on a line draws back, before it goes on to a goal.

    Args:
        occupancy: where it may go.
        line: from the arm's base to its tip, (N, 3) m in the world; clear.
        goal: (3,) m.
        places: how many, at equal shares of the line, are looked at; 2 or more. Those that the grid
            lets no arm begin at, before a port for example, are left out.
        clearance: nearer than this to an obstacle's surface paths do not slide, m.

    Raises:
        InputError: the line is no line; the goal or all places are outside the workspace or too
            near to an obstacle.
        NoPathError: there is no way from any place.
    """
    points, arcs = _checked(line, places)
    found: list[Candidate] = []
    why: InputError | NoPathError | None = None
    met: Met | None = None
    for arc in np.linspace(0.0, arcs[-1], places):
        try:
            found.append(candidate_from(occupancy, points, float(arc), goal))
        except (InputError, NoPathError) as error:
            why = why or error
            continue
        if len(found) > 1:
            met = neighbours(occupancy, points, *found[-2:], clearance=clearance).met
            if met is not None:
                break
    if not found:
        assert why is not None
        raise why
    chosen = found[-1] if met is None else found[-2]
    pulled = pull_quickly(occupancy.field, chosen.path, occupancy.radius)
    kept = chosen.line[: len(chosen.line) - len(chosen.path) + 1]
    tight = Candidate(chosen.origin, pulled, np.concatenate([kept, pulled[1:]]))
    return Retraction(chosen.origin, tight, met, tuple(found))


def candidate_from(
    occupancy: Occupancy, line: ArrayLike, origin: float, goal: ArrayLike
) -> Candidate:
    """The way to a goal that leaves a line (N, 3) m at an arc length, m.

    Raises:
        InputError, NoPathError: as of `find_path`.
    """
    points, arcs = _checked(line, 2)
    kept = np.vstack([points[arcs < origin], _at(points, arcs, origin)])
    path = find_path(occupancy, kept[-1], goal).points
    return Candidate(origin, path, np.concatenate([kept, path[1:]]))


def neighbours(
    occupancy: Occupancy,
    line: ArrayLike,
    near: Candidate,
    far: Candidate,
    *,
    clearance: float = 0.0,
) -> Neighbours:
    """Whether the ways from two places on a line (N, 3) m slide into each other.

    In unfolded coordinates, where no straight surface between them is clear, ways of one class
    (`path_classes`) slide on a bent one, past all that classes know of: if nothing else is between.
    """
    points, arcs = _checked(line, 2)
    between = points[(arcs > near.origin) & (arcs < far.origin)]
    start = _at(points, arcs, near.origin)
    longer = np.concatenate([start[None], between, far.path])
    met = what_they_meet(occupancy, near.path, longer, clearance=clearance)
    if met is not None and occupancy.grid.unfolded:
        surface = _surface(occupancy)
        if surface.word(near.path) == surface.word(longer):
            others = replace(occupancy, field=surface.others)
            met = what_they_meet(others, near.path, longer, clearance=clearance)
    return Neighbours(near.origin, far.origin, near.path, longer, met)


@lru_cache(maxsize=2)
def _surface(occupancy: Occupancy) -> Surface:
    """Found once for all pairs: an occupancy never changes."""
    return Surface.of(occupancy)


def _checked(line: ArrayLike, places: int) -> tuple[Array, Array]:
    """The line's points and their arc lengths, m."""
    points = np.asarray(line, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 1 or not np.isfinite(points).all():
        raise InputError(f"arm's line of shape {points.shape}; must be (N, 3) finite numbers")
    if places < 2:
        raise InputError(f"places on the arm's line = {places}; must be 2 or more")
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return points, np.concatenate([[0.0], np.cumsum(steps)])


def _at(points: Array, arcs: Array, arc: float) -> Array:
    return np.array([np.interp(arc, arcs, x) for x in points.T])
