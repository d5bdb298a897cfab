"""Convex polyhedra: vertices, faces and edges of boxes, prisms and hulls of points.

Planes are (A, B, C, D) with A X + B Y + C Z - D = 0 and a unit normal, as RMS-71 sends them to the
scene (section IV.B). The TRUE side of a body's face is outside, where A X + B Y + C Z > D.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import ConvexHull, QhullError

from pips_drake.errors import InputError

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]
Loops = tuple[tuple[int, ...], ...]

# Unit vectors are parallel when they differ by less.
_SAME = 1e-12
# As above, of faces that are found from vertices; as part of the body's size.
_SAME_PLANE = 1e-9

#: Faces a to f of a hexahedron, counter-clockwise seen from outside; rows are the vertices' numbers
#: less one. RMS-71's Figure 2, which shows the standard notation, is lost; this is ours. In the
#: hexahedron's frame, z down: a -x, b +y, c -z (top), d +z (bottom), e -y, f +x. Vertex 1 is at
#: (-x, -y, -z); z changes with every number, x with every second, y with every fourth, so that
#: edges 2-4 and 6-8 are edges of face d, as section IV.C.1 (AQFTST) has them.
HEXAHEDRON_FACES = np.array(
    [[0, 1, 5, 4], [4, 5, 7, 6], [0, 4, 6, 2], [1, 3, 7, 5], [0, 2, 3, 1], [2, 6, 7, 3]]
)
#: The ends of a hexahedron's twelve edges: four along z, four along x, four along y, each upward.
HEXAHEDRON_EDGES = np.array(
    [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]]
)
#: Where the vertices of a box are, in half sizes, (8, 3).
HEXAHEDRON_SIGNS = np.array([[x, y, z] for y in (-1, 1) for x in (-1, 1) for z in (-1, 1)])
#: Where y and z of a prism along x go when it is along another axis.
_TURNS = {"x": (0, 1, 2), "y": (2, 0, 1), "z": (1, 2, 0)}


def _one_of_each(directions: Array) -> Array:
    """Unit vectors without those that are parallel to one before them, (E, 3)."""
    kept = np.empty((0, 3))
    for direction in directions / np.linalg.norm(directions, axis=1, keepdims=True):
        if not (np.linalg.norm(np.cross(kept, direction), axis=1) < _SAME).any():
            kept = np.vstack([kept, direction])
    return kept


@dataclass(frozen=True, eq=False)
class ConvexBody:
    """A convex polyhedron in its own frame.

    Attributes:
        vertices: (V, 3) m.
        faces: rows of `vertices` around each face, counter-clockwise seen from outside.
        face_normals: unit normals, one of those that are parallel, (F, 3).
        edge_directions: unit vectors along edges, one of those that are parallel, (E, 3).
        edges: rows of `vertices` at the ends of each edge, (M, 2).
        planes: of `faces`, normals outward, (len(faces), 4).
    """

    vertices: Array
    faces: Loops
    face_normals: Array
    edge_directions: Array
    edges: Indices
    planes: Array

    @staticmethod
    def of_faces(vertices: ArrayLike, faces: Iterable[Sequence[int]]) -> ConvexBody:
        """A body of known faces.

        Args:
            vertices: (V, 3) m.
            faces: rows of `vertices` around each face, counter-clockwise seen from outside.
        """
        corners = np.array(vertices, dtype=float)
        loops = tuple(tuple(int(k) for k in face) for face in faces)
        edges = {tuple(sorted(e)) for f in loops for e in zip(f, f[1:] + f[:1], strict=True)}
        pairs = np.array(sorted(edges), dtype=np.int64)
        planes = np.array([_plane(corners[list(face)]) for face in loops])
        return ConvexBody(
            corners,
            loops,
            _one_of_each(planes[:, :3]),
            _one_of_each(corners[pairs[:, 1]] - corners[pairs[:, 0]]),
            pairs,
            planes,
        )

    @staticmethod
    def box(half_sizes: ArrayLike) -> ConvexBody:
        """A box around the origin, vertices and faces in `HEXAHEDRON_FACES`' notation.

        Args:
            half_sizes: (3,) m.

        Raises:
            InputError: a half size is not positive.
        """
        half = np.asarray(half_sizes, dtype=float)
        if half.shape != (3,) or not (np.isfinite(half) & (half > 0.0)).all():
            raise InputError(f"half sizes of a box are {half.tolist()} m; must be three, > 0")
        return ConvexBody.of_faces(HEXAHEDRON_SIGNS * half, HEXAHEDRON_FACES.tolist())

    @staticmethod
    def prism(sides: int, across_flats: float, length: float, axis: str = "x") -> ConvexBody:
        """A regular prism around the origin.

        Args:
            sides: faces around it, 3 or more. The next axis after `axis` (y after x) goes through
                an edge turned by half of a side, so through a flat of an even number of sides.
            across_flats: twice the distance of a side from the axis, m.
            length: m.
            axis: x, y or z.

        Raises:
            InputError: a size is not positive, or there is no such axis.
        """
        if sides < 3 or not (across_flats > 0.0 and length > 0.0):
            size = f"{sides} sides, {across_flats} m across flats, {length} m long"
            raise InputError(f"a prism has {size}; sides must be >= 3, sizes > 0")
        if axis not in _TURNS:
            raise InputError(f"a prism's axis is {axis!r}; must be x, y or z")
        angles = (np.arange(sides) + 0.5) * 2.0 * math.pi / sides
        radius = 0.5 * across_flats / math.cos(math.pi / sides)
        ring = radius * np.column_stack([np.cos(angles), np.sin(angles)])
        ends = [np.column_stack([np.full(sides, x), ring]) for x in (-length / 2, length / 2)]
        around = [(k, (k + 1) % sides) for k in range(sides)]
        faces = [
            tuple(reversed(range(sides))),
            tuple(range(sides, 2 * sides)),
            *((i, j, sides + j, sides + i) for i, j in around),
        ]
        return ConvexBody.of_faces(np.concatenate(ends)[:, _TURNS[axis]], faces)

    @staticmethod
    def hull(vertices: ArrayLike) -> ConvexBody:
        """The convex hull of points; triangles in one plane are one face.

        Args:
            vertices: (V, 3) m.

        Raises:
            InputError: points that are not finite, fewer than four, or all in one plane.
        """
        points = np.asarray(vertices, dtype=float)
        if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
            raise InputError(f"a hull's points have shape {points.shape}; must be finite, (V, 3)")
        try:
            found = ConvexHull(points)
        except (QhullError, ValueError) as error:
            raise InputError(f"{len(points)} points span no convex body") from error
        size = np.ptp(points, axis=0).max()
        scaled = found.equations / np.array([1.0, 1.0, 1.0, size])
        # Qhull's triangles run either way.
        a, b, c = (points[found.simplices[:, k]] for k in range(3))
        inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), found.equations[:, :3]) < 0.0
        triangles = np.where(inward[:, None], found.simplices[:, ::-1], found.simplices)
        loops, left = [], np.ones(len(triangles), bool)
        while left.any():
            alike = left & (abs(scaled - scaled[left][0]).max(axis=1) < _SAME_PLANE)
            loops.append(_outline(triangles[alike]))
            left &= ~alike
        used = sorted({k for loop in loops for k in loop})
        rows = {k: row for row, k in enumerate(used)}
        return ConvexBody.of_faces(points[used], [[rows[k] for k in loop] for loop in loops])

    def moved(self, R: ArrayLike, p: ArrayLike) -> ConvexBody:
        """The same body in another frame: x in this one is R x + p in that one.

        Args:
            R, p: (3, 3), (3,) m.
        """
        vertices = self.vertices @ np.asarray(R, dtype=float).T + np.asarray(p, dtype=float)
        return ConvexBody.of_faces(vertices, self.faces)

    def planes_at(self, R: ArrayLike, p: ArrayLike) -> Array:
        """The faces' planes of the body at poses, normals outward, (..., len(faces), 4).

        Args:
            R, p: (..., 3, 3), (..., 3) m.
        """
        normals = np.einsum("...ij,fj->...fi", np.asarray(R, dtype=float), self.planes[:, :3])
        places = np.asarray(p, dtype=float)[..., None, :]
        offsets = self.planes[:, 3] + (normals * places).sum(axis=-1)
        return np.concatenate([normals, offsets[..., None]], axis=-1)


def _plane(loop: Array) -> Array:
    """The plane of a face, normal outward, (4,)."""
    # Twice the area: good for any number of corners, and whichever of them are in line.
    area = np.cross(loop - loop[0], np.roll(loop, -1, axis=0) - loop[0]).sum(axis=0)
    normal = area / np.linalg.norm(area)
    return np.append(normal, (loop @ normal).mean())


def _outline(triangles: Indices) -> list[int]:
    """The loop around triangles of one plane."""
    edges = {(int(t[k]), int(t[(k + 1) % 3])) for t in triangles for k in range(3)}
    after = {i: j for i, j in edges if (j, i) not in edges}
    loop = [next(iter(after))]
    while after[loop[-1]] != loop[0]:
        loop.append(after[loop[-1]])
    return loop


def vertices_inside(points: ArrayLike, planes: ArrayLike) -> Flags:
    """Which points lie on the FALSE side of all planes, or on them (RMS-71, section IV.A.1).

    This is all that RMS-71 asks of the payload against bay and CAE (section IV.A.3). One centimetre
    past the first contact of a payload of 14 ft x 50 ft and its probe with the CAE, flown at it
    along -x within 2.5 m of the port, it misses 21 %, 43 % and 48 % of contacts, of payloads that
    lean up to 5, 30 and 60 deg (`tests/remote_manipulator/test_first_contacts.py`).

    Args:
        points: (..., V, 3) m.
        planes: normals outward, (..., F, 4).

    Returns:
        (..., V).
    """
    faces = np.asarray(planes, dtype=float)
    heights = np.asarray(points, dtype=float) @ np.swapaxes(faces[..., :3], -1, -2)
    inside = heights <= faces[..., None, :, 3]
    return cast(Flags, inside.all(axis=-1))
