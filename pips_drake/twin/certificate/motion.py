"""How far points leave their chords while the joints move linearly.

Between two knots every joint moves linearly in s from 0 to 1, so q'' = 0. For a chain of joints
that starts at a base link, with w the angular velocity and a the angular acceleration of each link
seen from the base (derivatives by s), z_j a joint's axis and o_j a point on it:

    w_j = w_(j-1) + q_j' z_j              a_j = a_(j-1) + q_j' w_(j-1) x z_j
    o_j'' = o_(j-1)'' + a_(j-1) x r + w_(j-1) x (w_(j-1) x r) [+ 2 w_(j-1) x d_j' z_j if it slides]

with r from o_(j-1) to o_j. Norms of these give `bending`. See docs/certificate.md.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numba
import numpy as np
from numpy.typing import NDArray

from pips_drake.twin.certificate.tree import (
    FREE,
    PRISMATIC,
    REVOLUTE,
    Tree,
    inner,
    multiply,
    rotate,
)

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Stands for a bound that was not asked for, m. Finite, so that nothing becomes NaN.
UNBOUNDED = 1e30


def chain(tree: Tree, base: int, body: int) -> list[tuple[int, int]]:
    """The joints from a base body to another: (the joint's body, +1 outward or -1 inward)."""
    inward, outward = _ancestors(tree, base), _ancestors(tree, body)
    common = next(b for b in inward if b in outward)
    steps = [(b, -1) for b in inward[: inward.index(common)]]
    return steps + [(b, 1) for b in reversed(outward[: outward.index(common)])]


def _ancestors(tree: Tree, body: int) -> list[int]:
    line = [body]
    while line[-1] != 0:
        line.append(int(tree.parent[line[-1]]))
    return line


def stack_chains(chains: Sequence[list[tuple[int, int]]]) -> tuple[Indices, Indices]:
    """Chains as rows of (bodies, signs), (L, C); sign 0 where a chain has ended."""
    longest = max((len(steps) for steps in chains), default=0)
    bodies = np.zeros((len(chains), max(longest, 1)), dtype=np.int64)
    signs = np.zeros_like(bodies)
    for row, steps in enumerate(chains):
        for column, (body, sign) in enumerate(steps):
            bodies[row, column], signs[row, column] = body, sign
    return bodies, signs


@inner
def span_of(u, v):
    """Distance of two points."""
    return math.sqrt((u[0] - v[0]) ** 2 + (u[1] - v[1]) ** 2 + (u[2] - v[2]) ** 2)


@inner
def free_turn(tree, poses, b, k, turn):
    """Angle, rad, by which a free body turns from knot k to the next; its axis in the world."""
    R0, R1, a = poses.rotation[k, b], poses.rotation[k + 1, b], tree.parent[b]
    # The body's turn seen from its parent: Q1 Q0^T with Q = (parent)^T (body).
    Q0, Q1, D = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    multiply(poses.rotation[k, a].T, R0, Q0)
    multiply(poses.rotation[k + 1, a].T, R1, Q1)
    multiply(Q1, Q0.T, D)
    x, y, z = D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]
    sine = 0.5 * math.sqrt(x * x + y * y + z * z)
    angle = math.atan2(sine, 0.5 * (D[0, 0] + D[1, 1] + D[2, 2] - 1.0))
    turn[0] = turn[1] = turn[2] = 0.0
    if sine > 1e-9:
        turn[0], turn[1], turn[2] = 0.5 * x / sine, 0.5 * y / sine, 0.5 * z / sine
    return angle


