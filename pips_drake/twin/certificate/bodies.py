"""Convex bodies with closed-form supports, read from the scene graph.

Every shape is conv(vertices) + E ball + r ball (Minkowski sums, E a 3 x 3 matrix), so one formula
gives the support of all of them in a direction n:

    h(n) = max over vertices of n . v  +  |E^T n|  +  r |n|

A box has eight vertices; a sphere one and a capsule two, with r; a cylinder two on its axis, with
E = R (1 - u u^T); an ellipsoid one, with E = its semi-axes; a mesh those of its convex hull. A half
space is the exception: its support is finite along its own normal alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pips_drake.errors import InputError

if TYPE_CHECKING:
    from pydrake.geometry import GeometryId, SceneGraphInspector, Shape

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Shapes(NamedTuple):
    """S shapes as arrays, each in its body's frame; a plain tuple, so that compiled code takes it.

    The last four describe a box or upright cylinder about the shape. They only suggest planes.

    Attributes:
        body: the body it is fixed to, (S,).
        vertices: of all shapes, (V, 3) m; shape s has those from `starts[s]` to `starts[s + 1]`.
        starts: (S + 1,).
        bulge: E, (S, 3, 3) m.
        radius: r, (S,) m.
        half_space: its outward normal, (S, 3); zero for every other shape.
        centre: (S, 3) m.
        axes: its axes as columns, (S, 3, 3).
        half: half its sides, (S, 3) m.
        disc: radius of a cylinder about the third axis, (S,) m; 0 for a box.
    """

    body: Indices
    vertices: Array
    starts: Indices
    bulge: Array
    radius: Array
    half_space: Array
    centre: Array
    axes: Array
    half: Array
    disc: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class ConvexBody:
    """One shape in its body's frame; attributes as in `Shapes`."""

    body: int
    vertices: Array
    bulge: Array
    radius: float
    half_space: Array
    centre: Array
    axes: Array
    half: Array
    disc: float = 0.0


def stack_shapes(shapes: Sequence[ConvexBody]) -> Shapes:
    """Shapes as arrays."""
    return Shapes(
        body=np.array([shape.body for shape in shapes], dtype=np.int64),
        vertices=np.ascontiguousarray(np.concatenate([shape.vertices for shape in shapes])),
        starts=np.cumsum([0, *(len(shape.vertices) for shape in shapes)]).astype(np.int64),
        bulge=np.array([shape.bulge for shape in shapes]),
        radius=np.array([shape.radius for shape in shapes]),
        half_space=np.array([shape.half_space for shape in shapes]),
        centre=np.array([shape.centre for shape in shapes]),
        axes=np.array([shape.axes for shape in shapes]),
        half=np.array([shape.half for shape in shapes]),
        disc=np.array([shape.disc for shape in shapes]),
    )


def read_shape(
    inspector: SceneGraphInspector, geometry: GeometryId, body: int, rotation: Array, origin: Array
) -> ConvexBody:
    """A collision geometry as a convex body.

    Args:
        body: index that it gets.
        rotation, origin: pose of the frame that the geometry is registered on, in the body's.

    Raises:
        InputError: a shape that is not convex or not known.
    """
    X_FG = inspector.GetPoseInFrame(geometry)
    turn = rotation @ X_FG.rotation().matrix()
    place = rotation @ X_FG.translation() + origin
    return place_shape(inspector.GetShape(geometry), body, turn, place)


def place_shape(shape: Shape, body: int, rotation: Array, origin: Array) -> ConvexBody:
    """A Drake shape at a pose (rotation (3, 3), origin (3,) m) in its body's frame.

    Raises:
        InputError: a shape that is not convex or not known.
    """
    local = _local(shape)
    about: dict[str, Any] = {"half": np.zeros(3), "disc": 0.0} | local
    vertices = about["vertices"]
    centre = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    return ConvexBody(
        body=body,
        vertices=vertices @ rotation.T + origin,
        bulge=rotation @ about.get("bulge", np.zeros((3, 3))),
        radius=about.get("radius", 0.0),
        half_space=rotation @ about.get("half_space", np.zeros(3)),
        centre=rotation @ centre + origin,
        axes=np.ascontiguousarray(rotation),
        half=about["half"],
        disc=about["disc"],
    )


def _local(shape: Shape) -> dict[str, Any]:
    """A shape in its own frame."""
    kind = type(shape).__name__
    origin = np.zeros((1, 3))
    if kind == "Box":
        half = 0.5 * np.array([shape.width(), shape.depth(), shape.height()])
        return {"vertices": _CORNERS * half, "half": half}
    if kind == "Sphere":
        return {"vertices": origin, "radius": float(shape.radius())}
    if kind in ("Capsule", "Cylinder"):
        end = np.array([0.0, 0.0, 0.5 * shape.length()])
        both, radius = np.stack([-end, end]), float(shape.radius())
        if kind == "Capsule":
            return {"vertices": both, "radius": radius, "half": end}
        bulge = np.diag([radius, radius, 0.0])
        return {"vertices": both, "bulge": bulge, "half": end, "disc": radius}
    if kind == "Ellipsoid":
        half = np.array([shape.a(), shape.b(), shape.c()])
        return {"vertices": origin, "bulge": np.diag(half), "half": half}
    if kind in ("Convex", "Mesh"):
        hull = shape.GetConvexHull()
        vertices = np.array([hull.vertex(i) for i in range(hull.num_vertices())])
        return {"vertices": vertices, "half": 0.5 * np.ptp(vertices, axis=0)}
    if kind == "HalfSpace":
        return {"vertices": origin, "half_space": np.array([0.0, 0.0, 1.0])}
    raise InputError(
        f"a collision shape of kind {kind} has no certified clearance; must be Box, Capsule, "
        "Convex, Cylinder, Ellipsoid, HalfSpace, Mesh or Sphere"
    )


_CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
