"""The shortest path on a grid between points in the world, or what is in its way (CMU-92)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError, NotFollowableError
from pips_drake.planning.a_star import CLOSED, ONWARD, search, walk_back
from pips_drake.planning.grid import STEPS, Cells, cell_centre
from pips_drake.planning.line_of_sight import segment_blocked
from pips_drake.planning.occupancy import BLOCKED, Occupancy

Array = NDArray[np.float64]

#: Rings of cells around a point in which a free one is looked for that it sees.
_RINGS = 3


class NoPathError(NotFollowableError):
    """There is no way on the grid.

    Attributes:
        nearest: the point, in the world, nearest to the goal that can be reached, (3,) m.
        distance: how far the goal is from it, m.
        blockers: the shapes that stand between, the most frequent first; none where the nearest
            point sees the goal.
    """

    def __init__(
        self, message: str, *, nearest: Array, distance: float, blockers: Sequence[str]
    ) -> None:
        self.nearest = nearest
        self.distance = distance
        self.blockers = tuple(blockers)
        super().__init__(message)


@dataclass(frozen=True, eq=False)
class GridPath:
    """A shortest path on a grid.

    Attributes:
        points: start, the centres of the cells passed, goal; in the world, (N, 3) m. Where start or
            goal is itself a centre, it stands there once.
        cost: length from the first cell's centre to the last one's, plus the source's own cost, m.
        source: which of the sources the path begins at; 0 if there is but one.
        visited: number of cells whose cost became known.
    """

    points: Array
    cost: float
    source: int
    visited: int

    @property
    def length(self) -> float:
        """From start to goal, m."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())


def find_path(occupancy: Occupancy, start: ArrayLike, goal: ArrayLike) -> GridPath:
    """The shortest path on the grid between two points (3,) m in the world.

    Raises:
        InputError: start or goal is not in the grid, or nearer to an obstacle than the radius.
        NoPathError: says how near to the goal one gets, and what blocks the way.
    """
    return find_path_from_any(occupancy, np.atleast_2d(np.asarray(start, float)), [0.0], goal)


def find_path_from_any(
    occupancy: Occupancy, starts: ArrayLike, costs: ArrayLike, goal: ArrayLike
) -> GridPath:
    """The path of least cost from any of several points.

    Args:
        starts: (N, 3) m in the world. Those that see no free cell are left out if others do.
        costs: what it costs to begin there, (N,) m.
        goal: (3,) m.

    Raises:
        InputError: the goal, or all starts, are not in the grid or too near to an obstacle.
        NoPathError: there is no way.
    """
    grid = occupancy.grid
    p = np.ascontiguousarray(starts, dtype=np.float64)
    target = np.ascontiguousarray(goal, dtype=np.float64)
    _check_point("goal", target)
    goal_cell = nearest_free_cells(occupancy, target[None])[0]
    cells = nearest_free_cells(occupancy, p)
    if goal_cell[0] < 0:
        raise InputError(_why_not_free(occupancy, "goal", target))
    seen = np.flatnonzero(cells[:, 0] >= 0)
    if not seen.size:
        for point in p:
            _check_point("start", point)
        raise InputError(_why_not_free(occupancy, "start", p[-1]))
    begin = np.asarray(costs, dtype=np.float64)[seen]
    cost, state, parent, visited = search(
        occupancy.padded,
        cells[seen] + 1,
        begin,
        goal_cell + 1,
        STEPS,
        grid.step_costs,
        grid.least_lengths,
        grid.periodic,
        not grid.unfolded,
        *ONWARD,
    )
    if not math.isfinite(cost):
        raise _no_path(occupancy, target, state)
    walked, source = walk_back(parent, STEPS, goal_cell + 1, grid.periodic)
    centres = grid.centres(walked - 1)
    first = int(seen[source])
    points = np.concatenate([p[first][None], centres, target[None]])
    moved = np.linalg.norm(np.diff(points, axis=0), axis=1) > 0.0
    return GridPath(
        points=points[np.concatenate([[True], moved])], cost=cost, source=first, visited=visited
    )


def nearest_free_cells(occupancy: Occupancy, points: ArrayLike) -> Cells:
    """The nearest free cells (N, 3) whose centres points (N, 3) m see; rows of -1 without one."""
    p = np.ascontiguousarray(points, dtype=np.float64)
    _check_points(p)
    grid = occupancy.grid
    return np.asarray(
        _free_cells(
            grid.arrays,
            occupancy.padded,
            occupancy.field.arrays,
            occupancy.radius,
            p,
            grid.cells(p),
            grid.periodic,
        )
    )


def _check_points(points: Array) -> None:
    for point in points:
        _check_point("point", point)


def _check_point(name: str, point: Array) -> None:
    if point.shape != (3,) or not np.isfinite(point).all():
        raise InputError(f"{name} = {point.tolist()} m; must be three finite numbers")


def _place(point: Array) -> str:
    return "(" + ", ".join(f"{x + 0.0:.4g}" for x in np.round(point, 6)) + ") m"


