"""How near cables, platform and obstacles come, beside sampled segments and Drake's distances."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from pydrake.geometry import (
    Box,
    Capsule,
    FramePoseVector,
    GeometryFrame,
    GeometryInstance,
    ProximityProperties,
    SceneGraph,
)
from pydrake.math import RigidTransform, RotationMatrix
from scipy.spatial.transform import Rotation

from pips_drake.cable_robot.interference import (
    ObstacleBox,
    _segment_from_box,
    box_from_bounds,
    clearances,
)
from pips_drake.cable_robot.kinematics import cable_vectors, make_poses
from pips_drake.errors import InputError

from .robots import box_robot

#: Drake's iteration ends above the distance, by up to 1.4e-5 m here.
UNFINISHED = 5e-5


@pytest.fixture(scope="module")
def found():
    """A robot, poses, turned obstacles and the clearances."""
    rng = np.random.default_rng(7)
    robot = replace(box_robot(crossed=True, seed=2), box=np.array([0.6, 0.5, 0.4]))
    poses = make_poses(rng.uniform(-1.0, 1.0, (12, 3)), rng.uniform(-0.4, 0.4, (12, 3)))
    obstacles = []
    for k in range(6):
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_rotvec(rng.uniform(-1.5, 1.5, 3)).as_matrix()
        pose[:3, 3] = rng.uniform(-1.7, 1.7, 3)
        obstacles.append(ObstacleBox(f"obstacle_{k}", rng.uniform(0.1, 1.5, 3), pose))
    return robot, poses, obstacles, clearances(robot, poses, obstacles)


def test_cables_are_as_near_as_points_sampled_on_them(found):
    robot, poses, _, near = found
    vectors, arms = cable_vectors(robot, poses)
    inner = poses.position[:, None] + arms
    along = np.linspace(0.0, 1.0, 201)
    # A sampled point is within half a step, at most 7 m / 200 / 2, of any point of its cable.
    step = np.linalg.norm(vectors, axis=2).max() / 200.0
    for n in range(len(poses)):
        points = inner[n][:, None] + along[:, None] * vectors[n][:, None]
        sampled = min(
            np.linalg.norm(points[a][:, None] - points[b], axis=2).min()
            for a, b in itertools.combinations(range(robot.cables), 2)
        )
        assert near.cable_cable[n] <= sampled + 1e-12
        assert sampled <= near.cable_cable[n] + step
        a, b = near.nearest[n, 0]
        pair = np.linalg.norm(points[a][:, None] - points[b], axis=2).min()
        assert pair <= near.cable_cable[n] + step


def test_a_segment_is_as_near_to_a_box_as_points_sampled_on_it():
    rng = np.random.default_rng(5)
    along, room = np.linspace(0.0, 1.0, 1001)[:, None], (np.empty(3), np.empty(3))
    touching = 0
    for i in range(400):
        a, b, c = rng.uniform(-2.0, 2.0, (3, 3))
        half = rng.uniform(0.05, 1.0, 3)
        R = Rotation.from_rotvec(rng.uniform(-2.0, 2.0, 3)).as_matrix() if i % 2 else np.eye(3)
        if i % 5 == 0:  # along an edge's direction
            b = a + R[:, 0] * rng.uniform(-3.0, 3.0)
        if i % 7 == 0:  # in the plane of a face
            a, b = (p - R[:, 2] * (R[:, 2] @ (p - c) - half[2]) for p in (a, b))
        if i % 11 == 0:
            b = a.copy()
        inside = (a + along * (b - a) - c) @ R
        sampled = np.linalg.norm(np.maximum(np.abs(inside) - half, 0.0), axis=1).min()
        found = _segment_from_box(a, b, R, c, half, np.inf, *room)
        assert found <= sampled + 1e-12
        assert sampled <= found + np.linalg.norm(b - a) / 1000.0 + 1e-12
        # A bound cuts off what is farther, and changes nothing that is nearer.
        bound = rng.uniform(0.3, 2.0) * found + 1e-3
        cut = _segment_from_box(a, b, R, c, half, bound, *room)
        assert cut == pytest.approx(min(found, bound), abs=1e-12)
        touching += found == 0.0
    assert 20 < touching < 200


def drake_distances(shapes):
    """Signed distances of pairs of ((shape, pose), (shape, pose)), m."""
    graph = SceneGraph()
    source, pairs = graph.RegisterSource("bodies"), []
    for number, pair in enumerate(shapes):
        ids = []
        for shape, pose in pair:
            instance = GeometryInstance(pose, shape, f"shape_{number}_{len(ids)}")
            instance.set_proximity_properties(ProximityProperties())
            frame = graph.world_frame_id()
            if not ids:  # only what can move has distances to what cannot
                frame = graph.RegisterFrame(source, GeometryFrame(f"frame_{number}"))
                moved = frame
            ids.append(graph.RegisterGeometry(source, frame, instance))
        pairs.append((ids, moved))
    context = graph.CreateDefaultContext()
    poses = FramePoseVector()
    for _, frame in pairs:
        poses.set_value(frame, RigidTransform())
    graph.get_source_pose_port(source).FixValue(context, poses)
    query = graph.get_query_output_port().Eval(context)
    return np.array(
        [query.ComputeSignedDistancePairClosestPoints(*ids).distance for ids, _ in pairs]
    )


def test_the_platform_is_as_near_to_boxes_as_drake_says(found):
    robot, poses, obstacles, near = found
    pairs = [
        (
            (Box(*robot.box), RigidTransform(RotationMatrix(Q), x)),
            (Box(*one.size), RigidTransform(one.X_WB)),
        )
        for x, Q in zip(poses.position, poses.rotation, strict=True)
        for one in obstacles
    ]
    theirs = drake_distances(pairs).reshape(len(poses), -1)
    least = np.maximum(theirs.min(axis=1), 0.0)
    assert (least > 0.0).any()
    assert (least == 0.0).any()
    np.testing.assert_allclose(near.platform_obstacle, least, atol=UNFINISHED)
    assert np.all(near.platform_obstacle <= least + 1e-9)
    apart = least > 0.0
    np.testing.assert_array_equal(near.nearest[apart, 3, 1], theirs.argmin(axis=1)[apart])


def test_cables_are_as_near_to_boxes_as_thin_capsules_of_drake(found):
    robot, poses, obstacles, near = found
    thin, pairs = 1e-3, []
    vectors, arms = cable_vectors(robot, poses)
    for n in range(len(poses)):
        for m in range(robot.cables):
            length = np.linalg.norm(vectors[n, m])
            turned = RotationMatrix.MakeFromOneVector(vectors[n, m], 2)
            middle = poses.position[n] + arms[n, m] + 0.5 * vectors[n, m]
            cable = (Capsule(thin, length), RigidTransform(turned, middle))
            pairs += [(cable, (Box(*one.size), RigidTransform(one.X_WB))) for one in obstacles]
    theirs = drake_distances(pairs).reshape(len(poses), -1) + thin
    least = theirs.min(axis=1)
    outside = least > 2.0 * thin
    assert outside.any()
    ours = near.cable_obstacle[outside]
    np.testing.assert_allclose(ours, least[outside], atol=UNFINISHED)
    assert np.all(ours <= least[outside] + 1e-9)
    assert np.all(near.cable_obstacle[~outside] <= 2.0 * thin)


def test_a_cable_leaves_the_platform_without_touching_it_unless_it_goes_through():
    robot = replace(box_robot(), box=np.array([0.6, 0.6, 0.6]))
    level = make_poses([[0.0, 0.0, 0.0]])
    near = clearances(robot, level)
    # From corner (0.3, 0.3, 0.3) along (3.7, 2.7, 1.7): outside in all three directions.
    expected = 0.1
    assert near.cable_platform == pytest.approx([expected], abs=1e-12)
    assert near.cable_obstacle == pytest.approx([np.inf])
    through = replace(robot, attachments=-np.asarray(robot.attachments))
    assert clearances(through, level).cable_platform == pytest.approx([0.0])


def test_cables_that_share_an_anchor_are_compared_without_its_neighbourhood():
    robot = box_robot()
    anchors = np.array(robot.anchors)
    anchors[1] = anchors[0]
    shared = replace(robot, anchors=anchors)
    poses = make_poses([[0.2, 0.1, 0.3]])
    vectors, _ = cable_vectors(shared, poses)
    units = vectors[0, :2] / np.linalg.norm(vectors[0, :2], axis=1, keepdims=True)
    # Two lines from a point spread, so the nearest are the points at the cut.
    expected = 0.5 * np.linalg.norm(units[0] - units[1])
    near = clearances(shared, poses, free_length=0.5)
    assert near.nearest[0, 0].tolist() == [0, 1]
    assert near.cable_cable == pytest.approx([expected], rel=1e-9)


@pytest.mark.parametrize(
    ("size", "pose"),
    [([1.0, 0.0, 1.0], np.eye(4)), ([1.0, 1.0, 1.0], 2.0 * np.eye(4)), ([1.0], np.eye(4))],
)
def test_an_obstacle_that_is_no_box_is_refused(size, pose):
    with pytest.raises(InputError, match="obstacle wall"):
        ObstacleBox("wall", np.array(size), pose)


def test_a_negative_free_length_is_refused():
    with pytest.raises(InputError, match="free_length"):
        clearances(box_robot(), make_poses([[0, 0, 0]]), free_length=-1.0)


def test_bounds_become_a_box():
    box = box_from_bounds("bay", [-1.0, -2.0, -3.0], [3.0, 2.0, 0.0])
    assert box.corners().min(axis=0) == pytest.approx([-1.0, -2.0, -3.0])
    assert box.corners().max(axis=0) == pytest.approx([3.0, 2.0, 0.0])
