"""Lower bounds of a pair's distance from separating planes, compiled.

For convex bodies A and B and any unit normal n (in B's frame, from B towards A)

    distance >= gap(n) = min over A of n . a  -  max over B of n . b,

in penetration too. `turning_bound` bounds it over a part of a segment in which n goes linearly from
n0 to n1; `fixed_bound` over many segments with one n.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from pips_drake.twin.certificate.tree import inner

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Taken off every bound for rounding, m: a ten-thousandth of the finest tolerance, and a thousand
#: times what double precision loses over the longest chains.
ROUNDING = 1e-9


class Pairs(NamedTuple):
    """P pairs of shapes; A moves as B sees it.

    Attributes:
        a, b: shapes, (P,).
        chain: row of the motion bounds, from b's body to a's, (P,).
        reach: how far a's points are from the chain's last origin, at most, (P,) m.
    """

    a: Indices
    b: Indices
    chain: Indices
    reach: Array


class Motion(NamedTuple):
    """What the joints' motion says of the pairs' chains: L chains of at most C joints.

    Attributes:
        bodies, signs: the chains, (L, C) each (`motion.stack_chains`).
        at_origin, by_reach: bounds on |p''| over each segment (`motion.bending`), (L, N - 1).
        deviates: whether joints may be off their positions.
        deviation: by how much the joint of each body, (B,) m or rad.
        slides: which of them slide, (B,).
        remainder_at_origin, remainder_by_reach: what that moves points beyond its first order, at
            most, m, and m by m of distance, (L, N - 1).
    """

    bodies: Indices
    signs: Indices
    at_origin: Array
    by_reach: Array
    deviates: bool
    deviation: Array
    slides: NDArray[np.bool_]
    remainder_at_origin: Array
    remainder_by_reach: Array


@inner
def dot(u, v):
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@inner
def copy(x, out):
    # Compiles in a tenth of the time of a slice assignment.
    for i in range(3):
        out[i] = x[i]


@inner
def into_frame(R, x, out):
    """R^T x."""
    for i in range(3):
        out[i] = R[0, i] * x[0] + R[1, i] * x[1] + R[2, i] * x[2]


@inner
def out_of_frame(R, x, out):
    """R x."""
    for i in range(3):
        out[i] = R[i, 0] * x[0] + R[i, 1] * x[1] + R[i, 2] * x[2]


@inner
def bulge_of(shapes, s, n):
    """|E^T n|."""
    E = shapes.bulge[s]
    x = E[0, 0] * n[0] + E[1, 0] * n[1] + E[2, 0] * n[2]
    y = E[0, 1] * n[0] + E[1, 1] * n[1] + E[2, 1] * n[2]
    z = E[0, 2] * n[0] + E[1, 2] * n[1] + E[2, 2] * n[2]
    return math.sqrt(x * x + y * y + z * z)


@inner
def support(shapes, s, n):
    """Largest n . x over the shape's points, m; infinite for a half space off its normal."""
    m = shapes.half_space[s]
    if dot(m, m) > 0.0 and not (m[0] == n[0] and m[1] == n[1] and m[2] == n[2]):
        return np.inf
    highest = -np.inf
    for v in range(shapes.starts[s], shapes.starts[s + 1]):
        highest = max(highest, dot(shapes.vertices[v], n))
    length = math.sqrt(dot(n, n))
    return highest + bulge_of(shapes, s, n) + shapes.radius[s] * length


@numba.njit(cache=True)
def relative(rotation, position, a, b, R, t):
    """Pose of body a in body b's frame, from poses (B, 3, 3) and (B, 3) in the world."""
    Ra, Rb = rotation[a], rotation[b]
    for i in range(3):
        t[i] = 0.0
        for j in range(3):
            R[i, j] = Rb[0, i] * Ra[0, j] + Rb[1, i] * Ra[1, j] + Rb[2, i] * Ra[2, j]
            t[i] += Rb[j, i] * (position[a, j] - position[b, j])


