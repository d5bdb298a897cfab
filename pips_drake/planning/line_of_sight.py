"""Whether an arm's middle can go straight from a point to another, exactly.

No sampling: a ball around a point of the segment whose radius is the distance d to the obstacles
holds no obstacle. It covers the tube of radius r around the piece of the segment that reaches
sqrt(d^2 - r^2) to either side. A segment is clear when such balls cover its whole tube. To make an
end of it where the segment grazes an obstacle, r is `TOLERANCE` less than asked for, and "blocked"
means that a point was found that is nearer than r.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.scene.shape_distance import distance_to_shape, least_distance
from pips_drake.scene.signed_distance import SignedDistanceField

Array = NDArray[np.float64]

#: A clear segment keeps its radius but for this, m.
TOLERANCE = 1e-5


def is_clear(field: SignedDistanceField, points: ArrayLike, radius: float) -> bool:
    """Whether a polyline (N, 3) m in the world keeps a radius (m, > 0) from all obstacles."""
    p = np.ascontiguousarray(points, dtype=np.float64)
    blocked, _, _ = first_blocked(field.arrays, p, radius)
    return bool(blocked < 0)


@numba.njit(cache=True)
def first_blocked(field, points, radius):
    """The first blocked segment of a polyline (-1: none), where on it (m), by which shape."""
    for i in range(points.shape[0] - 1):
        at, shape = segment_blocked(field, points[i], points[i + 1], radius)
        if shape >= 0:
            return i, at, shape
    return -1, 0.0, -1


@numba.njit(cache=True)
def segment_blocked(field, a, b, radius):
    """Where a segment is found to be blocked (m from a), and by which shape; -1 if it is clear."""
    dx, dy, dz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    if length > 0.0:
        dx, dy, dz = dx / length, dy / length, dz / length
    # Shapes that are near enough to the middle to come near any of it.
    shapes = field.kinds.shape[0]
    chosen, count = np.empty(shapes, dtype=np.int64), 0
    half = 0.5 * length
    mx, my, mz = a[0] + half * dx, a[1] + half * dy, a[2] + half * dz
    for m in range(shapes):
        reach = field.radii[m] + half + radius
        cx, cy, cz = field.centres[m, 0] - mx, field.centres[m, 1] - my, field.centres[m, 2] - mz
        if cx * cx + cy * cy + cz * cz > reach * reach:
            continue
        d, _, _, _ = distance_to_shape(field, m, mx, my, mz)
        if d < half + radius:
            chosen[count] = m
            count += 1
    if count == 0:
        return 0.0, -1
    least = max(radius - TOLERANCE, 0.5 * radius)
    covered, at = 0.0, 0.0
    while True:
        x, y, z = a[0] + at * dx, a[1] + at * dy, a[2] + at * dz
        d, _, _, _, shape = least_distance(field, x, y, z, chosen, count)
        # Points of tangency are found `TOLERANCE` deep at most.
        if d < radius - 0.5 * TOLERANCE:
            return at, shape
        reach = math.sqrt(d * d - least * least)
        if at - reach > covered:
            # Neither ball covers what is between them: look there.
            at = covered + 0.5 * (at - reach - covered)
            continue
        if at == length:
            return 0.0, -1
        covered = at + reach
        # The next ball is probably as large as this one. The last one has the end for its centre:
        # what is nearest to the end may be beyond it.
        at = min(covered + 0.9 * reach, length)
