"""Which cells of a grid are free for the middle of an arm.

Obstacles are grown by the arm's radius r. Along a step of length L between two centres, both at
distance d from every obstacle, no point is nearer to one than sqrt(d^2 - L^2 / 4): so a cell is
free where d >= sqrt(r^2 + L^2 / 4) with the longest step L of the grid. Then every step, not only
every centre, keeps the radius, and what is lost of narrow gaps is second order in the cells' size.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from pips_drake.errors import InputError
from pips_drake.planning.grid import Cells, Grid, cell_centre
from pips_drake.scene.shape_distance import distance_to_shape, least_distance
from pips_drake.scene.signed_distance import SignedDistanceField

Array = NDArray[np.float64]

#: States of cells in `Occupancy.padded`.
BLOCKED, FREE, INNER = 0, 1, 2
# Cells along each side of blocks that are looked at together.
_BLOCK, _SMALL_BLOCK = 8, 2


@dataclass(frozen=True, eq=False)
class Occupancy:
    """Which cells of a grid are free for the middle of an arm.

    Attributes:
        grid: its cells.
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
        """Looks at all cells; the module's docstring says which are free.

        Raises:
            InputError: the radius is not positive.
        """
        if not (math.isfinite(radius) and radius > 0.0):
            raise InputError(f"arm's radius = {radius} m; must be > 0")
        padded = np.zeros(np.array(grid.shape) + 2, dtype=np.uint8)
        low, high = np.zeros(3, dtype=np.int64), np.array(grid.shape, dtype=np.int64)
        _look_at(grid.arrays, field.arrays, _enough(grid, radius), low, high, padded)
        return Occupancy(grid=grid, field=field, radius=radius, padded=padded)

    def updated(self, field: SignedDistanceField) -> Occupancy:
        """The same cells among other obstacles; only where these differ are they looked at.

        Args:
            field: made from the old one by `with_shapes` and `without_body`: shapes that are the
                same objects count as unchanged.
        """
        padded, enough = self.padded.copy(), _enough(self.grid, self.radius)
        for one, other in ((self.field, field), (field, self.field)):
            kept = {id(placed) for placed in other.shapes}
            for m, placed in enumerate(one.shapes):
                if id(placed) in kept:
                    continue
                reach = float(one.arrays.radii[m]) + enough
                low, high = _cells_around(self.grid, one.arrays.centres[m], reach)
                if (low < high).all():
                    _look_at(self.grid.arrays, field.arrays, enough, low, high, padded)
        return Occupancy(grid=self.grid, field=field, radius=self.radius, padded=padded)

    @property
    def free(self) -> NDArray[np.bool_]:
        """Which cells are free, of the grid's shape."""
        return self.padded[1:-1, 1:-1, 1:-1] != BLOCKED


def _enough(grid: Grid, radius: float) -> float:
    """The distance from obstacles that makes a cell free, m."""
    return math.hypot(radius, 0.5 * grid.longest_step)


def _cells_around(grid: Grid, centre: Array, reach: float) -> tuple[Cells, Cells]:
    """The first cells, and the first beyond the last, of a block that holds a ball in the world."""
    middle = grid.from_world(centre[None])[0]
    extent = np.full(3, reach)
    shape = np.array(grid.shape)
    if grid.unfolded:
        extent[1] = math.asin(reach / middle[2]) if reach < middle[2] else math.inf
        first, last = middle[1] - extent[1], middle[1] + extent[1]
        # What reaches over the seam, or may stand on its other side, is looked for all around.
        if first < grid.lower[1] or last > grid.lower[1] + 2.0 * math.pi:
            extent[1] = math.inf
    low = np.clip((middle - extent - grid.lower) / grid.spacing - 1.0, 0, shape)
    high = np.clip((middle + extent - grid.lower) / grid.spacing + 1.0, 0, shape)
    return np.floor(low).astype(np.int64), np.ceil(high).astype(np.int64)


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
def _look_at(grid, field, enough, first, last, padded):
    """Fills cells from `first` to before `last`: in blocks, smaller ones, and cells if need be."""
    padded[first[0] + 1 : last[0] + 1, first[1] + 1 : last[1] + 1, first[2] + 1 : last[2] + 1] = (
        BLOCKED
    )
    shapes = field.kinds.shape[0]
    every = np.arange(shapes)
    near, nearest = np.empty(shapes, dtype=np.int64), np.empty(shapes, dtype=np.int64)
    for i in range(first[0], last[0], _BLOCK):
        for j in range(first[1], last[1], _BLOCK):
            for k in range(first[2], last[2], _BLOCK):
                low = (i, j, k)
                high = (
                    min(i + _BLOCK, last[0]),
                    min(j + _BLOCK, last[1]),
                    min(k + _BLOCK, last[2]),
                )
                verdict, count = _judge(grid, field, low, high, enough, every, shapes, near)
                if verdict == 1:
                    padded[i + 1 : high[0] + 1, j + 1 : high[1] + 1, k + 1 : high[2] + 1] = FREE
                elif verdict == 2:
                    _fill_block(grid, field, enough, low, high, near, count, nearest, padded)
    _mark_inner(padded, first, last, grid.unfolded)


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
def _mark_inner(padded, first, last, unfolded):
    """Marks free cells whose 26 neighbours are free: those given, and the ones beside them."""
    if unfolded:  # the search has no use for them there
        return
    n0, n1, n2 = padded.shape
    for i in range(max(first[0], 1), min(last[0] + 2, n0 - 1)):
        for j in range(max(first[1], 1), min(last[1] + 2, n1 - 1)):
            free_columns = 0  # in a row, so far
            for k in range(max(first[2], 1) - 1, min(last[2] + 2, n2 - 1) + 1):
                column = True
                for di in range(-1, 2):
                    for dj in range(-1, 2):
                        column = column and padded[i + di, j + dj, k] != BLOCKED
                free_columns = free_columns + 1 if column else 0
                if k - 1 >= max(first[2], 1) and padded[i, j, k - 1] != BLOCKED:
                    padded[i, j, k - 1] = INNER if free_columns >= 3 else FREE