@numba.njit(cache=True)
def gap(shapes, a, b, R, t, n):
    """Gap of shape a (at R, t in b's body) and b along the unit normal n, m."""
    m = np.empty(3)
    into_frame(R, n, m)
    lowest = np.inf
    for v in range(shapes.starts[a], shapes.starts[a + 1]):
        lowest = min(lowest, dot(shapes.vertices[v], m))
    lowest += dot(n, t) - bulge_of(shapes, a, m) - shapes.radius[a]
    return lowest - support(shapes, b, n)


@inner
def _levers(shapes, pairs, poses, motion, p, k, n, levers, offsets):
    """How joint errors move points of shape a along n (in b's body) at knot k.

    A point x of a's body goes levers[c] . x + offsets[c] along n for the error that joint c may
    have, at most, (C, 3) and (C,) m.
    """
    row = pairs.chain[p]
    i, j = shapes.body[pairs.a[p]], shapes.body[pairs.b[p]]
    w, u = np.empty(3), np.empty(3)
    out_of_frame(poses.rotation[k, j], n, w)
    for c in range(motion.bodies.shape[1]):
        levers[c, 0] = levers[c, 1] = levers[c, 2] = 0.0
        offsets[c] = 0.0
        joint = motion.bodies[row, c]
        error = motion.deviation[joint]
        if motion.signs[row, c] == 0 or error == 0.0:
            continue
        z = poses.axis[k, joint]
        if motion.slides[joint]:
            offsets[c] = error * dot(w, z)
            continue
        u[0] = error * (w[1] * z[2] - w[2] * z[1])
        u[1] = error * (w[2] * z[0] - w[0] * z[2])
        u[2] = error * (w[0] * z[1] - w[1] * z[0])
        into_frame(poses.rotation[k, i], u, levers[c])
        for axis in range(3):
            offsets[c] += u[axis] * (poses.position[k, i, axis] - poses.origin[k, joint, 1, axis])


@inner
def _moved(shapes, a, levers, offsets, v):
    """How far errors move vertex v (with the bulge around it) of shape a, at most, m."""
    total = 0.0
    for c in range(offsets.shape[0]):
        total += abs(dot(levers[c], shapes.vertices[v]) + offsets[c])
        total += bulge_of(shapes, a, levers[c])
    return total


@inner
def bend_of(pairs, motion, p, segment):
    """Bound on |p''| over a segment, m."""
    row = pairs.chain[p]
    return motion.at_origin[row, segment] + motion.by_reach[row, segment] * pairs.reach[p]


@inner
def _remainder(pairs, motion, p, segment):
    """What joint errors add beyond their first order, at most, m."""
    row = pairs.chain[p]
    return (
        motion.remainder_at_origin[row, segment]
        + motion.remainder_by_reach[row, segment] * pairs.reach[p]
    )


