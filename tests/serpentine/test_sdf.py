"""The generated SDF is, to Drake, the arm that the arm file states."""

from __future__ import annotations

from itertools import combinations, pairwise

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.framework import DiagramBuilder

from pips_drake.scene.packages import find_model_file
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.links import hard_stops
from pips_drake.serpentine.sdf import make_sdf

INCH = 0.0254
DEGREE = np.pi / 180.0

VARIANTS = {
    "prototype": {},
    "mirrored": {"mirrored": True},
    "without offsets": {"offsets": [0.0] * 8},
    "gimbal": {"base": "gimbal"},
    "mirrored gimbal": {"base": "gimbal", "mirrored": True},
    "two segments": {"lengths": [18.0, 14.0], "offsets": [1.1, 0.0]},
    "twelve segments": {"lengths": [12.0] * 12, "offsets": [0.7] * 12},
}


def parsed(arm, plant):
    """Adds the arm strictly, its rail on the world."""
    parser = Parser(plant)
    parser.SetStrictParsing()
    (model,) = parser.AddModelsFromString(make_sdf(arm), "sdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("rail", model))
    plant.Finalize()
    return plant


@pytest.fixture(scope="module")
def plants(arm_variant):
    """Arms and their plants, by variant."""
    arms = {name: arm_variant(**change) for name, change in VARIANTS.items()}
    return {name: (arm, parsed(arm, MultibodyPlant(0.0))) for name, arm in arms.items()}


class Scene:
    """The prototype's plant with its collision geometry."""

    def __init__(self, arm):
        builder = DiagramBuilder()
        self.plant, self.scene_graph = AddMultibodyPlantSceneGraph(builder, 1e-3)
        parsed(arm, self.plant)
        self.diagram = builder.Build()
        self.context = self.diagram.CreateDefaultContext()

    def query(self, q):
        self.plant.SetPositions(self.plant.GetMyMutableContextFromRoot(self.context), q)
        port = self.scene_graph.get_query_output_port()
        return port.Eval(self.scene_graph.GetMyContextFromRoot(self.context))

    def geometry(self, body):
        """The box that a body collides as; crossheads have their actuators' pins besides."""
        box, *pins = self.plant.GetCollisionGeometriesForBody(self.plant.GetBodyByName(body))
        assert len(pins) == (2 if body.startswith("crosshead") else 0)
        return box

    def distances(self, q, max_distance):
        """Distances by pair of bodies' names, of unfiltered pairs nearer than `max_distance`."""
        query = self.query(q)
        inspector = query.inspector()

        def name(geometry):
            return inspector.GetName(inspector.GetFrameId(geometry)).split("::")[-1]

        pairs = query.ComputeSignedDistancePairwiseClosestPoints(max_distance)
        return {frozenset((name(p.id_A), name(p.id_B))): p.distance for p in pairs}


@pytest.fixture(scope="module")
def scene(arm):
    return Scene(arm)


def test_the_committed_sdf_is_what_the_arm_file_makes(arm):
    text = find_model_file("prototype").read_text(encoding="utf-8")
    assert text == make_sdf(arm), "run `pips export prototype` and commit what it writes"


def test_the_committed_sdf_parses_strictly_and_needs_no_other_file():
    plant = MultibodyPlant(0.0)
    parser = Parser(plant)
    parser.SetStrictParsing()
    (model,) = parser.AddModels(str(find_model_file("prototype")))
    assert plant.GetModelInstanceName(model) == "prototype"


@pytest.mark.parametrize("name", VARIANTS)
def test_positions_are_the_joint_values_in_order(plants, name):
    arm, plant = plants[name]
    joints = [plant.GetJointByName(joint) for joint in arm.joint_names]
    assert [joint.position_start() for joint in joints] == list(range(arm.joints))
    assert [joint.velocity_start() for joint in joints] == list(range(arm.joints))
    assert [joint.type_name() for joint in joints] == [
        "prismatic" if slides else "revolute" for slides in arm.is_prismatic
    ]


@pytest.mark.parametrize("name", VARIANTS)
def test_frames_are_the_plants(plants, random_postures, name):
    arm, plant = plants[name]
    context, postures = plant.CreateDefaultContext(), random_postures(arm, 200)
    ours = kinematics.frames(arm, postures)
    for q, frames in zip(postures, ours, strict=True):
        plant.SetPositions(context, q)
        for body, frame in zip(arm.bodies, frames, strict=True):
            X_0B = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(body.name))
            # 1e-9 m is asked for; both are products of some 20 matrices of doubles, and poses
            # stand in the SDF as the shortest text of the same double.
            np.testing.assert_allclose(X_0B.GetAsMatrix4(), frame, rtol=0, atol=1e-13)


