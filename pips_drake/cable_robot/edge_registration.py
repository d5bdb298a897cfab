"""Where a camera really looks, from a panel's edges in its picture.

What a cable robot knows of its orientation may be wrong by several mrad: at a panel's edge by more
than the strip along it that is not looked at, so the edge itself would be taken for a defect. But a
picture that shows an edge shows which way the camera is wrong: the step from the panel to its dark
edge strip is looked for near where it should be, and the camera's pose is turned until it is there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pips_drake.cable_robot.kinematics import Poses
from pips_drake.cable_robot.panel_paint import PanelLook
from pips_drake.cable_robot.panels import Panel, panel_points
from pips_drake.cable_robot.survey_camera import SurveyCamera, world_pixels
from pips_drake.config import require

Array = NDArray[np.float64]

#: Points along an edge that are compared, and the fewest that must be in the picture.
_POINTS, _FEWEST = 400, 25
#: Pixels either side of a step whose brightness is compared.
_SIDE = 4
#: Least step, as a share of the brightness within, and share of the largest that counts as one.
_STEP, _SHARE = 0.15, 0.6
#: Farthest from the camera at which an edge is looked for, m.
_FAR = 1.5


def edge_shift(
    picture: NDArray[np.uint8],
    camera: SurveyCamera,
    poses: Poses,
    index: int,
    panels: Sequence[Panel],
    *,
    reach: float,
    strip: float = PanelLook.edge,
) -> Array:
    """By how much edges are off where they should be, (2,) pixels (across, down); NaN: none seen.

    Edges along v say how much across, edges along u how much down: views are square.

    Args:
        picture: (H, W, 3).
        poses: of the camera, as estimated; `index` is the picture's.
        reach: how far off edges may be, m.
        strip: width of the dark strip along the edges, m.
    """
    require(reach > 0.0, "reach of edges", f"{reach:g} m", "> 0")
    origin = poses.position[index]
    shifts: list[list[float]] = [[], []]
    share = np.linspace(0.0, 1.0, _POINTS)
    for panel in panels:
        ends = (panel.start - _FAR, panel.start + panel.length + _FAR)
        behind = math.hypot(origin[1] - panel.axis[0], origin[2] - panel.axis[1]) > panel.radius
        if behind or not ends[0] < origin[0] < ends[1]:
            continue
        u, v = panel.length * share, panel.width * share
        for axis, inwards, uv in (
            (0, 1.0, np.column_stack([0.0 * v + strip, v])),
            (0, -1.0, np.column_stack([0.0 * v + panel.length - strip, v])),
            (1, 1.0, np.column_stack([u, 0.0 * u + strip])),
            (1, -1.0, np.column_stack([u, 0.0 * u + panel.width - strip])),
        ):
            points = panel_points(panel, uv)
            points = points[np.linalg.norm(points - origin, axis=1) < _FAR]
            pixels = world_pixels(camera, poses, index, points)
            # Which way into the panel is in the picture: u goes across, v up or down by the side.
            way = int(inwards) if axis == 0 else int(-inwards * panel.side)
            found = _step(picture, pixels, axis, way, math.ceil(reach * camera.focal_length))
            if found is not None:
                shifts[axis].append(found)
    return np.array([float(np.median(s)) if s else math.nan for s in shifts])


def registered(
    picture: NDArray[np.uint8],
    camera: SurveyCamera,
    poses: Poses,
    index: int,
    panels: Sequence[Panel],
    *,
    reach: float,
    strip: float = PanelLook.edge,
) -> Poses:
    """The poses, with the picture's own turned so that edges which it shows are where they are.

    Arguments as of `edge_shift`. A picture that shows no edge keeps its pose. The error of the
    camera's place is taken for one of its orientation, which for a place near by is the same.
    """
    shift = edge_shift(picture, camera, poses, index, panels, reach=reach, strip=strip)
    across, down = np.nan_to_num(shift) / camera.focal_length
    turn = Rotation.from_rotvec([math.atan(down), -math.atan(across), 0.0]).as_matrix()
    rotation = np.array(poses.rotation)
    rotation[index] = rotation[index] @ turn
    return Poses(poses.position, rotation)


def _step(
    picture: NDArray[np.uint8], pixels: Array, axis: int, way: int, reach: int
) -> float | None:
    """How far along an axis of the picture the step from dark to light, inwards, is; None: nowhere.

    The innermost of several is the panel's own: beyond its edge strip there may be others.
    """
    height, width = picture.shape[:2]
    whole = np.rint(pixels[np.isfinite(pixels[:, 0])]).astype(np.int64)
    size = (width, height)
    span = reach + _SIDE
    # Along the axis all that is compared must be in the picture, or it would be of other points.
    low, high = np.zeros(2, dtype=np.int64), np.array(size) - 1
    low[axis] += span
    high[axis] -= span
    kept = np.all((whole >= low) & (whole <= high), axis=1)
    if kept.sum() < _FEWEST:
        return _partial(picture, whole, axis, way, reach)
    return _best(picture, whole[kept], axis, way, np.arange(-reach, reach + 1))


def _partial(
    picture: NDArray[np.uint8], whole: NDArray[np.int64], axis: int, way: int, reach: int
) -> float | None:
    """As `_step`, of an edge so near the picture's rim that shifts beyond it are not looked at."""
    size = np.array(picture.shape[1::-1])
    inside = np.all((whole >= 0) & (whole < size), axis=1)
    if inside.sum() < _FEWEST:
        return None
    kept = whole[inside]
    first = max(-reach, _SIDE - int(kept[:, axis].min()))
    last = min(reach, int(size[axis]) - 1 - _SIDE - int(kept[:, axis].max()))
    if last - first < 2:
        return None
    return _best(picture, kept, axis, way, np.arange(first, last + 1))


def _best(
    picture: NDArray[np.uint8],
    pixels: NDArray[np.int64],
    axis: int,
    way: int,
    shifts: NDArray[np.int64],
) -> float | None:
    offsets = np.arange(shifts[0] - _SIDE, shifts[-1] + _SIDE + 1)
    column, row = pixels.T
    if axis == 0:
        profile = picture[row[:, None], column[:, None] + offsets, 1]
    else:
        profile = picture[row[:, None] + offsets, column[:, None], 1]
    # Medians: defects, and edges that cross this one, are few of its points.
    middle = np.median(profile, axis=0)
    k = np.arange(len(shifts)) + _SIDE
    after = np.mean([middle[k + n] for n in range(1, _SIDE + 1)], axis=0)
    before = np.mean([middle[k - n] for n in range(1, _SIDE + 1)], axis=0)
    light, dark = (after, before) if way > 0 else (before, after)
    step = (light - dark) / np.maximum(light, 1.0)
    if step.max() < _STEP:
        return None
    strong = step >= max(_SHARE * step.max(), _STEP)
    peak = strong & (step >= np.roll(step, 1)) & (step >= np.roll(step, -1))
    peak[[0, -1]] = False
    places = np.flatnonzero(peak)
    if not len(places):
        return None
    # Inwards is the way; equal neighbours (a plateau) count as their middle.
    best = places[-1] if way > 0 else places[0]
    plateau = places[np.abs(places - best) <= 2]
    return float(shifts[plateau].mean())
