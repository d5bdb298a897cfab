"""A* on the cells of a grid, compiled (CMU-92 section 3.3).

The estimate of what is left is the exact distance on the grid without obstacles: of n0 >= n1 >= n2
steps to go along the axes, n2 go along all three at once, n1 - n2 along two, the rest along one.
(No other choice is shorter: the square root is concave, so that spreading squares over steps costs
more.) In unfolded coordinates a step around counts as on the innermost cells. Such an estimate is
consistent, so a cell that is taken from the heap has its final cost.

In Cartesian coordinates many ways cost the same: the order of steps does not matter. Where nothing
is near, only those are followed that begin with the steps along more axes (as jump point search
does: Harabor and Grastien 2011). From a cell x that was reached by a step d, and whose neighbours
are all free, only steps s along some of the axes of d, in its directions, are taken. Any other s
gives d + s as two steps through another neighbour of x that are shorter, or the same two in the
other order, the one along fewer axes last. Exchanging ends, at the latest when a step along one
axis is last, so that some shortest path is always found.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from pips_drake.planning.grid import STEPS, Cells
from pips_drake.planning.occupancy import BLOCKED, FREE, INNER

# Of cells with equal sums the one nearer to the goal goes first. Costs are right to this share.
_EAGER = 1.0 + 1e-12
# States of cells that a search has seen, beside those of `Occupancy.padded`; open ones keep FREE or
# INNER's difference.
_OPEN, CLOSED = 3, 5


def _steps_onward() -> tuple[Cells, Cells]:
    """By the step that led to a cell (26: none did) the steps to go on with, and their number."""
    onward, counts = np.zeros((27, 26), dtype=np.int64), np.full(27, 26, dtype=np.int64)
    onward[26] = np.arange(26)
    for row, step in enumerate(STEPS):
        along = np.flatnonzero(((STEPS == 0) | (step == STEPS)).all(axis=1))
        onward[row, : len(along)], counts[row] = along, len(along)
    return onward, counts


#: For `search`: the steps to go on with and their number, by the step that led to a cell.
ONWARD = _steps_onward()


@numba.njit(cache=True)
def _push(keys, nodes, size, key, node):
    """Puts a node into the heap; returns the arrays, which grow."""
    if size == keys.shape[0]:
        more_keys, more_nodes = np.empty(2 * size), np.empty(2 * size, dtype=np.int64)
        more_keys[:size], more_nodes[:size] = keys, nodes
        keys, nodes = more_keys, more_nodes
    at = size
    while at > 0:
        above = (at - 1) >> 1
        if keys[above] <= key:
            break
        keys[at], nodes[at] = keys[above], nodes[above]
        at = above
    keys[at], nodes[at] = key, node
    return keys, nodes


@numba.njit(cache=True)
def _pop(keys, nodes, size):
    """Takes the first node from the heap of `size` nodes, which then has one less."""
    top, size = nodes[0], size - 1
    key, node, at = keys[size], nodes[size], 0
    while True:
        below = 2 * at + 1
        if below >= size:
            break
        if below + 1 < size and keys[below + 1] < keys[below]:
            below += 1
        if keys[below] >= key:
            break
        keys[at], nodes[at] = keys[below], nodes[below]
        at = below
    keys[at], nodes[at] = key, node
    return top


@numba.njit(cache=True)
def _estimate(a, b, c, h):
    """The length of the way over a, b, c cells along the axes without obstacles, m."""
    b = min(b, h[7] - b)
    all_three = min(a, b, c)
    a, b, c = a - all_three, b - all_three, c - all_three
    ab, ac, bc = min(a, b), min(a, c), min(b, c)  # two of them are 0
    return (
        h[6] * all_three
        + h[3] * ab
        + h[4] * ac
        + h[5] * bc
        + h[0] * (a - ab - ac)
        + h[1] * (b - ab - bc)
        + h[2] * (c - ac - bc)
    )


@numba.njit(cache=True)
def search(
    padded, sources, source_costs, goal, steps, step_costs, lengths, periodic, prune, onward, counts
):
    """A* from several cells to one.

    Args:
        padded: `Occupancy.padded`; cells are counted in it.
        sources, source_costs: (S, 3), (S,) m.
        goal: (3,).
        steps, step_costs, lengths, periodic: `STEPS` and the grid's.
        prune: leave out steps as the module's docstring says.
        onward, counts: `ONWARD`.

    Returns:
        The cost (m, infinite without a path); of every cell its state,
        and the step that led there (26 + s at source s); the number of closed cells.
    """
    n1, n2 = padded.shape[1], padded.shape[2]
    around = n1 - 2
    layer = n1 * n2
    state = padded.copy().reshape(-1)
    parent = np.empty(state.shape[0], dtype=np.int32)
    cost = np.empty(state.shape[0])  # untouched where nothing goes, so that it takes no time there
    h0, h1, h2 = _EAGER * lengths[0], _EAGER * lengths[1], _EAGER * lengths[2]
    # What steps cost by the axes that they go along, and how many make a turn.
    h = (
        h0,
        h1,
        h2,
        math.hypot(h0, h1),
        math.hypot(h0, h2),
        math.hypot(h1, h2),
        math.sqrt(h0 * h0 + h1 * h1 + h2 * h2),
        around if periodic else 2 * around,
    )
    goal_node = goal[0] * layer + goal[1] * n2 + goal[2]
    offsets = np.empty(26, dtype=np.int64)
    for s in range(26):
        offsets[s] = steps[s, 0] * layer + steps[s, 1] * n2 + steps[s, 2]
    keys, nodes, size = np.empty(4096), np.empty(4096, dtype=np.int64), 0
    for s in range(sources.shape[0]):
        node = sources[s, 0] * layer + sources[s, 1] * n2 + sources[s, 2]
        if state[node] < _OPEN or source_costs[s] < cost[node]:
            if state[node] < _OPEN:
                state[node] += _OPEN - FREE
            cost[node], parent[node] = source_costs[s], 26 + s
            left = _estimate(
                abs(sources[s, 0] - goal[0]),
                abs(sources[s, 1] - goal[1]),
                abs(sources[s, 2] - goal[2]),
                h,
            )
            keys, nodes = _push(keys, nodes, size, source_costs[s] + left, node)
            size += 1
    visited = 0
    while size > 0:
        node = _pop(keys, nodes, size)
        size -= 1
        if state[node] == CLOSED:
            continue
        inner = state[node] == INNER + _OPEN - FREE
        state[node] = CLOSED
        visited += 1
        here = cost[node]
        if node == goal_node:
            return here, state.reshape(padded.shape), parent.reshape(padded.shape), visited
        i = node // layer
        j = (node - i * layer) // n2
        k = node - i * layer - j * n2
        row = min(parent[node], 26) if prune and inner else 26
        for n in range(counts[row]):
            s = onward[row, n]
            near, nj = node + offsets[s], j + steps[s, 1]
            if periodic:
                if nj == 0:
                    near, nj = near + around * n2, around
                elif nj > around:
                    near, nj = near - around * n2, 1
            known = state[near]
            if known in (BLOCKED, CLOSED):
                continue
            there = here + step_costs[k - 1, s]
            if known < _OPEN:
                state[near] = known + _OPEN - FREE
            elif there >= cost[near]:
                continue
            cost[near], parent[near] = there, s
            left = _estimate(
                abs(i + steps[s, 0] - goal[0]), abs(nj - goal[1]), abs(k + steps[s, 2] - goal[2]), h
            )
            keys, nodes = _push(keys, nodes, size, there + left, near)
            size += 1
    return np.inf, state.reshape(padded.shape), parent.reshape(padded.shape), visited


@numba.njit(cache=True)
def walk_back(parent, steps, goal, periodic):
    """The cells from a source to the goal, (N, 3), counted with the border, and the source."""
    around = parent.shape[1] - 2
    count = 1
    i, j, k = goal[0], goal[1], goal[2]
    walked = np.empty((64, 3), dtype=np.int64)
    walked[0, 0], walked[0, 1], walked[0, 2] = i, j, k
    while parent[i, j, k] < 26:
        s = parent[i, j, k]
        i, j, k = i - steps[s, 0], j - steps[s, 1], k - steps[s, 2]
        if periodic:
            j = around if j == 0 else (1 if j > around else j)
        if count == walked.shape[0]:
            longer = np.empty((2 * count, 3), dtype=np.int64)
            longer[:count] = walked
            walked = longer
        walked[count, 0], walked[count, 1], walked[count, 2] = i, j, k
        count += 1
    return walked[:count][::-1].copy(), parent[i, j, k] - 26
