"""Separating axes of convex bodies and the distance between them, compiled.

Bodies stand one behind the other in flat arrays; body k has rows `starts[k]` to `starts[k + 1]`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

FACE_OF_FIRST, FACE_OF_SECOND, EDGE_PAIR = range(3)

# Edges whose directions, unit vectors, have a shorter product than this are parallel. What is then
# left out changes a gap by no more than this part of the edges' length.
_PARALLEL = 1e-12
# An axis of two edges replaces a face's when its gap is larger by more than rounding, m.
_BETTER = 1e-12


class PackedBodies(NamedTuple):
    """B bodies as arrays, for compiled code; each body in its own frame.

    Attributes:
        vertices, vertex_starts: (sum V, 3) m, (B + 1,).
        normals, normal_starts: unit normals of the faces, one of those that are parallel,
            (sum F, 3), (B + 1,).
        directions, direction_starts: unit vectors along the edges, one of those that are parallel,
            (sum E, 3), (B + 1,).
        edges, edge_starts: every edge's two vertices, counted from the body's first, (sum M, 2),
            (B + 1,).
        sides, side_starts: what decides whether a point is above a face: its face's plane
            (n, d: n . x = d), and a plane through one of the face's edges, looking out of the face,
            (sum S, 8), (B + 1,); a face's sides follow each other.
    """

    vertices: NDArray[np.float64]
    vertex_starts: NDArray[np.int64]
    normals: NDArray[np.float64]
    normal_starts: NDArray[np.int64]
    directions: NDArray[np.float64]
    direction_starts: NDArray[np.int64]
    edges: NDArray[np.int64]
    edge_starts: NDArray[np.int64]
    sides: NDArray[np.float64]
    side_starts: NDArray[np.int64]


@numba.njit(cache=True)
def _turned(R, v, out, row):
    for i in range(3):
        out[row, i] = R[i, 0] * v[0] + R[i, 1] * v[1] + R[i, 2] * v[2]


@numba.njit(cache=True)
def _turn_all(R, rows, starts, body, out):
    """Rows of one body turned into the world; returns how many."""
    count = starts[body + 1] - starts[body]
    for k in range(count):
        _turned(R, rows[starts[body] + k], out, k)
    return count


@numba.njit(cache=True)
def _gap(x, y, z, a, n_a, b, n_b):
    """The gap between two sets of vertices along a unit axis, and which way a lies (+1, -1).

    Returns also the middle of the gap.
    """
    low_a = low_b = np.inf
    high_a = high_b = -np.inf
    for k in range(n_a):
        height = x * a[k, 0] + y * a[k, 1] + z * a[k, 2]
        low_a, high_a = min(low_a, height), max(high_a, height)
    for k in range(n_b):
        height = x * b[k, 0] + y * b[k, 1] + z * b[k, 2]
        low_b, high_b = min(low_b, height), max(high_b, height)
    if low_a - high_b >= low_b - high_a:
        return low_a - high_b, 1.0, 0.5 * (low_a + high_b)
    return low_b - high_a, -1.0, -0.5 * (low_b + high_a)


@numba.njit(cache=True)
def _largest(starts):
    largest = 0
    for k in range(len(starts) - 1):
        largest = max(largest, starts[k + 1] - starts[k])
    return largest


@numba.njit(cache=True)
def separate(bodies, pairs, R_first, p_first, R_second, p_second):
    """The axis of the largest gap for every pair, tried over all faces and all pairs of edges.

    Args:
        bodies: `PackedBodies`.
        pairs: which bodies, (N, 2).
        R_first, p_first, R_second, p_second: their poses in one frame, (N, 3, 3), (N, 3) m.

    Returns:
        Gap (N,) m; plane n . x = d in the middle of the gap, n (unit) from second to first, (N, 4);
        kind of axis (N,).
    """
    n_vertices = _largest(bodies.vertex_starts)
    n_normals = _largest(bodies.normal_starts)
    n_directions = _largest(bodies.direction_starts)
    a, b = np.empty((n_vertices, 3)), np.empty((n_vertices, 3))
    normals = np.empty((n_normals, 3))
    u, v = np.empty((n_directions, 3)), np.empty((n_directions, 3))
    count = len(pairs)
    gaps, planes, kinds = np.empty(count), np.empty((count, 4)), np.empty(count, np.int64)
    for n in range(count):
        first, second = pairs[n, 0], pairs[n, 1]
        R, S = R_first[n], R_second[n]
        n_a = _turn_all(R, bodies.vertices, bodies.vertex_starts, first, a)
        n_b = _turn_all(S, bodies.vertices, bodies.vertex_starts, second, b)
        # From the first body's origin, so that rounding does not grow with the distance from {W}'s.
        for k in range(n_b):
            for i in range(3):
                b[k, i] += p_second[n, i] - p_first[n, i]
        best, kind = -np.inf, FACE_OF_FIRST
        x, y, z, middle = 0.0, 0.0, 0.0, 0.0
        for owner in (FACE_OF_FIRST, FACE_OF_SECOND):
            body, Q = (first, R) if owner == FACE_OF_FIRST else (second, S)
            for k in range(_turn_all(Q, bodies.normals, bodies.normal_starts, body, normals)):
                ex, ey, ez = normals[k]
                gap, way, at = _gap(ex, ey, ez, a, n_a, b, n_b)
                if gap > best:
                    best, kind = gap, owner
                    x, y, z, middle = way * ex, way * ey, way * ez, at
        n_u = _turn_all(R, bodies.directions, bodies.direction_starts, first, u)
        n_v = _turn_all(S, bodies.directions, bodies.direction_starts, second, v)
        for i in range(n_u):
            ux, uy, uz = u[i]
            for j in range(n_v):
                ex = uy * v[j, 2] - uz * v[j, 1]
                ey = uz * v[j, 0] - ux * v[j, 2]
                ez = ux * v[j, 1] - uy * v[j, 0]
                length = math.sqrt(ex * ex + ey * ey + ez * ez)
                if length < _PARALLEL:
                    continue
                ex, ey, ez = ex / length, ey / length, ez / length
                # Of nearly parallel edges the product is mostly rounding: a tilt along the edge
                # costs gap in the first order, so it is taken out; across it, in the second.
                tilt = ex * ux + ey * uy + ez * uz
                ex, ey, ez = ex - tilt * ux, ey - tilt * uy, ez - tilt * uz
                length = math.sqrt(ex * ex + ey * ey + ez * ez)
                ex, ey, ez = ex / length, ey / length, ez / length
                gap, way, at = _gap(ex, ey, ez, a, n_a, b, n_b)
                if gap > best + _BETTER:
                    best, kind = gap, EDGE_PAIR
                    x, y, z, middle = way * ex, way * ey, way * ez, at
        gaps[n], kinds[n] = best, kind
        planes[n, 0], planes[n, 1], planes[n, 2] = x, y, z
        planes[n, 3] = middle + x * p_first[n, 0] + y * p_first[n, 1] + z * p_first[n, 2]
    return gaps, planes, kinds


@numba.njit(cache=True)
def _edge_points(a, i, j, b, k, m):
    """The nearest points of two segments, as parameters along each.

    Ericson, Real-Time Collision Detection (2005), section 5.1.9.
    """
    ux, uy, uz = a[j, 0] - a[i, 0], a[j, 1] - a[i, 1], a[j, 2] - a[i, 2]
    vx, vy, vz = b[m, 0] - b[k, 0], b[m, 1] - b[k, 1], b[m, 2] - b[k, 2]
    rx, ry, rz = a[i, 0] - b[k, 0], a[i, 1] - b[k, 1], a[i, 2] - b[k, 2]
    uu, vv = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz
    uv = ux * vx + uy * vy + uz * vz
    ur, vr = ux * rx + uy * ry + uz * rz, vx * rx + vy * ry + vz * rz
    # By the cross product: uu vv - uv^2 loses all digits where edges are nearly parallel.
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    square = nx * nx + ny * ny + nz * nz
    s = 0.0
    if square > _PARALLEL * _PARALLEL * uu * vv:
        mx, my, mz = vy * rz - vz * ry, vz * rx - vx * rz, vx * ry - vy * rx
        s = min(max((mx * nx + my * ny + mz * nz) / square, 0.0), 1.0)
    t = (uv * s + vr) / vv
    if t < 0.0:
        t, s = 0.0, min(max(-ur / uu, 0.0), 1.0)
    elif t > 1.0:
        t, s = 1.0, min(max((uv - ur) / uu, 0.0), 1.0)
    return s, t


@numba.njit(cache=True)
def _over_faces(points, count, sides, first, last, place, square, foot):
    """Points of one body above the faces of the other, in that one's frame.

    Args:
        foot: row 0 gets the nearest point, row 1 its foot, where nearer than `square`.
        place: of the body whose points these are; returned with the least square.
    """
    for k in range(count):
        x, y, z = points[k]
        s = first
        while s < last:
            height = sides[s, 0] * x + sides[s, 1] * y + sides[s, 2] * z - sides[s, 3]
            above = height >= 0.0 and height * height < square
            nx, ny, nz, d = sides[s, 0], sides[s, 1], sides[s, 2], sides[s, 3]
            # Sides of one face have the same plane, to the bit.
            while (
                s < last
                and sides[s, 0] == nx
                and sides[s, 1] == ny
                and sides[s, 2] == nz
                and sides[s, 3] == d
            ):
                if above:
                    out = sides[s, 4] * x + sides[s, 5] * y + sides[s, 6] * z - sides[s, 7]
                    above = out <= 0.0
                s += 1
            if above:
                square = height * height
                foot[place, 0], foot[place, 1], foot[place, 2] = x, y, z
                other = 1 - place
                foot[other, 0] = x - height * nx
                foot[other, 1] = y - height * ny
                foot[other, 2] = z - height * nz
    return square


@numba.njit(cache=True)
def _brought(R, p, points, starts, body, S, q, out):
    """Vertices of a body at pose (R, p) in the frame of one at (S, q); returns how many."""
    count = starts[body + 1] - starts[body]
    T = np.empty((3, 3))
    r = np.empty(3)
    for i in range(3):
        r[i] = 0.0
        for k in range(3):
            r[i] += S[k, i] * (p[k] - q[k])
        for j in range(3):
            T[i, j] = S[0, i] * R[0, j] + S[1, i] * R[1, j] + S[2, i] * R[2, j]
    for k in range(count):
        _turned(T, points[starts[body] + k], out, k)
        for i in range(3):
            out[k, i] += r[i]
    return count


@numba.njit(cache=True)
def distances(bodies, pairs, R_first, p_first, R_second, p_second, apart):
    """The distance of bodies that are apart: of vertices from faces and of edges from edges.

    Args:
        apart: (N,), which pairs to do.

    Returns:
        Distance (N,) m, and the nearest points of first and second, (N, 2, 3) m; NaN elsewhere.
    """
    n_vertices = _largest(bodies.vertex_starts)
    a, b = np.empty((n_vertices, 3)), np.empty((n_vertices, 3))
    count = len(pairs)
    found, points = np.full(count, np.nan), np.full((count, 2, 3), np.nan)
    foot, back = np.empty((2, 3)), np.empty((2, 3))
    starts, vertices = bodies.vertex_starts, bodies.vertices
    for n in range(count):
        if not apart[n]:
            continue
        first, second = pairs[n, 0], pairs[n, 1]
        R, S, p, q = R_first[n], R_second[n], p_first[n], p_second[n]
        # In the first body's frame, then (back) in the second's.
        n_b = _brought(S, q, vertices, starts, second, R, p, b)
        sides, lists = bodies.sides, bodies.side_starts
        square = _over_faces(b, n_b, sides, lists[first], lists[first + 1], 1, np.inf, foot)
        n_a = _brought(R, p, vertices, starts, first, S, q, a)
        nearer = _over_faces(a, n_a, sides, lists[second], lists[second + 1], 0, square, back)
        in_second = nearer < square
        square = nearer
        for k in range(n_a):
            for i in range(3):
                a[k, i] = vertices[starts[first] + k, i]
        for e in range(bodies.edge_starts[first], bodies.edge_starts[first + 1]):
            i, j = bodies.edges[e]
            for f in range(bodies.edge_starts[second], bodies.edge_starts[second + 1]):
                k, m = bodies.edges[f]
                s, t = _edge_points(a, i, j, b, k, m)
                total = 0.0
                for c in range(3):
                    one = a[i, c] + s * (a[j, c] - a[i, c])
                    two = b[k, c] + t * (b[m, c] - b[k, c])
                    total += (one - two) ** 2
                if total < square:
                    square, in_second = total, False
                    for c in range(3):
                        foot[0, c] = a[i, c] + s * (a[j, c] - a[i, c])
                        foot[1, c] = b[k, c] + t * (b[m, c] - b[k, c])
        found[n] = math.sqrt(square)
        for row in range(2):
            if in_second:
                _turned(S, back[row], points[n], row)
            else:
                _turned(R, foot[row], points[n], row)
            for c in range(3):
                points[n, row, c] += q[c] if in_second else p[c]
    return found, points
