"""Compiled joints from spine points, base to tip (FTL-95 section 3.4), as cosines and sines.

Arrays are in lanes (`solver`): their last axis, L, are postures that are worked out side by side.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numba
import numpy as np

from pips_drake.serpentine.dh_chain import ORIGIN, UNIT_ROTATION, dh_step, with_sines
from pips_drake.serpentine.motion_base import PRISMATIC, base_inverse

if TYPE_CHECKING:
    from pips_drake.serpentine.arm import SerpentineArm


class Mechanism(NamedTuple):
    """What compiled code knows of an arm: its motion base, and a chain of any number of modules.

    Everything is as drawn; a mirrored arm's world is reflected outside.
    """

    chain: np.ndarray  # Delta_i, S_{i+1} a row, (M, 2), m
    base_kind: int  # as in `motion_base`
    base_parameters: np.ndarray  # m; the last is S_1
    base_rows: np.ndarray  # the base's rows of the Denavit-Hartenberg table, `with_sines`
    home: tuple[float, float]  # cosine and sine of the second joint's home


class Inverse(NamedTuple):
    """What `invert_spines` finds."""

    base: np.ndarray  # d1 (m), cosine and sine of theta2, of theta3, (5, L)
    excess: np.ndarray  # of `base_inverse`, (2, L); positive: out of reach, and the rest is NaN
    axis: np.ndarray  # unit vectors along the even joints' axes, and one more, (M + 1, 3, L)
    along: np.ndarray  # X of the base's last frame, then of those between the joints, (M + 1, 3, L)
    bend: np.ndarray  # cosine and sine of the odd angles, (M, 2, L)
    gap: np.ndarray  # the last spine point that is reached minus the wanted one, (3, L), m
    error: np.ndarray  # largest such distance of all spine points squared, (L,), m^2


def make_mechanism(arm: SerpentineArm) -> Mechanism:
    """The mechanism of an arm, in the drawn hand."""
    home = float(arm.joint_home[1])
    return Mechanism(
        chain=np.ascontiguousarray(arm.chain),
        base_kind=arm.base.kind,
        base_parameters=arm.base.parameters,
        base_rows=with_sines(arm.dh_table[: len(arm.base.joint_names)]),
        home=(math.cos(home), math.sin(home)),
    )


@numba.njit(cache=True)
def make_inverse(modules, lanes):
    """Arrays for `invert_spines` to write."""
    return Inverse(
        np.empty((5, lanes)),
        np.empty((2, lanes)),
        np.empty((modules + 1, 3, lanes)),
        np.empty((modules + 1, 3, lanes)),
        np.empty((modules, 2, lanes)),
        np.empty((3, lanes)),
        np.empty(lanes),
    )


@numba.njit(cache=True, error_model="numpy")
def _base_frame(rows, d1, c2, s2, c3, s3):
    """The base's last frame: its rotation row by row (9), and its origin (3), m."""
    r, o = UNIT_ROTATION, ORIGIN
    for j in range(rows.shape[0]):
        d, c0, s0 = rows[j, 2], rows[j, 7], rows[j, 8]
        if rows[j, 4] == PRISMATIC:
            d += d1
            ct, st = c0, s0
        else:
            c, s = (c2, s2) if j == 1 else (c3, s3)
            ct, st = c * c0 - s * s0, s * c0 + c * s0
        r, o = dh_step(r, o, rows[j, 1], d, rows[j, 5], rows[j, 6], ct, st)
    return r, o


@numba.njit(cache=True, error_model="numpy")
def _start_at_base(mechanism, spine, base, excess, x_axis, axis, gap, error):
    """The base's joints in all lanes (FTL-95 section 3.4.1).

    Args:
        spine: first spine points (3, L), m.
        base: out, d1 (m), cosine and sine of theta2, of theta3, (5, L).
        excess: out, of `base_inverse`, (2, L).
        x_axis, axis: out, X and Y of the base's last frame, (3, L).
        gap, error: out, as in `_bend_module`.
    """
    kind, parameters, rows = mechanism.base_kind, mechanism.base_parameters, mechanism.base_rows
    home_cosine, home_sine = mechanism.home
    # The first spine point lies S_1 along X of the base's last frame.
    first = parameters[-1]
    for n in range(error.size):
        wanted_x, wanted_y, wanted_z = spine[0, n], spine[1, n], spine[2, n]
        d1, c2, s2, c3, s3, excess[0, n], excess[1, n] = base_inverse(
            kind, parameters, wanted_x, wanted_y, wanted_z, home_cosine, home_sine
        )
        r, o = _base_frame(rows, d1, c2, s2, c3, s3)
        x = o[0] + first * r[0] - wanted_x
        y = o[1] + first * r[3] - wanted_y
        z = o[2] + first * r[6] - wanted_z
        error[n] = x * x + y * y + z * z
        base[0, n], base[1, n], base[2, n], base[3, n], base[4, n] = d1, c2, s2, c3, s3
        gap[0, n], gap[1, n], gap[2, n] = x, y, z
        x_axis[0, n], x_axis[1, n], x_axis[2, n] = r[0], r[3], r[6]
        axis[0, n], axis[1, n], axis[2, n] = r[1], r[4], r[7]


