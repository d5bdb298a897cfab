"""A workspace cut into cells: which of them the middle of an arm may visit.

A cell stands for its centre, and a path on the grid is the polyline through the centres of cells
that touch (by a face, an edge or a corner: 26 neighbours), whatever the coordinates are. So the
cost of a step is the straight distance between two centres in the world, in unfolded coordinates
too, and a path's cost is its length in metres.

Obstacles are grown by the arm's radius r. Along a step of length L between two centres, both at
distance d from every obstacle, no point is nearer to one than sqrt(d^2 - L^2 / 4): so a cell is
free where d >= sqrt(r^2 + L^2 / 4) with the longest step L of the grid. Then every step, not only
every centre, keeps the radius, and what is lost of narrow gaps is second order in the cells' size.

Unfolded coordinates (along, around, out) are cylindrical ones, named after CMU-92's view of the gap
between payload and cargo bay "unfolded into a surface": along the axis (m), around it (rad), out
from it (m). Straight in the world is not straight there; lengths are those of the world.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.scene.shape_distance import distance_to_shape, least_distance
from pips_drake.scene.signed_distance import SignedDistanceField

Array = NDArray[np.float64]
Cells = NDArray[np.int64]

#: The 26 steps from a cell to its neighbours, (26, 3).
STEPS = np.array(
    [
        (i, j, k)
        for i in (-1, 0, 1)
        for j in (-1, 0, 1)
        for k in (-1, 0, 1)
        if (i, j, k) != (0, 0, 0)
    ],
    dtype=np.int64,
)
#: States of cells in `Occupancy.padded`.
BLOCKED, FREE, INNER = 0, 1, 2
#: More cells than this do not fit into the memory of a small machine: a search takes 10 bytes each.
MOST_CELLS = 100_000_000
# Cells along each side of blocks that are looked at together.
_BLOCK, _SMALL_BLOCK = 8, 2


class GridArrays(NamedTuple):
    """A grid for compiled code; see `Grid`."""

    unfolded: bool
    rotation: Array
    origin: Array
    lower: Array
    spacing: Array
    shape: Cells


@dataclass(frozen=True, eq=False)
class Grid:
    """Cells of equal size in Cartesian or unfolded coordinates.

    Attributes:
        lower, upper: corners of the workspace in the grid's coordinates, (3,): x, y, z in m, or
            along (m), around (rad), out (m, > 0).
        shape: number of cells along each coordinate, (3,).
        unfolded: the coordinates are (along, around, out), with `along` on the frame's z axis and
            `around` counted from its x axis.
        rotation, origin: pose of the grid's frame in the world, (3, 3), (3,) m.

    Raises:
        InputError: the limits or the shape cannot be a grid's.
    """

    lower: Array
    upper: Array
    shape: tuple[int, int, int]
    unfolded: bool = False
    rotation: Array | None = None
    origin: Array | None = None

    def __post_init__(self) -> None:
        for name in ("lower", "upper"):
            numbers = np.asarray(getattr(self, name), dtype=np.float64)
            if numbers.shape != (3,) or not np.isfinite(numbers).all():
                raise InputError(f"grid {name} = {numbers.tolist()}; must be three finite numbers")
            object.__setattr__(self, name, numbers)
        R = np.eye(3) if self.rotation is None else np.asarray(self.rotation, dtype=np.float64)
        p = np.zeros(3) if self.origin is None else np.asarray(self.origin, dtype=np.float64)
        object.__setattr__(self, "rotation", R)
        object.__setattr__(self, "origin", p)
        if not (self.upper > self.lower).all():
            raise InputError(
                f"grid from {self.lower.tolist()} to {self.upper.tolist()}; every upper limit must "
                "be above the lower one"
            )
        if len(self.shape) != 3 or min(self.shape) < 1 or math.prod(self.shape) > MOST_CELLS:
            raise InputError(
                f"grid of {self.shape} cells; must be three numbers of 1 or more, {MOST_CELLS} "
                "cells at most"
            )
        if self.unfolded:
            turn = self.upper[1] - self.lower[1]
            if turn > 2.0 * math.pi * (1.0 + 1e-12):
                raise InputError(f"grid around = {turn:.6g} rad; must be a whole turn at most")
            if self.lower[2] <= 0.0:
                raise InputError(f"grid out from {self.lower[2]} m; must be > 0")

    @property
    def spacing(self) -> Array:
        """Size of a cell in the grid's coordinates, (3,)."""
        size: Array = (self.upper - self.lower) / self.shape
        return size

    @property
    def periodic(self) -> bool:
        """Whether it goes all the way around, so that its first and last columns touch."""
        turn = self.upper[1] - self.lower[1]
        return self.unfolded and self.shape[1] > 2 and turn > 2.0 * math.pi * (1.0 - 1e-12)

    @cached_property
    def arrays(self) -> GridArrays:
        return GridArrays(
            unfolded=self.unfolded,
            rotation=np.ascontiguousarray(self.rotation, dtype=np.float64),
            origin=np.ascontiguousarray(self.origin, dtype=np.float64),
            lower=self.lower,
            spacing=self.spacing,
            shape=np.array(self.shape, dtype=np.int64),
        )

    def to_world(self, coordinates: ArrayLike) -> Array:
        """Positions (N, 3) m in the world of grid coordinates (N, 3)."""
        q = np.asarray(coordinates, dtype=np.float64)
        if self.unfolded:
            along, around, out = q.T
            q = np.column_stack([out * np.cos(around), out * np.sin(around), along])
        return q @ self.arrays.rotation.T + self.arrays.origin

    def from_world(self, points: ArrayLike) -> Array:
        """Grid coordinates (N, 3) of positions (N, 3) m in the world; `around` within the grid."""
        local = (np.asarray(points, dtype=np.float64) - self.arrays.origin) @ self.arrays.rotation
        if not self.unfolded:
            return local
        x, y, z = local.T
        around = np.arctan2(y, x)
        around = self.lower[1] + np.mod(around - self.lower[1], 2.0 * math.pi)
        return np.column_stack([z, around, np.hypot(x, y)])

    def centres(self, cells: ArrayLike) -> Array:
        """Centres (N, 3) m in the world of cells (N, 3)."""
        return self.to_world(self.lower + (np.asarray(cells) + 0.5) * self.spacing)

    def cells(self, points: ArrayLike) -> Cells:
        """The cells (N, 3) that hold points (N, 3) m of the world; outside, -1 or beyond shape."""
        q = (self.from_world(points) - self.lower) / self.spacing
        # A point on the upper limit belongs to the last cell.
        limit = np.array(self.shape, dtype=np.float64)
        q = np.where((q >= limit) & (q <= limit * (1.0 + 1e-12)), limit - 1.0, q)
        cells: Cells = np.floor(q).astype(np.int64)
        return cells

    @cached_property
    def step_costs(self) -> Array:
        """Length of each of the `STEPS` by the cell's place along the third axis, (shape[2], 26) m.

        In unfolded coordinates a step around is longer farther out.
        """
        square = (STEPS[:, 0] * self.spacing[0]) ** 2 + (STEPS[:, 2] * self.spacing[2]) ** 2
        if not self.unfolded:
            costs = np.sqrt(square + (STEPS[:, 1] * self.spacing[1]) ** 2)
            return np.tile(costs, (self.shape[2], 1))
        out = self.lower[2] + (np.arange(self.shape[2]) + 0.5) * self.spacing[2]
        other = out[:, None] + STEPS[:, 2] * self.spacing[2]
        # The chord: (a - b)^2 + 4 a b sin^2(angle / 2).
        sines = np.sin(0.5 * STEPS[:, 1] * self.spacing[1])
        chord: Array = np.sqrt(square + 4.0 * out[:, None] * np.maximum(other, 0.0) * sines**2)
        return chord

    @cached_property
    def least_lengths(self) -> Array:
        """What a step along each coordinate costs at least, (3,) m; around: on innermost cells."""
        lengths = self.spacing.copy()
        if self.unfolded:
            innermost = self.lower[2] + 0.5 * self.spacing[2]
            lengths[1] = 2.0 * innermost * math.sin(0.5 * self.spacing[1])
        return lengths

    @property
    def longest_step(self) -> float:
        """m."""
        inside = np.arange(self.shape[2])[:, None] + STEPS[:, 2]
        there = (inside >= 0) & (inside < self.shape[2])
        return float(self.step_costs[there].max())