@pytest.mark.parametrize("name", VARIANTS)
def test_jacobians_are_the_plants(plants, random_postures, name):
    arm, plant = plants[name]
    context, postures = plant.CreateDefaultContext(), random_postures(arm, 200)
    world, zero = plant.world_frame(), np.zeros(3)
    for joint in (3, arm.joints // 2 + 1, arm.joints):
        ours = kinematics.jacobian(arm, postures, joint)
        frame = plant.GetFrameByName(arm.bodies[joint - 1].name)
        for q, jacobian in zip(postures, ours, strict=True):
            plant.SetPositions(context, q)
            theirs = plant.CalcJacobianSpatialVelocity(
                context, JacobianWrtVariable.kV, frame, zero, world, world
            )
            np.testing.assert_allclose(theirs, jacobian, rtol=0, atol=1e-13)


@pytest.mark.parametrize("name", VARIANTS)
def test_masses_and_their_centres_are_the_arms(plants, name):
    arm, plant = plants[name]
    context = plant.CreateDefaultContext()
    for body in arm.bodies:
        link = plant.GetBodyByName(body.name)
        assert link.get_mass(context) == body.mass
        centre = link.CalcCenterOfMassInBodyFrame(context)
        np.testing.assert_array_equal(centre, body.centre * arm.mirror)
        # A uniform box's inertia about its middle: m (b^2 + c^2) / 12.
        inertia = link.CalcSpatialInertiaInBodyFrame(context).Shift(centre).CalcRotationalInertia()
        square = body.size**2
        np.testing.assert_allclose(
            inertia.get_moments(), body.mass * (square.sum() - square) / 12.0, rtol=1e-12
        )


def test_the_prototype_weighs_what_the_assumed_table_adds_up_to(plants):
    _, plant = plants["prototype"]
    # FACTS: 3 large, 3 medium, 2 small boxes, 7 short links, carriage, crane, camera head; and the
    # rail's 1 kg, which stands for nothing.
    total = 3 * 24.0 + 3 * 14.0 + 2 * 7.0 + 7 * 1.5 + 40.0 + 25.0 + 4.0 + 1.0
    assert plant.CalcTotalMass(plant.CreateDefaultContext()) == pytest.approx(total, abs=1e-12)


def test_joints_stop_where_the_strokes_end(plants):
    _, plant = plants["prototype"]
    # L = 2 a sin(45 deg + theta / 2), 2 mm beyond 30 deg each way; d1 2 mm, theta2 1 deg.
    pins = INCH * np.repeat([9.0, 7.5, 6.0, 2.7], [7, 6, 2, 1])
    for sign, limits in (
        (-1.0, plant.GetPositionLowerLimits()),
        (1.0, plant.GetPositionUpperLimits()),
    ):
        base = [24.9 * INCH - 0.002, -121.0 * DEGREE]
        if sign > 0.0:
            base = [114.5 * INCH + 0.002, -59.0 * DEGREE]
        ends = 2.0 * pins * np.sin((45.0 + sign * 15.0) * DEGREE) + sign * 0.002
        hinges = 2.0 * np.arcsin(ends / (2.0 * pins)) - 90.0 * DEGREE
        np.testing.assert_allclose(limits, np.append(base, hinges), rtol=0, atol=1e-14)


@pytest.mark.parametrize("name", VARIANTS)
def test_the_stops_leave_room_beyond_the_limits(plants, name):
    arm, plant = plants[name]
    lower, upper = hard_stops(arm)
    np.testing.assert_array_equal(plant.GetPositionLowerLimits(), lower)
    np.testing.assert_array_equal(plant.GetPositionUpperLimits(), upper)
    assert np.all(lower < arm.joint_lower) and np.all(upper > arm.joint_upper)


def test_speed_limits_are_the_actuators_over_their_levers(plants):
    _, plant = plants["prototype"]
    pins = INCH * np.repeat([9.0, 7.5, 6.0, 2.7], [7, 6, 2, 1])
    expected = np.append([0.05, 5.0 * DEGREE], 0.025 * np.sqrt(2.0) / pins)
    np.testing.assert_allclose(plant.GetVelocityUpperLimits(), expected, rtol=1e-14)
    np.testing.assert_allclose(plant.GetVelocityLowerLimits(), -expected, rtol=1e-14)


def test_effort_limits_and_gains_are_the_drives(plants):
    arm, plant = plants["prototype"]
    # FACTS' table as amended in the arm file; lever a / sqrt 2 where the hinge is straight.
    pins = INCH * np.repeat([9.0, 7.5, 6.0, 2.7], [7, 6, 2, 1])
    force = np.repeat([25000.0, 6000.0, 600.0], [7, 6, 3])
    stiffness = np.repeat([4e7, 3e7, 2e7], [7, 6, 3])
    efforts = np.append([10000.0, 7000.0], force * pins / np.sqrt(2.0))
    gains = np.append([2e7, 4e6], stiffness * pins**2 / 2.0)
    for j, joint in enumerate(arm.joint_names):
        actuator = plant.GetJointActuatorByName(joint)
        assert actuator.joint().name() == joint
        assert actuator.effort_limit() == pytest.approx(efforts[j], rel=1e-14)
        found = actuator.get_controller_gains()
        assert found.p == pytest.approx(gains[j], rel=1e-14)
        # Damping over stiffness: 5 ms (arm file).
        assert found.d == pytest.approx(0.005 * gains[j], rel=1e-14)


def touching_by_design():
    """Pairs of the prototype that are left out: neighbours, and across what lies between them."""
    chain = ["rail", "carriage", "crane", "segment_1"]
    for i in range(1, 8):
        chain += [f"crosshead_{i}", f"segment_{i + 1}"]
    chain.append("camera_head")
    pairs = {frozenset(pair) for pair in pairwise(chain)}
    pairs |= {frozenset((f"segment_{i}", f"segment_{i + 1}")) for i in range(1, 8)}
    return pairs | {frozenset(("carriage", "segment_1"))}, chain


def test_collision_filters_leave_out_just_what_touches_by_design(arm, scene):
    left_out, chain = touching_by_design()
    inspector = scene.query(arm.joint_home).inspector()
    found = {
        frozenset(pair)
        for pair in combinations(chain, 2)
        if inspector.CollisionFiltered(*map(scene.geometry, pair))
    }
    assert found == left_out


def test_at_home_nothing_touches(arm, scene):
    distances = scene.distances(arm.joint_home, 2.0)
    assert len(distances) > 50
    assert min(distances.values()) > 0.1


def test_filtered_pairs_are_not_reported_in_any_posture(arm, scene, random_postures):
    left_out, _ = touching_by_design()
    for q in random_postures(arm, 20):
        assert not left_out & set(scene.distances(q, 0.1))


def test_an_arm_bent_into_its_rail_is_seen(arm, scene):
    q = arm.joint_home.copy()
    q[1] = -120.0 * DEGREE  # the crane leans the first segment towards the rail
    distances = scene.distances(q, 0.0)
    assert distances[frozenset(("rail", "segment_1"))] < -0.1
    q[1] = -60.0 * DEGREE  # and away from it
    assert scene.distances(q, 0.0) == {}


@pytest.mark.parametrize("name", ["prototype", "mirrored"])
def test_bodies_collide_as_boxes_around_their_centres(arm_variant, name):
    arm = arm_variant(**VARIANTS[name])
    scene = Scene(arm)
    inspector = scene.query(arm.joint_home).inspector()
    for body in (arm.rail, *arm.bodies):
        geometry = scene.geometry(body.name)
        np.testing.assert_array_equal(inspector.GetShape(geometry).size(), body.size)
        pose = RigidTransform(inspector.GetPoseInFrame(geometry))
        # A pose is stored in the body's frame over a round trip: a rounding.
        np.testing.assert_allclose(pose.translation(), body.centre * arm.mirror, rtol=0, atol=1e-15)
        assert pose.rotation().IsExactlyIdentity()


@pytest.mark.parametrize("name", ["prototype", "mirrored"])
def test_crossheads_also_collide_at_their_actuators_pins(arm_variant, name):
    arm = arm_variant(**VARIANTS[name])
    scene = Scene(arm)
    inspector = scene.query(arm.joint_home).inspector()
    # Modules 1 to 3 are moved by large actuators, pins 9 in from the hinges at 45 deg; the even
    # hinge's outer pin stands ahead of the crosshead, the odd one's inner pin behind its far hinge.
    aside = 9.0 * INCH * np.sqrt(0.5)
    for i in (1, 2, 3):
        body = scene.plant.GetBodyByName(f"crosshead_{i}")
        pins = [
            RigidTransform(inspector.GetPoseInFrame(pin)).translation()
            for pin in scene.plant.GetCollisionGeometriesForBody(body)[1:]
        ]
        offset = arm.segment_offset[i - 1]
        # Poses of pins stand in the SDF with 17 digits.
        assert pins[0][0] == pytest.approx(aside, abs=1e-12)
        assert pins[1][0] == pytest.approx(offset - aside, abs=1e-12)
        for pin in pins:
            assert np.linalg.norm(pin[1:]) == pytest.approx(aside, abs=1e-12)


@pytest.mark.parametrize("name", VARIANTS)
def test_every_body_can_be_seen(arm_variant, name):
    arm = arm_variant(**VARIANTS[name])
    plant = Scene(arm).plant
    for body in (arm.rail, *arm.bodies):
        assert plant.GetVisualGeometriesForBody(plant.GetBodyByName(body.name))
