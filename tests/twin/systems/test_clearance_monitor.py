"""Distances and their rates against closed forms, for a box and a sphere on the move."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.geometry import Box, ProximityProperties, Sphere
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from scipy.spatial.transform import Rotation

from pips_drake.errors import InputError
from pips_drake.twin.systems.clearance_monitor import ClearanceMonitor

BOX = np.array([0.4, 0.6, 0.2])
RADIUS = 0.1
RANGE = 0.5
PERIOD = 1.0 / 32.0


class World:
    """A robot of two spheres, `hand` and `elbow`, beside a box `wall` that may move as well."""

    def __init__(self, *, connect_bodies=True, own_wall=False, **options):
        builder = DiagramBuilder()
        self.plant, self.scene_graph = AddMultibodyPlantSceneGraph(builder, 1e-3)
        self.plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, 0.0])
        self.robot = self.plant.AddModelInstance("robot")
        self.scene = self.plant.AddModelInstance("scene")
        inertia = SpatialInertia.SolidSphereWithMass(1.0, RADIUS)
        for name, model, shape in (
            ("hand", self.robot, Sphere(RADIUS)),
            ("elbow", self.robot, Sphere(RADIUS)),
            ("wall", self.scene, Box(*BOX)),
        ):
            body = self.plant.AddRigidBody(name, model, inertia)
            self.plant.RegisterCollisionGeometry(
                body, RigidTransform(), shape, name, ProximityProperties()
            )
        self.plant.Finalize()
        self.monitor = builder.AddSystem(
            ClearanceMonitor(
                self.plant,
                robot=[self.robot, self.scene] if own_wall else [self.robot],
                max_distance=RANGE,
                **options,
            )
        )
        connect = [("query_object", self.scene_graph.get_query_output_port())]
        if connect_bodies:
            connect.append(("body_poses", self.plant.get_body_poses_output_port()))
            velocities = self.plant.get_body_spatial_velocities_output_port()
            connect.append(("body_spatial_velocities", velocities))
        for name, port in connect:
            builder.Connect(port, self.monitor.GetInputPort(name))
        self.diagram = builder.Build()

    def place(self, context, **bodies):
        """Sets poses X_WB and velocities (w, v) of bodies by name."""
        mine = self.plant.GetMyMutableContextFromRoot(context)
        for name, (X_WB, w, v) in bodies.items():
            body = self.plant.GetBodyByName(name)
            self.plant.SetFreeBodyPose(mine, body, X_WB)
            self.plant.SetFreeBodySpatialVelocity(mine, body, SpatialVelocity(w, v))

    def measure(self, **bodies):
        """`clearance` and `witness` of a state, at initialization."""
        simulator = Simulator(self.diagram)
        self.place(simulator.get_mutable_context(), **bodies)
        simulator.Initialize()
        return self.outputs(simulator.get_context())

    def outputs(self, context):
        mine = self.monitor.GetMyContextFromRoot(context)
        return (
            self.monitor.GetOutputPort("clearance").Eval(mine).copy(),
            self.monitor.GetOutputPort("witness").Eval(mine).copy(),
        )


FAR = (RigidTransform([20.0, 0.0, 0.0]), np.zeros(3), np.zeros(3))
STILL = (RigidTransform(), np.zeros(3), np.zeros(3))


def at(p, R=None, w=(0.0, 0.0, 0.0), v=(0.0, 0.0, 0.0)):
    return RigidTransform(RotationMatrix() if R is None else R, p), np.array(w), np.array(v)


def exact_distance(X_WB, centre):
    """Distance of a sphere to the box, m: of its centre to the box, less its radius."""
    p = X_WB.inverse() @ np.asarray(centre)
    return np.linalg.norm(np.maximum(np.abs(p) - 0.5 * BOX, 0.0)) - RADIUS


@pytest.fixture(scope="module")
def world():
    return World()


def test_ports(world):
    monitor = world.monitor
    inputs = [monitor.get_input_port(i).get_name() for i in range(monitor.num_input_ports())]
    assert inputs == ["query_object", "body_poses", "body_spatial_velocities"]
    outputs = [monitor.get_output_port(i) for i in range(monitor.num_output_ports())]
    assert {p.get_name(): p.size() for p in outputs} == {
        "clearance": 3,
        "witness": 7,
        "urgent": 3,
        "own_urgent": 3,
    }


def test_no_output_has_feedthrough(world):
    assert not world.monitor.HasAnyDirectFeedthrough()


@pytest.mark.parametrize(
    "centre",
    [
        [0.45, 0.1, 0.05],  # off a face
        [0.35, -0.5, 0.02],  # off an edge
        [-0.35, 0.4, 0.3],  # off a corner
        [0.25, 0.1, 0.0],  # in penetration by 5 cm
    ],
)
def test_the_distance_of_a_sphere_to_a_box_is_exact(world, centre):
    clearance, witness = world.measure(hand=at(centre), elbow=FAR, wall=STILL)
    # Drake solves sphere against box in closed form: roundings.
    assert clearance[0] == pytest.approx(exact_distance(RigidTransform(), centre), abs=1e-14)
    on_robot, on_scene = witness[1:4], witness[4:7]
    assert np.linalg.norm(on_robot - centre) == pytest.approx(RADIUS, abs=1e-14)
    assert np.max(np.abs(on_scene) - 0.5 * BOX) == pytest.approx(0.0, abs=1e-14)
    assert np.linalg.norm(on_robot - on_scene) == pytest.approx(abs(clearance[0]), abs=1e-14)


def test_the_nearest_pair_is_named_robot_first(world):
    near, far = at([0.4, 0.0, 0.0]), at([-0.5, 0.0, 0.0])
    for names, places in (("hand", (near, far)), ("elbow", (far, near))):
        _, witness = world.measure(hand=places[0], elbow=places[1], wall=STILL)
        assert world.monitor.pair_name(witness[0]) == (f"robot::{names}", "scene::wall")


def test_the_robots_distance_to_itself_is_that_of_its_spheres(world):
    clearance, _ = world.measure(hand=at([5.0, 0.0, 0.0]), elbow=at([5.0, 0.3, 0.2]), wall=STILL)
    assert clearance[2] == pytest.approx(np.hypot(0.3, 0.2) - 2.0 * RADIUS, abs=1e-14)
    assert clearance[0] == RANGE


def test_the_scenes_bodies_count_only_against_the_robot():
    # Wall and hand far apart; a robot of the wall alone sees both spheres as scene.
    world = World()
    monitor = ClearanceMonitor(world.plant, robot=[world.scene])
    assert monitor.pair_name(-1.0) is None
    clearance, _ = world.measure(hand=at([5.0, 0.0, 0.0]), elbow=at([5.0, 0.1, 0.0]), wall=STILL)
    assert clearance[0] == RANGE and clearance[2] < 0.0


def test_the_rate_is_the_derivative_of_the_distance(world):
    rng = np.random.default_rng(10)
    step = 1e-6
    found = []
    for _ in range(40):
        # A turned and turning box, a sphere that turns too (which must not matter) and moves.
        R = RotationMatrix.MakeXRotation(rng.uniform(-3.0, 3.0)) @ RotationMatrix.MakeZRotation(
            rng.uniform(-3.0, 3.0)
        )
        X_WB = RigidTransform(R, rng.uniform(-0.2, 0.2, 3))
        aside = rng.normal(size=3)
        centre = X_WB.translation() + 0.55 * aside / np.linalg.norm(aside)
        w_hand, v_hand, w_box, v_box = rng.uniform(-1.0, 1.0, (4, 3))

        def box_at(time, X=X_WB, w=w_box, v=v_box):
            turn = RotationMatrix(Rotation.from_rotvec(time * w).as_matrix())
            return RigidTransform(turn @ X.rotation(), X.translation() + time * v)

        ahead = exact_distance(box_at(step), centre + step * v_hand)
        behind = exact_distance(box_at(-step), centre - step * v_hand)
        clearance, _ = world.measure(
            hand=at(centre, w=w_hand, v=v_hand), elbow=FAR, wall=(X_WB, w_box, v_box)
        )
        # Central differences: roundings of the distance (1e-16) over the step; and where the
        # nearest point passes from a face to its edge the second derivative jumps, by 1 / distance,
        # which is worth at most step / distance.
        assert clearance[1] == pytest.approx((ahead - behind) / (2.0 * step), abs=1e-5)
        found.append(clearance[1])
    assert min(found) < -0.3 and max(found) > 0.3  # toward and away


def urgent_of(world, *, output="urgent", **bodies):
    """An urgent pair of a state, at initialization, and the pair's names."""
    simulator = Simulator(world.diagram)
    world.place(simulator.get_mutable_context(), **bodies)
    simulator.Initialize()
    mine = world.monitor.GetMyContextFromRoot(simulator.get_context())
    urgent = world.monitor.GetOutputPort(output).Eval(mine).copy()
    pair = None if np.isnan(urgent[2]) else world.monitor.pair_name(urgent[2])
    return urgent, pair


