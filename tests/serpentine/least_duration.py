"""A duration that no motion within limits can beat, found without the passes that it judges."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import coo_matrix


def least_duration(limits, x):
    """A lower bound of the duration of every motion within limits, s, by linear programming.

    The duration of a motion that is linear in x = s'^2 between points is convex in x, and limits
    are linear in it: where the tangent plane at x is least among all motions, it is still below
    each one's duration. HiGHS finds it.
    """
    s, n, bound = limits.travel, len(limits.travel), limits.speed.min(axis=1)
    step = np.diff(s)
    rows, columns, values, right = [], [], [], []
    row = 0
    for i in range(n - 1):
        for b in range(limits.slope.shape[1]):
            a, c, g = limits.slope[i, b], limits.curve[i, b], limits.offset[i, b]
            for sign in (1.0, -1.0):
                rows += [row, row]
                columns += [i, i + 1]
                values += [sign * (c - a / step[i]) / 2, sign * (c + a / step[i]) / 2]
                right.append(1.0 - sign * g)
                row += 1
    root = np.sqrt(x)
    share = -2.0 * step / (root[1:] + root[:-1]) ** 2
    gradient = np.zeros(n)
    gradient[1:-1] = (share[1:] + share[:-1]) / (2.0 * root[1:-1])
    bounds = [(0.0, float(v**2)) for v in bound]
    bounds[0] = bounds[-1] = (0.0, 0.0)
    found = linprog(
        gradient,
        A_ub=coo_matrix((values, (rows, columns)), shape=(row, n)).tocsr(),
        b_ub=right,
        bounds=bounds,
        method="highs",
    )
    assert found.status == 0, found.message
    return np.sum(2.0 * step / (root[1:] + root[:-1])) + found.fun - gradient @ x
