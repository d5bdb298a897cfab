"""Pictures and replay of an arm in its scene."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder

from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import SerpentineSetup, arm_pose, make_plant, mounting_pose
from pips_drake.twin.rendering import (
    add_renderer,
    corner_points,
    fit_view,
    render_available,
    render_view,
    save_png,
)
from pips_drake.twin.replay import LineInSpace, write_replay

Array = NDArray[np.float64]

#: Pixels of a picture.
SIZE = (1600, 1000)
#: Points at which a path is drawn.
PATH_POINTS = 300


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
    diagram, plant, scene_graph, model = _make_posed(scenario, setup, rendered=True)
    context = diagram.CreateDefaultContext()
    query_port = scene_graph.get_query_output_port()
    scene_context = scene_graph.GetMyContextFromRoot(context)
    for name, joints in postures.items():
        plant.SetPositions(plant.GetMyContextFromRoot(context), model, np.asarray(joints))
        query = query_port.Eval(scene_context)
        X_WC = fit_view(corner_points(query), view_direction(scenario), size=SIZE)
        save_png(render_view(query, X_WC, size=SIZE), folder / f"{name}.png")
    return None


def write_run_replay(
    file: Path,
    scenario: SerpentineScenario,
    setup: SerpentineSetup,
    *,
    title: str,
    time: ArrayLike,
    joints: ArrayLike,
) -> None:
    """Writes recorded joints (N, joints) m and rad at times (N,) s as a 3-D page with the path."""
    diagram, plant, scene_graph, model = _make_posed(scenario, setup, rendered=False)
    context = diagram.CreateDefaultContext()
    query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(context))
    corners = corner_points(query)
    X_WC = fit_view(corners, view_direction(scenario), size=SIZE)
    # A point ahead of the eye, as far as the middle of what is seen: the page turns about it.
    eye, ahead = X_WC.translation(), X_WC.rotation().col(2)
    target = eye + ahead * float((corners.mean(axis=0) - eye) @ ahead)
    path = setup.path.point(np.linspace(0.0, setup.path.length, PATH_POINTS))
    X_W0: RigidTransform = arm_pose(scenario, setup)
    write_replay(
        file,
        diagram=diagram,
        plant=plant,
        model=model,
        time=time,
        positions=joints,
        eye=eye,
        target=target,
        title=title,
        lines=[LineInSpace(name="tip path", points=(X_W0 @ path.T).T)],
    )


def _make_posed(
    scenario: SerpentineScenario, setup: SerpentineSetup, *, rendered: bool
) -> tuple[Diagram, MultibodyPlant, SceneGraph, ModelInstanceIndex]:
    """A plant that is posed and looked at, not simulated."""
    builder = DiagramBuilder()
    plant, scene_graph, model = make_plant(builder, setup, scenario)
    if rendered:
        add_renderer(scene_graph)
    return builder.Build(), plant, scene_graph, model


def view_direction(scenario: SerpentineScenario) -> Array:
    """Where the scenario's camera looks, in the world, (3,)."""
    X_W0: RigidTransform = mounting_pose(scenario)
    direction: Array = X_W0.rotation() @ np.array(scenario.view.direction)
    return direction
