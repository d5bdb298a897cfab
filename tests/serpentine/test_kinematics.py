"""Frames are FTL-95's, Jacobians their derivatives, and the inverse undoes the forward map."""

from __future__ import annotations

import numpy as np
import pytest

from pips_drake.errors import InputError
from pips_drake.serpentine.kinematics import (
    centre_line,
    frames,
    jacobian,
    joint_axes,
    module_lengths,
    motion_base_roots,
    spine_inverse,
    spine_points,
)

INCH = 0.0254
M = np.diag([1.0, -1.0, 1.0])  # reflection in the x0-z0 plane


def test_frames_are_products_of_the_reports_matrices(arm, table_a1, report_frames, random_postures):
    postures = random_postures(arm, 20)
    expected = np.stack([report_frames(table_a1, q) for q in postures])
    # 18 products of numbers up to 5 m.
    np.testing.assert_allclose(frames(arm, postures), expected, rtol=0, atol=1e-14)


def test_home_spine_points_are_the_reports(arm):
    spine = spine_points(arm, arm.joint_home)[0] / INCH
    # FACTS, from Table A.1: x and y to seven digits, z to three.
    np.testing.assert_allclose(spine[:, 0], 16.2549018, rtol=0, atol=5e-8)
    np.testing.assert_allclose(spine[:, 1], -0.0000982, rtol=0, atol=5e-8)
    z = [53.843, 75.128, 96.413, 114.013, 131.301, 148.589, 162.089, 174.902]
    np.testing.assert_allclose(spine[:, 2], z, rtol=0, atol=5e-10 + 1e-9)


def test_at_home_the_centre_line_is_straight_and_as_long_as_its_segments(arm):
    corners = centre_line(arm, arm.joint_home)[0]
    assert corners.shape == (16, 3)
    steps = np.diff(corners, axis=0)
    np.testing.assert_allclose(steps[:, :2], 0.0, atol=1e-14)
    total = 3 * 20.035 + 3 * 16.1 + 2 * 12.0 + 2 * 1.25 + 2 * 1.5 + 2 * 1.188 + 0.813
    assert steps[:, 2].sum() / INCH == pytest.approx(total, abs=1e-11)


def test_the_centre_line_is_made_of_segments_and_offsets(arm, random_postures):
    corners = centre_line(arm, random_postures(arm, 50))
    lengths = np.linalg.norm(np.diff(corners, axis=1), axis=2) / INCH
    expected = [20.035, 1.25, 20.035, 1.25, 20.035, 1.5, 16.1, 1.188, 16.1, 1.188, 16.1, 1.5]
    expected += [12.0, 0.813, 12.0]
    np.testing.assert_allclose(lengths, np.tile(expected, (50, 1)), rtol=0, atol=1e-12)


@pytest.mark.parametrize("mirrored", [False, True])
def test_rotations_are_proper(arm_variant, random_postures, mirrored):
    arm = arm_variant(mirrored=mirrored)
    rotations = frames(arm, random_postures(arm, 20))[..., :3, :3]
    products = rotations @ rotations.swapaxes(-1, -2)
    np.testing.assert_allclose(products, np.broadcast_to(np.eye(3), products.shape), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(rotations), 1.0, atol=1e-14)


def test_eq_3_4_is_the_distance_that_forward_kinematics_finds(arm, random_postures):
    postures = random_postures(arm, 500)
    distances = np.linalg.norm(np.diff(spine_points(arm, postures), axis=1), axis=2)
    # Distances of half a metre between points some metres away: a few roundings of metres.
    np.testing.assert_allclose(
        module_lengths(arm, postures[:, 4:17:2]), distances, rtol=0, atol=1e-12
    )


def test_joints_come_back_from_their_spine_points(arm, random_postures):
    postures = random_postures(arm, 2000)
    found = spine_inverse(arm, spine_points(arm, postures))
    assert np.abs(found - postures).max() < 1e-12


@pytest.mark.parametrize(
    "change",
    [
        dict(mirrored=True),
        dict(base="gimbal"),
        dict(base="gimbal", mirrored=True),
        dict(lengths=[20.0, 12.0]),
        dict(lengths=[15.0] * 12, offsets=[1.0] * 11),
        dict(lengths=[15.0] * 5, offsets=[0.0] * 5),
        dict(lengths=[10.0, 9.0, 8.0, 7.0], offsets=[0.0, 2.0, 0.0]),
    ],
    ids=lambda change: ", ".join(f"{k} {v}" for k, v in change.items()),
)
def test_joints_come_back_for_other_arms_too(arm_variant, random_postures, change):
    arm = arm_variant(**change)
    postures = random_postures(arm, 200)
    found = spine_inverse(arm, spine_points(arm, postures))
    assert np.abs(found - postures).max() < 1e-12


