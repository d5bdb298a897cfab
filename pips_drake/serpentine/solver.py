"""Compiled core of follow-the-leader: fit, inverse, forward, iterate, and joint rates.

The same functions serve one point (the online loop) and many (the plan). They know a chain as
arrays: module i has offset Delta_i and length S_{i+1}; nothing here knows how many there are.
See `follow_the_leader` for the meaning and the public interface.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from pips_drake.serpentine.dh_chain import joint_frames
from pips_drake.serpentine.motion_base import PRISMATIC, base_inverse
from pips_drake.serpentine.path_geometry import START, find_piece, piece_point, walk_back

#: What became of a point. Order matters: everything above `CONVERGED` is a failure.
CONVERGED, NOT_CONVERGED, OFF_PATH, BASE_OUT_OF_REACH = 0, 1, 2, 3


@numba.njit(cache=True)
def module_length(offset, length, odd_angle):
    """Q_i (m) as a function of its odd angle (rad): FTL-95 Eq 3.4."""
    return math.sqrt(
        offset * offset + 2.0 * offset * length * math.cos(odd_angle) + length * length
    )


@numba.njit(cache=True)
def fit_spine(table, s_tip, q_lengths, spine, arc_lengths):
    """Places the spine points on the path, tip to base (FTL-95 section 3.3.2), in place.

    Args:
        q_lengths: module lengths (M,), base first, m.
        spine: out, spine points (M + 1, 3), base first, m.
        arc_lengths: out, their arc lengths (M + 1,), m.

    Returns:
        index of the module that found no intersection, or -1.
    """
    modules = q_lengths.size
    tangent = np.empty(3)
    piece = find_piece(table, s_tip)
    local = s_tip - table[piece, START]
    piece_point(table, piece, local, spine[modules], tangent)
    arc_lengths[modules] = s_tip
    for i in range(modules - 1, -1, -1):
        piece, local = walk_back(table, piece, local, spine[i + 1], q_lengths[i])
        if piece < 0:
            return i
        piece_point(table, piece, local, spine[i], tangent)
        arc_lengths[i] = table[piece, START] + local
    return -1


@numba.njit(cache=True)
def _even_step(rotation, cosine, sine):
    """R <- R times Eq 3.19, rotation about the module's even joint, in place."""
    for k in range(3):
        x, y, z = rotation[k, 0], rotation[k, 1], rotation[k, 2]
        rotation[k, 0] = cosine * x - sine * z
        rotation[k, 1] = -sine * x - cosine * z
        rotation[k, 2] = y


@numba.njit(cache=True)
def _odd_step(rotation, cosine, sine):
    """R <- R times the rotation of Eq 3.2, about the module's odd joint, in place."""
    for k in range(3):
        x, y, z = rotation[k, 0], rotation[k, 1], rotation[k, 2]
        rotation[k, 0] = cosine * x + sine * z
        rotation[k, 1] = -sine * x + cosine * z
        rotation[k, 2] = -y


@numba.njit(cache=True)
def module_inverse(x, y, z, offset):
    """Even and odd angle (rad) for the vector (x, y, z) m in frame j-1: Eqs 3.20 to 3.22.

    x / cos(theta_E) of Eq 3.22 is hypot(x, z), without the division by a cosine.
    """
    return math.atan2(-z, x), math.atan2(y, math.hypot(x, z) - offset)


@numba.njit(cache=True)
def spine_inverse(spine, chain, base_kind, base_parameters, base_dh, nominal, q):
    """Joints from spine points, base to tip (section 3.4), in place; and the achieved error.

    Args:
        spine: wanted spine points (M + 1, 3), m.
        chain: Delta_i, S_{i+1} a row, (M, 2), m.
        q: out, joints (B + 2 M + 1,), m and rad; the last, which no spine point needs, is kept.

    Returns:
        largest distance (m) between wanted spine points and forward kinematics, and the base's
        excess: positive when the first spine point is out of its reach.
    """
    joints = base_dh.shape[0]
    base_q, excess = base_inverse(base_kind, base_parameters, spine[0], nominal)
    if excess[0] > 0.0 or excess[1] > 0.0:
        return math.inf, excess
    q[:joints] = base_q
    rotations = np.empty((joints, 3, 3))
    origins = np.empty((joints, 3))
    joint_frames(base_dh, q, rotations, origins)
    rotation = rotations[joints - 1].copy()
    # Forward kinematics goes along: `reached` is where the angles really put each spine point.
    reached = np.empty(3)
    error = 0.0
    for k in range(3):
        # The first spine point lies S_1 along X of the base's last frame.
        reached[k] = origins[joints - 1, k] + base_parameters[-1] * rotation[k, 0]
        error += (reached[k] - spine[0, k]) ** 2
    error = math.sqrt(error)
    for i in range(chain.shape[0]):
        vx = spine[i + 1, 0] - spine[i, 0]
        vy = spine[i + 1, 1] - spine[i, 1]
        vz = spine[i + 1, 2] - spine[i, 2]
        x = rotation[0, 0] * vx + rotation[1, 0] * vy + rotation[2, 0] * vz
        y = rotation[0, 1] * vx + rotation[1, 1] * vy + rotation[2, 1] * vz
        z = rotation[0, 2] * vx + rotation[1, 2] * vy + rotation[2, 2] * vz
        even, odd = module_inverse(x, y, z, chain[i, 0])
        q[joints + 2 * i] = even
        q[joints + 2 * i + 1] = odd
        _even_step(rotation, math.cos(even), math.sin(even))
        along = chain[i, 0] + chain[i, 1] * math.cos(odd)
        up = chain[i, 1] * math.sin(odd)
        gap = 0.0
        for k in range(3):
            reached[k] += along * rotation[k, 0] + up * rotation[k, 2]
            gap += (reached[k] - spine[i + 1, k]) ** 2
        error = max(error, math.sqrt(gap))
        _odd_step(rotation, math.cos(odd), math.sin(odd))
    return error, excess


