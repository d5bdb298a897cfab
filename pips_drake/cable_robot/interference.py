"""How near cables and platform come to each other and to obstacles, for many poses at once.

Cables are straight segments without thickness, the platform is its box (`CableRobot.box`) and
obstacles are oriented boxes. Distances are exact, m, and 0 where two things meet; how deep they are
in each other is not said.

What always touches is left out. A cable leaves the platform at its attachment: its first
`free_length` does not count towards the platform's box. Two cables that share an anchor or an
attachment are compared without the `free_length` of both next to the shared end.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.cable_robot.kinematics import Poses
from pips_drake.cable_robot.robot import SAME_POINT, CableRobot
from pips_drake.config import require
from pips_drake.errors import InputError

Array = NDArray[np.float64]

#: Next to a shared end, m.
FREE_LENGTH = 0.1
#: A box's edges: corners numbered by the bits of their index, a set bit for the upper side.
_EDGES = np.array([(i, i | b) for b in (1, 2, 4) for i in range(8) if not i & b])


@dataclass(frozen=True, eq=False)
class ObstacleBox:
    """A box that nothing may touch.

    Attributes:
        name: of the obstacle.
        size: full sizes (3,) m.
        X_WB: its pose, (4, 4); the origin is its centre.
    """

    name: str
    size: Array
    X_WB: Array

    def __post_init__(self) -> None:
        size, pose = np.asarray(self.size, dtype=float), np.asarray(self.X_WB, dtype=float)
        good = size.shape == (3,) and bool(np.all(np.isfinite(size) & (size > 0.0)))
        require(good, f"obstacle {self.name}: size", size.tolist(), "three sizes > 0 m")
        good = pose.shape == (4, 4) and bool(np.all(np.isfinite(pose)))
        good = good and np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-9)
        if not good:
            raise InputError(f"obstacle {self.name}: X_WB must be a pose, (4, 4)")
        object.__setattr__(self, "size", size)
        object.__setattr__(self, "X_WB", pose)

    def corners(self) -> Array:
        """Its eight corners in the world, (8, 3) m."""
        return 0.5 * self.size * _signs() @ self.X_WB[:3, :3].T + self.X_WB[:3, 3]


def box_from_bounds(name: str, lower: ArrayLike, upper: ArrayLike) -> ObstacleBox:
    """A box with edges along the world's axes from one corner to the opposite, (3,) m each."""
    low, high = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    pose = np.eye(4)
    pose[:3, 3] = 0.5 * (low + high)
    return ObstacleBox(name, high - low, pose)


@dataclass(frozen=True, eq=False)
class Clearances:
    """Least distances of N poses, m; inf where there is nothing to be near to.

    Attributes:
        cable_cable: between two cables, (N,).
        cable_platform: between a cable and the platform's box, (N,).
        cable_obstacle: between a cable and an obstacle, (N,).
        platform_obstacle: between the platform's box and an obstacle, (N,).
        nearest: who is that near, (N, 4, 2), in the order above: cable and cable; cable and -1;
            cable and obstacle; -1 and obstacle. Indices from 0; -1 where there is none.
    """

    cable_cable: Array
    cable_platform: Array
    cable_obstacle: Array
    platform_obstacle: Array
    nearest: NDArray[np.int64]

    @property
    def least(self) -> Array:
        """The least of all but `cable_platform`, (N,) m.

        That one says at which angle a cable leaves the box: what matters is that it is not 0.
        """
        apart = np.minimum(self.cable_cable, self.cable_obstacle)
        return np.asarray(np.minimum(apart, self.platform_obstacle))


def clearances(
    robot: CableRobot,
    poses: Poses,
    obstacles: Sequence[ObstacleBox] = (),
    *,
    free_length: float = FREE_LENGTH,
) -> Clearances:
    """Least distances of N poses; see the module's text for what is left out.

    Args:
        free_length: m.
    """
    good = np.isfinite(free_length) and free_length >= 0.0
    require(good, "free_length", f"{free_length:g} m", ">= 0")
    arrays = (
        robot.anchors,
        robot.attachments,
        _shared_ends(robot),
        poses.position,
        poses.rotation,
        0.5 * robot.box,
        np.array([0.5 * one.size for one in obstacles]).reshape(-1, 3),
        np.array([one.X_WB[:3, :3] for one in obstacles]).reshape(-1, 3, 3),
        np.array([one.X_WB[:3, 3] for one in obstacles]).reshape(-1, 3),
    )
    # Copies: arrays that may not be written, or lie otherwise, are compiled for once more.
    distances, nearest = _least_distances(
        *(np.array(one, order="C") for one in arrays), float(free_length), _signs(), _EDGES.copy()
    )
    apart = np.ascontiguousarray(distances.T)
    return Clearances(apart[0], apart[1], apart[2], apart[3], nearest)


