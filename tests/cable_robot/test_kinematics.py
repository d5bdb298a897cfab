"""Kinematics of a cable robot: the report's example, finite differences, and the way back."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pips_drake.cable_robot.kinematics import (
    Poses,
    cable_lengths,
    forward_kinematics,
    jacobian,
    make_poses,
    rotation_matrix,
)
from pips_drake.errors import InputError, NotFollowableError

from .robots import box_robot, planar_example


def some_poses(count: int, *, seed: int = 0) -> Poses:
    rng = np.random.default_rng(seed)
    return make_poses(rng.uniform(-1.5, 1.5, (count, 3)), rng.uniform(-0.4, 0.4, (count, 3)))


def moved(poses: Poses, twist: np.ndarray, step: float) -> Poses:
    """The poses after a step along a twist of the world."""
    turn = Rotation.from_rotvec(step * twist[3:]).as_matrix()
    return Poses(poses.position + step * twist[:3], turn @ poses.rotation)


def test_q_is_the_product_of_the_three_rotations():
    angles = np.random.default_rng(1).uniform(-3.0, 3.0, (50, 3))
    expected = Rotation.from_euler("ZXY", angles).as_matrix()
    np.testing.assert_allclose(rotation_matrix(angles), expected, atol=1e-14)


def test_the_planar_example_has_the_printed_directions_and_lengths():
    robot, home = planar_example(), make_poses([[0.0, 0.0, 0.0]])
    np.testing.assert_allclose(cable_lengths(robot, home), [[5**0.5] * 4], rtol=1e-15)
    units = -jacobian(robot, home)[0, :, :2]
    expected = np.array([[1, 2], [2, -1], [-1, -2], [-2, 1]]) / 5**0.5
    np.testing.assert_allclose(units, expected, rtol=1e-15)


@pytest.mark.parametrize("crossed", [False, True])
def test_the_jacobian_agrees_with_finite_differences(crossed):
    robot, poses, h = box_robot(crossed=crossed, seed=3), some_poses(30), 1e-6
    L = jacobian(robot, poses)
    for k, twist in enumerate(np.eye(6)):
        ahead, behind = (cable_lengths(robot, moved(poses, twist, s)) for s in (h, -h))
        # h^2 times third derivatives of lengths of some metres, and roundings over h.
        np.testing.assert_allclose(L[..., k], (ahead - behind) / (2 * h), atol=2e-9)


def test_a_planar_jacobian_is_three_columns_of_the_spatial_one():
    robot, poses = planar_example(), make_poses([[0.2, -0.1, 0.0]], [0.3, 0.0, 0.0])
    assert jacobian(robot, poses).shape == (1, 4, 3)


def test_forward_kinematics_finds_the_pose_that_the_lengths_came_from():
    robot, poses = box_robot(seed=4), some_poses(40, seed=5)
    near = Poses(poses.position + 0.05, Rotation.from_rotvec([0.03, -0.05, 0.04]).as_matrix()
                 @ poses.rotation)  # fmt: skip
    found = forward_kinematics(robot, cable_lengths(robot, poses), near)
    np.testing.assert_allclose(found.position, poses.position, atol=1e-10)
    np.testing.assert_allclose(found.rotation, poses.rotation, atol=1e-10)


def test_lengths_that_no_pose_has_do_not_converge_or_are_as_near_as_can_be():
    robot, home = box_robot(), make_poses([[0.0, 0.0, 0.0]])
    lengths = cable_lengths(robot, home)
    longer = lengths + 0.01
    found = forward_kinematics(robot, longer, home)
    # By symmetry nothing is nearer than home.
    np.testing.assert_allclose(found.position, home.position, atol=1e-9)
    with pytest.raises(NotFollowableError, match="give no pose near the guess"):
        forward_kinematics(robot, np.full((1, 8), 0.05), make_poses([[1.0, 1.0, 1.0]]))


@pytest.mark.parametrize(
    ("position", "angles"), [([[0, 0]], [0, 0, 0]), ([[0, 0, np.nan]], [0, 0, 0])]
)
def test_poses_that_are_none_are_refused(position, angles):
    with pytest.raises(InputError, match="poses"):
        make_poses(position, angles)


def test_a_cable_of_no_length_is_named():
    robot = planar_example()
    with pytest.raises(InputError, match="cable 1 has no length at pose 1"):
        jacobian(robot, make_poses([[1.0, 2.0, 0.0]]))
