"""The arm's kinematics, compiled: the operator's frame asks for a pose several times.

The formulas are those of `kinematics`, where the conventions stand.
"""

from __future__ import annotations

import math

import numba
import numpy as np


@numba.njit(cache=True)
def _heading_pitch(heading, pitch, out):
    """R_z(heading) R_y(pitch) into out (3, 3)."""
    ch, sh, cp, sp = math.cos(heading), math.sin(heading), math.cos(pitch), math.sin(pitch)
    out[0, 0], out[0, 1], out[0, 2] = ch * cp, -sh, ch * sp
    out[1, 0], out[1, 1], out[1, 2] = sh * cp, ch, sh * sp
    out[2, 0], out[2, 1], out[2, 2] = -sp, 0.0, cp


@numba.njit(cache=True)
def forward(q, height, a0, a1, a2):
    """Shoulder, elbow, wrist and palm, (N, 4, 3) m, and R_R0, R_R1, R_R2, (N, 3, 3, 3).

    Args: q (N, 6) rad, height (N,) m, the arms' lengths m.
    """
    count = q.shape[0]
    points, R = np.empty((count, 4, 3)), np.empty((count, 3, 3, 3))
    wrist = np.empty((3, 3))
    for n in range(count):
        _heading_pitch(q[n, 0], q[n, 1], R[n, 0])
        # Two pitches about the same axis add.
        _heading_pitch(q[n, 0], q[n, 1] + q[n, 2], R[n, 1])
        _heading_pitch(q[n, 3], q[n, 4], wrist)
        c, s = math.cos(q[n, 5]), math.sin(q[n, 5])
        for row in range(3):
            across, down = wrist[row, 1], wrist[row, 2]
            wrist[row, 1], wrist[row, 2] = c * across + s * down, c * down - s * across
        for row in range(3):
            for column in range(3):
                total = 0.0
                for k in range(3):
                    total += R[n, 1, row, k] * wrist[k, column]
                R[n, 2, row, column] = total
        points[n, 0, 0], points[n, 0, 1], points[n, 0, 2] = 0.0, 0.0, -height[n]
        for axis in range(3):
            points[n, 1, axis] = points[n, 0, axis] + a0 * R[n, 0, axis, 0]
            points[n, 2, axis] = points[n, 1, axis] + a1 * R[n, 1, axis, 0]
            points[n, 3, axis] = points[n, 2, axis] + a2 * R[n, 2, axis, 0]
    return points, R


@numba.njit(cache=True)
def inverse(palm, R_R2, height, a0, a1, a2, backwards, below, flipped):
    """Angles (N, 6) rad within +-pi; NaN where the wrist is out of reach.

    Args: palm (N, 3) m, R_R2 (N, 3, 3), height (N,) m, the arms' lengths m, a branch.
    """
    count = palm.shape[0]
    angles, R_R1 = np.empty((count, 6)), np.empty((3, 3))
    sign = -1.0 if backwards else 1.0
    for n in range(count):
        x = palm[n, 0] - a2 * R_R2[n, 0, 0]
        y = palm[n, 1] - a2 * R_R2[n, 1, 0]
        z = palm[n, 2] - a2 * R_R2[n, 2, 0]
        heading = math.atan2(sign * y, sign * x)
        along, up = sign * math.hypot(x, y), -z - height[n]
        cosine = (along * along + up * up - a0 * a0 - a1 * a1) / (2.0 * a0 * a1)
        elbow = math.acos(cosine) if abs(cosine) <= 1.0 else math.nan
        # Seen from behind, up and down change sides.
        if below == backwards:
            elbow = -elbow
        shoulder = math.atan2(up, along) - math.atan2(
            a1 * math.sin(elbow), a0 + a1 * math.cos(elbow)
        )
        _heading_pitch(heading, shoulder + elbow, R_R1)
        x0 = x1 = x2 = y2 = z2 = 0.0
        for k in range(3):
            x0 += R_R1[k, 0] * R_R2[n, k, 0]
            x1 += R_R1[k, 1] * R_R2[n, k, 0]
            x2 += R_R1[k, 2] * R_R2[n, k, 0]
            y2 += R_R1[k, 2] * R_R2[n, k, 1]
            z2 += R_R1[k, 2] * R_R2[n, k, 2]
        wrist_pitch = math.asin(min(max(-x2, -1.0), 1.0)) if x2 == x2 else math.nan
        wrist_heading, roll = math.atan2(x1, x0), math.atan2(y2, z2)
        if flipped:
            wrist_heading += math.pi
            wrist_pitch = math.pi - wrist_pitch
            roll += math.pi
        angles[n, 0], angles[n, 1], angles[n, 2] = heading, shoulder, elbow
        angles[n, 3], angles[n, 4], angles[n, 5] = wrist_heading, wrist_pitch, roll
        for k in range(6):
            angles[n, k] = (angles[n, k] + math.pi) % (2.0 * math.pi) - math.pi
    return angles
