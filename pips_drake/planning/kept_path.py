"""Paths that are cut and gone on with: the part that is kept stays exactly what it was.

Follow-the-leader asks only for the path behind the tip. So where a path is cut at the tip, and
another goes on from there along the same tangent, the joints are the same on both: an arm changes
from one to the other without moving. Rounding corners anew (`blended_path` of all points together)
would move the part that the arm lies on.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.serpentine.path_geometry import LENGTH, START
from pips_drake.serpentine.tip_path import TipPath, blended_path

Array = NDArray[np.float64]

#: A part of a piece that is shorter than this is left out, m.
_SHORTEST = 1e-9


def cut_path(path: TipPath, arc_length: float) -> TipPath:
    """The path up to an arc length (m): the same lines and arcs, the last one shorter.

    Raises:
        InputError: the arc length is not between the home tip and the end.
    """
    if not path.home_arc_length <= arc_length <= path.length:
        raise InputError(
            f"path '{path.name}' cut at {arc_length} m; must be {path.home_arc_length:.6g} (home) "
            f".. {path.length:.6g} m (end)"
        )
    pieces = path.pieces[path.pieces[:, START] < arc_length - _SHORTEST].copy()
    pieces[-1, LENGTH] = min(pieces[-1, LENGTH], arc_length - pieces[-1, START])
    marks = path.marks[path.marks <= arc_length]
    return replace(path, pieces=pieces, marks=marks)


def continued_path(path: TipPath, points: ArrayLike) -> TipPath:
    """The path, and on from its end through points with rounded corners.

    Args:
        points: (P, 3) m; the first is the path's end, the second lies straight ahead of it.

    Raises:
        InputError: the points do not begin at the path's end, or not straight ahead.
    """
    way = np.asarray(points, dtype=np.float64)
    rest = blended_path(way, path.name)
    end, tangent = path.point(path.length), path.tangent(path.length)
    ahead = (way[1] - way[0]) / np.linalg.norm(way[1] - way[0])
    if np.abs(way[0] - end).max() > _SHORTEST or np.abs(ahead - tangent).max() > 1e-6:
        raise InputError(
            f"path '{path.name}' does not go on from its end along its tangent: from "
            f"{way[0].tolist()} m to {way[1].tolist()} m"
        )
    pieces = rest.pieces.copy()
    pieces[:, START] += path.length
    return replace(
        path,
        pieces=np.vstack([path.pieces, pieces]),
        marks=np.concatenate([path.marks, path.length + rest.marks]),
        deviation=max(path.deviation, rest.deviation),
    )