@numba.njit(cache=True)
def spine_inverse_many(spines, chain, base_kind, base_parameters, base_dh, nominal):
    """`spine_inverse` of spines (N, M + 1, 3) m: joints (N, B + 2 M + 1), NaN out of reach."""
    q = np.zeros((spines.shape[0], base_dh.shape[0] + 2 * chain.shape[0] + 1))
    for i in range(spines.shape[0]):
        error, _ = spine_inverse(
            spines[i], chain, base_kind, base_parameters, base_dh, nominal, q[i]
        )
        if math.isinf(error):
            q[i] = np.nan
    return q


@numba.njit(cache=True)
def solve_point(
    table,
    s_tip,
    chain,
    base_kind,
    base_parameters,
    base_dh,
    nominal,
    tolerance,
    max_iterations,
    q_lengths,
    q,
    spine,
    arc_lengths,
):
    """One tip position (FTL-95 Fig 3.1). `q_lengths`, `q`, `spine`, `arc_lengths` change in place.

    The module lengths are updated after every inverse solution, accepted ones too: that is what
    reproduces the report's iteration counts.

    Returns:
        status, iterations, spine error (m), first spine error (m), failing module or base row
        (-1 if none), and by how much a base row is out of reach (dimensionless excess of the sine
        or cosine over 1).
    """
    error = math.inf
    first_error = math.inf
    joints = base_dh.shape[0]
    for iteration in range(1, max_iterations + 1):
        missing = fit_spine(table, s_tip, q_lengths, spine, arc_lengths)
        if missing >= 0:
            return OFF_PATH, iteration, error, first_error, missing, 0.0
        error, excess = spine_inverse(spine, chain, base_kind, base_parameters, base_dh, nominal, q)
        if excess[0] > 0.0 or excess[1] > 0.0:
            row = 0 if excess[0] > 0.0 else 1
            return BASE_OUT_OF_REACH, iteration, error, first_error, row, excess[row]
        if iteration == 1:
            first_error = error
        for i in range(chain.shape[0]):
            q_lengths[i] = module_length(chain[i, 0], chain[i, 1], q[joints + 2 * i + 1])
        if error <= tolerance:
            return CONVERGED, iteration, error, first_error, -1, 0.0
    return NOT_CONVERGED, max_iterations, error, first_error, -1, 0.0


@numba.njit(cache=True)
def solve_points(
    table,
    s_tips,
    chain,
    base_kind,
    base_parameters,
    base_dh,
    nominal,
    tolerance,
    max_iterations,
    initial_q_lengths,
    carry_over,
):
    """Many tip positions; see `solve_point`. With `carry_over` the module lengths carry on.

    Returns:
        joints (N, B + 2 M + 1), spine (N, M + 1, 3), arc lengths (N, M + 1), status (N,),
        iterations (N,), errors (N, 2) last and first, failing part (N,), excess (N,), module
        lengths (N, M): as updated last, which at `OFF_PATH` are those that did not fit.
    """
    n, modules = s_tips.size, chain.shape[0]
    q = np.zeros((n, base_dh.shape[0] + 2 * modules + 1))
    spine = np.full((n, modules + 1, 3), np.nan)
    arc_lengths = np.full((n, modules + 1), np.nan)
    status = np.empty(n, dtype=np.int64)
    iterations = np.empty(n, dtype=np.int64)
    errors = np.empty((n, 2))
    part = np.empty(n, dtype=np.int64)
    excess = np.empty(n)
    lengths = np.empty((n, modules))
    q_lengths = initial_q_lengths.copy()
    for i in range(n):
        if not carry_over:
            q_lengths[:] = initial_q_lengths
        result = solve_point(
            table,
            s_tips[i],
            chain,
            base_kind,
            base_parameters,
            base_dh,
            nominal,
            tolerance,
            max_iterations,
            q_lengths,
            q[i],
            spine[i],
            arc_lengths[i],
        )
        status[i], iterations[i], errors[i, 0], errors[i, 1], part[i], excess[i] = result
        lengths[i] = q_lengths
        if status[i] > NOT_CONVERGED:
            q[i] = np.nan
            q_lengths[:] = initial_q_lengths
    return q, spine, arc_lengths, status, iterations, errors, part, excess, lengths