def _signs() -> Array:
    """Corners of a box of half sizes 1, (8, 3)."""
    return np.array([[2.0 * (i >> k & 1) - 1.0 for k in range(3)] for i in range(8)])


def _shared_ends(robot: CableRobot) -> NDArray[np.int64]:
    """Of each pair of cables: 0 none, 1 the attachment, 2 the anchor; (M, M)."""
    shared = np.zeros((robot.cables, robot.cables), dtype=np.int64)
    for number, ends in ((2, robot.anchors), (1, robot.attachments)):
        shared[np.abs(ends[:, None] - ends[None]).max(axis=2) < SAME_POINT] = number
    return shared


@numba.njit(cache=True)
def _segments_apart(p, u, q, v):
    """Distance of the segments p + s u and q + t v, s and t in [0, 1].

    Ericson, Real-Time Collision Detection (2005), section 5.1.9.
    """
    uu = u[0] * u[0] + u[1] * u[1] + u[2] * u[2]
    vv = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    uv = u[0] * v[0] + u[1] * v[1] + u[2] * v[2]
    wx, wy, wz = p[0] - q[0], p[1] - q[1], p[2] - q[2]
    uw, vw = u[0] * wx + u[1] * wy + u[2] * wz, v[0] * wx + v[1] * wy + v[2] * wz
    s, t = 0.0, 0.0
    if uu > 0.0 and vv > 0.0:
        determinant = uu * vv - uv * uv
        if determinant > 1e-14 * uu * vv:
            s = min(max((uv * vw - uw * vv) / determinant, 0.0), 1.0)
        t = (uv * s + vw) / vv
        if t < 0.0:
            t = 0.0
            s = min(max(-uw / uu, 0.0), 1.0)
        elif t > 1.0:
            t = 1.0
            s = min(max((uv - uw) / uu, 0.0), 1.0)
    elif uu > 0.0:
        s = min(max(-uw / uu, 0.0), 1.0)
    elif vv > 0.0:
        t = min(max(vw / vv, 0.0), 1.0)
    total = 0.0
    for k in range(3):
        gap = p[k] + s * u[k] - q[k] - t * v[k]
        total += gap * gap
    return math.sqrt(total)


@numba.njit(cache=True)
def _segment_from_box(a, b, R, c, half, bound, p, d):
    """Distance of the segment from a to b and a box, or `bound` if it is surely not below.

    The squared distance along the segment is convex, and a parabola between the places where the
    segment crosses the planes of the box's faces: its slope is monotonic, and linear between the
    last such place with a slope <= 0 and the first with one >= 0.

    Args:
        p, d: (3,), room to work in.
    """
    for k in range(3):
        low, high = 0.0, 0.0
        for j in range(3):
            low += R[j, k] * (a[j] - c[j])
            high += R[j, k] * (b[j] - c[j])
        p[k], d[k] = low, high - low
        if min(low, high) - half[k] >= bound or -max(low, high) - half[k] >= bound:
            return bound
    # Only the part inside the box widened by the bound can be nearer than that.
    before, slope_before, after, slope_after = 0.0, 0.0, 1.0, 0.0
    if bound < np.inf:
        for k in range(3):
            if d[k] != 0.0:
                reach = math.copysign(half[k] + bound, d[k])
                before = max(before, (-reach - p[k]) / d[k])
                after = min(after, (reach - p[k]) / d[k])
        if before >= after:
            return bound
    for place in range(8):
        t = before if place == 0 else after
        if place >= 2:
            k = (place - 2) // 2
            if d[k] == 0.0:
                continue
            side = (half[k] if place % 2 else -half[k]) - p[k]
            # No division where it cannot lie between.
            if d[k] > 0.0 and (side <= before * d[k] or side >= after * d[k]):
                continue
            if d[k] < 0.0 and (side >= before * d[k] or side <= after * d[k]):
                continue
            t = side / d[k]
        slope = 0.0
        for k in range(3):
            x = p[k] + t * d[k]
            if x > half[k]:
                slope += (x - half[k]) * d[k]
            elif x < -half[k]:
                slope += (x + half[k]) * d[k]
        if place == 0:
            slope_before = slope
            if slope >= 0.0:
                after, slope_after = before, slope
                break
        elif place == 1:
            slope_after = slope
            if slope <= 0.0:
                before, slope_before = after, slope
                break
        elif slope <= 0.0:
            before, slope_before = t, slope
        else:
            after, slope_after = t, slope
    t = before if slope_before >= 0.0 else after
    if slope_before < 0.0 and slope_after > 0.0:
        t = before - slope_before * (after - before) / (slope_after - slope_before)
    total = 0.0
    for k in range(3):
        out = max(abs(p[k] + t * d[k]) - half[k], 0.0)
        total += out * out
    return min(math.sqrt(total), bound)


