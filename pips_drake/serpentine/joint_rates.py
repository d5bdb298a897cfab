"""Compiled derivatives of the converged joints by the tip's arc length."""

from __future__ import annotations

import math

import numba
import numpy as np

from pips_drake.serpentine.dh_chain import joint_frames
from pips_drake.serpentine.motion_base import PRISMATIC
from pips_drake.serpentine.path_geometry import START, find_piece, piece_point


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
