"""Triangle meshes: reading, volume, convex hull, and how far one surface stands out of another.

Distances between surfaces are not sampled but bounded. The distance to a convex set (a triangle, a
convex part) is a convex function of the point, so over a triangle it is largest at a corner:

    max over x in P of min over C of d(x, C)  <=  min over C of max over corners v of P of d(v, C)

Triangles P whose bound exceeds what was found so far are cut in four, until none does by more than
the tolerance (branch and bound).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.scene.triangles import nearest_on_triangle

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: How near `excess` comes to the largest distance, m.
TOLERANCE = 0.5e-3
#: A mesh is flat when its hull is thinner than this part of its size.
_THINNEST = 1e-6
# Pieces looked at before they are put in order again, and distances after which `excess` gives up.
_BATCH, _MOST_WORK = 2048, 500_000_000


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """A surface of triangles.

    Attributes:
        vertices: (N, 3) m.
        triangles: rows of `vertices`, counter-clockwise seen from outside, (M, 3).
    """

    vertices: Array
    triangles: Indices

    @property
    def corners(self) -> Array:
        """The triangles' corners, (M, 3, 3) m."""
        corners: Array = self.vertices[self.triangles]
        return corners

    @property
    def closed(self) -> bool:
        """Whether it encloses a volume: every edge belongs to two triangles, once either way."""
        edges = self.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        there, count = np.unique(edges, axis=0, return_counts=True)
        back = np.unique(edges[:, ::-1], axis=0)
        return bool(len(there) and (count == 1).all() and np.array_equal(there, back))

    @property
    def volume(self) -> float:
        """What a closed mesh encloses, m^3."""
        a, b, c = self.corners.swapaxes(0, 1) - self.vertices.mean(axis=0)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def read_obj(file: Path, scale: ArrayLike = (1.0, 1.0, 1.0)) -> TriangleMesh:
    """Reads a Wavefront file; vertices that are equal become one.

    Args:
        scale: factors along x, y and z, (3,).

    Raises:
        InputError: the file cannot be read.
    """
    from pydrake.geometry import ReadObjToTriangleSurfaceMesh

    try:
        mesh = ReadObjToTriangleSurfaceMesh(file)
    except (RuntimeError, SystemExit) as error:  # the latter is how drake 1.51 says "bug"
        raise InputError(f"{file}: {' '.join(str(error).split())}") from None
    vertices = np.array([mesh.vertex(i) for i in range(mesh.num_vertices())]).reshape(-1, 3)
    elements = [mesh.element(i) for i in range(mesh.num_triangles())]
    triangles = np.array([[e.vertex(k) for k in range(3)] for e in elements], dtype=np.int64)
    if not triangles.size or not 0 <= triangles.min() <= triangles.max() < len(vertices):
        raise InputError(f"{file}: not a mesh; must have faces of the vertices that it has")
    factors = np.asarray(scale, dtype=np.float64)
    if np.prod(factors) < 0.0:  # a mirror turns triangles inside out
        triangles = triangles[:, ::-1]
    vertices, merged = np.unique(vertices * factors, axis=0, return_inverse=True)
    triangles = merged.reshape(-1)[triangles]
    a, b, c = triangles.T
    return TriangleMesh(vertices, triangles[(a != b) & (b != c) & (c != a)])


def convex_hull(points: ArrayLike) -> TriangleMesh | None:
    """The convex hull of points (N, 3) m; None if they have no volume: all lie in a plane."""
    from scipy.spatial import ConvexHull, QhullError

    p = np.asarray(points, dtype=np.float64)
    centred = p - p.mean(axis=0)
    size = np.linalg.svd(centred, compute_uv=False) if len(p) > 3 else np.zeros(3)
    if not size[-1] > _THINNEST * size[0]:
        return None
    try:
        hull = ConvexHull(p)
    except QhullError:
        return None
    triangles = hull.simplices.astype(np.int64)
    a, b, c = p[triangles].swapaxes(0, 1)
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    triangles[inward] = triangles[inward][:, ::-1]
    kept = np.unique(triangles)
    return TriangleMesh(p[kept], np.searchsorted(kept, triangles))


def hull_planes(hull: TriangleMesh) -> Array:
    """Planes n, d of a convex hull's triangles, (M, 4): inside, n . x + d <= 0 (m)."""
    a, b, c = hull.corners.swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    return np.column_stack([normals, -np.einsum("ij,ij->i", normals, a)])


