"""A motion and pairs of bodies, and what bounds of their distances need to be computed once."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pips_drake.errors import InputError
from pips_drake.twin.certificate.bodies import Shapes
from pips_drake.twin.certificate.bound import Motion, Pairs
from pips_drake.twin.certificate.motion import (
    UNBOUNDED,
    bending,
    chain,
    error_terms,
    stack_chains,
)
from pips_drake.twin.certificate.tree import FIXED, FREE, PRISMATIC, Poses, Tree, calc_poses

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Free bodies must turn less than this from knot to knot, rad: which way round would be unclear.
LARGEST_TURN = 3.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """A motion and the pairs whose distance counts.

    Attributes:
        tree: kinematics; positions are the plant's.
        shapes, names: the bodies; names are those of body and geometry.
        bodies: the shapes' plant bodies, by their scoped names.
        a, b: the pairs' shapes, (P,) each.
        times: of the knots, (N,) s.
        knots: (N, nq).
        deviation: how far each position may be off, (nq,) m and rad.
    """

    tree: Tree
    shapes: Shapes
    names: tuple[str, ...]
    bodies: tuple[str, ...]
    a: Indices
    b: Indices
    times: Array
    knots: Array
    deviation: Array


class Prepared:
    """A problem with what its search needs: poses, chains and motion bounds.

    Args:
        poses: at the knots, if they are known.
        pairs: those that will be asked for, all by default; of others nothing can be proved.
        segments: likewise, (N - 1,) bool.
    """

    def __init__(
        self,
        problem: Problem,
        *,
        poses: Poses | None = None,
        pairs: Indices | None = None,
        segments: NDArray[np.bool_] | None = None,
    ) -> None:
        self.problem = problem
        check_free_turns(problem.tree, problem.knots)
        tree, shapes, knots = problem.tree, problem.shapes, problem.knots
        self.poses: Poses = calc_poses(tree, knots) if poses is None else poses
        mine = np.arange(len(problem.a)) if pairs is None else pairs
        wanted = np.ones(len(knots) - 1, dtype=np.bool_) if segments is None else segments
        between: dict[tuple[int, int], int] = {}
        # One row more than there are chains, for the others.
        rows = np.full(len(problem.a), -1, dtype=np.int64)
        base, body = shapes.body[problem.b[mine]].tolist(), shapes.body[problem.a[mine]].tolist()
        for p, ends in zip(mine.tolist(), zip(base, body, strict=True), strict=True):
            rows[p] = between.setdefault(ends, len(between))
        rows[rows < 0] = len(between)
        chains = [chain(tree, base, body) for base, body in between]
        bodies, signs = stack_chains([*chains, []])
        at_origin, by_reach = bending(tree, self.poses, knots, bodies, signs, wanted)
        at_origin[-1] = UNBOUNDED
        self.motion = _make_motion(problem, self.poses, bodies, signs, at_origin, by_reach)
        self.pairs = Pairs(problem.a, problem.b, rows, self._reach(chains, rows, mine))

    def _reach(self, chains: list[list[tuple[int, int]]], rows: Indices, mine: Indices) -> Array:
        """How far a pair's a is from the last origin of its chain, at most, (P,) m."""
        problem, shapes = self.problem, self.problem.shapes
        found: dict[tuple[int, int], float] = {}
        reach = np.zeros(len(problem.a))
        shape_of, row_of = problem.a[mine].tolist(), rows[mine].tolist()
        for p, shape, row in zip(mine.tolist(), shape_of, row_of, strict=True):
            if not chains[row]:
                continue
            if (shape, row) not in found:
                joint, sign = chains[row][-1]
                body = shapes.body[shape]
                R, t = self.poses.rotation[0, body], self.poses.position[0, body]
                origin = R.T @ (self.poses.origin[0, joint, 1 if sign > 0 else 0] - t)
                vertices = shapes.vertices[shapes.starts[shape] : shapes.starts[shape + 1]]
                bulge = np.linalg.norm(shapes.bulge[shape], 2)
                farthest = np.linalg.norm(vertices - origin, axis=1).max()
                found[shape, row] = float(farthest + bulge)
            reach[p] = found[shape, row]
        return reach


def _make_motion(
    problem: Problem,
    poses: Poses,
    bodies: Indices,
    signs: Indices,
    at_origin: Array,
    by_reach: Array,
) -> Motion:
    tree = problem.tree
    deviates = bool(problem.deviation.any())
    deviation = np.where(tree.kind == FIXED, 0.0, problem.deviation[tree.start])
    rest, rest_by_reach = np.zeros_like(at_origin), np.zeros_like(at_origin)
    if deviates:
        more, more_by_reach, rest, rest_by_reach = error_terms(
            tree, poses, problem.knots, bodies, signs, deviation
        )
        at_origin, by_reach = at_origin + more, by_reach + more_by_reach
    return Motion(
        bodies=bodies,
        signs=signs,
        at_origin=at_origin,
        by_reach=by_reach,
        deviates=deviates,
        deviation=deviation,
        slides=tree.kind == PRISMATIC,
        remainder_at_origin=rest,
        remainder_by_reach=rest_by_reach,
    )


def check_free_turns(tree: Tree, knots: Array) -> None:
    """Refuses a motion of which it is not clear which way round a free body turns.

    Raises:
        InputError: a free body turns too far between two knots.
    """
    for b in np.flatnonzero(tree.kind == FREE):
        i = int(tree.start[b])
        quaternions = knots[:, i : i + 4]
        quaternions = quaternions / np.linalg.norm(quaternions, axis=1)[:, None]
        cosines = np.abs(np.einsum("ij,ij->i", quaternions[1:], quaternions[:-1]))
        turn = 2.0 * math.acos(min(1.0, float(cosines.min())))
        if not turn < LARGEST_TURN:
            raise InputError(
                f"a free body turns {turn:.3g} rad between two knots; must be < {LARGEST_TURN:g}"
            )
