"""Slows a motion given by joints where its speed would jump, so that the arm does not ring.

Rows that were timed by a speed alone ask for jumps of velocity: at both ends, and wherever the
lines before and after a row differ. An arm answers a jump dv of a point by ringing with an
amplitude of about dv / w, with w its lowest mode (about 2 pi 3 Hz: 10 mm/s give half a millimetre).
Here the postures stay, on the same straight lines, and the motion's own clock is slowed instead.

With tau the given time and r = dtau/dt the clock's rate, a point's jump at a row is r dv. So r is
at most jump / dv there, 0 at both ends, 1 everywhere, and changes from 0 to 1 in `ramp` at least:
|dr/dt| <= 1 / ramp, which is |d(r^2)/dtau| <= 2 / ramp. The largest such r follows from one pass
forward and one backward. Between two instants r^2 is linear in tau, so r is linear in t, and
dt = 2 dtau / (r_0 + r_1) exactly.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pips_drake.config import require
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.joint_motion import JointMotion

Array = NDArray[np.float64]

#: Largest jump of a spine point's velocity, m/s, and the least time from rest to full speed, s.
JUMP, RAMP = 0.010, 2.0
#: Over such a time velocities at a row are differences, s: shorter than any segment that counts.
_INSTANT = 1e-4
#: The clock's rate is found at instants at most so far apart in the given time, s.
_STEP = 1.0 / 16.0
#: Rows of the result are so far apart while the rate changes, s.
_INTERVAL = 1.0 / 16.0


def paced(
    arm: SerpentineArm, motion: JointMotion, *, jump: float = JUMP, ramp: float = RAMP
) -> JointMotion:
    """The same postures at other times: from rest to rest, without jumps of velocity.

    No part of it is faster than it was given.

    Args:
        jump: by how much the velocity of a spine point may jump at a row, m/s.
        ramp: in which time the clock may go from rest to its full rate, s.

    Raises:
        InputError: `jump` or `ramp` is not a number above 0.
    """
    for name, value in (("jump", jump), ("ramp", ramp)):
        require(math.isfinite(value) and value > 0.0, f"pacing: {name}", value, "> 0")
    times = _finer(motion.times)
    rates = np.ones(len(times))
    rows = np.searchsorted(times, motion.times)
    with np.errstate(divide="ignore"):
        rates[rows[1:-1]] = np.minimum(1.0, jump / _velocity_jumps(arm, motion))
    rates[0] = rates[-1] = 0.0
    steps = np.diff(times)
    squares = (rates**2).tolist()
    gains = (2.0 / ramp * steps).tolist()
    for k in range(len(gains)):
        squares[k + 1] = min(squares[k + 1], squares[k] + gains[k])
    for k in reversed(range(len(gains))):
        squares[k] = min(squares[k], squares[k + 1] + gains[k])
    rates = np.sqrt(squares)
    slowed = np.concatenate([[0.0], np.cumsum(2.0 * steps / (rates[:-1] + rates[1:]))])
    changing = rates[1:] != rates[:-1]
    # Rows, and where the rate begins or ends to change; in between, instants while it changes.
    kept = np.union1d(rows, np.flatnonzero(changing[1:] != changing[:-1]) + 1)
    instants = np.arange(_INTERVAL, slowed[-1], _INTERVAL)
    part = np.searchsorted(slowed, instants, side="right") - 1
    nearest = np.searchsorted(slowed[kept], instants)
    apart = np.minimum(instants - slowed[kept[nearest - 1]], slowed[kept[nearest]] - instants)
    good = changing[part] & (apart > 0.1 * _INTERVAL)
    instants, part = instants[good], part[good]
    since = instants - slowed[part]
    gain = (rates[part + 1] - rates[part]) / (slowed[part + 1] - slowed[part])
    given = times[part] + rates[part] * since + 0.5 * gain * since**2
    at = np.concatenate([slowed[kept], instants])
    order = np.argsort(at)
    joints = motion.at(np.concatenate([times[kept], given]))
    return JointMotion(times=at[order], joints=joints[order])


def _finer(times: Array) -> Array:
    """Times (L,) with every interval cut into equal parts of at most `_STEP`, two or more."""
    steps = np.diff(times)
    parts = np.maximum(2, np.ceil(steps / _STEP).astype(int))
    first = np.repeat(np.cumsum(parts) - parts, parts)
    share = (np.arange(parts.sum()) - first) / np.repeat(parts, parts)
    return np.append(np.repeat(times[:-1], parts) + share * np.repeat(steps, parts), times[-1])


def _velocity_jumps(arm: SerpentineArm, motion: JointMotion) -> Array:
    """By how much a spine point's velocity jumps at the rows between the ends, (K - 2,) m/s."""
    slopes = np.diff(motion.joints, axis=0) / np.diff(motion.times)[:, None]
    here = motion.joints[1:-1]
    if not len(here):
        return np.empty(0)
    at = kinematics.spine_points(arm, here)
    before = (at - kinematics.spine_points(arm, here - _INSTANT * slopes[:-1])) / _INSTANT
    after = (kinematics.spine_points(arm, here + _INSTANT * slopes[1:]) - at) / _INSTANT
    jumps: Array = np.linalg.norm(after - before, axis=2).max(axis=1)
    return jumps
