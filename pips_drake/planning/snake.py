"""The snake: a path that makes itself short, straight, and clear of obstacles (CMU-92 section 3.4).

Kass, Witkin and Terzopoulos' curve v(s) of least energy

    E = int alpha(s)/2 |v_s|^2 + beta(s)/2 |v_ss|^2 + U(v) - f(s) . v ds

with its tension alpha (N), its bending stiffness beta (N m^2), obstacles' energy U per length (N)
and what the operator pulls with, f (N/m). CMU-92 Eq 4 prints the norms without their squares; its
pentadiagonal matrix is that of the squares. With points at a spacing h the discrete energy is

    E = sum alpha_i / (2 h) |v_i+1 - v_i|^2 + sum beta_i / (2 h^3) |v_i+1 - 2 v_i + v_i-1|^2
      + sum h (U(v_i) - f_i . v_i)

whose internal gradient per length is K v, K pentadiagonal, symmetric and positive. Points move
against the gradient, their inertia neglected, the internal part taken after the step:

    (K + G) v' = G v - U'(v) + f,    G = diag(g_i) in N/m^2.

The stable step. Let the field be linear about the path, U' = C v with 0 <= C. A deviation e becomes
e' = M e with (K + G) M = G - C. For an eigenvector x with eigenvalue m,

    m = x'(G - C)x / x'(K + G)x.

-1 < m < 1 asks for x'(2G + K - C)x > 0, which g_i > c_i / 2 ensures; g_i >= c_i ensures m >= 0, so
that nothing overshoots. Along an obstacle's gradient c_i is U'' at the point, which
`Repulsion.stiffness` gives, summed over obstacles. Across it, the field of a convex surface is soft
(c < 0): no step is unstable for that, the path itself slides aside. So g_i is U'' there, plus
a floor that the tension sets. Because the field is not linear, a step that raises the energy is
taken again with twice the g, and a factor of two is given back with each step that does not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.planning.potential_field import DistanceField, Repulsion

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

#: A point that moves less in a step has settled, m.
SETTLED = 1e-5
#: Most steps of `settle`.
MAX_STEPS = 5000
#: The floor of g as a share of alpha / h^2, the tension's stiffness between neighbours.
_FLOOR = 1e-4
#: A step that raises the energy is repeated at most this often, with twice the g each time.
_MAX_DOUBLINGS = 40
#: By so much an energy may seem to rise by rounding.
_ROUNDING = 1e-12
#: Ends and one point between them are never deleted.
_FEWEST = 3


@dataclass(frozen=True, kw_only=True)
class SnakeSettings:
    """What a snake is made of.

    Attributes:
        tension: alpha, N: how much it wants to be short (elasticity).
        bending_stiffness: beta, N m^2: how much it wants to be straight (rigidity).
        spacing: h, m, of its points.
        spacing_band: shares of `spacing` outside which points are deleted or inserted. The upper
            must be more than twice the lower, or what is inserted is deleted at once.

    Raises:
        InputError: a number that means nothing.
    """

    tension: float = 1.0
    bending_stiffness: float = 0.05
    spacing: float = 0.1
    spacing_band: tuple[float, float] = (0.5, 1.5)

    def __post_init__(self) -> None:
        for name, value, unit, least in (
            ("tension", self.tension, "N", 0.0),
            ("bending stiffness", self.bending_stiffness, "N m^2", -math.ulp(0.0)),
            ("spacing", self.spacing, "m", 0.0),
        ):
            if not (math.isfinite(value) and value > least):
                allowed = "> 0" if least == 0.0 else "0 or more"
                raise InputError(f"snake {name} = {value} {unit}; must be {allowed}")
        low, high = self.spacing_band
        if not (0.0 < 2.0 * low < high < math.inf):
            raise InputError(
                f"snake spacing band = {low} .. {high}; must be positive, the upper more than "
                "twice the lower"
            )


@dataclass(frozen=True, kw_only=True)
class Snake:
    """A path of points that are nailed down or free.

    Attributes:
        points: (N, 3) m, from the base to the goal.
        nailed: (N,); both ends always are.
        tension, bending_stiffness: alpha N and beta N m^2 at the points, (N,).
    """

    points: Array
    nailed: Flags
    tension: Array
    bending_stiffness: Array
    settings: SnakeSettings

    @property
    def spacings(self) -> Array:
        """Distances (N - 1,) m between neighbours."""
        lengths: Array = np.linalg.norm(np.diff(self.points, axis=0), axis=-1)
        return lengths

    @property
    def arc_lengths(self) -> Array:
        """Of the points along the path, (N,) m."""
        return np.concatenate([[0.0], np.cumsum(self.spacings)])

    def nearest(self, place: ArrayLike) -> int:
        """The point nearest to a place (3,) m."""
        return int(np.argmin(np.linalg.norm(self.points - np.asarray(place), axis=-1)))


@dataclass(frozen=True, kw_only=True)
class Settled:
    """A snake that was let go.

    Attributes:
        stable: whether it came to rest within the steps allowed.
        energies: before the first step and after each, J. They fall, but where points were
            inserted or deleted.
        clearance: least distance of its points, m.
    """

    snake: Snake
    stable: bool
    steps: int
    energies: Array
    clearance: float


def make_snake(
    path: ArrayLike,
    settings: SnakeSettings,
    *,
    tension: ArrayLike | None = None,
    bending_stiffness: ArrayLike | None = None,
) -> Snake:
    """Lays a snake down on a path, with points at most `settings.spacing` apart.

    Args:
        path: (P, 3) m, corners of a polyline.
        tension, bending_stiffness: weights along the path, at equal shares of its length, linear
            between them; the settings' own by default.

    Raises:
        InputError: the path is not (P, 3) with P >= 2, finite and of a length; or a weight is not
            finite or negative.
    """
    corners = np.asarray(path, dtype=np.float64)
    if corners.ndim != 2 or corners.shape[1] != 3 or len(corners) < 2:
        raise InputError(f"snake's path of shape {corners.shape}; must be (2 or more, 3)")
    if not np.isfinite(corners).all():
        raise InputError("snake's path; must be of finite numbers")
    marks = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=-1))])
    if marks[-1] <= 0.0:
        raise InputError("snake's path has no length; start and goal must differ")
    count = max(math.ceil(marks[-1] / settings.spacing) + 1, 3)
    s = np.linspace(0.0, marks[-1], count)
    points = np.stack([np.interp(s, marks, corners[:, axis]) for axis in range(3)], axis=-1)
    points[0], points[-1] = corners[0], corners[-1]
    nailed = np.zeros(count, dtype=bool)
    nailed[[0, -1]] = True
    return Snake(
        points=points,
        nailed=nailed,
        tension=_weights("tension", tension, settings.tension, count),
        bending_stiffness=_weights(
            "bending stiffness", bending_stiffness, settings.bending_stiffness, count
        ),
        settings=settings,
    )


def nail(snake: Snake, place: ArrayLike) -> Snake:
    """The snake with the point that is nearest to a place (3,) m moved there and nailed down.

    Raises:
        InputError: the place is not of three finite numbers, or only an end is near it.
    """
    where = np.asarray(place, dtype=np.float64)
    if where.shape != (3,) or not np.isfinite(where).all():
        raise InputError(f"nail at {place!r}; must be three finite numbers, m")
    k = snake.nearest(where)
    if k in (0, len(snake.points) - 1):
        raise InputError(f"nail at {where.tolist()} m is nearest to an end, which is nailed")
    points, nailed = snake.points.copy(), snake.nailed.copy()
    points[k], nailed[k] = where, True
    return replace(snake, points=points, nailed=nailed)


def move_goal(snake: Snake, goal: ArrayLike) -> Snake:
    """The snake with its last point moved to (3,) m; the rest follows when it is let go.

    Raises:
        InputError: the goal is not of three finite numbers.
    """
    where = np.asarray(goal, dtype=np.float64)
    if where.shape != (3,) or not np.isfinite(where).all():
        raise InputError(f"goal at {goal!r}; must be three finite numbers, m")
    points = snake.points.copy()
    points[-1] = where
    return replace(snake, points=points)


def keep_spacing(snake: Snake) -> Snake:
    """The snake with points inserted and deleted where their spacing has left its band.

    The same object comes back if it has not. Nailed points are never deleted.
    """
    low, high = (share * snake.settings.spacing for share in snake.settings.spacing_band)
    spacings = snake.spacings
    if spacings.max() <= high and spacings.min() >= low:
        return snake
    keep = np.ones(len(snake.points), dtype=bool)
    last = 0
    for k in range(1, len(snake.points)):
        gap = np.linalg.norm(snake.points[k] - snake.points[last])
        if gap < low and not snake.nailed[k] and keep.sum() > _FEWEST:
            keep[k] = False
            continue
        last = k
    rows = np.flatnonzero(keep)
    # As many as bring each interval back into the band, at equal shares of it.
    lengths = np.linalg.norm(np.diff(snake.points[rows], axis=0), axis=-1)
    parts = np.where(lengths > high, np.ceil(lengths / snake.settings.spacing), 1.0)
    # Old points stay at whole numbers.
    at = np.concatenate([k + np.arange(n) / n for k, n in enumerate(parts)] + [[len(rows) - 1.0]])
    old = np.arange(len(rows), dtype=np.float64)
    whole = at == np.floor(at)
    points = np.stack([np.interp(at, old, snake.points[rows, k]) for k in range(3)], axis=-1)
    points[whole] = snake.points[rows]
    nailed = np.zeros(len(at), dtype=bool)
    nailed[whole] = snake.nailed[rows]
    return replace(
        snake,
        points=points,
        nailed=nailed,
        tension=np.interp(at, old, snake.tension[rows]),
        bending_stiffness=np.interp(at, old, snake.bending_stiffness[rows]),
    )


def settle(
    snake: Snake,
    field: DistanceField,
    repulsion: Repulsion,
    *,
    pulls: Sequence[tuple[ArrayLike, ArrayLike]] = (),
    max_steps: int = MAX_STEPS,
    tolerance: float = SETTLED,
) -> Settled:
    """Lets a snake go until it rests, or for a number of steps.

    Args:
        pulls: the operator's: a place (3,) m, whose nearest point is pulled, and a force (3,) N.
        max_steps: one for a single step.
        tolerance: it rests when no point moved farther than this in a step, m.

    Raises:
        InputError: a distance is not a finite number.
    """
    h = snake.settings.spacing
    snake = keep_spacing(snake)
    felt = _feel(snake, field, repulsion, pulls)
    energies, doublings, stable, steps = [felt.energy], 0, False, 0
    while steps < max_steps and not stable:
        floor = _FLOOR * snake.tension.max() / h**2
        stiffness = repulsion.stiffness(felt.distance).sum(axis=-1) + floor
        while True:
            points = _implicit_step(
                snake.points,
                snake.nailed,
                snake.tension,
                snake.bending_stiffness,
                h,
                stiffness * 2.0**doublings,
                felt.force,
            )
            moved = replace(snake, points=points)
            after = _feel(moved, field, repulsion, pulls)
            if after.energy <= felt.energy * (1.0 + _ROUNDING) or doublings == _MAX_DOUBLINGS:
                break
            doublings += 1
        steps += 1
        stable = float(np.abs(points - snake.points).max()) * 2.0**doublings <= tolerance
        doublings = max(doublings - 1, 0)
        energies.append(after.energy)
        snake, felt = moved, after
        spaced = keep_spacing(snake)
        if spaced is not snake:
            snake, felt, stable = spaced, _feel(spaced, field, repulsion, pulls), False
    return Settled(
        snake=snake,
        stable=stable,
        steps=steps,
        energies=np.array(energies),
        clearance=float(felt.distance.min()),
    )


def curvatures(points: Array) -> Array:
    """Of a path of points (N, 3) m at its inner ones, (N - 2,) 1/m: turn over mean spacing."""
    ways = np.diff(points, axis=0)
    lengths = np.linalg.norm(ways, axis=-1)
    across = np.linalg.norm(np.cross(ways[:-1], ways[1:]), axis=-1)
    along = np.einsum("ij,ij->i", ways[:-1], ways[1:])
    turns: Array = np.arctan2(across, along) / (0.5 * (lengths[:-1] + lengths[1:]))
    return turns


def link_curvature_limit(link_length: float, joint_limit: float) -> float:
    """The curvature of the circle that links of a length (m) follow at a joint angle (rad), 1/m.

    A chord l of a circle of radius R turns by theta where l = 2 R sin(theta / 2).
    """
    return 2.0 * math.sin(0.5 * joint_limit) / link_length


@dataclass(frozen=True)
class _Felt:
    """What the field and the operator do to a snake's points, and the whole energy, J."""

    distance: Array
    force: Array
    energy: float


