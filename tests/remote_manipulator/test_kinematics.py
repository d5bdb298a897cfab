"""The arm's kinematics: against the appendix, finite differences and its own inverse."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pips_drake.errors import InputError
from pips_drake.remote_manipulator.configuration import load_configuration
from pips_drake.remote_manipulator.kinematics import (
    BRANCHES,
    forward_kinematics,
    heading_matrix,
    inverse_kinematics,
    jacobian,
    joint_axes,
    nearest_angles,
    pitch_matrix,
    roll_matrix,
)

ARM = load_configuration().arm
#: Of positions of an arm of 15 m: 1e-12 m is some hundred roundings.
ROUNDING = 1e-12


def random_angles(count: int, *, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(ARM.lower, ARM.upper, (count, 6))


def printed_heading(angle: float) -> np.ndarray:
    """RMS-71's appendix as printed: a misprint."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])


def rank_of(matrix: np.ndarray) -> int:
    singular = np.linalg.svd(matrix, compute_uv=False)
    return int(np.sum(singular > 1e-9 * singular[0]))


def test_rotations_are_proper_at_random_angles():
    pose = forward_kinematics(ARM, random_angles(500), 3.0)
    for R in (pose.R_R0, pose.R_R1, pose.R_R2):
        np.testing.assert_allclose(np.linalg.det(R), 1.0, atol=1e-14)
        np.testing.assert_allclose(
            R @ np.swapaxes(R, 1, 2), np.broadcast_to(np.eye(3), R.shape), atol=1e-14
        )


def test_elementary_rotations_are_scipys():
    for make, axis in ((roll_matrix, "x"), (pitch_matrix, "y"), (heading_matrix, "z")):
        angles = np.linspace(-7.0, 7.0, 29)
        expected = Rotation.from_rotvec(np.outer(angles, np.eye(3)["xyz".index(axis)])).as_matrix()
        np.testing.assert_allclose(make(angles), expected, atol=2e-15)


def test_the_effectors_rotation_is_the_appendix_product():
    for angles in random_angles(20):
        first = Rotation.from_euler("ZY", angles[:2])
        last = Rotation.from_euler("ZYX", angles[3:])
        whole = first * Rotation.from_euler("Y", angles[2]) * last
        pose = forward_kinematics(ARM, angles, 2.5)
        np.testing.assert_allclose(pose.R_R2, whole.as_matrix(), atol=1e-14)


def test_the_jacobian_has_rank_6_where_the_printed_heading_leaves_4():
    angles = random_angles(200)
    assert min(rank_of(J) for J in jacobian(ARM, angles)) == 6

    def printed_tip(q: np.ndarray) -> np.ndarray:
        y = pitch_matrix
        R0 = printed_heading(q[0]) @ y(q[1])
        R1 = R0 @ y(q[2])
        R2 = R1 @ printed_heading(q[3]) @ y(q[4]) @ roll_matrix(q[5])
        tip = ARM.arm_0_m * R0[:, 0] + ARM.arm_1_m * R1[:, 0] + ARM.arm_2_m * R2[:, 0]
        return np.concatenate([tip, R2.ravel()])

    h = 1e-6
    for q in angles[:20]:
        steps = [printed_tip(q + h * e) - printed_tip(q - h * e) for e in np.eye(6)]
        singular = np.linalg.svd(np.array(steps).T / (2 * h), compute_uv=False)
        # Differences of 1e-6 leave errors of some 1e-9.
        assert int(np.sum(singular > 1e-6 * singular[0])) == 4


def test_the_jacobian_agrees_with_finite_differences():
    h = 1e-6
    for q in random_angles(20, seed=3):
        J = jacobian(ARM, q)
        R = forward_kinematics(ARM, q, 0.0).R_R2
        for k, e in enumerate(np.eye(6)):
            ahead = forward_kinematics(ARM, q + h * e, 0.0)
            behind = forward_kinematics(ARM, q - h * e, 0.0)
            turn = (ahead.R_R2 - behind.R_R2) / (2 * h) @ R.T
            spin = np.array([turn[2, 1], turn[0, 2], turn[1, 0]])
            velocity = (ahead.palm - behind.palm) / (2 * h)
            # h^2 / 6 times third derivatives of an arm of 15 m, and roundings over h.
            np.testing.assert_allclose(J[:, k], [*spin, *velocity], atol=2e-8)


