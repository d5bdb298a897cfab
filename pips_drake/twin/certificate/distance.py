"""The distance of two convex bodies, to suggest a plane and to witness a bound from above.

Nothing that is certified rests on it: its normal is only a suggestion, and its points are given as
convex combinations of the bodies' own points, which anybody can add up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from pips_drake.twin.certificate.bodies import Shapes
from pips_drake.twin.certificate.bound import copy, gap, into_frame, out_of_frame
from pips_drake.twin.certificate.tree import inner

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Cores nearer than this count as touching, m.
TOUCHING = 1e-9
#: Penetration depths are found within this, m.
DEPTH_TOLERANCE = 1e-7


@dataclass(frozen=True, kw_only=True, eq=False)
class Closest:
    """The distance of a pair, between two proofs.

    Attributes:
        lower: the gap along `normal`, m.
        upper: m; proved by `points`, or in deep penetration by `hull`.
        normal: unit, from b to a, in b's body, (3,).
        weights: of up to four points on each core, (4,); they add up to 1.
        vertices: rows of `Shapes.vertices`, on a and b, (4, 2).
        balls: points of the unit ball, to be multiplied by E, on a and b, (4, 2, 3).
        points: the nearest points on the surfaces of a and b, in b's body, (2, 3) m.
        hull_vertices, hull_balls: in deep penetration, as above for H pairs of points, (H, 2) and
            (H, 2, 3): the hull of their differences holds a ball about 0 of radius -`upper` (less
            the radii). Else H = 0.
    """

    lower: float
    upper: float
    normal: Array
    weights: Array
    vertices: Indices
    balls: Array
    points: Array
    hull_vertices: Indices
    hull_balls: Array


def closest(shapes: Shapes, a: int, b: int, R: Array, t: Array) -> Closest:
    """Distance of shape a, with its body at (R, t) in b's body, from shape b."""
    if shapes.half_space[b].any():
        return _above_half_space(shapes, a, b, R, t)
    normal, weights, vertices, balls, core = closest_cores(shapes, a, b, R, t)
    both = float(shapes.radius[a] + shapes.radius[b])
    hull = _Hull(shapes, a, b, R, t)
    on_a = weights @ (shapes.vertices[vertices[:, 0]] + balls[:, 0] @ shapes.bulge[a].T)
    on_b = weights @ (shapes.vertices[vertices[:, 1]] + balls[:, 1] @ shapes.bulge[b].T)
    on_a = R @ on_a + t
    upper = float(np.linalg.norm(on_a - on_b)) - both
    if core <= TOUCHING:
        normal, depth = _penetration(hull)
        upper = min(upper, -depth - both)
        on_a = on_b = 0.5 * (on_a + on_b)
        on_a, on_b = on_a - depth * normal, on_b
    return Closest(
        lower=float(gap(shapes, a, b, R, t, normal)),
        upper=upper,
        normal=normal,
        weights=weights,
        vertices=vertices,
        balls=balls,
        points=np.stack([on_a - shapes.radius[a] * normal, on_b + shapes.radius[b] * normal]),
        hull_vertices=np.array(hull.vertices, dtype=np.int64).reshape(-1, 2),
        hull_balls=np.array(hull.balls).reshape(-1, 2, 3),
    )


def _above_half_space(shapes: Shapes, a: int, b: int, R: Array, t: Array) -> Closest:
    normal = shapes.half_space[b].copy()
    m = R.T @ normal
    rows = np.arange(shapes.starts[a], shapes.starts[a + 1])
    row = int(rows[np.argmin(shapes.vertices[rows] @ m)])
    ball = -shapes.bulge[a].T @ m
    ball /= max(float(np.linalg.norm(ball)), 1e-300)
    ball *= 1.0 - 1e-15
    low = R @ (shapes.vertices[row] + shapes.bulge[a] @ ball) + t - shapes.radius[a] * normal
    distance = float(normal @ (low - shapes.vertices[shapes.starts[b]]))
    balls = np.zeros((4, 2, 3))
    balls[0, 0] = ball
    return Closest(
        lower=float(gap(shapes, a, b, R, t, normal)),
        upper=distance,
        normal=normal,
        weights=np.array([1.0, 0.0, 0.0, 0.0]),
        vertices=np.array([[row, shapes.starts[b]]] * 4),
        balls=balls,
        points=np.stack([low, low - distance * normal]),
        hull_vertices=np.empty((0, 2), dtype=np.int64),
        hull_balls=np.empty((0, 2, 3)),
    )


