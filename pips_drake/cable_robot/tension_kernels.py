"""Small dense programs for many poses at once, compiled: null spaces, linear and least programs.

A robot of M cables and n freedoms has at most M - n tensions to choose, two for CABLE-96's box, so
every program here has few unknowns and some 2 M constraints, and is solved in microseconds; a
general solver takes longer to be called. All kernels take P programs of one size.
"""

from __future__ import annotations

import math

import numba
import numpy as np

#: Constraints count as kept within this (times their largest term, where that is above 1).
KEPT = 1e-12
#: Smaller ones are no pivots.
_PIVOT = 1e-11
#: After so many steps of the simplex method the rule that cannot cycle takes over (R. G. Bland,
#: "New Finite Pivoting Rules for the Simplex Method", 1977).
_STEPS_BEFORE_BLAND = 40
_MOST_STEPS = 2000
#: The longest run of Newton's method seen is 30.
_MOST_NEWTON_STEPS = 200

SOLVED, INFEASIBLE, GAVE_UP = range(3)


@numba.njit(cache=True)
def decompose(matrices, sides, tolerance):
    """Complete QR decompositions with pivoting of (P, M, n), and the shortest solutions of L^T x.

    Args:
        matrices: L, (P, M, n), M >= n.
        sides: right hand sides of L^T x = b, (P, n).
        tolerance: columns that stand out of the others' span by less than this share of the
            longest column's length do not count.

    Returns:
        Orthogonal matrices (P, M, M), whose first columns span the range of L and whose others span
        the null space of L^T; ranks (P,); solutions x (P, M) of least length. Where the rank is
        below n and b is not in the range, x solves as many equations as the rank.
    """
    count, rows, columns = matrices.shape
    bases = np.empty((count, rows, rows))
    ranks = np.full(count, columns)
    shortest = np.zeros((count, rows))
    R, v = np.empty((rows, columns)), np.empty(rows)
    order, y = np.empty(columns, np.int64), np.empty(columns)
    for p in range(count):
        Q = bases[p]
        for i in range(rows):
            for j in range(rows):
                Q[i, j] = 1.0 if i == j else 0.0
            for j in range(columns):
                R[i, j] = matrices[p, i, j]
        first = 0.0
        for j in range(columns):
            order[j] = j
        for k in range(columns):
            best, length = k, -1.0
            for j in range(k, columns):
                total = 0.0
                for i in range(k, rows):
                    total += R[i, j] * R[i, j]
                if total > length:
                    best, length = j, total
            length = math.sqrt(length)
            if k == 0:
                first = length
            if length <= tolerance * first:
                ranks[p] = k
                break
            order[k], order[best] = order[best], order[k]
            for i in range(rows):
                R[i, k], R[i, best] = R[i, best], R[i, k]
            diagonal = -math.copysign(length, R[k, k])
            square = 0.0
            for i in range(k, rows):
                v[i] = R[i, k] - (diagonal if i == k else 0.0)
                square += v[i] * v[i]
            for j in range(k, columns):
                total = 0.0
                for i in range(k, rows):
                    total += v[i] * R[i, j]
                total *= 2.0 / square
                for i in range(k, rows):
                    R[i, j] -= total * v[i]
            for i in range(rows):
                total = 0.0
                for j in range(k, rows):
                    total += Q[i, j] * v[j]
                total *= 2.0 / square
                for j in range(k, rows):
                    Q[i, j] -= total * v[j]
        for k in range(ranks[p]):
            y[k] = sides[p, order[k]]
            for j in range(k):
                y[k] -= R[j, k] * y[j]
            y[k] /= R[k, k]
            for i in range(rows):
                shortest[p, i] += Q[i, k] * y[k]
    return bases, ranks, shortest


@numba.njit(cache=True)
def _solve(system, size, sides):
    """Solves system x = each column of sides (size, K) in place; False where it is singular."""
    columns = sides.shape[1]
    for k in range(size):
        best = k
        for i in range(k + 1, size):
            if abs(system[i, k]) > abs(system[best, k]):
                best = i
        if system[best, k] == 0.0:
            return False
        if best != k:
            for j in range(k, size):
                system[k, j], system[best, j] = system[best, j], system[k, j]
            for j in range(columns):
                sides[k, j], sides[best, j] = sides[best, j], sides[k, j]
        for i in range(size):
            if i != k and system[i, k] != 0.0:
                factor = system[i, k] / system[k, k]
                for j in range(k, size):
                    system[i, j] -= factor * system[k, j]
                for j in range(columns):
                    sides[i, j] -= factor * sides[k, j]
    for k in range(size):
        for j in range(columns):
            sides[k, j] /= system[k, k]
    return True


