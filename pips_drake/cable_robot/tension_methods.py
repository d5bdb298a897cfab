"""Which of the tensions T = T0 + N z that hold a platform to choose, within low <= T <= high.

- `least_norm`: the shortest T, a quadratic program. |T|^2 = |T0|^2 + |z|^2, so that the shortest z
  is sought. Continuous along a path, with kinks where cables reach their bounds.
- `least_infinity`: the smallest largest tension, a linear program. Its solution is a corner and may
  jump along a path.
- `closed_form`: the nearest to the mean of the bounds, with cables that miss their bounds fixed at
  them one by one (A. Pott, "An Improved Force Distribution Algorithm for Over-Constrained
  Cable-Driven Parallel Robots", 2014). No program, but it gives up at some poses that have
  tensions within the bounds: see `_closed_form`.
- `analytic_center`: where the product of all distances to the bounds is largest. Smooth along a
  path, because that product's logarithm is strictly concave and smooth.

All work on P poses of equal rank, with T, low and high divided by the largest among them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pips_drake.cable_robot.tension_kernels import (
    SOLVED,
    analytic_centres,
    linear_programs,
    shortest_points,
)

Array = NDArray[np.float64]

#: Sets with less slack are widened to this before a program runs, so that rounding cannot empty one
#: that is a point.
_WIDER = 1e-11
#: A set thinner than this has no inside to take the centre of.
_THIN = 1e-9


class Program(NamedTuple):
    """Tensions low <= shortest + null_space z <= high of P poses, all divided by `unit`.

    Attributes:
        null_space: (P, M, r), orthonormal columns.
        shortest: (P, M).
        low, high: (P,); high may be inf.
        slack: the largest s with low + s <= T <= high - s, (P,).
        roomiest: a z at which it is reached, (P, r).
    """

    null_space: Array
    shortest: Array
    low: Array
    high: Array
    slack: Array
    roomiest: Array

    def tensions(self, z: Array) -> Array:
        return np.asarray(self.shortest + (self.null_space @ z[..., None])[..., 0])

    def pick(self, chosen: NDArray[Any]) -> Program:
        return Program(*(np.ascontiguousarray(part[chosen]) for part in self))


def choose(
    method: str, null_space: Array, shortest: Array, low: float, high: float, kept: float
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Tensions (P, M), slacks (P,) and whether the tensions keep the bounds (P,).

    Args:
        kept: what counts as kept, over the largest number among tensions and bounds.
    """
    program, unit = prepare(null_space, shortest, low, high)
    possible = program.slack >= -kept
    z = program.roomiest.copy()
    if possible.any():
        z[possible] = METHODS[method](program.pick(possible))
    tensions = program.tensions(z)
    missed = np.maximum(program.low[:, None] - tensions, tensions - program.high[:, None])
    feasible = possible & (missed.max(axis=1) <= 2.0 * kept)
    return tensions * unit[:, None], program.slack * unit, feasible


def prepare(null_space: Array, shortest: Array, low: float, high: float) -> tuple[Program, Array]:
    """The program in units (P,), N, and its slack.

    Without an upper bound, s is first kept below the largest T0 - low, plus one. Wherever s is
    bounded at all, it is at most that: multipliers y >= 0 with sum y = 1 and N^T y = 0 prove that
    s <= y . (T0 - low). So where s gets as far, there is no largest.
    """
    ends = np.array([low, high if np.isfinite(high) else 0.0])
    unit = np.maximum(np.abs(shortest).max(axis=1), ends.max())
    unit = np.where(unit > 0.0, unit, 1.0)
    above = shortest / unit[:, None] - low / unit[:, None]
    below = high / unit[:, None] - shortest / unit[:, None]
    most = above.max(axis=1) + 1.0
    rows, sides = [-null_space], [above]
    if np.isfinite(high):
        rows, sides = [*rows, null_space], [*sides, below]
    x, _ = solve_linear(rows, [1.0] * len(rows), sides, most)
    slack = np.where(x[:, -1] >= most - 1e-6, np.inf, x[:, -1])
    scaled = shortest / unit[:, None]
    return Program(null_space, scaled, low / unit, high / unit, slack, x[:, :-1].copy()), unit


def solve_linear(
    blocks: list[Array], shares: list[float], sides: list[Array], most: Array
) -> tuple[Array, Array]:
    """The largest s <= most with block z + share s <= side for all blocks.

    Args:
        blocks: (P, m_k, r) each.
        shares: one a block.
        sides: (P, m_k) each.
        most: (P,).

    Returns:
        (z, s), (P, r + 1), and the multipliers of all rows and of `most`, (P, m + 1).
    """
    poses, _, size = blocks[0].shape
    counts = [block.shape[1] for block in blocks]
    rows = np.zeros((poses, sum(counts) + 1, size + 1))
    bounds = np.empty((poses, sum(counts) + 1))
    start = 0
    for block, share, side, count in zip(blocks, shares, sides, counts, strict=True):
        rows[:, start : start + count, :size] = block
        rows[:, start : start + count, size] = share
        bounds[:, start : start + count] = side
        start += count
    rows[:, -1, size], bounds[:, -1] = 1.0, most
    x, multipliers, states = linear_programs(rows, bounds)
    assert np.all(states == SOLVED), f"linear programs ended as {np.unique(states)}"
    return x, multipliers


