"""Where the tip goes to scan a surface: rasters and helices on a cylinder (CMU-92 section 3.7.3).

A camera with a field of view a that looks straight at a flat surface from a standoff h sees a strip
2 h tan(a / 2) wide; lines stand a strip's width times (1 - overlap) apart. Across a convex cylinder
of radius R, seen from R + h, the strip's edge stands at an angle f from its middle about the axis,
where by the law of sines

    (R + h) sin(a / 2) = R sin(a / 2 + f),

and a / 2 + f is the incidence there, which has a limit of its own. How the camera is turned about
its view is not known beforehand: strips are counted as wide as its narrower field.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.config import require
from pips_drake.errors import InputError
from pips_drake.planning.scan_target import CylinderTarget, ScanCamera
from pips_drake.scene.signed_distance import SignedDistanceField
from pips_drake.serpentine.path_file import read_points

Array = NDArray[np.float64]

#: More points than this are a mistake in a number.
MOST_POINTS = 100_000


@dataclass(frozen=True, kw_only=True, eq=False)
class ScanPattern:
    """Where the tip goes, point by point.

    Attributes:
        kind: `raster`, `helix`, or `points`.
        points: (N, 3) m in the world.
        views: unit vectors towards the surface, (N, 3).
        passes: which line or turn a point belongs to, from 0, (N,); a point between two lines
            belongs to the one that comes.
        spacing: of the lines on the surface, m; 0 where there is but one, or it is not known.
        swath: how wide a strip the camera sees from the standoff, m; 0 where it is not known.
        standoff: m; not a number where it is not known.
        target: what is to be seen; None where it is not known.
    """

    kind: str
    points: Array
    views: Array
    passes: NDArray[np.int64]
    spacing: float = 0.0
    swath: float = 0.0
    standoff: float = math.nan
    target: CylinderTarget | None = None

    @property
    def length(self) -> float:
        """Of the tip's way, m."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())


def swath_along(camera: ScanCamera, standoff: float) -> float:
    """How wide a strip around the axis is, m along it: flat there, 2 h tan(a / 2)."""
    _check_standoff(camera, standoff)
    return 2.0 * standoff * math.tan(min(0.5 * camera.narrower, camera.incidence))


def swath_around(camera: ScanCamera, standoff: float, radius: float) -> float:
    """How wide a strip along the axis is, rad about it (the module's text has the equation)."""
    _check_standoff(camera, standoff)
    sine = (1.0 + standoff / radius) * math.sin(0.5 * camera.narrower)
    incidence = camera.incidence if sine >= 1.0 else min(math.asin(sine), camera.incidence)
    return 2.0 * (incidence - math.asin(math.sin(incidence) / (1.0 + standoff / radius)))


