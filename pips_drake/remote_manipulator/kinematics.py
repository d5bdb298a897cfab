"""The arm's kinematics: six angles and a telescoping stand (RMS-71, appendix).

R_R2 = R_z(H0) R_y(P0) R_y(P1) R_z(H2) R_y(P2) R_x(R2), standard right-handed rotations. The
report's appendix prints the heading matrix as another rotation about y (rows (cos, 0, -sin),
(0, 1, 0), (sin, 0, cos)), with which the arm could only move in one plane and its Jacobian has rank
4; that is R_z with the axes y and z exchanged. Its pitch and roll matrices are right. As z points
down, a positive pitch raises the arm's end: the flight arm's limits (-2 .. 145 deg at the shoulder,
-161 .. 2.4 deg at the elbow) mean the same.

The wrist's three axes meet in a point and two of the other three are parallel, so the inverse is in
closed form: wrist point, a triangle in the arm's plane, then heading, pitch and roll.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.remote_manipulator import kinematics_kernels as kernels
from pips_drake.remote_manipulator.configuration import JOINTS, ArmConfig

Array = NDArray[np.float64]

#: Shoulder turned backwards, elbow below the line from shoulder to wrist, wrist flipped over.
Branch = tuple[bool, bool, bool]
_SIDES = (False, True)
#: Angles that are as near as this, rad, are taken without looking at the other branches.
_SURELY_NEAREST = 0.05
#: All ways in which the arm can hold its palm somewhere; the first is the usual one.
BRANCHES: tuple[Branch, ...] = tuple(itertools.product(_SIDES, _SIDES, _SIDES))


def heading_matrix(angle: ArrayLike) -> Array:
    """R_z, (..., 3, 3), of headings (...) rad."""
    return _rotation(angle, 2)


def pitch_matrix(angle: ArrayLike) -> Array:
    """R_y, (..., 3, 3), of pitches (...) rad."""
    return _rotation(angle, 1)


def roll_matrix(angle: ArrayLike) -> Array:
    """R_x, (..., 3, 3), of rolls (...) rad."""
    return _rotation(angle, 0)


def _rotation(angle: ArrayLike, axis: int) -> Array:
    angle = np.asarray(angle, dtype=np.float64)
    one, two = (axis + 1) % 3, (axis + 2) % 3
    result = np.zeros((*angle.shape, 3, 3))
    result[..., axis, axis] = 1.0
    result[..., one, one] = result[..., two, two] = np.cos(angle)
    result[..., two, one] = np.sin(angle)
    result[..., one, two] = -result[..., two, one]
    return result


@dataclass(frozen=True, kw_only=True, eq=False)
class ArmPose:
    """Where the arm is: points (..., 3) m and rotations (..., 3, 3) in {R}.

    Attributes:
        shoulder, elbow, wrist: origins of {0}, {1} and {2}.
        palm: the end of arm 2, the middle of the palm's top.
        R_R0, R_R1, R_R2: their columns are the unit vectors of {0}, {1} and {2}.
    """

    shoulder: Array
    elbow: Array
    wrist: Array
    palm: Array
    R_R0: Array
    R_R1: Array
    R_R2: Array


def forward_kinematics(arm: ArmConfig, angles: ArrayLike, stand_height: ArrayLike) -> ArmPose:
    """Where the arm is at angles (..., 6) rad and shoulder heights (...) m."""
    q = _angles(angles)
    leading = q.shape[:-1]
    height = np.broadcast_to(np.asarray(stand_height, dtype=np.float64), leading)
    points, R = kernels.forward(
        np.ascontiguousarray(q).reshape(-1, len(JOINTS)),
        np.ascontiguousarray(height).reshape(-1),
        arm.arm_0_m,
        arm.arm_1_m,
        arm.arm_2_m,
    )
    points, R = points.reshape(*leading, 4, 3), R.reshape(*leading, 3, 3, 3)
    return ArmPose(
        shoulder=points[..., 0, :],
        elbow=points[..., 1, :],
        wrist=points[..., 2, :],
        palm=points[..., 3, :],
        R_R0=R[..., 0, :, :],
        R_R1=R[..., 1, :, :],
        R_R2=R[..., 2, :, :],
    )


def joint_axes(angles: ArrayLike) -> Array:
    """The joints' axes in {R}, (..., 6, 3), in the order H0 P0 P1 H2 P2 R2."""
    q = _angles(angles)
    turned = heading_matrix(q[..., 0])
    R_R1 = turned @ pitch_matrix(q[..., 1] + q[..., 2])
    wrist = R_R1 @ heading_matrix(q[..., 3])
    effector = wrist @ pitch_matrix(q[..., 4])
    up = np.broadcast_to([0.0, 0.0, 1.0], turned.shape[:-1])
    across = turned[..., 1]
    return np.stack([up, across, across, R_R1[..., 2], wrist[..., 1], effector[..., 0]], axis=-2)


