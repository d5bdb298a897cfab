"""Small pieces of the surfaces of shapes, each with its middle, normal, area and corners."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from pydrake.math import RigidTransform

Array = NDArray[np.float64]

#: Default edge of a patch, m.
PATCH_SIZE = 0.025


@dataclass(frozen=True, kw_only=True, eq=False)
class Patches:
    """Small pieces of a surface, N of them.

    Attributes:
        points: their middles on the surface, (N, 3) m.
        normals: outward, (N, 3).
        areas: (N,) m^2; together they are the whole surface.
        corners: in order round each, (N, 4, 3) m; a triangle has its last corner twice.
    """

    points: Array
    normals: Array
    areas: Array
    corners: Array

    def __len__(self) -> int:
        return len(self.areas)

    def placed(self, X: RigidTransform) -> Patches:
        """The patches in the frame in which theirs has the pose `X`."""
        R, p = X.rotation().matrix(), X.translation()
        return Patches(
            points=self.points @ R.T + p,
            normals=self.normals @ R.T,
            areas=self.areas,
            corners=self.corners @ R.T + p,
        )

    def select(self, rows: NDArray[np.bool_]) -> Patches:
        """The patches of a mask (N,)."""
        return Patches(
            points=self.points[rows],
            normals=self.normals[rows],
            areas=self.areas[rows],
            corners=self.corners[rows],
        )


def join(parts: Iterable[Patches]) -> Patches:
    """All patches of several surfaces."""
    all_parts = list(parts)
    return Patches(
        points=np.concatenate([part.points for part in all_parts]),
        normals=np.concatenate([part.normals for part in all_parts]),
        areas=np.concatenate([part.areas for part in all_parts]),
        corners=np.concatenate([part.corners for part in all_parts]),
    )


@dataclass(frozen=True, kw_only=True)
class Grid:
    """How a cylinder's patches lie side by side: `around` times `along`, angle first.

    Attributes:
        radius, length: of the cylinder, m.
        around, along: number of patches round the axis, from angle 0 on, and along it.
    """

    radius: float
    length: float
    around: int
    along: int


def sample_shape(shape: object, size: float) -> tuple[Patches, Grid | None] | None:
    """Patches of a shape in its own frame; None for a kind that is not known."""
    from pydrake.geometry import Box, Convex, Cylinder, Mesh, Sphere
    from pydrake.math import RigidTransform, RotationMatrix

    if isinstance(shape, Cylinder):
        radius, length = shape.radius(), shape.length()
        side, grid = cylinder_side(radius, length, size)
        end = disc(radius, size)
        top = end.placed(RigidTransform([0.0, 0.0, 0.5 * length]))
        turned = RigidTransform(RotationMatrix.MakeXRotation(math.pi), [0.0, 0.0, -0.5 * length])
        return join([side, top, end.placed(turned)]), grid
    if isinstance(shape, Box):
        return box(shape.width(), shape.depth(), shape.height(), size), None
    if isinstance(shape, Sphere):
        return sphere(shape.radius(), size), None
    if isinstance(shape, Convex | Mesh):
        hull = shape.GetConvexHull()
        found = []
        for index in range(hull.num_faces()):
            face = hull.element(index)
            ring = [hull.vertex(face.vertex(k)) for k in range(face.num_vertices())]
            found += [[ring[0], a, b] for a, b in itertools.pairwise(ring[1:])]
        return triangles(found, size), None
    return None


def cylinder_side(radius: float, length: float, size: float = PATCH_SIZE) -> tuple[Patches, Grid]:
    """The curved side of a cylinder about z, and how its patches lie on the map."""
    grid = Grid(
        radius=radius,
        length=length,
        around=max(12, math.ceil(2.0 * math.pi * radius / size)),
        along=max(1, math.ceil(length / size)),
    )
    angle = np.linspace(0.0, 2.0 * math.pi, grid.around + 1)
    height = np.linspace(-0.5 * length, 0.5 * length, grid.along + 1)

    def at(angles: Array, heights: Array) -> Array:
        a, h = np.broadcast_arrays(angles, heights)
        return np.stack([radius * np.cos(a), radius * np.sin(a), h], axis=-1)

    middle_angle, middle_height = 0.5 * (angle[1:] + angle[:-1]), 0.5 * (height[1:] + height[:-1])
    points = at(middle_angle[:, None], middle_height[None]).reshape(-1, 3)
    rim = at(angle[:, None], height[None])
    patches = Patches(
        points=points,
        normals=points * [1.0, 1.0, 0.0] / radius,
        areas=np.full(len(points), 2.0 * math.pi * radius * length / len(points)),
        corners=_quads(rim),
    )
    return patches, grid


def disc(radius: float, size: float = PATCH_SIZE) -> Patches:
    """A disc about z that faces +z."""
    rings = max(1, math.ceil(radius / size))
    edge = radius * np.arange(rings + 1) / rings
    found = []
    for inner, outer in itertools.pairwise(edge):
        sectors = max(6, math.ceil(2.0 * math.pi * outer / size))
        angle = np.linspace(0.0, 2.0 * math.pi, sectors + 1)
        ray = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
        middle = 0.5 * (angle[1:] + angle[:-1])
        points = (
            0.5
            * (inner + outer)
            * np.stack([np.cos(middle), np.sin(middle), np.zeros_like(middle)], axis=-1)
        )
        found.append(
            Patches(
                points=points,
                normals=np.tile([0.0, 0.0, 1.0], (sectors, 1)),
                areas=np.full(sectors, math.pi * (outer**2 - inner**2) / sectors),
                corners=_quads(np.stack([inner * ray, outer * ray])),
            )
        )
    return join(found)


def box(width: float, depth: float, height: float, size: float = PATCH_SIZE) -> Patches:
    """A box about its middle, with edges along x, y and z."""
    edges = np.array([width, depth, height])
    found = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            # u, v and the outward normal are right-handed.
            u, v = ((axis + 1) % 3, (axis + 2) % 3)[:: int(sign)]
            count = [max(1, math.ceil(edges[k] / size)) for k in (u, v)]
            corner = np.zeros((count[0] + 1, count[1] + 1, 3))
            corner[..., axis] = 0.5 * sign * edges[axis]
            corner[..., u] = np.linspace(-0.5, 0.5, count[0] + 1)[:, None] * edges[u]
            corner[..., v] = np.linspace(-0.5, 0.5, count[1] + 1)[None] * edges[v]
            quads = _quads(corner)
            normal = np.zeros(3)
            normal[axis] = sign
            found.append(
                Patches(
                    points=quads.mean(axis=1),
                    normals=np.tile(normal, (len(quads), 1)),
                    areas=np.full(len(quads), edges[u] * edges[v] / len(quads)),
                    corners=quads,
                )
            )
    return join(found)


def sphere(radius: float, size: float = PATCH_SIZE) -> Patches:
    """A sphere about the origin, in rings about z."""
    rings = max(4, math.ceil(math.pi * radius / size))
    polar = np.linspace(0.0, math.pi, rings + 1)
    found = []
    for upper, lower in itertools.pairwise(polar):
        middle = 0.5 * (upper + lower)
        sectors = max(6, math.ceil(2.0 * math.pi * radius * math.sin(middle) / size))
        angle = np.linspace(0.0, 2.0 * math.pi, sectors + 1)
        normals = _on_sphere(middle, 0.5 * (angle[1:] + angle[:-1]))
        area = 2.0 * math.pi * radius**2 * (math.cos(upper) - math.cos(lower)) / sectors
        rim = radius * np.stack([_on_sphere(upper, angle), _on_sphere(lower, angle)])
        found.append(
            Patches(
                points=radius * normals,
                normals=normals,
                areas=np.full(sectors, area),
                corners=_quads(rim),
            )
        )
    return join(found)


def triangles(corners: ArrayLike, size: float = PATCH_SIZE) -> Patches:
    """Triangles (N, 3, 3) m, anticlockwise from outside, each cut until its edges are short."""
    found = []
    for triangle in np.asarray(corners, dtype=np.float64):
        edge = np.linalg.norm(triangle - np.roll(triangle, 1, axis=0), axis=1).max()
        found.append(_cut(triangle, max(1, math.ceil(edge / size))))
    pieces = np.concatenate(found)
    across = np.cross(pieces[:, 1] - pieces[:, 0], pieces[:, 2] - pieces[:, 0])
    twice = np.linalg.norm(across, axis=1)
    kept = twice > 0.0
    pieces, across, twice = pieces[kept], across[kept], twice[kept]
    return Patches(
        points=pieces.mean(axis=1),
        normals=across / twice[:, None],
        areas=0.5 * twice,
        corners=pieces[:, [0, 1, 2, 2]],
    )


def _quads(corners: Array) -> Array:
    """Corners (N, 4, 3) of the cells of a grid of points (rows, columns, 3), row by row."""
    cells = np.stack(
        [corners[:-1, :-1], corners[1:, :-1], corners[1:, 1:], corners[:-1, 1:]], axis=2
    )
    return cells.reshape(-1, 4, 3)


def _on_sphere(polar: float, angle: Array) -> Array:
    """Unit vectors at an angle from z and angles (N,) about it."""
    ring = math.sin(polar)
    height = np.full_like(angle, math.cos(polar))
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), height], axis=-1)


def _cut(triangle: Array, parts: int) -> Array:
    """A triangle (3, 3) cut into parts^2 equal ones, each edge into `parts`."""
    a, b, c = triangle

    def at(i: int, j: int) -> Array:
        corner: Array = a + (b - a) * (i / parts) + (c - a) * (j / parts)
        return corner

    found = []
    for i in range(parts):
        for j in range(parts - i):
            found.append([at(i, j), at(i + 1, j), at(i, j + 1)])
            if i + j < parts - 1:
                found.append([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)])
    return np.array(found)
