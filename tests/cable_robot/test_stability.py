"""Stability of a cable robot: three tests that agree, and certificates that prove each answer."""

from __future__ import annotations

import time

import numpy as np
import pytest

from pips_drake.cable_robot.kinematics import cable_lengths, jacobian, make_poses
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.stability import METHODS, kinematic_stability, static_stability
from pips_drake.cable_robot.statics import structure_matrix, total_wrench
from pips_drake.errors import InputError

from .robots import box_robot, planar_example
from .test_kinematics import moved, some_poses
from .test_statics import concurrent_robot, robot_of

HOME = make_poses([[0.0, 0.0, 0.0]])


def check_certificates(robot: CableRobot, poses, found) -> None:
    """What Stiemke's lemma promises stands in the result, whatever test it came from."""
    L, full = jacobian(robot, poses), found.rank == robot.freedom
    tense = np.all(np.isfinite(found.tension), axis=1)
    np.testing.assert_array_equal(found.stable, tense & full)
    assert np.all(found.tension[tense] > 0.0)
    np.testing.assert_allclose(found.tension[tense].max(axis=1, initial=1.0), 1.0)
    left = (np.swapaxes(L, 1, 2) @ np.nan_to_num(found.tension)[..., None])[..., 0]
    assert np.abs(left).max() < 1e-13
    np.testing.assert_array_equal(np.isfinite(found.motion).all(axis=1), ~found.stable)
    rates = (L @ np.nan_to_num(found.motion)[..., None])[..., 0]
    # Rates are roundings of twists that may be large near singular poses.
    large = 1e-13 * (1.0 + np.abs(np.nan_to_num(found.motion)).max(axis=1))
    assert np.all(rates.max(axis=1) < large)
    unstable = ~tense
    np.testing.assert_allclose(rates[unstable].min(axis=1), -1.0, rtol=1e-10)
    assert np.all(np.abs(rates[tense]).max(axis=1, initial=0.0) < large[tense])


def compare(robot: CableRobot, poses, methods=METHODS):
    """All tests on the same poses, with certificates checked; the share of stable ones."""
    results = [kinematic_stability(robot, poses, method) for method in methods]
    for found in results:
        check_certificates(robot, poses, found)
        np.testing.assert_array_equal(found.stable, results[0].stable)
    hangs = static_stability(robot, poses)
    assert np.all(hangs.stable[results[0].stable])
    A, w = structure_matrix(robot, poses), total_wrench(robot, poses)
    left = (A @ hangs.tensions[..., None])[..., 0] + w
    sizes = 1e-11 * np.abs(hangs.tensions).max(axis=1) + 1e-9
    assert np.all(np.abs(left[hangs.stable]).max(axis=1) < sizes[hangs.stable])
    assert np.all(hangs.tensions[hangs.stable] > 0.0)
    return results[0].stable.mean()


@pytest.mark.parametrize("method", METHODS)
def test_the_planar_example_turns_counter_clockwise_and_all_cables_get_shorter(method):
    """CABLE-96, Figure 1."""
    robot = planar_example()
    found = kinematic_stability(robot, HOME, method)
    check_certificates(robot, HOME, found)
    assert not found.stable[0]
    rates = (jacobian(robot, HOME) @ [0.0, 0.0, 1.0])[0]
    np.testing.assert_allclose(rates, np.full(4, -2 / 5**0.5), rtol=1e-15)
    turned = moved(HOME, np.array([0, 0, 0, 0, 0, 1.0]), 0.01)
    assert np.all(cable_lengths(robot, turned) < cable_lengths(robot, HOME))
    # The rates' sum is -8 / sqrt(5) times the rotation, so every such motion turns this way.
    assert found.motion[0, 2] > 0.0
    assert not static_stability(robot, HOME).stable[0]


def test_the_motion_program_finds_the_rotation_itself_for_the_planar_example():
    found = kinematic_stability(planar_example(), HOME, "motion")
    np.testing.assert_allclose(found.motion, [[0.0, 0.0, 5**0.5 / 2]], atol=1e-12)


@pytest.mark.parametrize("crossed", [False, True])
def test_the_three_tests_agree_on_random_poses(crossed):
    share = compare(box_robot(crossed=crossed, seed=3), some_poses(400, seed=4))
    assert 0.01 < share < 0.9


