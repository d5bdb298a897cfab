"""An arm and its scene in a plant that is posed and asked for distances, not simulated."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import QueryObject, SceneGraph
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

    def posed(self, postures: Iterable[NDArray[np.float64]]) -> Iterator[QueryObject]:
        """The scene with the arm in one posture after another, (joints,) m and rad each.

        A query is good until the next is asked for, and no longer than the iterator.
        """
        context = self.diagram.CreateDefaultContext()
        plant_context = self.plant.GetMyMutableContextFromRoot(context)
        scene_context = self.scene_graph.GetMyContextFromRoot(context)
        port = self.scene_graph.get_query_output_port()
        for q in postures:
            self.plant.SetPositions(plant_context, self.model, q)
            yield port.Eval(scene_context)


def place_arm(scenario: SerpentineScenario, setup: SerpentineSetup) -> PlacedArm:
    """The arm and the scene of a scenario in a plant to be posed and asked for distances."""
    builder = DiagramBuilder()
    # Nothing is shown. With a period the drawn actuators stand still until a simulator asks;
    # without one they are posed again for each posture, which takes longer than distances.
    plant, scene_graph, model = make_plant(builder, setup, scenario, visual_period=VISUAL_PERIOD)
    return PlacedArm(diagram=builder.Build(), plant=plant, scene_graph=scene_graph, model=model)
