"""What a pose can bear, beside linear programs and the tests of stability."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog

from pips_drake.cable_robot.capability import (
    jacobian_directions,
    stiffness_svd,
    wrench_capability,
)
from pips_drake.cable_robot.kinematics import Poses, jacobian, make_poses
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.stability import kinematic_stability, static_stability
from pips_drake.cable_robot.statics import characteristic_length, structure_matrix
from pips_drake.cable_robot.stiffness import elastic_stiffness, stiffness_directions
from pips_drake.errors import InputError

from .robots import box_robot, planar_example

LOW, HIGH = 10.0, 800.0
BOX = np.array([20.0, 20.0, 20.0, 4.0, 4.0, 4.0])


def bounded(**changes: object) -> CableRobot:
    return replace(box_robot(crossed=True, seed=3), tension_min=LOW, tension_max=HIGH, **changes)


def some_poses(count: int, seed: int) -> Poses:
    rng = np.random.default_rng(seed)
    return make_poses(
        rng.uniform(-1.0, 1.0, (count, 3)) * [2.0, 1.5, 0.8], rng.uniform(-0.1, 0.1, (count, 3))
    )


def farthest(robot: CableRobot, poses: Poses, n: int, way: np.ndarray) -> float:
    """The largest k at which tensions balance the weight and k times a wrench; nan if none."""
    one = Poses(poses.position[n : n + 1], poses.rotation[n : n + 1])
    A, w = structure_matrix(robot, one)[0], robot.weight_wrench(one.rotation)[0]
    cost = np.append(np.zeros(robot.cables), -1.0)
    bounds = [(LOW, HIGH)] * robot.cables + [(None, None)]
    result = linprog(cost, A_eq=np.column_stack([A, way]), b_eq=-w, bounds=bounds)
    return float(result.x[-1]) if result.status == 0 else float("nan")


def least_sum(robot: CableRobot, poses: Poses, n: int) -> float:
    """The sum of tensions that balance the weight, N; nan if none do."""
    one = Poses(poses.position[n : n + 1], poses.rotation[n : n + 1])
    A, w = structure_matrix(robot, one)[0], robot.weight_wrench(one.rotation)[0]
    result = linprog(np.ones(robot.cables), A_eq=A, b_eq=-w, bounds=(LOW, HIGH))
    return float(result.fun) if result.status == 0 else float("nan")


def test_the_largest_wrench_along_a_direction_is_a_linear_program_s():
    robot, poses = bounded(), some_poses(8, seed=1)
    ways = np.vstack([np.eye(6), [[1.0, -2.0, 0.5, 0.1, 0.0, -0.2]]])
    found = wrench_capability(robot, poses, directions=ways)
    held = found.force >= 0.0
    assert held.any()
    for n, k in itertools.product(np.flatnonzero(held), range(len(ways))):
        expected = farthest(robot, poses, n, ways[k])
        assert found.along[n, k] == pytest.approx(expected, rel=1e-7, abs=1e-7)


def test_where_the_weight_is_not_held_no_program_has_tensions():
    robot, poses = bounded(), some_poses(40, seed=2)
    found = wrench_capability(robot, poses)
    held = [not np.isnan(least_sum(robot, poses, n)) for n in range(len(poses))]
    np.testing.assert_array_equal(found.force >= 0.0, held)
    assert 0 < np.sum(held) < len(held)


def test_the_margin_is_where_a_corner_of_the_disturbances_leaves_the_set():
    robot, poses = bounded(), some_poses(25, seed=4)
    found = wrench_capability(robot, poses, disturbance=BOX)
    chosen = np.flatnonzero(found.margin > 0.0)[:3]
    assert len(chosen) == 3
    for n in chosen:
        corners = [BOX * signs for signs in itertools.product((-1.0, 1.0), repeat=6)]
        expected = min(farthest(robot, poses, n, corner) for corner in corners)
        assert found.margin[n] == pytest.approx(expected, rel=1e-7)


def test_the_force_in_every_direction_is_the_least_along_directions():
    robot, poses = bounded(), some_poses(25, seed=4)
    rng = np.random.default_rng(0)
    ways = np.zeros((3000, 6))
    ways[:, :3] = rng.normal(size=(3000, 3))
    ways[:, :3] /= np.linalg.norm(ways[:, :3], axis=1, keepdims=True)
    found = wrench_capability(robot, poses, directions=ways)
    turned = wrench_capability(robot, poses, directions=np.roll(ways, 3, axis=1))
    held = found.force > 0.0
    # Of 3000 directions the nearest to any other is within some 0.1 rad: 1 / cos(0.1) is 1.005.
    for radius, along in ((found.force, found.along), (turned.moment, turned.along)):
        assert np.all(along[held].min(axis=1) >= radius[held] * (1.0 - 1e-9))
        assert np.all(along[held].min(axis=1) <= radius[held] * 1.02)


@pytest.mark.parametrize("robot", [box_robot(seed=1), box_robot(crossed=True, seed=1)])
def test_faces_say_what_the_programs_of_stability_say(robot):
    rng = np.random.default_rng(5)
    places = rng.uniform(-1.0, 1.0, (300, 3)) * [3.8, 2.8, 3.5]
    poses = make_poses(places, rng.uniform(-0.2, 0.2, (300, 3)))
    found = wrench_capability(robot, poses)
    kinematic = kinematic_stability(robot, poses, certificates=False).stable
    static = static_stability(robot, poses).stable
    np.testing.assert_array_equal(found.kinematic, kinematic)
    np.testing.assert_array_equal(found.static, static)
    assert 0 < static.sum() < len(poses)


def hanging(cables: int) -> CableRobot:
    """Cables from a ring of anchors down to a platform, turned to and fro."""
    rng, turn = np.random.default_rng(cables), 2.0 * np.pi * np.arange(cables) / cables
    inner = turn + 0.9 * (-1.0) ** np.arange(cables)
    heights, depths = 3.0 + rng.uniform(-1.0, 1.0, cables), rng.uniform(-0.3, 0.3, cables)
    return CableRobot(
        name="ring",
        anchors=np.column_stack([4.0 * np.cos(turn), 4.0 * np.sin(turn), heights]),
        attachments=np.column_stack([0.5 * np.cos(inner), 0.5 * np.sin(inner), depths]),
        mass=20.0,
        tension_min=LOW,
        tension_max=HIGH,
    )


@pytest.mark.slow
@pytest.mark.parametrize("cables", [6, 7, 9, 12])
def test_any_number_of_cables_bears_what_linear_programs_say(cables):
    robot = hanging(cables)
    poses = make_poses(np.random.default_rng(6).uniform(-0.5, 0.5, (20, 3)))
    found = wrench_capability(robot, poses, directions=np.eye(6))
    held = np.array([not np.isnan(least_sum(robot, poses, n)) for n in range(len(poses))])
    np.testing.assert_array_equal(found.force >= 0.0, held)
    assert held.any()
    for n, k in itertools.product(np.flatnonzero(held), range(6)):
        expected = farthest(robot, poses, n, np.eye(6)[k])
        assert found.along[n, k] == pytest.approx(expected, rel=1e-7, abs=1e-7)
    np.testing.assert_array_equal(found.static, static_stability(robot, poses).stable)


def test_the_planar_example_bears_nothing():
    found = wrench_capability(planar_example(), make_poses([[0.0, 0.0, 0.0]]))
    assert found.full_rank.tolist() == [True]
    assert found.kinematic.tolist() == [False]
    assert found.static.tolist() == [False]
    assert found.force[0] < 0.0


def test_without_an_upper_bound_a_stable_pose_bears_everything():
    robot = box_robot(crossed=True)
    found = wrench_capability(robot, make_poses([[0.1, 0.0, 0.1]]), disturbance=BOX)
    assert found.kinematic.tolist() == [True]
    assert found.force.tolist() == [np.inf]
    assert found.margin.tolist() == [np.inf]


def test_a_pose_without_full_rank_bears_nothing():
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    # All cables meet in the platform's origin: no moment about it is possible.
    robot = CableRobot(name="star", anchors=4.0 * signs, attachments=np.zeros((8, 3)))
    found = wrench_capability(robot, make_poses([[0.0, 0.0, 0.0]]), directions=np.eye(6))
    assert found.full_rank.tolist() == [False]
    assert found.force.tolist() == [0.0]
    assert found.along.tolist() == [[0.0] * 6]


def test_the_flimsiest_motion_changes_the_lengths_least():
    robot, poses = box_robot(crossed=True, seed=8), some_poses(5, seed=9)
    found = jacobian_directions(robot, poses)
    L, length = jacobian(robot, poses), characteristic_length(robot)
    changes = np.linalg.norm((L @ found.flimsiest[..., None])[..., 0], axis=1)
    np.testing.assert_allclose(changes, found.values[:, -1], rtol=1e-9)
    others = np.random.default_rng(1).normal(size=(200, 6))
    others /= np.linalg.norm(others * [1, 1, 1, length, length, length], axis=1, keepdims=True)
    assert np.all(np.linalg.norm(L @ others.T, axis=1) >= changes[:, None] * (1.0 - 1e-12))
    np.testing.assert_allclose(found.condition, found.values[:, 0] / changes)


def test_singular_values_of_stiffness_are_those_of_its_directions():
    robot, poses = box_robot(crossed=True, seed=8), some_poses(5, seed=9)
    K = elastic_stiffness(robot, poses)
    known = stiffness_directions(robot, K, characteristic_length(robot))
    found = stiffness_svd(robot, K)
    np.testing.assert_allclose(found.values, known.values[:, ::-1], rtol=1e-9)
    same = np.abs(np.einsum("nk,nk->n", found.flimsiest, known.softest))
    np.testing.assert_allclose(same, np.linalg.norm(known.softest, axis=1) ** 2, rtol=1e-9)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"disturbance": [1.0]}, "disturbance"),
        ({"disturbance": [-1.0] * 6}, "disturbance"),
        ({"directions": np.full((1, 6), np.nan)}, "directions"),
        ({"tension_min": 5.0, "tension_max": 1.0}, "tension bounds"),
    ],
)
def test_bad_input_is_said(changes, words):
    with pytest.raises(InputError, match=words):
        wrench_capability(bounded(), some_poses(1, seed=0), **changes)
