"""What planes and a witness prove, computed anew with numpy alone.

Nothing here is shared with the code that found the planes: neither kinematics nor motion bounds.
The theorem is the one of docs/certificate.md; a plane that is fixed over several segments is the
case n0 = n1 on each of them. Planes over whole blocks are in `recheck_swept`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from pips_drake.twin.certificate.problem import Problem
from pips_drake.twin.certificate.proof import Proof
from pips_drake.twin.certificate.recheck_motion import (
    Kinematics,
    MotionBounds,
    chain_of,
    motion_bounds,
    postures,
)
from pips_drake.twin.certificate.recheck_swept import lowest_of_quadratics, proved_by_sweeps
from pips_drake.twin.certificate.tree import FREE, PRISMATIC

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def proved_lower(proof: Proof) -> float:
    """The least bound that the planes prove, m."""
    problem = proof.problem
    at_knots = Kinematics(problem.tree, problem.knots)
    if np.setdiff1d(np.arange(len(problem.a)), proof.pair).size:
        return -np.inf
    bounds: dict[tuple[int, int], MotionBounds] = {}
    order = np.flatnonzero(~proof.swept)
    order = order[np.argsort(proof.pair[order], kind="stable")]
    splits = np.searchsorted(proof.pair[order], np.arange(len(problem.a) + 1))
    # Parts of segments need poses of their own; all of them at once.
    part = np.flatnonzero((proof.start > 0.0) | (proof.end < 1.0))
    at_parts = [
        Kinematics(problem.tree, postures(problem, proof.first[part], fraction[part]))
        for fraction in (proof.start, proof.end)
    ]
    lowest = proved_by_sweeps(proof, at_knots)
    for p in np.flatnonzero(np.diff(splits)).tolist():
        rows = order[splits[p] : splits[p + 1]]
        body_a = int(problem.shapes.body[problem.a[p]])
        body_b = int(problem.shapes.body[problem.b[p]])
        steps = chain_of(problem.tree, body_b, body_a)
        if (body_b, body_a) not in bounds:
            bounds[body_b, body_a] = motion_bounds(problem, at_knots, steps, body_a)
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
    moving: MotionBounds,
    begin: tuple[Kinematics, Indices],
    end: tuple[Kinematics, Indices],
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
    least = lowest_of_quadratics(*coefficients).min(axis=1)
    return float(np.where(least < 0.0, least / half, least).min())


def _seen(at: tuple[Kinematics, Indices], i: int, j: int, normal: Array) -> tuple[Array, Array]:
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
    ends: tuple[tuple[Kinematics, Indices], tuple[Kinematics, Indices]],
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
    q = postures(problem, np.array([segment]), np.array([fraction])) + proof.off
    at = Kinematics(problem.tree, q)
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
