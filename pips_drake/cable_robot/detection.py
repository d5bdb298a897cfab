"""Defects in one picture of a panel, with scikit-image.

The background is what is left of a picture without small things: means of blocks, and of those the
medians over a wide window. Defects are what is much darker or lighter than that. Their outline is
drawn again where they have half their own contrast, so blur and the smoothing make them no larger.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pips_drake.config import require
from pips_drake.errors import InputError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: What a background has beside a defect's contrast: median absolute deviation of a normal one.
_NORMAL = 1.4826
_MOST_REGIONS = 400


@dataclass(frozen=True, kw_only=True)
class Detector:
    """How defects are told from the background.

    Attributes:
        contrast: least contrast, as a share of the background, after smoothing over 3 x 3 pixels.
        deviations: least contrast, in standard deviations (robust) of the picture.
        area: fewest pixels of a region.
        extent: fewest pixels of a region's longest extent.
        block: pixels of a block that the background is made of.
        window: blocks (odd) that the medians are taken over.
        gap: pieces with no more pixels between them are one defect.
        border: regions nearer to the picture's rim than this, pixels, are cut by it.
    """

    contrast: float = 0.06
    deviations: float = 6.0
    area: int = 4
    extent: float = 3.0
    block: int = 16
    window: int = 11
    gap: int = 6
    border: int = 3

    def __post_init__(self) -> None:
        for name in ("contrast", "deviations", "area", "block"):
            require(getattr(self, name) > 0, f"detector {name}", getattr(self, name), "> 0")
        good = self.window > 0 and self.window % 2 == 1
        require(good, "detector window", self.window, "odd and > 0")


@dataclass(frozen=True, eq=False)
class Detection:
    """A region of a picture that is no background.

    Attributes:
        centre: of its area, (2,) pixels (across, down).
        outline: corners of its convex hull, (K, 2) pixels, the pixels' outer corners included.
        extent, width: of the hull, longest, and least between parallel lines, pixels.
        area: pixels.
        contrast: mean brightness more than the background's, as a share of it.
        kind: a guess: scratch, ding or debris.
        cut: whether the picture's rim, or what was left out, may hide some of it.
    """

    centre: Array
    outline: Array
    extent: float
    width: float
    area: int
    contrast: float
    kind: str
    cut: bool


def find_defects(
    picture: NDArray[np.uint8], detector: Detector | None = None, mask: Mask | None = None
) -> list[Detection]:
    """Defects in a picture (H, W) or (H, W, 3), brightest contrast first.

    Args:
        mask: (H, W), where to look; None for everywhere.

    Raises:
        InputError: scikit-image is not installed, or the picture is too small.
    """
    measure = _scikit_image_measure()
    detector = detector or Detector()
    height, width = picture.shape[:2]
    least = 2 * detector.block
    good = height >= least and width >= least
    require(good, "picture", f"{width} x {height} pixels", f"{least} x {least} at least")
    relative = relative_brightness(picture, detector, mask)
    smooth = _smoothed(relative)
    sample = smooth[::4, ::4] if mask is None else smooth[::4, ::4][mask[::4, ::4]]
    if not sample.size:
        return []
    spread = _NORMAL * float(np.median(np.abs(sample - np.median(sample))))
    least_contrast = max(detector.contrast, detector.deviations * spread)
    found = np.abs(smooth) > least_contrast
    if mask is not None:
        found &= mask
    labels = measure.label(found, connectivity=2)
    regions = [r for r in measure.regionprops(labels) if r.num_pixels >= max(detector.area // 2, 1)]
    # More is no list of defects but a picture of something else; the largest of it will do.
    regions = sorted(regions, key=lambda r: -r.num_pixels)[:_MOST_REGIONS]
    boxes = np.array([r.bbox for r in regions]).reshape(-1, 4)
    detections = []
    for group in _neighbours(boxes, detector.gap):
        pixels = np.concatenate([regions[i].coords for i in group])
        detection = _measured(pixels, relative, least_contrast, mask, detector)
        if detection is not None:
            detections.append(detection)
    return sorted(detections, key=lambda d: -abs(d.contrast))


def relative_brightness(
    picture: NDArray[np.uint8], detector: Detector, mask: Mask | None = None
) -> NDArray[np.float32]:
    """Brightness more than the background's, as a share of it, (H, W).

    What the mask leaves out is no background: there the background goes on as it is nearest.
    """
    from scipy.ndimage import distance_transform_edt, median_filter

    if picture.ndim == 3:
        grey = picture[..., 0].astype(np.float32)
        grey += picture[..., 1]
        grey += picture[..., 2]
        grey *= 1.0 / 3.0
    else:
        grey = picture.astype(np.float32)
    height, width = grey.shape
    rows, columns = height // detector.block, width // detector.block
    whole = grey[: rows * detector.block, : columns * detector.block]
    blocks = whole.reshape(rows, detector.block, columns, detector.block).mean(axis=(1, 3))
    if mask is not None:
        part = mask[: rows * detector.block, : columns * detector.block]
        out = ~part.reshape(rows, detector.block, columns, detector.block).all(axis=(1, 3))
        if not out.all():
            _, nearest = distance_transform_edt(out, return_indices=True)
            blocks = blocks[nearest[0], nearest[1]]
    coarse = median_filter(blocks, size=detector.window, mode="nearest")
    down = interpolation(height, rows, detector.block)
    across = interpolation(width, columns, detector.block)
    background = down @ (coarse @ across.T)
    np.maximum(background, 1.0, out=background)
    grey -= background
    grey /= background
    return grey


def interpolation(size: int, count: int, block: int) -> NDArray[np.float32]:
    """Weights (size, count) that make pixels of blocks' middles, linear between them."""
    place = np.clip((np.arange(size) + 0.5) / block - 0.5, 0.0, count - 1.0)
    low = np.minimum(place.astype(int), max(count - 2, 0))
    weights = np.zeros((size, count), dtype=np.float32)
    k = np.arange(size)
    weights[k, low] = 1.0 - (place - low)
    if count > 1:
        weights[k, low + 1] = place - low
    return weights