def _why_not_free(occupancy: Occupancy, name: str, point: Array) -> str:
    """Why an arm's middle cannot be at a point."""
    grid, radius = occupancy.grid, occupancy.radius
    cell = grid.cells(point[None])[0]
    if (cell < 0).any() or (cell >= grid.shape).any():
        return f"{name} {_place(point)} is outside the workspace"
    found = occupancy.field.nearest(point[None])
    distance = float(found.distances[0])
    if distance < radius:
        label = occupancy.field.label(int(found.indices[0]))
        where = f"{-distance:.3g} m inside" if distance < 0.0 else f"{distance:.3g} m from"
        return f"{name} {_place(point)} is {where} {label}; must be {radius:.3g} m or more from it"
    return (
        f"{name} {_place(point)} sees no free cell of the grid within {_RINGS} cells; use a finer "
        "grid"
    )


def _no_path(occupancy: Occupancy, goal: Array, state: NDArray[np.uint8]) -> NoPathError:
    """Says how far the search came, and what is in the way from there straight to the goal."""
    grid = occupancy.grid
    cells, distances = _nearest_reached(grid.arrays, state, goal, 2.0 * grid.longest_step)
    centres = grid.centres(cells)
    blockers = _first_blockers(occupancy.field.arrays, centres, goal, occupancy.radius)
    best = int(np.argmin(distances))
    names: list[str] = []
    if blockers[best] >= 0:
        shapes, counts = np.unique(blockers[blockers >= 0], return_counts=True)
        names = [occupancy.field.label(int(m)) for m in shapes[np.argsort(-counts, kind="stable")]]
    nothing = "no obstacle, but the workspace's edge or a gap too narrow for the grid's cells"
    in_the_way = ", ".join(names[:4]) or nothing
    return NoPathError(
        f"no way to the goal {_place(goal)} for an arm of {occupancy.radius:.3g} m radius: it gets "
        f"within {distances[best]:.3g} m, at {_place(centres[best])}; in the way: {in_the_way}",
        nearest=centres[best],
        distance=float(distances[best]),
        blockers=names,
    )


@numba.njit(cache=True)
def _free_cells(grid, padded, field, radius, points, cells, periodic):
    found = np.full((points.shape[0], 3), -1, dtype=np.int64)
    side = 2 * _RINGS + 1
    places = np.empty((side * side * side, 3), dtype=np.int64)
    distances = np.empty(side * side * side)
    centre = np.empty(3)
    for row in range(points.shape[0]):
        p, count = points[row], 0
        for di in range(-_RINGS, _RINGS + 1):
            for dj in range(-_RINGS, _RINGS + 1):
                for dk in range(-_RINGS, _RINGS + 1):
                    i, j, k = cells[row, 0] + di, cells[row, 1] + dj, cells[row, 2] + dk
                    if periodic:
                        j = j % grid.shape[1]
                    if not (
                        0 <= i < grid.shape[0]
                        and 0 <= j < grid.shape[1]
                        and 0 <= k < grid.shape[2]
                        and padded[i + 1, j + 1, k + 1] != BLOCKED
                    ):
                        continue
                    x, y, z = cell_centre(grid, i, j, k)
                    places[count, 0], places[count, 1], places[count, 2] = i, j, k
                    distances[count] = (x - p[0]) ** 2 + (y - p[1]) ** 2 + (z - p[2]) ** 2
                    count += 1
        for n in np.argsort(distances[:count], kind="mergesort"):
            i, j, k = places[n, 0], places[n, 1], places[n, 2]
            centre[0], centre[1], centre[2] = cell_centre(grid, i, j, k)
            _, shape = segment_blocked(field, p, centre, radius)
            if shape < 0:
                found[row, 0], found[row, 1], found[row, 2] = i, j, k
                break
    return found


@numba.njit(cache=True)
def _nearest_reached(grid, state, goal, band):
    """The reached cell nearest to the goal, and those up to `band` (m) farther from it.

    Returns:
        Cells (N, 3), at most 1000 of them, the nearest one among them; their distances, (N,) m.
    """
    n0, n1, n2 = grid.shape[0], grid.shape[1], grid.shape[2]
    least = np.inf
    cells, distances = np.empty((1000, 3), dtype=np.int64), np.empty(1000)
    for only_least in (True, False):
        count = 0
        for i in range(n0):
            for j in range(n1):
                for k in range(n2):
                    if state[i + 1, j + 1, k + 1] != CLOSED:
                        continue
                    x, y, z = cell_centre(grid, i, j, k)
                    d = math.sqrt((x - goal[0]) ** 2 + (y - goal[1]) ** 2 + (z - goal[2]) ** 2)
                    if only_least:
                        least = min(least, d)
                    elif d == least or (d <= least + band and count < 999):
                        cells[count, 0], cells[count, 1], cells[count, 2] = i, j, k
                        distances[count] = d
                        count += 1
                        if count == 1000:
                            return cells, distances
    return cells[:count], distances[:count]


@numba.njit(cache=True)
def _first_blockers(field, centres, goal, radius):
    """The first shape in the way from each of some points straight to the goal, (N,); -1: none."""
    shapes = np.empty(centres.shape[0], dtype=np.int64)
    for i in range(centres.shape[0]):
        _, shapes[i] = segment_blocked(field, centres[i], goal, radius)
    return shapes
