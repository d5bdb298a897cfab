"""Way points for a platform, and when it is where: straight lines, each from rest to rest.

Between two way points position, orientation and the camera's tilt all go the same share s of their
ways, by a trapezoid of speed: s rises with a constant acceleration to a constant rate and back,
both as large as the limits of all three allow. Orientations turn about one fixed axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from pips_drake.cable_robot.kinematics import Poses
from pips_drake.config import require
from pips_drake.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class MotionLimits:
    """How fast a platform goes. Assumed: a picture every few seconds, and no swinging.

    Attributes:
        speed, acceleration: m/s and m/s2.
        turn_speed, turn_acceleration: of platform and tilt, rad/s and rad/s2.
        dwell: rest at each way point, s.
    """

    speed: float = 0.25
    acceleration: float = 0.25
    turn_speed: float = 0.3
    turn_acceleration: float = 0.5
    dwell: float = 0.5

    def __post_init__(self) -> None:
        for name in ("speed", "acceleration", "turn_speed", "turn_acceleration"):
            value = getattr(self, name)
            require(math.isfinite(value) and value > 0.0, f"motion: {name}", f"{value:g}", "> 0")
        good = math.isfinite(self.dwell) and self.dwell >= 0.0
        require(good, "motion: dwell", f"{self.dwell:g} s", ">= 0")


@dataclass(frozen=True, eq=False)
class MotionState:
    """Where a platform is to be at a time.

    Attributes:
        position, rotation: (3,) m and (3, 3), in the world.
        twist: velocity m/s and angular velocity rad/s in the world's axes, (6,).
        tilt: of the camera, rad.
        way_point: the last one reached, from 0.
        standing: whether it rests there.
    """

    position: Array
    rotation: Array
    twist: Array
    tilt: float
    way_point: int
    standing: bool


class PlatformMotion:
    """A motion through way points, from rest to rest at each.

    Args:
        poses: of the platform, K.
        tilts: of the camera, (K,) rad; None: 0.
        limits: of the motion.

    Attributes:
        arrivals: when each way point is reached, (K,) s; the first at 0.
        duration: when the last one's rest is over, s.

    Raises:
        InputError: no way point, other shapes, or numbers that are not finite.
    """

    def __init__(
        self, poses: Poses, tilts: ArrayLike | None = None, limits: MotionLimits | None = None
    ) -> None:
        limits = limits or MotionLimits()
        count = len(poses)
        tilt = np.zeros(count) if tilts is None else np.asarray(tilts, dtype=np.float64)
        good = count > 0 and tilt.shape == (count,)
        require(good, "motion: way points and tilts", (count, tilt.shape), "K >= 1 and (K,)")
        finite = all(np.all(np.isfinite(part)) for part in (poses.position, poses.rotation, tilt))
        if not finite:
            raise InputError("motion: way points must be finite numbers")
        self.poses, self.tilts, self.limits = poses, tilt, limits
        self._ways = np.diff(poses.position, axis=0)
        turned = poses.rotation[1:] @ np.swapaxes(poses.rotation[:-1], 1, 2)
        # In the world's axes.
        self._turns = Rotation.from_matrix(turned).as_rotvec() if count > 1 else np.zeros((0, 3))
        self._tilts = np.diff(tilt)
        angle = np.maximum(np.linalg.norm(self._turns, axis=1), np.abs(self._tilts))
        distance = np.linalg.norm(self._ways, axis=1)
        with np.errstate(divide="ignore"):
            rate = np.minimum(limits.speed / distance, limits.turn_speed / angle)
            ramp = np.minimum(limits.acceleration / distance, limits.turn_acceleration / angle)
        # Two equal way points: no way, no time.
        moving = np.isfinite(rate)
        self._ramp = np.where(moving, ramp, 1.0)
        self._rate = np.minimum(np.where(moving, rate, 1.0), np.sqrt(self._ramp))
        self._times = np.where(moving, 1.0 / self._rate + self._rate / self._ramp, 0.0)
        legs = self._times + limits.dwell
        self.arrivals = np.concatenate([[0.0], np.cumsum(legs)])
        self.duration = float(self.arrivals[-1] + limits.dwell)

    def at(self, time: float) -> MotionState:
        """Where the platform is to be at a time, s; before the beginning and after the end: there.

        It rests for `dwell` at a way point, and then leaves.
        """
        last = len(self.tilts) - 1
        k = int(np.searchsorted(self.arrivals, time, side="right")) - 1
        k = min(max(k, 0), last)
        past = time - self.arrivals[k] - self.limits.dwell
        position, rotation = self.poses.position[k], self.poses.rotation[k]
        if past <= 0.0 or k == last:
            return MotionState(position, rotation, np.zeros(6), float(self.tilts[k]), k, True)
        share, speed = self._share(k, past)
        turned = Rotation.from_rotvec(share * self._turns[k]).as_matrix()
        return MotionState(
            position + share * self._ways[k],
            turned @ rotation,
            speed * np.concatenate([self._ways[k], self._turns[k]]),
            float(self.tilts[k] + share * self._tilts[k]),
            k,
            False,
        )

    def _share(self, leg: int, past: float) -> tuple[float, float]:
        """s and ds/dt of a leg, `past` s after its beginning."""
        ramp, rate, whole = self._ramp[leg], self._rate[leg], self._times[leg]
        rising = rate / ramp
        past = min(past, whole)
        if past < rising:
            return float(0.5 * ramp * past**2), float(ramp * past)
        left = whole - past
        if left < rising:
            return float(1.0 - 0.5 * ramp * left**2), float(ramp * left)
        return float(0.5 * rate * rising + rate * (past - rising)), float(rate)