def test_a_first_spine_point_out_of_reach_gives_nan(arm, random_postures):
    spine = spine_points(arm, random_postures(arm, 2))
    spine[1, :, 1] += 10.0
    found = spine_inverse(arm, spine)
    assert np.all(np.isfinite(found[0]))
    assert np.all(np.isnan(found[1]))


@pytest.mark.parametrize("base", ["rail_crane", "gimbal"])
def test_a_mirrored_arm_is_the_mirror_image(arm_variant, random_postures, base):
    drawn, built = arm_variant(base=base), arm_variant(base=base, mirrored=True)
    postures = random_postures(drawn, 20)
    expected = frames(drawn, postures)
    expected[..., :3, :3] = M @ expected[..., :3, :3] @ M
    expected[..., :3, 3] = expected[..., :3, 3] @ M
    # Signs alone: exact.
    np.testing.assert_array_equal(frames(built, postures), expected)
    np.testing.assert_array_equal(spine_points(built, postures), spine_points(drawn, postures) @ M)


@pytest.mark.parametrize("base", ["rail_crane", "gimbal"])
@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("joint", [None, 3, 9])
def test_jacobian_is_the_derivative_of_the_frame(
    arm_variant, random_postures, base, mirrored, joint
):
    arm = arm_variant(base=base, mirrored=mirrored)
    last = (arm.joints if joint is None else joint) - 1
    postures = random_postures(arm, 5)
    postures[:, -1] = 0.3
    found = jacobian(arm, postures, joint)
    h = 1e-5
    for j in range(arm.joints):
        step = np.zeros(arm.joints)
        step[j] = h
        plus, minus = frames(arm, postures + step)[:, last], frames(arm, postures - step)[:, last]
        # Central differences: h^2 times a lever of 4 m, and its rounding over h: below 1e-9.
        velocity = (plus[:, :3, 3] - minus[:, :3, 3]) / (2.0 * h)
        np.testing.assert_allclose(found[:, 3:, j], velocity, rtol=0, atol=2e-9)
        rate = (plus[:, :3, :3] - minus[:, :3, :3]) / (2.0 * h)
        spin = rate @ frames(arm, postures)[:, last, :3, :3].swapaxes(1, 2)
        vector = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
        np.testing.assert_allclose(found[:, :3, j], vector, rtol=0, atol=2e-9)


def test_joint_axes_stay_put_when_their_joint_turns(arm_variant, random_postures):
    arm = arm_variant(mirrored=True)
    q = random_postures(arm, 1)
    axes = joint_axes(arm, frames(arm, q))
    np.testing.assert_allclose(np.linalg.norm(axes, axis=2), 1.0, atol=1e-14)
    for j in range(arm.joints):
        turned = q.copy()
        turned[0, j] += 0.4
        np.testing.assert_allclose(
            joint_axes(arm, frames(arm, turned))[0, j], axes[0, j], atol=1e-14
        )


def test_many_postures_give_what_each_gives_alone(arm, random_postures):
    postures = random_postures(arm, 7)
    together = frames(arm, postures)
    for q, expected in zip(postures, together, strict=True):
        np.testing.assert_array_equal(frames(arm, q)[0], expected)


def test_motion_base_roots_of_a_mirrored_arm_are_those_of_the_mirrored_point(arm_variant):
    drawn, built = arm_variant(), arm_variant(mirrored=True)
    point = np.array([[0.41, 0.05, 1.5], [0.43, -0.02, 1.6]])
    np.testing.assert_array_equal(
        motion_base_roots(built, point @ M), motion_base_roots(drawn, point)
    )
    assert np.all(np.isnan(motion_base_roots(drawn, [[0.4, 5.0, 1.0]])))


def test_wrong_shapes_and_frames_are_refused_with_what_is_allowed(arm):
    with pytest.raises(InputError, match=r"\(17,\).*\(N, 18\).*prototype"):
        frames(arm, np.zeros(17))
    with pytest.raises(InputError, match=r"joint frame 19; must be 1 \.\. 18"):
        jacobian(arm, arm.joint_home, 19)
    with pytest.raises(InputError, match="joint frame 0"):
        jacobian(arm, arm.joint_home, 0)