def _least_norm(program: Program) -> Array:
    wider = np.maximum(_WIDER - program.slack, 0.0)[:, None]
    N = program.null_space
    rows, sides = [-N], [program.shortest - program.low[:, None] + wider]
    if np.all(np.isfinite(program.high)):
        rows, sides = [*rows, N], [*sides, program.high[:, None] - program.shortest + wider]
    z, states = shortest_points(np.concatenate(rows, axis=1), np.concatenate(sides, axis=1))
    assert np.all(states == SOLVED), f"least programs ended as {np.unique(states)}"
    return np.asarray(z)


def _least_infinity(program: Program) -> Array:
    """With s = -(the largest tension): T <= -s, and s <= -low follows.

    The upper bound is kept of itself: the smallest largest tension is below it, or nothing is.
    """
    N = program.null_space
    wider = np.maximum(_WIDER - program.slack, 0.0)
    low = program.low - wider
    sides = [program.shortest - low[:, None], -program.shortest]
    x, _ = solve_linear([-N, N], [0.0, 1.0], sides, -low)
    return x[:, :-1]


def _closed_form(program: Program) -> Array:
    """The projection of the bounds' mean, and again with the worst cable fixed at its bound.

    With Tm the mean of the bounds, Pott's closed form is T = Tm - A^+ (w + A Tm), the nearest to Tm
    of all tensions that balance w. As T0 is square to N's orthonormal columns, it is T0 + N zm with
    zm = N^T Tm. Where it misses bounds, the cable that misses by most is fixed at its bound, and
    the nearest to Tm of what is left is sought: z = zm + N_F^T (N_F N_F^T)^-1 (b - T0_F - N_F zm)
    with F the fixed cables, because |T - Tm|^2 = |z - zm|^2 + constant. At most r cables can be
    fixed. A cable once fixed stays so, and the choice may be a bad one: then no tensions result
    though there are some.
    """
    N, shortest = program.null_space, program.shortest
    poses, cables, size = N.shape
    middle = 0.5 * (program.low + program.high)
    nearest = (np.swapaxes(N, 1, 2) @ np.broadcast_to(middle[:, None, None], (poses, cables, 1)))[
        ..., 0
    ]
    z = nearest.copy()
    wrong = np.arange(poses)
    fixed, values = np.zeros((poses, 0), dtype=np.int64), np.zeros((poses, 0))
    for _ in range(size):
        part = program.pick(wrong)
        tensions = part.tensions(z[wrong])
        missed = np.maximum(part.low[:, None] - tensions, tensions - part.high[:, None])
        np.put_along_axis(missed, fixed, -np.inf, axis=1)
        worst = np.argmax(missed, axis=1)
        bad = np.take_along_axis(missed, worst[:, None], axis=1)[:, 0] > _WIDER
        if not bad.any():
            break
        wrong, worst, tensions = wrong[bad], worst[bad], tensions[bad]
        slack = tensions[np.arange(len(wrong)), worst] < program.low[wrong]
        bound = np.where(slack, program.low[wrong], program.high[wrong])
        fixed = np.column_stack([fixed[bad], worst])
        values = np.column_stack([values[bad], bound])
        rows = np.take_along_axis(N[wrong], fixed[..., None], axis=1)
        left = values - np.take_along_axis(shortest[wrong], fixed, axis=1)
        left -= (rows @ nearest[wrong][..., None])[..., 0]
        z[wrong] = nearest[wrong] + (np.linalg.pinv(rows) @ left[..., None])[..., 0]
    return z


def _analytic_center(program: Program) -> Array:
    z = program.roomiest.copy()
    roomy = program.slack > _THIN
    part = program.pick(roomy)
    lows, highs = part.low[:, None] - part.shortest, part.high[:, None] - part.shortest
    z[roomy] = analytic_centres(part.null_space, lows, highs, part.roomiest)
    return z


#: By name; each takes P programs with solutions and returns their z (P, r).
METHODS: dict[str, Callable[[Program], Array]] = {
    "least_norm": _least_norm,
    "least_infinity": _least_infinity,
    "closed_form": _closed_form,
    "analytic_center": _analytic_center,
}
NEED_BOTH_BOUNDS = ("closed_form", "analytic_center")
