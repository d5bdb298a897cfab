"""The surface of a body as patches, and which of them a camera has seen."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.twin.camera import PinholeCamera, seen_distances
from pips_drake.twin.patches import PATCH_SIZE, Grid, Patches, join, sample_shape

if TYPE_CHECKING:
    from pydrake.geometry import GeometryId, QueryObject
    from pydrake.math import RigidTransform

Array = NDArray[np.float64]

#: A patch this far inside another shape is no surface, m.
_BURIED = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class Surface:
    """The surface of a body in the world.

    Attributes:
        name: of the body.
        patches: of all its shapes, without what is buried in other shapes.
        maps: of its cylinders, the largest first.
        left_out: names of shapes of a kind that is not sampled.
    """

    name: str
    patches: Patches
    maps: tuple[CylinderMap, ...] = ()
    left_out: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class CylinderMap:
    """Where a cylinder's patches are in its body's surface.

    Attributes:
        name: of the shape.
        grid: its patches.
        rows: index of each among the surface's patches, (around, along); -1 where buried.
        X_WG: pose of the cylinder.
    """

    name: str
    grid: Grid
    rows: NDArray[np.int_]
    X_WG: RigidTransform


def body_surface(
    query_object: QueryObject,
    geometries: Iterable[GeometryId],
    name: str,
    *,
    size: float = PATCH_SIZE,
) -> Surface:
    """The surface of a body's shapes, where the scene graph has them.

    Cylinders, boxes, spheres, and the convex hulls of meshes; what lies inside another shape of the
    scene is left out, because nothing can see it.

    Raises:
        InputError: none of the shapes can be sampled.
    """
    inspector = query_object.inspector()
    parts, maps, left_out, count = [], [], [], 0
    for geometry in geometries:
        shape_name = inspector.GetName(geometry).split("::")[-1]
        sampled = sample_shape(inspector.GetShape(geometry), size)
        if sampled is None:
            left_out.append(shape_name)
            continue
        local, grid = sampled
        X_WG = query_object.GetPoseInWorld(geometry)
        patches = local.placed(X_WG)
        free = _not_buried(query_object, geometry, patches.points)
        if grid is not None:
            rows = np.where(free, count + np.cumsum(free) - 1, -1)[: grid.around * grid.along]
            maps.append(
                CylinderMap(
                    name=shape_name,
                    grid=grid,
                    rows=rows.reshape(grid.around, grid.along),
                    X_WG=X_WG,
                )
            )
        parts.append(patches.select(free))
        count += len(parts[-1])
    if count == 0:
        raise InputError(
            f"body '{name}' has no surface to look at; must have a collision shape that is a "
            "cylinder, box, sphere, convex or mesh"
        )
    maps.sort(key=lambda item: -item.grid.radius * item.grid.length)
    return Surface(name=name, patches=join(parts), maps=tuple(maps), left_out=tuple(left_out))


@dataclass(kw_only=True, eq=False)
class SeenSurface:
    """Remembers from how near each patch of a surface has been seen.

    Attributes:
        surface: the surface.
        distance: the least so far, (N,) m; infinite where a patch has not been seen.
    """

    surface: Surface
    distance: Array = field(init=False)

    def __post_init__(self) -> None:
        self.distance = np.full(len(self.surface.patches), np.inf)

    def add(
        self,
        camera: PinholeCamera,
        X_WC: RigidTransform,
        *,
        depth_image: ArrayLike | None = None,
    ) -> None:
        """Adds what a camera at `X_WC` sees; `depth_image` as in `seen_distances`."""
        patches = self.surface.patches
        found = seen_distances(
            camera,
            X_WC.translation(),
            X_WC.rotation().matrix(),
            patches.points,
            patches.normals,
            depth_image=depth_image,
        )
        np.minimum(self.distance, found, out=self.distance)

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Which patches have been seen, (N,)."""
        return np.isfinite(self.distance)

    @property
    def area(self) -> float:
        """Seen area, m^2."""
        return float(self.surface.patches.areas[self.seen].sum())

    @property
    def fraction(self) -> float:
        """Seen share of the surface."""
        return self.area / float(self.surface.patches.areas.sum())


def _not_buried(query_object: QueryObject, own: GeometryId, points: Array) -> NDArray[np.bool_]:
    """Which points (N, 3) m in the world lie inside no other shape, (N,)."""
    free = np.ones(len(points), dtype=np.bool_)
    for row, point in enumerate(points):
        inside = query_object.ComputeSignedDistanceToPoint(point, threshold=-_BURIED)
        free[row] = all(found.id_G == own for found in inside)
    return free