@numba.njit(cache=True)
def _first_basis(rows, basis):
    """Rows that are farthest from each other's span, and the last one, which is (0, .., 0, 1)."""
    count, size = rows.shape[0] - 1, rows.shape[1] - 1
    rest, unit = np.empty((count, size)), np.empty(size)
    for i in range(count):
        for j in range(size):
            rest[i, j] = rows[i, j]
    for k in range(size):
        best, length = 0, -1.0
        for i in range(count):
            total = 0.0
            for j in range(size):
                total += rest[i, j] * rest[i, j]
            if total > length:
                best, length = i, total
        basis[k] = best
        if length > 0.0:
            for j in range(size):
                unit[j] = rest[best, j] / math.sqrt(length)
            for i in range(count):
                along = 0.0
                for j in range(size):
                    along += rest[i, j] * unit[j]
                for j in range(size):
                    rest[i, j] -= along * unit[j]
    basis[size] = count


@numba.njit(cache=True)
def linear_programs(rows, bounds):
    """The x of the largest last component with rows x <= bounds, by the dual simplex method.

    The last row is (0, .., 0, 1), a bound of what is sought: with it, a start is at hand at which
    all multipliers are nonnegative.

    Args:
        rows: (P, m, d); without their last column they span d - 1 dimensions.
        bounds: (P, m).

    Returns:
        Solutions (P, d), the constraints' multipliers (P, m), and SOLVED, INFEASIBLE or GAVE_UP
        (P,).
    """
    count, constraints, size = rows.shape
    solutions = np.zeros((count, size))
    multipliers = np.zeros((count, constraints))
    states = np.full(count, GAVE_UP)
    basis = np.empty(size, np.int64)
    system, side = np.empty((size, size)), np.empty((size, 1))
    pair = np.empty((size, 2))
    for p in range(count):
        a, h, x = rows[p], bounds[p], solutions[p]
        _first_basis(a, basis)
        for step in range(_MOST_STEPS):
            bland = step >= _STEPS_BEFORE_BLAND
            for k in range(size):
                side[k, 0] = h[basis[k]]
                for j in range(size):
                    system[k, j] = a[basis[k], j]
            if not _solve(system, size, side):
                break
            for k in range(size):
                x[k] = side[k, 0]
            entering, worst = -1, 0.0
            for i in range(constraints):
                excess, largest = -h[i], 1.0
                for j in range(size):
                    excess += a[i, j] * x[j]
                    largest = max(largest, abs(a[i, j] * x[j]))
                if excess > worst and excess > KEPT * largest:
                    entering, worst = i, excess
                    if bland:
                        break
            for k in range(size):
                for j in range(size):
                    system[k, j] = a[basis[j], k]
                pair[k, 0] = 1.0 if k == size - 1 else 0.0
                pair[k, 1] = a[entering, k] if entering >= 0 else 0.0
            if not _solve(system, size, pair):
                break
            if entering < 0:
                states[p] = SOLVED
                for k in range(size):
                    multipliers[p, basis[k]] = max(pair[k, 0], 0.0)
                break
            leaving, least = -1, np.inf
            for k in range(size):
                if pair[k, 1] <= _PIVOT:
                    continue
                ratio = max(pair[k, 0], 0.0) / pair[k, 1]
                if leaving < 0 or ratio < least - _PIVOT:
                    leaving, least = k, ratio
                elif ratio <= least + _PIVOT:
                    # Equal: the largest pivot for its precision, or the rule that cannot cycle.
                    if bland:
                        better = basis[k] < basis[leaving]
                    else:
                        better = pair[k, 1] > pair[leaving, 1]
                    if better:
                        leaving, least = k, min(ratio, least)
            if leaving < 0:
                states[p] = INFEASIBLE
                break
            basis[leaving] = entering
    return solutions, multipliers, states