def raster(
    target: CylinderTarget,
    camera: ScanCamera,
    *,
    standoff: float,
    overlap: float = 0.2,
    lines: Literal["around", "along"] = "around",
    step: float = 0.1,
) -> ScanPattern:
    """Lines to and fro, joined at their ends.

    Args:
        standoff: of the tip from the surface, m.
        overlap: share of a strip that the next one sees again; the lines stand as much nearer as
            makes the outermost strips end with the target.
        lines: around the axis, or along it.
        step: of the points, m.

    Raises:
        InputError: a number that means nothing.
    """
    _check_overlap(overlap)
    wide = swath_along(camera, standoff)
    turn = swath_around(camera, standoff, target.radius)
    if lines == "around":
        places, spacing = _lines(*target.along, wide, overlap)
        swath, ends = wide, _inset(*target.around, turn)
    elif lines == "along":
        places, spacing = _lines(*target.around, turn, overlap)
        swath, spacing = turn * target.radius, spacing * target.radius
        ends = _inset(*target.along, wide)
    else:
        raise InputError(f"raster's lines = '{lines}'; must be around or along")
    corners = []
    for row, place in enumerate(places):
        for end in ends if row % 2 == 0 else ends[::-1]:
            corners.append((place, end) if lines == "around" else (end, place))
    # The way from a line's end to the next line's beginning counts with the next line.
    numbers = (np.arange(1, 2 * len(places)) // 2).astype(np.int64)
    return _walk("raster", target, np.array(corners), numbers, standoff, step, spacing, swath)


def helix(
    target: CylinderTarget,
    camera: ScanCamera,
    *,
    standoff: float,
    overlap: float = 0.2,
    step: float = 0.1,
) -> ScanPattern:
    """Around and around, a strip's width times (1 - overlap) farther with every turn.

    It begins and ends with a turn that does not climb, or the target's edges would be cut.

    Raises:
        InputError: a number that means nothing, or a target that does not go all the way around.
    """
    _check_overlap(overlap)
    turn = math.degrees(target.around[1] - target.around[0])
    require(target.whole_turn, "helix around", f"{turn:g} deg", "360 deg: a raster scans a part")
    swath = swath_along(camera, standoff)
    places, spacing = _lines(*target.along, swath, overlap)
    angles = target.around[0] + 2.0 * math.pi * np.arange(len(places) + 2)
    heights = np.concatenate([places[:1], places, places[-1:]])
    if len(places) == 1:
        angles, heights = angles[:2], heights[:2]
    corners = np.column_stack([heights, angles])
    numbers = np.arange(len(corners) - 1)
    return _walk("helix", target, corners, numbers, standoff, step, spacing, swath)


def pattern_of_points(
    points: ArrayLike,
    *,
    target: CylinderTarget | None = None,
    field: SignedDistanceField | None = None,
    step: float = 0.1,
) -> ScanPattern:
    """A pattern that is given point by point, for any surface.

    Args:
        points: (P, 3) m in the world, corners of a polyline.
        target: looked at along its normals, if given.
        field: otherwise: looked at is what is nearest, against the distance's gradient.

    Raises:
        InputError: the points are no polyline, or neither target nor field is given.
    """
    corners = np.asarray(points, dtype=np.float64)
    if corners.ndim != 2 or corners.shape[1:] != (3,) or len(corners) < 2:
        raise InputError(f"scanned points of shape {corners.shape}; must be (2 or more, 3)")
    if not np.isfinite(corners).all():
        raise InputError("scanned points; must be finite numbers")
    dense, _ = _dense(corners, np.linalg.norm(np.diff(corners, axis=0), axis=1), step)
    if target is not None:
        _, around, height = target.from_world(dense)
        views, standoff = -target.normals(around), float(height.mean())
    elif field is not None:
        near = field.nearest(dense)
        views, standoff = -near.gradients, float(near.distances.mean())
    else:
        raise InputError("scanned points; must come with a target or with what is looked at")
    return ScanPattern(
        kind="points",
        points=dense,
        views=views,
        passes=np.zeros(len(dense), dtype=np.int64),
        standoff=standoff,
        target=target,
    )


def read_pattern(
    file: Path,
    *,
    target: CylinderTarget | None = None,
    field: SignedDistanceField | None = None,
    step: float = 0.1,
) -> ScanPattern:
    """`pattern_of_points` of a CSV table with a header x_m,y_m,z_m or x_in,y_in,z_in.

    Raises:
        InputError: names file, row and value.
    """
    try:
        return pattern_of_points(read_points(file), target=target, field=field, step=step)
    except InputError as error:
        if str(error).startswith(str(file)):
            raise
        raise InputError(f"{file}: {error}") from None


def _check_standoff(camera: ScanCamera, standoff: float) -> None:
    good = math.isfinite(standoff) and standoff > 0.0 and camera.near <= standoff <= camera.far
    allowed = f"within the camera's range, {camera.near:g} .. {camera.far:g} m"
    require(good, "standoff", f"{standoff} m", allowed)


def _check_overlap(overlap: float) -> None:
    require(0.0 <= overlap <= 0.95, "overlap", overlap, "0 .. 0.95")


def _lines(low: float, high: float, swath: float, overlap: float) -> tuple[Array, float]:
    """Middles of strips that cover low .. high, and their spacing; one stands in the middle."""
    left = high - low - swath
    count = max(1, math.ceil(left / ((1.0 - overlap) * swath) - 1e-9) + 1)
    require(count <= MOST_POINTS, "number of a scan's lines", count, f"<= {MOST_POINTS}")
    if count == 1:
        return np.array([0.5 * (low + high)]), 0.0
    return np.linspace(low + 0.5 * swath, high - 0.5 * swath, count), left / (count - 1)


def _inset(low: float, high: float, swath: float) -> tuple[float, float]:
    """Where lines begin and end so that the camera sees as far as low and high."""
    inset = min(0.5 * swath, 0.5 * (high - low) - 1e-3)
    return low + max(inset, 0.0), high - max(inset, 0.0)


def _walk(
    kind: str,
    target: CylinderTarget,
    corners: Array,
    numbers: NDArray[np.int64],
    standoff: float,
    step: float,
    spacing: float,
    swath: float,
) -> ScanPattern:
    """A pattern through corners (C, 2): along (m) and around (rad); `numbers` of the C - 1 legs."""
    ways = np.diff(corners, axis=0) * [1.0, target.radius + standoff]
    places, leg = _dense(corners, np.linalg.norm(ways, axis=1), step)
    return ScanPattern(
        kind=kind,
        points=target.to_world(places[:, 0], places[:, 1], standoff),
        views=-target.normals(places[:, 1]),
        passes=numbers[leg],
        spacing=spacing,
        swath=swath,
        standoff=standoff,
        target=target,
    )


def _dense(corners: Array, lengths: Array, step: float) -> tuple[Array, NDArray[np.int64]]:
    """Points on a polyline at most a step apart, and their legs: a corner is on the one before."""
    require(math.isfinite(step) and step > 0.0, "scan's step", f"{step} m", "> 0")
    parts = np.maximum(np.ceil(lengths / step - 1e-9), 1.0)
    require(parts.sum() < MOST_POINTS, "number of a scan's points", parts.sum(), f"< {MOST_POINTS}")
    at = np.concatenate([k + np.arange(1, n + 1) / n for k, n in enumerate(parts)])
    at = np.concatenate([[0.0], at])
    leg = np.maximum(np.ceil(at).astype(np.int64) - 1, 0)
    share = (at - leg)[:, None]
    return corners[leg] * (1.0 - share) + corners[leg + 1] * share, leg
