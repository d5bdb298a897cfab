"""What of a scene collides, beside what of it is seen, and where the two differ.

Drake lets a mesh collide as its convex hull: right for a plate, wrong for whatever has a hollow.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pips_drake.errors import InputError
from pips_drake.scene.decomposition import GROUP, MESH, SCALE
from pips_drake.scene.meshes import (
    TriangleMesh,
    convex_hull,
    excess,
    hull_excess,
    joined,
    read_obj,
)

if TYPE_CHECKING:
    from pydrake.geometry import FrameId, GeometryId, SceneGraphInspector, Shape
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import ModelInstanceIndex

Array = NDArray[np.float64]

#: A hull or its parts may differ from their mesh by this much without a warning, m: the engine's
#: own distances are no better.
HULL_TOLERANCE = 1e-3
#: What is seen may stand out of what collides by this much without a warning, m.
SEEN_TOLERANCE = 5e-3
#: Sides of the polygons that stand for circles.
_SIDES = 48


@dataclass(frozen=True, kw_only=True)
class MeshFit:
    """How the convex shapes that collide compare with the mesh that they stand for.

    Attributes:
        file: the mesh's name.
        parts: how many convex shapes.
        larger: how far they reach beyond the mesh, at most, m; None if the mesh cannot be read
            (only *.obj is).
        missing: how far the mesh reaches beyond them, at most, m; 0 for a hull.
        volume_ratio: their volume over the mesh's; None for a mesh that encloses none.
        declared: the model says that the mesh is convex.
    """

    file: str
    parts: int = 1
    larger: float | None = None
    missing: float = 0.0
    volume_ratio: float | None = None
    declared: bool = False


@dataclass(frozen=True, kw_only=True)
class CollisionShape:
    """A shape that collides.

    Attributes:
        body: its body's scoped name.
        kind: Drake's name of the shape.
        size: the shape's own measures in Drake's order, m; of a mesh, its extent along x, y, z.
        fit: for a mesh or its parts.
    """

    body: str
    name: str
    kind: str
    size: tuple[float, ...]
    fit: MeshFit | None = None


@dataclass(frozen=True, kw_only=True)
class SceneShapes:
    """What of a scene collides and what is seen.

    Attributes:
        shapes: what collides; the parts of one mesh are one shape.
        only_seen, only_colliding: bodies that have no counterpart.
        seen_outside: by body, how far what is seen stands out of what collides, at most, m.
    """

    shapes: tuple[CollisionShape, ...]
    only_seen: tuple[str, ...]
    only_colliding: tuple[str, ...]
    seen_outside: dict[str, float]

    def warnings(self) -> list[str]:
        """One sentence for every difference that makes distances wrong or surprising."""
        found = [_warning(shape.body, shape.fit) for shape in self.shapes if shape.fit]
        found += [
            f"{body} is seen but does not collide: the arm passes through it"
            for body in self.only_seen
        ]
        found += [f"{body} collides but is not seen" for body in self.only_colliding]
        found += [
            f"{body} is seen up to {outside * 1e3:.3g} mm outside what collides: distances to it "
            "are too large there"
            for body, outside in self.seen_outside.items()
            if outside > SEEN_TOLERANCE
        ]
        return [text for text in found if text]

    def as_data(self) -> list[dict[str, Any]]:
        """The shapes for a summary, lengths in m."""
        rows = []
        for shape in self.shapes:
            row: dict[str, Any] = {"body": shape.body, "shape": shape.kind, "size_m": shape.size}
            if shape.fit:
                row |= {
                    "mesh": shape.fit.file,
                    "convex_parts": shape.fit.parts,
                    "larger_than_mesh_max_m": shape.fit.larger,
                    "left_out_of_mesh_max_m": shape.fit.missing,
                    "volume_over_mesh": shape.fit.volume_ratio,
                }
            rows.append(row)
        return rows


def scene_frames(plant: MultibodyPlant, robot: ModelInstanceIndex) -> dict[FrameId, str]:
    """The frames of all bodies but a robot's, with the bodies' scoped names."""
    from pydrake.multibody.tree import BodyIndex

    bodies = [plant.get_body(BodyIndex(i)) for i in range(plant.num_bodies())]
    names = {body.index(): str(body.scoped_name()) for body in bodies}
    names[plant.world_body().index()] = "world"
    return {
        plant.GetBodyFrameIdOrThrow(body.index()): names[body.index()]
        for body in bodies
        if body.model_instance() != robot
    }


def describe_shapes(inspector: SceneGraphInspector, frames: Mapping[FrameId, str]) -> SceneShapes:
    """What of some frames collides and what is seen.

    Args:
        inspector: of the scene graph.
        frames: the frames, and how their bodies are called.

    Raises:
        InputError: a mesh has no volume, or cannot be read.
    """
    from pydrake.geometry import Role

    shapes: list[CollisionShape] = []
    only_seen, only_colliding, outside = [], [], {}
    for frame, body in frames.items():
        colliding = inspector.GetGeometries(frame, Role.kProximity)
        seen = inspector.GetGeometries(frame, Role.kIllustration) or inspector.GetGeometries(
            frame, Role.kPerception
        )
        shapes += _colliding_shapes(inspector, body, colliding)
        if seen and not colliding:
            only_seen.append(body)
        elif colliding and not seen:
            only_colliding.append(body)
        elif colliding:
            outside[body] = _seen_outside(inspector, seen, colliding)
    return SceneShapes(
        shapes=tuple(shapes),
        only_seen=tuple(only_seen),
        only_colliding=tuple(only_colliding),
        seen_outside=outside,
    )


def _colliding_shapes(
    inspector: SceneGraphInspector, body: str, geometries: list[GeometryId]
) -> list[CollisionShape]:
    shapes = []
    parts: dict[tuple[str, str, str], list[TriangleMesh]] = {}
    for geometry in geometries:
        shape, name = inspector.GetShape(geometry), inspector.GetName(geometry).split("::")[-1]
        properties = inspector.GetProximityProperties(geometry)
        if properties.HasProperty(GROUP, MESH):
            whole = (
                name.rpartition("_part_")[0],
                properties.GetProperty(GROUP, MESH),
                properties.GetProperty(GROUP, SCALE),
            )
            parts.setdefault(whole, []).append(hull_of(shape, body))
            continue
        fit = None
        if type(shape).__name__ in ("Mesh", "Convex"):
            hull = hull_of(shape, body)
            size, fit = tuple(np.ptp(hull.vertices, axis=0).tolist()), _hull_fit(shape, hull)
        else:
            size = _measures(shape)
        shapes.append(
            CollisionShape(body=body, name=name, kind=type(shape).__name__, size=size, fit=fit)
        )
    for (name, file, scale), hulls in parts.items():
        mesh = read_obj(Path(file), [float(word) for word in scale.split()])
        fit = MeshFit(
            file=Path(file).name,
            parts=len(hulls),
            larger=excess(joined(hulls), mesh),
            missing=excess(mesh, hulls),
            volume_ratio=_ratio(sum(hull.volume for hull in hulls), mesh),
        )
        extent = tuple(np.ptp(mesh.vertices, axis=0).tolist())
        shapes.append(CollisionShape(body=body, name=name, kind="Convex", size=extent, fit=fit))
    return shapes


def _hull_fit(shape: Shape, hull: TriangleMesh) -> MeshFit:
    declared = type(shape).__name__ == "Convex"
    file = _file(shape)
    if file is None or shape.extension() != ".obj":
        name = file.name if file else "in memory"
        return MeshFit(file=name, declared=declared)
    mesh = read_obj(file, shape.scale3())
    return MeshFit(
        file=file.name,
        larger=hull_excess(hull, mesh),
        volume_ratio=_ratio(hull.volume, mesh),
        declared=declared,
    )


def _ratio(volume: float, mesh: TriangleMesh) -> float | None:
    whole = mesh.volume if mesh.closed else 0.0
    return volume / whole if whole > 0.0 else None


def hull_of(shape: Shape, body: str) -> TriangleMesh:
    """The convex hull of a Mesh or Convex, in its own frame.

    Raises:
        InputError: it has no volume.
    """
    file = _file(shape)
    if file is not None and shape.extension() == ".obj":
        points = read_obj(file, shape.scale3()).vertices  # Drake's hull of a plane has a thickness
    else:
        drawn = shape.GetConvexHull()
        points = np.array([drawn.vertex(i) for i in range(drawn.num_vertices())])
    hull = convex_hull(points)
    if hull is None:
        raise InputError(
            f"{body}: mesh {file.name if file else ''} is flat; a mesh that collides must enclose "
            "some volume (a thin box does)"
        )
    return hull


def outline_points(shape: Shape) -> Array:
    """Points whose convex hull is about the shape and inside it, (N, 3) m; none of a half space."""
    return _points(shape, outer=False)


def _file(shape: Shape) -> Path | None:
    return Path(shape.source().path()) if shape.source().is_path() else None


def _mesh_of(shape: Shape) -> TriangleMesh:
    """The mesh of a shape whose source is an .obj, in a file or in memory."""
    file = _file(shape)
    if file is not None:
        return read_obj(file, shape.scale3())
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "mesh.obj"
        copy.write_bytes(shape.source().in_memory().mesh_file.contents())
        return read_obj(copy, shape.scale3())


def _warning(body: str, fit: MeshFit) -> str:
    """What is wrong with a mesh's hull or parts; nothing if nothing is."""
    what = f"{body} mesh {fit.file}"
    if fit.larger is None:
        return (
            f"{what} collides as its convex hull; how much larger that is has not been looked at "
            "(only *.obj is)"
        )
    if max(fit.larger, fit.missing) <= HULL_TOLERANCE:
        return ""
    larger = f"up to {fit.larger * 1e3:.3g} mm larger"
    if fit.parts > 1:
        text = f"{what} collides as {fit.parts} convex parts, {larger}"
        if fit.missing > HULL_TOLERANCE:
            text += f", which leave out up to {fit.missing * 1e3:.3g} mm of it"
        return text
    if fit.volume_ratio is not None:
        larger += f" and {fit.volume_ratio:.3g} times its volume"
    hint = "its model declares it convex" if fit.declared else "`--decompose` splits it"
    return (
        f"{what} collides as its convex hull, {larger}: distances to it are too small in its "
        f"hollows; {hint}"
    )


