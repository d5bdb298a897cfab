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
from functools import cached_property

import numpy as np
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


# Each serves arrays here, and compiled loops (`drives`) one actuator at a time.
@register_jitable
def actuator_length(a, b, phi):
    """L (m) at phi = phi0 + theta (rad), pins a and b (m) from the hinge."""
    # a^2 + b^2 - 2 a b cos(phi) as a sum of squares: no cancellation when the pins nearly meet.
    return np.sqrt((a - b) ** 2 + 4.0 * a * b * np.sin(0.5 * phi) ** 2)


@register_jitable
def actuator_lever(a, b, phi):
    """dL/dtheta (m/rad) at phi = phi0 + theta (rad)."""
    return a * b * np.sin(phi) / actuator_length(a, b, phi)


@register_jitable
def actuator_angle(a, b, length):
    """phi = phi0 + theta (rad) at a length (m); NaN where no triangle closes."""
    return np.arccos((a * a + b * b - length * length) / (2.0 * a * b))


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
            found: Array = actuator_length(anchor_inner, anchor_outer, pin_angle + angle)
            return found

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

    @cached_property
    def triangles(self) -> Array:
        """a, b (m) and phi0 (rad) of each actuator, (A, 3)."""
        return np.column_stack([self.anchor_inner, self.anchor_outer, self.pin_angle])

    def length(self, angle: ArrayLike) -> Array:
        """Lengths (..., A) m at hinge angles (..., A) rad."""
        phi = self.pin_angle + np.asarray(angle)
        length: Array = actuator_length(self.anchor_inner, self.anchor_outer, phi)
        return length

    def angle(self, length: ArrayLike) -> Array:
        """Hinge angles (..., A) rad at lengths (..., A) m; NaN where no triangle closes."""
        with np.errstate(invalid="ignore"):
            phi = actuator_angle(self.anchor_inner, self.anchor_outer, np.asarray(length))
        angle: Array = phi - self.pin_angle
        return angle

    def lever(self, angle: ArrayLike) -> Array:
        """dL/dtheta (..., A) m/rad at hinge angles (..., A) rad."""
        phi = self.pin_angle + np.asarray(angle)
        lever: Array = actuator_lever(self.anchor_inner, self.anchor_outer, phi)
        return lever

    def joint_stiffness(self, angle: ArrayLike) -> Array:
        """Stiffness k (dL/dtheta)^2 of the hinges (..., A) Nm/rad at angles (..., A) rad."""
        return self.stiffness * self.lever(angle) ** 2
