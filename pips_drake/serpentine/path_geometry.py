"""Compiled geometry of a path made of lines and circular arcs.

A path is a table of float64 with one row a piece, so that compiled code can walk it without
knowing Python objects. Columns:

| column | line | arc |
|---|---|---|
| `START` | arc length at the piece's start, m | same |
| `LENGTH` | length, m | same |
| `RADIUS` | 0 | radius, m |
| `ORIGIN` .. +3 | start point, m | centre, m |
| `U` .. +3 | unit direction | unit vector from the centre to the start |
| `V` .. +3 | zero | unit tangent at the start |
"""

from __future__ import annotations

import math

import numba
import numpy as np

START, LENGTH, RADIUS, ORIGIN, U, V, COLUMNS = 0, 1, 2, 3, 6, 9, 12

#: How far outside a piece, as a fraction of it, an intersection still counts as on it. Rounding
#: alone would otherwise lose the hit when a vertex lies exactly one module length away (FACTS).
ON_PIECE_TOLERANCE = 1e-12


@numba.njit(cache=True)
def find_piece(table, s):
    """Index of the piece that holds arc length `s` (m); ends belong to the earlier piece."""
    low, high = 0, table.shape[0] - 1
    while low < high:
        middle = (low + high) // 2
        if s <= table[middle, START] + table[middle, LENGTH]:
            high = middle
        else:
            low = middle + 1
    return low


@numba.njit(cache=True)
def piece_point(table, piece, local, point, tangent):
    """Point (m) and unit tangent at arc length `local` from the start of a piece, in place."""
    radius = table[piece, RADIUS]
    if radius == 0.0:
        for k in range(3):
            point[k] = table[piece, ORIGIN + k] + local * table[piece, U + k]
            tangent[k] = table[piece, U + k]
    else:
        cosine, sine = math.cos(local / radius), math.sin(local / radius)
        for k in range(3):
            u, v = table[piece, U + k], table[piece, V + k]
            point[k] = table[piece, ORIGIN + k] + radius * (cosine * u + sine * v)
            tangent[k] = -sine * u + cosine * v


@numba.njit(cache=True)
def points_and_tangents(table, s):
    """Points (N, 3) in m and unit tangents (N, 3) at arc lengths `s` (N,) in m."""
    points = np.empty((s.size, 3))
    tangents = np.empty((s.size, 3))
    for i in range(s.size):
        piece = find_piece(table, s[i])
        piece_point(table, piece, s[i] - table[piece, START], points[i], tangents[i])
    return points, tangents


@numba.njit(cache=True)
def sphere_line_roots(px, py, pz, ux, uy, uz, cx, cy, cz, radius):
    """Where a line meets a sphere: `(real, t1, t2)` with t1 <= t2 (FTL-95 Eqs 3.5 to 3.8).

    The line is p + t u. With a unit u, t is a length in m; the quadratic's A is then 1, and the
    midpoint form used here loses fewer digits than -B +- sqrt(B^2 - 4AC).
    """
    dx, dy, dz = px - cx, py - cy, pz - cz
    a = ux * ux + uy * uy + uz * uz
    b = (ux * dx + uy * dy + uz * dz) / a
    # The foot of the perpendicular, so that radius^2 - foot^2 is computed from small numbers.
    fx, fy, fz = dx - b * ux, dy - b * uy, dz - b * uz
    half2 = (radius * radius - (fx * fx + fy * fy + fz * fz)) / a
    if half2 < 0.0:
        return False, math.nan, math.nan
    half = math.sqrt(half2)
    return True, -b - half, -b + half


@numba.njit(cache=True)
def _line_exit(table, piece, high, centre, radius, slack):
    """Where, going back from `high`, a line piece leaves the sphere; -1 if it does not."""
    real, first, _ = sphere_line_roots(
        table[piece, ORIGIN],
        table[piece, ORIGIN + 1],
        table[piece, ORIGIN + 2],
        table[piece, U],
        table[piece, U + 1],
        table[piece, U + 2],
        centre[0],
        centre[1],
        centre[2],
        radius,
    )
    # The base-side root: going back from inside a sphere, a line leaves it once, at the smaller t.
    if real and -slack <= first <= high + slack:
        return min(max(first, 0.0), high)
    return -1.0