def test_what_closes_in_behind_the_nearest_is_urgent():
    world = World(lookahead=0.2, lookahead_reach=0.15)
    # Faces at x = -0.2 and 0.2, spheres of 0.1: the hand stands 60 mm off, the elbow comes from
    # 120 mm on the other side.
    hand = at([0.36, 0.0, 0.0])
    for speed, nearest in ((0.2, "hand"), (0.4, "elbow")):
        # In 0.2 s 120 mm become 80 mm, or 40 mm.
        elbow = at([-0.42, 0.0, 0.0], v=[speed, 0.0, 0.0])
        urgent, pair = urgent_of(world, hand=hand, elbow=elbow, wall=STILL)
        distance, rate = (0.06, 0.0) if nearest == "hand" else (0.12, -speed)
        np.testing.assert_allclose(urgent[:2], [distance, rate], rtol=0, atol=1e-9)
        assert pair == (f"robot::{nearest}", "scene::wall")


def test_without_a_lookahead_or_anything_near_nothing_is_urgent():
    near = {"hand": at([0.36, 0.0, 0.0], v=[-1.0, 0.0, 0.0]), "elbow": FAR, "wall": STILL}
    assert np.all(np.isnan(urgent_of(World(), **near)[0]))
    world = World(lookahead=0.2, lookahead_reach=0.05)
    assert np.all(np.isnan(urgent_of(world, **near)[0]))


