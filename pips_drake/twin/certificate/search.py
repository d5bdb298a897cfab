"""Best-first search for a certificate: which planes are needed, and where.

Whole spans of the path are first tried with one plane a pair. A span whose bound does not reach the
best distance found so far, less the tolerance, is cut in two; a single segment gets a normal that
turns; then exact distances at its ends give better planes (and better witnesses), and at last the
segment itself is cut. What is left at the end is a plane for every pair and every instant.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pips_drake.config import require
from pips_drake.twin.certificate.bound import relative, turning_bound
from pips_drake.twin.certificate.distance import Closest, closest
from pips_drake.twin.certificate.planes import segment_bounds, span_bounds
from pips_drake.twin.certificate.problem import Prepared, Problem
from pips_drake.twin.certificate.tree import Poses, calc_poses, interpolate

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Segments of a span that is tried first.
LONGEST_SPAN = 64
#: Parts of a segment narrower than this are not cut any more; the bound then stays as loose as it
#: is there. Only bodies that touch along a changing feature come near.
NARROWEST = 2.0**-14
_CLOSED = 3
#: Distances after which a search gives up, and says that its bounds are not tight.
MOST_QUERIES = 20_000


@dataclass(frozen=True, kw_only=True, eq=False)
class Witness:
    """Where a pair comes nearest.

    Attributes:
        pair: index of the pair.
        bodies, geometries: names, the robot's first.
        time: s.
        segment, fraction: where on the path.
        distance: m; the true distance there is no more.
        points: nearest points on both, in the world, (2, 3) m.
        deviation: how far the positions are off there, (nq,).
        closest: the proof of the distance.
    """

    pair: int
    bodies: tuple[str, str]
    geometries: tuple[str, str]
    time: float
    segment: int
    fraction: float
    distance: float
    points: Array
    deviation: Array
    closest: Closest = field(repr=False)


@dataclass(frozen=True, kw_only=True, eq=False)
class Planes:
    """W spans that cover every pair and instant, each with its plane.

    A span goes from `first[w]` + `start[w]` to `last[w]` - 1 + `end[w]` in segments: over several
    segments it is whole (start 0, end 1) and its normal fixed; in a single one the normal turns.

    Attributes:
        pair, first, last: (W,).
        start, end: (W,).
        normals: at both ends, in b's body, (W, 2, 3).
        bounds: m, (W,).
    """

    pair: Indices
    first: Indices
    last: Indices
    start: Array
    end: Array
    normals: Array
    bounds: Array


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
    """The state of a search: spans that still count, and the best witness."""

    def __init__(self, prepared: Prepared, tolerance: float) -> None:
        self.prepared, self.tolerance = prepared, tolerance
        self.queries = 0
        self.witness: Witness | None = None
        self._known: dict[tuple[int, int, float], Closest] = {}
        segments, pairs = len(prepared.problem.times) - 1, len(prepared.problem.a)
        first = np.arange(0, segments, LONGEST_SPAN)
        last = np.minimum(first + LONGEST_SPAN, segments)
        spans = len(first)
        count = pairs * spans
        self.pair = np.repeat(np.arange(pairs), spans)
        self.first, self.last = np.tile(first, pairs), np.tile(last, pairs)
        self.start, self.end = np.zeros(count), np.ones(count)
        self.normals = np.full((count, 2, 3), np.nan)
        self.low = np.full(count, -np.inf)
        # 0: a fixed normal; 1: one that turns; 2: between exact ones; 3: cutting does not help.
        self.stage = np.zeros(count, dtype=np.int64)
        self._bound_spans(np.arange(count))

    @property
    def best(self) -> float:
        return math.inf if self.witness is None else self.witness.distance

    def run(self) -> None:
        # A first witness, where planes that cost nothing are tightest.
        w = int(np.argmin(self.low))
        self.query(int(self.pair[w]), int(self.first[w] + self.last[w]) // 2, 0.0)
        while True:
            open_spans = np.flatnonzero(self.low < self.best - self.tolerance)
            narrow = self.end[open_spans] - self.start[open_spans] < NARROWEST
            open_spans = open_spans[~narrow & (self.stage[open_spans] < _CLOSED)]
            if not len(open_spans) or self.queries >= MOST_QUERIES:
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
        prepared = self.prepared
        low, normals = segment_bounds(
            prepared.problem.shapes,
            prepared.pairs,
            prepared.poses,
            prepared.motion,
            self.pair[rows],
            self.first[rows],
            np.ascontiguousarray(self.normals[rows]),
        )
        self.stage[rows] = 1
        better = low > self.low[rows]
        self.low[rows[better]], self.normals[rows[better]] = low[better], normals[better]

    def _refine(self, w: int) -> None:
        """Exact planes at a part's ends; if it has them, two halves."""
        if self.stage[w] == 2 and self.prepared.motion.deviates and self._is_settled(w):
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
        p, segment, prepared = int(self.pair[w]), int(self.first[w]), self.prepared
        fractions = (float(self.start[w]), float(self.end[w]))
        poses = self._poses(segment, fractions)
        at_ends = []
        for k, fraction in enumerate(fractions):
            n = self.query(p, segment, fraction).normal
            at_ends.append(
                turning_bound(
                    prepared.problem.shapes,
                    prepared.pairs,
                    poses,
                    prepared.motion,
                    p,
                    k,
                    k,
                    n,
                    n,
                    segment,
                    0.0,
                )
            )
        return bool(self.low[w] >= min(at_ends) - 0.25 * self.tolerance)

    def _bound_exactly(self, w: int) -> None:
        p, segment = int(self.pair[w]), int(self.first[w])
        start, end = float(self.start[w]), float(self.end[w])
        normals = np.stack(
            [self.query(p, segment, start).normal, self.query(p, segment, end).normal]
        )
        prepared = self.prepared
        if start == 0.0 and end == 1.0:
            poses, k0, k1 = prepared.poses, segment, segment + 1
        else:
            poses, k0, k1 = self._poses(segment, (start, end)), 0, 1
        # Where the best plane jumps from one pair of features to another, a still one is better.
        still = [np.stack([normal, normal]) for normal in normals]
        for tried in (normals, *still, self.normals[w].copy()):
            low = turning_bound(
                prepared.problem.shapes,
                prepared.pairs,
                poses,
                prepared.motion,
                p,
                k0,
                k1,
                tried[0],
                tried[1],
                segment,
                end - start,
            )
            if low > self.low[w]:
                self.low[w], self.normals[w] = low, tried

    def _spread(self, p: int, normal: Array) -> None:
        """A good plane of one span may do for the pair's others that still count."""
        rows = np.flatnonzero(
            (self.pair == p) & (self.stage < 2) & (self.low < self.best - self.tolerance)
        )
        if not len(rows):
            return
        prepared = self.prepared
        low, normals = segment_bounds(
            prepared.problem.shapes,
            prepared.pairs,
            prepared.poses,
            prepared.motion,
            self.pair[rows],
            self.first[rows],
            np.tile(normal, (len(rows), 2, 1)),
        )
        better = low > self.low[rows]
        self.low[rows[better]], self.normals[rows[better]] = low[better], normals[better]

    def _poses(self, segment: int, fractions: Sequence[float]) -> Poses:
        problem = self.prepared.problem
        q0, q1 = problem.knots[segment], problem.knots[segment + 1]
        return calc_poses(
            problem.tree, np.array([interpolate(problem.tree, q0, q1, s) for s in fractions])
        )

    def query(self, p: int, segment: int, fraction: float) -> Closest:
        """The pair's distance at an instant; remembers the least of all."""
        if fraction == 1.0:
            segment, fraction = segment + 1, 0.0
        key = (p, segment, fraction)
        if key in self._known:
            return self._known[key]
        problem = self.prepared.problem
        if fraction == 0.0:
            q = problem.knots[segment]
        else:
            q = interpolate(
                problem.tree, problem.knots[segment], problem.knots[segment + 1], fraction
            )
        found, poses = self._closest(p, q)
        self._known[key] = found
        off = np.zeros(len(q))
        self._remember(p, segment, fraction, found, poses, off)
        if self.prepared.motion.deviates:
            off = self._worst_errors(p, found, poses)
            worse, poses = self._closest(p, q + off)
            self._remember(p, segment, fraction, worse, poses, off)
        return found

    def _closest(self, p: int, q: Array) -> tuple[Closest, Poses]:
        self.queries += 1
        problem = self.prepared.problem
        poses = calc_poses(problem.tree, q[None])
        a, b = int(problem.a[p]), int(problem.b[p])
        R, t = np.empty((3, 3)), np.empty(3)
        relative(
            poses.rotation[0],
            poses.position[0],
            problem.shapes.body[a],
            problem.shapes.body[b],
            R,
            t,
        )
        return closest(problem.shapes, a, b, R, t), poses

    def _worst_errors(self, p: int, found: Closest, poses: Poses) -> Array:
        """The joint errors that bring the nearest points nearer, to first order, (nq,)."""
        problem, motion = self.prepared.problem, self.prepared.motion
        body = problem.shapes.body[problem.b[p]]
        R, t = poses.rotation[0, body], poses.position[0, body]
        normal, point = R @ found.normal, R @ found.points[0] + t
        off = np.zeros(problem.knots.shape[1])
        row = self.prepared.pairs.chain[p]
        for joint, sign in zip(motion.bodies[row], motion.signs[row], strict=True):
            if sign == 0:
                break
            axis = poses.axis[0, joint]
            moves = axis
            if not motion.slides[joint]:
                moves = np.cross(axis, point - poses.origin[0, joint, 1])
            off[problem.tree.start[joint]] = (
                -np.sign(sign * (normal @ moves)) * motion.deviation[joint]
            )
        return off

    def _remember(
        self, p: int, segment: int, fraction: float, found: Closest, poses: Poses, off: Array
    ) -> None:
        if found.upper >= self.best:
            return
        problem = self.prepared.problem
        body = problem.shapes.body[problem.b[p]]
        R, t = poses.rotation[0, body], poses.position[0, body]
        a, b = int(problem.a[p]), int(problem.b[p])
        times = problem.times
        time_ = float(times[segment])
        if fraction > 0.0:
            time_ += fraction * float(times[segment + 1] - times[segment])
        self.witness = Witness(
            pair=p,
            bodies=(problem.bodies[a], problem.bodies[b]),
            geometries=(problem.names[a], problem.names[b]),
            time=time_,
            segment=segment,
            fraction=fraction,
            distance=found.upper,
            points=found.points @ R.T + t,
            deviation=off,
            closest=found,
        )


def certify(problem: Problem, *, tolerance: float = 1e-4) -> Certificate:
    """Bounds the least distance of a problem's pairs over its whole motion.

    Raises:
        InputError: a free body turns too far between two knots.
    """
    began = time.perf_counter()
    require(tolerance > 0.0, "tolerance", f"{tolerance} m", "> 0")
    search = _Search(Prepared(problem), tolerance)
    search.run()
    assert search.witness is not None
    return Certificate(
        lower=float(min(search.low.min(), search.best)),
        upper=search.best,
        witness=search.witness,
        tolerance=tolerance,
        queries=search.queries,
        wall_s=time.perf_counter() - began,
        planes=Planes(
            pair=search.pair,
            first=search.first,
            last=search.last,
            start=search.start,
            end=search.end,
            normals=search.normals,
            bounds=search.low,
        ),
        problem=problem,
    )
