"""What it takes to hold the arm still against gravity."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.dh_chain import gravity_efforts
from pips_drake.serpentine.drives import drive_from_joint, drive_stiffness, joint_stiffness
from pips_drake.serpentine.linkage import actuator_lever

Array = NDArray[np.float64]


def holding_efforts(arm: SerpentineArm, q: ArrayLike, gravity: ArrayLike) -> Array:
    """Joint efforts that hold postures still, (N, joints), N and Nm, positive with the joint value.

    Args:
        q: joint values (N, joints) or (joints,), m and rad.
        gravity: in frame {0}, (3,) m/s^2 (the mounting's rotation applied to the world's).

    Raises:
        InputError: `q` or `gravity` has another shape.
    """
    postures = np.atleast_2d(np.asarray(q, dtype=np.float64))
    if postures.ndim != 2 or postures.shape[1] != arm.joints:  # compiled code would not look
        raise InputError(
            f"joint values of shape {np.shape(q)}; must be (N, {arm.joints}) for arm '{arm.name}'"
        )
    chain = weighed_chain(arm, gravity)
    return -np.asarray(gravity_efforts(chain[0], postures, *chain[1:]))


def sag(arm: SerpentineArm, q: ArrayLike, gravity: ArrayLike) -> Array:
    """How far joints stand short of where they are sent, (N, joints), m and rad.

    A joint of stiffness K that holds an effort tau at its posture stands tau / K short.

    Args:
        q, gravity: as of `holding_efforts`.
    """
    return holding_efforts(arm, q, gravity) / joint_stiffness(arm)


def weighed_chain(arm: SerpentineArm, gravity: ArrayLike) -> tuple[Array, Array, Array, Array]:
    """What `dh_chain.gravity_efforts` wants to know of an arm beside its posture.

    Args:
        gravity: in frame {0}, (3,) m/s^2.

    Returns:
        chain's rows (J, 5); masses (J,) kg; centres of mass (J, 3) m; gravity (3,) m/s^2.

    Raises:
        InputError: `gravity` has another shape.
    """
    if np.shape(gravity) != (3,):
        raise InputError(f"gravity of shape {np.shape(gravity)}; must be (3,), m/s^2")
    # A mirrored arm under mirrored gravity has the same joint efforts.
    gravity_drawn = np.asarray(gravity, dtype=np.float64) * arm.mirror
    masses = np.array([body.mass for body in arm.bodies])
    centres = np.array([body.centre for body in arm.bodies])
    return arm.dh_table, masses, centres, gravity_drawn


def deflection_terms(arm: SerpentineArm, gravity: ArrayLike) -> tuple[Array, ...]:
    """Everything that `write_deflection_offset` wants to know beside the posture."""
    return (*weighed_chain(arm, gravity), joint_stiffness(arm), arm.linkage.triangles)


def leg_deflection_terms(arm: SerpentineArm, gravity: ArrayLike) -> tuple[Array, ...]:
    """Everything that `write_leg_deflection_offset` wants to know beside the posture."""
    return (*weighed_chain(arm, gravity), drive_stiffness(arm), arm.linkage.triangles)


@numba.njit(cache=True, error_model="numpy")
def write_deflection_offset(
    dh, masses, centres, gravity, stiffness, triangles, joint_state, offset
):
    """How much farther drives must be sent to stand at one posture: the joints' `sag` (at it).

    Args:
        dh, masses, centres, gravity, stiffness, triangles: `deflection_terms`.
        joint_state: joint values first, (at least J,) m and rad.
        offset: out, (J,) m and rad.
    """
    joints = dh.shape[0]
    first = joints - triangles.shape[0]
    posture = joint_state[:joints].copy().reshape(1, joints)
    efforts = gravity_efforts(dh, posture, masses, centres, gravity)
    for j in range(joints):
        q = posture[0, j]
        aim = q - efforts[0, j] / stiffness[j]
        offset[j] = drive_from_joint(triangles, first, j, aim) - drive_from_joint(
            triangles, first, j, q
        )


@numba.njit(cache=True, error_model="numpy")
def write_leg_deflection_offset(
    dh, masses, centres, gravity, stiffness, triangles, joint_state, offset
):
    """What drives give way, along their own coordinates, that hold one posture against gravity.

    As `write_deflection_offset`, where the actuators themselves are the springs: what gives way is
    a length, force over stiffness, so the joints' stiffness follows the posture.

    Args:
        dh, masses, centres, gravity, stiffness, triangles: `leg_deflection_terms`.
        joint_state: joint values first, (at least J,) m and rad.
        offset: out, (J,) m and rad.
    """
    joints = dh.shape[0]
    first = joints - triangles.shape[0]
    posture = joint_state[:joints].copy().reshape(1, joints)
    efforts = gravity_efforts(dh, posture, masses, centres, gravity)
    for j in range(joints):
        offset[j] = -efforts[0, j] / stiffness[j]
        if j >= first:
            a, b, phi0 = triangles[j - first]
            offset[j] /= actuator_lever(a, b, phi0 + posture[0, j])
