"""Kinematics and motion bounds for checking proofs, in numpy alone.

Nothing here is shared with the code that finds planes; docs/certificate.md states the theorems.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pips_drake.twin.certificate.problem import Problem
from pips_drake.twin.certificate.tree import FREE, PRISMATIC, REVOLUTE, Tree

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Kinematics:
    """Poses of all bodies at K postures, in the world."""

    def __init__(self, tree: Tree, q: Array) -> None:
        count, bodies = len(q), len(tree.parent)
        self.q = q
        self.R = np.zeros((bodies, count, 3, 3))
        self.p, self.axis = np.zeros((bodies, count, 3)), np.zeros((bodies, count, 3))
        # Each joint's origin as a point of the parent, and of the body.
        self.origin = np.zeros((bodies, 2, count, 3))
        self.R[0] = np.eye(3)
        for b in range(1, bodies):
            i = int(tree.start[b])
            R_WP, p_WP = self.R[tree.parent[b]], self.p[tree.parent[b]]
            R_WF, p_WF = R_WP @ tree.R_PF[b], p_WP + R_WP @ tree.p_PF[b]
            self.axis[b] = R_WF @ tree.axis[b]
            R_FM, p_FM = np.broadcast_to(np.eye(3), (count, 3, 3)), np.zeros((count, 3))
            if tree.kind[b] == REVOLUTE:
                R_FM = Rotation.from_rotvec(tree.axis[b] * q[:, i, None]).as_matrix()
            elif tree.kind[b] == PRISMATIC:
                p_FM = tree.axis[b] * q[:, i, None]
            else:
                R_FM = Rotation.from_quat(np.roll(q[:, i : i + 4], -1, axis=1)).as_matrix()
                p_FM = q[:, i + 4 : i + 7]
            R_WM, p_WM = R_WF @ R_FM, p_WF + np.einsum("kij,kj->ki", R_WF, p_FM)
            self.origin[b] = p_WF, p_WM
            self.R[b] = R_WM @ tree.R_MB[b]
            self.p[b] = p_WM + R_WM @ tree.p_MB[b]


def postures(problem: Problem, segment: Indices, fraction: Array) -> Array:
    """Positions (K, nq) at fractions of segments; free bodies turn evenly, the shorter way."""
    after = np.minimum(segment + 1, len(problem.knots) - 1)
    q0, q1, s = problem.knots[segment], problem.knots[after], fraction[:, None]
    q = (1.0 - s) * q0 + s * q1
    for b in np.flatnonzero(problem.tree.kind == FREE):
        four = slice(int(problem.tree.start[b]), int(problem.tree.start[b]) + 4)
        R0 = Rotation.from_quat(np.roll(q0[:, four], -1, axis=1))
        R1 = Rotation.from_quat(np.roll(q1[:, four], -1, axis=1))
        turned = R0 * Rotation.from_rotvec(s * (R0.inv() * R1).as_rotvec())
        q[:, four] = np.roll(turned.as_quat(), 1, axis=1)
    return q


def chain_of(tree: Tree, base: int, body: int) -> list[tuple[int, bool]]:
    """Joints from a base body to another, and whether each is passed outward."""
    up, down = [], []
    while base != body:
        if base > body:
            up.append((base, False))
            base = int(tree.parent[base])
        else:
            down.append((body, True))
            body = int(tree.parent[body])
    return up + down[::-1]


@dataclass(frozen=True)
class MotionBounds:
    """Of one chain, over all segments: |p''| <= acceleration + per_metre * reach, and so on.

    `origin` is that of the last joint, in the last body, (3,) m.
    """

    acceleration: Array
    per_metre: Array
    remainder: Array
    remainder_per_metre: Array
    origin: Array


def motion_bounds(
    problem: Problem, at: Kinematics, steps: list[tuple[int, bool]], body: int
) -> MotionBounds:
    """The recursion of docs/certificate.md, for all segments at once."""
    zero = np.zeros(len(problem.knots) - 1)
    parts = _elementary(problem, at, steps)
    angular, speed, acceleration = zero, zero, zero
    w0, w1 = np.zeros((len(zero), 3)), np.zeros((len(zero), 3))
    e_angular, e_speed, e_acceleration = 0.0, 0.0, zero
    before: Array | None = None
    lengths, errors, slides = [], [], []
    for part in parts:
        r = zero
        if before is not None:
            apart = np.linalg.norm(part.origin - before, axis=1)
            r = np.maximum(apart[:-1], apart[1:])
        before = part.origin
        acceleration = acceleration + (angular + speed**2) * r
        r = r + (part.error if part.slides else 0.0)
        e_acceleration = e_acceleration + (e_angular + e_speed**2) * r
        lengths.append(r)
        errors.append(part.error)
        slides.append(part.slides)
        if part.slides:
            acceleration = acceleration + 2.0 * speed * part.amount
            e_acceleration = e_acceleration + 2.0 * e_speed * part.error
            continue
        angular = angular + part.amount * speed
        w0, w1 = w0 + part.rate[0], w1 + part.rate[1]
        ends = np.linalg.norm(w0, axis=1) + np.linalg.norm(w1, axis=1)
        speed = np.minimum(speed + part.amount, 0.5 * (ends + angular))
        e_angular, e_speed = e_angular + part.error * e_speed, e_speed + part.error
    turn = sum((part.amount for part in parts if not part.slides), zero)
    slide = sum((part.amount for part in parts if part.slides), zero)
    per_metre = angular + speed**2
    for c, error in enumerate(errors):
        if slides[c]:
            acceleration = acceleration + error * turn**2
        else:
            beyond = sum(lengths[c + 1 :], zero)
            acceleration = acceleration + error * (turn**2 * beyond + 2.0 * turn * slide)
            per_metre = per_metre + error * turn**2
    return MotionBounds(
        acceleration=acceleration,
        per_metre=per_metre,
        remainder=zero + 0.5 * e_acceleration,
        remainder_per_metre=zero + 0.5 * (e_angular + e_speed**2),
        origin=np.zeros(3) if before is None else at.R[body][0].T @ (before[0] - at.p[body][0]),
    )


@dataclass(frozen=True)
class _Part:
    """A joint of one degree of freedom: how much it moves in each segment, and where it is."""

    slides: bool
    origin: Array
    amount: Array
    rate: tuple[Array, Array]
    error: float


def _elementary(problem: Problem, at: Kinematics, steps: list[tuple[int, bool]]) -> list[_Part]:
    """A chain's joints; a free one is a slide and a turn, in the order in which they are met."""
    tree, parts = problem.tree, []
    for b, outward in steps:
        i, sign = int(tree.start[b]), 1.0 if outward else -1.0
        kind, side = tree.kind[b], 1 if outward else 0
        error = float(problem.deviation[i])
        none = (np.zeros(0), np.zeros(0))
        if kind == FREE:
            parent = int(tree.parent[b])
            R_PB = at.R[parent].swapaxes(1, 2) @ at.R[b]
            turn = Rotation.from_matrix(R_PB[1:] @ R_PB[:-1].swapaxes(1, 2)).as_rotvec()
            rate = tuple(
                sign * np.einsum("kij,kj->ki", R, turn)
                for R in (at.R[parent][:-1], at.R[parent][1:])
            )
            moved = np.linalg.norm(np.diff(at.q[:, i + 4 : i + 7], axis=0), axis=1)
            turned = np.linalg.norm(turn, axis=1)
            sliding = _Part(True, at.origin[b, side], moved, none, 0.0)
            turning = _Part(False, at.origin[b, 1], turned, (rate[0], rate[1]), 0.0)
            parts += [sliding, turning] if outward else [turning, sliding]
            continue
        change = np.diff(at.q[:, i])
        if kind == PRISMATIC:
            parts.append(_Part(True, at.origin[b, side], np.abs(change), none, error))
        else:
            both = sign * change[:, None] * at.axis[b][:-1], sign * change[:, None] * at.axis[b][1:]
            parts.append(_Part(False, at.origin[b, side], np.abs(change), both, error))
    return parts
