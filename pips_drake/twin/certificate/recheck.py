"""What planes and a witness prove, computed anew with numpy alone.

Nothing here is shared with the code that found the planes: neither kinematics nor motion bounds.
The theorem is the one of docs/certificate.md; a plane that is fixed over several segments is the
case n0 = n1 on each of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from pips_drake.twin.certificate.problem import Problem
from pips_drake.twin.certificate.proof import Proof
from pips_drake.twin.certificate.tree import FREE, PRISMATIC, REVOLUTE, Tree

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class _Kinematics:
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


def _postures(problem: Problem, segment: Indices, fraction: Array) -> Array:
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


def _chain(tree: Tree, base: int, body: int) -> list[tuple[int, bool]]:
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
class _MotionBounds:
    """Of one chain, over all segments: |p''| <= acceleration + per_metre * reach, and so on.

    `origin` is that of the last joint, in the last body, (3,) m.
    """

    acceleration: Array
    per_metre: Array
    remainder: Array
    remainder_per_metre: Array
    origin: Array


def _motion_bounds(
    problem: Problem, at: _Kinematics, steps: list[tuple[int, bool]], body: int
) -> _MotionBounds:
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
    return _MotionBounds(
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


def _elementary(problem: Problem, at: _Kinematics, steps: list[tuple[int, bool]]) -> list[_Part]:
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


def proved_lower(proof: Proof) -> float:
    """The least bound that the planes prove, m."""
    problem = proof.problem
    at_knots = _Kinematics(problem.tree, problem.knots)
    bounds: dict[tuple[int, int], _MotionBounds] = {}
    order = np.argsort(proof.pair, kind="stable")
    splits = np.searchsorted(proof.pair[order], np.arange(len(problem.a) + 1))
    # Parts of segments need poses of their own; all of them at once.
    part = np.flatnonzero((proof.start > 0.0) | (proof.end < 1.0))
    at_parts = [
        _Kinematics(problem.tree, _postures(problem, proof.first[part], fraction[part]))
        for fraction in (proof.start, proof.end)
    ]
    lowest = np.inf
    for p in range(len(problem.a)):
        rows = order[splits[p] : splits[p + 1]]
        if not len(rows):
            return -np.inf
        body_a = int(problem.shapes.body[problem.a[p]])
        body_b = int(problem.shapes.body[problem.b[p]])
        steps = _chain(problem.tree, body_b, body_a)
        if (body_b, body_a) not in bounds:
            bounds[body_b, body_a] = _motion_bounds(problem, at_knots, steps, body_a)
        moving = bounds[body_b, body_a]
        whole = rows[(proof.start[rows] == 0.0) & (proof.end[rows] == 1.0)]
        repeat = proof.last[whole] - proof.first[whole]
        record = np.repeat(whole, repeat)
        within = np.arange(len(record)) - np.repeat(np.cumsum(repeat) - repeat, repeat)
        segment = proof.first[record] + within
        ends = (at_knots, segment), (at_knots, segment + 1)
        share = np.ones(len(segment))
        found = _least_bound(
            problem, p, steps, moving, *ends, proof.normals[record], segment, share
        )
        lowest = min(lowest, found)
        mine = np.flatnonzero(proof.pair[part] == p)
        record = part[mine]
        segment, share = proof.first[record], proof.end[record] - proof.start[record]
        ends = (at_parts[0], mine), (at_parts[1], mine)
        found = _least_bound(
            problem, p, steps, moving, *ends, proof.normals[record], segment, share
        )
        lowest = min(lowest, found)
    return lowest


def _least_bound(
    problem: Problem,
    p: int,
    steps: list[tuple[int, bool]],
    moving: _MotionBounds,
    begin: tuple[_Kinematics, Indices],
    end: tuple[_Kinematics, Indices],
    normals: Array,
    segment: Indices,
    width: Array,
) -> float:
    """The least bound over K parts of segments with a normal that turns on each, m."""
    if not len(segment):
        return np.inf
    shapes = problem.shapes
    a, b = int(problem.a[p]), int(problem.b[p])
    rows = slice(int(shapes.starts[a]), int(shapes.starts[a + 1]))
    vertices, bulge, radius = shapes.vertices[rows], shapes.bulge[a], float(shapes.radius[a])
    i, j = int(shapes.body[a]), int(shapes.body[b])
    n0, n1 = normals[:, 0], normals[:, 1]
    half = 0.5 * np.linalg.norm(n0 + n1, axis=1)
    if not (half > 0.0).all():
        return -np.inf
    h0, h1 = _support(problem, b, n0), _support(problem, b, n1)
    farthest = np.linalg.norm(vertices - moving.origin, axis=1).max()
    reach = float(farthest + np.linalg.norm(bulge, 2)) if steps else 0.0
    bend = (moving.acceleration + moving.per_metre * reach)[segment] * width**2
    away = radius + (moving.remainder + moving.remainder_per_metre * reach)[segment]
    # Three directions in a's body, and the same of the origins: coefficients 0, 1 and 2.
    one, same = _seen(begin, i, j, n0), _seen(end, i, j, n1)
    crosswise = zip(_seen(end, i, j, n0), _seen(begin, i, j, n1), strict=True)
    cross = [0.5 * (u + v) for u, v in crosswise]
    coefficients = []
    for (direction, offset), top, extra in (
        (one, h0, 0.0),
        (cross, 0.5 * (h0 + h1), 0.25 * bend),
        (same, h1, 0.0),
    ):
        value = direction @ vertices.T + offset[:, None]
        value -= np.linalg.norm(direction @ bulge, axis=1)[:, None]
        coefficients.append(value - (top + away + extra)[:, None])
    if problem.deviation.any():
        _take_errors(problem, steps, (begin, end), (n0, n1), (i, j), vertices, bulge, coefficients)
    b0, b1, b2 = coefficients
    # The lowest value of each quadratic over [0, 1]. Inside it is b1 + u v / (u + v): nothing
    # cancels where u and v are only rounding.
    u, v = b0 - b1, b2 - b1
    inside = (u > 0.0) & (v > 0.0)
    share = np.divide(v, u + v, out=np.zeros_like(v), where=inside)
    least = np.where(inside, b1 + u * share, np.minimum(b0, b2)).min(axis=1)
    return float(np.where(least < 0.0, least / half, least).min())


def _seen(at: tuple[_Kinematics, Indices], i: int, j: int, normal: Array) -> tuple[Array, Array]:
    """A normal in b's body (K, 3): as a's body sees it, and along it the way from b to a."""
    poses, k = at
    world = np.einsum("kij,kj->ki", poses.R[j][k], normal)
    direction = np.einsum("kij,ki->kj", poses.R[i][k], world)
    return direction, np.einsum("ki,ki->k", world, poses.p[i][k] - poses.p[j][k])


def _support(problem: Problem, s: int, normal: Array) -> Array:
    """Support of a shape in its body's frame along normals (K, 3), m."""
    shapes = problem.shapes
    if shapes.half_space[s].any():
        same = (normal == shapes.half_space[s]).all(axis=1)
        plane = normal @ shapes.vertices[shapes.starts[s]]
        return np.where(same, plane, np.inf)
    vertices = shapes.vertices[shapes.starts[s] : shapes.starts[s + 1]]
    top: Array = (normal @ vertices.T).max(axis=1)
    return top + np.linalg.norm(normal @ shapes.bulge[s], axis=1) + shapes.radius[s]