def _seen_outside(
    inspector: SceneGraphInspector, seen: list[GeometryId], colliding: list[GeometryId]
) -> float:
    """How far what is seen stands out of what collides, at most, m."""
    if any(type(inspector.GetShape(geometry)).__name__ == "HalfSpace" for geometry in colliding):
        return 0.0
    hulls = [
        _moved(inspector, geometry, convex_hull(_points(inspector.GetShape(geometry), outer=True)))
        for geometry in colliding
    ]
    target = [hull for hull in hulls if hull is not None]
    farthest = 0.0
    for geometry in seen:
        surface = _moved(inspector, geometry, _surface(inspector.GetShape(geometry)))
        if surface is not None:
            farthest = max(farthest, excess(surface, target, tolerance=HULL_TOLERANCE))
    return farthest


def _moved(
    inspector: SceneGraphInspector, geometry: GeometryId, mesh: TriangleMesh | None
) -> TriangleMesh | None:
    """A mesh from its geometry's frame to its body's."""
    if mesh is None:
        return None
    X_BG = inspector.GetPoseInFrame(geometry)
    return TriangleMesh((X_BG @ mesh.vertices.T).T, mesh.triangles)


def _surface(shape: Shape) -> TriangleMesh | None:
    """The surface of a shape; None where there are no triangles to look at."""
    kind = type(shape).__name__
    if kind == "Mesh":
        return _mesh_of(shape) if shape.extension() == ".obj" else None
    return convex_hull(_points(shape, outer=False))


