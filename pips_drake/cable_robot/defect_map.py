"""The electronic map: what pictures show, put on the panels, measured, and compared with the truth.

A detection's pixels are rays from where the camera is thought to be; where they meet the panel is
where the defect is thought to be. If the camera's place is wrong by no more than e and its
orientation by no more than w, a point seen from the distance d is misplaced by no more than about
e + w d, and one pixel's worth more by the detection: `predicted_error`. Sightings of one defect in
several pictures are nearer to each other than twice that, and are one finding.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.cable_robot.defects import Defect
from pips_drake.cable_robot.detection import Detection, Mask, interpolation
from pips_drake.cable_robot.kinematics import Poses
from pips_drake.cable_robot.panels import Panel, edge_distances, intersect_rays
from pips_drake.cable_robot.survey_camera import SurveyCamera, world_rays
from pips_drake.config import require

Array = NDArray[np.float64]

#: What is nearer to a panel's edge than this is not looked for, m: the edge itself would be found.
EDGE_MARGIN = 0.01
#: What is smaller than this need not be found, m.
LEAST_SIZE = 0.005
#: Bounds of the classes of size that recall is stated for, m.
SIZE_CLASSES = (0.0, 0.003, 0.005, 0.01, 0.02, math.inf)
#: Panels whose ends are farther than this from the camera are not asked whether they are seen, m.
_FAR = 3.0
_BLOCK = 20


@dataclass(frozen=True, kw_only=True, eq=False)
class Sighting:
    """A detection, put on a panel.

    Attributes:
        panel: its name.
        uv: where, (2,) m.
        size_m, width_m: longest extent along the surface, and least across, m.
        contrast, kind, cut: as of a `Detection`.
        image: index of the picture.
        pixel: of its centre, (2,).
        distance: from the camera, m.
    """

    panel: str
    uv: Array
    size_m: float
    width_m: float
    contrast: float
    kind: str
    cut: bool
    image: int
    pixel: Array
    distance: float


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A defect of the map.

    Attributes:
        name: for example ``"port_2-003"``; numbers rise along u.
        panel: the panel's name.
        u, v: where, m.
        size_m, width_m: longest extent and extent across, m; if `cut`, at least.
        contrast: mean brightness more than the panel's, as a share of it.
        kind: what most pictures show it as.
        cut: whether no picture shows it whole.
        images: indices of the pictures that show it.
        image: the one that shows it nearest to its middle.
        pixel: where in that one, (across, down).
        spread: how far the pictures' places are from (u, v), at most, m.
    """

    name: str
    panel: str
    u: float
    v: float
    size_m: float
    width_m: float
    contrast: float
    kind: str
    cut: bool
    images: tuple[int, ...]
    image: int
    pixel: tuple[float, float]
    spread: float


@dataclass(frozen=True, eq=False)
class SizeClass:
    """Recall and false alarms of one class of size.

    Attributes:
        low, high: bounds of the class, m; defects are sorted by their true size, false alarms by
            their measured one.
        defects, found, false_alarms: how many.
    """

    low: float
    high: float
    defects: int
    found: int
    false_alarms: int


@dataclass(frozen=True, eq=False)
class MapCheck:
    """A map beside the truth.

    Attributes:
        pairs: findings and the defects that they are.
        missed: defects that are not in the map.
        false_alarms: findings that are no defects.
        offsets: where findings are, less where their defects are, (pairs, 2) m.
        tolerance: beyond which a finding is not taken for a defect, m.
        classes: by size.
    """

    pairs: list[tuple[Finding, Defect]]
    missed: list[Defect]
    false_alarms: list[Finding]
    offsets: Array
    tolerance: float
    classes: list[SizeClass]

    @property
    def errors(self) -> Array:
        """Distances of findings from their defects, (pairs,) m."""
        return np.hypot(*self.offsets.T)

    @property
    def size_errors(self) -> Array:
        """Measured less true sizes, (pairs,) m."""
        return np.array([f.size_m - d.size_m for f, d in self.pairs])

    def missed_from(self, size: float = LEAST_SIZE) -> list[Defect]:
        """Missed defects that are at least this large, m."""
        return [d for d in self.missed if d.size_m >= size]

    def recall(self, size: float = LEAST_SIZE) -> float:
        """Share of the defects of at least this size, m, that are in the map; 1 if none are."""
        found = sum(d.size_m >= size for _, d in self.pairs)
        total = found + len(self.missed_from(size))
        return found / total if total else 1.0


def predicted_error(
    camera: SurveyCamera,
    distance: float,
    *,
    position_error: float,
    rotation_error: float,
    pixels: float = 1.0,
) -> float:
    """How far a point of the map is misplaced at most, m, up to terms of second order.

    Args:
        distance: of the panel from the camera, m.
        position_error, rotation_error: bounds of what the camera's pose is wrong by, m and rad.
        pixels: by which a detection's centre is off.
    """
    half = math.tan(0.5 * camera.field_of_view)
    slope = half * math.hypot(1.0, camera.width / camera.height)
    # A point in the picture's corner is farther away and moves askew along the surface.
    lever = distance * (1.0 + slope * slope)
    askew = math.sqrt(1.0 + slope * slope)
    return position_error * askew + rotation_error * lever + pixels * lever / camera.focal_length


