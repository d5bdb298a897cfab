"""Independent truth: distances of convex shapes by nonnegative least squares, random machines."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from scipy.optimize import nnls
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from pips_drake.twin.certificate.bodies import ConvexBody, stack_shapes
from pips_drake.twin.certificate.problem import Problem
from pips_drake.twin.certificate.tree import FREE, PRISMATIC, REVOLUTE, Tree

#: Of the polygon that stands for a circle.
SIDES = 96


@dataclass
class Solid:
    """conv(points) grown by a radius; a cylinder's circles are regular polygons in the circle."""

    body: int
    points: np.ndarray
    radius: float
    shape: ConvexBody


_ONE = np.array([0.0, 0.0, 0.0, 1.0])


class Truth:
    """Exact distances (but for polygons in place of circles) and kinematics of its own."""

    #: A cylinder's polygon lies inside by at most this part of its radius.
    polygon = 1.0 - np.cos(np.pi / SIDES)

    def core_distance(self, p: np.ndarray, q: np.ndarray) -> float:
        """Signed distance of two convex hulls, (N, 3) and (M, 3) m."""
        nearest = p.mean(axis=0) - q.mean(axis=0)
        columns: list[np.ndarray] = []
        for _ in range(300):
            # The corner of the difference that is lowest along the nearest point so far.
            corner = p[np.argmin(p @ nearest)] - q[np.argmax(q @ nearest)]
            square = nearest @ nearest
            if columns and square - nearest @ corner <= 1e-13 * (1.0 + square):
                return float(np.sqrt(square))
            if any((corner == column).all() for column in columns):
                return float(np.sqrt(square))
            columns.append(corner)
            # Lawson and Hanson's least distance programming: these nonnegative least squares are
            # the point of the corners' hull that is nearest to 0, but for a factor.
            weights, _ = nnls(np.vstack([np.array(columns).T, np.ones(len(columns))]), _ONE)
            nearest = np.array(columns).T @ weights / weights.sum()
            if np.linalg.norm(nearest) < 1e-7:
                return self._depth(p, q)
        return float(np.linalg.norm(nearest))  # rounding alone keeps it going

    def _depth(self, p: np.ndarray, q: np.ndarray) -> float:
        """Minus the penetration depth of hulls that overlap, m."""
        difference = (p[:, None] - q[None]).reshape(-1, 3)
        try:
            return float(ConvexHull(difference).equations[:, 3].max())
        except QhullError:
            return 0.0


