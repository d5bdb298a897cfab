"""How far an arm is from where it was sent, and how hard its drives work, compiled."""

from __future__ import annotations

import math

import numba
import numpy as np

from pips_drake.serpentine.dh_chain import joint_frames


@numba.njit(cache=True)
def tracking_error(dh, joints_of_spine, commanded, measured):
    """The farthest spine point from its command.

    Args:
        dh: the chain, (J, 5); a mirrored arm's distances are the same.
        joints_of_spine: joints whose frames' origins are the spine points, (M + 1,), from 1.
        commanded, measured: joint values (at least J,), m and rad.

    Returns:
        distance (m) and the joint of that point; NaN if any value is NaN.
    """
    joints = dh.shape[0]
    rotations, wanted = np.empty((joints, 3, 3)), np.empty((joints, 3))
    reached = np.empty((joints, 3))
    joint_frames(dh, commanded, rotations, wanted)
    joint_frames(dh, measured, rotations, reached)
    worst, at = 0.0, joints_of_spine[0]
    for j in joints_of_spine:
        total = 0.0
        for k in range(3):
            total += (reached[j - 1, k] - wanted[j - 1, k]) ** 2
        distance = math.sqrt(total)
        # Written so that a NaN stays.
        if not distance <= worst and not math.isnan(worst):
            worst, at = distance, j
    return worst, at


@numba.njit(cache=True)
def largest_share(values, limits):
    """The largest |value| / limit of (J,) each and its index; NaN if any value is."""
    worst, at = 0.0, 0
    for j in range(limits.size):
        share = abs(values[j]) / limits[j]
        if not share <= worst and not math.isnan(worst):
            worst, at = share, j
    return worst, at