@numba.njit(cache=True)
def shortest_points(rows, bounds):
    """The shortest z with rows z <= bounds: D. Goldfarb and A. Idnani's dual method (1983).

    Args:
        rows: (P, m, r).
        bounds: (P, m).

    Returns:
        Points (P, r), and SOLVED, INFEASIBLE or GAVE_UP (P,).
    """
    count, constraints, size = rows.shape
    points = np.zeros((count, size))
    states = np.full(count, GAVE_UP)
    active, forces = np.empty(size + 1, np.int64), np.empty(size + 1)
    gram, side = np.empty((size, size)), np.empty((size, 1))
    direction = np.empty(size)
    for p in range(count):
        a, h, z = rows[p], bounds[p], points[p]
        used, entering = 0, -1
        for _ in range(_MOST_STEPS):
            if entering < 0:
                worst = 0.0
                for i in range(constraints):
                    excess, largest = -h[i], 1.0
                    for j in range(size):
                        excess += a[i, j] * z[j]
                        largest = max(largest, abs(a[i, j] * z[j]))
                    if excess > worst and excess > KEPT * largest:
                        # An active one is kept as well as its equations can be solved.
                        known = False
                        for k in range(used):
                            known = known or active[k] == i
                        if not known:
                            entering, worst = i, excess
                if entering < 0:
                    states[p] = SOLVED
                    break
                forces[used] = 0.0
            # The entering normal as a sum of the active ones, and what is left of it.
            for k in range(used):
                side[k, 0] = 0.0
                for j in range(size):
                    side[k, 0] += a[active[k], j] * a[entering, j]
                for i in range(used):
                    gram[k, i] = 0.0
                    for j in range(size):
                        gram[k, i] += a[active[k], j] * a[active[i], j]
            if not _solve(gram, used, side):
                break
            whole, left, excess = 0.0, 0.0, -h[entering]
            for j in range(size):
                direction[j] = a[entering, j]
                for k in range(used):
                    direction[j] -= side[k, 0] * a[active[k], j]
                whole += a[entering, j] * a[entering, j]
                left += direction[j] * direction[j]
                excess += a[entering, j] * z[j]
            dependent = used == size or left <= 1e-18 * whole
            step = np.inf if dependent else excess / left
            leaving = -1
            for k in range(used):
                if side[k, 0] > _PIVOT and forces[k] < step * side[k, 0]:
                    leaving, step = k, forces[k] / side[k, 0]
            if step == np.inf:
                states[p] = INFEASIBLE
                break
            if leaving < 0:
                # Afresh from the active constraints, so that no rounding adds up: z = -A^T u with
                # A A^T u = -h.
                active[used] = entering
                used += 1
                entering = -1
                for k in range(used):
                    side[k, 0] = -h[active[k]]
                    for i in range(used):
                        gram[k, i] = 0.0
                        for j in range(size):
                            gram[k, i] += a[active[k], j] * a[active[i], j]
                if not _solve(gram, used, side):
                    break
                for j in range(size):
                    z[j] = 0.0
                for k in range(used):
                    forces[k] = max(side[k, 0], 0.0)
                    for j in range(size):
                        z[j] -= side[k, 0] * a[active[k], j]
                if used == size:
                    # A corner: A A^T has squared what the equations of the corner lose.
                    for k in range(size):
                        side[k, 0] = h[active[k]]
                        for j in range(size):
                            gram[k, j] = a[active[k], j]
                    if not _solve(gram, size, side):
                        break
                    for k in range(size):
                        z[k] = side[k, 0]
            else:
                for j in range(size):
                    if not dependent:
                        z[j] -= step * direction[j]
                for k in range(used):
                    forces[k] = max(forces[k] - step * side[k, 0], 0.0)
                forces[used] += step
                for k in range(leaving, used):
                    forces[k] = forces[k + 1]
                    if k + 1 < used:
                        active[k] = active[k + 1]
                used -= 1
    return points, states


@numba.njit(cache=True)
def analytic_centres(null_spaces, lows, highs, starts):
    """The z at which the product of the distances to the bounds low <= N z <= high is largest.

    Newton's method on the sum of their logarithms, damped by 1 / (1 + its decrement) until that is
    small, which stays inside the bounds (Y. Nesterov and A. Nemirovskii, 1994).

    Args:
        null_spaces: N, (P, M, r).
        lows, highs: (P, M).
        starts: points strictly inside, (P, r).

    Returns:
        Centres (P, r).
    """
    count, rows, size = null_spaces.shape
    centres = starts.copy()
    hessian, step = np.empty((size, size)), np.empty((size, 1))
    uphill = np.empty(size)
    for p in range(count):
        N, z = null_spaces[p], centres[p]
        for _ in range(_MOST_NEWTON_STEPS):
            for j in range(size):
                uphill[j] = 0.0
                for k in range(size):
                    hessian[j, k] = 0.0
            for i in range(rows):
                value = 0.0
                for j in range(size):
                    value += N[i, j] * z[j]
                below, above = 1.0 / (value - lows[p, i]), 1.0 / (highs[p, i] - value)
                curvature = below * below + above * above
                for j in range(size):
                    uphill[j] += (below - above) * N[i, j]
                    for k in range(size):
                        hessian[j, k] += curvature * N[i, j] * N[i, k]
            for j in range(size):
                step[j, 0] = uphill[j]
            if not _solve(hessian, size, step):
                break
            square = 0.0
            for j in range(size):
                square += uphill[j] * step[j, 0]
            decrement = math.sqrt(max(square, 0.0))
            damping = 1.0 if decrement < 0.25 else 1.0 / (1.0 + decrement)
            for j in range(size):
                z[j] += damping * step[j, 0]
            if decrement < 1e-9:
                break
    return centres
