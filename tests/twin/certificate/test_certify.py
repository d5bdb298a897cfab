"""Certificates of plants: every kind of shape and joint, Drake's own distances, trajectory 4."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    GeometryInstance,
    HalfSpace,
    MeshcatCone,
    ProximityProperties,
    Sphere,
)
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.multibody.tree import (
    BallRpyJoint,
    PrismaticJoint,
    RevoluteJoint,
    SpatialInertia,
    UniversalJoint,
)
from pydrake.systems.framework import DiagramBuilder

from pips_drake.errors import InputError
from pips_drake.scenarios import load_scenario
from pips_drake.scene.decomposition import AddConvexParts
from pips_drake.serpentine.plan import make_plan
from pips_drake.serpentine.runs.placed_arm import place_arm
from pips_drake.serpentine.station import load_setup
from pips_drake.twin.certificate.bodies import place_shape
from pips_drake.twin.certificate.certify import certify_clearance, read_problems
from pips_drake.twin.certificate.proof import make_proof, save_proof
from pips_drake.twin.certificate.search import certify
from pips_drake.twin.certificate.verify import check_proof, verify_proof
from pips_drake.twin.clearance import ClearanceQuery

FRICTION = CoulombFriction(0.5, 0.5)


class Bench:
    """A plant with a robot that the test builds, and a scene."""

    def __init__(self) -> None:
        self.builder = DiagramBuilder()
        self.plant, self.scene_graph = AddMultibodyPlantSceneGraph(self.builder, 0.0)
        self.robot = self.plant.AddModelInstance("robot")
        self.scene = self.plant.AddModelInstance("scene")
        self.world = self.plant.world_body()

    def body(self, name, model, shape=None, X=None):
        inertia = SpatialInertia.SolidSphereWithMass(1.0, 0.1)
        body = self.plant.AddRigidBody(name, model, inertia)
        if shape is not None:
            self.shape(body, shape, X)
        return body

    def shape(self, body, shape, X=None):
        count = len(self.plant.GetCollisionGeometriesForBody(body))
        X = X or RigidTransform()
        return self.plant.RegisterCollisionGeometry(
            body, X, shape, f"{body.name()}_{count}", FRICTION
        )

    def finish(self):
        self.plant.Finalize()
        self.diagram = self.builder.Build()
        self.context = self.diagram.CreateDefaultContext()
        return self

    def certify(self, positions, **options):
        inspector = self.scene_graph.model_inspector()
        return certify_clearance(self.plant, inspector, [self.robot], positions, **options)

    def drake(self, q) -> float:
        """Drake's own distance of robot and scene, m."""
        self.plant.SetPositions(self.plant.GetMyContextFromRoot(self.context), q)
        port = self.scene_graph.get_query_output_port()
        query = port.Eval(self.scene_graph.GetMyContextFromRoot(self.context))
        clearance = ClearanceQuery(self.plant, [self.robot], max_distance=10.0)
        return clearance.least(query)[0].distance


def slider(shape, obstacle, X_obstacle=None, X_shape=None):
    """A shape that slides along x, and an anchored obstacle."""
    bench = Bench()
    tool = bench.body("tool", bench.robot, shape, X_shape)
    bench.plant.AddJoint(
        PrismaticJoint("x", bench.world.body_frame(), tool.body_frame(), [1.0, 0.0, 0.0])
    )
    bench.shape(bench.world, obstacle, X_obstacle)
    return bench.finish()


def up(z: float, roll: float = 0.0, pitch: float = 0.0) -> RigidTransform:
    return RigidTransform(RollPitchYaw(roll, pitch, 0.0), [0.0, 0.0, z])


