"""Studies of many poses, beside the functions that study one thing each, and closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pips_drake.cable_robot.interference import box_from_bounds, clearances
from pips_drake.cable_robot.kinematics import jacobian, make_poses
from pips_drake.cable_robot.stability import kinematic_stability, static_stability
from pips_drake.cable_robot.statics import (
    characteristic_length,
    distribute_tensions,
    moment_scales,
)
from pips_drake.cable_robot.workspace import Study, make_grid, sweep
from pips_drake.errors import InputError, PipsError

from .robots import box_robot, planar_example


@pytest.fixture(scope="module")
def robot():
    return replace(
        box_robot(crossed=True, seed=1),
        tension_min=5.0,
        tension_max=900.0,
        box=np.array([0.6, 0.6, 0.6]),
    )


@pytest.fixture(scope="module")
def grid():
    return make_grid([-3.5, -2.5, -2.5], [3.5, 2.5, 3.0], (7, 5, 11))


def test_columns_are_what_functions_say_that_study_one_thing_each(robot, grid):
    poses, wall = grid.poses, box_from_bounds("wall", [1.0, 1.0, -2.0], [2.0, 2.5, 0.5])
    found = sweep(robot, poses, Study(obstacles=[wall], least_clearance=0.002))
    kinematic = kinematic_stability(robot, poses, certificates=False)
    np.testing.assert_array_equal(found.rank, kinematic.rank)
    np.testing.assert_array_equal(found.kinematic, kinematic.stable)
    np.testing.assert_array_equal(found.static, static_stability(robot, poses).stable)
    chosen = distribute_tensions(robot, poses, "least_norm")
    np.testing.assert_array_equal(found.feasible, chosen.feasible)
    np.testing.assert_allclose(found.slack, chosen.slack)
    held = chosen.feasible
    np.testing.assert_allclose(found.tension_most[held], chosen.tensions[held].max(axis=1))
    np.testing.assert_allclose(found.tension_least[held], chosen.tensions[held].min(axis=1))
    assert np.isnan(found.tension_most[~held]).all()
    scales = moment_scales(robot, characteristic_length(robot))
    condition = np.linalg.cond(jacobian(robot, poses) / scales)
    np.testing.assert_allclose(found.condition, condition, rtol=1e-9)
    near = clearances(robot, poses, [wall])
    np.testing.assert_array_equal(found.clear, (near.least >= 0.002) & (near.cable_platform > 0.0))
    np.testing.assert_array_equal(found.usable, found.feasible & found.clear)
    assert 0 < found.usable.sum() < found.feasible.sum() < len(poses)


def test_kinematically_stable_poses_are_statically_stable_and_feasible_ones_too(robot, grid):
    found = sweep(robot, grid.poses, Study(parts=["tensions"]))
    assert np.all(found.static[found.kinematic])
    assert np.all(found.static[found.feasible])
    assert found.kinematic.any()


def test_a_larger_disturbance_leaves_a_part_of_the_workspace(robot, grid):
    still = sweep(robot, grid.poses, Study(parts=[]))
    small, large = (
        sweep(
            robot,
            grid.poses,
            Study(disturbance_force=force, disturbance_moment=0.1 * force, parts=[]),
        )
        for force in (15.0, 60.0)
    )
    assert np.all(still.feasible[small.feasible])
    assert np.all(small.feasible[large.feasible])
    assert large.feasible.sum() < small.feasible.sum() < still.feasible.sum()
    # Four times the box fits a quarter as often.
    np.testing.assert_allclose(small.margin, 4.0 * large.margin, rtol=1e-9)


def test_parts_that_are_left_out_are_no_numbers(robot, grid):
    found = sweep(robot, grid.poses, Study(parts=[]))
    assert np.isnan(found.tension_most).all()
    assert np.isnan(found.condition).all()
    assert found.clearances is None
    assert found.clear.all()


def test_chunks_do_not_show(robot, monkeypatch):
    poses = make_grid([-1.0, -1.0, -1.0], [1.0, 1.0, 1.0], (3, 3, 3)).poses
    whole = sweep(robot, poses)
    monkeypatch.setattr("pips_drake.cable_robot.workspace._CHUNK", 10)
    parts = sweep(robot, poses)
    np.testing.assert_array_equal(whole.slack, parts.slack)
    np.testing.assert_array_equal(whole.feasible, parts.feasible)


def test_a_planar_robot_is_studied_too():
    found = sweep(
        planar_example(), make_poses([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]], [[0, 0, 0], [0.5, 0, 0]])
    )
    assert found.rank.tolist() == [3, 3]
    assert not found.static[0]
    assert not found.feasible[0]


def test_volumes_of_masks_are_those_of_bodies():
    grid = make_grid([-1.0, -1.0, -1.0], [1.0, 1.0, 1.0], (60, 60, 60))
    ball = np.linalg.norm(grid.poses.position, axis=1) < 0.9
    # The error of counted cells is of the order of a cell's size, 1/30, squared.
    assert grid.measure(ball) == pytest.approx(4.0 / 3.0 * np.pi * 0.9**3, rel=5e-3)
    assert grid.fraction(ball) == pytest.approx(grid.measure(ball) / 8.0)
    level = make_grid([-1.0, -1.0, 0.3], [1.0, 1.0, 0.3], (200, 200, 1))
    disc = np.linalg.norm(level.poses.position, axis=1) < 0.9
    assert level.measure(disc) == pytest.approx(np.pi * (0.9**2 - 0.3**2), rel=5e-3)
    assert level.values(disc).shape == (200, 200, 1)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"disturbance_force": -1.0}, "disturbance_force"),
        ({"least_clearance": np.nan}, "least_clearance"),
        ({"parts": ["colour"]}, "colour"),
        ({"tension_method": "guess"}, "guess"),
    ],
)
def test_bad_studies_are_refused(changes, words):
    with pytest.raises(PipsError, match=words):
        Study(**changes)


def test_bad_sweeps_and_grids_are_refused(robot):
    with pytest.raises(InputError, match="poses to study"):
        sweep(robot, make_poses(np.zeros((0, 3))))
    with pytest.raises(InputError, match="tension_max"):
        sweep(box_robot(), make_poses([[0, 0, 0]]), Study(tension_method="analytic_center"))
    with pytest.raises(InputError, match="block or slice"):
        make_grid([0, 0, 0], [-1, 1, 1], (2, 2, 2))
    with pytest.raises(InputError, match="flat"):
        make_grid([0, 0, 0], [0, 1, 1], (2, 2, 2))