class _Hull:
    """Points of the cores' difference, and what they are differences of."""

    def __init__(self, shapes: Shapes, a: int, b: int, R: Array, t: Array) -> None:
        self._shapes, self._pair, self._R, self._t = shapes, (a, b), R, t
        self.points: list[Array] = []
        self.vertices: list[tuple[int, int]] = []
        self.balls: list[tuple[Array, Array]] = []
        self.axes = np.vstack([np.eye(3), shapes.axes[b].T, (R @ shapes.axes[a]).T])

    def add(self, direction: Array) -> float:
        """Adds the point that is farthest along a direction in b's body; how far that is, m."""
        shapes, far, rows, balls = self._shapes, [], [], []
        for shape, along in zip(self._pair, (self._R.T @ direction, -direction), strict=True):
            first, last = int(shapes.starts[shape]), int(shapes.starts[shape + 1])
            row = first + int(np.argmax(shapes.vertices[first:last] @ along))
            ball = shapes.bulge[shape].T @ along
            # A hair inside the ball, so that rounding does not take it out.
            ball = ball * ((1.0 - 1e-15) / max(float(np.linalg.norm(ball)), 1e-300))
            far.append(shapes.vertices[row] + shapes.bulge[shape] @ ball)
            rows.append(row)
            balls.append(ball)
        point = self._R @ far[0] + self._t - far[1]
        self.points.append(point)
        self.vertices.append((rows[0], rows[1]))
        self.balls.append((balls[0], balls[1]))
        return float(direction @ point)


def _penetration(hull: _Hull) -> tuple[Array, float]:
    """Normal along which cores that overlap are parted soonest, and how deep they are, m.

    The hull of points of the cores' difference holds a ball about 0, whose radius is at most the
    depth; the difference's reach along each face's normal is at least it. Faces are pushed out
    until both meet.
    """
    from scipy.spatial import ConvexHull, QhullError

    best, normal, depth = np.inf, np.array([0.0, 0.0, 1.0]), 0.0

    def look(outward: Array) -> None:
        nonlocal best, normal
        reach = hull.add(outward)
        if reach < best:
            best, normal = reach, -outward

    for axis in hull.axes:
        look(axis)
        look(-axis)
    for _ in range(200):
        try:
            faces = ConvexHull(np.array(hull.points)).equations
        except QhullError:
            # All in a plane so far. Either there is more beside it, or the cores' difference is
            # flat (of two segments, say) and has no depth along its own normal.
            _, _, across = np.linalg.svd(np.array(hull.points) - np.mean(hull.points, axis=0))
            if hull.add(across[-1]) + hull.add(-across[-1]) > TOUCHING:
                continue
            return across[-1], 0.0
        # Outward normals of the faces, and their distances from 0.
        face = int(np.argmax(faces[:, 3]))
        depth = max(0.0, -float(faces[face, 3]))
        if best - depth <= DEPTH_TOLERANCE:
            break
        look(faces[face, :3])
    return normal, depth


@inner
def _core_support(shapes, s, d, ball, out):
    """The farthest point of a core along d: its vertex's row; the point, and its ball's part."""
    best, row = -np.inf, shapes.starts[s]
    for v in range(shapes.starts[s], shapes.starts[s + 1]):
        x = shapes.vertices[v]
        height = x[0] * d[0] + x[1] * d[1] + x[2] * d[2]
        if height > best:
            best, row = height, v
    into_frame(shapes.bulge[s], d, ball)
    length = math.sqrt(ball[0] ** 2 + ball[1] ** 2 + ball[2] ** 2)
    # A hair inside the ball, so that rounding does not take it out.
    scale = (1.0 - 1e-15) / length if length > 1e-300 else 0.0
    for i in range(3):
        ball[i] *= scale
    out_of_frame(shapes.bulge[s], ball, out)
    for i in range(3):
        out[i] += shapes.vertices[row, i]
    return row


