"""Where the camera must stop to see every panel: a raster, its order, and what it covers.

What is whole in a picture of a concave panel is less than of a flat one: the panel bends towards
the camera. A camera at the distance d from the panel, so at r = R - d from the arc's axis, sees at
half its vertical field t the point at the angle b = t - asin(r sin(t) / R) about the axis, which is
R b along the arc; there the depth is R cos(b) - r, less than d, so less of u is seen too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pips_drake.cable_robot.kinematics import Poses, make_poses
from pips_drake.cable_robot.panels import Panel, panel_normals, panel_points
from pips_drake.cable_robot.survey_camera import (
    STANDOFF,
    SurveyCamera,
    camera_poses,
    check_standoff,
    view_pose,
    world_pixels,
)
from pips_drake.config import require

Array = NDArray[np.float64]
Counts = NDArray[np.int64]

#: Share of a picture that the next one shows again.
OVERLAP = 0.1
#: How far pictures go beyond a panel's edges, m: more than the camera misses its place by.
MARGIN = 0.02
#: More views than this are no survey that anybody would fly.
MOST_VIEWS = 10_000
#: What is farther from the camera than this is too small in the picture to count as seen, m.
FARTHEST = 1.5


@dataclass(frozen=True, eq=False)
class Raster:
    """Views in the order in which they are taken.

    Attributes:
        panels: what is looked at.
        panel: index of each view's panel, (N,).
        uv: the middle of each view, (N, 2) m.
        platform: poses of the level platform, N.
        tilt: of the camera, (N,) rad.
        footprint: what is whole in each picture, (2,) m of u and v.
        overlap: of pictures next to each other, (2,) m of u and v.
    """

    panels: tuple[Panel, ...]
    panel: Counts
    uv: Array
    platform: Poses
    tilt: Array
    footprint: Array
    overlap: Array

    def __len__(self) -> int:
        return len(self.panel)

    @property
    def path_length(self) -> float:
        """From view to view in straight lines, m."""
        steps = np.diff(self.platform.position, axis=0)
        return float(np.linalg.norm(steps, axis=1).sum())


def footprint(camera: SurveyCamera, panel: Panel, standoff: float = STANDOFF) -> Array:
    """The largest piece of the panel, (2,) m of u and v, that is whole in a square view."""
    check_standoff(panel, standoff)
    half = 0.5 * camera.field_of_view
    inner = panel.radius - standoff
    turn = half - math.asin(inner * math.sin(half) / panel.radius)
    depth = panel.radius * math.cos(turn) - inner
    slope = math.tan(half) * camera.width / camera.height
    return np.array([2.0 * depth * slope, 2.0 * panel.radius * turn])


def survey_raster(
    panels: Sequence[Panel],
    camera: SurveyCamera | None = None,
    *,
    standoff: float = STANDOFF,
    overlap: float = OVERLAP,
    margin: float = MARGIN,
) -> Raster:
    """The fewest views, evenly spaced on each panel, that overlap by at least a share of a picture.

    One side after the other, in rows of constant v, so of constant tilt, that go all along the side
    and back; the second side's rows begin at the edge at which the first side's ended.

    Args:
        overlap: least share of a footprint's length and width that the next picture shows again.
        margin: how far the first and the last pictures go beyond the panel's edges, m.
    """
    camera = camera or SurveyCamera()
    panels = tuple(panels)
    require(len(panels) > 0, "panels to survey", len(panels), ">= 1")
    require(0.0 <= overlap < 0.9, "overlap", f"{overlap:g}", "in [0, 0.9)")
    require(margin >= 0.0, "margin", f"{margin:g} m", ">= 0")
    sizes = {(p.length, p.width, p.radius) for p in panels}
    require(len(sizes) == 1, "sizes of panels", len(sizes), "one: a raster is of equal panels")
    seen = footprint(camera, panels[0], standoff)
    us, vs = (
        _middles(length, part, overlap, margin)
        for length, part in zip((panels[0].length, panels[0].width), seen, strict=True)
    )
    count = len(us) * len(vs) * len(panels)
    allowed = f"<= {MOST_VIEWS}: a wider field of view, less overlap or a larger standoff"
    require(count <= MOST_VIEWS, "views of the survey", count, allowed)
    order: list[tuple[int, float, float]] = []
    forward, outward = True, True
    for side in dict.fromkeys(p.side for p in panels):
        along = sorted((p.start, i) for i, p in enumerate(panels) if p.side == side)
        row = [(i, u) for _, i in along for u in us]
        for v in vs if outward else vs[::-1]:
            order += [(i, u, v) for i, u in (row if forward else row[::-1])]
            forward = not forward
        outward = not outward
    index = np.array([i for i, _, _ in order])
    uv = np.array([[u, v] for _, u, v in order])
    position, tilt = np.empty((len(order), 3)), np.empty(len(order))
    for i, panel in enumerate(panels):
        here = index == i
        platform, tilt[here] = view_pose(camera, panel, uv[here, 0], uv[here, 1], standoff)
        position[here] = platform.position
    steps = [np.diff(m).min() if len(m) > 1 else 0.0 for m in (us, vs)]
    return Raster(panels, index, uv, make_poses(position), tilt, seen, seen - np.array(steps))


def raster_cameras(raster: Raster, camera: SurveyCamera) -> Poses:
    """Poses X_WC of the camera at the raster's views."""
    return camera_poses(camera, raster.platform, raster.tilt)