def jacobian(arm: ArmConfig, angles: ArrayLike) -> Array:
    """Spatial velocity of the palm by the angles' rates, (..., 6, 6), in {R}.

    Rows 0 to 2: angular velocity, rad/s; 3 to 5: velocity of the palm, m/s.
    """
    pose = forward_kinematics(arm, angles, 0.0)
    axes = joint_axes(angles)
    origins = np.stack([pose.shoulder] * 2 + [pose.elbow] + [pose.wrist] * 3, axis=-2)
    linear = np.cross(axes, pose.palm[..., None, :] - origins)
    return np.concatenate([np.swapaxes(axes, -1, -2), np.swapaxes(linear, -1, -2)], axis=-2)


def inverse_kinematics(
    arm: ArmConfig,
    palm: ArrayLike,
    R_R2: ArrayLike,
    stand_height: ArrayLike,
    *,
    branch: Branch = BRANCHES[0],
) -> Array:
    """Angles (..., 6) rad within +-pi that hold the palm so; NaN where it is out of reach.

    Args:
        palm: the end of arm 2, (..., 3) m in {R}.
        R_R2: (..., 3, 3), the effector's unit vectors as columns.
        stand_height: (...) m.
        branch: one of `BRANCHES`. Limits are not looked at.
    """
    points = np.asarray(palm, dtype=np.float64)
    leading = points.shape[:-1]
    rotations = np.broadcast_to(np.asarray(R_R2, dtype=np.float64), (*leading, 3, 3))
    height = np.broadcast_to(np.asarray(stand_height, dtype=np.float64), leading)
    angles = kernels.inverse(
        np.ascontiguousarray(points).reshape(-1, 3),
        np.ascontiguousarray(rotations).reshape(-1, 3, 3),
        np.ascontiguousarray(height).reshape(-1),
        arm.arm_0_m,
        arm.arm_1_m,
        arm.arm_2_m,
        *branch,
    )
    result: Array = angles.reshape(*leading, len(JOINTS))
    return result


def nearest_angles(
    arm: ArmConfig, palm: ArrayLike, R_R2: ArrayLike, stand_height: float, near: ArrayLike
) -> Array | None:
    """The angles (6,) rad that hold the palm so and are nearest to `near` (6,) rad; None: cannot.

    Of all branches and full turns, within the hard limits; nearest by the largest difference.
    """
    reference = _angles(near)
    best, least = None, math.inf
    for branch in BRANCHES:
        angles = inverse_kinematics(arm, palm, R_R2, stand_height, branch=branch)
        if not np.all(np.isfinite(angles)):
            continue
        turns = 2.0 * math.pi * np.round((reference - angles) / (2.0 * math.pi))
        for candidate in (angles + turns, angles):
            inside = (candidate >= arm.lower - 1e-12) & (candidate <= arm.upper + 1e-12)
            distance = float(np.max(np.abs(candidate - reference)))
            if np.all(inside) and distance < least:
                best, least = candidate, distance
        # The branches lie far apart, but at singular poses: none of the others will be nearer.
        if least < _SURELY_NEAREST:
            break
    return best


def _angles(angles: ArrayLike) -> Array:
    q = np.asarray(angles, dtype=np.float64)
    if q.shape[-1:] != (len(JOINTS),):
        raise InputError(f"angles of shape {q.shape}; must be (..., {len(JOINTS)}), rad")
    return q