@numba.njit(cache=True)
def bending(tree, poses, q, bodies, signs, wanted):
    """Bounds on second derivatives by s of points of each chain's last link, in its base's frame.

    Args:
        bodies, signs: chains, (L, C) each (`stack_chains`).
        wanted: segments that are looked at, (N - 1,); the bounds of others are `UNBOUNDED`.

    Returns:
        acceleration of the last joint's origin, (L, N - 1) m, and what a point of the last link
        adds by each metre of its distance from there, (L, N - 1).
    """
    chains, knots = bodies.shape[0], q.shape[0]
    at_origin, by_reach = np.zeros((chains, knots - 1)), np.zeros((chains, knots - 1))
    w0, w1, u, x = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for row in range(chains):
        for k in range(knots - 1):
            if not wanted[k]:
                at_origin[row, k] = UNBOUNDED
                continue
            angular = speed = acceleration = 0.0
            for j in range(3):
                w0[j] = w1[j] = 0.0
            last, last_side = -1, 0
            for c in range(bodies.shape[1]):
                sign, b = signs[row, c], bodies[row, c]
                if sign == 0:
                    break
                side = 1 if sign > 0 else 0
                kind, i = tree.kind[b], tree.start[b]
                # A free joint slides, then turns about the body's point; inward it turns first.
                for part in range(2 if kind == FREE else 1):
                    turns = kind == REVOLUTE or (kind == FREE and (part == 1) == (sign > 0))
                    here = side
                    if kind == FREE and turns:
                        here = 1
                    if last >= 0:
                        r = max(
                            span_of(poses.origin[k, b, here], poses.origin[k, last, last_side]),
                            span_of(
                                poses.origin[k + 1, b, here], poses.origin[k + 1, last, last_side]
                            ),
                        )
                        acceleration += (angular + speed * speed) * r
                    last, last_side = b, here
                    if not turns:
                        if kind == PRISMATIC:
                            slide = abs(q[k + 1, i] - q[k, i])
                        else:
                            slide = span_of(q[k + 1, i + 4 : i + 7], q[k, i + 4 : i + 7])
                        acceleration += 2.0 * speed * slide
                        continue
                    if kind == REVOLUTE:
                        angle = q[k + 1, i] - q[k, i]
                        for j in range(3):
                            w0[j] += sign * angle * poses.axis[k, b, j]
                            w1[j] += sign * angle * poses.axis[k + 1, b, j]
                    else:
                        angle = free_turn(tree, poses, b, k, u)
                        a = tree.parent[b]
                        rotate(poses.rotation[k, a], u, x)
                        for j in range(3):
                            w0[j] += sign * angle * x[j]
                        rotate(poses.rotation[k + 1, a], u, x)
                        for j in range(3):
                            w1[j] += sign * angle * x[j]
                    angular += abs(angle) * speed
                    ends = math.sqrt(w0[0] ** 2 + w0[1] ** 2 + w0[2] ** 2) + math.sqrt(
                        w1[0] ** 2 + w1[1] ** 2 + w1[2] ** 2
                    )
                    speed = min(speed + abs(angle), 0.5 * (ends + angular))
            at_origin[row, k] = acceleration
            by_reach[row, k] = angular + speed * speed
    return at_origin, by_reach


@numba.njit(cache=True)
def error_terms(tree, poses, q, bodies, signs, deviation):
    """What errors of the joints add to `bending`, and what they move points beyond first order.

    Returns:
        four (L, N - 1): as `bending` does, additions to the bounds on second derivatives (by which
        first-order displacements leave their chords) and the remainder of second order.
    """
    chains, knots, longest = bodies.shape[0], q.shape[0], bodies.shape[1]
    bend, bend_reach = np.zeros((chains, knots - 1)), np.zeros((chains, knots - 1))
    rest, rest_reach = np.zeros((chains, knots - 1)), np.zeros((chains, knots - 1))
    spans = np.zeros(longest)
    for row in range(chains):
        for k in range(knots - 1):
            angular = speed = acceleration = turn = slide = length = 0.0
            last, last_side = -1, 0
            for c in range(longest):
                sign, b = signs[row, c], bodies[row, c]
                if sign == 0:
                    break
                side, i = (1 if sign > 0 else 0), tree.start[b]
                spans[c] = 0.0
                if last >= 0:
                    spans[c] = max(
                        span_of(poses.origin[k, b, side], poses.origin[k, last, last_side]),
                        span_of(poses.origin[k + 1, b, side], poses.origin[k + 1, last, last_side]),
                    )
                    if tree.kind[b] == FREE and sign < 0:
                        # Two steps: to the body's point about which it turns, and along its slide.
                        spans[c] = span_of(
                            poses.origin[k, b, 1], poses.origin[k, last, last_side]
                        ) + max(
                            span_of(poses.origin[k, b, 0], poses.origin[k, b, 1]),
                            span_of(poses.origin[k + 1, b, 0], poses.origin[k + 1, b, 1]),
                        )
                last, last_side = b, side
                error = deviation[b]
                if tree.kind[b] == PRISMATIC:
                    spans[c] += error
                length += spans[c]
                acceleration += (angular + speed * speed) * spans[c]
                if tree.kind[b] == PRISMATIC:
                    acceleration += 2.0 * speed * error
                    slide += abs(q[k + 1, i] - q[k, i])
                elif tree.kind[b] == REVOLUTE:
                    angular += error * speed
                    speed += error
                    turn += abs(q[k + 1, i] - q[k, i])
                else:
                    slide += span_of(q[k + 1, i + 4 : i + 7], q[k, i + 4 : i + 7])
                    turn += free_turn(tree, poses, b, k, np.empty(3))
            rest[row, k] = 0.5 * acceleration
            rest_reach[row, k] = 0.5 * (angular + speed * speed)
            for c in range(longest):
                if signs[row, c] == 0:
                    break
                error = deviation[bodies[row, c]]
                # From joint c's origin to the last one's.
                length -= spans[c]
                if tree.kind[bodies[row, c]] == PRISMATIC:
                    bend[row, k] += error * turn * turn
                else:
                    bend[row, k] += error * (turn * turn * length + 2.0 * turn * slide)
                    bend_reach[row, k] += error * turn * turn
    return bend, bend_reach, rest, rest_reach
