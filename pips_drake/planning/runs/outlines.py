"""What is drawn of a workspace: outlines of its shapes and of the arm, and the gap unfolded.

Everything comes from the distance field and the arm's collision shapes: there is no second list of
obstacles that a figure could get wrong.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import ArrayLike, NDArray

from pips_drake.planning.arm_clearance import arm_bodies
from pips_drake.planning.grid import Grid
from pips_drake.planning.occupancy import Occupancy
from pips_drake.scene.meshes import TriangleMesh, convex_hull
from pips_drake.scene.shapes import outline_points
from pips_drake.scene.signed_distance import PlacedShape, SignedDistanceField
from pips_drake.serpentine.arm import SerpentineArm

Array = NDArray[np.float64]

#: Of bodies, in the order of the field's; muted, so that paths stand out.
BODY_COLORS = ("#9aa1ab", "#cdb67e", "#7d9cc0", "#c08a7d", "#8fb38f", "#a78fb8")
#: Edges between faces that meet at less than this are not drawn, deg.
_SMOOTH = 25.0
#: What is as near to the seam is drawn on both sides, deg.
_ON_THE_SEAM = 3.0
#: How far around a payload's surface is shown unfolded, m.
_AROUND = 0.9


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnShape:
    """A shape of the field.

    Attributes:
        body: which of the field's bodies it belongs to.
        hull: in the grid's frame, m.
        edges: where its faces meet at an angle, (E, 2, 3) m.
        inside: it reaches into the workspace; what does not is its surroundings.
    """

    body: int
    hull: TriangleMesh
    edges: Array
    inside: bool


def drawn_shapes(field: SignedDistanceField, grid: Grid) -> list[DrawnShape]:
    """The field's shapes, but for those that go on for ever."""
    shapes = []
    for placed in field.shapes:
        points = outline_points(placed.shape)
        hull = convex_hull(points) if len(points) else None
        if hull is None:
            continue
        world = (placed.X_WG @ hull.vertices.T).T
        local = TriangleMesh((world - grid.arrays.origin) @ grid.arrays.rotation, hull.triangles)
        shapes.append(
            DrawnShape(
                body=field.bodies.index(placed.body),
                hull=local,
                edges=_sharp_edges(local),
                inside=_reaches_into(grid, world),
            )
        )
    return shapes


