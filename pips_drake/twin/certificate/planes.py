"""Planes that cost next to nothing: suggestions, and the bounds that they give, compiled.

A plane that is no good makes a bound loose, never wrong.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from pips_drake.twin.certificate.bound import (
    copy,
    dot,
    fixed_bound,
    gap,
    into_frame,
    out_of_frame,
    relative,
    turning_bound,
)
from pips_drake.twin.certificate.tree import inner


@inner
def _nearest(shapes, s, x, out):
    """The point nearest to x of the box or cylinder about a shape."""
    local = np.empty(3)
    Q, c, e = shapes.axes[s], shapes.centre[s], shapes.half[s]
    for i in range(3):
        local[i] = sum_of(Q, i, x, c)
    if shapes.disc[s] > 0.0:
        radial = math.sqrt(local[0] ** 2 + local[1] ** 2)
        if radial > shapes.disc[s]:
            local[0] *= shapes.disc[s] / radial
            local[1] *= shapes.disc[s] / radial
        local[2] = min(max(local[2], -e[2]), e[2])
    else:
        for i in range(3):
            local[i] = min(max(local[i], -e[i]), e[i])
    out_of_frame(Q, local, out)
    for i in range(3):
        out[i] += c[i]


@inner
def sum_of(Q, i, x, c):
    """Component i of Q^T (x - c)."""
    return Q[0, i] * (x[0] - c[0]) + Q[1, i] * (x[1] - c[1]) + Q[2, i] * (x[2] - c[2])


@inner
def suggest(shapes, a, b, R, t, n):
    """A normal that separates the pair well, by two alternating projections; in b's body."""
    m = shapes.half_space[b]
    if dot(m, m) > 0.0:
        copy(m, n)
        return
    x, y, local, near = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    out_of_frame(R, shapes.centre[a], x)
    for i in range(3):
        x[i] += t[i]
    for _ in range(2):
        _nearest(shapes, b, x, y)
        for i in range(3):
            local[i] = y[i] - t[i]
        into_frame(R, local, near)
        _nearest(shapes, a, near, local)
        out_of_frame(R, local, x)
        for i in range(3):
            x[i] += t[i]
    length = math.sqrt((x[0] - y[0]) ** 2 + (x[1] - y[1]) ** 2 + (x[2] - y[2]) ** 2)
    if length > 1e-6:
        for i in range(3):
            n[i] = (x[i] - y[i]) / length
        return
    # They overlap: the best of both bodies' axes.
    best = -np.inf
    for which in range(12):
        axis, sign = which // 2 % 3, 1.0 - 2.0 * (which % 2)
        if which < 6:
            for i in range(3):
                local[i] = sign * shapes.axes[b, i, axis]
        else:
            for i in range(3):
                near[i] = sign * shapes.axes[a, i, axis]
            out_of_frame(R, near, local)
        found = gap(shapes, a, b, R, t, local)
        if found > best:
            best = found
            copy(local, n)


@numba.njit(cache=True)
def span_bounds(shapes, pairs, poses, motion, rows, first, last, given):
    """Bounds of W spans with a fixed normal each: the better of a suggested and a given one.

    Args:
        rows, first, last: pair and knots of each span, (W,).
        given: normals to try, (W, 3); NaN for none.

    Returns:
        bounds (W,) m and normals (W, 3).
    """
    count = rows.shape[0]
    low, normals = np.empty(count), np.empty((count, 3))
    R, t, n = np.empty((3, 3)), np.empty(3), np.empty(3)
    for w in range(count):
        p = rows[w]
        a, b = pairs.a[p], pairs.b[p]
        low[w] = -np.inf
        if given[w, 0] == given[w, 0]:
            low[w] = fixed_bound(
                shapes, pairs, poses, motion, p, first[w], last[w], given[w], -np.inf
            )
            copy(given[w], normals[w])
        k = (first[w] + last[w]) // 2
        relative(poses.rotation[k], poses.position[k], shapes.body[a], shapes.body[b], R, t)
        suggest(shapes, a, b, R, t, n)
        found = fixed_bound(shapes, pairs, poses, motion, p, first[w], last[w], n, low[w])
        if found > low[w]:
            low[w] = found
            copy(n, normals[w])
    return low, normals


@numba.njit(cache=True)
def segment_bounds(shapes, pairs, poses, motion, rows, segments, given):
    """Bounds of W whole segments with a normal that turns from knot to knot.

    At each end the normal is the better one of a suggested and a given one, (W, 2, 3).

    Returns:
        bounds (W,) m and normals (W, 2, 3).
    """
    count = rows.shape[0]
    low, normals = np.empty(count), np.empty((count, 2, 3))
    R, t, n = np.empty((2, 3, 3)), np.empty((2, 3)), np.empty(3)
    for w in range(count):
        p = rows[w]
        a, b = pairs.a[p], pairs.b[p]
        i, j = shapes.body[a], shapes.body[b]
        for end in range(2):
            k = segments[w] + end
            relative(poses.rotation[k], poses.position[k], i, j, R[end], t[end])
            suggest(shapes, a, b, R[end], t[end], n)
            copy(given[w, end], normals[w, end])
            if gap(shapes, a, b, R[end], t[end], n) > gap(
                shapes, a, b, R[end], t[end], given[w, end]
            ):
                copy(n, normals[w, end])
        low[w] = turning_bound(
            shapes, pairs, poses, motion, p, segments[w], segments[w] + 1, normals[w, 0],
            normals[w, 1], segments[w], 1.0,
        )  # fmt: skip
    return low, normals


@numba.njit(cache=True)
def polish(shapes, pairs, poses, motion, p, k0, k1, normals, segment, width, low):
    """Tilts the normals (2, 3) of a part of a segment, both alike, while that raises its bound.

    What joint errors move is least for another normal than the distance is largest for. The
    normals are changed in place.

    Args:
        low: their bound, m; others as of `bound.turning_bound`.

    Returns:
        the new bound, m.
    """
    m = shapes.half_space[pairs.b[p]]
    if dot(m, m) > 0.0:
        return low
    tried, tilt = np.empty((2, 3)), np.empty(3)
    angle = 0.2
    while angle > 1e-3:
        better = False
        for way in range(6):
            tilt[0] = tilt[1] = tilt[2] = 0.0
            tilt[way // 2] = angle if way % 2 == 0 else -angle
            for end in range(2):
                length = 0.0
                for i in range(3):
                    tried[end, i] = normals[end, i] + tilt[i]
                    length += tried[end, i] ** 2
                for i in range(3):
                    tried[end, i] /= math.sqrt(length)
            found = turning_bound(
                shapes, pairs, poses, motion, p, k0, k1, tried[0], tried[1], segment, width
            )
            if found > low:
                low, better = found, True
                for end in range(2):
                    copy(tried[end], normals[end])
        if not better:
            angle *= 0.5
    return low
