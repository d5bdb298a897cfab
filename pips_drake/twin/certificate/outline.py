"""What bounds shapes coarsely: balls about them, and how far joint errors move them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pips_drake.twin.certificate.bodies import Shapes
from pips_drake.twin.certificate.tree import FREE, PRISMATIC, REVOLUTE, Tree

Array = NDArray[np.float64]


class Outline(NamedTuple):
    """Of each shape, (S,): what bounds it coarsely.

    Attributes:
        centre: of a ball about it, in its body, (S, 3) m.
        ball: the ball's radius, m.
        reach: how far its core is from its body's joint, at most, m.
        error: by how much joint errors move its points, at most, m.
    """

    centre: Array
    ball: Array
    reach: Array
    error: Array


def make_outline(tree: Tree, shapes: Shapes, knots: Array, deviation: Array) -> Outline:
    """Coarse bounds of shapes on a tree whose joints may be off by `deviation`, (nq,)."""
    at, by_reach = _error_balls(tree, knots, deviation)
    # The joint's point in its body, about which `Sweep` measures.
    joint = -np.einsum("bji,bj->bi", tree.R_MB, tree.p_MB)
    count = len(shapes.body)
    centre, ball, reach = np.empty((count, 3)), np.empty(count), np.empty(count)
    bulges = np.linalg.norm(shapes.bulge, ord=2, axis=(1, 2))
    for s in range(count):
        vertices = shapes.vertices[shapes.starts[s] : shapes.starts[s + 1]]
        centre[s] = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
        ball[s] = np.linalg.norm(vertices - centre[s], axis=1).max()
        reach[s] = np.linalg.norm(vertices - joint[shapes.body[s]], axis=1).max()
    reach += bulges
    ball += bulges + shapes.radius
    ball[shapes.half_space.any(axis=1)] = np.inf
    return Outline(centre, ball, reach, at[shapes.body] + by_reach[shapes.body] * reach)


def _error_balls(tree: Tree, knots: Array, deviation: Array) -> tuple[Array, Array]:
    """By how much joint errors move points of each body, (B,) m and m by metre from its joint.

    The errors are made one after the other, from the body inward. Each turns what lies beyond its
    joint by no more than itself, so a point goes no farther than the error times its distance from
    the joint, which is no longer than the way along the chain.
    """
    at, by_reach = np.zeros(len(tree.parent)), np.zeros(len(tree.parent))
    if not deviation.any():
        return at, by_reach
    for b in range(1, len(tree.parent)):
        kind, a, i = tree.kind[b], int(tree.parent[b]), int(tree.start[b])
        error = 0.0 if kind == FREE else float(deviation[i])
        # From the parent's joint to this body's, at most.
        step = float(np.linalg.norm(tree.p_PF[b] + tree.R_MB[a].T @ tree.p_MB[a]))
        if kind == PRISMATIC:
            step += float(np.abs(knots[:, i]).max()) + error
        elif kind == FREE:
            step += float(np.linalg.norm(knots[:, i + 4 : i + 7], axis=1).max())
        at[b] = at[a] + by_reach[a] * step + (error if kind == PRISMATIC else 0.0)
        by_reach[b] = by_reach[a] + (error if kind == REVOLUTE else 0.0)
    return at, by_reach