def _smoothed(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Means of 3 x 3 pixels; those at the rim stay as they are."""
    smooth = values.copy()
    rows = values[:-2] + values[1:-1]
    rows += values[2:]
    inner = rows[:, :-2] + rows[:, 1:-1]
    inner += rows[:, 2:]
    inner *= 1.0 / 9.0
    smooth[1:-1, 1:-1] = inner
    return smooth


def _measured(
    pixels: NDArray[np.int64],
    relative: NDArray[np.float32],
    least_contrast: float,
    mask: Mask | None,
    detector: Detector,
) -> Detection | None:
    """A region drawn anew at half its own contrast; None if it is too small or faint."""
    height, width = relative.shape
    here = relative[pixels[:, 0], pixels[:, 1]]
    strength = np.abs(here)
    peak = float(np.quantile(strength, 0.9))
    sharp = strength > max(0.5 * peak, 0.5 * least_contrast)
    kept, value = pixels[sharp], here[sharp]
    if len(kept) < detector.area:
        return None
    outline = _hull(kept)
    extent, across = _extents(outline)
    if extent < detector.extent:
        return None
    weight = np.abs(value)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    cut = bool(
        min(low[0], low[1], height - 1 - high[0], width - 1 - high[1]) < detector.border
    ) or (mask is not None and _touches(pixels, mask))
    centre = (
        (weight @ kept) / weight.sum()
        if np.all(value < 0) or np.all(value > 0)
        else (kept.mean(axis=0))
    )
    return Detection(
        centre=centre[::-1].astype(np.float64),
        outline=outline,
        extent=extent,
        width=across,
        area=len(kept),
        contrast=float(value.mean()),
        kind=_kind(kept, here, pixels, extent, across),
        cut=cut,
    )


def _kind(
    kept: NDArray[np.int64],
    here: NDArray[np.float32],
    pixels: NDArray[np.int64],
    extent: float,
    across: float,
) -> str:
    """Scratches are long for their area; a ding's middle is lighter than its rim."""
    if across < 0.6 * extent and len(kept) < 0.25 * extent * extent:
        return "scratch"
    distance = np.linalg.norm(pixels - pixels.mean(axis=0), axis=1)
    far = float(distance.max())
    inner, outer = here[distance < 0.4 * far], here[distance > 0.6 * far]
    if inner.size and outer.size and float(inner.mean()) > max(0.0, float(outer.mean())):
        return "ding"
    return "debris"


def _touches(pixels: NDArray[np.int64], mask: Mask) -> bool:
    """Whether a region goes up to what was left out."""
    height, width = mask.shape
    for down, across in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        row = np.clip(pixels[:, 0] + down, 0, height - 1)
        column = np.clip(pixels[:, 1] + across, 0, width - 1)
        if not mask[row, column].all():
            return True
    return False


def _hull(pixels: NDArray[np.int64]) -> Array:
    """Corners (K, 2), as (across, down), of the hull of whole pixels."""
    from scipy.spatial import ConvexHull

    # Only the ends of each row can be corners.
    order = np.lexsort((pixels[:, 1], pixels[:, 0]))
    p = pixels[order]
    first = np.append(True, p[1:, 0] != p[:-1, 0])
    ends = p[first | np.append(first[1:], True)]
    corners = (
        ends[:, None] + np.array([[y, x] for y in (-0.5, 0.5) for x in (-0.5, 0.5)])
    ).reshape(-1, 2)
    hull: Array = corners[ConvexHull(corners).vertices][:, ::-1].astype(np.float64)
    return hull


def _extents(outline: Array) -> tuple[float, float]:
    """Longest extent of a convex outline, and the least distance of lines that it is between."""
    longest = max(float(np.linalg.norm(outline - corner, axis=1).max()) for corner in outline)
    edges = np.roll(outline, -1, axis=0) - outline
    normals = np.column_stack([-edges[:, 1], edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
    across = np.abs((outline[None] - outline[:, None]) @ normals[..., None])[..., 0].max(axis=1)
    return longest, float(across.min())


def _neighbours(boxes: NDArray[np.int64], gap: int) -> list[list[int]]:
    """Groups of boxes (top, left, bottom, right) with no more than a gap between them."""
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import connected_components

    if not len(boxes):
        return []
    low, high = boxes[:, :2], boxes[:, 2:]
    near = np.all(low[:, None] - high[None] <= gap, axis=2)
    _, group = connected_components(csr_matrix(near & near.T), directed=False)
    return [np.flatnonzero(group == g).tolist() for g in range(group.max() + 1)]


def require_scikit_image() -> None:
    """Raises `InputError` unless scikit-image is installed."""
    _scikit_image_measure()


def _scikit_image_measure() -> Any:
    try:
        from skimage import measure
    except ImportError:
        raise InputError(
            "finding defects needs scikit-image: pip install 'pips-drake[survey]'"
        ) from None
    return measure


def pixels_for(length: float, distance: float, focal_length: float) -> int:
    """How many whole pixels a length, m, at a distance, m, is at least long."""
    return math.floor(focal_length * length / distance)
