"""What a camera sees of a surface: pinhole geometry, pan and tilt, focus, and points that are seen.

Cameras are Drake's: frame {C} has x to the right, y down and z into the picture, and pixel (0, 0)
is centred in the upper left corner. A camera sits in a mount {M} that looks along its x axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.config import require

Array = NDArray[np.float64]

#: Columns are the axes x, y, z of {C} in the mount {M} at zero pan, tilt and roll.
_R_MC = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
#: What lies behind the depth image by less than this, m, and this share of its depth is no farther
#: away: at 75 deg of incidence one pixel of 480 covers 0.9 % of the depth.
_DEPTH_SLACK, _DEPTH_SLACK_SHARE = 0.01, 0.015


@dataclass(frozen=True, kw_only=True)
class PinholeCamera:
    """A pinhole camera, and what of its picture is good enough to count as seen.

    Attributes:
        width, height: of the picture, pixels.
        field_of_view: vertical, rad.
        near, far: least and largest distance at which something counts as seen, m.
        focus: distance of the plane of sharpness from the camera, m; 0 focuses each picture on the
            surface in its middle.
        aperture: diameter of the lens's opening, m; 0 is sharp everywhere.
        blur: largest diameter of a point's blurred image that counts as seen, pixels.
        incidence: largest angle between the view and the surface's normal, rad.
    """

    width: int = 640
    height: int = 480
    field_of_view: float = math.radians(50.0)
    near: float = 0.05
    far: float = 10.0
    focus: float = 0.0
    aperture: float = 0.0
    blur: float = 2.0
    incidence: float = math.radians(75.0)

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            require(getattr(self, name) > 0, f"camera {name}", getattr(self, name), "> 0")
        angle = math.degrees(self.field_of_view)
        require(0.0 < angle < 180.0, "camera field of view", f"{angle:g} deg", "in (0, 180)")
        require(0.0 < self.near < self.far, "camera near", f"{self.near} m", "> 0 and < far")
        for name in ("focus", "aperture"):
            require(getattr(self, name) >= 0.0, f"camera {name}", getattr(self, name), ">= 0")

    @property
    def focal_length(self) -> float:
        """Pixels per unit of slope x / z."""
        return 0.5 * self.height / math.tan(0.5 * self.field_of_view)

    @property
    def centre(self) -> Array:
        """Pixel (2,) that z goes through; between pixels where their number is even."""
        return np.array([0.5 * self.width - 0.5, 0.5 * self.height - 0.5])

    def zoomed(self, zoom: float) -> PinholeCamera:
        """The camera with a focal length `zoom` times as long."""
        require(zoom > 0.0, "zoom", zoom, "> 0")
        angle = 2.0 * math.atan(math.tan(0.5 * self.field_of_view) / zoom)
        return replace(self, field_of_view=angle)

    def project(self, points: ArrayLike) -> tuple[Array, Array]:
        """Pixels (N, 2) as (across, down), and depths z (N,) m, of points (N, 3) m in {C}.

        Pixels of points that are not in front of the camera are NaN.
        """
        p = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        depth = np.where(p[:, 2] > 0.0, p[:, 2], np.nan)
        return self.centre + self.focal_length * p[:, :2] / depth[:, None], p[:, 2].copy()

    def in_picture(self, pixels: ArrayLike) -> NDArray[np.bool_]:
        """Which pixels (N, 2) lie in the picture, its outermost pixels included whole."""
        uv = np.asarray(pixels, dtype=np.float64)
        size = np.array([self.width, self.height])
        with np.errstate(invalid="ignore"):
            inside: NDArray[np.bool_] = np.all((uv >= -0.5) & (uv <= size - 0.5), axis=-1)
        return inside

    def blur_at(self, depth: ArrayLike, focus: float) -> Array:
        """Diameter (N,) px of the image of points at `depth` (N,) m when focused at `focus` m.

        Thin lens, with a focal length that is small beside the distances: a point at z is seen
        through the aperture A as a disc of A |1 / focus - 1 / z| times the focal length in pixels.
        """
        inverse = np.abs(1.0 / focus - 1.0 / np.asarray(depth, dtype=np.float64))
        blur: Array = self.aperture * self.focal_length * inverse
        return blur


def camera_rotation(pan: float, tilt: float, roll: float = 0.0) -> Array:
    """R_MC (3, 3) of a camera panned about the mount's z, then tilted up, towards z, rad.

    `roll` turns the camera about its own view: what was up in the picture goes to the left.
    """
    c, s = math.cos(pan), math.sin(pan)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    c, s = math.cos(tilt), math.sin(tilt)
    lift = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    c, s = math.cos(roll), math.sin(roll)
    about_view = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    return turn @ lift @ about_view @ _R_MC


def pan_and_tilt(direction: ArrayLike) -> tuple[float, float]:
    """Pan and tilt, rad, that point the camera along `direction` (3,) in the mount."""
    x, y, z = np.asarray(direction, dtype=np.float64)
    return math.atan2(y, x), math.atan2(z, math.hypot(x, y))


def seen_distances(
    camera: PinholeCamera,
    p_WC: ArrayLike,
    R_WC: ArrayLike,
    points: ArrayLike,
    normals: ArrayLike,
    *,
    depth_image: ArrayLike | None = None,
) -> Array:
    """From how far each point of a surface is seen, (N,) m; infinite where it is not.

    Seen is what lies in the picture, faces the camera within its incidence, stands in its range, is
    sharp, and has nothing before it.

    Args:
        p_WC, R_WC: position (3,) m and rotation (3, 3) of the camera in the world.
        points, normals: of the surface in the world, (N, 3) m and outward unit vectors.
        depth_image: what the camera sees, (height, width) m along z, infinite where nothing is.
            Without it, only the surface itself can hide a point, by facing away: exact for one
            convex body that nothing stands before.
    """
    position = np.asarray(p_WC, dtype=np.float64)
    view = np.asarray(points, dtype=np.float64) - position
    distance = np.linalg.norm(view, axis=1)
    facing = -np.einsum("ij,ij->i", view, np.asarray(normals, dtype=np.float64))
    good = facing >= distance * math.cos(camera.incidence)
    good &= (distance >= camera.near) & (distance <= camera.far)
    result = np.full(len(distance), np.inf)
    rows = np.flatnonzero(good)
    pixels, depth = camera.project(view[rows] @ np.asarray(R_WC, dtype=np.float64))
    inside = camera.in_picture(pixels)
    rows, pixels, depth = rows[inside], pixels[inside], depth[inside]
    if depth_image is not None and rows.size:
        column, row = np.clip(
            np.rint(pixels).astype(int).T, 0, [[camera.width - 1], [camera.height - 1]]
        )
        before = np.asarray(depth_image, dtype=np.float64)[row, column]
        free = depth <= before * (1.0 + _DEPTH_SLACK_SHARE) + _DEPTH_SLACK
        rows, pixels, depth = rows[free], pixels[free], depth[free]
    if camera.aperture > 0.0 and rows.size:
        middle = np.argmin(np.sum((pixels - camera.centre) ** 2, axis=1))
        focus = camera.focus if camera.focus > 0.0 else float(depth[middle])
        rows = rows[camera.blur_at(depth, focus) <= camera.blur]
    result[rows] = distance[rows]
    return result