#: Of a body that tumbles, rad.
ANGLES = ((0.0, 0.0, 0.0), (1.0, 0.5, 0.0), (2.0, 0.0, 1.0))
SHAPES = {
    # Above the plane z = 0 by these, when the shape stands at z = 1.
    "box": (Box(0.2, 0.4, 0.6), 0.7),
    "sphere": (Sphere(0.3), 0.7),
    "capsule": (Capsule(0.1, 0.6), 0.6),
    "cylinder": (Cylinder(0.2, 0.6), 0.7),
    "ellipsoid": (Ellipsoid(0.1, 0.2, 0.4), 0.6),
    "convex": (Convex(np.array([[0, 0, -0.5], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]).T, "c"), 0.5),
}
FLOORS = {
    "half space": (HalfSpace(), RigidTransform()),
    "box": (Box(9.0, 9.0, 2.0), up(-1.0)),
    "cylinder": (Cylinder(9.0, 2.0), up(-1.0)),
}


@pytest.mark.parametrize("floor", FLOORS)
@pytest.mark.parametrize("name", SHAPES)
def test_every_shape_above_a_floor(name, floor) -> None:
    shape, height = SHAPES[name]
    bench = slider(shape, *FLOORS[floor], X_shape=up(1.0))
    found = bench.certify([[-0.5], [0.5]]).scene
    assert found.lower <= height + 1e-9
    assert found.upper == pytest.approx(height, abs=1e-7)
    assert found.upper - found.lower <= 1e-4
    assert check_proof(make_proof(found)).failures == ()


@pytest.mark.parametrize("name", SHAPES)
def test_every_shape_as_obstacle_and_tilted(name) -> None:
    # A ball slides past: its distance from the shape where it is nearest, against Drake's, which
    # is exact for a sphere and any shape.
    shape, _ = SHAPES[name]
    bench = slider(Sphere(0.05), shape, up(0.0, 0.4, 0.3), RigidTransform([0.0, 0.1, 1.2]))
    found = bench.certify([[-1.0], [-0.1], [1.0]], tolerance=1e-5).scene
    least = min(bench.drake([x]) for x in np.linspace(-1.0, 1.0, 4001))
    # Drake's is sampled every 0.5 mm; the ball's own curve rises by 1e-7 in that.
    assert found.lower <= least + 1e-8
    assert least - 2e-5 <= found.upper <= least + 1e-5


#: Where Drake (1.58) has a capsule too far from a box by 1 mm and more, once by 165 mm: places (m)
#: and angles (rad); eight of 170,000 random ones.
DRAKE_IS_WRONG = (
    ((-0.486, 0.280, -0.454), (-2.42, -1.39, -1.94)),
    ((-0.585, -0.030, -0.717), (2.38, 2.52, -2.88)),
    ((-0.038, 0.017, 0.543), (-0.67, 1.14, -1.86)),
    ((0.500, 0.744, 0.091), (-2.68, -2.96, -1.26)),
    ((0.265, 0.705, 0.040), (-0.70, 0.56, 1.08)),
    ((0.629, 0.036, 0.179), (1.26, 0.15, -0.60)),
    ((-0.641, -0.104, 0.094), (2.77, -0.25, -0.16)),
    ((0.578, -0.228, -0.323), (1.86, 0.60, 0.39)),
)


def test_where_drake_is_wrong_the_certificate_is_right(truth) -> None:
    half = np.array([0.25, 0.2, 0.3])
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    bench = Bench()
    bench.body("tool", bench.robot, Capsule(0.1, 1.0))
    bench.shape(bench.world, Box(*(2.0 * half)))
    bench.finish()
    worse = 0
    for place, angles in DRAKE_IS_WRONG:
        turn = RotationMatrix(RollPitchYaw(angles))
        q = np.concatenate([turn.ToQuaternion().wxyz(), place])
        ends = np.array([[0.0, 0.0, -0.5], [0.0, 0.0, 0.5]]) @ turn.matrix().T + place
        exact = truth.core_distance(ends, corners) - 0.1
        found = bench.certify([q], tolerance=1e-6).scene
        assert exact - 1e-6 <= found.lower <= exact + 1e-9
        assert exact - 1e-9 <= found.upper <= exact + 1e-6
        # A proof, which rests on no distance engine.
        assert check_proof(make_proof(found)).failures == ()
        worse += bench.drake(q) > found.upper + 0.9e-3
    # There are such postures, so this test looks at what it is about. (Not all of them in every
    # version of Drake: it depends on rounding.)
    assert worse >= 2


