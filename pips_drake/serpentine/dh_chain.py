"""Compiled frames of a Denavit-Hartenberg chain in Craig's convention."""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from pips_drake.serpentine.motion_base import PRISMATIC

Array = NDArray[np.float64]


#: A rotation's nine numbers row by row, and a point, of the frame that a chain starts from.
UNIT_ROTATION, ORIGIN = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0)


@numba.njit(cache=True, error_model="numpy")
def dh_step(r, o, a, d, ca, sa, ct, st):
    """Next frame of a chain: RotX(alpha) TransX(a) RotZ(theta) TransZ(d).

    Args:
        r, o: rotation row by row (9) and origin (3), m.
        ca, sa, ct, st: cosines and sines of alpha and theta.

    Returns:
        rotation and origin.
    """
    z0, z1, z2 = ca * r[2] - sa * r[1], ca * r[5] - sa * r[4], ca * r[8] - sa * r[7]
    y0, y1, y2 = ca * r[1] + sa * r[2], ca * r[4] + sa * r[5], ca * r[7] + sa * r[8]
    rotation = (
        ct * r[0] + st * y0,
        ct * y0 - st * r[0],
        z0,
        ct * r[3] + st * y1,
        ct * y1 - st * r[3],
        z1,
        ct * r[6] + st * y2,
        ct * y2 - st * r[6],
        z2,
    )
    return rotation, (o[0] + a * r[0] + d * z0, o[1] + a * r[3] + d * z1, o[2] + a * r[6] + d * z2)


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
        dh: the chain's first rows (J, 5 or more), as `SerpentineArm.dh_table`.
        q: joint values (J or more,), m and rad.
        rotations, origins: out, (J, 3, 3) and (J, 3) m in frame {0}.
    """
    r, o = UNIT_ROTATION, ORIGIN
    for j in range(dh.shape[0]):
        prismatic = dh[j, 4] == PRISMATIC
        d = dh[j, 2] + (q[j] if prismatic else 0.0)
        alpha, theta = dh[j, 0], dh[j, 3] + (0.0 if prismatic else q[j])
        r, o = dh_step(
            r, o, dh[j, 1], d, math.cos(alpha), math.sin(alpha), math.cos(theta), math.sin(theta)
        )
        for k in range(3):
            origins[j, k] = o[k]
            for m in range(3):
                rotations[j, k, m] = r[3 * k + m]


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
