"""Drives: what moves the joints. The base's two joints directly, every other through an actuator.

A drive's coordinate is the joint value itself for the base's first joints (d1 in m, theta2 in rad),
and the actuator's length (L3, L4, ... in m) for the rest. Functions take joint quantities with the
joints along the last axis and are vectorised over the others. The compiled ones at the end do the
same for one posture, in a running simulation: they write into arrays that exist.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.linkage import actuator_angle, actuator_length, actuator_lever

Array = NDArray[np.float64]


def drive_names(arm: SerpentineArm) -> tuple[str, ...]:
    """`d1`, `theta2`, `L3`, ..."""
    return arm.joint_names[: arm.first_actuated_joint] + arm.actuator_names


def drive_columns(arm: SerpentineArm) -> tuple[str, ...]:
    """Names of the drives' coordinates with their units: `d1_m`, `theta2_rad`, `L3_m`, ..."""
    base = arm.joint_columns[: arm.first_actuated_joint]
    return base + tuple(f"{name}_m" for name in arm.actuator_names)


def effort_columns(arm: SerpentineArm) -> tuple[str, ...]:
    """Names of the drives' efforts with their units: `d1_N`, `theta2_Nm`, `L3_N`, ..."""
    base = [
        f"{name}_N" if prismatic else f"{name}_Nm"
        for name, prismatic in zip(arm.joint_names, arm.is_prismatic, strict=True)
    ]
    return tuple(base[: arm.first_actuated_joint] + [f"{name}_N" for name in arm.actuator_names])


def levers(arm: SerpentineArm, joints: ArrayLike) -> Array:
    """Derivative of each drive by its joint, (..., joints): 1 for the base, dL/dtheta in m/rad."""
    q = np.asarray(joints, dtype=np.float64)
    first = arm.first_actuated_joint
    return np.concatenate(
        [np.ones_like(q[..., :first]), arm.linkage.lever(q[..., first:])], axis=-1
    )


def drives_from_joints(arm: SerpentineArm, joints: ArrayLike) -> Array:
    """Drive coordinates (..., joints) at joint values (..., joints)."""
    q = np.asarray(joints, dtype=np.float64)
    first = arm.first_actuated_joint
    return np.concatenate([q[..., :first], arm.linkage.length(q[..., first:])], axis=-1)


def joints_from_drives(arm: SerpentineArm, drives: ArrayLike) -> Array:
    """Joint values (..., joints) at drive coordinates; NaN where no triangle closes."""
    y = np.asarray(drives, dtype=np.float64)
    first = arm.first_actuated_joint
    return np.concatenate([y[..., :first], arm.linkage.angle(y[..., first:])], axis=-1)


def drive_efforts(arm: SerpentineArm, joints: ArrayLike, joint_efforts: ArrayLike) -> Array:
    """Efforts of the drives (..., joints), N and Nm, that make the joints' (virtual work)."""
    return np.asarray(joint_efforts) / levers(arm, joints)


def drive_limits(arm: SerpentineArm) -> tuple[Array, Array, Array, Array]:
    """Limits of the drives, (joints,) each: lower, upper coordinate; speed; effort."""
    first, linkage = arm.first_actuated_joint, arm.linkage
    return (
        np.concatenate([arm.joint_lower[:first], linkage.length_lower]),
        np.concatenate([arm.joint_upper[:first], linkage.length_upper]),
        np.concatenate([arm.base_speed_limit, linkage.speed_limit]),
        np.concatenate([arm.base_effort_limit, linkage.force_limit]),
    )


def joint_stiffness(arm: SerpentineArm) -> Array:
    """Stiffness that the drives give the joints, (joints,) N/m and Nm/rad.

    For actuators k (dL/dtheta)^2, taken where the hinge is straight and constant from there. (The
    hardware's follows the posture: by -42 to +42 percent over +-30 deg of the assumed linkage.)
    """
    hinges = arm.linkage.joint_stiffness(np.zeros(len(arm.actuator_names)))
    return np.concatenate([arm.base_stiffness, hinges])


def drive_stiffness(arm: SerpentineArm) -> Array:
    """Stiffness of the drives along their own coordinates, (joints,) N/m and Nm/rad."""
    return np.concatenate([arm.base_stiffness, arm.linkage.stiffness])


