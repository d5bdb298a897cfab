"""An arm and its scene in a plant that is posed and asked for distances, not simulated."""

from __future__ import annotations

from dataclasses import dataclass

from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder

from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import VISUAL_PERIOD, SerpentineSetup, make_plant


@dataclass(frozen=True, kw_only=True)
class PlacedArm:
    """An arm in a plant with its scene; the diagram is held because it owns the others."""

    diagram: Diagram
    plant: MultibodyPlant
    scene_graph: SceneGraph
    model: ModelInstanceIndex


def place_arm(scenario: SerpentineScenario, setup: SerpentineSetup) -> PlacedArm:
    """The arm and the scene of a scenario in a plant to be posed and asked for distances."""
    builder = DiagramBuilder()
    # Nothing is shown. With a period the drawn actuators stand still until a simulator asks;
    # without one they are posed again for each posture, which takes longer than distances.
    plant, scene_graph, model = make_plant(builder, setup, scenario, visual_period=VISUAL_PERIOD)
    return PlacedArm(diagram=builder.Build(), plant=plant, scene_graph=scene_graph, model=model)
