"""Poses as the ports carry them: (7,), quaternion w x y z of R_WP and position, m.

One pose at a time, many times a second: scipy's rotations take several times as long.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pips_drake.cable_robot.kinematics import Poses

Array = NDArray[np.float64]


def pose_vector(position: Array, rotation: Array) -> Array:
    """(7,) of a position (3,) m and an orientation (3, 3); the largest of w x y z is positive."""
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    # Four times the square of each; the largest is divided by.
    squares = (1.0 + a + e + i, 1.0 + a - e - i, 1.0 - a + e - i, 1.0 - a - e + i)
    largest = max(range(4), key=squares.__getitem__)
    square = squares[largest]
    quaternion = (
        (square, h - f, c - g, d - b),
        (h - f, square, b + d, c + g),
        (c - g, b + d, square, f + h),
        (d - b, c + g, f + h, square),
    )[largest]
    share = 0.5 / math.sqrt(square)
    vector = np.empty(7)
    vector[:4] = quaternion
    vector[:4] *= share
    vector[4:] = position
    return vector


def pose_of(vector: Array) -> Poses:
    """One pose of (7,), or of a free body's state (13,)."""
    w, x, y, z = vector[:4].tolist()
    two = 2.0 / (w * w + x * x + y * y + z * z)
    rotation = np.array(
        [
            [1.0 - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)],
            [two * (x * y + w * z), 1.0 - two * (x * x + z * z), two * (y * z - w * x)],
            [two * (x * z - w * y), two * (y * z + w * x), 1.0 - two * (x * x + y * y)],
        ]
    )
    return Poses(vector[None, 4:7].copy(), rotation[None])


def turn(vector: Array) -> Array:
    """The rotation (3, 3) of a rotation vector (3,) rad."""
    x, y, z = vector.tolist()
    half = 0.5 * math.sqrt(x * x + y * y + z * z)
    # sin(half) / (2 half), which tends to a half.
    share = 0.5 * math.sin(half) / half if half > 1e-8 else 0.5
    quaternion = [math.cos(half), share * x, share * y, share * z, 0.0, 0.0, 0.0]
    return pose_of(np.array(quaternion)).rotation[0]


def turn_vector(rotation: Array) -> Array:
    """The rotation vector (3,) rad of a rotation (3, 3), shorter than half a turn."""
    w, x, y, z = pose_vector(np.zeros(3), rotation)[:4].tolist()
    sine = math.sqrt(x * x + y * y + z * z)
    angle = 2.0 * math.atan2(sine, w)
    if angle > math.pi:
        angle -= 2.0 * math.pi
    share = angle / sine if sine > 1e-8 else 2.0
    return np.array([share * x, share * y, share * z])


def advanced(pose: Poses, twist: Array, time: float) -> Poses:
    """The pose a time (s) later, at a constant twist of the world (6,) m/s and rad/s."""
    turned = turn(time * twist[3:]) @ pose.rotation[0]
    return Poses(pose.position + time * twist[:3], turned[None])