@numba.njit(cache=True)
def turning_bound(shapes, pairs, poses, motion, p, k0, k1, n0, n1, segment, width):
    """Lower bound of the distance over a part of a segment, from knot k0 of `poses` to k1, m.

    Args:
        n0, n1: unit normals in b's body at both ends; between them n goes straight.
        segment: of the path, for its motion bounds.
        width: the part's share of the segment.
    """
    length = 0.5 * math.sqrt((n0[0] + n1[0]) ** 2 + (n0[1] + n1[1]) ** 2 + (n0[2] + n1[2]) ** 2)
    if length < 1e-3:
        return -np.inf
    a, b = pairs.a[p], pairs.b[p]
    i, j = shapes.body[a], shapes.body[b]
    R0, R1, t0, t1 = np.empty((3, 3)), np.empty((3, 3)), np.empty(3), np.empty(3)
    relative(poses.rotation[k0], poses.position[k0], i, j, R0, t0)
    relative(poses.rotation[k1], poses.position[k1], i, j, R1, t1)
    m0, m1, m2, x = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    into_frame(R0, n0, m0)
    into_frame(R1, n1, m2)
    into_frame(R1, n0, m1)
    into_frame(R0, n1, x)
    for axis in range(3):
        m1[axis] = 0.5 * (m1[axis] + x[axis])
    h0, h2 = support(shapes, b, n0), support(shapes, b, n1)
    bend = bend_of(pairs, motion, p, segment) * width * width
    away = shapes.radius[a] + _remainder(pairs, motion, p, segment)
    c0 = dot(n0, t0) - h0 - away - bulge_of(shapes, a, m0)
    c2 = dot(n1, t1) - h2 - away - bulge_of(shapes, a, m2)
    c1 = 0.5 * (dot(n0, t1) + dot(n1, t0) - h0 - h2) - away - bulge_of(shapes, a, m1) - 0.25 * bend
    joints = motion.bodies.shape[1] if motion.deviates else 0
    levers, offsets = np.empty((4, joints, 3)), np.empty((4, joints))
    if motion.deviates:
        _levers(shapes, pairs, poses, motion, p, k0, n0, levers[0], offsets[0])
        _levers(shapes, pairs, poses, motion, p, k1, n0, levers[1], offsets[1])
        _levers(shapes, pairs, poses, motion, p, k0, n1, levers[3], offsets[3])
        _levers(shapes, pairs, poses, motion, p, k1, n1, levers[2], offsets[2])
        for c in range(joints):
            offsets[1, c] = 0.5 * (offsets[1, c] + offsets[3, c])
            for axis in range(3):
                levers[1, c, axis] = 0.5 * (levers[1, c, axis] + levers[3, c, axis])
    lowest = np.inf
    for row in range(shapes.starts[a], shapes.starts[a + 1]):
        v = shapes.vertices[row]
        b0, b1, b2 = c0 + dot(m0, v), c1 + dot(m1, v), c2 + dot(m2, v)
        if motion.deviates:
            b0 -= _moved(shapes, a, levers[0], offsets[0], row)
            b1 -= _moved(shapes, a, levers[1], offsets[1], row)
            b2 -= _moved(shapes, a, levers[2], offsets[2], row)
        least = min(b0, b2)
        if b1 < least:
            # The quadratic's lowest point is inside: (b0 b2 - b1^2) / (b0 - 2 b1 + b2), written so
            # that nothing cancels where all three are nearly the same.
            least = b1 + (b0 - b1) * ((b2 - b1) / ((b0 - b1) + (b2 - b1)))
        lowest = min(lowest, least)
    if lowest < 0.0:
        lowest /= length
    return lowest - ROUNDING


@numba.njit(cache=True)
def fixed_bound(shapes, pairs, poses, motion, p, first, last, n, floor):
    """Lower bound over the segments from knot `first` to `last` with one normal n, m.

    Gives up, with what it has, below `floor`.
    """
    a, b = pairs.a[p], pairs.b[p]
    i, j = shapes.body[a], shapes.body[b]
    top = support(shapes, b, n) + shapes.radius[a]
    w, m = np.empty(3), np.empty(3)
    joints = motion.bodies.shape[1] if motion.deviates else 0
    levers, offsets = np.empty((joints, 3)), np.empty(joints)
    lowest = before = np.inf
    for k in range(first, last + 1):
        out_of_frame(poses.rotation[k, j], n, w)
        into_frame(poses.rotation[k, i], w, m)
        if motion.deviates:
            _levers(shapes, pairs, poses, motion, p, k, n, levers, offsets)
        here = np.inf
        for v in range(shapes.starts[a], shapes.starts[a + 1]):
            height = dot(shapes.vertices[v], m)
            if motion.deviates:
                height -= _moved(shapes, a, levers, offsets, v)
            here = min(here, height)
        for axis in range(3):
            here += w[axis] * (poses.position[k, i, axis] - poses.position[k, j, axis])
        here -= bulge_of(shapes, a, m) + top
        if k > first:
            loss = 0.125 * bend_of(pairs, motion, p, k - 1) + _remainder(pairs, motion, p, k - 1)
            lowest = min(lowest, min(before, here) - loss)
            if lowest < floor:
                break
        before = here
    return lowest - ROUNDING