def joint_effort_limit(arm: SerpentineArm) -> Array:
    """Effort limits of the joints where the hinges are straight, (joints,) N and Nm."""
    hinges = arm.linkage.force_limit * arm.linkage.lever(np.zeros(len(arm.actuator_names)))
    return np.concatenate([arm.base_effort_limit, hinges])


@numba.njit(cache=True, error_model="numpy")
def drive_from_joint(triangles, first, j, joint):
    """Drive j's coordinate at a value of joint j, of which `first` have no actuator."""
    if j < first:
        return joint
    a, b, phi0 = triangles[j - first]
    return actuator_length(a, b, phi0 + joint)


@numba.njit(cache=True, error_model="numpy")
def joint_from_drive(triangles, first, j, drive):
    """Joint j's value at a coordinate of drive j; NaN where no triangle closes."""
    if j < first:
        return drive
    a, b, phi0 = triangles[j - first]
    return actuator_angle(a, b, drive) - phi0


@numba.njit(cache=True, error_model="numpy")
def write_drive_state(triangles, joint_state, drive_state):
    """Drive coordinates and rates from joint values and rates.

    Args:
        triangles: `Linkage.triangles`, (A, 3).
        joint_state: (2 J,) m and rad, m/s and rad/s.
        drive_state: out, (2 J,).
    """
    joints = joint_state.size // 2
    first = joints - triangles.shape[0]
    for j in range(joints):
        joint, rate = joint_state[j], joint_state[joints + j]
        drive_state[j] = drive_from_joint(triangles, first, j, joint)
        if j >= first:
            a, b, phi0 = triangles[j - first]
            rate *= actuator_lever(a, b, phi0 + joint)
        drive_state[joints + j] = rate


@numba.njit(cache=True, error_model="numpy")
def write_joint_state(triangles, period, drive_state, joint_state):
    """Joint values and rates from drive coordinates and rates.

    Args:
        triangles: `Linkage.triangles`, (A, 3).
        period: over which the joints' rates are mean ones, s; 0 for the derivatives.
        drive_state: (2 J,) m and rad, m/s and rad/s.
        joint_state: out, (2 J,); NaN where no triangle closes.
    """
    joints = drive_state.size // 2
    first = joints - triangles.shape[0]
    for j in range(joints):
        drive, rate = drive_state[j], drive_state[joints + j]
        joint = joint_from_drive(triangles, first, j, drive)
        if period > 0.0:
            before = joint_from_drive(triangles, first, j, drive - rate * period)
            rate = (joint - before) / period
        elif j >= first:
            a, b, phi0 = triangles[j - first]
            rate /= actuator_lever(a, b, phi0 + joint)
        joint_state[j], joint_state[joints + j] = joint, rate


@numba.njit(cache=True)
def cut_to_stroke(lower, upper, command, offset, target):
    """Where drives are sent (J,): command plus offset, within the ends of the stroke."""
    for j in range(target.size):
        # Written so that a NaN stays.
        wanted = command[j] + offset[j]
        target[j] = lower[j] if wanted < lower[j] else upper[j] if wanted > upper[j] else wanted


@numba.njit(cache=True)
def step_servos(lower, upper, speed, period, command, offset, setpoint, saturation):
    """One period of servos that go to a command as far as stroke and speed let them.

    Args:
        lower, upper: ends of the strokes, (J,) m and rad.
        speed: limits, (J,) m/s and rad/s.
        period: s.
        command, offset: drive coordinates (at least J,); their sum is wanted.
        setpoint: in and out, drive coordinates and their rates over the period, (2 J,).
        saturation: out, how many stand at an end of their stroke, and at their speed limit, (2,).
    """
    joints = lower.size
    target = np.empty(joints)
    cut_to_stroke(lower, upper, command, offset, target)
    saturation[:] = 0.0
    for j in range(joints):
        missing, reach = target[j] - setpoint[j], speed[j] * period
        if target[j] <= lower[j] or target[j] >= upper[j]:
            saturation[0] += 1.0
        if abs(missing) > reach:
            saturation[1] += 1.0
            missing = reach if missing > 0.0 else -reach
        setpoint[j] += missing
        setpoint[joints + j] = missing / period