@numba.njit(cache=True)
def _least_distances(
    anchors,
    attachments,
    shared,
    positions,
    rotations,
    half,
    halves,
    Rs,
    centres,
    free,
    signs,
    edges,
):
    """Distances (N, 4) and who is that near (N, 4, 2), as `Clearances` has them."""
    count, cables, boxes = len(positions), len(anchors), len(halves)
    distances = np.full((count, 4), np.inf)
    nearest = np.full((count, 4, 2), -1)
    inner, vectors = np.empty((cables, 3)), np.empty((cables, 3))
    p, u, q, v = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    corners = np.empty((8, 3))
    start, along, gaps = np.empty(3), np.empty(3), np.empty(boxes)
    has_box = half[0] > 0.0 and half[1] > 0.0 and half[2] > 0.0
    radius = math.sqrt(half[0] ** 2 + half[1] ** 2 + half[2] ** 2)
    for n in range(count):
        x, Q, least = positions[n], rotations[n], distances[n]
        for m in range(cables):
            for k in range(3):
                inner[m, k] = x[k]
                for j in range(3):
                    inner[m, k] += Q[k, j] * attachments[m, j]
                vectors[m, k] = anchors[m, k] - inner[m, k]
        for m in range(cables):
            length = math.sqrt(vectors[m, 0] ** 2 + vectors[m, 1] ** 2 + vectors[m, 2] ** 2)
            cut = min(free / length, 1.0) if length > 0.0 else 0.0
            for other in range(m + 1, cables):
                near, far = 0.0, 0.0
                near_other, far_other = 0.0, 0.0
                if shared[m, other]:
                    size = math.sqrt(
                        vectors[other, 0] ** 2 + vectors[other, 1] ** 2 + vectors[other, 2] ** 2
                    )
                    cut_other = min(free / size, 1.0) if size > 0.0 else 0.0
                    if shared[m, other] == 1:
                        near, near_other = cut, cut_other
                    else:
                        far, far_other = cut, cut_other
                for k in range(3):
                    p[k] = inner[m, k] + near * vectors[m, k]
                    u[k] = (1.0 - near - far) * vectors[m, k]
                    q[k] = inner[other, k] + near_other * vectors[other, k]
                    v[k] = (1.0 - near_other - far_other) * vectors[other, k]
                gap = _segments_apart(p, u, q, v)
                if gap < least[0]:
                    least[0] = gap
                    nearest[n, 0, 0], nearest[n, 0, 1] = m, other
            if has_box:
                for k in range(3):
                    p[k] = inner[m, k] + cut * vectors[m, k]
                gap = _segment_from_box(p, anchors[m], Q, x, half, least[1], start, along)
                if gap < least[1]:
                    least[1] = gap
                    nearest[n, 1, 0] = m
            for box in range(boxes):
                if least[2] == 0.0:
                    break
                gap = _segment_from_box(
                    inner[m], anchors[m], Rs[box], centres[box], halves[box], least[2], start, along
                )
                if gap < least[2]:
                    least[2] = gap
                    nearest[n, 2, 0], nearest[n, 2, 1] = m, box
        if not has_box:
            continue
        first = 0
        for box in range(boxes):
            # Of the centre, a segment too.
            gaps[box] = _segment_from_box(
                x, x, Rs[box], centres[box], halves[box], np.inf, start, along
            )
            if gaps[box] < gaps[first]:
                first = box
        for number in range(boxes):
            # The nearest centre first; nothing of the platform is farther from it than its corners.
            box = first if number == 0 else (0 if number == first else number)
            if gaps[box] - radius >= least[3]:
                continue
            # Two convex bodies are nearest at an edge of one of them, or an edge pierces the other.
            for whose in range(2):
                R = Q if whose == 0 else Rs[box]
                c = x if whose == 0 else centres[box]
                h = half if whose == 0 else halves[box]
                for i in range(8):
                    for k in range(3):
                        corners[i, k] = c[k]
                        for j in range(3):
                            corners[i, k] += R[k, j] * signs[i, j] * h[j]
                for edge in edges:
                    a, b = corners[edge[0]], corners[edge[1]]
                    R = Rs[box] if whose == 0 else Q
                    c = centres[box] if whose == 0 else x
                    h = halves[box] if whose == 0 else half
                    gap = _segment_from_box(a, b, R, c, h, least[3], start, along)
                    if gap < least[3]:
                        least[3] = gap
                        nearest[n, 3, 1] = box
    return distances, nearest
