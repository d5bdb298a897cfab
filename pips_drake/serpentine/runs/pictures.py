"""Off-screen pictures of an arm in its scene."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder

from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import SerpentineSetup, make_plant, mounting_pose
from pips_drake.twin.rendering import (
    add_renderer,
    corner_points,
    fit_view,
    render_available,
    render_view,
    save_png,
)

Array = NDArray[np.float64]

#: Pixels of a picture.
SIZE = (1600, 1000)


def render_postures(
    folder: Path,
    scenario: SerpentineScenario,
    setup: SerpentineSetup,
    postures: Mapping[str, ArrayLike],
) -> str | None:
    """Renders the arm in its scene, one `NAME.png` a posture (joints,) m and rad.

    Returns:
        None, or one line that says why there are no pictures here.
    """
    missing = render_available()
    if missing is not None:
        return missing
    builder = DiagramBuilder()
    plant, scene_graph, model = make_plant(builder, setup, scenario)
    add_renderer(scene_graph)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    query_port = scene_graph.get_query_output_port()
    scene_context = scene_graph.GetMyContextFromRoot(context)
    for name, joints in postures.items():
        plant.SetPositions(plant.GetMyContextFromRoot(context), model, np.asarray(joints))
        query = query_port.Eval(scene_context)
        X_WC = fit_view(corner_points(query), view_direction(scenario), size=SIZE)
        save_png(render_view(query, X_WC, size=SIZE), folder / f"{name}.png")
    return None


def view_direction(scenario: SerpentineScenario) -> Array:
    """Where the scenario's camera looks, in the world, (3,)."""
    X_W0: RigidTransform = mounting_pose(scenario)
    direction: Array = X_W0.rotation() @ np.array(scenario.view.direction)
    return direction