def polygon(points: Array) -> Array:
    """The convex hull (K, 2) of points in a plane (N, 2); empty if they lie in a line."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except QhullError:
        return np.empty((0, 2))


def arm_corners(
    arm: SerpentineArm, postures: ArrayLike, *, shift: float = 0.0
) -> tuple[Array, NDArray[np.bool_]]:
    """Corners of the arm's boxes in postures (K, joints), m and rad.

    Args:
        shift: of the arm's frame {0} along z0, m, where its rail is placed for the path.

    Returns:
        (K, B, 8, 3) m in frame 0, and which of the B bodies are boxes; the others are small.
    """
    bodies = arm_bodies(arm)
    rotations, centres = bodies.placed(arm, postures, np.array([0.0, 0.0, shift]))
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    corners = signs * bodies.halves[:, None]
    placed: Array = np.einsum("kbij,bcj->kbci", rotations, corners) + centres[:, :, None]
    return placed, bodies.halves.any(axis=1)


def unfolding(occupancy: Occupancy, *, middle: ArrayLike | None = None) -> Occupancy | None:
    """The occupancy itself if it is unfolded; else one around the widest upright cylinder in it.

    Args:
        middle: a point in the world, (3,) m, which the seam is to be opposite to.

    Returns:
        None if the workspace has no cylinder along its z axis.
    """
    grid, field = occupancy.grid, occupancy.field
    if grid.unfolded:
        return occupancy
    found = _widest_cylinder(field, grid)
    if found is None:
        return None
    axis, radius = found
    origin = grid.to_world([[axis[0], axis[1], 0.0]])[0]
    ahead = np.zeros(3) if middle is None else grid.from_world(np.reshape(middle, (1, 3)))[0] - axis
    seam = math.atan2(ahead[1], ahead[0]) - math.pi
    cell = float(grid.spacing.min())
    length = float(grid.upper[2] - grid.lower[2])
    around = Grid(
        lower=np.array([grid.lower[2], seam, radius]),
        upper=np.array([grid.upper[2], seam + 2.0 * math.pi, radius + _AROUND]),
        shape=(
            max(1, round(length / cell)),
            max(8, round(2.0 * math.pi * radius / cell)),
            max(1, round(_AROUND / cell)),
        ),
        unfolded=True,
        rotation=grid.arrays.rotation,
        origin=origin,
    )
    return Occupancy.of(field, around, occupancy.radius)


def blocked_bodies(occupancy: Occupancy) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Which body takes room in an unfolded workspace, and where it takes all of it.

    At any depth, it is the one that is nearer than it usually is at that depth, by most.

    Returns:
        For each (along, around) the body, -1 where there is as much room as elsewhere; and whether
        there is none at all.
    """
    grid, field = occupancy.grid, occupancy.field
    depth = occupancy.free.sum(axis=2)
    full = depth == 0
    # A cell less may be rounding.
    less = full | (depth < np.median(depth[~full]) - 1.0) if (~full).any() else full
    if not (less.any() and field.shapes):
        return np.full(less.shape, -1, dtype=np.int64), full
    cells = np.indices(grid.shape).reshape(3, -1).T
    distances, _ = field.to_bodies(grid.to_world(grid.lower + (cells + 0.5) * grid.spacing))
    near = np.minimum(distances, 2.0 * occupancy.radius).reshape(*grid.shape, -1)
    usual = np.median(near[~less], axis=0) if (~less).any() else 2.0 * occupancy.radius
    nearest = (usual - near).max(axis=2).argmax(axis=-1)
    return np.where(less, nearest, -1), full


def unfolded_picture(occupancy: Occupancy) -> Array:
    """Red, green and blue of an unfolded workspace, (around, along, 3): what takes room, and where.

    Bodies' colours stand where they leave no room, and pale where they leave less than there is
    elsewhere.
    """
    bodies, full = blocked_bodies(occupancy)
    picture = np.ones((*bodies.shape, 3))
    for k in range(len(occupancy.field.bodies)):
        color = np.array(to_rgb(BODY_COLORS[k % len(BODY_COLORS)]))
        picture[(bodies == k) & full] = color
        picture[(bodies == k) & ~full] = 1.0 - 0.35 * (1.0 - color)
    return picture.swapaxes(0, 1)


def unfolded_line(grid: Grid, points: ArrayLike, *, parts: int = 20) -> Array:
    """A line in the world (N, 3) m as (along m, around deg), (M, 2), NaN where it leaves the seam.

    Straight in the world is not straight here: each piece is drawn in so many parts.
    """
    p = np.asarray(points, dtype=np.float64)
    fine = np.concatenate(
        [a + np.linspace(0.0, 1.0, parts + 1)[:-1, None] * (b - a) for a, b in pairwise(p)]
    )
    along, around, _ = grid.from_world(np.vstack([fine, p[-1:]])).T
    line = np.column_stack([along, np.degrees(around)])
    seams = np.flatnonzero(np.abs(np.diff(line[:, 1])) > 180.0)
    pieces: list[Array] = []
    first = 0
    for seam in seams:
        # Both ends go on to the seam, and a gap stands between them.
        turn = math.copysign(360.0, line[seam + 1, 1] - line[seam, 1])
        beyond = line[seam + 1] - [0.0, turn]
        before = line[seam] + [0.0, turn]
        gap = np.full(2, np.nan)
        pieces += [line[first : seam + 1], np.vstack([beyond, gap, before])]
        first = int(seam) + 1
    return np.concatenate([*pieces, line[first:]])


