"""Do convex bodies meet, which plane is between them, how far apart are they: exactly.

Two convex polyhedra are apart exactly when their projections are apart along a face's normal of
either, or along the product of an edge of the one with an edge of the other (Gottschalk, Lin &
Manocha, OBBTree, 1996, section 5, for boxes). Along such an axis lies the depth, too, by which
bodies that meet must be moved to be apart. RMS-71 (section IV.A.1) could afford a part of these
axes only; see `hexahedra`.

A plane between two bodies has the first on its TRUE side, where A X + B Y + C Z > D.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.remote_manipulator.convex_kernels import (
    EDGE_PAIR,
    FACE_OF_FIRST,
    FACE_OF_SECOND,
    PackedBodies,
    distances,
    separate,
)
from pips_drake.remote_manipulator.polyhedra import (
    HEXAHEDRON_EDGES,
    HEXAHEDRON_FACES,
    ConvexBody,
    vertices_inside,
)

__all__ = [
    "EDGE_PAIR",
    "FACE_OF_FIRST",
    "FACE_OF_SECOND",
    "BodySet",
    "ConvexBody",
    "Distance",
    "Separation",
    "distance",
    "exact_collision",
    "separation",
    "vertices_inside",
]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]
Poses = tuple[Array, Array, Array, Array]

# Edges of hexahedra are parallel when they differ by less than this part of their length.
_SAME = 1e-12


@dataclass(frozen=True, eq=False)
class Separation:
    """N pairs of convex bodies.

    Attributes:
        separation: (N,) m. Where bodies are apart, the largest gap between their projections onto
            an axis, no more than their distance; where they meet, minus the depth.
        normal: the axis, unit vectors from second to first, (N, 3). First moved along it by the
            depth only touches second.
        plane: in the middle of the gap, first on its TRUE side, (N, 4); NaN where they meet.
        axis: FACE_OF_FIRST, FACE_OF_SECOND or EDGE_PAIR: where the axis comes from, (N,).
    """

    separation: Array
    normal: Array
    plane: Array
    axis: Indices

    @property
    def collides(self) -> Flags:
        """Which pairs meet; touching is meeting, (N,)."""
        return self.separation <= 0.0


@dataclass(frozen=True, eq=False)
class Distance:
    """N pairs of convex bodies.

    Attributes:
        distance: (N,) m; where bodies meet, minus the depth.
        points: nearest points of first and second, (N, 2, 3) m; NaN where they meet.
        separation: of the same pairs.
    """

    distance: Array
    points: Array
    separation: Separation


class BodySet:
    """Bodies of one frame, to be tested against each other in one call."""

    def __init__(self, bodies: Iterable[ConvexBody]) -> None:
        self.bodies = tuple(bodies)
        self._packed = _packed(
            [body.vertices for body in self.bodies],
            [body.face_normals for body in self.bodies],
            [body.edge_directions for body in self.bodies],
            [body.edges for body in self.bodies],
            [_sides(body) for body in self.bodies],
        )

    def separations(self, pairs: ArrayLike, R: ArrayLike, p: ArrayLike) -> Separation:
        """Separation of N pairs of the set's bodies.

        Args:
            pairs: which bodies, (N, 2).
            R, p: poses of all B bodies in one frame, (B, 3, 3), (B, 3) m.
        """
        chosen = np.asarray(pairs, dtype=np.int64)
        return _separations(self._packed, chosen, _poses_of(chosen, R, p))

    def distances(self, pairs: ArrayLike, R: ArrayLike, p: ArrayLike) -> Distance:
        """Distance of N pairs of the set's bodies; arguments as of `separations`."""
        chosen = np.asarray(pairs, dtype=np.int64)
        return _distances(self._packed, chosen, _poses_of(chosen, R, p))

    def separation(
        self, R_first: ArrayLike, p_first: ArrayLike, R_second: ArrayLike, p_second: ArrayLike
    ) -> Separation:
        """Separation of the set's first two bodies at N poses, as `separation`."""
        poses = _broadcast(R_first, p_first, R_second, p_second)
        return _separations(self._packed, _first_two(poses), poses)

    def distance(
        self, R_first: ArrayLike, p_first: ArrayLike, R_second: ArrayLike, p_second: ArrayLike
    ) -> Distance:
        """Distance of the set's first two bodies at N poses, as `distance`."""
        poses = _broadcast(R_first, p_first, R_second, p_second)
        return _distances(self._packed, _first_two(poses), poses)


def separation(
    first: ConvexBody,
    R_first: ArrayLike,
    p_first: ArrayLike,
    second: ConvexBody,
    R_second: ArrayLike,
    p_second: ArrayLike,
) -> Separation:
    """Separation of two bodies at N poses.

    Args:
        first, second: the bodies.
        R_first, p_first, R_second, p_second: poses in one frame, (N, 3, 3) or (3, 3), (N, 3) or
            (3,) m.
    """
    return BodySet((first, second)).separation(R_first, p_first, R_second, p_second)


