"""What errors of lengths do to the pose, beside forward kinematics of lengths with errors."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pips_drake.cable_robot.accuracy import length_inverse, pose_errors, step_motions
from pips_drake.cable_robot.kinematics import (
    Poses,
    cable_lengths,
    forward_kinematics,
    make_poses,
)
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.errors import InputError

from .robots import box_robot, planar_example

#: So small that squares of it do not count: the pose errs by some 1e-6 of its own.
ERROR = 1e-6
ARM = np.array([0.1, -0.2, -1.3])


def moved(robot, pose, errors):
    """Twists (K, 6) that errors of lengths (K, M) make, and how the point moves, (K, 3)."""
    count = len(errors)
    start = Poses(np.repeat(pose.position, count, axis=0), np.repeat(pose.rotation, count, axis=0))
    found = forward_kinematics(robot, cable_lengths(robot, start) + errors, start)
    turns = Rotation.from_matrix(found.rotation @ np.swapaxes(start.rotation, 1, 2)).as_rotvec()
    shifts = found.position - start.position
    points = shifts + (found.rotation - start.rotation) @ ARM
    return np.hstack([shifts, turns]), points


@pytest.fixture(scope="module")
def case():
    robot = box_robot(crossed=True, seed=4)
    return robot, make_poses([[0.5, -0.3, 0.2]], [0.2, -0.1, 0.15])


def test_random_errors_of_lengths_do_no_more_than_is_said(case):
    robot, pose = case
    said = pose_errors(robot, pose, ERROR, arm=ARM)
    errors = np.random.default_rng(3).uniform(-ERROR, ERROR, (200, robot.cables))
    twists, points = moved(robot, pose, errors)
    # Terms of second order: the relative size of the step.
    more = 1.0 + 1e-4
    assert np.all(np.abs(twists).max(axis=0) <= said.components[0] * more)
    assert np.linalg.norm(twists[:, :3], axis=1).max() <= said.position[0] * more
    assert np.linalg.norm(twists[:, 3:], axis=1).max() <= said.rotation[0] * more
    assert np.linalg.norm(points, axis=1).max() <= said.point[0] * more


def test_some_signs_of_errors_reach_what_is_said(case):
    robot, pose = case
    said = pose_errors(robot, pose, ERROR, arm=ARM)
    signs = 2.0 * (np.arange(2**robot.cables)[:, None] >> np.arange(robot.cables) & 1) - 1.0
    twists, points = moved(robot, pose, ERROR * signs)
    np.testing.assert_allclose(np.abs(twists).max(axis=0), said.components[0], rtol=1e-4)
    for vectors, worst in (
        (twists[:, :3], said.position),
        (twists[:, 3:], said.rotation),
        (points, said.point),
    ):
        assert np.linalg.norm(vectors, axis=1).max() == pytest.approx(worst[0], rel=1e-4)


def test_the_bound_is_above_the_exact_value(case):
    robot, _ = case
    poses = make_poses(np.random.default_rng(1).uniform(-1.0, 1.0, (50, 3)))
    said = pose_errors(robot, poses, 1e-3)
    assert np.all(said.position <= said.position_bound * (1.0 + 1e-12))
    assert np.all(said.rotation <= said.rotation_bound * (1.0 + 1e-12))
    # The longest d is sqrt(M) e long, so the bound is at most that many times too large.
    assert np.all(said.position_bound <= np.sqrt(robot.cables) * said.position * (1.0 + 1e-9))
    np.testing.assert_allclose(said.point, said.position, rtol=1e-12)


def test_many_cables_have_the_bound_alone():
    rng = np.random.default_rng(2)
    robot = CableRobot(
        name="many", anchors=rng.normal(size=(14, 3)) * 4.0, attachments=rng.normal(size=(14, 3))
    )
    said = pose_errors(robot, make_poses([[0.0, 0.0, 0.0]]), 1e-3)
    np.testing.assert_array_equal(said.position, said.position_bound)


def test_a_step_of_one_encoder_moves_the_platform_as_forward_kinematics_says(case):
    robot, pose = case
    shifts, turns = step_motions(robot, pose, ERROR)
    twists, _ = moved(robot, pose, ERROR * np.eye(robot.cables))
    np.testing.assert_allclose(shifts[0], np.linalg.norm(twists[:, :3], axis=1), rtol=1e-4)
    np.testing.assert_allclose(turns[0], np.linalg.norm(twists[:, 3:], axis=1), rtol=1e-4)


def test_a_planar_robot_errs_in_its_plane_only():
    robot, pose = planar_example(), make_poses([[0.1, 0.2, 0.0]], [0.3, 0.0, 0.0])
    inverse = length_inverse(robot, pose)
    assert np.all(inverse[0, [2, 3, 4]] == 0.0)
    said = pose_errors(robot, pose, 1e-3, arm=[1.0, 0.0, 0.0])
    assert said.components.shape == (1, 3)
    assert said.rotation == pytest.approx(said.components[:, 2])


def test_a_pose_that_the_lengths_do_not_hold_has_no_accuracy():
    anchors = 4.0 * np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    robot = CableRobot(name="star", anchors=anchors, attachments=np.zeros((8, 3)))
    said = pose_errors(robot, make_poses([[0.0, 0.0, 0.0]]), 1e-3, arm=ARM)
    for column in (said.position, said.position_bound, said.rotation, said.point):
        assert column.tolist() == [np.inf]


@pytest.mark.parametrize(
    ("changes", "words"),
    [({"length_error": -1.0}, "length_error"), ({"length_error": 1.0, "arm": [1.0]}, "arm")],
)
def test_bad_input_is_said(case, changes, words):
    with pytest.raises(InputError, match=words):
        pose_errors(*case, **changes)
