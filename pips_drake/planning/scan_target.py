"""What is scanned and by what: a camera, a part of a cylinder, and the gap around it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.config import require
from pips_drake.errors import InputError
from pips_drake.scene.signed_distance import SignedDistanceField

Array = NDArray[np.float64]

#: Points of a target whose distance to what stands around it is measured, either way.
_PROBES = (8, 36)
#: A target lies on a shape of the scene where that is no farther from its points, m.
ON_SURFACE = 1e-3


@dataclass(frozen=True, kw_only=True)
class ScanCamera:
    """The camera at the tip; the defaults are those of `serpentine.scenario.CameraConfig`.

    Attributes:
        field_of_view: vertical, rad.
        aspect: width over height of its picture.
        near, far: least and largest distance at which something counts as seen, m.
        incidence: largest angle between view and normal that does, rad.
        pan_limit, tilt_limit: either way, rad.
        roll: how it is turned in its mount, rad.

    Raises:
        InputError: a number that means nothing.
    """

    field_of_view: float = math.radians(50.0)
    aspect: float = 4.0 / 3.0
    near: float = 0.1
    far: float = 3.0
    incidence: float = math.radians(75.0)
    pan_limit: float = math.radians(60.0)
    tilt_limit: float = math.radians(80.0)
    roll: float = math.radians(-45.0)

    def __post_init__(self) -> None:
        degrees = math.degrees(self.field_of_view)
        require(
            0.0 < degrees < 180.0, "scan camera's field of view", f"{degrees:g} deg", "0 .. 180"
        )
        require(self.aspect > 0.0, "scan camera's aspect", self.aspect, "> 0")
        good = 0.0 <= self.near < self.far
        require(
            good, "scan camera's range", f"{self.near} .. {self.far} m", "0 or more, near < far"
        )
        degrees = math.degrees(self.incidence)
        require(0.0 < degrees < 90.0, "scan camera's incidence", f"{degrees:g} deg", "0 .. 90")
        for name in ("pan_limit", "tilt_limit"):
            degrees = math.degrees(getattr(self, name))
            require(
                0.0 <= degrees <= 180.0, f"scan camera's {name}", f"{degrees:g} deg", "0 .. 180"
            )

    @property
    def slopes(self) -> tuple[float, float]:
        """Tangents of half the fields of view: across the picture, and down it."""
        down = math.tan(0.5 * self.field_of_view)
        return self.aspect * down, down

    @property
    def narrower(self) -> float:
        """The smaller of both fields of view, rad."""
        return 2.0 * math.atan(min(self.slopes))


@dataclass(frozen=True, kw_only=True, eq=False)
class CylinderTarget:
    """The part of a cylinder's lateral surface that is to be seen.

    Attributes:
        radius: m.
        along: from, to, on the axis, m.
        around: from, to, about the axis from the frame's x axis on, rad; a whole turn at most.
        origin, rotation: pose of its frame in the world, (3,) m and (3, 3); z is the axis.

    Raises:
        InputError: a number that means nothing.
    """

    radius: float
    along: tuple[float, float]
    around: tuple[float, float] = (-math.pi, math.pi)
    origin: ArrayLike = (0.0, 0.0, 0.0)
    rotation: ArrayLike | None = None

    def __post_init__(self) -> None:
        good = math.isfinite(self.radius) and self.radius > 0.0
        require(good, "scanned cylinder's radius", f"{self.radius} m", "> 0")
        for name, (low, high), unit in (
            ("along", self.along, "m"),
            ("around", self.around, "rad"),
        ):
            good = math.isfinite(low) and math.isfinite(high) and low < high
            text = f"{low:g} .. {high:g} {unit}"
            require(good, f"scanned cylinder {name}", text, "finite, from less than to")
        turn = math.degrees(self.around[1] - self.around[0])
        good = turn <= 360.0 * (1.0 + 1e-12)
        require(good, "scanned cylinder around", f"{turn:g} deg", "a whole turn at most")

    @property
    def whole_turn(self) -> bool:
        """Whether it goes all the way around."""
        return self.around[1] - self.around[0] > 2.0 * math.pi * (1.0 - 1e-9)

    @property
    def area(self) -> float:
        """m^2."""
        low, high = self.around
        return float(self.radius * (high - low) * (self.along[1] - self.along[0]))

    def to_world(self, along: ArrayLike, around: ArrayLike, height: ArrayLike = 0.0) -> Array:
        """Points (N, 3) m at places on it, and at heights above it: m, rad, m, (N,) each."""
        z, angle, h = np.broadcast_arrays(*(np.asarray(x, float) for x in (along, around, height)))
        out = self.radius + h
        local = np.stack([out * np.cos(angle), out * np.sin(angle), z], axis=-1)
        return local @ self._rotation.T + np.asarray(self.origin, dtype=np.float64)

    def from_world(self, points: ArrayLike) -> tuple[Array, Array, Array]:
        """Along (m), around (rad, within a turn from its beginning) and height (m) of points."""
        away = np.asarray(points, dtype=np.float64) - np.asarray(self.origin, dtype=np.float64)
        x, y, z = (away @ self._rotation).T
        # A target's own middle is the middle of the turn, so that no part of it is cut off.
        start = 0.5 * (self.around[0] + self.around[1]) - math.pi
        around = start + np.mod(np.arctan2(y, x) - start, 2.0 * math.pi)
        return z, around, np.hypot(x, y) - self.radius

    def normals(self, around: ArrayLike) -> Array:
        """Outward unit vectors (N, 3) in the world at angles (N,) rad."""
        angle = np.asarray(around, dtype=np.float64)
        local = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
        return local @ self._rotation.T

    @property
    def _rotation(self) -> Array:
        return np.eye(3) if self.rotation is None else np.asarray(self.rotation, dtype=np.float64)


def own_shape(target: CylinderTarget, field: SignedDistanceField) -> int:
    """Index of the shape of a scene that a target is the surface of; -1: of none."""
    near = field.nearest(_probes(target))
    on = near.indices[np.abs(near.distances) <= ON_SURFACE]
    if on.size * 2 < len(near.indices):
        return -1
    return int(np.bincount(on).argmax())


def others(target: CylinderTarget, field: SignedDistanceField) -> SignedDistanceField:
    """The scene without the shape that the target is the surface of."""
    own = own_shape(target, field)
    return SignedDistanceField.of(placed for k, placed in enumerate(field.shapes) if k != own)


def gap_width(target: CylinderTarget, field: SignedDistanceField) -> float:
    """From a target to what stands around it, straight out, m: the median; infinite in the open."""
    around = others(target, field)
    points = _probes(target)
    if not around.shapes:
        return math.inf
    _, angles, _ = target.from_world(points)
    normals, walked = target.normals(angles), np.zeros(len(points))
    for _ in range(64):  # a ball of that radius is empty: sphere tracing
        distance = around.distances(points + walked[:, None] * normals)
        walked += np.maximum(distance, 0.0)
        if np.median(walked) > 1e3:
            return math.inf
    return float(np.median(walked))


def check_standoff(
    target: CylinderTarget, field: SignedDistanceField, standoff: float, radius: float
) -> None:
    """Refuses a standoff at which an arm of a radius (m) does not fit beside a target.

    Raises:
        InputError: says what fits.
    """
    gap = gap_width(target, field)
    middle = f"; the gap's middle is {0.5 * gap:.3f} m" if math.isfinite(gap) else ""
    if 2.0 * radius > gap:
        raise InputError(
            f"gap around the scanned surface is {gap:.3f} m wide; an arm of radius {radius:g} m "
            "does not fit"
        )
    upper = f"{gap - radius:.3f} m" if math.isfinite(gap) else "any"
    good = radius <= standoff <= gap - radius
    require(good, "standoff", f"{standoff:g} m", f"{radius:g} m .. {upper}{middle}")


def _probes(target: CylinderTarget) -> Array:
    """Places on a target, (N, 3) m, evenly over it and off its edges."""
    along, around = (
        low + (high - low) * (np.arange(count) + 0.5) / count
        for (low, high), count in zip((target.along, target.around), _PROBES, strict=True)
    )
    return target.to_world(*(x.ravel() for x in np.meshgrid(along, around, indexing="ij")))