def excess(
    surface: TriangleMesh,
    target: TriangleMesh | Sequence[TriangleMesh],
    *,
    tolerance: float = TOLERANCE,
    hollow: bool = False,
) -> float:
    """The largest distance of a surface's points from a target, m.

    Args:
        surface: whose points are meant.
        target: a mesh, or convex hulls that together are the target. What lies inside a hull or a
            closed mesh has distance 0.
        tolerance: how far (m) the result may be below the true one. Of very fine meshes it is the
            largest distance that was found in some ten seconds.
        hollow: a closed mesh is its surface alone.
    """
    if isinstance(target, TriangleMesh):
        corners, solid = target.corners, target.closed and not hollow
        cells, planes = list(corners[:, None]), [np.empty((0, 4))] * len(corners)
    else:
        cells, solid = [hull.corners for hull in target], False
        planes = [hull_planes(hull) for hull in target]
    if not cells or not len(surface.triangles):
        return math.inf if len(surface.triangles) else 0.0
    triangles, starts = _joined(cells)
    faces, face_starts = _joined(planes)
    centres = np.array([cell.reshape(-1, 3).mean(axis=0) for cell in cells])
    radii = np.array(
        [
            np.linalg.norm(cell.reshape(-1, 3) - centre, axis=1).max()
            for cell, centre in zip(cells, centres, strict=True)
        ]
    )
    pieces, found, work = surface.corners, 0.0, 0
    bounds = np.full(len(pieces), np.inf)
    while len(pieces) and work < _MOST_WORK:
        # The most promising ones first: what they find spares looking at the others.
        order = np.argsort(-bounds, kind="stable")
        now, later = order[:_BATCH], order[_BATCH:]
        low, high, done = _bounds(
            pieces[now],
            triangles,
            starts,
            faces,
            face_starts,
            centres,
            radii,
            solid,
            found,
            tolerance,
        )
        found, work = max(found, float(low.max())), work + done
        cut, kept = now[high > found + tolerance], later[bounds[later] > found + tolerance]
        children = np.repeat(high[high > found + tolerance], 4)
        bounds = np.concatenate([children, bounds[kept]])
        pieces = np.concatenate([_quartered(pieces[cut]), pieces[kept]])
    return found


def hull_excess(hull: TriangleMesh, mesh: TriangleMesh, *, tolerance: float = TOLERANCE) -> float:
    """`excess` of a mesh's convex hull from the mesh, m; faces that the mesh has too cost no time.

    The mesh lies within its hull. So where its triangles in the plane of a face have as much area
    as the face, they are the face.
    """
    size = float(np.ptp(mesh.vertices, axis=0).max())
    grid = [1e-6, 1e-6, 1e-6, 1e-6 * size]
    keys = np.round(np.concatenate([hull_planes(hull), hull_planes(mesh)]) / grid)
    # Planes that are rounded apart are looked at without need; no harm but time.
    _, plane = np.unique(keys + 0.0, axis=0, return_inverse=True)
    face, other = np.split(plane.reshape(-1), [len(hull.triangles)])
    count = int(plane.max()) + 1
    whole = np.bincount(face, _areas(hull.corners), count)
    shared = np.bincount(other, _areas(mesh.corners), count) >= (1.0 - 1e-6) * whole
    free = TriangleMesh(hull.vertices, hull.triangles[~shared[face]])
    # No point of the hull is inside the mesh, so there is no need to find out.
    return excess(free, mesh, tolerance=tolerance, hollow=True)


def joined(meshes: Sequence[TriangleMesh]) -> TriangleMesh:
    """Several surfaces as one."""
    vertices, starts = _joined([mesh.vertices for mesh in meshes])
    return TriangleMesh(
        vertices,
        np.concatenate([m.triangles + s for m, s in zip(meshes, starts[:-1], strict=True)]),
    )


def _areas(corners: Array) -> Array:
    a, b, c = corners.swapaxes(0, 1)
    areas: Array = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return areas


def _joined(arrays: Sequence[Array]) -> tuple[Array, Indices]:
    """Arrays one after the other, and where each begins and the last ends."""
    starts = np.cumsum([0, *(len(array) for array in arrays)])
    return np.concatenate(arrays), starts.astype(np.int64)


def _quartered(pieces: Array) -> Array:
    a, b, c = pieces.swapaxes(0, 1)
    ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    children = np.stack([np.stack(part, axis=1) for part in parts], axis=1)
    return children.reshape(-1, 3, 3)


