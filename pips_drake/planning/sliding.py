"""Whether two paths can slide into each other without meeting an obstacle (CMU-92 section 3.3).

A snake comes to rest at the same place from either of two paths with the same ends if nothing
stands between them. What is between is taken to be the surface

    H(u, v) = (1 - v) a(u) + v b(u),    0 <= v <= 1,

in the grid's coordinates: in unfolded ones, for straight lines in the world would cut through the
payload. The angle is counted on along each path: two paths that end at one point after a different
number of turns do not slide into each other over the gap.

Three such surfaces are tried. First a and b at equal shares u of their lengths. Where one path is
longer, these are not beside each other, and the surface cuts corners that both go around: so then
points are matched in order with the least sum of squared distances. At last straight through the
world, for before and behind the payload there is room across the axis. Any of the three that is
clear shows that the paths slide; that all meet something does not prove that they cannot: bent
surfaces may be clear. (Surfaces that are bent around what they meet were tried, and lifted paths
over obstacles that the snakes did not pass over.)

On a surface nothing is missed, however thin. Paths are taken as a(u) that are linear, in the
coordinates of H, between points a_k at equal shares of length, a cell apart or less. On the patch
of H between u_k and u_k+1, from v0 to v1, go from the middle M first along u, then along v. In
unfolded coordinates a way's length in the world is that of (d along, out d around, d out), and with
R, the largest `out` of either path, in place of `out` it becomes a norm |.|_R and is no shorter:
H's `out` is a mean of theirs. Norms of linear functions are convex, so that no point of the patch
is farther from M than

    rho = (u1 - u0)/2 max(|a_k+1 - a_k|_R, |b_k+1 - b_k|_R) + (v1 - v0)/2 max(|b - a|_R at k, k + 1)

(u counted in points). The signed distance of several obstacles is the least of functions that
change by no more than the way walked, and so changes by no more. Hence with d its value at M, the
patch is clear by c if d >= c + rho; if d < c, M itself is where an obstacle is met. Otherwise the
patch is halved along its longer side, until rho is at most `RESOLUTION`: then all of it is clear by
c - RESOLUTION, and counts as clear.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.planning.grid import Grid
from pips_drake.planning.occupancy import Occupancy

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: How much nearer to an obstacle than asked for two paths may slide past each other unseen, m.
RESOLUTION = 5e-3
#: Ends that are farther apart are not the same, m.
SAME_END = 1e-6


@dataclass(frozen=True, eq=False)
class Met:
    """What two paths meet on their way into each other.

    Attributes:
        label: the obstacle, or "a turn around the axis" where they go round differently.
        point: where, (3,) m in the world; NaN for a turn.
        share: how far from the first path to the second, 0 to 1.
    """

    label: str
    point: Array
    share: float


def can_slide(
    occupancy: Occupancy, path_a: ArrayLike, path_b: ArrayLike, *, clearance: float = 0.0
) -> bool:
    """Whether two paths (N, 3), (M, 3) m slide into each other; see `what_they_meet`."""
    return what_they_meet(occupancy, path_a, path_b, clearance=clearance) is None


def what_they_meet(
    occupancy: Occupancy, path_a: ArrayLike, path_b: ArrayLike, *, clearance: float = 0.0
) -> Met | None:
    """What two paths meet on their way into each other; None: nothing, they slide.

    Args:
        occupancy: its grid's coordinates are what paths slide in; its field, what they may meet.
        path_a, path_b: (N, 3), (M, 3) m in the world.
        clearance: nearer than this to an obstacle's surface meets it, m.

    Raises:
        InputError: a path is not of (N, 3) finite numbers.
    """
    grid = occupancy.grid
    a, b = _checked("first", path_a), _checked("second", path_b)
    spacing = float(grid.least_lengths.min())
    longest = max(path_length(a), path_length(b))
    count = max(int(np.ceil(longest / spacing)), 1) + 1
    world = [equal_shares(path, count) for path in (a, b)]
    first: Met | None = None
    for way in _ways(grid, world):
        met = way if isinstance(way, Met) else _sweep(occupancy, way, clearance)
        if met is None:
            return None
        first = first or met
    return first


def _ways(grid: Grid, world: list[Array]) -> Iterator[Met | _Way]:
    """The ways in which two paths (N, 3) m may slide, or what keeps them from it."""
    straight = _Way(world[0], world[1], False)
    if not grid.unfolded:
        yield straight
        yield straight.matched()
        return
    qa, qb = (unwrapped(grid, points) for points in world)
    qb[:, 1] -= 2.0 * np.pi * np.round((qb[0, 1] - qa[0, 1]) / (2.0 * np.pi))
    same_goal = float(np.linalg.norm(world[0][-1] - world[1][-1])) <= SAME_END
    if same_goal and abs(qb[-1, 1] - qa[-1, 1]) > np.pi:
        yield Met("a turn around the axis", np.full(3, np.nan), 0.5)
    else:
        unfolded = _Way(qa, qb, True)
        yield unfolded
        yield unfolded.matched()
    # Beside the end of what the gap goes around there may be room across the axis.
    yield straight.matched()


def path_length(points: Array) -> float:
    """Of a polyline (N, 3), m."""
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def equal_shares(points: Array, count: int) -> Array:
    """The points (count, 3) m at equal shares of a polyline's length."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    arcs = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.linspace(0.0, arcs[-1], count)
    return np.stack([np.interp(at, arcs, points[:, axis]) for axis in range(3)], axis=-1)


