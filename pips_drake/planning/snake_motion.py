"""How a snake moves to where its energy is least, and the step at which that is stable.

The discrete energy (`snake`) has the internal gradient K v per length, K pentadiagonal, symmetric
and positive. Points move against the gradient, their inertia neglected, the internal part taken
after the step:

    (K + G) v' = G v - U'(v) + f,    G of a symmetric block G_i (3, 3) a point, in N/m^2.

K is the same along x, y and z; with G the matrix is banded, with six diagonals on either side.

The stable step. Let the field be linear about the path, U' = C v, C of symmetric blocks. A
deviation e becomes e' = M e with (K + G) M = G - C. For an eigenvector x with eigenvalue m,

    m = x'(G - C)x / x'(K + G)x.

-1 < m < 1 asks for x'(2 G + K - C)x > 0 and x'(K + C)x > 0: the first holds if G > C / 2, the
second if the path can rest there at all. G >= C ensures m >= 0 too, so that nothing overshoots. Of
an obstacle at distance d with the gradient n, C = U''(d) n n' + U'(d) d'': along n the field is as
stiff as U'', which `Repulsion.stiffness` gives; across n, with U' < 0, a convex surface (d'' >= 0)
makes it soft, a concave one stiffer. So G_i is the sum of U'' n n' over obstacles, plus g times the
unit matrix: a gain along n alone does not slow what slides along a wall. g starts as a small share
of the tension's stiffness. Because fields are neither linear nor always convex, a step that raises
the energy is taken again with a larger g, and with each step that does not, g shrinks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import LinAlgError
from scipy.linalg.lapack import dpbsv

from pips_drake.errors import InputError
from pips_drake.planning.potential_field import DistanceField, Repulsion
from pips_drake.planning.snake import Snake, keep_spacing

Array = NDArray[np.float64]

#: A point that moves less in a step has settled, m.
SETTLED = 1e-5
#: Most steps of `settle`.
MAX_STEPS = 5000
#: The least g as a share of alpha / h^2, the tension's stiffness between neighbours.
_FLOOR = 1e-4
#: What g grows by when a step raised the energy, and shrinks by when it did not.
_GROWTH, _SHRINK = 4.0, 0.5
#: So often at most; then the step is taken as it is: it is too small to matter.
_MOST_REPEATS = 40
#: So often at most points are inserted and deleted: where a point goes as soon as it has come, the
#: snake rests with those that it has.
_MOST_CHANGES = 100
#: By so much an energy may seem to rise by rounding.
_ROUNDING = 1e-12
_UNIT = np.eye(3)


@dataclass(frozen=True, kw_only=True)
class Settled:
    """A snake that was let go.

    Attributes:
        stable: whether it came to rest within the steps allowed.
        energies: before the first step and after each, J. They fall, but where points were
            inserted or deleted.
        clearance: least distance of its points, m, as the field tells it; infinite without any
            obstacle.
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
        InputError: a distance is not a number.
    """
    h = snake.settings.spacing
    snake = keep_spacing(snake)
    felt = _feel(snake, field, repulsion, pulls)
    floor = _FLOOR * snake.tension.max() / h**2
    energies, gain, stable, steps, changes = [felt.energy], floor, False, 0, 0
    while steps < max_steps and not stable:
        for _ in range(_MOST_REPEATS):
            points = _implicit_step(snake, felt, gain)
            moved = replace(snake, points=points)
            after = _feel(moved, field, repulsion, pulls)
            if after.energy <= felt.energy + _ROUNDING * abs(felt.energy):
                break
            gain *= _GROWTH
        steps += 1
        energies.append(after.energy)
        # A small step at a large gain says nothing.
        small = float(np.abs(points - snake.points).max()) <= tolerance
        stable = bool(small and gain <= _GROWTH * floor)
        gain = max(gain * _SHRINK, floor)
        snake, felt = moved, after
        spaced = keep_spacing(snake) if changes < _MOST_CHANGES else snake
        if spaced is not snake:
            snake, felt, stable = spaced, _feel(spaced, field, repulsion, pulls), False
            changes += 1
    return Settled(
        snake=snake,
        stable=stable,
        steps=steps,
        energies=np.array(energies),
        clearance=float(np.min(felt.distance, initial=np.inf)),
    )


@dataclass(frozen=True)
class _Felt:
    """What the field and the operator do to a snake's points, and the whole energy, J."""

    distance: Array  # (N, M), m
    force: Array  # (N, 3), N/m
    stiffness: Array  # (N, 3, 3), N/m^2: the sum of U'' n n'
    energy: float