def test_the_arms_own_pair_that_will_be_nearest_is_urgent():
    # Hand and elbow 0.1 m apart at their surfaces, closing in; the wall is far from both.
    hand = at([5.0, 0.0, 0.0], v=[0.0, 0.3, 0.0])
    elbow = at([5.0, 0.3, 0.0], v=[0.0, -0.1, 0.0])
    bodies = {"hand": hand, "elbow": elbow, "wall": STILL}
    world = World(lookahead=0.2, lookahead_reach=0.15)
    urgent, pair = urgent_of(world, output="own_urgent", **bodies)
    np.testing.assert_allclose(urgent[:2], [0.1, -0.4], rtol=0, atol=1e-9)
    assert set(pair) == {"robot::hand", "robot::elbow"}
    assert np.all(np.isnan(urgent_of(world, **bodies)[0]))
    short = World(lookahead=0.2, lookahead_reach=0.05)
    assert np.all(np.isnan(urgent_of(short, output="own_urgent", **bodies)[0]))


def test_of_the_arms_own_pairs_the_one_that_closes_in_is_urgent_not_the_nearest():
    # Three spheres in a row: wall of the scene is a part of this robot. The hand stands 60 mm off
    # its face, and the elbow comes from 120 mm on the other side: 40 mm in 0.2 s.
    hand, elbow = at([0.36, 0.0, 0.0]), at([-0.42, 0.0, 0.0], v=[0.4, 0.0, 0.0])
    world = World(own_wall=True, lookahead=0.2, lookahead_reach=0.15)
    urgent, pair = urgent_of(world, output="own_urgent", hand=hand, elbow=elbow, wall=STILL)
    np.testing.assert_allclose(urgent[:2], [0.12, -0.4], rtol=0, atol=1e-9)
    assert set(pair) == {"robot::elbow", "scene::wall"}
    clearance, _ = world.measure(hand=hand, elbow=elbow, wall=STILL)
    assert clearance[2] == pytest.approx(0.06, abs=1e-14)


