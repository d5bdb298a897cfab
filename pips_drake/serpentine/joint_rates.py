"""Compiled derivatives of the converged joints by the tip's arc length.

Vectors are tuples here: arrays of three would take longer to make than to compute.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from pips_drake.serpentine.dh_chain import joint_frames
from pips_drake.serpentine.motion_base import PRISMATIC
from pips_drake.serpentine.path_geometry import START, find_piece, piece_point
from pips_drake.serpentine.solver import CONVERGED, solve_points


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
def _column(matrix, k):
    return matrix[0, k], matrix[1, k], matrix[2, k]


@numba.njit(cache=True)
def _scaled(a, factor):
    return a[0] * factor, a[1] * factor, a[2] * factor


@numba.njit(cache=True)
def _sum(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@numba.njit(cache=True)
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@numba.njit(cache=True)
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@numba.njit(cache=True, error_model="numpy")
def _solve3(first, second, third, b):
    """x of x0 first + x1 second + x2 third = b: Cramer's rule with cross products."""
    c0 = _cross(second, third)
    determinant = _dot(first, c0)
    return (
        _dot(b, c0) / determinant,
        _dot(first, _cross(b, third)) / determinant,
        _dot(first, _cross(second, b)) / determinant,
    )


@numba.njit(cache=True, error_model="numpy")
def joint_rates(table, q, arc_lengths, mechanism):
    """Derivative of the converged joints by the tip's arc length, (B + 2 M + 1,), rad/m and m/m.

    Marches from base to tip with the first spine point at unit speed along the path: it fixes the
    base's three rates, and each further spine point, which must move along the path's tangent,
    fixes its two angle rates and its own speed (three equations, three unknowns). Dividing by the
    tip's speed turns the whole into rates by the tip's arc length. No iteration is differentiated.
    """
    chain, base_dh = mechanism.chain, mechanism.base_rows
    joints, modules = base_dh.shape[0], chain.shape[0]
    # The first spine point lies S_1 along X of the base's last frame.
    first_length = mechanism.base_parameters[-1]
    rate = np.zeros(q.size)
    rotations = np.empty((joints, 3, 3))
    origins = np.empty((joints, 3))
    joint_frames(base_dh, q, rotations, origins)
    rotation = rotations[joints - 1].copy()
    here = _sum(origins[joints - 1], _scaled(_column(rotation, 0), first_length))
    point, tangent = np.empty(3), np.empty(3)
    piece = find_piece(table, arc_lengths[0])
    piece_point(table, piece, arc_lengths[0] - table[piece, START], point, tangent)
    columns = np.empty((3, 3))
    for j in range(joints):
        axis = _column(rotations[j], 2)
        if base_dh[j, 4] != PRISMATIC:
            axis = _cross(axis, _sum(here, _scaled(origins[j], -1.0)))
        columns[j, 0], columns[j, 1], columns[j, 2] = axis
    velocity = tangent[0], tangent[1], tangent[2]
    rate[0], rate[1], rate[2] = _solve3(columns[0], columns[1], columns[2], velocity)
    spin = 0.0, 0.0, 0.0
    for j in range(joints):
        if base_dh[j, 4] != PRISMATIC:
            spin = _sum(spin, _scaled(_column(rotations[j], 2), rate[j]))
    speed = 1.0
    for i in range(modules):
        even, odd = q[joints + 2 * i], q[joints + 2 * i + 1]
        _even_step(rotation, math.cos(even), math.sin(even))
        even_axis = _column(rotation, 2)
        # From spine point j to j+1, the odd hinge, and on to j+2 (Eq 3.3).
        to_hinge = _scaled(_column(rotation, 0), chain[i, 0])
        _odd_step(rotation, math.cos(odd), math.sin(odd))
        odd_axis = _column(rotation, 2)
        to_end = _scaled(_column(rotation, 0), chain[i, 1])
        span = _sum(to_hinge, to_end)
        piece = find_piece(table, arc_lengths[i + 1])
        piece_point(table, piece, arc_lengths[i + 1] - table[piece, START], point, tangent)
        along = tangent[0], tangent[1], tangent[2]
        carried = _sum(velocity, _cross(spin, span))
        even_rate, odd_rate, speed = _solve3(
            _cross(even_axis, span),
            _cross(odd_axis, to_end),
            _scaled(along, -1.0),
            _scaled(carried, -1.0),
        )
        rate[joints + 2 * i] = even_rate
        rate[joints + 2 * i + 1] = odd_rate
        spin = _sum(spin, _sum(_scaled(even_axis, even_rate), _scaled(odd_axis, odd_rate)))
        velocity = _scaled(along, speed)
    for j in range(rate.size):
        rate[j] /= speed
    return rate


@numba.njit(cache=True)
def joint_rates_many(table, q, arc_lengths, mechanism):
    """`joint_rates` for postures q (N, joints); rows that did not solve give NaN."""
    rates = np.full(q.shape, np.nan)
    for i in range(q.shape[0]):
        if not math.isnan(q[i, 0]):
            rates[i] = joint_rates(table, q[i], arc_lengths[i], mechanism)
    return rates


@numba.njit(cache=True)
def follow_tip(
    table,
    s_tip,
    speed,
    mechanism,
    tolerance,
    max_iterations,
    module_lengths,
    carry_over,
    joint_state,
    solution,
):
    """One tip position with its rates, for a loop: `solver.solve_points` and `joint_rates`.

    Args:
        s_tip, speed: the tip's arc length and rate, m and m/s.
        module_lengths: where the iteration starts, (M,) m; in and out, as they carry over.
        carry_over: true. (Said here it would be a constant, for which all is compiled once more.)
        joint_state: out, joint values and rates (2 J,); not written without a solution.
        solution: out, spine error (m) and iterations, (2,).

    Returns:
        status.
    """
    tips = np.empty(1)
    tips[0] = s_tip
    q, _, arcs, status, iterations, errors, _, _, lengths = solve_points(
        table, tips, mechanism, tolerance, max_iterations, module_lengths, carry_over
    )
    module_lengths[:] = lengths[0]
    if status[0] == CONVERGED:
        rates = joint_rates(table, q[0], arcs[0], mechanism)
        for j in range(rates.size):
            joint_state[j] = q[0, j]
            joint_state[rates.size + j] = rates[j] * speed
    solution[0], solution[1] = errors[0, 0], iterations[0]
    return status[0]
