"""Straight ways of the palm: where it is after a share of the time, and how long a way takes.

A pose on a way is six numbers: rotation vector and position, in the frame that the way is straight
in. With s = 10 t^3 - 15 t^4 + 6 t^5 of the way behind after a share t of its time T, the largest
speed is 1.875 L / T and the largest acceleration 5.774 L / T^2.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
Pose = tuple[Array, Array]

#: Largest rate and acceleration of `progress`.
PEAK_RATE, PEAK_ACCELERATION = 1.875, 5.774
#: Largest speeds, m/s, and accelerations, m/s^2, of the palm, free and with a payload: what the
#: flight arm is allowed with its heavier payloads, and what its torques can do with 10 t (assumed).
FREE_SPEED, HELD_SPEED = 0.15, 0.06
FREE_ACCELERATION, HELD_ACCELERATION = 0.02, 0.004
#: The same of turning, rad/s and rad/s^2.
FREE_SPIN, HELD_SPIN = 0.03, 0.006
FREE_SPIN_ACCELERATION, HELD_SPIN_ACCELERATION = 0.006, 0.0004
#: No way is shorter, s.
SHORTEST = 1.0
# A turn of less is none, rad: most ways keep their orientation.
_NO_TURN = 1e-9


def progress(share: float) -> float:
    """How much of a way is behind after a share of its time."""
    return share**3 * (10.0 + share * (-15.0 + 6.0 * share))


def relative(base: Pose, pose: Pose) -> Pose:
    """A pose seen from a base."""
    R = base[0].T
    return R @ pose[0], R @ (pose[1] - base[1])


def pose_numbers(pose: Pose) -> Array:
    """A pose as the six numbers of a way."""
    return np.concatenate([Rotation.from_matrix(pose[0]).as_rotvec(), pose[1]])


def pose_between(start: Array, goal: Array, part: float) -> Pose:
    """The pose when a part of the way from start to goal, (6,) each, is behind."""
    rotation = Rotation.from_rotvec(start[:3])
    if np.max(np.abs(goal[:3] - start[:3])) > _NO_TURN:
        turn = (rotation.inv() * Rotation.from_rotvec(goal[:3])).as_rotvec()
        rotation = rotation * Rotation.from_rotvec(part * turn)
    return rotation.as_matrix(), start[3:] + part * (goal[3:] - start[3:])


def least_duration(start: Array, goal: Array, *, held: bool, speed: float = 0.0) -> float:
    """How long the way from start to goal, (6,) each, takes within speeds and accelerations, s.

    Args:
        held: with a payload.
        speed: the palm's largest, m/s; 0: the usual one.
    """
    first, last = Rotation.from_rotvec(start[:3]), Rotation.from_rotvec(goal[:3])
    length = float(np.linalg.norm(goal[3:] - start[3:]))
    turn = float((first.inv() * last).magnitude())
    if held:
        limits = HELD_SPEED, HELD_ACCELERATION, HELD_SPIN, HELD_SPIN_ACCELERATION
    else:
        limits = FREE_SPEED, FREE_ACCELERATION, FREE_SPIN, FREE_SPIN_ACCELERATION
    usual, acceleration, spin, spin_acceleration = limits
    return max(
        PEAK_RATE * length / (speed or usual),
        math.sqrt(PEAK_ACCELERATION * length / acceleration),
        PEAK_RATE * turn / spin,
        math.sqrt(PEAK_ACCELERATION * turn / spin_acceleration),
        SHORTEST,
    )