def distance(
    first: ConvexBody,
    R_first: ArrayLike,
    p_first: ArrayLike,
    second: ConvexBody,
    R_second: ArrayLike,
    p_second: ArrayLike,
) -> Distance:
    """Distance of two bodies at N poses; arguments as of `separation`."""
    return BodySet((first, second)).distance(R_first, p_first, R_second, p_second)


def exact_collision(first: ArrayLike, second: ArrayLike) -> Separation:
    """Separation of convex hexahedra given by their vertices alone.

    Args:
        first, second: vertices in `HEXAHEDRON_FACES`' notation, in one frame, (N, 8, 3) m.
    """
    both = np.concatenate([np.asarray(first, dtype=float), np.asarray(second, dtype=float)])
    count = len(both) // 2
    ends = both[:, HEXAHEDRON_EDGES]
    directions = ends[:, :, 1] - ends[:, :, 0]
    classes = directions.reshape(-1, 3, 4, 3)
    uneven = abs(classes - classes[:, :, :1]).max(initial=0.0)
    if uneven <= _SAME * abs(directions).max(initial=0.0):  # boxes: a third of edges and faces do
        directions = classes[:, :, 0]
        normals = np.cross(directions, np.roll(directions, 1, axis=1))
    else:
        # The diagonals' product is a plane quadrangle's normal.
        corners = both[:, HEXAHEDRON_FACES]
        normals = np.cross(corners[:, :, 2] - corners[:, :, 0], corners[:, :, 3] - corners[:, :, 1])
    nothing = np.empty((0, 0))
    bodies = PackedBodies(
        both.reshape(-1, 3),
        _starts(len(both), 8),
        _units(normals),
        _starts(len(both), normals.shape[1]),
        _units(directions),
        _starts(len(both), directions.shape[1]),
        nothing.astype(np.int64),
        _starts(0, 0),
        nothing,
        _starts(0, 0),
    )
    here = _broadcast(np.eye(3), np.zeros((count, 3)), np.eye(3), np.zeros((count, 3)))
    return _separations(bodies, np.arange(2 * count).reshape(2, count).T, here)


def _sides(body: ConvexBody) -> Array:
    """`PackedBodies.sides` of one body, (S, 8)."""
    rows = []
    for face, plane in zip(body.faces, body.planes, strict=True):
        for i, j in zip(face, face[1:] + face[:1], strict=True):
            out = np.cross(body.vertices[j] - body.vertices[i], plane[:3])
            out /= np.linalg.norm(out)
            rows.append([*plane, *out, out @ body.vertices[i]])
    return np.array(rows)


def _units(vectors: Array) -> Array:
    """Unit vectors, (N K, 3)."""
    return (vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)).reshape(-1, 3)


def _starts(bodies: int, each: int) -> Indices:
    return np.arange(bodies + 1, dtype=np.int64) * each


def _packed(*lists: Sequence[NDArray]) -> PackedBodies:
    arrays: list[NDArray] = []
    for rows in lists:
        arrays.append(np.ascontiguousarray(np.concatenate(rows)))
        arrays.append(np.concatenate([[0], np.cumsum([len(r) for r in rows])]).astype(np.int64))
    return PackedBodies(*arrays)


def _poses_of(pairs: Indices, R: ArrayLike, p: ArrayLike) -> Poses:
    rotations, places = np.ascontiguousarray(R, dtype=float), np.ascontiguousarray(p, dtype=float)
    one, two = pairs[:, 0], pairs[:, 1]
    return rotations[one], places[one], rotations[two], places[two]


def _broadcast(
    R_first: ArrayLike, p_first: ArrayLike, R_second: ArrayLike, p_second: ArrayLike
) -> Poses:
    """Poses as (N, 3, 3) and (N, 3)."""
    rotations = [np.asarray(R, dtype=float) for R in (R_first, R_second)]
    places = [np.asarray(p, dtype=float) for p in (p_first, p_second)]
    many = [len(R) for R in rotations if R.ndim == 3] + [len(p) for p in places if p.ndim == 2]
    count = many[0] if many else 1
    # Copies, because numba compiles anew for arrays that are read-only or in another order.
    first, second = (np.array(np.broadcast_to(R, (count, 3, 3)), order="C") for R in rotations)
    one, two = (np.array(np.broadcast_to(p, (count, 3)), order="C") for p in places)
    return first, one, second, two


def _first_two(poses: Poses) -> Indices:
    return np.tile(np.array([0, 1], dtype=np.int64), (len(poses[0]), 1))


def _separations(bodies: PackedBodies, pairs: Indices, poses: Poses) -> Separation:
    gaps, planes, axes = separate(bodies, np.array(pairs, order="C"), *poses)
    planes += 0.0  # no -0.0
    normals = planes[:, :3].copy()
    planes[gaps <= 0.0] = np.nan
    return Separation(gaps, normals, planes, axes)


def _distances(bodies: PackedBodies, pairs: Indices, poses: Poses) -> Distance:
    apart = _separations(bodies, pairs, poses)
    found, points = distances(bodies, np.array(pairs, order="C"), *poses, ~apart.collides)
    return Distance(np.where(apart.collides, apart.separation, found), points, apart)
