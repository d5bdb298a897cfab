"""Bodies over dyadic blocks of a motion: how far they are from chords, and planes for whole blocks.

A block of level l is 2^l segments. Over a block from knot k0 to k1 a body is compared with its
chord, the affine map (1 - s) X(k0) + s X(k1), with s even in the knots' numbers. A point of it is
never farther from its own chord than

    departure = at_origin + by_reach * (its distance from the body's joint)

so that planes are bounded over thousands of segments at the cost of one. docs/certificate.md,
section 7, has the proof.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from pips_drake.twin.certificate.bound import (
    ROUNDING,
    bulge_of,
    copy,
    dot,
    gap,
    into_frame,
    out_of_frame,
    relative,
)
from pips_drake.twin.certificate.distance import closest_cores
from pips_drake.twin.certificate.motion import free_turn, span_of
from pips_drake.twin.certificate.planes import suggest
from pips_drake.twin.certificate.tree import (
    PRISMATIC,
    REVOLUTE,
    Poses,
    Tree,
    calc_poses,
    inner,
    rotate,
)

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Sweep(NamedTuple):
    """A motion by blocks; a plain tuple for compiled code.

    Attributes:
        poses: at the N knots.
        starts: of each level, the row of its first block, (levels,).
        at_origin, by_reach: departures of each body from its chord, (rows, B) m and m by m.
    """

    poses: Poses
    starts: Indices
    at_origin: Array
    by_reach: Array


def make_sweep(tree: Tree, knots: Array) -> Sweep:
    """A motion (N, nq), N >= 2, by blocks."""
    poses = calc_poses(tree, knots)
    segments, starts, rows = len(knots) - 1, [], 0
    while True:
        starts.append(rows)
        blocks = -(-segments // 2 ** (len(starts) - 1))
        rows += blocks
        if blocks == 1:
            break
    levels = np.array(starts, dtype=np.int64)
    return Sweep(poses, levels, *_departures(tree, poses, knots, levels, rows))


@inner
def _away_from_chord(u, v, w, share):
    """How far v is from (1 - share) u + share w."""
    total = 0.0
    for i in range(3):
        total += (v[i] - u[i] - share * (w[i] - u[i])) ** 2
    return total


@numba.njit(cache=True)
def _departures(tree, poses, q, starts, rows):
    """The departures of `Sweep`: of segments from section 3's bounds, of blocks from their halves.

    A half is within its own departure of its chord, and that chord within the departure of the
    middle knot of the block's.
    """
    bodies, segments = tree.parent.shape[0], q.shape[0] - 1
    at_origin, by_reach = np.zeros((rows, bodies)), np.zeros((rows, bodies))
    angular, speed, acceleration = np.zeros(bodies), np.zeros(bodies), np.zeros(bodies)
    w0, w1, x = np.zeros((bodies, 3)), np.zeros((bodies, 3)), np.empty((2, 3))
    for k in range(segments):
        for b in range(1, bodies):
            # As `motion.bending` goes along a chain; here outward from the world, all at once.
            a, kind, i = tree.parent[b], tree.kind[b], tree.start[b]
            o0, o1 = poses.origin[k, b, 1], poses.origin[k + 1, b, 1]
            about = angular[a] + speed[a] * speed[a]
            acceleration[b] = acceleration[a]
            if about > 0.0:
                r = max(span_of(o0, poses.origin[k, a, 1]), span_of(o1, poses.origin[k + 1, a, 1]))
                acceleration[b] += about * r
            angular[b], speed[b] = angular[a], speed[a]
            copy(w0[a], w0[b])
            copy(w1[a], w1[b])
            angle = 0.0
            if kind == REVOLUTE:
                angle = q[k + 1, i] - q[k, i]
                copy(poses.axis[k, b], x[0])
                copy(poses.axis[k + 1, b], x[1])
            elif kind == PRISMATIC:
                acceleration[b] += 2.0 * speed[a] * abs(q[k + 1, i] - q[k, i])
            else:
                slide = span_of(q[k + 1, i + 4 : i + 7], q[k, i + 4 : i + 7])
                acceleration[b] += 2.0 * speed[a] * slide
                turn = np.empty(3)
                angle = free_turn(tree, poses, b, k, turn)
                rotate(poses.rotation[k, a], turn, x[0])
                rotate(poses.rotation[k + 1, a], turn, x[1])
            if angle != 0.0:
                for j in range(3):
                    w0[b, j] += angle * x[0, j]
                    w1[b, j] += angle * x[1, j]
                angular[b] += abs(angle) * speed[a]
                ends = math.sqrt(dot(w0[b], w0[b])) + math.sqrt(dot(w1[b], w1[b]))
                speed[b] = min(speed[a] + abs(angle), 0.5 * (ends + angular[b]))
            at_origin[k, b] = 0.125 * acceleration[b]
            by_reach[k, b] = 0.125 * (angular[b] + speed[b] * speed[b])
    for level in range(1, starts.shape[0]):
        end = starts[level + 1] if level + 1 < starts.shape[0] else rows
        half = 1 << (level - 1)
        for row in range(starts[level], end):
            first = 2 * half * (row - starts[level])
            left = starts[level - 1] + 2 * (row - starts[level])
            middle, last = first + half, min(first + 2 * half, segments)
            for b in range(1, bodies):
                at_origin[row, b], by_reach[row, b] = at_origin[left, b], by_reach[left, b]
                if middle >= segments:
                    continue
                share = half / (last - first)
                moved = _away_from_chord(
                    poses.origin[first, b, 1],
                    poses.origin[middle, b, 1],
                    poses.origin[last, b, 1],
                    share,
                )
                turned = 0.0
                for i in range(3):
                    turned += _away_from_chord(
                        poses.rotation[first, b, i],
                        poses.rotation[middle, b, i],
                        poses.rotation[last, b, i],
                        share,
                    )
                at_origin[row, b] = max(at_origin[left, b], at_origin[left + 1, b])
                by_reach[row, b] = max(by_reach[left, b], by_reach[left + 1, b])
                at_origin[row, b] += math.sqrt(moved)
                by_reach[row, b] += math.sqrt(turned)
    return at_origin, by_reach


@inner
def _directions(poses, body, k0, k1, n0, n1, m, along):
    """Bernstein's coefficients of n(s) . p(s): those of a vertex v are m[c] . v + along[c]."""
    R0, R1 = poses.rotation[k0, body], poses.rotation[k1, body]
    t0, t1 = poses.position[k0, body], poses.position[k1, body]
    into_frame(R0, n0, m[0])
    into_frame(R1, n0, m[1])
    into_frame(R0, n1, m[3])
    into_frame(R1, n1, m[2])
    for i in range(3):
        m[1, i] = 0.5 * (m[1, i] + m[3, i])
    along[0], along[2] = dot(n0, t0), dot(n1, t1)
    along[1] = 0.5 * (dot(n0, t1) + dot(n1, t0))