@dataclass
class Machine:
    """Bodies on joints: a row (parent, kind, R_PF, p_PF, axis) each, the first being the world."""

    rows: list = field(default_factory=list)
    solids: list[Solid] = field(default_factory=list)

    @property
    def positions(self) -> int:
        return sum(7 if row[1] == FREE else 1 for row in self.rows)

    def poses(self, q: np.ndarray) -> list:
        """(rotation, origin) of each body in the world."""
        found, first = [(np.eye(3), np.zeros(3))], 0
        for parent, kind, R_PF, p_PF, axis in self.rows:
            R, p = found[parent]
            R_WF, p_WF = R @ R_PF, R @ p_PF + p
            if kind == REVOLUTE:
                R_FM, p_FM = Rotation.from_rotvec(q[first] * axis).as_matrix(), np.zeros(3)
            elif kind == PRISMATIC:
                R_FM, p_FM = np.eye(3), q[first] * axis
            else:
                w, x, y, z = q[first : first + 4]
                R_FM = Rotation.from_quat([x, y, z, w]).as_matrix()
                p_FM = q[first + 4 : first + 7]
            first += 7 if kind == FREE else 1
            found.append((R_WF @ R_FM, R_WF @ p_FM + p_WF))
        return found

    def between(self, q0: np.ndarray, q1: np.ndarray, s: float) -> np.ndarray:
        """Positions between knots; a free body turns about one axis at an even rate."""
        q, first = (1.0 - s) * q0 + s * q1, 0
        for row in self.rows:
            if row[1] == FREE:
                start, end = (
                    Rotation.from_quat(np.roll(k[first : first + 4], -1)) for k in (q0, q1)
                )
                turn = (start.inv() * end).as_rotvec()
                q[first : first + 4] = np.roll(
                    (start * Rotation.from_rotvec(s * turn)).as_quat(), 1
                )
            first += 7 if row[1] == FREE else 1
        return q

    def problem(self, pairs, knots, *, times=None, deviation=None) -> Problem:
        parent = np.array([0] + [row[0] for row in self.rows])
        kind = np.array([0] + [row[1] for row in self.rows])
        width = [7 if row[1] == FREE else 1 for row in self.rows]
        eye, zero = np.eye(3), np.zeros(3)
        count = len(self.rows) + 1
        tree = Tree(
            parent=parent,
            kind=kind,
            start=np.array([0, *np.cumsum([0, *width[:-1]])]),
            R_PF=np.array([eye] + [row[2] for row in self.rows]),
            p_PF=np.array([zero] + [row[3] for row in self.rows]),
            axis=np.array([zero] + [row[4] for row in self.rows]),
            R_MB=np.array([eye] * count),
            p_MB=np.array([zero] * count),
        )
        knots = np.ascontiguousarray(knots, dtype=float)
        labels = tuple(f"shape_{i}" for i in range(len(self.solids)))
        return Problem(
            tree=tree,
            shapes=stack_shapes([solid.shape for solid in self.solids]),
            names=labels,
            bodies=tuple(f"body_{solid.body}" for solid in self.solids),
            a=np.array([pair[0] for pair in pairs], dtype=np.int64),
            b=np.array([pair[1] for pair in pairs], dtype=np.int64),
            times=np.arange(len(knots), dtype=float) if times is None else times,
            knots=knots,
            deviation=np.zeros(self.positions) if deviation is None else deviation,
        )

    def least(self, truth: Truth, pairs, q, bound=np.inf) -> float:
        """Least distance of all pairs at a posture, unless it is above `bound`, m."""
        return min(bound, self.least_of(truth, pairs, [q]))

    def least_of(self, truth: Truth, pairs, postures) -> float:
        """Least distance of all pairs at some postures, (S, nq), m."""
        solids = self.solids
        poses = [self.poses(q) for q in postures]
        placed = [
            [solid.points @ at[solid.body][0].T + at[solid.body][1] for solid in solids]
            for at in poses
        ]
        least = np.inf
        for i, j in pairs:
            radii = solids[i].radius + solids[j].radius
            # Between two postures a distance changes by no more than points move.
            found, before = -np.inf, None
            for here in placed:
                p, q = here[i], here[j]
                if before is not None:
                    moved = sum(
                        np.sqrt(((x - y) ** 2).sum(axis=1).max())
                        for x, y in zip((p, q), before, strict=True)
                    )
                    if found - moved > least:
                        continue
                else:
                    centres = p.mean(axis=0), q.mean(axis=0)
                    reach = [
                        np.linalg.norm(x - c, axis=1).max()
                        for x, c in zip((p, q), centres, strict=True)
                    ]
                    found = np.linalg.norm(centres[0] - centres[1]) - sum(reach) - radii
                    before = (p, q)
                    if found > least:
                        continue
                found, before = truth.core_distance(p, q) - radii, (p, q)
                least = min(least, found)
        return least


