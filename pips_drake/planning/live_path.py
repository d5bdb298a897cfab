"""The tip's path along a snake, made anew at every tick."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pips_drake.errors import InputError
from pips_drake.serpentine.path_geometry import COLUMNS, LENGTH, ORIGIN, RADIUS, START, U, V
from pips_drake.serpentine.tip_path import STRAIGHT, TipPath

Array = NDArray[np.float64]


def rounded_path(points: Array, name: str) -> TipPath:
    """As `tip_path.blended_path`, for points (P, 3) m that are fit for it, in a loop's time.

    There must be no corner at home (row 1), as a lead ensures, and none that turns straight back.
    """
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    ways = steps / lengths[:, None]
    across = np.linalg.norm(np.cross(ways[:-1], ways[1:]), axis=1)
    turns = np.arctan2(across, np.einsum("ij,ij->i", ways[:-1], ways[1:]))
    round_ = turns > STRAIGHT
    room = 0.5 * np.minimum(np.append(np.inf, lengths[1:-1]), lengths[1:])
    tangent = np.where(round_, room, 0.0)
    # A line on each segment, shortened at both ends, and an arc after each but the last.
    cut_before, cut_after = np.append(0.0, tangent), np.append(tangent, 0.0)
    rows = np.zeros((2 * len(lengths) - 1, COLUMNS))
    lines, arcs = rows[0::2], rows[1::2]
    lines[:, LENGTH] = lengths - cut_before - cut_after
    lines[:, ORIGIN : ORIGIN + 3] = points[:-1] + cut_before[:, None] * ways
    lines[:, U : U + 3] = ways
    half = np.tan(0.5 * np.where(round_, turns, 1.0))
    radius = tangent / half
    # Towards the centre: what of the next way is square to this one.
    aside = ways[1:] - np.cos(turns)[:, None] * ways[:-1]
    inward = aside / np.where(round_, np.linalg.norm(aside, axis=1), 1.0)[:, None]
    arcs[:, LENGTH], arcs[:, RADIUS] = radius * turns, radius
    arcs[:, ORIGIN : ORIGIN + 3] = (
        points[1:-1] - tangent[:, None] * ways[:-1] + radius[:, None] * inward
    )
    arcs[:, U : U + 3], arcs[:, V : V + 3] = -inward, ways[:-1]
    kept = rows[:, LENGTH] > 1e-12
    kept[1::2] &= round_
    rows = rows[kept]
    rows[:, START] = np.append(0.0, np.cumsum(rows[:-1, LENGTH]))
    return TipPath(name=name, pieces=rows, home_arc_length=float(lengths[0]), marks=np.empty(0))


def with_lead(points: Array, along: Array, lead: float) -> Array:
    """A path (P, 3) m whose first `lead` (m) goes straight on from its beginning.

    Raises:
        InputError: it does not go on beyond its lead.
    """
    if points.ndim != 2 or points.shape[1:] != (3,) or len(points) < 2:
        raise InputError(f"snake's path of shape {points.shape}; must be (2 or more, 3)")
    ahead = (points - points[0]) @ along
    beyond = np.flatnonzero(ahead > lead + 1e-9)
    if not beyond.size:
        raise InputError(f"snake's path; must go beyond its lead of {lead:g} m")
    return np.vstack([points[0], points[0] + lead * along, points[beyond[0] :]])