@inner
def _top(shapes, s, m):
    """Largest m . x over a shape's core; infinite for a half space off its normal."""
    h = shapes.half_space[s]
    if dot(h, h) > 0.0 and not (h[0] == m[0] and h[1] == m[1] and h[2] == m[2]):
        return np.inf
    highest = -np.inf
    for v in range(shapes.starts[s], shapes.starts[s + 1]):
        highest = max(highest, dot(shapes.vertices[v], m))
    return highest + bulge_of(shapes, s, m)


@numba.njit(cache=True)
def chord_bound(shapes, poses, a, b, k0, k1, n0, n1, away, work):
    """Lower bound of two shapes' distance over a block from knot k0 to k1, m.

    Args:
        n0, n1: unit normals in the world at both ends, from b to a; between them n goes straight.
        away: how far points of both are from their chords, together, and both radii, m.
        work: scratch, (3, 4, 3) m.

    Returns:
        the bound, and the gaps at both ends without `away`.
    """
    length = 0.5 * math.sqrt((n0[0] + n1[0]) ** 2 + (n0[1] + n1[1]) ** 2 + (n0[2] + n1[2]) ** 2)
    if length < 1e-3:
        return -np.inf, np.inf, np.inf
    m, along, off = work[0], work[1, 0], work[1, 1]
    _directions(poses, shapes.body[b], k0, k1, n0, n1, m, along)
    for c in range(3):
        off[c] = -along[c] - _top(shapes, b, m[c]) - away
    _directions(poses, shapes.body[a], k0, k1, n0, n1, m, along)
    for c in range(3):
        off[c] += along[c] - bulge_of(shapes, a, m[c])
    lowest = first = second = np.inf
    for row in range(shapes.starts[a], shapes.starts[a + 1]):
        v = shapes.vertices[row]
        b0, b1, b2 = off[0] + dot(m[0], v), off[1] + dot(m[1], v), off[2] + dot(m[2], v)
        first, second = min(first, b0), min(second, b2)
        least = min(b0, b2)
        if b1 < least:
            # As in `bound.turning_bound`.
            least = b1 + (b0 - b1) * ((b2 - b1) / ((b0 - b1) + (b2 - b1)))
        lowest = min(lowest, least)
    if lowest < 0.0:
        lowest /= length
    return lowest - ROUNDING, first + away, second + away


@inner
def _aim(shapes, poses, a, b, k, floor, n):
    """A good normal at a knot, in the world; an exact one if the suggested gap is below floor."""
    i, j = shapes.body[a], shapes.body[b]
    R, t, local = np.empty((3, 3)), np.empty(3), np.empty(3)
    relative(poses.rotation[k], poses.position[k], i, j, R, t)
    suggest(shapes, a, b, R, t, local)
    found = gap(shapes, a, b, R, t, local)
    h = shapes.half_space[b]
    if found < floor and dot(h, h) == 0.0:
        exact = closest_cores(shapes, a, b, R, t)[0]
        better = gap(shapes, a, b, R, t, exact)
        if better > found:
            found = better
            copy(exact, local)
    out_of_frame(poses.rotation[k, j], local, n)
    return found