def test_an_obstacle_that_moves_is_met_where_it_is() -> None:
    """Two balls on parallel rails, one going there, one coming back: 0.1 m apart in the middle."""
    bench = Bench()
    for model, name, y in ((bench.robot, "tool", 0.0), (bench.scene, "cart", 0.5)):
        body = bench.body(name, model, Sphere(0.2))
        place = bench.plant.AddFrame(_fixed_frame(bench, f"{name}_rail", [0.0, y, 0.0]))
        bench.plant.AddJoint(PrismaticJoint(f"{name}_x", place, body.body_frame(), [1.0, 0, 0]))
    bench.finish()
    found = bench.certify([[-1.0, 1.0], [1.0, -1.0]], times=[0.0, 4.0]).scene
    assert found.upper == pytest.approx(0.1, abs=1e-4)
    assert found.upper - 1e-4 <= found.lower <= 0.1 + 1e-12
    assert found.witness.time == pytest.approx(2.0, abs=0.1)
    assert found.witness.bodies == ("robot::tool", "scene::cart")
    # Side by side all the way they are as near; behind each other never.
    side = bench.certify([[-1.0, -1.0], [1.0, 1.0]]).scene
    assert side.lower == pytest.approx(0.1, abs=1e-6)
    apart = bench.certify([[-1.0, 2.0], [1.0, 4.0]]).scene
    assert apart.lower == pytest.approx(math.hypot(3.0, 0.5) - 0.4, abs=1e-6)


def _fixed_frame(bench, name, place):
    from pydrake.multibody.tree import FixedOffsetFrame

    return FixedOffsetFrame(name, bench.world.body_frame(), RigidTransform(place))


def test_a_carried_payload_counts_as_the_robot() -> None:
    """A hinge carries a long rod: the hand stays clear of the wall by 0.8 m, the rod by 0.3 m."""
    bench = Bench()
    hand = bench.body("hand", bench.robot, Sphere(0.1))
    bench.plant.AddJoint(
        RevoluteJoint("hinge", bench.world.body_frame(), hand.body_frame(), [0.0, 0.0, 1.0])
    )
    load = bench.plant.AddModelInstance("load")
    rod = bench.body("rod", load, Capsule(0.1, 1.0), up(0.0, 0.0, 0.5 * math.pi))
    bench.plant.WeldFrames(hand.body_frame(), rod.body_frame(), RigidTransform())
    bench.shape(bench.world, Box(0.2, 4.0, 4.0), RigidTransform([1.0, 0.0, 0.0]))
    bench.finish()
    inspector = bench.scene_graph.model_inspector()
    path = [[-1.5], [1.2]]  # along the wall, then at it, at 0, in between
    alone = certify_clearance(bench.plant, inspector, [bench.robot], path)
    carried = certify_clearance(bench.plant, inspector, [bench.robot, load], path)
    assert carried.scene.upper == pytest.approx(0.3, abs=1e-4)
    assert carried.scene.witness.bodies[0] == "load::rod"
    assert carried.scene.upper - carried.scene.lower <= 1e-4
    assert alone.scene.upper == pytest.approx(0.8, abs=1e-4)
    assert alone.scene.witness.bodies[0] == "robot::hand"