def _feel(
    snake: Snake,
    field: DistanceField,
    repulsion: Repulsion,
    pulls: Sequence[tuple[ArrayLike, ArrayLike]],
) -> _Felt:
    h = snake.settings.spacing
    distance, gradient = field(snake.points)
    if np.isnan(distance).any():
        raise InputError("a snake's point has no distance to the obstacles: not a number")
    force = np.einsum("ij,ijk->ik", repulsion.push(distance), gradient)
    stiffness = np.einsum("ij,ijk,ijl->ikl", repulsion.stiffness(distance), gradient, gradient)
    energy = h * float(repulsion.energy(distance).sum())
    for place, pull in pulls:
        k, newtons = snake.nearest(place), np.asarray(pull, dtype=np.float64)
        force[k] += newtons / h
        energy -= float(newtons @ snake.points[k])
    energy += _internal_energy(snake.points, snake.tension, snake.bending_stiffness, h)
    return _Felt(distance, force, stiffness, energy)


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


def _implicit_step(snake: Snake, felt: _Felt, gain: float) -> Array:
    """Points (N, 3) after (K + G) v' = G v + F with g = `gain`, nailed ones where they are."""
    blocks = felt.stiffness + gain * _UNIT
    bands, right = _banded(
        snake.points,
        snake.nailed,
        snake.tension,
        snake.bending_stiffness,
        snake.settings.spacing,
        blocks,
        felt.force,
    )
    # What `scipy.linalg.solveh_banded` calls; its looks at the arguments are a tenth of a step.
    _, after, failed = dpbsv(bands, right, lower=1, overwrite_ab=1, overwrite_b=1)
    if failed:
        raise LinAlgError(f"a snake's equations have no stable solution (dpbsv: {failed})")
    points: Array = after.reshape(-1, 3)
    points[snake.nailed] = snake.points[snake.nailed]
    return points


@numba.njit(cache=True)
def _banded(points, nailed, tension, bending_stiffness, h, blocks, force):
    """K + G as lower bands (7, 3 N), and G v + F (3 N,); rows of nailed points say v' = v."""
    n = len(points)
    bands, right = np.zeros((7, 3 * n)), np.empty(3 * n)
    near, far = np.zeros(n), np.zeros(n)  # of i and i + 1, of i and i + 2: the same along x, y, z
    own = np.zeros(n)
    for i in range(n - 1):
        a = 0.5 * (tension[i] + tension[i + 1]) / (h * h)
        own[i] += a
        own[i + 1] += a
        near[i] -= a
    for i in range(1, n - 1):
        b = bending_stiffness[i] / h**4
        own[i - 1] += b
        own[i] += 4.0 * b
        own[i + 1] += b
        near[i - 1] -= 2.0 * b
        near[i] -= 2.0 * b
        far[i - 1] += b
    for i in range(n):
        for k in range(3):
            row = 3 * i + k
            if nailed[i]:
                bands[0, row], right[row] = 1.0, points[i, k]
                continue
            total = force[i, k]
            for m in range(3):
                total += blocks[i, k, m] * points[i, m]
            # What is nailed is known: it stands on the right side.
            if i > 0 and nailed[i - 1]:
                total -= near[i - 1] * points[i - 1, k]
            if i > 1 and nailed[i - 2]:
                total -= far[i - 2] * points[i - 2, k]
            if i < n - 1 and nailed[i + 1]:
                total -= near[i] * points[i + 1, k]
            if i < n - 2 and nailed[i + 2]:
                total -= far[i] * points[i + 2, k]
            right[row] = total
            bands[0, row] = own[i] + blocks[i, k, k]
            for m in range(k + 1, 3):
                bands[m - k, row] = blocks[i, m, k]
            if i < n - 1 and not nailed[i + 1]:
                bands[3, row] = near[i]
            if i < n - 2 and not nailed[i + 2]:
                bands[6, row] = far[i]
    return bands, right