@numba.njit(cache=True, error_model="numpy")
def _bend_module(offset, length, start, end, axis, next_axis, along, bend, gap, error):
    """One module's angles in all lanes (FTL-95 Eqs 3.19 to 3.22), as vectors and cosines.

    The even joint turns about `axis`, so X of the frame after it lies along the spine vector's part
    square to that axis; the odd joint bends the segment from there towards the axis. Angles are
    formed when the iteration is over. Forward kinematics goes along, to tell where the module
    really ends.

    Args:
        start, end: wanted spine points j and j + 2, (3, L) m.
        axis: unit vectors (3, L) along the even joint's axis.
        next_axis: out, those of the next even joint.
        along: out, X of the frame between the even and the odd joint, (3, L).
        bend: out, cosine and sine of the odd angle, (2, L).
        gap: in and out, the spine point that is reached minus the wanted one, (3, L) m.
        error: in and out, the largest square of the gap so far, (L,) m^2.
    """
    for n in range(error.size):
        vx, vy, vz = end[0, n] - start[0, n], end[1, n] - start[1, n], end[2, n] - start[2, n]
        ex, ey, ez = axis[0, n], axis[1, n], axis[2, n]
        up = vx * ex + vy * ey + vz * ez
        flat_x, flat_y, flat_z = vx - up * ex, vy - up * ey, vz - up * ez
        flat = math.sqrt(flat_x * flat_x + flat_y * flat_y + flat_z * flat_z)
        # Nothing square to the axis: NaN from here on, which never converges.
        shrink = 1.0 / flat
        ux, uy, uz = flat_x * shrink, flat_y * shrink, flat_z * shrink
        from_hinge = flat - offset
        reach = 1.0 / math.sqrt(from_hinge * from_hinge + up * up)
        cosine, sine = from_hinge * reach, up * reach
        a, b = offset + length * cosine, length * sine
        x = gap[0, n] + a * ux + b * ex - vx
        y = gap[1, n] + a * uy + b * ey - vy
        z = gap[2, n] + a * uz + b * ez - vz
        squared = x * x + y * y + z * z
        # Written so that a NaN stays.
        error[n] = error[n] if squared <= error[n] else squared
        gap[0, n], gap[1, n], gap[2, n] = x, y, z
        bend[0, n], bend[1, n] = cosine, sine
        along[0, n], along[1, n], along[2, n] = ux, uy, uz
        next_axis[0, n] = cosine * ex - sine * ux
        next_axis[1, n] = cosine * ey - sine * uy
        next_axis[2, n] = cosine * ez - sine * uz


@numba.njit(cache=True)
def invert_spines(mechanism, spine, found):
    """Joints of all lanes from their spine points (M + 1, 3, L) m, into `found` (`Inverse`)."""
    chain, axis, along = mechanism.chain, found.axis, found.along
    _start_at_base(
        mechanism, spine[0], found.base, found.excess, along[0], axis[0], found.gap, found.error
    )
    for i in range(chain.shape[0]):
        _bend_module(
            chain[i, 0],
            chain[i, 1],
            spine[i],
            spine[i + 1],
            axis[i],
            axis[i + 1],
            along[i + 1],
            found.bend[i],
            found.gap,
            found.error,
        )


@numba.njit(cache=True)
def write_joints(found, lane, q):
    """A lane's joints (B + 2 M + 1,) m and rad, in place; the last, the roll, is kept.

    The even angle is that of `along` about the even axis, from X of the frame before.
    """
    base, axis, along, bend = found.base, found.axis, found.along, found.bend
    q[0] = base[0, lane]
    q[1] = math.atan2(base[2, lane], base[1, lane])
    q[2] = math.atan2(base[4, lane], base[3, lane])
    x0, x1, x2 = along[0, 0, lane], along[0, 1, lane], along[0, 2, lane]
    for i in range(bend.shape[0]):
        e0, e1, e2 = axis[i, 0, lane], axis[i, 1, lane], axis[i, 2, lane]
        u0, u1, u2 = along[i + 1, 0, lane], along[i + 1, 1, lane], along[i + 1, 2, lane]
        cosine = u0 * x0 + u1 * x1 + u2 * x2
        # Z = X x Y of the frame before, whose Y is the even axis.
        z0, z1, z2 = x1 * e2 - x2 * e1, x2 * e0 - x0 * e2, x0 * e1 - x1 * e0
        q[3 + 2 * i] = math.atan2(-(u0 * z0 + u1 * z1 + u2 * z2), cosine)
        c, s = bend[i, 0, lane], bend[i, 1, lane]
        q[4 + 2 * i] = math.atan2(s, c)
        x0, x1, x2 = c * u0 + s * e0, c * u1 + s * e1, c * u2 + s * e2


@numba.njit(cache=True)
def joints_from_spines(mechanism, spines):
    """Joints (N, B + 2 M + 1), m and rad, from wanted spine points (N, M + 1, 3), m.

    The last joint is 0; all are NaN where the base does not reach.
    """
    n, modules = spines.shape[0], mechanism.chain.shape[0]
    q = np.zeros((n, mechanism.base_rows.shape[0] + 2 * modules + 1))
    spine = np.empty((modules + 1, 3, n))
    for i in range(n):
        spine[:, :, i] = spines[i]
    found = make_inverse(modules, n)
    invert_spines(mechanism, spine, found)
    for i in range(n):
        if found.excess[0, i] > 0.0 or found.excess[1, i] > 0.0:
            q[i] = np.nan
        else:
            write_joints(found, i, q[i])
    return q
