"""Exact distances at single instants, and where the nearest of them was."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pips_drake.twin.certificate.bound import relative
from pips_drake.twin.certificate.distance import Closest, closest
from pips_drake.twin.certificate.motion import chain
from pips_drake.twin.certificate.problem import Problem
from pips_drake.twin.certificate.tree import PRISMATIC, Poses, calc_poses, interpolate

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Witness:
    """Where a pair comes nearest.

    Attributes:
        pair: index of the pair.
        bodies, geometries: names, the robot's first.
        time: s.
        segment, fraction: where on the path.
        distance: m; the true distance there is no more.
        points: nearest points on both, in the world, (2, 3) m.
        deviation: how far the positions are off there, (nq,).
        closest: the proof of the distance.
    """

    pair: int
    bodies: tuple[str, str]
    geometries: tuple[str, str]
    time: float
    segment: int
    fraction: float
    distance: float
    points: Array
    deviation: Array
    closest: Closest = field(repr=False)


class Distances:
    """Distances of a problem's pairs at instants, each computed once.

    Attributes:
        queries: how many were computed; with joint errors an instant takes two.
        witness: the least of all so far; None before the first.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.queries = 0
        self.witness: Witness | None = None
        self._known: dict[tuple[int, int, float], Closest] = {}

    @property
    def least(self) -> float:
        """The witness's distance, m; infinite before the first."""
        return math.inf if self.witness is None else self.witness.distance

    def query(self, p: int, segment: int, fraction: float) -> Closest:
        """The pair's distance at an instant; remembers the least of all."""
        if fraction == 1.0:
            segment, fraction = segment + 1, 0.0
        key = (p, segment, fraction)
        if key in self._known:
            return self._known[key]
        problem = self.problem
        if fraction == 0.0:
            q = problem.knots[segment]
        else:
            q = interpolate(
                problem.tree, problem.knots[segment], problem.knots[segment + 1], fraction
            )
        found, poses = self._closest(p, q)
        self._known[key] = found
        off = np.zeros(len(q))
        self._remember(p, segment, fraction, found, poses, off)
        if problem.deviation.any():
            off = self._worst_errors(p, found, poses)
            worse, poses = self._closest(p, q + off)
            self._remember(p, segment, fraction, worse, poses, off)
        return found

    def _closest(self, p: int, q: Array) -> tuple[Closest, Poses]:
        self.queries += 1
        problem = self.problem
        poses = calc_poses(problem.tree, q[None])
        a, b = int(problem.a[p]), int(problem.b[p])
        R, t = np.empty((3, 3)), np.empty(3)
        relative(
            poses.rotation[0],
            poses.position[0],
            problem.shapes.body[a],
            problem.shapes.body[b],
            R,
            t,
        )
        return closest(problem.shapes, a, b, R, t), poses

    def _worst_errors(self, p: int, found: Closest, poses: Poses) -> Array:
        """The joint errors that bring the nearest points nearer, to first order, (nq,)."""
        problem, tree = self.problem, self.problem.tree
        body = problem.shapes.body[problem.b[p]]
        R, t = poses.rotation[0, body], poses.position[0, body]
        normal, point = R @ found.normal, R @ found.points[0] + t
        off = np.zeros(problem.knots.shape[1])
        for joint, sign in chain(tree, int(body), int(problem.shapes.body[problem.a[p]])):
            i = int(tree.start[joint])
            axis = poses.axis[0, joint]
            moves = axis
            if tree.kind[joint] != PRISMATIC:
                moves = np.cross(axis, point - poses.origin[0, joint, 1])
            off[i] = -np.sign(sign * (normal @ moves)) * problem.deviation[i]
        return off

    def _remember(
        self, p: int, segment: int, fraction: float, found: Closest, poses: Poses, off: Array
    ) -> None:
        if found.upper >= self.least:
            return
        problem = self.problem
        body = problem.shapes.body[problem.b[p]]
        R, t = poses.rotation[0, body], poses.position[0, body]
        a, b = int(problem.a[p]), int(problem.b[p])
        times = problem.times
        time_ = float(times[segment])
        if fraction > 0.0:
            time_ += fraction * float(times[segment + 1] - times[segment])
        self.witness = Witness(
            pair=p,
            bodies=(problem.bodies[a], problem.bodies[b]),
            geometries=(problem.names[a], problem.names[b]),
            time=time_,
            segment=segment,
            fraction=fraction,
            distance=found.upper,
            points=found.points @ R.T + t,
            deviation=off,
            closest=found,
        )
