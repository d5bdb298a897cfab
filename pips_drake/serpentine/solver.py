"""Compiled core of follow-the-leader: fit, inverse, forward, and iterate.

The same functions serve one point (the online loop) and many (the plan). They know a chain as
arrays: module i has offset Delta_i and length S_{i+1}; nothing here knows how many there are.
See `follow_the_leader` for the meaning and the public interface.

Tip positions that do not depend on each other are solved side by side, in lanes: the last axis of
every array here. A single one is a long chain of square roots and divisions, each of which waits
for the last; several in step keep the processor busy (three times faster for many lanes).
"""

from __future__ import annotations

import math

import numba
import numpy as np

from pips_drake.serpentine.motion_base import PRISMATIC, base_inverse
from pips_drake.serpentine.path_geometry import START, find_piece, piece_position, walk_back

#: What became of a point. Order matters: everything above `CONVERGED` is a failure.
CONVERGED, NOT_CONVERGED, OFF_PATH, BASE_OUT_OF_REACH = 0, 1, 2, 3
# Not yet any of these.
_RUNNING = -1

#: Tip positions that are solved side by side when they do not depend on each other.
LANES = 64


@numba.njit(cache=True, error_model="numpy")
def _third_side(offset, length, odd_cosine):
    """Q_i (m) from the cosine of its odd angle: FTL-95 Eq 3.4."""
    return math.sqrt(offset * offset + 2.0 * offset * length * odd_cosine + length * length)


@numba.njit(cache=True)
def module_length(offset, length, odd_angle):
    """Q_i (m) as a function of its odd angle (rad): FTL-95 Eq 3.4."""
    return _third_side(offset, length, math.cos(odd_angle))


@numba.njit(cache=True)
def place_tips(table, s_tips, spine, arc_lengths, tip_piece):
    """Puts the lanes' last spine points on the path, and says on which piece."""
    last = spine.shape[0] - 1
    for n in range(s_tips.size):
        piece = find_piece(table, s_tips[n])
        spine[last, 0, n], spine[last, 1, n], spine[last, 2, n] = piece_position(
            table, piece, s_tips[n] - table[piece, START]
        )
        arc_lengths[last, n] = s_tips[n]
        tip_piece[n] = piece


@numba.njit(cache=True, error_model="numpy")
def fit_spines(table, tip_piece, q_lengths, running, spine, arc_lengths, piece, missing):
    """Places the running lanes' spine points on the path, tip to base (FTL-95 section 3.3.2).

    Args:
        tip_piece: pieces that the tips stand on (L,).
        q_lengths: module lengths (M, L), m.
        running: which lanes to do, (L,).
        spine, arc_lengths: in and out, as in `_solve_lanes`; only the tips' are read.
        piece: scratch (L,).
        missing: out, index of the module that found no intersection, or -1, (L,).
    """
    last = spine.shape[0] - 1
    for n in range(running.size):
        if running[n]:
            piece[n], missing[n] = tip_piece[n], -1
    # Lanes inside modules: one lane's walk waits for the last one's root, the others' need not.
    for i in range(last - 1, -1, -1):
        for n in range(running.size):
            if not running[n] or missing[n] >= 0:
                continue
            start = table[piece[n], START]
            here, local = walk_back(
                table,
                piece[n],
                arc_lengths[i + 1, n] - start,
                spine[i + 1, 0, n],
                spine[i + 1, 1, n],
                spine[i + 1, 2, n],
                q_lengths[i, n],
            )
            if here < 0:
                missing[n] = i
                continue
            spine[i, 0, n], spine[i, 1, n], spine[i, 2, n] = piece_position(table, here, local)
            arc_lengths[i, n] = table[here, START] + local
            piece[n] = here


@numba.njit(cache=True, error_model="numpy")
def _dh_step(row, r, o, d, ct, st):
    """Next frame of a chain, scalars only: RotX(alpha) TransX(a) RotZ(theta) TransZ(d)."""
    a, ca, sa = row
    z0, z1, z2 = ca * r[2] - sa * r[1], ca * r[5] - sa * r[4], ca * r[8] - sa * r[7]
    y0, y1, y2 = ca * r[1] + sa * r[2], ca * r[4] + sa * r[5], ca * r[7] + sa * r[8]
    origin = (o[0] + a * r[0] + d * z0, o[1] + a * r[3] + d * z1, o[2] + a * r[6] + d * z2)
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
    return rotation, origin


@numba.njit(cache=True, error_model="numpy")
def _base_frame(rows, d1, c2, s2, c3, s3):
    """The base's last frame: its rotation row by row (9), and its origin (3), m."""
    r = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    o = (0.0, 0.0, 0.0)
    for j in range(rows.shape[0]):
        d, c0, s0 = rows[j, 2], rows[j, 7], rows[j, 8]
        if rows[j, 4] == PRISMATIC:
            d += d1
            ct, st = c0, s0
        else:
            c, s = (c2, s2) if j == 1 else (c3, s3)
            ct, st = c * c0 - s * s0, s * c0 + c * s0
        r, o = _dh_step((rows[j, 1], rows[j, 5], rows[j, 6]), r, o, d, ct, st)
    return r, o