def test_joint_axes_are_unit_and_follow_the_order_of_the_channels():
    axes = joint_axes(np.zeros(6))
    np.testing.assert_allclose(
        axes, [[0, 0, 1], [0, 1, 0], [0, 1, 0], [0, 0, 1], [0, 1, 0], [1, 0, 0]], atol=1e-15
    )


def test_with_z_down_a_positive_pitch_raises_and_a_positive_heading_turns_to_port():
    level = forward_kinematics(ARM, np.zeros(6), 3.0)
    raised = forward_kinematics(ARM, [0.0, math.radians(30.0), 0, 0, 0, 0], 3.0)
    turned = forward_kinematics(ARM, [math.radians(30.0), 0.0, 0, 0, 0, 0], 3.0)
    assert level.palm[2] == pytest.approx(-3.0)
    assert raised.palm[2] - level.palm[2] == pytest.approx(-0.5 * (6.378 + 7.06 + 1.4224))
    assert turned.palm[1] == pytest.approx(0.5 * (6.378 + 7.06 + 1.4224))


def test_the_telescope_lifts_the_whole_arm():
    q = random_angles(1)[0]
    low, high = (forward_kinematics(ARM, q, height) for height in (2.0, 3.5))
    for name in ("shoulder", "elbow", "wrist", "palm"):
        np.testing.assert_allclose(
            getattr(high, name) - getattr(low, name), [0.0, 0.0, -1.5], atol=ROUNDING
        )


@pytest.mark.parametrize("branch", BRANCHES)
def test_every_branch_of_the_inverse_holds_the_palm_where_it_is(branch):
    angles = random_angles(300, seed=5)
    height = np.linspace(2.0, 4.0, 300)
    pose = forward_kinematics(ARM, angles, height)
    found = inverse_kinematics(ARM, pose.palm, pose.R_R2, height, branch=branch)
    again = forward_kinematics(ARM, found, height)
    # The wrist's sine is badly conditioned near +-90 deg, at most the root of a rounding there.
    np.testing.assert_allclose(again.palm, pose.palm, atol=1e-10)
    np.testing.assert_allclose(again.R_R2, pose.R_R2, atol=1e-10)


def test_the_eight_branches_differ():
    pose = forward_kinematics(ARM, [0.3, 0.9, -1.2, 0.2, -0.7, 0.4], 3.0)
    found = [inverse_kinematics(ARM, pose.palm, pose.R_R2, 3.0, branch=b) for b in BRANCHES]
    for first in range(8):
        for second in range(first):
            assert np.max(np.abs(found[first] - found[second])) > 1e-2


def test_the_first_branch_has_the_elbow_up():
    pose = forward_kinematics(ARM, [0.3, 0.9, -1.2, 0.2, -0.7, 0.4], 3.0)
    angles = inverse_kinematics(ARM, pose.palm, pose.R_R2, 3.0)
    np.testing.assert_allclose(angles, [0.3, 0.9, -1.2, 0.2, -0.7, 0.4], atol=1e-12)


def test_out_of_reach_is_nan_and_none():
    far = np.array([20.0, 0.0, -3.0])
    assert np.all(np.isnan(inverse_kinematics(ARM, far, np.eye(3), 3.0)[1:3]))
    assert nearest_angles(ARM, far, np.eye(3), 3.0, np.zeros(6)) is None


def test_the_nearest_angles_keep_full_turns_of_the_roll():
    near = np.radians([-14.0, 62.0, -98.0, 0.0, -54.0, 400.0])
    pose = forward_kinematics(ARM, near, 3.0)
    found = nearest_angles(ARM, pose.palm, pose.R_R2, 3.0, near + 0.01)
    assert found is not None
    np.testing.assert_allclose(found, near, atol=1e-10)


def test_the_nearest_angles_are_within_the_hard_limits():
    rng = np.random.default_rng(8)
    for q in random_angles(100, seed=9):
        pose = forward_kinematics(ARM, q, 3.0)
        found = nearest_angles(ARM, pose.palm, pose.R_R2, 3.0, rng.uniform(ARM.lower, ARM.upper))
        assert found is not None  # q itself is one
        assert np.all(found >= ARM.lower - 1e-12) and np.all(found <= ARM.upper + 1e-12)


def test_a_wrong_number_of_angles_is_refused():
    with pytest.raises(InputError, match=r"angles of shape \(5,\); must be \(..., 6\), rad"):
        forward_kinematics(ARM, np.zeros(5), 3.0)