@dataclass(frozen=True, eq=False)
class Occupancy:
    """Which cells of a grid are free for the middle of an arm.

    Attributes:
        grid: the cells.
        field: the obstacles.
        radius: of the arm, with whatever margin is wanted, m.
        padded: `BLOCKED`, `FREE`, or `INNER` where all neighbours are free too; with a border of
            one blocked cell, (shape[0] + 2, shape[1] + 2, shape[2] + 2).
    """

    grid: Grid
    field: SignedDistanceField
    radius: float
    padded: NDArray[np.uint8]

    @staticmethod
    def of(field: SignedDistanceField, grid: Grid, radius: float) -> Occupancy:
        """Looks at all cells; see the module's docstring for which are free.

        Raises:
            InputError: the radius is not positive.
        """
        if not (math.isfinite(radius) and radius > 0.0):
            raise InputError(f"arm's radius = {radius} m; must be > 0")
        enough = math.hypot(radius, 0.5 * grid.longest_step)
        padded = _fill(grid.arrays, field.arrays, enough)
        _mark_inner(padded)
        return Occupancy(grid=grid, field=field, radius=radius, padded=padded)

    @property
    def free(self) -> NDArray[np.bool_]:
        """Which cells are free, of the grid's shape."""
        return self.padded[1:-1, 1:-1, 1:-1] != BLOCKED