@pytest.mark.parametrize("crossed", [False, True])
def test_the_three_tests_agree_where_everything_is_symmetric(crossed):
    line = np.linspace(-1.5, 1.5, 5)
    grid = np.stack(np.meshgrid(line, line, line), axis=-1).reshape(-1, 3)
    assert compare(box_robot(crossed=crossed), make_poses(grid)) == 1.0
    # A quarter turn: the cables pull it back.
    assert compare(box_robot(crossed=crossed), make_poses(grid, [np.pi / 2, 0, 0])) == 0.0


@pytest.mark.parametrize("cables", [6, 7, 10])
def test_other_numbers_of_cables(cables):
    methods = METHODS if cables <= 8 else ("tension", "motion")
    share = compare(robot_of(cables, seed=1), some_poses(300, seed=5), methods)
    if cables == 6:
        assert share == 0.0  # as many cables as freedoms never pull against each other
    if cables == 10:
        assert share > 0.05


def test_a_pendulum_hangs_but_is_not_kinematically_stable():
    """CABLE-96, section 3.2: below all anchors; raising it slackens all cables."""
    robot = box_robot(seed=3)
    below = make_poses([[0.0, 0.0, -6.0], [0.05, 0.03, -7.0]])
    above = make_poses([[0.0, 0.0, 6.0], [0.05, 0.03, 7.0]])
    for poses, hangs in ((below, True), (above, False)):
        found, static = kinematic_stability(robot, poses), static_stability(robot, poses)
        check_certificates(robot, poses, found)
        assert not np.any(found.stable)
        np.testing.assert_array_equal(static.stable, [hangs, hangs])
        assert np.all(np.isfinite(static.slack))
    up = np.array([0, 0, 1.0, 0, 0, 0])
    assert np.all(jacobian(robot, below) @ up < 0.0)
    # Being below all anchors is not enough, though: a level platform that hangs off to one side
    # wants to tilt.
    assert not static_stability(robot, make_poses([[0.5, 0.3, -7.0]])).stable[0]
    # Weightless, it does not hang either: its slack is no more than zero.
    free = static_stability(robot, below, -total_wrench(robot, below))
    assert not np.any(free.stable)


def test_a_singular_pose_is_not_stable_though_its_cables_pull_against_each_other():
    robot, poses = concurrent_robot(), make_poses([[0.0, 0.0, 0.0], [0.4, 0.2, -0.1]])
    for method in METHODS:
        found = kinematic_stability(robot, poses, method)
        check_certificates(robot, poses, found)
        np.testing.assert_array_equal(found.rank, [3, 3])
        assert np.all(np.isfinite(found.tension))
        assert not np.any(found.stable)
    # No cable resists a rotation about their common point, the middle at home.
    assert np.abs(found.motion[0, :3]).max() < 1e-12
    # The weight acts through that point at home alone.
    static = static_stability(robot, poses)
    np.testing.assert_array_equal(static.stable, [True, False])
    assert static.slack[1] == -np.inf


def test_certificates_can_be_left_out():
    found = kinematic_stability(planar_example(), HOME, "half_plane", certificates=False)
    assert np.all(np.isnan(found.motion))


def test_bad_arguments_are_refused():
    with pytest.raises(InputError, match="did you mean 'half_plane'"):
        kinematic_stability(planar_example(), HOME, "halfplane")
    with pytest.raises(InputError, match="10 cables and 6 freedoms; half_plane takes at most 2"):
        kinematic_stability(robot_of(10), HOME, "half_plane")


@pytest.mark.slow
@pytest.mark.parametrize("crossed", [False, True])
def test_the_three_tests_agree_on_ten_thousand_random_poses(crossed):
    share = compare(box_robot(crossed=crossed, seed=3), some_poses(10_000, seed=6))
    assert 0.01 < share < 0.9


@pytest.mark.slow
@pytest.mark.parametrize("cables", [7, 8, 9, 12])
def test_kinematic_stability_implies_static_for_random_robots(cables):
    methods = METHODS if cables <= 8 else ("tension", "motion")
    for seed in range(4):
        compare(robot_of(cables, seed=seed), some_poses(2500, seed=seed), methods)


@pytest.mark.slow
def test_half_planes_of_a_hundred_thousand_poses_take_seconds():
    robot, poses = box_robot(crossed=True, seed=3), some_poses(100_000, seed=7)
    start = time.process_time()
    found = kinematic_stability(robot, poses, "half_plane", certificates=False)
    assert time.process_time() - start < 5.0  # measured: 0.7 s
    assert 0.1 < found.stable.mean() < 0.5