@numba.njit(cache=True)
def closest_cores(shapes, a, b, R, t):
    """Gilbert, Johnson and Keerthi's algorithm on the cores: normal, combination, distance."""
    points = np.zeros((5, 3))
    vertices = np.zeros((5, 2), dtype=np.int64)
    balls = np.zeros((5, 2, 3))
    weights, solution = np.zeros(5), np.zeros(5)
    v, d, m, x, y = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    normal = np.zeros(3)
    out_of_frame(R, shapes.centre[a], v)
    for i in range(3):
        v[i] += t[i] - shapes.centre[b, i]
    if v[0] ** 2 + v[1] ** 2 + v[2] ** 2 < 1e-12:
        v[2] = 1.0
    count, best, distance = 0, -np.inf, np.inf
    for _ in range(200):
        length = math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
        if count > 0:
            distance = length
            if length <= 1e-12:
                break
        for i in range(3):
            d[i] = -v[i] / length
        into_frame(R, d, m)
        vertices[count, 0] = _core_support(shapes, a, m, balls[count, 0], x)
        out_of_frame(R, x, points[count])
        for i in range(3):
            m[i] = -d[i]
        vertices[count, 1] = _core_support(shapes, b, m, balls[count, 1], y)
        height = 0.0
        for i in range(3):
            points[count, i] += t[i] - y[i]
            height -= d[i] * points[count, i]
        if height > best:
            best = height
            for i in range(3):
                normal[i] = -d[i]
        if count > 0 and distance - best <= 1e-12 * (1.0 + distance):
            break
        known = False
        for k in range(count):
            if (
                abs(points[k, 0] - points[count, 0]) + abs(points[k, 1] - points[count, 1])
                + abs(points[k, 2] - points[count, 2])
            ) < 1e-14:  # fmt: skip
                known = True
        if known:
            break
        count += 1
        reached = _least_combination(points, count, solution)
        if reached >= distance and count > 1:
            # No nearer: the precision is used up.
            count -= 1
            break
        kept = 0
        for k in range(count):
            if solution[k] > 0.0:
                copy(points[k], points[kept])
                weights[kept] = solution[k]
                for body in range(2):
                    vertices[kept, body] = vertices[k, body]
                    copy(balls[k, body], balls[kept, body])
                kept += 1
        count = kept
        for i in range(3):
            v[i] = 0.0
            for k in range(count):
                v[i] += weights[k] * points[k, i]
        if count == 4:
            distance = 0.0
            break
    total = 0.0
    for k in range(5):
        if k >= count:
            weights[k] = 0.0
        total += weights[k]
    return normal, weights[:4] / total, vertices[:4], balls[:4], distance


@inner
def _least_combination(points, count, solution):
    """Weights of the convex combination of up to four points that is nearest to 0; its length.

    The best of all subsets: the nearest point of each one's plane counts if it lies inside.
    """
    gram = np.empty((4, 4))
    for i in range(count):
        for j in range(count):
            gram[i, j] = (
                points[i, 0] * points[j, 0] + points[i, 1] * points[j, 1]
                + points[i, 2] * points[j, 2]
            )  # fmt: skip
    best = np.inf
    members = np.empty(4, dtype=np.int64)
    A, y, z = np.empty((3, 4)), np.empty(3), np.empty(4)
    for subset in range(1, 1 << count):
        size = 0
        for i in range(count):
            if subset >> i & 1:
                members[size] = i
                size += 1
        # With the last member as origin: (p_i - p_l) . (p_l + sum y_j (p_j - p_l)) = 0.
        o, n = members[size - 1], size - 1
        for i in range(n):
            p = members[i]
            for j in range(n):
                q = members[j]
                A[i, j] = gram[p, q] - gram[p, o] - gram[q, o] + gram[o, o]
            A[i, 3] = gram[o, o] - gram[p, o]
        regular = True
        for i in range(n):
            pivot = i
            for k in range(i + 1, n):
                if abs(A[k, i]) > abs(A[pivot, i]):
                    pivot = k
            if abs(A[pivot, i]) < 1e-18:
                regular = False
                break
            for j in range(4):
                A[i, j], A[pivot, j] = A[pivot, j], A[i, j]
            for k in range(i + 1, n):
                f = A[k, i] / A[i, i]
                for j in range(i, 4):
                    A[k, j] -= f * A[i, j]
        if not regular:
            continue
        total = 0.0
        inside = True
        for i in range(n - 1, -1, -1):
            y[i] = A[i, 3]
            for j in range(i + 1, n):
                y[i] -= A[i, j] * y[j]
            y[i] /= A[i, i]
            z[i] = y[i]
            total += y[i]
            inside = inside and y[i] > 0.0
        z[n] = 1.0 - total
        if not (inside and z[n] > 0.0):
            continue
        length = 0.0
        for axis in range(3):
            x = 0.0
            for i in range(size):
                x += z[i] * points[members[i], axis]
            length += x * x
        if length < best:
            best = length
            for i in range(4):
                solution[i] = 0.0
            for i in range(size):
                solution[members[i]] = z[i]
    return math.sqrt(best)
