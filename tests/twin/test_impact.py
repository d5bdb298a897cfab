"""How hard a blow is, against closed forms: a sliding mass, a rod, two masses, a glancing blow."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydrake.geometry import Box, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    CoulombFriction,
    ExternallyAppliedSpatialForce,
)
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    PrismaticJoint,
    RevoluteJoint,
    RotationalInertia,
    SpatialInertia,
    UnitInertia,
)
from pydrake.systems.framework import DiagramBuilder

from pips_drake.twin.clearance import ClearanceQuery, LeastDistance
from pips_drake.twin.impact import Impact, find_impact

#: Drake's distances of spheres and boxes are exact but for roundings.
EXACT = 1e-9
RADIUS = 0.05
FRICTION = CoulombFriction(0.0, 0.0)


class World:
    """A plant with a robot of one or more bodies, and a wall: the half-space x > `wall`."""

    def __init__(self, *, wall: float = 0.3) -> None:
        self.builder = DiagramBuilder()
        self.plant, self.scene_graph = AddMultibodyPlantSceneGraph(self.builder, 1e-3)
        self.plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, 0.0])
        self.robot = self.plant.AddModelInstance("robot")
        self.plant.RegisterCollisionGeometry(
            self.plant.world_body(),
            RigidTransform([wall + 0.5, 0.0, 0.0]),
            Box(1.0, 4.0, 4.0),
            "wall",
            FRICTION,
        )

    def ball(self, name, mass, offset=(0.0, 0.0, 0.0), inertia=None):
        """A body with a sphere at `offset`; its mass is at its origin unless `inertia` is given."""
        if inertia is None:
            inertia = SpatialInertia(mass, np.zeros(3), UnitInertia.SolidSphere(RADIUS))
        body = self.plant.AddRigidBody(name, self.robot, inertia)
        self.plant.RegisterCollisionGeometry(
            body, RigidTransform(offset), Sphere(RADIUS), name, FRICTION
        )
        return body

    def slide(self, body, axis, parent=None):
        parent = self.plant.world_body() if parent is None else parent
        joint = PrismaticJoint(body.name(), parent.body_frame(), body.body_frame(), axis)
        self.plant.AddJoint(joint)

    def finish(self):
        self.plant.Finalize()
        return self.builder.Build()

    def hit(self, positions, velocities) -> Impact:
        diagram = self.finish()
        root = diagram.CreateDefaultContext()
        context = self.plant.GetMyMutableContextFromRoot(root)
        self.plant.SetPositions(context, positions)
        self.plant.SetVelocities(context, velocities)
        root.SetTime(0.125)
        port = self.scene_graph.get_query_output_port()
        query = port.Eval(self.scene_graph.GetMyContextFromRoot(root))
        nearest = min(
            ClearanceQuery(self.plant, [self.robot], max_distance=0.5).least(query),
            key=lambda one: one.distance,
        )
        return find_impact(self.plant, context, nearest)


def test_a_sliding_mass_hits_with_itself():
    world = World()
    world.slide(world.ball("ball", 3.0), [1.0, 0.0, 0.0])
    found = world.hit([0.3 - RADIUS + 1e-3], [0.4])
    assert found.pair == ("robot::ball", "WorldModelInstance::world")
    assert found.time == 0.125
    np.testing.assert_allclose(found.normal, [-1.0, 0.0, 0.0], atol=EXACT)
    assert found.point[0] == pytest.approx(0.3, abs=1e-3)
    assert found.closing_speed == pytest.approx(0.4, rel=EXACT)
    assert found.effective_mass == pytest.approx(3.0, rel=EXACT)
    assert found.energy == pytest.approx(0.5 * 3.0 * 0.4**2, rel=EXACT)
    assert found.impulse == pytest.approx(3.0 * 0.4, rel=EXACT)


def test_a_glancing_mass_hits_with_what_moves_along_the_normal():
    """On a rail at 60 deg to the normal, v cos 60 closes in, and a push p along the normal moves
    the mass by p cos 60 / m along the rail, of which cos 60 is along the normal: m / cos^2."""
    world, angle = World(), math.radians(60.0)
    world.slide(world.ball("ball", 3.0), [math.cos(angle), math.sin(angle), 0.0])
    found = world.hit([0.251 / math.cos(angle)], [0.4])
    assert found.closing_speed == pytest.approx(0.4 * 0.5, rel=EXACT)
    assert found.effective_mass == pytest.approx(3.0 / 0.25, rel=EXACT)
    # All that moves moves along the rail, which the wall stops: nothing is left.
    assert found.energy == pytest.approx(0.5 * 3.0 * 0.4**2, rel=EXACT)


def test_a_rod_hits_with_its_inertia_over_the_square_of_the_lever():
    """A uniform rod that turns about its end, and touches at a distance r from it: I = m L^2 / 3
    about the pivot, m_eff = I / r^2; at r = L a third of its mass."""
    mass, length, lever, rate = 2.0, 0.8, 0.6, 1.5
    world = World(wall=0.3)
    inertia = SpatialInertia.MakeFromCentralInertia(
        mass,
        [0.0, 0.5 * length, 0.0],
        RotationalInertia(mass * length**2 / 12.0, 1e-3, mass * length**2 / 12.0),
    )
    rod = world.ball("rod", mass, (0.0, lever, 0.0), inertia)
    frame = world.plant.world_frame()
    # Swings about z, from along y towards +x (negative turns); pivot so that the ball just touches.
    pivot = world.plant.AddFrame(
        FixedOffsetFrame("pivot", frame, RigidTransform([0.3 - RADIUS + 5e-4, 0.0, 0.0]))
    )
    world.plant.AddJoint(RevoluteJoint("pivot", pivot, rod.body_frame(), [0.0, 0.0, 1.0]))
    found = world.hit([0.0], [-rate])
    assert found.closing_speed == pytest.approx(rate * lever, rel=EXACT)
    assert found.effective_mass == pytest.approx(mass * length**2 / 3.0 / lever**2, rel=EXACT)
    # All of the rod's energy is along the normal: I w^2 / 2.
    assert found.energy == pytest.approx(0.5 * mass * length**2 / 3.0 * rate**2, rel=EXACT)


def test_two_parts_of_a_robot_hit_with_their_reduced_mass():
    world = World(wall=50.0)
    for name, mass in (("first", 3.0), ("second", 6.0)):
        world.slide(world.ball(name, mass), [1.0, 0.0, 0.0])
    found = world.hit([0.0, 2.0 * RADIUS - 1e-3], [0.5, -0.25])
    assert set(found.pair) == {"robot::first", "robot::second"}
    assert found.closing_speed == pytest.approx(0.75, rel=EXACT)
    assert found.effective_mass == pytest.approx(2.0, rel=EXACT)


def test_a_chain_answers_a_push_with_less_than_the_whole():
    """A mass on a slide on a slide: what carries it does not feel a push at once."""
    world = World()
    carrier = world.plant.AddRigidBody(
        "carrier", world.robot, SpatialInertia(9.0, np.zeros(3), UnitInertia.SolidSphere(0.1))
    )
    world.slide(carrier, [1.0, 0.0, 0.0])
    world.slide(world.ball("ball", 3.0), [1.0, 0.0, 0.0], carrier)
    found = world.hit([0.1, 0.151], [0.3, 0.1])
    assert found.closing_speed == pytest.approx(0.4, rel=EXACT)
    assert found.effective_mass == pytest.approx(3.0, rel=EXACT)


def test_what_cannot_move_along_the_normal_weighs_infinitely_much():
    world = World()
    world.slide(world.ball("ball", 3.0), [0.0, 1.0, 0.0])
    world.plant.RegisterCollisionGeometry(
        world.plant.world_body(),
        RigidTransform([RADIUS + 0.1 - 1e-3, 0.0, 0.0]),
        Box(0.2, 4.0, 4.0),
        "near_wall",
        FRICTION,
    )
    found = world.hit([0.0], [0.4])
    assert found.effective_mass == math.inf
    assert found.closing_speed == pytest.approx(0.0, abs=1e-15)
    assert found.energy == found.impulse == 0.0
    assert found.sentence().endswith("without closing in")


def test_an_arm_answers_a_push_with_the_acceleration_that_its_effective_mass_says():
    """Three links, bent: a force of 1 N along the normal at the touching point accelerates that
    point by 1 / m_eff along it, by Drake's forward dynamics and differences of positions."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.0)
    parent, robot = plant.world_body(), plant.AddModelInstance("robot")
    for k, axis in enumerate(([0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.6, 0.0, 0.8])):
        moments = RotationalInertia(0.02, 0.05 + 0.01 * k, 0.05)
        inertia = SpatialInertia.MakeFromCentralInertia(2.0 - 0.4 * k, [0.2, 0.03, 0.01], moments)
        body = plant.AddRigidBody(f"link_{k}", robot, inertia)
        hinge = FixedOffsetFrame(f"hinge_{k}", parent.body_frame(), RigidTransform([0.4, 0.0, 0.0]))
        frame = plant.AddFrame(hinge)
        plant.AddJoint(RevoluteJoint(f"joint_{k}", frame, body.body_frame(), axis))
        parent = body
    plant.Finalize()
    diagram = builder.Build()
    root = diagram.CreateDefaultContext()
    context = plant.GetMyMutableContextFromRoot(root)
    posture = np.array([0.3, -0.5, 0.8])
    plant.SetPositions(context, posture)
    normal, p_BP = np.array([0.48, 0.6, 0.64]), np.array([0.35, 0.02, -0.04])

    def place(positions):
        plant.SetPositions(context, positions)
        frame = parent.body_frame()
        return plant.CalcPointsPositions(context, frame, p_BP, plant.world_frame())[:, 0]

    point = place(posture)
    nearest = LeastDistance(
        distance=0.0,
        pair=("robot::link_2", "world"),
        points=np.array([point, point]),
        normal=normal,
        bodies=(parent.index(), plant.world_body().index()),
    )
    mass = find_impact(plant, context, nearest).effective_mass
    accelerations = []
    for force in (0.0, 1.0):
        push = ExternallyAppliedSpatialForce()
        push.body_index, push.p_BoBq_B = parent.index(), p_BP
        push.F_Bq_W = SpatialForce(np.zeros(3), force * normal)
        plant.get_applied_spatial_force_input_port().FixValue(context, [push])
        derivatives = plant.EvalTimeDerivatives(context).get_generalized_velocity()
        accelerations.append(derivatives.CopyToVector())
    change, small = accelerations[1] - accelerations[0], 1e-5
    moved = (place(posture + small * change) - place(posture - small * change)) / (2.0 * small)
    # Central differences of 1e-5 (rad/s^2)/N: their error is of the order of 1e-10.
    assert normal @ moved == pytest.approx(1.0 / mass, rel=1e-7)


def test_a_blow_is_told_with_what_when_and_how_hard():
    blow = Impact(
        time=30.113,
        pair=("prototype::segment_8", "pallet::pallet"),
        point=np.zeros(3),
        normal=np.array([0.0, 1.0, 0.0]),
        closing_speed=0.25,
        effective_mass=16.0,
    )
    assert blow.sentence() == (
        "prototype::segment_8 hit pallet::pallet at 30.113 s: closing in at 0.25 m/s with 16 kg "
        "along the normal, 0.5 J, 4 N s"
    )
    told = blow.summary()
    assert told["hit_pair"] == ["prototype::segment_8", "pallet::pallet"]
    assert told["hit_energy_j"] == 0.5 and told["hit_impulse_n_s"] == 4.0
