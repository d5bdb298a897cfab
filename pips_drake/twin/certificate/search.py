"""Best-first search for a certificate: which planes are needed, and where.

Whole blocks of the path come first (`blocks.cover_blocks`). Where their planes do not reach the
best distance found so far, less the tolerance, a span of the path is tried with one plane; if that
does not reach it, it is cut in two; a single segment gets a normal that turns; then exact distances
at its ends give better planes (and better witnesses), and at last the segment itself is cut. What
is left at the end is a plane for every pair and every instant.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from pips_drake.config import require
from pips_drake.twin.certificate.blocks import Aim, Planes, cover_blocks
from pips_drake.twin.certificate.bound import turning_bound
from pips_drake.twin.certificate.planes import polish, segment_bounds, span_bounds
from pips_drake.twin.certificate.problem import Prepared, Problem, check_free_turns
from pips_drake.twin.certificate.sweep import Sweep, make_sweep
from pips_drake.twin.certificate.tree import Poses, calc_poses, interpolate
from pips_drake.twin.certificate.witness import Distances, Witness

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Parts of a segment narrower than this are not cut any more; the bound then stays as loose as it
#: is there. Only bodies that touch along a changing feature come near.
NARROWEST = 2.0**-14
_CLOSED = 3
#: Distances after which a search gives up, and says that its bounds are not tight.
MOST_QUERIES = 20_000


@dataclass(frozen=True, kw_only=True, eq=False)
class Certificate:
    """Two-sided bounds of the least distance over a motion.

    Attributes:
        lower: at every instant every pair is at least this far apart, m.
        upper: the witness's distance, m.
        witness: where that is.
        tolerance: what was asked for, m.
        queries: distances of single pairs that were computed.
        wall_s: s.
        planes: the proof of `lower`.
        problem: what it is about.
    """

    lower: float
    upper: float
    witness: Witness
    tolerance: float
    queries: int
    wall_s: float
    planes: Planes = field(repr=False)
    problem: Problem = field(repr=False)

    @property
    def tight(self) -> bool:
        """Whether the bounds are as near to each other as was asked for."""
        return self.upper - self.lower <= self.tolerance


class _Search:
    """The state of a search: spans, each with its best plane so far, and the best witness."""

    def __init__(
        self,
        prepared: Prepared,
        distances: Distances,
        aim: Aim,
        spans: tuple[Indices, Indices, Indices],
    ) -> None:
        self.prepared, self.distances, self.aim = prepared, distances, aim
        self.pair, self.first, self.last = spans
        count = len(self.pair)
        self.start, self.end = np.zeros(count), np.ones(count)
        self.normals = np.full((count, 2, 3), np.nan)
        self.low = np.full(count, -np.inf)
        # 0: a fixed normal; 1: one that turns; 2: between exact ones; 3: cutting does not help.
        self.stage = np.zeros(count, dtype=np.int64)
        self._bound_spans(np.arange(count))

    @property
    def floor(self) -> float:
        """What a bound must reach, m."""
        return self.aim.floor(self.distances.least)

    def run(self) -> None:
        while True:
            open_spans = np.flatnonzero(self.low < self.floor)
            narrow = self.end[open_spans] - self.start[open_spans] < NARROWEST
            open_spans = open_spans[~narrow & (self.stage[open_spans] < _CLOSED)]
            if not len(open_spans) or self.distances.queries >= MOST_QUERIES:
                return
            long = self.last[open_spans] - self.first[open_spans] > 1
            whole = ~long & (self.stage[open_spans] == 0)
            if long.any():
                self._cut_spans(open_spans[long])
            elif whole.any():
                self._turn(open_spans[whole])
            else:
                self._refine(int(open_spans[np.argmin(self.low[open_spans])]))

    def _bound_spans(self, rows: Indices) -> None:
        """Gives spans the better of a suggested plane and the one that they have."""
        prepared = self.prepared
        low, normals = span_bounds(
            prepared.problem.shapes,
            prepared.pairs,
            prepared.poses,
            prepared.motion,
            self.pair[rows],
            self.first[rows],
            self.last[rows],
            np.ascontiguousarray(self.normals[rows, 0]),
        )
        self.low[rows], self.normals[rows] = low, normals[:, None, :]

    def _cut_spans(self, rows: Indices) -> None:
        middle = (self.first[rows] + self.last[rows]) // 2
        new = self._copy(rows)
        self.last[rows], self.first[new] = middle, middle
        self._bound_spans(np.concatenate([rows, new]))

    def _copy(self, rows: Indices) -> Indices:
        """Repeats spans at the end of the list."""
        count = len(self.low)
        for name in ("pair", "first", "last", "start", "end", "normals", "low", "stage"):
            values = getattr(self, name)
            setattr(self, name, np.concatenate([values, values[rows]]))
        return np.arange(count, count + len(rows))

    def _turn(self, rows: Indices) -> None:
        self._bound_segments(rows, self.normals[rows])
        self.stage[rows] = 1

    def _bound_segments(self, rows: Indices, normals: Array) -> None:
        """Gives segments planes that turn, begun at `normals`, where those are better."""
        prepared = self.prepared
        low, normals = segment_bounds(
            prepared.problem.shapes,
            prepared.pairs,
            prepared.poses,
            prepared.motion,
            self.pair[rows],
            self.first[rows],
            np.ascontiguousarray(normals),
        )
        better = low > self.low[rows]
        self.low[rows[better]], self.normals[rows[better]] = low[better], normals[better]

    def _refine(self, w: int) -> None:
        """Exact planes at a part's ends; if it has them, two halves."""
        if self.stage[w] == 2 and self.prepared.motion.deviates and self._is_settled(w):
            self._polish(w)
            self.stage[w] = _CLOSED
            return
        if self.stage[w] == 2:
            (new,) = self._copy(np.array([w])).tolist()
            middle = 0.5 * (self.start[w] + self.end[w])
            self.end[w], self.start[new] = middle, middle
            # The whole's bound holds for both, but its plane does not say so of a half.
            self.low[w] = self.low[new] = -np.inf
            self._bound_exactly(w)
            self._bound_exactly(new)
            return
        self.stage[w] = 2
        self._bound_exactly(w)
        self._spread(int(self.pair[w]), self.normals[w, 0])

    def _is_settled(self, w: int) -> bool:
        """Whether joint errors, and not the width of the part, are what makes a bound loose."""
        p, segment = int(self.pair[w]), int(self.first[w])
        fractions = (float(self.start[w]), float(self.end[w]))
        poses = self._poses(segment, fractions)
        at_ends = []
        for k, fraction in enumerate(fractions):
            n = self.distances.query(p, segment, fraction).normal
            at_ends.append(self._turning_bound(w, poses, (k, k), (n, n), 0.0))
        return bool(self.low[w] >= min(at_ends) - 0.25 * self.aim.tolerance)

    def _polish(self, w: int) -> None:
        """The best plane with errors, where the best one without them is known."""
        prepared, segment = self.prepared, int(self.first[w])
        poses, ends = self._ends(w)
        normals = self.normals[w].copy()
        self.low[w] = polish(
            prepared.problem.shapes, prepared.pairs, poses, prepared.motion, int(self.pair[w]),
            *ends, normals, segment, float(self.end[w] - self.start[w]), float(self.low[w]),
        )  # fmt: skip
        self.normals[w] = normals

    def _ends(self, w: int) -> tuple[Poses, tuple[int, int]]:
        """Poses at both ends of a part of a segment, and which of them those are."""
        segment, start, end = int(self.first[w]), float(self.start[w]), float(self.end[w])
        if start == 0.0 and end == 1.0:
            return self.prepared.poses, (segment, segment + 1)
        return self._poses(segment, (start, end)), (0, 1)

    def _bound_exactly(self, w: int) -> None:
        p, segment = int(self.pair[w]), int(self.first[w])
        start, end = float(self.start[w]), float(self.end[w])
        normals = np.stack(
            [
                self.distances.query(p, segment, start).normal,
                self.distances.query(p, segment, end).normal,
            ]
        )
        poses, ends = self._ends(w)
        # Where the best plane jumps from one pair of features to another, a still one is better.
        still = [np.stack([normal, normal]) for normal in normals]
        for tried in (normals, *still, self.normals[w].copy()):
            low = self._turning_bound(w, poses, ends, tried, end - start)
            if low > self.low[w]:
                self.low[w], self.normals[w] = low, tried

    def _turning_bound(
        self, w: int, poses: Poses, ends: tuple[int, int], normals: Sequence[Array], share: float
    ) -> float:
        """The bound of a part of a segment, m.

        Args:
            w: index of the part.
            poses, ends: of the bodies, and which of them are the part's first and last.
            normals: at both ends, in b's body, (3,) each.
            share: of the segment that the part is.
        """
        prepared = self.prepared
        return float(
            turning_bound(
                prepared.problem.shapes,
                prepared.pairs,
                poses,
                prepared.motion,
                int(self.pair[w]),
                *ends,
                *normals,
                int(self.first[w]),
                share,
            )
        )

    def _spread(self, p: int, normal: Array) -> None:
        """A good plane of one span may do for the pair's others that still count."""
        rows = np.flatnonzero((self.pair == p) & (self.stage < 2) & (self.low < self.floor))
        if not len(rows):
            return
        self._bound_segments(rows, np.tile(normal, (len(rows), 2, 1)))

    def _poses(self, segment: int, fractions: Sequence[float]) -> Poses:
        problem = self.prepared.problem
        q0, q1 = problem.knots[segment], problem.knots[segment + 1]
        return calc_poses(
            problem.tree, np.array([interpolate(problem.tree, q0, q1, s) for s in fractions])
        )