def _feel(
    snake: Snake,
    field: DistanceField,
    repulsion: Repulsion,
    pulls: Sequence[tuple[ArrayLike, ArrayLike]],
) -> _Felt:
    h = snake.settings.spacing
    distance, gradient = field(snake.points)
    if not np.isfinite(distance).all():
        raise InputError("a snake's point has no finite distance to the obstacles")
    force = np.einsum("ij,ijk->ik", repulsion.push(distance), gradient)
    energy = h * float(repulsion.energy(distance).sum())
    for place, pull in pulls:
        k, newtons = snake.nearest(place), np.asarray(pull, dtype=np.float64)
        force[k] += newtons / h
        energy -= float(newtons @ snake.points[k])
    energy += _internal_energy(snake.points, snake.tension, snake.bending_stiffness, h)
    return _Felt(distance, force, energy)


def _weights(name: str, given: ArrayLike | None, default: float, count: int) -> Array:
    values = np.atleast_1d(np.asarray(default if given is None else given, dtype=np.float64))
    if not (np.isfinite(values).all() and (values >= 0.0).all()):
        raise InputError(f"snake's {name}; must be finite and 0 or more")
    return np.interp(np.linspace(0.0, 1.0, count), np.linspace(0.0, 1.0, values.size), values)


@numba.njit(cache=True)
def _internal_energy(points, tension, bending_stiffness, h):
    """Of tension and bending, J."""
    energy = 0.0
    for i in range(len(points) - 1):
        alpha = 0.5 * (tension[i] + tension[i + 1])
        for k in range(3):
            way = points[i + 1, k] - points[i, k]
            energy += 0.5 * alpha / h * way * way
    for i in range(1, len(points) - 1):
        for k in range(3):
            bend = points[i + 1, k] - 2.0 * points[i, k] + points[i - 1, k]
            energy += 0.5 * bending_stiffness[i] / h**3 * bend * bend
    return energy


