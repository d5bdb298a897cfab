"""Drives: what moves the joints. The base's two joints directly, every other through an actuator.

A drive's coordinate is the joint value itself for the base's first joints (d1 in m, theta2 in rad),
and the actuator's length (L3, L4, ... in m) for the rest. Functions take joint quantities with the
joints along the last axis and are vectorised over the others.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.serpentine.arm import SerpentineArm

Array = NDArray[np.float64]


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


def joint_effort_limit(arm: SerpentineArm) -> Array:
    """Effort limits of the joints where the hinges are straight, (joints,) N and Nm."""
    hinges = arm.linkage.force_limit * arm.linkage.lever(np.zeros(len(arm.actuator_names)))
    return np.concatenate([arm.base_effort_limit, hinges])


def deflection_offset(arm: SerpentineArm, joints: ArrayLike, holding_efforts: ArrayLike) -> Array:
    """How much farther the drives must be sent to stand where they are wanted, (..., joints).

    A drive of joint stiffness K that holds an effort tau stands tau / K short of its command.
    """
    q = np.asarray(joints, dtype=np.float64)
    aim = q + np.asarray(holding_efforts) / joint_stiffness(arm)
    return drives_from_joints(arm, aim) - drives_from_joints(arm, q)