@inner
def _centre(shapes, outline, poses, s, k, out):
    body = shapes.body[s]
    rotate(poses.rotation[k, body], outline.centre[s], out)
    for i in range(3):
        out[i] += poses.position[k, body, i]


@numba.njit(cache=True)
def block_bounds(shapes, outline, sweep, pair_a, pair_b, level, rows, blocks, normals, floor):
    """Bounds of W pairs over a block each; good planes are looked for below `floor` only.

    Args:
        rows, blocks: pair and block of the level, (W,).
        normals: in the world at both ends, (W, 2, 3), from earlier tries; NaN for none. Replaced.

    Returns:
        bounds (W,) m; whether halves may do better, (W,) bool: what joints' errors move is the same
        in them; and which of those that are below `floor` comes nearest to contact: the pair, the
        knot and the gap there (infinite if there is none).
    """
    poses = sweep.poses
    segments = poses.position.shape[0] - 1
    low, divides = np.full(rows.shape[0], -np.inf), np.ones(rows.shape[0], dtype=np.bool_)
    c0, c1, n = np.empty(3), np.empty(3), np.empty(3)
    work = np.empty((3, 4, 3))
    near_pair, near_knot, near = -1, -1, np.inf
    for w in range(rows.shape[0]):
        a, b = pair_a[rows[w]], pair_b[rows[w]]
        i, j = shapes.body[a], shapes.body[b]
        k0 = blocks[w] << level
        k1 = min(k0 + (1 << level), segments)
        row = sweep.starts[level] + blocks[w]
        departure = sweep.at_origin[row, i] + sweep.by_reach[row, i] * outline.reach[a]
        departure += sweep.at_origin[row, j] + sweep.by_reach[row, j] * outline.reach[b]
        errors = outline.error[a] + outline.error[b]
        divides[w] = departure >= errors
        departure += errors
        if outline.ball[b] < np.inf:
            # Balls about both: the point of their centres' way that is nearest to 0.
            _centre(shapes, outline, poses, a, k0, c0)
            _centre(shapes, outline, poses, b, k0, n)
            for axis in range(3):
                c0[axis] -= n[axis]
            _centre(shapes, outline, poses, a, k1, c1)
            _centre(shapes, outline, poses, b, k1, n)
            moved = passed = 0.0
            for axis in range(3):
                c1[axis] -= n[axis]
                moved += (c1[axis] - c0[axis]) ** 2
                passed -= c0[axis] * (c1[axis] - c0[axis])
            share = min(1.0, max(0.0, passed / moved)) if moved > 0.0 else 0.0
            for axis in range(3):
                n[axis] = c0[axis] + share * (c1[axis] - c0[axis])
            apart = math.sqrt(dot(n, n))
            if apart - departure < floor:
                continue
            found = apart - departure - outline.ball[a] - outline.ball[b] - 2.0 * ROUNDING
            if found >= floor and apart > 1e-6:
                low[w] = found
                for axis in range(3):
                    normals[w, 0, axis] = normals[w, 1, axis] = n[axis] / apart
                continue
        elif j != 0:
            continue
        away = departure + shapes.radius[a] + shapes.radius[b]
        for end in range(2):
            if normals[w, end, 0] != normals[w, end, 0]:
                _aim(shapes, poses, a, b, k1 if end else k0, floor, normals[w, end])
        found, first, second = chord_bound(
            shapes, poses, a, b, k0, k1, normals[w, 0], normals[w, 1], away, work
        )
        radii = shapes.radius[a] + shapes.radius[b]
        first, second = first - radii, second - radii
        if first < near:
            near_pair, near_knot, near = rows[w], k0, first
        if second < near:
            near_pair, near_knot, near = rows[w], k1, second
        low[w] = found
        if found < floor and min(first, second) - departure >= floor:
            # One of the two may do where they do not go together.
            for end in range(2):
                copy(normals[w, end], n)
                found = chord_bound(shapes, poses, a, b, k0, k1, n, n, away, work)[0]
                if found >= floor:
                    low[w] = found
                    copy(n, normals[w, 1 - end])
                    break
    return low, divides, near_pair, near_knot, near


@numba.njit(cache=True)
def nearest_at(shapes, outline, poses, pair_a, pair_b, knots):
    """The pair and the knot, of some, where the gap is least as far as balls and planes tell."""
    near_pair, near_knot, near = 0, knots[0], np.inf
    x, y = np.empty(3), np.empty(3)
    for k in knots:
        for p in range(pair_a.shape[0]):
            a, b = pair_a[p], pair_b[p]
            if outline.ball[b] < np.inf:
                _centre(shapes, outline, poses, a, k, x)
                _centre(shapes, outline, poses, b, k, y)
                if span_of(x, y) - outline.ball[a] - outline.ball[b] >= near:
                    continue
            found = _aim(shapes, poses, a, b, k, near, x)
            if found < near:
                near_pair, near_knot, near = p, k, found
    return near_pair, near_knot
