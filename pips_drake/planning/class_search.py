"""The shortest path of every class, compiled: A* on cells and classes (`path_classes`) together.

A state is a cell with the class of the way to it. Classes are reduced words; they form a tree, in
which a letter leads to a child, or back to the parent if it is the inverse of the last one. A
class's cells are given memory when the first of them is reached. What is left to the goal is
estimated by the exact distance on the grid, whatever the class, which one search from the goal has
found for all cells: so a state is looked at only if a path through it is no longer than the last
one that is wanted.
"""

from __future__ import annotations

import numba
import numpy as np

from pips_drake.planning.a_star import _pop, _push
from pips_drake.planning.occupancy import BLOCKED

# Sums that are equal but for rounding must not open a cell twice.
_EAGER = 1.0 - 1e-12


@numba.njit(cache=True)
def search_classes(
    padded, start, goal, steps, step_costs, periodic, cuts, cut_starts, left, count, longest, most
):
    """The shortest paths of the first few classes from a cell to another.

    Args:
        padded: `Occupancy.padded`; cells are counted in it.
        start, goal: (3,).
        steps, step_costs, periodic: `STEPS` and the grid's.
        cuts, cut_starts: `Surface.crossings`.
        left: of every cell, flat: no more than what is left to the goal, m, infinite without a way.
        count: how many paths are wanted.
        longest: no path longer than this share of the first one is.
        most: number of classes that are looked at.

    Returns:
        The goal's classes (C,), costs (C,) m; of every class its parent and last letter (K,), and
        of its cells the costs (K, cells) m and the steps that led there (26: none did) and from
        which class (K, cells); the number of closed states.
    """
    n1, n2 = padded.shape[1], padded.shape[2]
    around, layer = n1 - 2, n1 * n2
    flat = padded.reshape(-1)
    cells, letters = flat.shape[0], cuts.shape[0]
    parents = np.full(most, -1, dtype=np.int64)
    last = np.zeros(most, dtype=np.int64)
    children = np.full((most, 2 * letters + 1), -1, dtype=np.int64)
    held = 1
    cost = np.full((held, cells), np.inf)
    step_to = np.full((held, cells), 26, dtype=np.int8)
    class_from = np.zeros((held, cells), dtype=np.int16)
    closed = np.zeros((held, cells), dtype=np.bool_)
    classes = 1
    found, costs, number = np.empty(count, dtype=np.int64), np.empty(count), 0
    keys, nodes, size = np.empty(4096), np.empty(4096, dtype=np.int64), 0
    offsets = np.empty(26, dtype=np.int64)
    for s in range(26):
        offsets[s] = steps[s, 0] * layer + steps[s, 1] * n2 + steps[s, 2]
    first = start[0] * layer + start[1] * n2 + start[2]
    goal_node = goal[0] * layer + goal[1] * n2 + goal[2]
    cost[0, first] = 0.0
    bound = np.inf
    if left[first] < np.inf:
        keys, nodes = _push(keys, nodes, size, left[first], first)
        size += 1
    visited = 0
    while size > 0:
        state = _pop(keys, nodes, size)
        size -= 1
        here_class, node = state // cells, state % cells
        if closed[here_class, node]:
            continue
        closed[here_class, node] = True
        visited += 1
        here = cost[here_class, node]
        if node == goal_node:
            found[number], costs[number] = here_class, here
            number += 1
            if number == 1:
                bound = longest * here
            if number == count:
                break
            # It is passed through as well.
        i = node // layer
        j = (node - i * layer) // n2
        k = node - i * layer - j * n2
        for s in range(26):
            near, nj = node + offsets[s], j + steps[s, 1]
            if periodic:
                if nj == 0:
                    near, nj = near + around * n2, around
                elif nj > around:
                    near, nj = near - around * n2, 1
            if flat[near] == BLOCKED:
                continue
            there = here + step_costs[k - 1, s]
            if not there + left[near] <= bound:
                continue
            there_class = here_class
            if steps[s, 1] != 0:
                # Columns are counted without the border; the cuts of the step's lower one.
                up = steps[s, 1] > 0
                column, row = (j - 1, i - 1) if up else (nj - 1, i + steps[s, 0] - 1)
                low, high = cut_starts[column], cut_starts[column + 1]
                for n in range(high - low):
                    at = low + n if up else high - 1 - n
                    if row >= cuts[at, 0]:
                        continue
                    letter = cuts[at, 1] + 1 if up else -(cuts[at, 1] + 1)
                    if there_class != 0 and last[there_class] == -letter:
                        there_class = parents[there_class]
                        continue
                    child = children[there_class, letter + letters]
                    if child < 0:
                        if classes == most:
                            there_class = -1
                            break
                        child = classes
                        classes += 1
                        children[there_class, letter + letters] = child
                        parents[child], last[child] = there_class, letter
                    there_class = child
            if there_class < 0:
                continue
            while there_class >= held:
                cost = np.concatenate((cost, np.full((held, cells), np.inf)))
                step_to = np.concatenate((step_to, np.full((held, cells), 26, dtype=np.int8)))
                class_from = np.concatenate((class_from, np.zeros((held, cells), dtype=np.int16)))
                closed = np.concatenate((closed, np.zeros((held, cells), dtype=np.bool_)))
                held = 2 * held
            if closed[there_class, near] or there >= _EAGER * cost[there_class, near]:
                continue
            cost[there_class, near] = there
            step_to[there_class, near], class_from[there_class, near] = s, here_class
            keys, nodes = _push(keys, nodes, size, there + left[near], there_class * cells + near)
            size += 1
    return found[:number], costs[:number], step_to, class_from, cost, classes, visited
