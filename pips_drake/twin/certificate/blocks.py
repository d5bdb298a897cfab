"""Planes for whole blocks of a motion: what is far needs few, what is near is left for later."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pips_drake.twin.certificate.outline import make_outline
from pips_drake.twin.certificate.problem import Problem
from pips_drake.twin.certificate.sweep import Sweep, block_bounds, nearest_at
from pips_drake.twin.certificate.witness import Distances

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Knots at which a first witness is looked for.
_FIRST_LOOKS = 17


@dataclass(frozen=True, kw_only=True, eq=False)
class Planes:
    """W spans that cover every pair and instant, each with its plane.

    A span goes from `first[w]` + `start[w]` to `last[w]` - 1 + `end[w]` in segments: over several
    segments it is whole (start 0, end 1) and its normal fixed; in a single one the normal turns. A
    swept one is whole too, and its normal turns in the world.

    Attributes:
        pair, first, last: (W,).
        start, end: (W,).
        normals: at both ends, in b's body, or in the world if swept, (W, 2, 3).
        swept: (W,) bool.
        bounds: m, (W,).
    """

    pair: Indices
    first: Indices
    last: Indices
    start: Array
    end: Array
    normals: Array
    swept: NDArray[np.bool_]
    bounds: Array


@dataclass(frozen=True)
class Aim:
    """When a bound is good enough.

    Attributes:
        tolerance: how far it may be below the least distance that is known, m.
        enough: what will do in any case, m.
    """

    tolerance: float
    enough: float

    def floor(self, least: float) -> float:
        """What a bound must reach if `least` is the least distance that is known, m."""
        return min(self.enough, least - self.tolerance)


def cover_blocks(
    problem: Problem, sweep: Sweep, distances: Distances, aim: Aim
) -> tuple[Planes, tuple[Indices, Indices, Indices]]:
    """Planes over blocks of the motion, from all of it down to segments.

    Returns:
        planes that reach the floor, and where there are none: pairs, first and last knots.
    """
    outline = make_outline(problem.tree, problem.shapes, problem.knots, problem.deviation)
    segments = len(problem.knots) - 1
    count = len(problem.a)
    looks = np.unique(np.linspace(0, segments, min(_FIRST_LOOKS, segments + 1)).astype(np.int64))
    pair, knot = nearest_at(problem.shapes, outline, sweep.poses, problem.a, problem.b, looks)
    known = distances.query(int(pair), int(knot), 0.0).upper
    rows, blocks = np.arange(count), np.zeros(count, dtype=np.int64)
    normals = np.full((count, 2, 3), np.nan)
    found: list[tuple[Array, ...]] = []
    left: list[tuple[Indices, ...]] = []
    for level in range(len(sweep.starts) - 1, -1, -1):
        low, divides, pair, knot, near = block_bounds(
            problem.shapes, outline, sweep, problem.a, problem.b, level, rows, blocks, normals,
            aim.floor(distances.least),
        )  # fmt: skip
        if near < known:
            known = min(known, distances.query(int(pair), int(knot), 0.0).upper)
        done = low >= aim.floor(distances.least)
        first = blocks << level
        last = np.minimum(first + (1 << level), segments)
        found.append((rows[done], first[done], last[done], normals[done], low[done]))
        cut = ~done & divides if level > 0 else np.zeros_like(done)
        rest = ~done & ~cut
        left.append((rows[rest], first[rest], last[rest]))
        rows, blocks, normals, first = rows[cut], blocks[cut], normals[cut], first[cut]
        # Both halves; the last block of a level may have one only.
        halves = np.full((2, *normals.shape), np.nan)
        halves[0, :, 0], halves[1, :, 1] = normals[:, 0], normals[:, 1]
        second = first + ((1 << level) >> 1) < segments
        halves[0, ~second, 1] = normals[~second, 1]
        rows = np.concatenate([rows, rows[second]])
        blocks = np.concatenate([2 * blocks, 2 * blocks[second] + 1])
        normals = np.concatenate([halves[0], halves[1, second]])
    pairs, firsts, lasts, normal, lows = (
        np.concatenate(column) for column in zip(*found, strict=True)
    )
    planes = Planes(
        pair=pairs,
        first=firsts,
        last=lasts,
        start=np.zeros(len(pairs)),
        end=np.ones(len(pairs)),
        normals=normal,
        swept=np.ones(len(pairs), dtype=np.bool_),
        bounds=lows,
    )
    rows, first, last = (np.concatenate(column) for column in zip(*left, strict=True))
    return planes, (rows, first, last)
