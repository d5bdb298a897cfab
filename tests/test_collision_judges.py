"""The campaign's two judges against closed forms: each kind of shape above a floor."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.geometry import Box, Capsule, Convex, Cylinder, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.multibody.tree import PrismaticJoint, SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from benchmarks.collision_judges import TOUCHING, CoalJudge, DrakeJudge, disagreements
from pips_drake.serpentine.runs.placed_arm import PlacedArm

pytestmark = pytest.mark.slow

FRICTION = CoulombFriction(1.0, 1.0)
#: Half of each shape's height, m; the bracket's own origin is at its bottom.
BELOW = {"sphere": 0.1, "box": 0.15, "cylinder": 0.2, "capsule": 0.25, "hull": 0.0}


@pytest.fixture(params=BELOW)
def above_a_floor(request, tmp_path, bracket):
    """A shape that slides along z above a floor at z = 0, and how far its lowest point is down."""
    (tmp_path / "bracket.obj").write_text(bracket.obj())
    shape = {
        "sphere": lambda: Sphere(0.1),
        "box": lambda: Box(0.2, 0.4, 0.3),
        "cylinder": lambda: Cylinder(0.1, 0.4),
        "capsule": lambda: Capsule(0.1, 0.3),
        "hull": lambda: Convex(str(tmp_path / "bracket.obj")),
    }[request.param]()
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 1e-3)
    robot = plant.AddModelInstance("robot")
    body = plant.AddRigidBody("body", robot, SpatialInertia.SolidSphereWithMass(1.0, 0.1))
    plant.AddJoint(PrismaticJoint("lift", plant.world_frame(), body.body_frame(), [0.0, 0.0, 1.0]))
    plant.RegisterCollisionGeometry(body, RigidTransform(), shape, "shape", FRICTION)
    floor, below = RigidTransform([0.0, 0.0, -0.5]), plant.world_body()
    plant.RegisterCollisionGeometry(below, floor, Box(4.0, 4.0, 1.0), "floor", FRICTION)
    plant.Finalize()
    placed = PlacedArm(diagram=builder.Build(), plant=plant, scene_graph=scene_graph, model=robot)
    drake = DrakeJudge(placed)
    return drake, CoalJudge(drake, scene_graph.model_inspector()), BELOW[request.param]


@pytest.mark.parametrize("height", [0.02, 0.001, -0.001, -0.02])
def test_both_judges_know_how_a_shape_stands_to_a_floor(above_a_floor, height):
    drake, coal, below = above_a_floor
    posture = np.array([below + height])
    assert drake.collides(posture) == (height < 0.0)
    least, _ = coal.least(posture)
    # Both libraries iterate to about 1e-6 m.
    assert least == pytest.approx(height, abs=1e-5)
    assert disagreements(drake, coal, posture[None], [0]) == []


def test_what_is_farther_than_the_reach_is_not_looked_at(above_a_floor):
    _, coal, below = above_a_floor
    assert coal.least(np.array([below + 3.0]), reach=0.05) == (0.05, None)


def test_a_contradiction_beyond_touching_is_told(above_a_floor):
    drake, coal, below = above_a_floor
    postures = np.array([[below + 0.01], [below - 0.01]])

    class Blind:
        """Says the opposite."""

        def collides(self, positions):
            return not drake.collides(positions)

    first, second = disagreements(Blind(), coal, postures, [0, 1])
    assert "step 0: Drake says touching, coal 10.0" in first
    assert "step 1: Drake says clear, coal -10.0" in second
    near = np.array([[below + 0.5 * TOUCHING], [below - 0.5 * TOUCHING]])
    assert disagreements(Blind(), coal, near, [0, 1]) == [], "too near to touching to say"
