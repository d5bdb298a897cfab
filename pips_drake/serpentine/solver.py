"""Compiled core of follow-the-leader: fit and inverse, iterated until they agree (FTL-95 Fig 3.1).

The same functions serve one point (the online loop) and many (the plan). See `follow_the_leader`
for the meaning and the public interface.

Tip positions that do not depend on each other are solved side by side, in lanes: the last axis of
the arrays. A single one is a long chain of square roots and divisions, each of which waits
for the last; several in step keep the processor busy (three times faster for many lanes).
"""

from __future__ import annotations

import math

import numba
import numpy as np

from pips_drake.serpentine.spine_fit import fit_spines, place_tips
from pips_drake.serpentine.spine_inverse import invert_spines, make_inverse, write_joints

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
def _solve_lanes(table, s_tips, mechanism, tolerance, max_iterations, q_lengths, q):
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
    chain = mechanism.chain
    lanes, modules = s_tips.size, chain.shape[0]
    spine = np.full((modules + 1, 3, lanes), np.nan)
    arc_lengths = np.full((modules + 1, lanes), np.nan)
    tip_piece, piece = np.empty(lanes, dtype=np.int64), np.empty(lanes, dtype=np.int64)
    place_tips(table, s_tips, spine, arc_lengths, tip_piece)
    found = make_inverse(modules, lanes)
    excess, bend = found.excess, found.bend
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
        invert_spines(mechanism, spine, found)
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
                errors[n, 0] = math.sqrt(found.error[n])
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
            write_joints(found, n, q[n])
    return spine, arc_lengths, status, iterations, errors, part, beyond


@numba.njit(cache=True)
def solve_points(
    table, s_tips, mechanism, tolerance, max_iterations, initial_q_lengths, carry_over
):
    """Many tip positions (FTL-95 Fig 3.1). With `carry_over` the module lengths carry on.

    Args:
        table: the path's pieces (`path_geometry`).
        s_tips: arc lengths of the tips (N,), m.
        mechanism: the arm's (`spine_inverse`).
        tolerance: spine error that is accepted, m.
        initial_q_lengths: where the iteration starts, (M,) m.

    Returns:
        joints (N, B + 2 M + 1) m and rad, spine (N, M + 1, 3) m, arc lengths (N, M + 1) m, status
        (N,), iterations (N,), errors (N, 2) m last and first, failing module or base row (N,) or
        -1, by how much a base row is out of reach (N,) (excess of the sine or cosine over 1),
        module lengths (N, M): as updated last, which at `OFF_PATH` are those that did not fit.
    """
    n, modules = s_tips.size, mechanism.chain.shape[0]
    q = np.zeros((n, mechanism.base_rows.shape[0] + 2 * modules + 1))
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
            table, s_tips[here], mechanism, tolerance, max_iterations, q_lengths, q[here]
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