def _points(shape: Shape, *, outer: bool) -> Array:
    """Points whose convex hull is about the shape; if `outer`, round ones lie in it, (N, 3) m."""
    kind = type(shape).__name__
    if kind in ("Mesh", "Convex"):
        hull = shape.GetConvexHull()
        return np.array([hull.vertex(i) for i in range(hull.num_vertices())])
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    if kind == "Box":
        return 0.5 * signs * np.array(_measures(shape))
    angles = np.arange(_SIDES) * 2.0 * math.pi / _SIDES
    grow = 1.0 / math.cos(math.pi / _SIDES) if outer else 1.0
    circle = grow * np.column_stack([np.cos(angles), np.sin(angles), 0.0 * angles])
    if kind == "Cylinder":
        radius, half = shape.radius(), [0.0, 0.0, 0.5 * shape.length()]
        return np.concatenate([radius * circle + half, radius * circle - half])
    if kind in ("Sphere", "Capsule", "Ellipsoid"):
        heights = np.linspace(-0.5 * math.pi, 0.5 * math.pi, _SIDES // 2 + 1)
        sphere = np.concatenate(
            [math.cos(h) * circle + [0.0, 0.0, grow * math.sin(h)] for h in heights]
        ) * (grow if outer else 1.0)
        if kind == "Ellipsoid":
            return sphere * [shape.a(), shape.b(), shape.c()]
        ball = shape.radius() * sphere
        half = [0.0, 0.0, 0.5 * shape.length() if kind == "Capsule" else 0.0]
        return np.concatenate([np.add(ball, half), np.subtract(ball, half)])
    return np.empty((0, 3))


def _measures(shape: Shape) -> tuple[float, ...]:
    """A shape's measures in Drake's order, m."""
    names = {
        "Box": ("width", "depth", "height"),
        "Capsule": ("radius", "length"),
        "Cylinder": ("radius", "length"),
        "Ellipsoid": ("a", "b", "c"),
        "Sphere": ("radius",),
    }
    return tuple(float(getattr(shape, name)()) for name in names.get(type(shape).__name__, ()))
