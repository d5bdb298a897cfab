"""Pulls a path tight around the obstacles, like a string, and keeps it clear at every step.

First a line of sight from each corner to the farthest that it sees; then, in rounds, each corner is
drawn towards the straight line between its neighbours as far as both its segments stay clear (all
of the way: the corner goes), sliding along what they touch. When a round gains little, sharp
corners get company, so that the string comes to lie on round obstacles: around a cylinder with a
turn of t rad at each corner it is t^2 / 12 longer than the arc.

Every change is checked exactly (`line_of_sight`), so the result is as clear as the path that came
in, and never longer. It is the shortest only among those that the rounds reach: which side of an
obstacle it passes is mostly the incoming path's choice.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.planning.line_of_sight import TOLERANCE, first_blocked, segment_blocked
from pips_drake.scene.shape_distance import least_distance
from pips_drake.scene.signed_distance import SignedDistanceField

Array = NDArray[np.float64]

#: Corners that turn more than this (rad) get company: 0.75 % of an arc's length at most.
SHARP = 0.3
#: A round that shortens the path by less than this share gains little.
SETTLED = 2e-4
#: It is done sooner but for paths of thousands of corners.
MOST_ROUNDS = 200
# How finely a corner's way is searched: halvings of it.
_HALVINGS = 5


def pull(
    field: SignedDistanceField, points: ArrayLike, radius: float, *, most_rounds: int = MOST_ROUNDS
) -> Array:
    """The path pulled tight, (K, 3) m; its ends stay.

    Args:
        field: the obstacles.
        points: a clear path in the world, (N, 3) m.
        radius: that every point of it keeps from the obstacles, m, > 0.
        most_rounds: after fewer than it takes the path is as clear, but longer than need be: enough
            for what tightens it anyway.

    Raises:
        InputError: the path is not clear, or no path.
    """
    p = np.ascontiguousarray(points, dtype=np.float64)
    if p.ndim != 2 or p.shape[1] != 3 or len(p) < 1 or not np.isfinite(p).all():
        raise InputError(f"path of shape {p.shape}; must be (N, 3) finite numbers")
    # What was found clear must not be refused here for where the balls happen to lie.
    segment, at, shape = first_blocked(field.arrays, p, radius - TOLERANCE)
    if segment >= 0:
        raise InputError(
            f"path is not clear: {at:.3g} m behind its point {segment} it is nearer than "
            f"{radius:.3g} m to {field.label(shape)}"
        )
    return np.asarray(_pulled(field.arrays, p, radius + TOLERANCE, most_rounds))


@numba.njit(cache=True)
def path_length(points):
    """Length of a polyline (N, 3), m."""
    total = 0.0
    for i in range(points.shape[0] - 1):
        total += _distance(points[i], points[i + 1])
    return total


@numba.njit(cache=True)
def _pulled(field, points, radius, most_rounds):
    path = _shortcut(field, points, radius)
    every = np.arange(field.kinds.shape[0])
    length = path_length(path)
    for _ in range(most_rounds):
        path = _tightened(field, path, radius, every)
        shorter = path_length(path)
        # What is far from tight is pulled while it has few corners: that is soon done.
        if shorter > (1.0 - SETTLED) * length:
            path, company = _with_company(path, radius)
            if not company:
                break
        length = shorter
    return _shortcut(field, path, radius)


@numba.njit(cache=True)
def _distance(a, b):
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@numba.njit(cache=True)
def _sees(field, a, b, radius):
    _, shape = segment_blocked(field, a, b, radius)
    return shape < 0


@numba.njit(cache=True)
def _shortcut(field, points, radius):
    """From each point to the farthest that it sees, looked for in growing and then halved steps."""
    count = points.shape[0]
    kept, number, i = np.empty((count, 3)), 1, 0
    kept[0] = points[0]
    while i < count - 1:
        good, step = i + 1, 2  # a path's next point is always seen
        while good < count - 1:
            far = min(i + step, count - 1)
            if not _sees(field, points[i], points[far], radius):
                break
            good, step = far, 2 * step
        bad = min(i + step, count - 1) if good < count - 1 else good + 1
        while bad - good > 1:
            middle = (good + bad) // 2
            if _sees(field, points[i], points[middle], radius):
                good = middle
            else:
                bad = middle
        i = good
        kept[number] = points[i]
        number += 1
    return kept[:number].copy()


@numba.njit(cache=True)
def _turn(a, b, c):
    """How much a path turns at b, rad."""
    ab, bc = _distance(a, b), _distance(b, c)
    if ab == 0.0 or bc == 0.0:
        return 0.0
    cosine = 0.0
    for axis in range(3):
        cosine += (b[axis] - a[axis]) * (c[axis] - b[axis])
    return math.acos(min(max(cosine / (ab * bc), -1.0), 1.0))


@numba.njit(cache=True)
def _with_company(path, radius):
    """A path with new points in the middle of long segments at sharp corners; whether it has any.

    A corner at something sharp stays sharp however many points it gets, until its segments are as
    short as a turn on the grown edge (of the arm's radius) wants them.
    """
    count = path.shape[0]
    sharp = np.zeros(count, dtype=np.bool_)
    for i in range(1, count - 1):
        sharp[i] = _turn(path[i - 1], path[i], path[i + 1]) > SHARP
    more, number = np.empty((2 * count, 3)), 0
    for i in range(count):
        more[number] = path[i]
        number += 1
        if i == count - 1 or not (sharp[i] or sharp[i + 1]):
            continue
        if _distance(path[i], path[i + 1]) > SHARP * radius:
            more[number] = 0.5 * (path[i] + path[i + 1])
            number += 1
    return more[:number].copy(), number > count


@numba.njit(cache=True)
def _draw(field, a, b, c, way, radius, contact):
    """Moves b along a way (3,) m as far as a-b-c stays clear and gets shorter.

    Returns:
        Whether something was in the way at the last; then `contact` (3,) m is where.
    """
    moved, start = np.empty(3), b.copy()
    least = _distance(a, b) + _distance(b, c)
    low, high, part, touched = 0.0, 1.0, 1.0, False
    for _ in range(_HALVINGS):
        for axis in range(3):
            moved[axis] = start[axis] + part * way[axis]
        length = _distance(a, moved) + _distance(moved, c)
        good = length < least
        if good:
            for end in (a, c):
                at, shape = segment_blocked(field, end, moved, radius)
                if shape >= 0:
                    good, touched = False, True
                    share = at / _distance(end, moved)
                    for axis in range(3):
                        contact[axis] = end[axis] + share * (moved[axis] - end[axis])
                    break
        if good:
            low, least = part, length
            b[:] = moved
            if low == 1.0:
                return False
        else:
            high = part
        part = 0.5 * (low + high)
    return touched


@numba.njit(cache=True)
def _tightened(field, path, radius, every):
    """One round: each corner is drawn towards its neighbours' line, or goes; from end to end.

    What its segments touch on the way stops the motion into it. The rest goes on: along one
    surface, then along the edge of two, which is all that is left to a corner both of whose
    segments lie on a round obstacle.
    """
    count = path.shape[0]
    kept, number = np.empty((count, 3)), 1
    kept[0] = path[0]
    way, corner, contact, normals = np.empty(3), np.empty(3), np.empty(3), np.empty((2, 3))
    for i in range(1, count - 1):
        a, c = kept[number - 1], path[i + 1]
        corner[:] = path[i]
        if _distance(a, corner) == 0.0 or _distance(a, c) == 0.0:
            continue
        # A corner in the middle of a straight line is company for those beside it.
        if _turn(a, corner, c) > 1e-6 and _sees(field, a, c, radius):
            continue
        for touching in range(3):
            square, along = 0.0, 0.0
            for axis in range(3):
                square += (c[axis] - a[axis]) ** 2
                along += (c[axis] - a[axis]) * (corner[axis] - a[axis])
            share = min(max(along / square, 0.0), 1.0)
            for axis in range(3):
                way[axis] = a[axis] + share * (c[axis] - a[axis]) - corner[axis]
            for n in range(touching):
                _leave_out(way, normals[n])
            if not _draw(field, a, corner, c, way, radius, contact) or touching == 2:
                break
            _, gx, gy, gz, _ = least_distance(
                field, contact[0], contact[1], contact[2], every, every.shape[0]
            )
            normal = normals[touching]
            normal[0], normal[1], normal[2] = gx, gy, gz
            if touching == 1:
                _leave_out(normal, normals[0])
                size = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
                if size < 1e-3:  # the same surface again
                    break
                normal /= size
        kept[number] = corner
        number += 1
    if count > 1:
        kept[number] = path[count - 1]
        number += 1
    return kept[:number].copy()


@numba.njit(cache=True)
def _leave_out(vector, unit):
    """Takes from a vector (3,) its part along a unit vector."""
    part = vector[0] * unit[0] + vector[1] * unit[1] + vector[2] * unit[2]
    for axis in range(3):
        vector[axis] -= part * unit[axis]