@numba.njit(cache=True)
def _bounds(
    pieces, triangles, starts, planes, plane_starts, centres, radii, solid, found, tolerance
):
    """Bounds from below and above of the largest distance of each piece's points, (P,) m; work."""
    work = 0
    count, cells = pieces.shape[0], centres.shape[0]
    low, high = np.zeros(count), np.zeros(count)
    points, nearest = np.empty((4, 3)), np.empty(4)
    for i in range(count):
        for axis in range(3):
            total = 0.0
            for k in range(3):
                points[k, axis] = pieces[i, k, axis]
                total += pieces[i, k, axis]
            points[3, axis] = total / 3.0
        radius = 0.0
        for k in range(3):
            radius = max(radius, _distance(points, k, points, 3))
        for k in range(4):
            nearest[k] = np.inf
        bound = np.inf
        work += cells // 8
        for cell in range(cells):
            # No point of the piece is nearer to the cell than this.
            if _distance(points, 3, centres, cell) - radii[cell] - radius > bound:
                continue
            worst = 0.0
            for k in range(4):
                # A convex part is at least as far as its farthest plane.
                height = _height(points, k, planes, plane_starts[cell], plane_starts[cell + 1])
                if height <= 0.0:
                    least = 0.0
                elif height < np.inf and height > bound:
                    least = height
                else:
                    least = np.inf
                    for j in range(starts[cell], starts[cell + 1]):
                        least = min(least, _triangle_distance(points, k, triangles, j))
                    work += starts[cell + 1] - starts[cell]
                nearest[k] = min(nearest[k], least)
                if k < 3:
                    worst = max(worst, least)
            bound = min(bound, worst)
        # Distance changes by no more than the way walked.
        bound = min(bound, nearest[3] + radius)
        if not solid:
            for k in range(4):
                low[i] = max(low[i], nearest[k])
        elif bound > found + tolerance:
            work += triangles.shape[0]
            if _surrounded(points, 3, triangles):
                bound = min(bound, max(0.0, radius - nearest[3]))
            else:
                low[i] = nearest[3]
        high[i] = bound
    return low, high, work


@numba.njit(cache=True)
def _distance(p, i, q, j):
    """Distance of row i of p from row j of q."""
    x, y, z = p[i, 0] - q[j, 0], p[i, 1] - q[j, 1], p[i, 2] - q[j, 2]
    return math.sqrt(x * x + y * y + z * z)


@numba.njit(cache=True)
def _height(p, i, planes, first, last):
    """How high row i of p is above the highest of some planes; infinite if there are none."""
    highest = -np.inf if last > first else np.inf
    for k in range(first, last):
        height = planes[k, 3]
        for axis in range(3):
            height += planes[k, axis] * p[i, axis]
        highest = max(highest, height)
    return highest


@numba.njit(cache=True)
def _triangle_distance(p, i, triangles, j):
    """Distance of row i of p from triangle j."""
    x, y, z = nearest_on_triangle(p[i, 0], p[i, 1], p[i, 2], triangles[j])
    return math.sqrt((p[i, 0] - x) ** 2 + (p[i, 1] - y) ** 2 + (p[i, 2] - z) ** 2)


@numba.njit(cache=True)
def _surrounded(p, i, triangles):
    """Whether a closed surface goes round row i of p: its solid angles add up to 4 pi."""
    total = 0.0
    for j in range(triangles.shape[0]):
        ax, ay, az = (triangles[j, 0, 0] - p[i, 0], triangles[j, 0, 1] - p[i, 1],
                      triangles[j, 0, 2] - p[i, 2])  # fmt: skip
        bx, by, bz = (triangles[j, 1, 0] - p[i, 0], triangles[j, 1, 1] - p[i, 1],
                      triangles[j, 1, 2] - p[i, 2])  # fmt: skip
        cx, cy, cz = (triangles[j, 2, 0] - p[i, 0], triangles[j, 2, 1] - p[i, 1],
                      triangles[j, 2, 2] - p[i, 2])  # fmt: skip
        a = math.sqrt(ax * ax + ay * ay + az * az)
        b = math.sqrt(bx * bx + by * by + bz * bz)
        c = math.sqrt(cx * cx + cy * cy + cz * cz)
        volume = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
        below = (a * b * c + (ax * bx + ay * by + az * bz) * c + (bx * cx + by * cy + bz * cz) * a
                 + (cx * ax + cy * ay + cz * az) * b)  # fmt: skip
        total += 2.0 * math.atan2(volume, below)
    return total > 2.0 * math.pi
