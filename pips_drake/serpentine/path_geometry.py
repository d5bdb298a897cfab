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

#: A point is surely inside a sphere if its squared distance is less than the squared radius by this
#: (m) times the radius: 500 times what `ON_PIECE_TOLERANCE` and rounding make of a metre.
_SURELY_INSIDE = 1e-9


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


@numba.njit(cache=True, error_model="numpy")
def piece_position(table, piece, local):
    """Point (x, y, z) m at arc length `local` from the start of a piece."""
    x, y, z = table[piece, ORIGIN], table[piece, ORIGIN + 1], table[piece, ORIGIN + 2]
    radius = table[piece, RADIUS]
    if radius == 0.0:
        u, v = local, 0.0
    else:
        # From the arc's start, by half angles: far from the centre cosines lose what matters.
        x += radius * table[piece, U]
        y += radius * table[piece, U + 1]
        z += radius * table[piece, U + 2]
        sine = math.sin(0.5 * local / radius)
        u = -2.0 * radius * sine * sine
        v = 2.0 * radius * sine * math.cos(0.5 * local / radius)
    return (
        x + (u * table[piece, U] + v * table[piece, V]),
        y + (u * table[piece, U + 1] + v * table[piece, V + 1]),
        z + (u * table[piece, U + 2] + v * table[piece, V + 2]),
    )


@numba.njit(cache=True)
def piece_point(table, piece, local, point, tangent):
    """Point (m) and unit tangent at arc length `local` from the start of a piece, in place."""
    point[0], point[1], point[2] = piece_position(table, piece, local)
    radius = table[piece, RADIUS]
    if radius == 0.0:
        cosine, sine = 0.0, -1.0
    else:
        cosine, sine = math.cos(local / radius), math.sin(local / radius)
    for k in range(3):
        tangent[k] = -sine * table[piece, U + k] + cosine * table[piece, V + k]


@numba.njit(cache=True)
def points_and_tangents(table, s):
    """Points (N, 3) in m and unit tangents (N, 3) at arc lengths `s` (N,) in m."""
    points = np.empty((s.size, 3))
    tangents = np.empty((s.size, 3))
    for i in range(s.size):
        piece = find_piece(table, s[i])
        piece_point(table, piece, s[i] - table[piece, START], points[i], tangents[i])
    return points, tangents


@numba.njit(cache=True, error_model="numpy")
def sphere_line_roots(px, py, pz, ux, uy, uz, cx, cy, cz, radius):
    """Where a line meets a sphere: `(real, t1, t2)` with t1 <= t2 (FTL-95 Eqs 3.5 to 3.8).

    The line is p + t u with a unit u, so that t is a length in m; the quadratic's A is then 1, and
    the midpoint form used here loses fewer digits than -B +- sqrt(B^2 - 4AC).
    """
    dx, dy, dz = px - cx, py - cy, pz - cz
    b = ux * dx + uy * dy + uz * dz
    # The foot of the perpendicular, so that radius^2 - foot^2 is computed from small numbers.
    fx, fy, fz = dx - b * ux, dy - b * uy, dz - b * uz
    half2 = radius * radius - (fx * fx + fy * fy + fz * fz)
    if half2 < 0.0:
        return False, math.nan, math.nan
    half = math.sqrt(half2)
    return True, -b - half, -b + half


@numba.njit(cache=True, error_model="numpy")
def _line_exit(table, piece, high, cx, cy, cz, radius, slack):
    """Where, going back from `high`, a line piece leaves the sphere; -1 if it does not."""
    px, py, pz = table[piece, ORIGIN], table[piece, ORIGIN + 1], table[piece, ORIGIN + 2]
    # A sphere is convex: from a point inside it, a line leaves before its start only if the start
    # lies outside. That spares the root on most pieces (the rounding of both sides is far less).
    inside = radius * radius - ((px - cx) ** 2 + (py - cy) ** 2 + (pz - cz) ** 2)
    if inside > _SURELY_INSIDE * radius:
        return -1.0
    real, first, _ = sphere_line_roots(
        px, py, pz, table[piece, U], table[piece, U + 1], table[piece, U + 2], cx, cy, cz, radius
    )
    # The base-side root: going back from inside a sphere, a line leaves it once, at the smaller t.
    if real and -slack <= first <= high + slack:
        return min(max(first, 0.0), high)
    return -1.0


@numba.njit(cache=True, error_model="numpy")
def _arc_exit(table, piece, high, cx, cy, cz, radius, slack):
    """Where, going back from `high`, an arc piece leaves the sphere; -1 if it does not."""
    r = table[piece, RADIUS]
    # From the sphere's centre to the arc's start, and its parts along U and V.
    dx = table[piece, ORIGIN] + r * table[piece, U] - cx
    dy = table[piece, ORIGIN + 1] + r * table[piece, U + 1] - cy
    dz = table[piece, ORIGIN + 2] + r * table[piece, U + 2] - cz
    a = dx * table[piece, U] + dy * table[piece, U + 1] + dz * table[piece, U + 2]
    b = dx * table[piece, V] + dy * table[piece, V + 1] + dz * table[piece, V + 2]
    # With t = 2 r tan(phi / 2) the squared distance is that of a line, t^2 + 2 b t + |d|^2, but for
    # terms in 1 / r: nothing cancels on an arc that is nearly straight.
    c = dx * dx + dy * dy + dz * dz - radius * radius
    q = 1.0 - a / r + c / (4.0 * r * r)
    half2 = b * b - q * c
    if half2 < 0.0:
        return -1.0
    half = math.sqrt(half2)
    # Of the two roots the one where the distance falls with phi: going back, one leaves there.
    if b > 0.0:
        phi = 2.0 * math.atan2(-(b + half), 2.0 * r * q)
    else:
        phi = 2.0 * math.atan2(c, 2.0 * r * (half - b))
    top = (high + slack) / r
    phi -= 2.0 * math.pi * math.ceil((phi - top) / (2.0 * math.pi))
    local = phi * r
    if -slack <= local <= high + slack:
        return min(max(local, 0.0), high)
    return -1.0


@numba.njit(cache=True, error_model="numpy")
def walk_back(table, piece, local, cx, cy, cz, radius):
    """The walk of FTL-95 section 3.3.2.1, going back to the first point at `radius` from a centre.

    Starts at `local` (m) on `piece`, which lies inside the sphere, and tries one piece after the
    other towards the base.

    Returns:
        piece index and arc length on it in m; the index is -1 if the path's start is reached.
    """
    high = local
    while piece >= 0:
        slack = ON_PIECE_TOLERANCE * table[piece, LENGTH]
        if table[piece, RADIUS] == 0.0:
            hit = _line_exit(table, piece, high, cx, cy, cz, radius, slack)
        else:
            hit = _arc_exit(table, piece, high, cx, cy, cz, radius, slack)
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
