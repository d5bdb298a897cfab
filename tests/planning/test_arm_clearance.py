"""The arm's clearance along a path: exact for boxes, as Drake has it, and between postures too."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.geometry import Box, Capsule, Cylinder, Sphere
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import DiagramBuilder
from scipy.spatial.transform import Rotation

from pips_drake.planning.arm_clearance import arm_bodies, boxes_to_field, least_clearance
from pips_drake.scene.signed_distance import PlacedShape, SignedDistanceField
from pips_drake.serpentine.arm import load_arm

FAR = 5.0


def scene():
    shapes = (Box(0.4, 0.3, 0.2), Cylinder(0.2, 0.6), Sphere(0.25), Capsule(0.1, 0.5))
    places = ([1.0, 0.2, 0.1], [-0.8, 0.9, 0.0], [0.0, -1.2, 0.3], [0.2, 0.4, 1.3])
    return SignedDistanceField.of(
        PlacedShape(f"shape_{k}", "", shape, RigidTransform(RollPitchYaw(0.3 * k, 0.5, 0.2), place))
        for k, (shape, place) in enumerate(zip(shapes, places, strict=True))
    )


def drakes_distances(field, turns, centres, halves):
    """Of each box to each shape, by the engine, (K, M) m."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    friction = CoulombFriction(0.0, 0.0)
    names = {}
    for m, placed in enumerate(field.shapes):
        name = plant.RegisterCollisionGeometry(
            plant.world_body(), placed.X_WG, placed.shape, f"shape_{m}", friction
        )
        names[name] = m
    bodies = []
    for k, half in enumerate(halves):
        bodies.append(plant.AddRigidBody(f"box_{k}", SpatialInertia.SolidSphereWithMass(1.0, 1.0)))
        shape = Box(*(2.0 * half))
        name = plant.RegisterCollisionGeometry(
            bodies[k], RigidTransform(), shape, f"box_{k}", friction
        )
        names[name] = k
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    within = plant.GetMyMutableContextFromRoot(context)
    for k, body in enumerate(bodies):
        pose = RigidTransform(RotationMatrix(turns[k]), centres[k])
        plant.SetFreeBodyPose(within, body, pose)
    query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(context))
    inspector = query.inspector()
    result = np.full((len(halves), len(field.shapes)), np.nan)
    for pair in query.ComputeSignedDistancePairwiseClosestPoints(100.0):
        found = (pair.id_A, pair.id_B)
        still = [inspector.GetName(g).split("::")[-1].startswith("shape") for g in found]
        if any(still):
            m, k = (pair.id_A, pair.id_B) if still[0] else (pair.id_B, pair.id_A)
            result[names[k], names[m]] = pair.distance
    return result


def test_a_boxs_distance_is_the_engines():
    rng, field, count = np.random.default_rng(4), scene(), 60
    turns = Rotation.random(count, random_state=8).as_matrix()
    centres = rng.uniform(-1.2, 1.2, (count, 3))
    halves = rng.uniform(0.02, 0.2, (count, 3))
    expected = drakes_distances(field, turns, centres, halves)
    assert np.isfinite(expected).all()
    least = expected.min(axis=1)
    lower, upper, shapes, points = boxes_to_field(
        field.arrays, turns, centres, halves, np.zeros(count), FAR
    )
    outside = least > 0.0
    assert 40 < outside.sum() < count
    # The engine is good to a millimetre where things are round.
    assert (lower <= upper + 1e-12).all()
    assert (lower[outside] <= least[outside] + 1e-3).all()
    assert (upper[outside] >= least[outside] - 1e-3).all()
    assert (upper - lower)[outside].max() < 2e-3
    # What overlaps is told to: by how much is another question to the engine.
    assert (lower[~outside] < 0.0).all()
    # The point is the box's, and as far from the shape as it says.
    local = np.einsum("kji,kj->ki", turns, points - centres)
    assert (np.abs(local) <= halves + 1e-12).all()
    nearest = field.nearest(points)
    assert_allclose(nearest.distances, upper, rtol=0, atol=1e-12)
    assert_array_equal(nearest.indices, shapes)


def test_a_ball_is_its_middle_less_its_radius_and_what_is_far_counts_as_far():
    field, centres = scene(), np.array([[0.3, 0.0, 0.0], [40.0, 0.0, 0.0]])
    turns, radii = np.tile(np.eye(3), (2, 1, 1)), np.array([0.05, 0.05])
    lower, upper, shapes, _ = boxes_to_field(
        field.arrays, turns, centres, np.zeros((2, 3)), radii, FAR
    )
    assert_allclose(lower[0], field.distances(centres[:1])[0] - 0.05, rtol=0, atol=1e-12)
    assert_allclose(upper[0], lower[0], rtol=0, atol=1e-12)
    assert lower[1] == upper[1] == FAR
    assert shapes[1] == -1


def test_a_thin_rod_between_two_postures_is_not_jumped_over():
    """It stands across, beside the feed: bodies pass it, and are far from it at both ends."""
    arm = load_arm("cmu_92")
    pose = RigidTransform(RollPitchYaw(np.pi / 2, 0.0, 0.0), [0.6, 0.0, 3.0])
    field = SignedDistanceField.of([PlacedShape("rod", "", Cylinder(0.005, 4.0), pose)])

    def postures(s):
        joints = np.tile(arm.joint_home, (len(s), 1))
        joints[:, 0] = s
        return joints

    bodies = arm_bodies(arm)
    found = least_clearance(
        arm, field, postures, [0.7, 3.2], shift=np.zeros(3), within=1.0, bodies=bodies
    )
    fine = least_clearance(
        arm, field, postures, np.linspace(0.7, 3.2, 501), shift=np.zeros(3), within=1.0
    )
    assert found.lower <= found.seen
    assert fine.seen - 2.5e-3 <= found.lower <= fine.seen + 1e-9
    assert found.seen == pytest.approx(fine.seen, abs=2e-3)
    assert field.distances(found.point[None])[0] == pytest.approx(found.seen, abs=1e-9)
    shifted = least_clearance(
        arm, field, postures, [0.7, 3.2], shift=np.array([-0.02, 0.0, 0.0]), within=1.0
    )
    assert shifted.lower == pytest.approx(found.lower + 0.02, abs=2.5e-3)