@numba.njit(cache=True)
def _implicit_step(points, nailed, tension, bending_stiffness, h, gain, force):
    """Points (N, 3) after (K + G) v' = G v + F, nailed ones where they are."""
    n = len(points)
    diagonal, one, two = gain.copy(), np.zeros(n), np.zeros(n)  # one[i]: of i and i + 1, and so on
    for i in range(n - 1):
        a = 0.5 * (tension[i] + tension[i + 1]) / (h * h)
        diagonal[i] += a
        diagonal[i + 1] += a
        one[i] -= a
    for i in range(1, n - 1):
        b = bending_stiffness[i] / h**4
        diagonal[i - 1] += b
        diagonal[i] += 4.0 * b
        diagonal[i + 1] += b
        one[i - 1] -= 2.0 * b
        one[i] -= 2.0 * b
        two[i - 1] += b
    after = np.empty((n, 3))
    for i in range(n):
        for k in range(3):
            after[i, k] = gain[i] * points[i, k] + force[i, k]
    # What is nailed leaves the equations: known, it goes to the right side.
    for i in range(n):
        if not nailed[i]:
            continue
        for k in range(3):
            if i > 0:
                after[i - 1, k] -= one[i - 1] * points[i, k]
            if i > 1:
                after[i - 2, k] -= two[i - 2] * points[i, k]
            if i < n - 1:
                after[i + 1, k] -= one[i] * points[i, k]
            if i < n - 2:
                after[i + 2, k] -= two[i] * points[i, k]
        if i > 0:
            one[i - 1] = 0.0
        if i > 1:
            two[i - 2] = 0.0
        one[i] = 0.0
        two[i] = 0.0
        diagonal[i] = 1.0
    for i in range(n):
        if nailed[i]:
            for k in range(3):
                after[i, k] = points[i, k]
    # L D L' of a pentadiagonal matrix, L's diagonals over `one` and `two`, and its solution.
    for i in range(n):
        if i > 0:
            diagonal[i] -= one[i - 1] * one[i - 1] * diagonal[i - 1]
        if i > 1:
            diagonal[i] -= two[i - 2] * two[i - 2] * diagonal[i - 2]
        if i > 0:
            one[i] -= two[i - 1] * one[i - 1] * diagonal[i - 1]
        one[i] /= diagonal[i]
        two[i] /= diagonal[i]
    for k in range(3):
        for i in range(n):
            if i > 0:
                after[i, k] -= one[i - 1] * after[i - 1, k]
            if i > 1:
                after[i, k] -= two[i - 2] * after[i - 2, k]
        for i in range(n):
            after[i, k] /= diagonal[i]
        for i in range(n - 1, -1, -1):
            if i < n - 1:
                after[i, k] -= one[i] * after[i + 1, k]
            if i < n - 2:
                after[i, k] -= two[i] * after[i + 2, k]
    return after