def coverage(
    panel: Panel,
    poses: Poses,
    camera: SurveyCamera,
    *,
    cell: float = 0.05,
    border: float = 0.0,
    farthest: float = FARTHEST,
) -> tuple[float, Counts]:
    """Share of a panel that pictures show, and how often each of its cells is seen.

    Args:
        poses: of the camera, N.
        cell: largest size of a cell, m; a cell counts as seen if its middle and corners are.
        border: pixels at a picture's rim that do not count.
        farthest: distance from the camera up to which something counts as seen, m.

    Returns:
        The share, and counts (cells along u, cells along v).
    """
    require(cell > 0.0, "coverage cell", f"{cell:g} m", "> 0")
    shape = math.ceil(panel.length / cell), math.ceil(panel.width / cell)
    u, v = (
        np.linspace(0.0, size, 2 * n + 1)
        for size, n in zip((panel.length, panel.width), shape, strict=True)
    )
    uv = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1)
    points, normals = panel_points(panel, uv), panel_normals(panel, uv)
    counts = np.zeros(shape, dtype=np.int64)
    low, high = points.min(axis=0) - farthest, points.max(axis=0) + farthest
    around = np.all((poses.position > low) & (poses.position < high), axis=1)
    for k in np.flatnonzero(around).tolist():
        pixels = world_pixels(camera, poses, k, points)
        back = poses.position[k] - points
        facing = np.einsum("ij,ij->i", back, normals) > 0.0
        near = np.einsum("ij,ij->i", back, back) <= farthest**2
        seen = (camera.in_picture(pixels, border) & facing & near).reshape(uv.shape[:2])
        if seen.any():
            corners = seen[:-1:2, :-1:2] & seen[2::2, :-1:2] & seen[:-1:2, 2::2] & seen[2::2, 2::2]
            counts += corners & seen[1::2, 1::2]
    return float(np.mean(counts > 0)), counts


def _middles(length: float, part: float, overlap: float, margin: float) -> Array:
    """Middles of the fewest parts that cover a length and its margins with this overlap, m."""
    whole = length + 2.0 * margin
    if part >= whole:
        return np.array([0.5 * length])
    gaps = math.ceil((whole - part) / (part * (1.0 - overlap)) - 1e-9)
    return np.linspace(0.5 * part - margin, length + margin - 0.5 * part, gaps + 1)