def _take_errors(
    problem: Problem,
    steps: list[tuple[int, bool]],
    ends: tuple[tuple[_Kinematics, Indices], tuple[_Kinematics, Indices]],
    normals: tuple[Array, Array],
    bodies: tuple[int, int],
    vertices: Array,
    bulge: Array,
    coefficients: list[Array],
) -> None:
    """Takes from the coefficients what joint errors move each vertex along the normal."""
    i, j = bodies
    for joint, _ in steps:
        error = float(problem.deviation[problem.tree.start[joint]])
        if error == 0.0 or problem.tree.kind[joint] == FREE:
            continue
        slides = problem.tree.kind[joint] == PRISMATIC

        def moved(
            end: int, which: int, joint: int = joint, slides: bool = slides
        ) -> tuple[Array, Array]:
            poses, k = ends[end]
            world = np.einsum("kij,kj->ki", poses.R[j][k], normals[which])
            if slides:
                along = np.einsum("ki,ki->k", world, poses.axis[joint][k])
                return np.zeros_like(world), along
            lever = np.cross(world, poses.axis[joint][k])
            offset = np.einsum("ki,ki->k", lever, poses.p[i][k] - poses.origin[joint, 0][k])
            return np.einsum("kij,ki->kj", poses.R[i][k], lever), offset

        first, last = moved(0, 0), moved(1, 1)
        middle = [0.5 * (u + v) for u, v in zip(moved(1, 0), moved(0, 1), strict=True)]
        for c, (lever, offset) in enumerate((first, middle, last)):
            most = np.abs(lever @ vertices.T + offset[:, None])
            coefficients[c] -= error * (most + np.linalg.norm(lever @ bulge, axis=1)[:, None])


def proved_upper(proof: Proof) -> float:
    """What the witness proves, m."""
    problem, shapes = proof.problem, proof.problem.shapes
    p, segment, fraction = proof.witness
    a, b = int(problem.a[p]), int(problem.b[p])
    q = _postures(problem, np.array([segment]), np.array([fraction])) + proof.off
    at = _Kinematics(problem.tree, q)
    i, j = int(shapes.body[a]), int(shapes.body[b])
    R = at.R[j][0].T @ at.R[i][0]
    t = at.R[j][0].T @ (at.p[i][0] - at.p[j][0])
    radii = float(shapes.radius[a] + shapes.radius[b])
    on = [
        _points_of(problem, shape, proof.vertices[:, side], proof.balls[:, side])
        for side, shape in enumerate((a, b))
    ]
    used = proof.weights > 0.0
    points = [proof.weights[used] @ mine[used] for mine in on]
    if not np.isfinite(points).all():
        return np.inf
    if shapes.half_space[b].any():
        normal = shapes.half_space[b]
        return float(normal @ (R @ points[0] + t - shapes.vertices[shapes.starts[b]])) - radii
    upper = float(np.linalg.norm(R @ points[0] + t - points[1]) - radii)
    if len(proof.hull_vertices):
        corners = [
            _points_of(problem, shape, proof.hull_vertices[:, side], proof.hull_balls[:, side])
            for side, shape in enumerate((a, b))
        ]
        upper = min(upper, -_ball_in_hull(corners[0] @ R.T + t - corners[1]) - radii)
    return upper


def _points_of(problem: Problem, s: int, rows: Indices, balls: Array) -> Array:
    """Points of a shape's core in its body's frame; NaN for a vertex that is not its own."""
    shapes = problem.shapes
    own = (rows >= shapes.starts[s]) & (rows < shapes.starts[s + 1])
    points = shapes.vertices[np.where(own, rows, shapes.starts[s])] + balls @ shapes.bulge[s].T
    return np.where(own[:, None], points, np.nan)


def _ball_in_hull(points: Array) -> float:
    """Radius of the ball about 0 in the hull of points (H, 3) m; 0 if 0 is not inside."""
    if not np.isfinite(points).all():
        return 0.0
    try:
        return max(0.0, -float(ConvexHull(points).equations[:, 3].max()))
    except QhullError:
        return 0.0