def certify(
    problem: Problem,
    *,
    tolerance: float = 1e-4,
    enough: float = math.inf,
    sweep: Sweep | None = None,
) -> Certificate:
    """Bounds the least distance of a problem's pairs over its whole motion.

    Args:
        tolerance: how near the bounds must come to each other, m.
        enough: a lower bound of this will do, m, however far the distance is above it.
        sweep: of the problem's motion, if it is known.

    Raises:
        InputError: a free body turns too far between two knots.
    """
    began = time.perf_counter()
    require(tolerance > 0.0, "tolerance", f"{tolerance} m", "> 0")
    check_free_turns(problem.tree, problem.knots)
    aim, distances = Aim(tolerance, enough), Distances(problem)
    if sweep is None:
        sweep = make_sweep(problem.tree, problem.knots)
    planes, left = cover_blocks(problem, sweep, distances, aim)
    if len(left[0]):
        planes = _join(planes, _search(problem, sweep, distances, aim, left))
    assert distances.witness is not None
    return Certificate(
        lower=float(min(planes.bounds.min(), distances.least)),
        upper=distances.least,
        witness=distances.witness,
        tolerance=tolerance,
        queries=distances.queries,
        wall_s=time.perf_counter() - began,
        planes=planes,
        problem=problem,
    )


def _search(
    problem: Problem,
    sweep: Sweep,
    distances: Distances,
    aim: Aim,
    spans: tuple[Indices, Indices, Indices],
) -> Planes:
    """Planes for spans of pairs (pair, first and last knot) that need care."""
    pair, first, last = spans
    edges = np.zeros(len(problem.knots), dtype=np.int64)
    np.add.at(edges, first, 1)
    np.add.at(edges, last, -1)
    segments = np.cumsum(edges)[:-1] > 0
    prepared = Prepared(problem, poses=sweep.poses, pairs=np.unique(pair), segments=segments)
    search = _Search(prepared, distances, aim, spans)
    search.run()
    return Planes(
        pair=search.pair,
        first=search.first,
        last=search.last,
        start=search.start,
        end=search.end,
        normals=search.normals,
        swept=np.zeros(len(search.pair), dtype=np.bool_),
        bounds=search.low,
    )


def _join(one: Planes, other: Planes) -> Planes:
    names = [field.name for field in fields(Planes)]
    return Planes(
        **{name: np.concatenate([getattr(one, name), getattr(other, name)]) for name in names}
    )