def test_a_free_body_that_tumbles_is_bounded(truth) -> None:
    bench = Bench()
    bench.body("crate", bench.robot, Box(0.4, 0.3, 0.2))
    bench.shape(bench.world, Box(2.0, 2.0, 1.0), up(-0.9))
    bench.finish()
    turns = [
        RotationMatrix(RollPitchYaw(*angles)) for angles in ((0, 0, 0), (1, 0.5, 0), (2, 0, 1))
    ]
    places = [[0.0, 0.0, 0.2], [0.1, 0.0, 0.0], [0.0, 0.1, 0.1]]
    knots = [
        np.concatenate([turn.ToQuaternion().wxyz(), place])
        for turn, place in zip(turns, places, strict=True)
    ]
    found = bench.certify(knots).scene
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    least = np.inf
    for k in range(2):
        way = (turns[k].inverse() @ turns[k + 1]).ToAngleAxis()
        for s in np.linspace(0.0, 1.0, 401):
            step = RotationMatrix(type(way)(s * way.angle(), way.axis()))
            R = (turns[k] @ step).matrix()
            place = (1.0 - s) * np.array(places[k]) + s * np.array(places[k + 1])
            box = corners * [0.2, 0.15, 0.1] @ R.T + place
            least = min(least, box[:, 2].min() + 0.4)  # above the floor at z = -0.4
    assert found.lower <= least
    assert least - 1e-4 <= found.upper <= least + 1e-4


def test_a_mesh_is_bounded_by_its_hull_or_by_its_parts(bracket, tmp_path: Path) -> None:
    """In the bracket's hollow a ball is clear of both legs, and inside of the convex hull."""
    bracket.write(tmp_path, fixed=True)
    (tmp_path / "bracket.sdf").write_text(
        (tmp_path / "bracket.sdf").read_text().replace("<uri>", f"<uri>file://{tmp_path}/")
    )
    found = {}
    for parts in (False, True):
        bench = Bench()
        tool = bench.body(
            "tool", bench.robot, Sphere(0.02), RigidTransform([0.0, 0.14, 0.5 * bracket.height])
        )
        bench.plant.AddJoint(
            PrismaticJoint("x", bench.world.body_frame(), tool.body_frame(), [1.0, 0.0, 0.0])
        )
        models = Parser(bench.plant).AddModels(str(tmp_path / "bracket.sdf"))
        if parts:
            AddConvexParts(bench.plant, bench.scene_graph, models)
        bench.finish()
        found[parts] = bench.certify([[0.16], [0.18]]).scene
    # At x = 0.16: 0.06 m from the leg along y, 0.04 m from that along x; less the ball's radius.
    # The parts may be larger than the legs by what CoACD leaves.
    assert found[True].lower == pytest.approx(0.02, abs=3e-3)
    assert found[True].upper - found[True].lower <= 1e-4
    assert found[False].upper < -0.02
    assert check_proof(make_proof(found[False])).failures == ()


@pytest.mark.parametrize("joint", [BallRpyJoint, UniversalJoint])
def test_joints_that_are_not_known_may_only_stand_still(joint) -> None:
    bench = Bench()
    tool = bench.body("tool", bench.robot, Sphere(0.1), RigidTransform([0.5, 0.0, 0.0]))
    bench.plant.AddJoint(joint("odd", bench.world.body_frame(), tool.body_frame()))
    bench.shape(bench.world, HalfSpace(), up(-1.0))
    bench.finish()
    still = np.full((3, bench.plant.num_positions()), 0.3)
    bench.plant.SetPositions(bench.plant.GetMyContextFromRoot(bench.context), still[0])
    assert bench.certify(still).scene.upper == pytest.approx(bench.drake(still[0]), abs=1e-9)
    still[2] += 0.1
    with pytest.raises(InputError, match=r"joint odd of kind .* moves; a certified motion"):
        bench.certify(still)


def test_what_cannot_be_certified_is_refused() -> None:
    bench = slider(Sphere(0.1), HalfSpace(), up(-1.0))
    for positions, message in (
        ([0.0, 1.0], r"positions of shape \(2,\); must be \(N >= 1, 1\)"),
        ([[np.nan]], "positions = not finite"),
    ):
        with pytest.raises(InputError, match=message):
            bench.certify(positions)
    with pytest.raises(InputError, match="times = not increasing"):
        bench.certify([[0.0], [1.0]], times=[1.0, 0.0])
    with pytest.raises(InputError, match=r"deviation = \[-0.1\]"):
        bench.certify([[0.0], [1.0]], deviation=-0.1)
    with pytest.raises(InputError, match="tolerance = 0 m; must be > 0"):
        bench.certify([[0.0], [1.0]], tolerance=0)
    with pytest.raises(InputError, match="kind MeshcatCone has no certified clearance"):
        place_shape(MeshcatCone(1.0, 0.5, 0.5), 0, np.eye(3), np.zeros(3))


