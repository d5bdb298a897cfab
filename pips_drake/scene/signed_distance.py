"""Exact signed distance and gradient from many points to a scene: what a planner asks.

The shapes are read from the scene graph, so the planner's world is the one that collides: a `Mesh`
is its convex hull (as in Drake's distances between pairs of shapes; Drake's distance of a *point*
takes the mesh itself), a hollow thing is what it is made of, a cylinder's wall for example a ring
of boxes.

Exact are: each shape's distance and gradient, inside and outside; the scene's distance outside all
shapes (the least of theirs). Inside shapes that overlap, the scene's depth is the deepest shape's:
a lower bound of the way out of all of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError, UnknownNameError
from pips_drake.scene.meshes import hull_planes
from pips_drake.scene.shape_distance import (
    BOX,
    CAPSULE,
    CONVEX,
    CYLINDER,
    ELLIPSOID,
    HALF_SPACE,
    SPHERE,
    FieldArrays,
    blended_to_groups,
    distances_many,
    distances_to_groups,
)
from pips_drake.scene.shapes import hull_of, scene_frames

if TYPE_CHECKING:
    from pydrake.geometry import FrameId, QueryObject, Shape
    from pydrake.math import RigidTransform

Array = NDArray[np.float64]

_KINDS = {
    "Sphere": SPHERE,
    "HalfSpace": HALF_SPACE,
    "Box": BOX,
    "Cylinder": CYLINDER,
    "Capsule": CAPSULE,
    "Ellipsoid": ELLIPSOID,
    "Convex": CONVEX,
    "Mesh": CONVEX,
}


@dataclass(frozen=True, eq=False)
class PlacedShape:
    """A shape in the world.

    Attributes:
        body: its body's scoped name, or the name of an artificial obstacle.
        name: of the shape in its body.
        shape: Drake's.
        X_WG: its pose in the world.
    """

    body: str
    name: str
    shape: Shape
    X_WG: RigidTransform


@dataclass(frozen=True, eq=False)
class NearestShapes:
    """What is nearest to N points.

    Attributes:
        distances: (N,) m, negative inside; infinite in an empty scene.
        gradients: of the distances, unit vectors in the world, (N, 3); zeros in an empty scene.
        indices: of the nearest shapes, (N,); -1 in an empty scene.
    """

    distances: Array
    gradients: Array
    indices: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class SignedDistanceField:
    """The signed distance of a scene's shapes. It never changes: `with_shapes` makes another.

    Attributes:
        shapes: M shapes.
        arrays: the same for compiled code.
    """

    shapes: tuple[PlacedShape, ...]
    arrays: FieldArrays

    @staticmethod
    def of(shapes: Iterable[PlacedShape]) -> SignedDistanceField:
        """The field of shapes.

        Raises:
            InputError: a shape that has no distance (MeshcatCone), or a mesh without volume.
        """
        every = tuple(shapes)
        return SignedDistanceField(shapes=every, arrays=_arrays_of(every))

    def distances(self, points: ArrayLike) -> Array:
        """Signed distances (N,) m of points (N, 3) m in the world."""
        return self.nearest(points).distances

    def nearest(self, points: ArrayLike) -> NearestShapes:
        """Signed distances, gradients and shapes of points (N, 3) m in the world.

        Raises:
            InputError: the points are not rows of three finite numbers.
        """
        distances, gradients, indices = distances_many(self.arrays, _checked(points))
        return NearestShapes(distances=distances, gradients=gradients, indices=indices)

    def to_bodies(self, points: ArrayLike) -> tuple[Array, Array]:
        """Distances to each body by itself, for forces that come from all of them.

        Args:
            points: (N, 3) m in the world.

        Returns:
            Distances (N, B) m, in the order of `bodies`, and their gradients (N, B, 3).

        Raises:
            InputError: as of `nearest`.
        """
        distances, gradients = distances_to_groups(
            self.arrays, self._groups, len(self.bodies), _checked(points)
        )
        return distances, gradients

    def blended(self, points: ArrayLike, *, blend: float, within: float) -> tuple[Array, Array]:
        """As `to_bodies`, smooth where two shapes of a body are as near: what slides needs that.

        Args:
            blend: m, over which shapes of a body are blended. A distance becomes smaller, by
                `blend` ln(n) at most where n shapes are as near.
            within: m, as far as distances are wanted. Shapes much farther are left out, and a body
                with none nearer is infinitely far.

        Raises:
            InputError: as of `nearest`; or `blend` or `within` is not positive.
        """
        for name, value in (("blend", blend), ("within", within)):
            if not value > 0.0:
                raise InputError(f"{name} = {value} m; must be > 0")
        distances, gradients = blended_to_groups(
            self.arrays,
            self._groups,
            len(self.bodies),
            _checked(points),
            blend,
            # Beyond, a shape's weight is below e^-20 of one at the limit.
            within + 20.0 * blend,
        )
        return distances, gradients

    @cached_property
    def bodies(self) -> tuple[str, ...]:
        """The bodies' names, in the order of their first shapes."""
        return tuple(dict.fromkeys(placed.body for placed in self.shapes))

    @cached_property
    def _groups(self) -> NDArray[np.int64]:
        """Which body each shape belongs to, (M,)."""
        bodies = self.bodies
        return np.array([bodies.index(placed.body) for placed in self.shapes], dtype=np.int64)

    def label(self, index: int) -> str:
        """What a shape is called in messages: its body, and its name where that says more."""
        placed = self.shapes[index]
        return f"{placed.body} ({placed.name})" if placed.name else placed.body

    def with_shapes(self, shapes: Iterable[PlacedShape]) -> SignedDistanceField:
        """The field with more shapes, for example artificial obstacles."""
        return SignedDistanceField.of([*self.shapes, *shapes])

    def without_body(self, body: str) -> SignedDistanceField:
        """The field without a body's shapes.

        Raises:
            UnknownNameError: there is no such body.
        """
        if body not in self.bodies:
            raise UnknownNameError("body", body, self.bodies)
        return SignedDistanceField.of(placed for placed in self.shapes if placed.body != body)


