"""Limits that hold at every instant of a motion, not only at its samples.

Between knots every joint moves linearly. A joint's extremes are then at knots. A drive's are those
of its length over the interval of angles that a segment covers (`linkage`): with phi the angle at
the hinge between the pins,

    L^2  = a^2 + b^2 - 2 a b cos(phi)    is extreme at the interval's ends, phi = 0 and phi = pi;
    |L'| = a b |sin(phi)| / L            is extreme at the ends and where L'' = 0, which is where
                                         cos(phi) = min(a, b) / max(a, b) and |L'| = min(a, b).

So what is found is no sample but the extreme itself (or, with a deviation, a bound of it).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.drives import drive_limits

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionExtremes:
    """How near a motion comes to the limits of joints and drives at any instant.

    J joints and drives, A actuators (L3 ..). Times are the beginnings of the segments in which the
    extremes lie, s.

    Attributes:
        joint_margin: distance to the nearer limit, (J,) m and rad; negative beyond it.
        stroke_margin: distance of the actuators' lengths to the nearer end of their stroke, (A,) m.
        speed_fraction: drive speeds over their limits, (J,).
        joint_time, stroke_time, speed_time: when, (J,), (A,), (J,) s.
    """

    joint_margin: Array
    joint_time: Array
    stroke_margin: Array
    stroke_time: Array
    speed_fraction: Array
    speed_time: Array


def motion_extremes(
    arm: SerpentineArm, times: ArrayLike, joints: ArrayLike, *, deviation: ArrayLike = 0.0
) -> MotionExtremes:
    """Extremes over all of a motion that is linear in the joints between knots.

    Args:
        times: of the knots, (N >= 2,) s, increasing.
        joints: at the knots, (N, J) m and rad.
        deviation: how far each joint may be from that motion, (J,) or a number for all, m and rad;
            counts in margins of joints and strokes. Speeds are those of the motion as given.

    Raises:
        InputError: shapes do not fit, or something is not finite.
    """
    t, q = np.asarray(times, dtype=np.float64), np.asarray(joints, dtype=np.float64)
    if t.ndim != 1 or len(t) < 2 or q.shape != (len(t), arm.joints):
        raise InputError(
            f"times of shape {t.shape} and joints of shape {q.shape}; must be (N >= 2,) and "
            f"(N, {arm.joints})"
        )
    off = np.broadcast_to(np.asarray(deviation, dtype=np.float64), arm.joints)
    if not (np.all(np.isfinite(q)) and np.all(np.isfinite(off)) and np.all(np.diff(t) > 0.0)):
        raise InputError("joints and deviation must be finite, and times finite and increasing")
    if np.any(off < 0.0):
        raise InputError(f"deviation = {off.tolist()}; must be >= 0")
    low = np.minimum(q[:-1], q[1:]) - off
    high = np.maximum(q[:-1], q[1:]) + off
    joint_margin = np.minimum(low - arm.joint_lower, arm.joint_upper - high)
    first, linkage = arm.first_actuated_joint, arm.linkage
    shortest, longest = _length_range(arm, low[:, first:], high[:, first:])
    stroke = np.minimum(shortest - linkage.length_lower, linkage.length_upper - longest)
    # Speeds belong to the motion as given, so its own interval counts.
    levers = np.ones_like(low)
    levers[:, first:] = _largest_lever(
        arm, low[:, first:] + off[first:], high[:, first:] - off[first:]
    )
    rates = np.abs(np.diff(q, axis=0)) / np.diff(t)[:, None]
    speed = levers * rates / drive_limits(arm)[2]
    return MotionExtremes(
        joint_margin=joint_margin.min(axis=0),
        joint_time=t[joint_margin.argmin(axis=0)],
        stroke_margin=stroke.min(axis=0),
        stroke_time=t[stroke.argmin(axis=0)],
        speed_fraction=speed.max(axis=0),
        speed_time=t[speed.argmax(axis=0)],
    )


def _holds(low: Array, high: Array, angle: Array | float) -> NDArray[np.bool_]:
    """Whether the interval of angles (rad) holds `angle`, give or take whole turns."""
    turn = 2.0 * np.pi
    held: NDArray[np.bool_] = np.floor((high - angle) / turn) >= np.ceil((low - angle) / turn)
    return held


def _length_range(arm: SerpentineArm, low: Array, high: Array) -> tuple[Array, Array]:
    """Least and largest length (N, A) m over intervals of hinge angles (N, A) rad."""
    linkage = arm.linkage
    a, b = linkage.anchor_inner, linkage.anchor_outer
    ends = linkage.length(low), linkage.length(high)
    phi = low + linkage.pin_angle, high + linkage.pin_angle
    return (
        np.where(_holds(*phi, 0.0), np.abs(a - b), np.minimum(*ends)),
        np.where(_holds(*phi, np.pi), a + b, np.maximum(*ends)),
    )


def _largest_lever(arm: SerpentineArm, low: Array, high: Array) -> Array:
    """Largest |dL/dtheta| (N, A) m/rad over intervals of hinge angles (N, A) rad."""
    linkage = arm.linkage
    a, b = linkage.anchor_inner, linkage.anchor_outer
    shorter = np.minimum(a, b)
    steepest = np.arccos(shorter / np.maximum(a, b))
    phi = low + linkage.pin_angle, high + linkage.pin_angle
    inside = _holds(*phi, steepest) | _holds(*phi, -steepest)
    ends = np.maximum(np.abs(linkage.lever(low)), np.abs(linkage.lever(high)))
    return np.where(inside, shorter, ends)