def unfolded_marks(grid: Grid, points: ArrayLike) -> tuple[Array, NDArray[np.int64]]:
    """Points (N, 3) m in the world as (along m, around deg), (M, 2); on the seam on both sides.

    Returns:
        Them, and which of the points each is, (M,).
    """
    p = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    along, around, _ = grid.from_world(p).T
    rows = np.column_stack([along, np.degrees(around)])
    found, which = [rows], [np.arange(len(p))]
    low, high = np.degrees([grid.lower[1], grid.upper[1]])
    if high - low > 359.0:
        for near, turn in ((rows[:, 1] - low, 360.0), (high - rows[:, 1], -360.0)):
            again = np.flatnonzero(near < _ON_THE_SEAM)
            found.append(rows[again] + np.array([0.0, turn]))
            which.append(again)
    return np.concatenate(found), np.concatenate(which)


def unfolded_polygons(grid: Grid, corners: Array) -> list[Array]:
    """A convex body's outline as (along m, around deg): once, or on both sides of the seam.

    Args:
        corners: (N, 3) m in the world.
    """
    along, around, _ = grid.from_world(corners).T
    angles = np.unwrap(np.concatenate([[around[0]], around]))[1:]
    angles = around[0] + (angles - around[0] + math.pi) % (2.0 * math.pi) - math.pi
    outline = polygon(np.column_stack([along, np.degrees(angles)]))
    if not len(outline):
        return []
    low, high = np.degrees([grid.lower[1], grid.upper[1]])
    found, turn = [outline], np.array([0.0, 360.0])
    if outline[:, 1].max() > high:
        found.append(outline - turn)
    if outline[:, 1].min() < low:
        found.append(outline + turn)
    return found


def _sharp_edges(hull: TriangleMesh) -> Array:
    a, b, c = hull.corners.swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    faces: dict[tuple[int, int], list[int]] = {}
    for k, triangle in enumerate(hull.triangles):
        for i, j in ((0, 1), (1, 2), (2, 0)):
            one, other = sorted((int(triangle[i]), int(triangle[j])))
            faces.setdefault((one, other), []).append(k)
    smooth = math.cos(math.radians(_SMOOTH))
    sharp = [
        edge
        for edge, meet in faces.items()
        if len(meet) == 2 and normals[meet[0]] @ normals[meet[1]] < smooth
    ]
    return hull.vertices[np.array(sharp, dtype=np.int64).reshape(-1, 2)]


def _reaches_into(grid: Grid, points: Array) -> bool:
    """Whether the range of a shape's points overlaps the grid's, by a twentieth at the least."""
    q = grid.from_world(points)
    axes: Sequence[int] = (0, 2) if grid.unfolded else (0, 1, 2)
    low, high = q.min(axis=0), q.max(axis=0)
    if grid.unfolded and np.ptp(q[:, 1]) > math.pi:
        low[2] = 0.0  # it may hold the axis
    slack = 0.05 * (grid.upper - grid.lower)
    slack = np.minimum(slack, 0.02)
    inside = [
        low[k] < grid.upper[k] - slack[k] and high[k] > grid.lower[k] + slack[k] for k in axes
    ]
    return all(inside)


def _widest_cylinder(field: SignedDistanceField, grid: Grid) -> tuple[Array, float] | None:
    """Middle (3,) m in the grid's coordinates and radius, m, of a cylinder along its z axis."""
    best: tuple[float, PlacedShape] | None = None
    for placed in field.shapes:
        if type(placed.shape).__name__ != "Cylinder":
            continue
        axis = grid.arrays.rotation.T @ placed.X_WG.rotation().matrix()[:, 2]
        if abs(axis[2]) > 1.0 - 1e-6 and (best is None or placed.shape.radius() > best[0]):
            best = (float(placed.shape.radius()), placed)
    if best is None:
        return None
    return grid.from_world(best[1].X_WG.translation()[None])[0], best[0]