def unwrapped(grid: Grid, points: Array) -> Array:
    """Grid coordinates (N, 3) of points (N, 3) m of a path; angles go on along it."""
    q = grid.from_world(points)
    if grid.unfolded:
        q[:, 1] = np.unwrap(q[:, 1])
    return q


def _checked(which: str, path: ArrayLike) -> Array:
    p = np.asarray(path, dtype=np.float64)
    if p.ndim != 2 or p.shape[1] != 3 or len(p) < 1 or not np.isfinite(p).all():
        raise InputError(f"{which} path of shape {p.shape}; must be (N, 3) finite numbers")
    return p


@dataclass(frozen=True, eq=False)
class _Way:
    """Points of two paths in the coordinates that they slide in, those with one index together."""

    qa: Array
    qb: Array
    unfolded: bool

    @property
    def weights(self) -> Array:
        """Of |.|_R."""
        weights = np.ones(3)
        if self.unfolded:
            weights[1] = max(self.qa[:, 2].max(), self.qb[:, 2].max())
        return weights

    def matched(self) -> _Way:
        """Other points together: in order, and so that the squares of their distances have the
        least sum (dynamic time warping)."""
        apart = (self.qa[:, None] - self.qb[None]) * self.weights
        rows, columns = _matching(np.einsum("ijk,ijk->ij", apart, apart))
        return replace(self, qa=self.qa[rows], qb=self.qb[columns])


def _matching(costs: Array) -> tuple[Indices, Indices]:
    """Pairs (K,), (K,) of rows and columns from the first ones to the last, in steps of at most one
    along both, whose costs (N, M) have the least sum."""
    rows, columns = costs.shape
    total = np.full((rows + 1, columns + 1), np.inf)
    total[0, 0] = 0.0
    # All pairs with one sum of their indices at a time.
    for both in range(rows + columns - 1):
        i = np.arange(max(0, both - columns + 1), min(rows, both + 1))
        j = both - i
        before = np.minimum(np.minimum(total[i, j], total[i, j + 1]), total[i + 1, j])
        total[i + 1, j + 1] = costs[i, j] + before
    i, j = rows, columns
    pairs = [(i, j)]
    while (i, j) != (1, 1):
        steps = [(i - 1, j - 1), (i - 1, j), (i, j - 1)]
        i, j = min(steps, key=lambda step: total[step])
        pairs.append((i, j))
    found = np.array(pairs[::-1], dtype=np.int64) - 1
    return found[:, 0], found[:, 1]


def _sweep(occupancy: Occupancy, way: _Way, clearance: float) -> Met | None:
    """Patches of H, all of one size at a time; the module's docstring has the proof."""
    qa, qb, weights = way.qa, way.qb, way.weights
    steps = [np.linalg.norm(np.diff(q, axis=0) * weights, axis=1) for q in (qa, qb)]
    across = np.linalg.norm((qb - qa) * weights, axis=1)
    k = np.arange(len(qa) - 1)
    if not len(k):
        return None
    speed, gap = np.maximum(*steps), np.maximum(across[:-1], across[1:])
    # Middles and half sizes of the patches; u within its own interval.
    u, v = np.full(len(k), 0.5), np.full(len(k), 0.5)
    du, dv = u.copy(), v.copy()
    while len(k):
        ends = [q[k] + u[:, None] * (q[k + 1] - q[k]) for q in (qa, qb)]
        points = ends[0] + v[:, None] * (ends[1] - ends[0])
        if way.unfolded:
            points = occupancy.grid.to_world(points)
        distances = occupancy.field.distances(points)
        worst = int(np.argmin(distances))
        if distances[worst] < clearance:
            nearest = occupancy.field.nearest(points[worst : worst + 1])
            label = occupancy.field.label(int(nearest.indices[0]))
            return Met(label, points[worst], float(v[worst]))
        long_u, long_v = du * speed[k], dv * gap[k]
        rho = long_u + long_v
        left = (distances < clearance + rho) & (rho > RESOLUTION)
        k, u, v, du, dv = (x[left] for x in (k, u, v, du, dv))
        split_u = (long_u > long_v)[left]
        du, dv = np.where(split_u, 0.5 * du, du), np.where(split_u, dv, 0.5 * dv)
        shift_u, shift_v = np.where(split_u, du, 0.0), np.where(split_u, 0.0, dv)
        k, du, dv = np.tile(k, 2), np.tile(du, 2), np.tile(dv, 2)
        u = np.concatenate([u - shift_u, u + shift_u])
        v = np.concatenate([v - shift_v, v + shift_v])
    return None
