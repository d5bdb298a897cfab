"""The survey's camera: pinhole geometry, where it is on the platform, poses that look square.

Cameras are Drake's: frame {C} has x to the right, y down and z into the picture; pixel (0, 0) is
centred in the upper left corner. The camera is on a tilt head under the platform, which turns
about the platform's x axis; at zero tilt it looks down, with x of {C} along x of the platform.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.cable_robot.kinematics import Poses, make_poses
from pips_drake.cable_robot.panels import Panel, panel_normals, panel_points
from pips_drake.config import require

if TYPE_CHECKING:
    from pydrake.systems.sensors import CameraInfo

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

#: Distance of the camera from the panel along the normal, m.
STANDOFF = 1.0
#: Columns are the axes of {C} in the platform's frame at zero tilt.
_R_PC = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])


@dataclass(frozen=True, kw_only=True)
class SurveyCamera:
    """A pinhole camera on a tilt head.

    Attributes:
        width, height: of the picture, pixels.
        field_of_view: vertical, rad.
        mount: where the tilt axis passes through the camera, in the platform's frame, m.
    """

    width: int = 1280
    height: int = 960
    field_of_view: float = math.radians(30.0)
    mount: tuple[float, float, float] = (0.0, 0.0, -0.28)

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            require(getattr(self, name) >= 8, f"camera {name}", getattr(self, name), ">= 8 pixels")
        angle = math.degrees(self.field_of_view)
        require(0.0 < angle < 120.0, "camera field of view", f"{angle:g} deg", "in (0, 120)")

    @property
    def focal_length(self) -> float:
        """Pixels per unit of slope x / z."""
        return 0.5 * self.height / math.tan(0.5 * self.field_of_view)

    @property
    def centre(self) -> Array:
        """Pixel (2,) that z goes through."""
        return np.array([0.5 * self.width - 0.5, 0.5 * self.height - 0.5])

    def camera_info(self) -> CameraInfo:
        """The intrinsics with which Drake's renderer draws this camera's pictures.

        Drake counts pixels from their centres, as here, but its renderer takes the principal point
        to be counted from the picture's edge: with `CameraInfo(width, height, field_of_view)` what
        it draws is half a pixel further to the left and further up (measured; drake 1.51 and 1.58).
        """
        from pydrake.systems.sensors import CameraInfo

        f = self.focal_length
        return CameraInfo(self.width, self.height, f, f, *(self.centre + 0.5))

    def rays(self, pixels: ArrayLike) -> Array:
        """Directions (N, 3) in {C}, with z = 1, of pixels (N, 2) as (across, down)."""
        slopes = (np.asarray(pixels, dtype=np.float64).reshape(-1, 2) - self.centre) / (
            self.focal_length
        )
        return np.column_stack([slopes, np.ones(len(slopes))])

    def project(self, points: ArrayLike) -> Array:
        """Pixels (N, 2) of points (N, 3) m in {C}; NaN where they are not in front of it."""
        p = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        depth = np.where(p[:, 2] > 0.0, p[:, 2], np.nan)
        return self.centre + self.focal_length * p[:, :2] / depth[:, None]

    def in_picture(self, pixels: ArrayLike, border: float = 0.0) -> NDArray[np.bool_]:
        """Which pixels (N, 2) lie in the picture, at least `border` pixels from its rim."""
        uv = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
        far = np.array([self.width, self.height]) - 0.5 - border
        with np.errstate(invalid="ignore"):
            inside: NDArray[np.bool_] = np.all((uv >= border - 0.5) & (uv <= far), axis=1)
        return inside

    def pixels_across(self, length: float, distance: float) -> float:
        """How many pixels a length, m, seen square from a distance, m, is long."""
        return self.focal_length * length / distance


def camera_poses(camera: SurveyCamera, platform: Poses, tilt: ArrayLike) -> Poses:
    """Poses X_WC of the camera on platforms with these tilts (N,) rad."""
    angle = np.broadcast_to(np.asarray(tilt, dtype=np.float64), (len(platform),))
    c, s = np.cos(angle), np.sin(angle)
    zero, one = np.zeros_like(c), np.ones_like(c)
    turn = np.array([[one, zero, zero], [zero, c, -s], [zero, s, c]]).transpose(2, 0, 1)
    position = platform.position + platform.rotation @ np.asarray(camera.mount)
    return Poses(position, platform.rotation @ turn @ _R_PC)


def view_pose(
    camera: SurveyCamera,
    panel: Panel,
    u: ArrayLike,
    v: ArrayLike,
    standoff: float = STANDOFF,
) -> tuple[Poses, Array]:
    """Poses of a level platform, and tilts (N,) rad, that look square at (u, v) of a panel.

    Args:
        u, v: (N,) m or numbers.
        standoff: distance of the camera from the panel along the normal, m.

    Raises:
        InputError: the camera would be on the arc's axis or beyond it.
    """
    check_standoff(panel, standoff)
    uv = np.column_stack(np.broadcast_arrays(np.atleast_1d(u), np.atleast_1d(v)))
    normal = panel_normals(panel, uv)
    # z of {C} is (0, sin(tilt), -cos(tilt)) on a level platform, and must be the normal's opposite.
    tilt = np.arctan2(-normal[:, 1], normal[:, 2])
    level = make_poses(panel_points(panel, uv, standoff) - np.asarray(camera.mount))
    return level, tilt


def check_standoff(panel: Panel, standoff: float) -> None:
    """Raises `InputError` unless the camera is between the panel and its axis."""
    good = 0.0 < standoff < panel.radius
    require(good, "standoff", f"{standoff:g} m", f"in (0, {panel.radius:g}), the panel's radius")


def world_rays(camera: SurveyCamera, poses: Poses, index: int, pixels: ArrayLike) -> Array:
    """Directions (N, 3) in the world of pixels (N, 2) of the camera at one of its poses."""
    return camera.rays(pixels) @ poses.rotation[index].T


def world_pixels(camera: SurveyCamera, poses: Poses, index: int, points: ArrayLike) -> Array:
    """Pixels (N, 2) of points (N, 3) m in the world, seen from one of the camera's poses."""
    away = np.asarray(points, dtype=np.float64).reshape(-1, 3) - poses.position[index]
    return camera.project(away @ poses.rotation[index])


def noise_tile(camera: SurveyCamera, sigma: float, seed: int) -> NDArray[np.int16]:
    """Normal noise of a sensor, rounded, a quarter wider and higher than the picture."""
    rng = np.random.default_rng(seed)
    size = (camera.height * 5 // 4, camera.width * 5 // 4)
    return np.rint(rng.normal(0.0, sigma, size)).astype(np.int16)


def with_noise(picture: Picture, tile: NDArray[np.int16], seed: int) -> Picture:
    """A picture (H, W, 3) with the noise of a part of the tile that the seed chooses.

    Drawing noise anew for each picture would take longer than finding what is in it.
    """
    rng = np.random.default_rng(seed)
    height, width = picture.shape[:2]
    row = int(rng.integers(0, tile.shape[0] - height + 1))
    column = int(rng.integers(0, tile.shape[1] - width + 1))
    part = tile[row : row + height, column : column + width, None]
    noisy: Picture = np.clip(picture + part, 0, 255).astype(np.uint8)
    return noisy
