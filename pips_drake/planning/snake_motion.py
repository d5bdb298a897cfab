"""How a snake moves to where its energy is least, and the step at which that is stable.

The discrete energy (`snake`) has the internal gradient K v per length, K pentadiagonal, symmetric
and positive. Points move against the gradient, their inertia neglected, the internal part taken
after the step:

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

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.planning.potential_field import DistanceField, Repulsion
from pips_drake.planning.snake import Snake, keep_spacing

Array = NDArray[np.float64]

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