@numba.njit(cache=True)
def _solve3(columns, b):
    """x of x0 columns[0] + x1 columns[1] + x2 columns[2] = b: Cramer's rule with cross products."""
    c0 = np.cross(columns[1], columns[2])
    determinant = np.dot(columns[0], c0)
    x = np.empty(3)
    x[0] = np.dot(b, c0) / determinant
    x[1] = np.dot(columns[0], np.cross(b, columns[2])) / determinant
    x[2] = np.dot(columns[0], np.cross(columns[1], b)) / determinant
    return x


@numba.njit(cache=True)
def joint_rates(table, q, arc_lengths, chain, base_dh, first_length):
    """Derivative of the converged joints by the tip's arc length, (B + 2 M + 1,), rad/m and m/m.

    Marches from base to tip with the first spine point at unit speed along the path: it fixes the
    base's three rates, and each further spine point, which must move along the path's tangent,
    fixes its two angle rates and its own speed (three equations, three unknowns). Dividing by the
    tip's speed turns the whole into rates by the tip's arc length. No iteration is differentiated.
    """
    joints, modules = base_dh.shape[0], chain.shape[0]
    rate = np.zeros(q.size)
    rotations = np.empty((joints, 3, 3))
    origins = np.empty((joints, 3))
    joint_frames(base_dh, q, rotations, origins)
    rotation = rotations[joints - 1].copy()
    here = origins[joints - 1] + first_length * rotation[:, 0]
    point, tangent = np.empty(3), np.empty(3)
    piece = find_piece(table, arc_lengths[0])
    piece_point(table, piece, arc_lengths[0] - table[piece, START], point, tangent)
    columns = np.empty((3, 3))
    for j in range(joints):
        axis = rotations[j, :, 2].copy()
        if base_dh[j, 4] == PRISMATIC:
            columns[j] = axis
        else:
            columns[j] = np.cross(axis, here - origins[j])
    rate[:joints] = _solve3(columns, tangent)
    spin = np.zeros(3)
    for j in range(joints):
        if base_dh[j, 4] != PRISMATIC:
            spin += rate[j] * rotations[j, :, 2]
    velocity = tangent.copy()
    speed = 1.0
    for i in range(modules):
        even, odd = q[joints + 2 * i], q[joints + 2 * i + 1]
        _even_step(rotation, math.cos(even), math.sin(even))
        even_axis = rotation[:, 2].copy()
        # From spine point j to j+1, the odd hinge, and on to j+2 (Eq 3.3).
        to_hinge = chain[i, 0] * rotation[:, 0]
        _odd_step(rotation, math.cos(odd), math.sin(odd))
        odd_axis = rotation[:, 2].copy()
        to_end = chain[i, 1] * rotation[:, 0]
        span = to_hinge + to_end
        piece = find_piece(table, arc_lengths[i + 1])
        piece_point(table, piece, arc_lengths[i + 1] - table[piece, START], point, tangent)
        columns[0] = np.cross(even_axis, span)
        columns[1] = np.cross(odd_axis, to_end)
        columns[2] = -tangent
        carried = velocity + np.cross(spin, span)
        x = _solve3(columns, -carried)
        rate[joints + 2 * i] = x[0]
        rate[joints + 2 * i + 1] = x[1]
        speed = x[2]
        spin = spin + x[0] * even_axis + x[1] * odd_axis
        velocity = speed * tangent
    return rate / speed


@numba.njit(cache=True)
def joint_rates_many(table, q, arc_lengths, chain, base_dh, first_length):
    """`joint_rates` for postures q (N, joints); rows that did not solve give NaN."""
    rates = np.full(q.shape, np.nan)
    for i in range(q.shape[0]):
        if not math.isnan(q[i, 0]):
            rates[i] = joint_rates(table, q[i], arc_lengths[i], chain, base_dh, first_length)
    return rates