def test_what_the_plant_does_not_know_is_refused() -> None:
    bench = Bench()
    bench.body("tool", bench.robot, Sphere(0.1))
    source = bench.scene_graph.RegisterSource("somebody")
    wall = GeometryInstance(RigidTransform([2.0, 0.0, 0.0]), Box(0.1, 1.0, 1.0), "wall")
    wall.set_proximity_properties(ProximityProperties())
    bench.scene_graph.RegisterAnchoredGeometry(source, wall)
    bench.finish()
    with pytest.raises(InputError, match="wall may collide with the robot and is not the plant's"):
        bench.certify([[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 3.0]])


def test_only_the_pairs_that_are_asked_for() -> None:
    bench = slider(Sphere(0.1), HalfSpace(), up(-1.0))
    far = bench.certify([[0.0], [1.0]], pairs=[])
    assert far.scene is None and far.own is None


@pytest.fixture(scope="module")
def trajectory_4():
    scenario = load_scenario("trajectory_4").config
    setup = load_setup(scenario)
    plan = make_plan(setup.arm, setup.path)
    return place_arm(scenario, setup), plan.joints[plan.solution.solved]


def test_trajectory_4_takes_less_than_20_queries(trajectory_4, tmp_path: Path) -> None:
    placed, joints = trajectory_4
    plant, model = placed.plant, placed.model
    inspector = placed.scene_graph.model_inspector()
    found = certify_clearance(plant, inspector, [model], joints)
    assert found.scene.queries + found.own.queries <= 20
    for group in (found.scene, found.own):
        assert 0.0 <= group.upper - group.lower <= 1e-4
    # The pallet and the arm are boxes, of which Drake's distances are right.
    query = ClearanceQuery(plant, [model], max_distance=1.0)
    sampled = [
        [pair.distance for pair in query.least(scene)] for scene in placed.posed(joints[::6])
    ]
    assert found.scene.lower <= min(scene for scene, _ in sampled)
    assert found.own.lower <= min(own for _, own in sampled)
    assert found.scene.witness.bodies == ("prototype::segment_3", "pallet::pallet")
    assert found.scene.upper == pytest.approx(sampled[-1][0], abs=1e-3)
    # A hundred times tighter for a few queries more.
    fine = certify_clearance(plant, inspector, [model], joints, tolerance=1e-6)
    assert fine.scene.upper - fine.scene.lower <= 1e-6
    assert fine.scene.queries <= 20
    file = tmp_path / "proof.npz"
    save_proof(file, found)
    scene, own = read_problems(plant, inspector, [model], joints)
    report = verify_proof(file, {"scene": scene, "own": own})
    assert report.failures == ()
    assert file.stat().st_size < 1_000_000


def test_trajectory_4_with_joint_errors_keeps_most_of_its_clearance(trajectory_4) -> None:
    placed, joints = trajectory_4
    scene, _ = read_problems(
        placed.plant,
        placed.scene_graph.model_inspector(),
        [placed.model],
        joints[::4],
        deviation=np.array([1e-3] + [math.radians(0.05)] * 17),
    )
    found = certify(scene)
    exact = certify(type(scene)(**(scene.__dict__ | {"deviation": 0.0 * scene.deviation})))
    # The tip moves by up to 28 mm, but not segment 3 towards the pallet's wall.
    assert exact.lower - 5e-3 < found.lower <= found.upper < exact.upper - 1e-3
    assert found.upper - found.lower < 1e-3
