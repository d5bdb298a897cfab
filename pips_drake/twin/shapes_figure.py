"""What of a scene is seen and, beside it, what of it collides."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pips_drake.twin.figures import figure_style, new_figure, save_figure
from pips_drake.twin.rendering import add_renderer, corner_points, fit_view, render_view

if TYPE_CHECKING:
    from pydrake.geometry import (
        FrameId,
        GeometryId,
        GeometryInstance,
        QueryObject,
        Role,
        SceneGraph,
    )
    from pydrake.systems.framework import Context

#: Pixels of each of the two pictures.
SIZE = (900, 900)
# Red, green, blue of what collides, shape by shape in turn: the parts of a mesh can be told apart.
_TINTS = ((0.10, 0.40, 0.75), (0.20, 0.60, 0.85), (0.05, 0.50, 0.55), (0.40, 0.45, 0.80))


def shapes_figure(
    file: Path,
    query_object: QueryObject,
    frames: Iterable[FrameId],
    *,
    direction: ArrayLike,
    title: str,
) -> None:
    """Renders some frames' shapes twice from the same view; writes nothing if there are none.

    Args:
        query_object: of the scene graph, in the posture to show.
        frames: whose shapes are shown.
        direction: in which the camera looks, in the world, (3,).
        title: of the figure.
    """
    from pydrake.geometry import Role

    frames = list(frames)
    # Queries look into contexts but do not keep them, so these are held until the end.
    held = [_graph(query_object, frames, role) for role in (Role.kPerception, Role.kProximity)]
    seen, colliding = (graph.get_query_output_port().Eval(context) for graph, context in held)
    corners = np.concatenate([corner_points(seen), corner_points(colliding)])
    if not len(corners):
        return
    X_WC = fit_view(corners, direction, size=SIZE)
    with figure_style():
        figure = new_figure(5.2, title=title)
        layout = figure.add_gridspec(1, 2)
        for column, (query, caption) in enumerate(
            [(seen, "seen"), (colliding, "what collides, each convex shape in a tint")]
        ):
            axes = figure.add_subplot(layout[0, column])
            axes.imshow(render_view(query, X_WC, size=SIZE))
            axes.set_axis_off()
            axes.set_title(caption, loc="left")
        save_figure(figure, file)


def _graph(
    query_object: QueryObject, frames: Iterable[FrameId], role: Role
) -> tuple[SceneGraph, Context]:
    """A scene graph in which the frames' shapes of a role stand still, to be seen."""
    from pydrake.geometry import Role, SceneGraph

    graph, inspector = SceneGraph(), query_object.inspector()
    source = graph.RegisterSource("shapes")
    geometries = [g for frame in frames for g in inspector.GetGeometries(frame, role)]
    for number, geometry in enumerate(geometries):
        tint = None if role == Role.kPerception else _TINTS[number % len(_TINTS)]
        graph.RegisterAnchoredGeometry(source, _standing(query_object, geometry, tint))
    add_renderer(graph)
    return graph, graph.CreateDefaultContext()


def _standing(
    query_object: QueryObject, geometry: GeometryId, tint: tuple[float, float, float] | None
) -> GeometryInstance:
    """A shape where it stands, to be seen; in a tint as what it collides as."""
    from pydrake.geometry import Convex, GeometryInstance, Mesh, PerceptionProperties, Rgba

    inspector = query_object.inspector()
    shape = inspector.GetShape(geometry)
    if tint is None:
        properties = PerceptionProperties(inspector.GetPerceptionProperties(geometry))
    else:
        properties = PerceptionProperties()
        properties.AddProperty("phong", "diffuse", Rgba(*tint, 1.0))
        if isinstance(shape, Mesh):  # this is what Drake lets it collide as
            shape = Convex(shape.source(), np.array(shape.scale3()))
    name = f"{inspector.GetName(inspector.GetFrameId(geometry))}::{geometry.get_value()}"
    instance = GeometryInstance(query_object.GetPoseInWorld(geometry), shape, name)
    instance.set_perception_properties(properties)
    return instance