@numba.njit(cache=True)
def grid_to_world(grid, q0, q1, q2):
    """`Grid.to_world` of one point."""
    if grid.unfolded:
        q0, q1, q2 = q2 * math.cos(q1), q2 * math.sin(q1), q0
    R, p = grid.rotation, grid.origin
    return (
        R[0, 0] * q0 + R[0, 1] * q1 + R[0, 2] * q2 + p[0],
        R[1, 0] * q0 + R[1, 1] * q1 + R[1, 2] * q2 + p[1],
        R[2, 0] * q0 + R[2, 1] * q1 + R[2, 2] * q2 + p[2],
    )


@numba.njit(cache=True)
def cell_centre(grid, i, j, k):
    """The centre of a cell in the world, m."""
    return grid_to_world(
        grid,
        grid.lower[0] + (i + 0.5) * grid.spacing[0],
        grid.lower[1] + (j + 0.5) * grid.spacing[1],
        grid.lower[2] + (k + 0.5) * grid.spacing[2],
    )


@numba.njit(cache=True)
def _judge(grid, field, low, high, enough, chosen, count, near):
    """Whether a block of cells is free (1), not free (0), or has to be looked at closely (2).

    A signed distance changes by no more than the way walked: where the block's middle is far enough
    from an obstacle, or deep enough in one, so are all its cells; and only shapes about as near to
    its middle as the nearest one can be nearest to any of them. Of the `chosen` shapes these are
    written to `near`.

    Args:
        low, high: the first cell of the block and the first beyond it, along each axis.

    Returns:
        The verdict, and the number of near shapes.
    """
    h = grid.spacing
    x, y, z = cell_centre(
        grid,
        0.5 * (low[0] + high[0] - 1),
        0.5 * (low[1] + high[1] - 1),
        0.5 * (low[2] + high[2] - 1),
    )
    a = 0.5 * (high[0] - low[0] - 1) * h[0]
    b = 0.5 * (high[1] - low[1] - 1) * h[1]
    c = 0.5 * (high[2] - low[2] - 1) * h[2]
    if grid.unfolded:
        # No way from the middle is longer than out, and around on the outermost cells.
        reach = math.sqrt(a * a + (c + (grid.lower[2] + high[2] * h[2]) * b) ** 2)
    else:
        reach = math.sqrt(a * a + b * b + c * c)
    reach *= 1.0 + 1e-9
    least = np.inf
    distances = np.empty(count)
    for n in range(count):
        distances[n], _, _, _ = distance_to_shape(field, chosen[n], x, y, z)
        least = min(least, distances[n])
    if least - reach >= enough:
        return 1, 0
    if least + reach < enough:
        return 0, 0
    kept = 0
    for n in range(count):
        if distances[n] <= least + 2.0 * reach:
            near[kept] = chosen[n]
            kept += 1
    return 2, kept


