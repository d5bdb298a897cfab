"""The plant: the arm and the scene, in the physics engine and in its scene graph."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder

from pips_drake.scene.decomposition import AddConvexParts
from pips_drake.scene.loading import (
    AddMissingNormals,
    AddPlacedFrame,
    AddScene,
    check_anchored,
)
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.legs import lightened
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.sdf import make_sdf
from pips_drake.serpentine.station.faults import displace_bodies
from pips_drake.serpentine.station.legs import AddLegSprings
from pips_drake.serpentine.station.prismatic_legs import (
    AddPrismaticLegs,
    set_default_leg_positions,
)
from pips_drake.serpentine.station.setup import SerpentineSetup, built_arm, mounting_pose
from pips_drake.serpentine.systems.actuator_visualizer import AddActuatorVisualizer

Array = NDArray[np.float64]

#: Name of the frame in which scenes and paths are given: the arm's frame {0}, fixed in the world.
BASE_FRAME = "frame_0"


def AddSerpentineArm(
    plant: MultibodyPlant, arm: SerpentineArm, X_WF: RigidTransform, rail_shift: float = 0.0
) -> ModelInstanceIndex:
    """Adds the arm, generated from its data, with its rail welded to the world.

    The plant gets the frame `frame_0` at `X_WF`, for scenes to be welded to; the arm's own frame
    {0} stands `rail_shift` (m) from it along z.
    """
    parser = Parser(plant)
    parser.SetStrictParsing()
    (model,) = parser.AddModelsFromString(make_sdf(arm), "sdf")
    AddPlacedFrame(plant, BASE_FRAME, X_WF)
    plant.WeldFrames(
        plant.GetFrameByName(BASE_FRAME),
        plant.GetFrameByName(arm.rail.name, model),
        RigidTransform([0.0, 0.0, rail_shift]),
    )
    return model


def plant_time_step(scenario: SerpentineScenario) -> float:
    """The plant's step, s; 0 for a continuous plant."""
    if scenario.integration.scheme == "discrete":
        return 1.0 / scenario.clocks.plant_hz
    return 0.0


def make_plant(
    builder: DiagramBuilder,
    setup: SerpentineSetup,
    scenario: SerpentineScenario,
    *,
    visual_period: float | None = None,
    fidelity: str = "joint",
) -> tuple[MultibodyPlant, SceneGraph, ModelInstanceIndex]:
    """Adds a finalized plant with arm and scene; the arm stands where its motion begins.

    Both are as the scenario's faults have them: a payload displaced, an arm built otherwise.

    Args:
        visual_period: how often the drawn actuators move, s; None for a plant that is only posed.
        fidelity: of the actuators, as in `actuation.fidelity`; a posed plant needs none beyond
            `joint`.
    """
    plant, scene_graph = AddMultibodyPlant(
        MultibodyPlantConfig(
            time_step=plant_time_step(scenario),
            # Lagged is the fast one, and honours implicit PD gains (TAMSI ignores them silently).
            discrete_contact_approximation="lagged",
        ),
        builder,
    )
    arm = built_arm(setup, scenario.faults)
    body_arm = lightened(arm) if fidelity == "truss" else arm
    model = AddSerpentineArm(plant, body_arm, mounting_pose(scenario), setup.rail_shift)
    scene = []
    if setup.scene_file is not None:
        scene = AddScene(plant, setup.scene_file, base_frame=BASE_FRAME)
        displace_bodies(plant, scene, scenario.faults)
        AddMissingNormals(plant, scene_graph, scene)
    if scenario.decompose_meshes:
        AddConvexParts(plant, scene_graph, scene)
    # After the scene: while a plant has constraints, no body of it can be displaced.
    if fidelity == "leg":
        AddLegSprings(plant, model, arm)
    elif fidelity == "truss":
        AddPrismaticLegs(plant, model, arm)
    plant.Finalize()
    if setup.scene_file is not None:
        check_anchored(plant, scene, setup.scene_file)
    home = setup.motion.home
    plant.SetDefaultPositions(model, home)
    if fidelity == "truss":  # its legs are bodies and show themselves
        set_default_leg_positions(plant, arm, home)
        return plant, scene_graph, model
    AddActuatorVisualizer(
        builder,
        plant=plant,
        model=model,
        scene_graph=scene_graph,
        arm=arm,
        period=visual_period,
    )
    return plant, scene_graph, model


def gravity_in_frame_0(plant: MultibodyPlant) -> Array:
    """The plant's gravity as the arm's base frame sees it, (3,) m/s^2."""
    X_W0 = plant.GetFrameByName(BASE_FRAME).GetFixedPoseInBodyFrame()
    gravity: Array = X_W0.rotation().inverse() @ plant.gravity_field().gravity_vector()
    return gravity
