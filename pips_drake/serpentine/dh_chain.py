"""Compiled frames of a Denavit-Hartenberg chain in Craig's convention."""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from pips_drake.serpentine.motion_base import PRISMATIC

Array = NDArray[np.float64]


@numba.njit(cache=True)
def _dh_step(rotation, origin, alpha, a, d, theta):
    """Next frame: RotX(alpha) TransX(a) RotZ(theta) TransZ(d), in place."""
    ca, sa = math.cos(alpha), math.sin(alpha)
    ct, st = math.cos(theta), math.sin(theta)
    for k in range(3):
        x, y, z = rotation[k, 0], rotation[k, 1], rotation[k, 2]
        tilted_y, tilted_z = ca * y + sa * z, ca * z - sa * y
        origin[k] += a * x + d * tilted_z
        rotation[k, 0] = ct * x + st * tilted_y
        rotation[k, 1] = ct * tilted_y - st * x
        rotation[k, 2] = tilted_z


def with_sines(dh: Array) -> Array:
    """A table (J, 5) with four columns more: cosine and sine of alpha, and of the theta offset.

    What iterates over the same chain need not compute them again.
    """
    alpha, theta = dh[:, 0], dh[:, 3]
    return np.column_stack([dh, np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)])


@numba.njit(cache=True)
def joint_frames(dh, q, rotations, origins):
    """Frames of the first joints of a chain, in place.

    Args:
        dh: the chain's first rows (J, 5), as `SerpentineArm.dh_table`.
        q: joint values (J or more,), m and rad.
        rotations, origins: out, (J, 3, 3) and (J, 3) m in frame {0}.
    """
    rotation, origin = np.eye(3), np.zeros(3)
    for j in range(dh.shape[0]):
        prismatic = dh[j, 4] == PRISMATIC
        d = dh[j, 2] + (q[j] if prismatic else 0.0)
        theta = dh[j, 3] + (0.0 if prismatic else q[j])
        _dh_step(rotation, origin, dh[j, 0], dh[j, 1], d, theta)
        rotations[j] = rotation
        origins[j] = origin


@numba.njit(cache=True)
def joint_frames_many(dh, q):
    """`joint_frames` of postures q (N, J): rotations (N, J, 3, 3) and origins (N, J, 3) m."""
    rotations = np.empty((q.shape[0], dh.shape[0], 3, 3))
    origins = np.empty((q.shape[0], dh.shape[0], 3))
    for i in range(q.shape[0]):
        joint_frames(dh, q[i], rotations[i], origins[i])
    return rotations, origins


@numba.njit(cache=True)
def gravity_efforts(dh, q, masses, centres, gravity):
    """Generalised forces of gravity on a chain, (N, J), N and Nm.

    Joint j carries everything beyond it: with the mass and the first moment of mass summed from the
    tip, its torque is axis . ((sum m c - o_j sum m) x g), and a slide's force axis . g sum m.

    Args:
        q: postures (N, J), m and rad.
        masses: of the joints' bodies, (J,) kg.
        centres: their centres of mass in their joints' frames, (J, 3) m.
        gravity: in frame {0}, (3,) m/s^2.
    """
    joints = dh.shape[0]
    efforts = np.empty((q.shape[0], joints))
    rotations = np.empty((joints, 3, 3))
    origins = np.empty((joints, 3))
    moment = np.empty(3)
    for i in range(q.shape[0]):
        joint_frames(dh, q[i], rotations, origins)
        mass = 0.0
        moment[:] = 0.0
        for j in range(joints - 1, -1, -1):
            mass += masses[j]
            for k in range(3):
                centre = origins[j, k]
                for m in range(3):
                    centre += rotations[j, k, m] * centres[j, m]
                moment[k] += masses[j] * centre
            efforts[i, j] = 0.0
            for k in range(3):
                pull = mass * gravity[k]
                if dh[j, 4] != PRISMATIC:
                    m, n = (k + 1) % 3, (k + 2) % 3
                    x, y = moment[m] - mass * origins[j, m], moment[n] - mass * origins[j, n]
                    pull = x * gravity[n] - y * gravity[m]
                efforts[i, j] += rotations[j, k, 2] * pull
    return efforts