@numba.njit(cache=True)
def _fill(grid, field, enough):
    """The padded occupancy, looked at in blocks, smaller ones, and cells where that is needed."""
    shape = grid.shape
    free = np.zeros((shape[0] + 2, shape[1] + 2, shape[2] + 2), dtype=np.uint8)
    shapes = field.kinds.shape[0]
    every = np.arange(shapes)
    near, nearest = np.empty(shapes, dtype=np.int64), np.empty(shapes, dtype=np.int64)
    for i in range(0, shape[0], _BLOCK):
        for j in range(0, shape[1], _BLOCK):
            for k in range(0, shape[2], _BLOCK):
                low = (i, j, k)
                high = (
                    min(i + _BLOCK, shape[0]),
                    min(j + _BLOCK, shape[1]),
                    min(k + _BLOCK, shape[2]),
                )
                verdict, count = _judge(grid, field, low, high, enough, every, shapes, near)
                if verdict == 1:
                    free[i + 1 : high[0] + 1, j + 1 : high[1] + 1, k + 1 : high[2] + 1] = FREE
                elif verdict == 2:
                    _fill_block(grid, field, enough, low, high, near, count, nearest, free)
    return free


@numba.njit(cache=True)
def _fill_block(grid, field, enough, low, high, near, count, nearest, free):
    for i0 in range(low[0], high[0], _SMALL_BLOCK):
        i1 = min(i0 + _SMALL_BLOCK, high[0])
        for j0 in range(low[1], high[1], _SMALL_BLOCK):
            j1 = min(j0 + _SMALL_BLOCK, high[1])
            for k0 in range(low[2], high[2], _SMALL_BLOCK):
                k1 = min(k0 + _SMALL_BLOCK, high[2])
                verdict, few = _judge(
                    grid, field, (i0, j0, k0), (i1, j1, k1), enough, near, count, nearest
                )
                if verdict == 0:
                    continue
                for i in range(i0, i1):
                    for j in range(j0, j1):
                        for k in range(k0, k1):
                            if verdict == 2:
                                x, y, z = cell_centre(grid, i, j, k)
                                d, _, _, _, _ = least_distance(field, x, y, z, nearest, few)
                                if d < enough:
                                    continue
                            free[i + 1, j + 1, k + 1] = FREE


@numba.njit(cache=True)
def _mark_inner(padded):
    """Marks free cells whose 26 neighbours are free."""
    n0, n1, n2 = padded.shape
    for i in range(1, n0 - 1):
        for j in range(1, n1 - 1):
            free_columns = 0  # in a row, so far
            for k in range(n2):
                column = True
                for di in range(-1, 2):
                    for dj in range(-1, 2):
                        column = column and padded[i + di, j + dj, k] != BLOCKED
                free_columns = free_columns + 1 if column else 0
                if free_columns >= 3:
                    padded[i, j, k - 1] = INNER