def panel_mask(
    camera: SurveyCamera,
    poses: Poses,
    index: int,
    panels: Sequence[Panel],
    margin: float = EDGE_MARGIN,
) -> Mask | None:
    """Where a picture shows panels, `margin` m inside their edges, (H, W); None: everywhere."""
    rows, columns = (math.ceil(n / _BLOCK) for n in (camera.height, camera.width))
    down, across = ((np.arange(n) + 0.5) * _BLOCK - 0.5 for n in (rows, columns))
    pixels = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    rays = world_rays(camera, poses, index, pixels)
    inside = np.full(len(pixels), -1.0)
    near = _near(panels, poses.position[index])
    for panel in near:
        # Beyond the edges too: their place between two rays is found from both.
        uv, distance = intersect_rays(panel, poses.position[index], rays, margin=0.2)
        met = np.isfinite(distance)
        inside[met] = np.maximum(inside[met], edge_distances(panel, uv[met]))
    inside -= margin
    # Between rays the distance from the edge changes by less than a block is wide.
    if inside.min() > 2.0 * _BLOCK * _scale(camera, poses, index, near):
        return None
    fine = interpolation(camera.height, rows, _BLOCK) @ (
        inside.reshape(rows, columns).astype(np.float32)
        @ interpolation(camera.width, columns, _BLOCK).T
    )
    mask: Mask = fine > 0.0
    return mask


def locate(
    detections: Sequence[Detection],
    camera: SurveyCamera,
    poses: Poses,
    index: int,
    panels: Sequence[Panel],
) -> list[Sighting]:
    """Puts a picture's detections on the panels that their rays meet; others are left out.

    Args:
        poses: of the camera, as estimated.
        index: of the picture and its pose.
    """
    sightings = []
    origin = poses.position[index]
    panels = _near(panels, origin)
    for detection in detections:
        outline = np.concatenate([detection.centre[None], detection.outline])
        rays = world_rays(camera, poses, index, outline)
        hits = [(intersect_rays(p, origin, rays[:1])[1][0], p) for p in panels]
        on = [(float(distance), p) for distance, p in hits if np.isfinite(distance)]
        if not on:
            continue
        distance, panel = min(on, key=lambda hit: hit[0])
        uv, _ = intersect_rays(panel, origin, rays, margin=0.5)
        corners = uv[1:][np.isfinite(uv[1:, 0])]
        size, width = _size(corners)
        sightings.append(
            Sighting(
                panel=panel.name,
                uv=uv[0],
                size_m=size,
                width_m=width,
                contrast=detection.contrast,
                kind=detection.kind,
                cut=detection.cut,
                image=index,
                pixel=detection.centre,
                distance=distance,
            )
        )
    return sightings


def merge(sightings: Sequence[Sighting], camera: SurveyCamera, *, radius: float) -> list[Finding]:
    """Sightings of the same defects as one finding each, sorted by panel and along u.

    What a picture's rim cuts belongs to a whole sighting that it may be a part of.

    Args:
        radius: how far apart sightings of one defect may be, m: twice the predicted error.
    """
    require(radius > 0.0, "radius to merge sightings in", f"{radius:g} m", "> 0")
    findings = []
    for panel in dict.fromkeys(s.panel for s in sightings):
        here = [s for s in sightings if s.panel == panel]
        whole = [s for s in here if not s.cut]
        groups = _clusters(whole, radius)
        loose = []
        for part in (s for s in here if s.cut):
            reach = [
                min(_apart(part, s) - 0.5 * (s.size_m + part.size_m) for s in group)
                for group in groups
            ]
            if reach and min(reach) <= radius:
                groups[int(np.argmin(reach))].append(part)
            else:
                loose.append(part)
        groups += _clusters(loose, radius)
        made = sorted((_finding(group, camera) for group in groups), key=lambda f: (f.u, f.v))
        findings += [replace(f, name=f"{panel}-{k:03d}") for k, f in enumerate(made, 1)]
    return sorted(findings, key=lambda f: f.name)


def match(first: ArrayLike, second: ArrayLike, radius: float) -> list[tuple[int, int]]:
    """Pairs of points (N, 2) and (M, 2) no farther apart than a radius, m, with the least sum.

    As many pairs as there can be; no point is in two.
    """
    from scipy.optimize import linear_sum_assignment

    a, b = (np.asarray(p, dtype=np.float64).reshape(-1, 2) for p in (first, second))
    apart = np.linalg.norm(a[:, None] - b[None], axis=2)
    # A pair that may not be costs more than all pairs that may.
    never = (1.0 + min(len(a), len(b))) * radius
    rows, columns = linear_sum_assignment(np.where(apart <= radius, apart, never))
    good = apart[rows, columns] <= radius
    return list(zip(rows[good].tolist(), columns[good].tolist(), strict=True))