@numba.njit(cache=True, error_model="numpy")
def _start_at_base(kind, parameters, rows, nominal, spine, base, excess, x_axis, axis, gap, error):
    """The base's joints in all lanes (FTL-95 section 3.4.1).

    Args:
        spine: first spine points (3, L), m.
        base: out, d1 (m), cosine and sine of theta2, of theta3, (5, L).
        excess: out, of `base_inverse`, (2, L).
        x_axis, axis: out, X and Y of the base's last frame, (3, L).
        gap, error: out, as in `_bend_module`.
    """
    # The first spine point lies S_1 along X of the base's last frame.
    first = parameters[-1]
    for n in range(error.size):
        wanted_x, wanted_y, wanted_z = spine[0, n], spine[1, n], spine[2, n]
        d1, c2, s2, c3, s3, excess[0, n], excess[1, n] = base_inverse(
            kind, parameters, wanted_x, wanted_y, wanted_z, nominal[0], nominal[1]
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
def _spine_inverse(
    chain, kind, parameters, rows, nominal, spine, base, excess, axis, along, bend, gap, error
):
    """Joints of all lanes from their spine points, base to tip (section 3.4), as cosines.

    Args:
        spine: wanted spine points (M + 1, 3, L), m.
        base, excess, bend, gap: out, as in `_start_at_base` and, for all modules, `_bend_module`.
        axis: out, axes of the even joints, and of one more, (M + 1, 3, L).
        along: out, X of the base's last frame, then as in `_bend_module`, (M + 1, 3, L).
        error: out, the largest distance of wanted and reached spine points squared (L,), m^2.
    """
    _start_at_base(
        kind, parameters, rows, nominal, spine[0], base, excess, along[0], axis[0], gap, error
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
            bend[i],
            gap,
            error,
        )


@numba.njit(cache=True)
def _write_joints(base, axis, along, bend, lane, q):
    """A lane's joints (B + 2 M + 1,) m and rad, in place; the last, the roll, is kept.

    The even angle is that of `along` about the even axis, from X of the frame before.
    """
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
def spine_inverse_many(spines, chain, kind, parameters, rows, nominal):
    """Joints from spine points, base to tip (section 3.4).

    Args:
        spines: wanted spine points (N, M + 1, 3), m.
        chain, kind, parameters, rows, nominal: as in `solve_points`.

    Returns:
        joints (N, B + 2 M + 1), m and rad; the last 0; NaN where the base does not reach.
    """
    n, modules = spines.shape[0], chain.shape[0]
    q = np.zeros((n, rows.shape[0] + 2 * modules + 1))
    spine = np.empty((modules + 1, 3, n))
    for i in range(n):
        spine[:, :, i] = spines[i]
    base, excess, axis, along, bend, gap, error = _make_lanes(modules, n)
    _spine_inverse(
        chain, kind, parameters, rows, nominal, spine, base, excess, axis, along, bend, gap, error
    )
    for i in range(n):
        if excess[0, i] > 0.0 or excess[1, i] > 0.0:
            q[i] = np.nan
        else:
            _write_joints(base, axis, along, bend, i, q[i])
    return q


@numba.njit(cache=True)
def _make_lanes(modules, lanes):
    """Arrays that `_spine_inverse` writes: base, excess, axis, along, bend, gap, error."""
    return (
        np.empty((5, lanes)),
        np.empty((2, lanes)),
        np.empty((modules + 1, 3, lanes)),
        np.empty((modules + 1, 3, lanes)),
        np.empty((modules, 2, lanes)),
        np.empty((3, lanes)),
        np.empty(lanes),
    )


@numba.njit(cache=True)
def _solve_lanes(
    table, s_tips, chain, kind, parameters, rows, nominal, tolerance, max_iterations, q_lengths, q
):
    """Solves L tip positions side by side (FTL-95 Fig 3.1), each until it is done.

    A lane that is done keeps its spine points and its module lengths, so that going on with the
    others changes nothing in it.

    Args:
        q_lengths: module lengths (M, L), m; in and out.
        q: out, joints (L, B + 2 M + 1).

    Returns:
        as `solve_points` from `spine` on, but spine points (M + 1, 3, L) and arc lengths (M + 1, L)
        in lanes, and no module lengths.
    """
    lanes, modules = s_tips.size, chain.shape[0]
    spine = np.full((modules + 1, 3, lanes), np.nan)
    arc_lengths = np.full((modules + 1, lanes), np.nan)
    tip_piece, piece = np.empty(lanes, dtype=np.int64), np.empty(lanes, dtype=np.int64)
    place_tips(table, s_tips, spine, arc_lengths, tip_piece)
    base, excess, axis, along, bend, gap, error2 = _make_lanes(modules, lanes)
    status = np.full(lanes, _RUNNING)
    iterations = np.zeros(lanes, dtype=np.int64)
    errors = np.full((lanes, 2), np.inf)
    part = np.full(lanes, -1)
    beyond = np.zeros(lanes)
    running = np.full(lanes, True)
    iteration = 0
    while np.any(running):
        iteration += 1
        fit_spines(table, tip_piece, q_lengths, running, spine, arc_lengths, piece, part)
        _spine_inverse(
            chain,
            kind,
            parameters,
            rows,
            nominal,
            spine,
            base,
            excess,
            axis,
            along,
            bend,
            gap,
            error2,
        )
        for n in range(lanes):
            if not running[n]:
                continue
            iterations[n] = iteration
            if part[n] >= 0:
                status[n] = OFF_PATH
            elif excess[0, n] > 0.0 or excess[1, n] > 0.0:
                status[n] = BASE_OUT_OF_REACH
                part[n] = 0 if excess[0, n] > 0.0 else 1
                beyond[n] = excess[part[n], n]
            else:
                errors[n, 0] = math.sqrt(error2[n])
                if iteration == 1:
                    errors[n, 1] = errors[n, 0]
                # After accepted solutions too: that is what reproduces the report's counts.
                for i in range(modules):
                    q_lengths[i, n] = _third_side(chain[i, 0], chain[i, 1], bend[i, 0, n])
                if errors[n, 0] <= tolerance:
                    status[n] = CONVERGED
                elif iteration == max_iterations:
                    status[n] = NOT_CONVERGED
            running[n] = status[n] == _RUNNING
    for n in range(lanes):
        if status[n] > NOT_CONVERGED:
            q[n] = np.nan
        else:
            _write_joints(base, axis, along, bend, n, q[n])
    return spine, arc_lengths, status, iterations, errors, part, beyond


@numba.njit(cache=True)
def solve_points(
    table,
    s_tips,
    chain,
    kind,
    parameters,
    rows,
    nominal,
    tolerance,
    max_iterations,
    initial_q_lengths,
    carry_over,
):
    """Many tip positions (FTL-95 Fig 3.1). With `carry_over` the module lengths carry on.

    Args:
        table: the path's pieces (`path_geometry`).
        s_tips: arc lengths of the tips (N,), m.
        chain: Delta_i, S_{i+1} a row, (M, 2), m.
        kind, parameters: of the motion base.
        rows: its rows of the Denavit-Hartenberg table, `with_sines`.
        nominal: cosine and sine of the second joint's home.
        tolerance: spine error that is accepted, m.
        initial_q_lengths: where the iteration starts, (M,) m.

    Returns:
        joints (N, B + 2 M + 1) m and rad, spine (N, M + 1, 3) m, arc lengths (N, M + 1) m, status
        (N,), iterations (N,), errors (N, 2) m last and first, failing module or base row (N,) or
        -1, by how much a base row is out of reach (N,) (excess of the sine or cosine over 1),
        module lengths (N, M): as updated last, which at `OFF_PATH` are those that did not fit.
    """
    n, modules = s_tips.size, chain.shape[0]
    q = np.zeros((n, rows.shape[0] + 2 * modules + 1))
    spine = np.empty((n, modules + 1, 3))
    arc_lengths = np.empty((n, modules + 1))
    status = np.empty(n, dtype=np.int64)
    iterations = np.empty(n, dtype=np.int64)
    errors = np.empty((n, 2))
    part = np.empty(n, dtype=np.int64)
    beyond = np.empty(n)
    lengths = np.empty((n, modules))
    start = initial_q_lengths.copy()
    lanes = 1 if carry_over else LANES
    for first in range(0, n, lanes):
        here = slice(first, min(first + lanes, n))
        q_lengths = np.empty((modules, here.stop - first))
        for i in range(modules):
            q_lengths[i] = start[i]
        found = _solve_lanes(
            table,
            s_tips[here],
            chain,
            kind,
            parameters,
            rows,
            nominal,
            tolerance,
            max_iterations,
            q_lengths,
            q[here],
        )
        points, places, status[here], iterations[here], errors[here], part[here], beyond[here] = (
            found
        )
        for lane in range(q_lengths.shape[1]):
            spine[first + lane] = points[:, :, lane]
            arc_lengths[first + lane] = places[:, lane]
            lengths[first + lane] = q_lengths[:, lane]
        if carry_over:
            start[:] = initial_q_lengths if status[first] > NOT_CONVERGED else lengths[first]
    return q, spine, arc_lengths, status, iterations, errors, part, beyond, lengths