def make_solid(rng, body: int, kind: str, *, size: float, place: np.ndarray) -> Solid:
    """A random solid of a kind at a place in its body."""
    R = Rotation.random(random_state=rng).as_matrix()
    e = size * rng.uniform(0.3, 1.0, 3)
    zero = np.zeros(3)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * e
    radius, disc, bulge, half = 0.0, 0.0, np.zeros((3, 3)), e
    if kind == "box":
        vertices = points = corners
    elif kind == "sphere":
        vertices = points = np.zeros((1, 3))
        radius, half = e[0], zero
    elif kind == "capsule":
        vertices = points = np.array([[0, 0, -e[2]], [0, 0, e[2]]])
        radius, half = 0.3 * e[0], np.array([0, 0, e[2]])
    elif kind == "cylinder":
        vertices, disc = np.array([[0, 0, -e[2]], [0, 0, e[2]]]), e[0]
        bulge = np.diag([e[0], e[0], 0.0])
        angles = np.arange(SIDES) * 2.0 * np.pi / SIDES
        circle = e[0] * np.column_stack([np.cos(angles), np.sin(angles), 0.0 * angles])
        points = np.vstack([circle + vertices[0], circle + vertices[1]])
        half = np.array([0, 0, e[2]])
    else:
        vertices = points = rng.uniform(-1.0, 1.0, (12, 3)) * e
    shape = ConvexBody(
        body=body,
        vertices=vertices @ R.T + place,
        bulge=R @ bulge,
        radius=radius,
        half_space=zero,
        centre=place,
        axes=R,
        half=half,
        disc=disc,
    )
    return Solid(body=body, points=points @ R.T + place, radius=radius, shape=shape)


def make_machine(rng, *, joints: int = 6, sliding: float = 0.2, moving_obstacle: bool = False):
    """A chain of random joints with a solid on each link, obstacles around it, and the pairs."""
    machine, kinds = Machine(), ["box", "sphere", "capsule", "cylinder", "mesh"]
    for j in range(joints):
        kind = PRISMATIC if rng.random() < sliding else REVOLUTE
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        place = np.array([0.0, 0.0, 0.4]) + 0.1 * rng.normal(size=3) if j else np.zeros(3)
        R = Rotation.from_rotvec(0.3 * rng.normal(size=3)).as_matrix()
        machine.rows.append((j, kind, R, place, axis))
        machine.solids.append(
            make_solid(rng, j + 1, rng.choice(kinds), size=0.2, place=np.array([0.0, 0.0, 0.2]))
        )
    arm = len(machine.solids)
    body = 0
    if moving_obstacle:
        machine.rows.append((0, FREE, np.eye(3), np.zeros(3), np.zeros(3)))
        machine.rows.append(
            (
                len(machine.rows),
                REVOLUTE,
                np.eye(3),
                0.2 * rng.normal(size=3),
                np.array([1.0, 0, 0]),
            )
        )
        body = len(machine.rows)
    for i in range(4):
        direction = rng.normal(size=3)
        place = direction / np.linalg.norm(direction) * rng.uniform(0.8, 2.0) + [0.0, 0.0, 1.0]
        moves = moving_obstacle and i < 2
        if moves:
            place = 0.3 * rng.normal(size=3)
        machine.solids.append(
            make_solid(rng, body if moves else 0, rng.choice(kinds), size=0.4, place=place)
        )
    scene = [(i, j) for i in range(arm) for j in range(arm, arm + 4)]
    own = [(j, i) for i in range(arm) for j in range(i + 3, arm)]
    return machine, scene, own


def random_knots(rng, machine: Machine, count: int, step: float) -> np.ndarray:
    """A random walk of the joints, (count, nq); free bodies drift about a point away from 0."""
    q = []
    for _, kind, *_ in machine.rows:
        if kind == FREE:
            q.append(
                np.concatenate(
                    [
                        Rotation.random(random_state=rng).as_quat(),
                        rng.normal([1.5, 0.0, 1.0]),
                    ]
                )
            )
        else:
            q.append(rng.uniform(-0.6, 0.6, 1))
    knots = [np.concatenate(q)]
    for _ in range(count - 1):
        new, first = knots[-1] + step * rng.normal(size=machine.positions), 0
        for _, kind, *_ in machine.rows:
            if kind == FREE:
                new[first : first + 4] /= np.linalg.norm(new[first : first + 4])
            first += 7 if kind == FREE else 1
        knots.append(new)
    return np.array(knots)


@pytest.fixture(scope="session")
def truth() -> Truth:
    return Truth()


@pytest.fixture(scope="session")
def random_machine():
    return make_machine


@pytest.fixture(scope="session")
def random_walk():
    return random_knots
