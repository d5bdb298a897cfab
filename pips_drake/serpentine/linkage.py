"""Actuators across the hinges: length as a function of the angle, and back (L3 .. L18).

FTL-95 says that the as-built geometry is "not as simple" as drawn and gives none; the model is a
pin-to-pin actuator across each hinge (assumed): with pins at a and b from the hinge and phi0
between them when the hinge is straight,

    L(theta)^2 = a^2 + b^2 - 2 a b cos(phi0 + theta)
    dL/dtheta  = a b sin(phi0 + theta) / L

dL/dtheta is the actuator's lever arm: its speed is that times the joint's, and the joint's torque
is that times its force (a pushing force is positive and lengthens it).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Linkage:
    """Actuators of a chain of hinges; every array is (A,), one entry an actuator.

    Attributes:
        anchor_inner, anchor_outer: a and b, m.
        pin_angle: phi0, rad.
        stiffness: along the actuator, N/m.
        force_limit: push or pull, N.
        speed_limit: m/s.
        length_lower, length_upper: the stroke's ends, m.
    """

    anchor_inner: Array
    anchor_outer: Array
    pin_angle: Array
    stiffness: Array
    force_limit: Array
    speed_limit: Array
    length_lower: Array
    length_upper: Array

    @classmethod
    def make(
        cls,
        *,
        anchor_inner: Array,
        anchor_outer: Array,
        pin_angle: Array,
        stiffness: Array,
        force_limit: Array,
        speed_limit: Array,
        angle_lower: Array,
        angle_upper: Array,
        overtravel: float,
    ) -> Linkage:
        """A linkage whose strokes reach the angles' limits (rad) and `overtravel` (m) beyond."""

        def length(angle: Array) -> Array:
            return _length(anchor_inner, anchor_outer, pin_angle + angle)

        return cls(
            anchor_inner=anchor_inner,
            anchor_outer=anchor_outer,
            pin_angle=pin_angle,
            stiffness=stiffness,
            force_limit=force_limit,
            speed_limit=speed_limit,
            length_lower=length(angle_lower) - overtravel,
            length_upper=length(angle_upper) + overtravel,
        )

    def length(self, angle: ArrayLike) -> Array:
        """Lengths (..., A) m at hinge angles (..., A) rad."""
        return _length(self.anchor_inner, self.anchor_outer, self.pin_angle + np.asarray(angle))

    def angle(self, length: ArrayLike) -> Array:
        """Hinge angles (..., A) rad at lengths (..., A) m; NaN where no triangle closes."""
        a, b = self.anchor_inner, self.anchor_outer
        cosine = (a * a + b * b - np.square(length)) / (2.0 * a * b)
        return np.where(
            np.abs(cosine) <= 1.0, np.arccos(np.clip(cosine, -1.0, 1.0)) - self.pin_angle, np.nan
        )

    def lever(self, angle: ArrayLike) -> Array:
        """dL/dtheta (..., A) m/rad at hinge angles (..., A) rad."""
        a, b, phi = self.anchor_inner, self.anchor_outer, self.pin_angle + np.asarray(angle)
        return a * b * np.sin(phi) / _length(a, b, phi)

    def joint_stiffness(self, angle: ArrayLike) -> Array:
        """Stiffness k (dL/dtheta)^2 of the hinges (..., A) Nm/rad at angles (..., A) rad."""
        return self.stiffness * self.lever(angle) ** 2


def _length(a: Array, b: Array, phi: Array) -> Array:
    # a^2 + b^2 - 2 a b cos(phi) as a sum of squares: no cancellation when the pins nearly meet.
    length: Array = np.sqrt((a - b) ** 2 + 4.0 * a * b * np.sin(0.5 * phi) ** 2)
    return length