@numba.njit(cache=True)
def _arc_exit(table, piece, high, centre, radius, slack):
    """Where, going back from `high`, an arc piece leaves the sphere; -1 if it does not."""
    r = table[piece, RADIUS]
    mx = table[piece, ORIGIN] - centre[0]
    my = table[piece, ORIGIN + 1] - centre[1]
    mz = table[piece, ORIGIN + 2] - centre[2]
    a = mx * table[piece, U] + my * table[piece, U + 1] + mz * table[piece, U + 2]
    b = mx * table[piece, V] + my * table[piece, V + 1] + mz * table[piece, V + 2]
    # |m + r (cos u + sin v)|^2 = radius^2  <=>  a cos(phi) + b sin(phi) = c
    c = (radius * radius - mx * mx - my * my - mz * mz - r * r) / (2.0 * r)
    amplitude = math.sqrt(a * a + b * b)
    if amplitude == 0.0 or abs(c) > amplitude:
        return -1.0
    # Distance grows towards phi0; outside is |phi - phi0| < delta. Going back one enters the
    # outside at phi0 + delta, taken in the turn that ends at `high`.
    phi = math.atan2(b, a) + math.acos(c / amplitude)
    top = (high + slack) / r
    phi -= 2.0 * math.pi * math.ceil((phi - top) / (2.0 * math.pi))
    local = phi * r
    if -slack <= local <= high + slack:
        return min(max(local, 0.0), high)
    return -1.0


@numba.njit(cache=True)
def walk_back(table, piece, local, centre, radius):
    """The walk of FTL-95 section 3.3.2.1: the first point at `radius` from `centre`, going back.

    Starts at `local` (m) on `piece`, which lies inside the sphere, and tries one piece after the
    other towards the base.

    Returns:
        piece index and arc length on it in m; the index is -1 if the path's start is reached.
    """
    high = local
    while piece >= 0:
        slack = ON_PIECE_TOLERANCE * table[piece, LENGTH]
        if table[piece, RADIUS] == 0.0:
            hit = _line_exit(table, piece, high, centre, radius, slack)
        else:
            hit = _arc_exit(table, piece, high, centre, radius, slack)
        if hit >= 0.0:
            return piece, hit
        piece -= 1
        if piece >= 0:
            high = table[piece, LENGTH]
    return -1, math.nan


@numba.njit(cache=True)
def _piece_distance(table, piece, low, high, point):
    """Distance (m) from a point to the part [low, high] (m) of a piece, and where it is."""
    radius = table[piece, RADIUS]
    dx = point[0] - table[piece, ORIGIN]
    dy = point[1] - table[piece, ORIGIN + 1]
    dz = point[2] - table[piece, ORIGIN + 2]
    along_u = dx * table[piece, U] + dy * table[piece, U + 1] + dz * table[piece, U + 2]
    if radius == 0.0:
        local = min(max(along_u, low), high)
    else:
        along_v = dx * table[piece, V] + dy * table[piece, V + 1] + dz * table[piece, V + 2]
        # The nearest angle, taken in the turn centred on the part's middle, then clamped.
        middle = 0.5 * (low + high) / radius
        phi = math.atan2(along_v, along_u)
        phi -= 2.0 * math.pi * math.floor((phi - middle + math.pi) / (2.0 * math.pi))
        local = min(max(phi * radius, low), high)
    nearest = np.empty(3)
    tangent = np.empty(3)
    piece_point(table, piece, local, nearest, tangent)
    gap = math.sqrt(
        (point[0] - nearest[0]) ** 2 + (point[1] - nearest[1]) ** 2 + (point[2] - nearest[2]) ** 2
    )
    return gap, local


@numba.njit(cache=True)
def nearest_on_path(table, points, low, high):
    """Distance (N,) in m and arc length (N,) in m of the path's nearest point to each point.

    Only the part from `low` to `high` (N,) in m is looked at, so that a path that comes back near
    itself is not mistaken for the part that the link should lie on.
    """
    distance = np.empty(points.shape[0])
    arc_length = np.empty(points.shape[0])
    for i in range(points.shape[0]):
        best, where = math.inf, 0.0
        piece = find_piece(table, low[i])
        while piece < table.shape[0] and (
            table[piece, START] <= high[i] or piece == find_piece(table, low[i])
        ):
            start, length = table[piece, START], table[piece, LENGTH]
            first = min(max(low[i] - start, 0.0), length)
            last = min(max(high[i] - start, first), length)
            gap, local = _piece_distance(table, piece, first, last, points[i])
            if gap < best:
                best, where = gap, start + local
            piece += 1
        distance[i], arc_length[i] = best, where
    return distance, arc_length
