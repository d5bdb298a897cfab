"""What planes over whole blocks of a motion prove, computed anew with numpy alone.

A block's bodies are compared with their chords at every knot in it, not with halves of halves as
the search does. docs/certificate.md, section 7, has the theorem.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pips_drake.twin.certificate.problem import Problem
from pips_drake.twin.certificate.proof import Proof
from pips_drake.twin.certificate.recheck_motion import (
    Kinematics,
    MotionBounds,
    chain_of,
    motion_bounds,
)
from pips_drake.twin.certificate.tree import FREE, PRISMATIC, REVOLUTE

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Knots that are looked at together, so that no proof takes up the memory.
_TOGETHER = 100_000


def lowest_of_quadratics(b0: Array, b1: Array, b2: Array) -> Array:
    """The lowest value over [0, 1] of quadratics with Bernstein coefficients b0, b1 and b2."""
    # Inside it is b1 + u v / (u + v): nothing cancels where u and v are only rounding.
    u, v = b0 - b1, b2 - b1
    inside = (u > 0.0) & (v > 0.0)
    share = np.divide(v, u + v, out=np.zeros_like(v), where=inside)
    return np.where(inside, b1 + u * share, np.minimum(b0, b2))


def proved_by_sweeps(proof: Proof, at: Kinematics) -> float:
    """The least bound that the swept planes prove, m; infinite if there are none.

    Args:
        at: the bodies at the motion's knots.
    """
    planes = np.flatnonzero(proof.swept)
    if not len(planes):
        return np.inf
    problem, shapes = proof.problem, proof.problem.shapes
    first, last = proof.first[planes], proof.last[planes]
    n0, n1 = proof.normals[planes, 0], proof.normals[planes, 1]
    half = 0.5 * np.linalg.norm(n0 + n1, axis=1)
    if not (half > 0.0).all():
        return -np.inf
    a, b = problem.a[proof.pair[planes]], problem.b[proof.pair[planes]]
    away = shapes.radius[a] + shapes.radius[b]
    away += _departures(problem, at, a, first, last) + _departures(problem, at, b, first, last)
    # Of the second shape the highest of its points counts, coefficient by coefficient.
    tops = np.empty((len(planes), 3))
    for s, rows in _by_value(b):
        tops[rows] = _values(problem, at, s, first[rows], last[rows], n0[rows], n1[rows], 1.0).max(
            axis=1
        )
        normal = shapes.half_space[s]
        if normal.any():
            body = int(shapes.body[s])
            same = (n0[rows] == normal).all(axis=1) & (n1[rows] == normal).all(axis=1)
            tops[rows[~same | (body != 0)]] = np.inf
    lowest = np.inf
    for s, rows in _by_value(a):
        values = _values(problem, at, s, first[rows], last[rows], n0[rows], n1[rows], -1.0)
        b0, b1, b2 = np.moveaxis(values - (tops[rows] + away[rows, None])[:, None], 2, 0)
        least = lowest_of_quadratics(b0, b1, b2).min(axis=1)
        lowest = min(lowest, float(np.where(least < 0.0, least / half[rows], least).min()))
    return lowest


def _by_value(values: Indices) -> list[tuple[int, Indices]]:
    """The distinct values, and where each is."""
    order = np.argsort(values, kind="stable")
    found, starts = np.unique(values[order], return_index=True)
    return list(zip(found.tolist(), np.split(order, starts[1:]), strict=True))


def _values(
    problem: Problem,
    at: Kinematics,
    s: int,
    first: Indices,
    last: Indices,
    n0: Array,
    n1: Array,
    sign: float,
) -> Array:
    """Bernstein coefficients of n(s) . p(s) of a shape's vertices on their chords, (K, V, 3) m.

    With what the bulge around each adds at most (sign 1) or takes at most (-1).
    """
    shapes = problem.shapes
    vertices = shapes.vertices[shapes.starts[s] : shapes.starts[s + 1]]
    R, p = at.R[shapes.body[s]], at.p[shapes.body[s]]

    def seen(k: Indices, n: Array) -> tuple[Array, Array]:
        return np.einsum("kij,ki->kj", R[k], n), np.einsum("ki,ki->k", n, p[k])

    crosswise = zip(seen(last, n0), seen(first, n1), strict=True)
    middle = [0.5 * (u + v) for u, v in crosswise]
    found = np.empty((len(first), len(vertices), 3))
    for c, (direction, offset) in enumerate((seen(first, n0), middle, seen(last, n1))):
        bulge = np.linalg.norm(direction @ shapes.bulge[s], axis=1)
        found[:, :, c] = direction @ vertices.T + (offset + sign * bulge)[:, None]
    return found


def _departures(
    problem: Problem, at: Kinematics, shape: Indices, first: Indices, last: Indices
) -> Array:
    """How far points of shapes are from their chords and where errors put them, at most, (K,) m."""
    nominal = replace(problem, deviation=np.zeros_like(problem.deviation))
    shapes, found = problem.shapes, np.zeros(len(shape))
    errors = _errors(problem, at)
    for body, rows in _by_value(shapes.body[shape]):
        if body == 0:
            continue
        moving = motion_bounds(nominal, at, chain_of(problem.tree, 0, body), body)
        spans, which = np.unique(
            np.stack([first[rows], last[rows]], axis=1), axis=0, return_inverse=True
        )
        at_joint, per_metre = _block_departures(at, moving, body, spans)
        for s, mine in _by_value(shape[rows]):
            vertices = shapes.vertices[shapes.starts[s] : shapes.starts[s + 1]]
            reach = np.linalg.norm(vertices - moving.origin, axis=1).max()
            reach += np.linalg.norm(shapes.bulge[s], 2)
            block = which.reshape(-1)[mine]
            found[rows[mine]] = at_joint[block] + per_metre[block] * reach
            found[rows[mine]] += errors[0][body] + errors[1][body] * reach
    return found


def _block_departures(
    at: Kinematics, moving: MotionBounds, body: int, spans: Indices
) -> tuple[Array, Array]:
    """Of a body over spans (K, 2) of knots: that of its joint, m, and more by m from there."""
    found = np.empty((2, len(spans)))
    joint, R = at.origin[body, 1], at.R[body].reshape(-1, 9)
    bends = moving.acceleration / 8.0, moving.per_metre / 8.0
    for width, rows in _by_value(spans[:, 1] - spans[:, 0]):
        share = (np.arange(width + 1) / width)[:, None]
        step = max(1, _TOGETHER // (width + 1))
        for part in np.split(rows, np.arange(step, len(rows), step)):
            k = spans[part, 0, None] + np.arange(width + 1)
            for values, bend, out in zip((joint, R), bends, found, strict=True):
                points = values[k]
                chord = (1.0 - share) * points[:, :1] + share * points[:, -1:]
                off = np.linalg.norm(points - chord, axis=2)
                out[part] = (np.maximum(off[:, :-1], off[:, 1:]) + bend[k[:, :-1]]).max(axis=1)
    return found[0], found[1]


def _errors(problem: Problem, at: Kinematics) -> tuple[Array, Array]:
    """By how much joint errors move points of each body, (B,) m, and more by m from its joint."""
    tree = problem.tree
    fixed, per_metre = np.zeros(len(tree.parent)), np.zeros(len(tree.parent))
    for b in range(1, len(tree.parent)):
        a, kind = int(tree.parent[b]), tree.kind[b]
        error = 0.0 if kind == FREE else float(problem.deviation[tree.start[b]])
        length = float(np.linalg.norm(at.origin[b, 1] - at.origin[a, 1], axis=1).max())
        slip = error if kind == PRISMATIC else 0.0
        fixed[b] = fixed[a] + per_metre[a] * (length + slip) + slip
        per_metre[b] = per_metre[a] + (error if kind == REVOLUTE else 0.0)
    return fixed, per_metre