def test_in_penetration_the_rate_is_still_that_of_the_signed_distance(world):
    # The sphere's centre is inside, nearest to the face x = 0.2: distance = x - 0.2 - radius.
    clearance, _ = world.measure(
        hand=at([0.17, 0.0, 0.0], v=[-0.3, 0.2, 0.1]), elbow=FAR, wall=STILL
    )
    assert clearance[0] == pytest.approx(-0.13, abs=1e-14)
    assert clearance[1] == pytest.approx(-0.3, abs=1e-14)


def test_with_nothing_near_it_says_so(world):
    clearance, witness = world.measure(hand=at([3.0, 0.0, 0.0]), elbow=FAR, wall=STILL)
    np.testing.assert_array_equal(clearance, [RANGE, np.nan, RANGE])
    np.testing.assert_array_equal(witness, [-1.0] + [np.nan] * 6)
    assert world.monitor.pair_name(witness[0]) is None


@pytest.mark.parametrize(("gap", "seen"), [(RANGE - 1e-6, True), (RANGE + 1e-6, False)])
def test_it_looks_as_far_as_it_is_told(world, gap, seen):
    clearance, witness = world.measure(
        hand=at([0.2 + gap + RADIUS, 0.0, 0.0]), elbow=FAR, wall=STILL
    )
    assert (witness[0] >= 0.0) == seen
    assert clearance[0] == pytest.approx(min(gap, RANGE), abs=1e-14)


@pytest.mark.parametrize("own", [0.05, 0.3, 0.45])
@pytest.mark.parametrize("gap", [0.05, 0.3, 0.45])
def test_the_nearest_are_found_however_far_apart_the_two_distances_are(world, gap, own):
    """Each of them within, or beyond, the shorter range that is looked at first."""
    # Along the wall's face, so that the elbow is as far from the wall as the hand.
    x, y = 0.5 * BOX[0] + gap + RADIUS, own + 2.0 * RADIUS
    clearance, witness = world.measure(
        hand=at([x, 0.0, 0.0]), elbow=at([x + 1e-3, y, 0.0]), wall=STILL
    )
    assert clearance[0] == pytest.approx(gap, abs=1e-14)
    assert clearance[2] == pytest.approx(np.hypot(y, 1e-3) - 2.0 * RADIUS, abs=1e-14)
    assert world.monitor.pair_name(witness[0]) == ("robot::hand", "scene::wall")


def test_it_samples_every_period_and_holds_between(world):
    simulator = Simulator(world.diagram)
    # From 0.5 m off the face towards it at 0.4 m/s; no gravity, so the motion is straight.
    world.place(
        simulator.get_mutable_context(),
        hand=at([0.7, 0.0, 0.0], v=[-0.4, 0.0, 0.0]),
        elbow=FAR,
        wall=STILL,
    )
    seen = []
    for k in range(16):
        simulator.AdvanceTo((k + 0.5) * PERIOD)
        clearance, _ = world.outputs(simulator.get_context())
        seen.append(clearance[0])
        assert clearance[1] == pytest.approx(-0.4, abs=1e-12)
    time = PERIOD * np.arange(16)
    # The plant steps in milliseconds beside 1/32 s: a sample is up to one step old.
    np.testing.assert_allclose(seen, 0.4 - 0.4 * time, rtol=0, atol=0.4 * 1e-3 + 1e-12)


def test_without_the_bodies_ports_there_is_a_distance_but_no_rate():
    world = World(connect_bodies=False)
    clearance, witness = world.measure(
        hand=at([0.4, 0.0, 0.0], v=[-1.0, 0.0, 0.0]), elbow=FAR, wall=STILL
    )
    assert clearance[0] == pytest.approx(0.1, abs=1e-14)
    assert np.isnan(clearance[1])
    assert world.monitor.pair_name(witness[0]) == ("robot::hand", "scene::wall")


def test_a_robot_without_collision_geometry_is_refused():
    world = World()
    model = world.plant.GetModelInstanceByName("DefaultModelInstance")
    message = r"robot \(models: DefaultModelInstance\) has no collision geometry in the scene graph"
    with pytest.raises(InputError, match=message):
        ClearanceMonitor(world.plant, robot=[model])


def test_a_range_that_is_not_positive_is_refused():
    with pytest.raises(InputError, match=r"max_distance = 0.0 m; must be > 0"):
        ClearanceMonitor(World().plant, robot=[], max_distance=0.0)
