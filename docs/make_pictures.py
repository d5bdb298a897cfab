"""Renders the pictures of the documents: docs/images/*.png and models/sdf/MODEL/MODEL.png.

    python docs/make_pictures.py [NAME ...]

A NAME is a shipped scenario or a model of models/sdf; without one, all models, and the scenarios
that have a picture already. The same versions give the same bytes. Scenarios are shown as planned,
at the path's end, from their own `view`.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.image import imread
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from pips_drake.remote_manipulator.configuration import load_configuration
from pips_drake.remote_manipulator.station.plant import X_WR, home_arm_vector
from pips_drake.scenarios import load_scenario
from pips_drake.scene.packages import find_model_file, list_names, models_directory
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.mounting import mounting_rotation
from pips_drake.serpentine.plan import make_plan
from pips_drake.serpentine.runs.pictures import render_posture
from pips_drake.serpentine.station import AddSerpentineArm, load_setup
from pips_drake.serpentine.systems.actuator_visualizer import AddActuatorVisualizer
from pips_drake.twin.rendering import (
    Picture,
    add_renderer,
    corner_points,
    fit_view,
    render_available,
    render_view,
    save_png,
)

IMAGES = Path(__file__).resolve().parent / "images"
#: Pixels of a model's picture, before its empty border is cut off.
SIZE = (1200, 750)
#: How far an arm's hinges are bent in its picture, as a part of their limits.
BENDS = {"prototype": 0.6, "cmu_92": -0.15}
#: Where one looks at the remote manipulator's parts from: z of their own frames points down.
DOWNWARD = {
    "rms_arm": [-0.3, 0.9, -0.25],
    "rms_cae": [-0.9, 0.35, -0.3],
    "rms_cargo_bay": [0.8, -0.35, -0.5],
    "rms_orbiter": [0.9, 0.6, -0.5],
    "rms_payload": [0.6, 0.8, -0.45],
}
#: Free border around what is shown, pixels.
BORDER = 24


def main(names: list[str]) -> None:
    """Renders what is named, or everything."""
    missing = render_available()
    if missing is not None:
        sys.exit(missing)
    IMAGES.mkdir(exist_ok=True)
    for name in names or sorted(file.stem for file in IMAGES.glob("*.png")):
        if name in list_names("scenario"):
            picture_scenario(name)
    for name in names or list_names("model"):
        if name in list_names("model"):
            picture_model(name)


def picture_scenario(name: str) -> None:
    """The arm at the end of a scenario's planned path, to docs/images."""
    scenario = load_scenario(name)
    setup = load_setup(scenario.config, folder=scenario.folder)
    end = make_plan(setup.arm, setup.path).joints[-1]
    file = IMAGES / f"{name}.png"
    render_posture(file, scenario.config, setup, end)
    save_png(cut(np.uint8(255.0 * imread(file)[:, :, :3] + 0.5)), file)


def picture_model(name: str) -> None:
    """A model alone, beside its SDF; an arm bent, as on the pad."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.01)
    add_renderer(scene_graph)
    if name in list_names("arm"):
        arm = load_arm(name)
        X_W0 = RigidTransform(RotationMatrix(mounting_rotation("pad")), np.zeros(3))
        model = AddSerpentineArm(plant, arm, X_W0)
        plant.Finalize()
        AddActuatorVisualizer(
            builder, plant=plant, model=model, scene_graph=scene_graph, arm=arm, period=None
        )
        posture = arm.joint_home.copy()
        # One way, then the other, clear of the rail.
        bend = BENDS.get(name, -0.4)
        first, middle = arm.first_actuated_joint, arm.joints // 2
        posture[first + 2 : middle] = bend * arm.joint_upper[first + 2 : middle]
        posture[middle:] = -bend * arm.joint_upper[middle:]
        plant.SetDefaultPositions(model, posture)
        direction = [0.5, 0.8, -0.15]
    elif name in DOWNWARD:
        (model,) = Parser(plant).AddModels(str(find_model_file(name)))
        root = plant.get_body(plant.GetBodyIndices(model)[0])
        plant.WeldFrames(plant.world_frame(), root.body_frame(), X_WR)
        plant.Finalize()
        if plant.num_positions():
            plant.SetDefaultPositions(home_arm_vector(load_configuration("rms_71")))
        direction = DOWNWARD[name]
    else:
        parser = Parser(plant)
        (model,) = parser.AddModels(str(find_model_file(name)))
        (link,) = plant.GetBodyIndices(model)
        plant.WeldFrames(plant.world_frame(), plant.get_body(link).body_frame())
        plant.Finalize()
        direction = [-0.5, 0.8, -0.45] if "payload" in name else [0.8, 0.35, -0.5]
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(context))
    X_WC = fit_view(corner_points(query), direction, size=SIZE)
    file = models_directory() / "sdf" / name / f"{name}.png"
    save_png(cut(render_view(query, X_WC, size=SIZE)), file)


def cut(picture: Picture) -> Picture:
    """The picture without most of its empty border; the background is its corner's colour."""
    shown = np.any(picture != picture[0, 0], axis=2)
    (top, bottom), (left, right) = (np.flatnonzero(shown.any(axis=k))[[0, -1]] for k in (1, 0))
    rows = slice(max(0, top - BORDER), bottom + BORDER)
    return picture[rows, max(0, left - BORDER) : right + BORDER]


if __name__ == "__main__":
    main(sys.argv[1:])