def placed_shapes(query: QueryObject, frames: Mapping[FrameId, str]) -> list[PlacedShape]:
    """The shapes of some frames that collide, where they stand now.

    Args:
        query: of the scene graph, in the context that says where things stand.
        frames: the frames, and how their bodies are called (`scene_frames`).
    """
    from pydrake.geometry import Role

    inspector = query.inspector()
    return [
        PlacedShape(
            body=body,
            name=inspector.GetName(geometry).split("::")[-1],
            shape=inspector.GetShape(geometry),
            X_WG=query.GetPoseInWorld(geometry),
        )
        for frame, body in frames.items()
        for geometry in inspector.GetGeometries(frame, Role.kProximity)
    ]


def read_distance_field(
    file: Path, *, placed_frames: Mapping[str, RigidTransform] | None = None
) -> SignedDistanceField:
    """The field of a scene file alone, without an arm.

    Args:
        file: any file that `AddScene` takes.
        placed_frames: poses in the world of frames that the file names, `frame_0` for example; by
            default `frame_0` is the world.

    Raises:
        InputError: the file cannot be used as a scene.
    """
    from pydrake.math import RigidTransform
    from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
    from pydrake.multibody.tree import ModelInstanceIndex
    from pydrake.systems.framework import DiagramBuilder

    from pips_drake.scene.loading import AddPlacedFrame, AddScene, check_anchored

    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    places = placed_frames if placed_frames is not None else {"frame_0": RigidTransform()}
    for name, X_WF in places.items():
        AddPlacedFrame(plant, name, X_WF)
    models = AddScene(plant, file)
    plant.Finalize()
    check_anchored(plant, models, file)
    diagram = builder.Build()
    context = scene_graph.GetMyContextFromRoot(diagram.CreateDefaultContext())
    query = scene_graph.get_query_output_port().Eval(context)
    nobody = ModelInstanceIndex(plant.num_model_instances())
    return SignedDistanceField.of(placed_shapes(query, scene_frames(plant, nobody)))