def compare_with_truth(
    findings: Sequence[Finding],
    defects: Sequence[Defect],
    tolerance: float,
    bounds: Sequence[float] = SIZE_CLASSES,
) -> MapCheck:
    """A map beside the defects that there are.

    Args:
        tolerance: how far a finding may be from its defect, m: the predicted error.
        bounds: of the classes of size, rising, m.
    """
    require(tolerance > 0.0, "tolerance of places", f"{tolerance:g} m", "> 0")
    pairs: list[tuple[Finding, Defect]] = []
    for panel in dict.fromkeys(f.panel for f in findings):
        ours = [f for f in findings if f.panel == panel]
        true = [d for d in defects if d.panel == panel]
        places = [(f.u, f.v) for f in ours], [(d.u, d.v) for d in true]
        pairs += [(ours[i], true[k]) for i, k in match(*places, tolerance)]
    known = {f.name for f, _ in pairs}
    # Defects may be equal to each other; each is one.
    seen = {id(d) for _, d in pairs}
    missed = [d for d in defects if id(d) not in seen]
    false_alarms = [f for f in findings if f.name not in known]
    classes = []
    for low, high in itertools.pairwise(bounds):
        found = sum(low <= d.size_m < high for _, d in pairs)
        lost = sum(low <= d.size_m < high for d in missed)
        false = sum(low <= f.size_m < high for f in false_alarms)
        classes.append(SizeClass(low, high, found + lost, found, false))
    offsets = np.array([[f.u - d.u, f.v - d.v] for f, d in pairs]).reshape(-1, 2)
    return MapCheck(pairs, missed, false_alarms, offsets, tolerance, classes)


def _near(panels: Sequence[Panel], point: Array) -> list[Panel]:
    """Panels that a camera at a point (3,) m may see from near enough."""
    return [
        p
        for p in panels
        if p.start - _FAR <= point[0] <= p.start + p.length + _FAR
        and math.hypot(point[1] - p.axis[0], point[2] - p.axis[1]) <= p.radius
    ]


def _scale(camera: SurveyCamera, poses: Poses, index: int, panels: Sequence[Panel]) -> float:
    """Metres that a pixel in the middle of the picture is wide on the panel; 0 if it shows none."""
    ray = world_rays(camera, poses, index, camera.centre)
    hits = [intersect_rays(p, poses.position[index], ray)[1][0] for p in panels]
    on = [hit for hit in hits if np.isfinite(hit)]
    return min(on) / camera.focal_length if on else 0.0


def _size(corners: Array) -> tuple[float, float]:
    """Longest extent, and least between parallel lines along an edge, of a hull (K, 2) m."""
    if len(corners) < 3:
        return 0.0, 0.0
    longest = float(np.linalg.norm(corners[:, None] - corners[None], axis=2).max())
    edges = np.roll(corners, -1, axis=0) - corners
    length = np.maximum(np.linalg.norm(edges, axis=1), 1e-12)
    normals = np.column_stack([-edges[:, 1], edges[:, 0]]) / length[:, None]
    across = np.abs(np.einsum("ijk,ik->ij", corners[None] - corners[:, None], normals))
    return longest, float(across.max(axis=1).min())


def _apart(first: Sighting, second: Sighting) -> float:
    return float(np.linalg.norm(first.uv - second.uv))


def _clusters(sightings: Sequence[Sighting], radius: float) -> list[list[Sighting]]:
    from scipy.cluster.hierarchy import fclusterdata

    if len(sightings) < 2:
        return [list(sightings)] if sightings else []
    # Complete linkage: no two of a cluster are farther apart than the radius.
    places = np.array([s.uv for s in sightings])
    labels = fclusterdata(places, radius, criterion="distance", method="complete")
    return [
        [s for s, label in zip(sightings, labels, strict=True) if label == k]
        for k in np.unique(labels)
    ]


def _finding(group: Sequence[Sighting], camera: SurveyCamera) -> Finding:
    whole = [s for s in group if not s.cut] or list(group)
    places = np.array([s.uv for s in whole])
    uv = places.mean(axis=0)
    best = min(whole, key=lambda s: float(np.linalg.norm(s.pixel - camera.centre)))
    return Finding(
        name="",
        panel=best.panel,
        u=float(uv[0]),
        v=float(uv[1]),
        size_m=float(np.median([s.size_m for s in whole])),
        width_m=float(np.median([s.width_m for s in whole])),
        contrast=float(np.mean([s.contrast for s in whole])),
        kind=Counter(s.kind for s in whole).most_common(1)[0][0],
        cut=best.cut,
        images=tuple(sorted({s.image for s in group})),
        image=best.image,
        pixel=(float(best.pixel[0]), float(best.pixel[1])),
        spread=float(np.linalg.norm(places - uv, axis=1).max()),
    )
