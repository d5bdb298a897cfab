"""A workspace cut into cells, in Cartesian or in unfolded coordinates.

A cell stands for its centre, and a path on the grid is the polyline through the centres of cells
that touch (by a face, an edge or a corner: 26 neighbours), whatever the coordinates are. So the
cost of a step is the straight distance between two centres in the world, in unfolded coordinates
too, and a path's cost is its length in metres.

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
#: More cells than this do not fit into the memory of a small machine: a search takes 10 bytes each.
MOST_CELLS = 100_000_000


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