def _checked(points: ArrayLike) -> Array:
    p = np.ascontiguousarray(points, dtype=np.float64)
    if p.ndim != 2 or p.shape[1] != 3:
        raise InputError(f"points have shape {p.shape}; must be (N, 3)")
    finite = np.isfinite(p).all(axis=1)
    if not finite.all():
        row = int(np.argmin(finite))
        raise InputError(f"points[{row}] = {p[row].tolist()}; must be finite")
    return p


def _arrays_of(shapes: Sequence[PlacedShape]) -> FieldArrays:
    count = len(shapes)
    kinds, sizes = np.zeros(count, dtype=np.int64), np.zeros((count, 3))
    rotations, positions = np.zeros((count, 3, 3)), np.zeros((count, 3))
    extents = np.full((count, 3), np.inf)
    centres, radii = np.zeros((count, 3)), np.zeros(count)
    planes, triangles, starts = [np.zeros((0, 4))], [np.zeros((0, 3, 3))], [0]
    for i, placed in enumerate(shapes):
        kind = type(placed.shape).__name__
        if kind not in _KINDS:
            raise InputError(
                f"{placed.body}: shape {placed.name} is a {kind}; must be one of "
                f"{', '.join(sorted(_KINDS))}"
            )
        kinds[i] = _KINDS[kind]
        rotations[i] = placed.X_WG.rotation().matrix()
        positions[i] = centres[i] = placed.X_WG.translation()
        faces = 0
        if kinds[i] == CONVEX:
            hull = hull_of(placed.shape, placed.body)
            planes.append(hull_planes(hull))
            triangles.append(hull.corners)
            faces = len(hull.triangles)
            middle = 0.5 * (hull.vertices.min(axis=0) + hull.vertices.max(axis=0))
            centres[i] = positions[i] + rotations[i] @ middle
            radii[i] = np.linalg.norm(hull.vertices - middle, axis=1).max()
        else:
            sizes[i], extents[i], radii[i] = _measures(placed.shape)
        starts.append(starts[-1] + faces)
    return FieldArrays(
        kinds=kinds,
        sizes=sizes,
        rotations=rotations,
        positions=positions,
        extents=extents,
        centres=centres,
        # Rounding must not hide a shape that touches its ball.
        radii=radii * (1.0 + 1e-12),
        planes=np.concatenate(planes),
        triangles=np.concatenate(triangles),
        starts=np.array(starts, dtype=np.int64),
    )


def _measures(
    shape: Shape,
) -> tuple[tuple[float, float, float], tuple[float, float, float], float]:
    """What `FieldArrays.sizes` and `extents` want, and the radius of a ball around the shape, m."""
    kind = type(shape).__name__
    if kind == "Sphere":
        radius = shape.radius()
        return (radius, 0.0, 0.0), (radius, radius, radius), radius
    if kind == "Box":
        half = (0.5 * shape.width(), 0.5 * shape.depth(), 0.5 * shape.height())
        return half, half, float(np.linalg.norm(half))
    if kind in ("Cylinder", "Capsule"):
        radius, half_length = shape.radius(), 0.5 * shape.length()
        if kind == "Cylinder":
            top, ball = half_length, float(np.hypot(radius, half_length))
        else:
            top = ball = half_length + radius
        return (radius, half_length, 0.0), (radius, radius, top), ball
    if kind == "Ellipsoid":
        axes = (shape.a(), shape.b(), shape.c())
        return axes, axes, max(axes)
    return (0.0, 0.0, 0.0), (np.inf, np.inf, np.inf), np.inf  # a half space
