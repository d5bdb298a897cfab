"""Stiffness of a cable robot: finite differences of the wrench, closed forms, its directions."""

from __future__ import annotations

import numpy as np
import pytest

from pips_drake.cable_robot.kinematics import Poses, cable_lengths, jacobian, make_poses
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.statics import distribute_tensions, structure_matrix
from pips_drake.cable_robot.stiffness import (
    cable_stiffness,
    elastic_stiffness,
    full_stiffness,
    stiffness_directions,
)
from pips_drake.errors import InputError

from .robots import box_robot, planar_example
from .test_kinematics import moved, some_poses


def heavy_box(**changes) -> CableRobot:
    box = box_robot(crossed=True, seed=3)
    numbers = {
        "centre_of_mass": [0.1, -0.2, 0.15],
        "axial_stiffness": np.linspace(2e4, 9e4, 8),
    }
    return CableRobot(
        name="heavy", anchors=box.anchors, attachments=box.attachments, mass=20.0,
        **(numbers | changes),
    )  # fmt: skip


def wrench(robot, poses, unstretched, *, weight):
    """Of cables of these unstretched lengths, Hooke's law and nothing else."""
    tensions = robot.axial_stiffness * (cable_lengths(robot, poses) / unstretched - 1.0)
    pulled = (structure_matrix(robot, poses) @ tensions[..., None])[..., 0]
    return pulled + (robot.weight_wrench(poses.rotation) if weight else 0.0)


def differences(robot, poses, tensions, *, weight, h=1e-6):
    unstretched = cable_lengths(robot, poses) / (1.0 + tensions / robot.axial_stiffness)
    columns = []
    for twist in np.eye(6)[list(robot.freedoms)]:
        ahead, behind = (
            wrench(robot, moved(poses, twist, step), unstretched, weight=weight) for step in (h, -h)
        )
        columns.append(-(ahead - behind) / (2 * h))
    return np.stack(columns, axis=2)


@pytest.mark.parametrize("weight", [False, True])
def test_the_full_stiffness_is_minus_the_gradient_of_the_wrench(weight):
    """Tensions anything: the derivation asks for no equilibrium, and K is not symmetric."""
    robot, poses = heavy_box(), some_poses(30)
    tensions = np.random.default_rng(1).uniform(100.0, 5000.0, (30, 8))
    K = full_stiffness(robot, poses, tensions, weight=weight)
    expected = differences(robot, poses, tensions, weight=weight)
    assert np.abs(K - np.swapaxes(K, 1, 2)).max() > 100.0
    sizes = np.abs(expected).max(axis=(1, 2))
    # Measured: 6e-10. Roundings of 1e-12 N over steps of 1e-6, third derivatives times 1e-12.
    assert np.all(np.abs(K - expected).max(axis=(1, 2)) < 1e-8 * sizes)


def test_the_pretensions_share_alone_is_within_a_hundred_thousandth():
    """Slack ropes: the tensions' terms are most of K, so none of them hides behind E A / l."""
    robot, poses = heavy_box(axial_stiffness=10.0), some_poses(30, seed=2)
    tensions = np.random.default_rng(2).uniform(100.0, 500.0, (30, 8))
    K = full_stiffness(robot, poses, tensions)
    expected = differences(robot, poses, tensions, weight=True)
    geometric = expected - elastic_stiffness(robot, poses)
    assert np.all(np.abs(geometric).max(axis=(1, 2)) > 0.5 * np.abs(expected).max(axis=(1, 2)))
    error = np.abs(K - expected).max(axis=(1, 2))
    assert np.all(error < 1e-5 * np.abs(geometric).max(axis=(1, 2)))


def test_a_planar_robots_too():
    robot = planar_example(centre_of_mass=[0.1, 0.2, 0.0], axial_stiffness=300.0)
    rng = np.random.default_rng(3)
    places = np.column_stack([rng.uniform(-0.5, 0.5, (10, 2)), np.zeros(10)])
    poses = make_poses(places, [0.3, 0.0, 0.0])
    tensions = rng.uniform(1.0, 50.0, (10, 4))
    K = full_stiffness(robot, poses, tensions)
    assert K.shape == (10, 3, 3)
    np.testing.assert_allclose(K, differences(robot, poses, tensions, weight=True), rtol=1e-6,
                               atol=1e-6)  # fmt: skip


def test_without_tensions_it_is_the_reports_matrix():
    robot, poses = heavy_box(), some_poses(10)
    K = full_stiffness(robot, poses, np.zeros((10, 8)), weight=False)
    L = jacobian(robot, poses)
    expected = [L[k].T @ np.diag(robot.axial_stiffness / cable_lengths(robot, poses)[k]) @ L[k]
                for k in range(10)]  # fmt: skip
    np.testing.assert_allclose(K, expected, rtol=1e-12, atol=1e-8)
    np.testing.assert_allclose(elastic_stiffness(robot, poses), expected, rtol=1e-12, atol=1e-8)


def test_in_equilibrium_it_is_symmetric_with_the_weight_and_only_with_it():
    robot, poses = heavy_box(), some_poses(200, seed=4)
    found = distribute_tensions(robot, poses, tension_min=10.0, tension_max=2000.0)
    kept = np.flatnonzero(found.feasible)
    assert len(kept) > 20
    held = Poses(poses.position[kept], poses.rotation[kept])
    both = full_stiffness(robot, held, found.tensions[kept])
    np.testing.assert_allclose(both, np.swapaxes(both, 1, 2), atol=1e-8)
    cables = full_stiffness(robot, held, found.tensions[kept], weight=False)
    # Half of [M x], M the cables' moment, which bears that of the weight.
    M = -robot.weight_wrench(held.rotation)[:, 3:]
    odd = 0.5 * (cables - np.swapaxes(cables, 1, 2))[:, 3:, 3:]
    found_moment = np.stack([odd[:, 2, 1], odd[:, 0, 2], odd[:, 1, 0]], axis=1)
    np.testing.assert_allclose(found_moment, 0.5 * M, atol=1e-8)
    assert np.abs(M).max() > 10.0


def test_the_symmetric_part_is_the_second_derivative_of_the_energy():
    robot, poses, h = heavy_box(), some_poses(20, seed=5), 1e-3
    rng = np.random.default_rng(5)
    tensions, twist = rng.uniform(100.0, 5000.0, (20, 8)), rng.normal(size=6)
    unstretched = cable_lengths(robot, poses) / (1.0 + tensions / robot.axial_stiffness)

    def energy(step):
        at = moved(poses, twist, step)
        stretch = cable_lengths(robot, at) - unstretched
        height = (at.rotation @ robot.centre_of_mass + at.position)[:, 2]
        elastic = 0.5 * np.sum(robot.axial_stiffness / unstretched * stretch**2, axis=1)
        return elastic + 20.0 * 9.81 * height

    curvature = (energy(h) - 2 * energy(0.0) + energy(-h)) / h**2
    K = full_stiffness(robot, poses, tensions)
    # Fourth derivatives over twelve times h^2.
    np.testing.assert_allclose(curvature, np.einsum("i,nij,j->n", twist, K, twist), rtol=1e-5)


def test_a_pendulum_is_held_sideways_by_its_tension_over_its_length():
    """Two upright cables of length l, each T: sideways out of their plane 2 T / l, no more."""
    robot = CableRobot(
        name="swing", anchors=[[1, 0, 3], [-1, 0, 3], [1, 0, -3], [-1, 0, -3], [5, 0, 0],
                               [-5, 0, 0]],
        attachments=[[1, 0, 0], [-1, 0, 0]] * 3, axial_stiffness=1e6,
    )  # fmt: skip
    home, tensions = make_poses([[0.0, 0.0, 0.0]]), [[60.0, 60.0, 0, 0, 0, 0]]
    K = full_stiffness(robot, home, tensions)[0]
    assert K[1, 1] == pytest.approx(2 * 60.0 / 3.0, rel=1e-12)
    assert elastic_stiffness(robot, home)[0, 1, 1] == pytest.approx(0.0, abs=1e-9)


def test_cables_are_stiffer_by_their_tension():
    robot, poses = heavy_box(), some_poses(3)
    lengths = cable_lengths(robot, poses)
    np.testing.assert_allclose(cable_stiffness(robot, poses) * lengths, [robot.axial_stiffness] * 3)
    more = cable_stiffness(robot, poses, np.full((3, 8), 50.0)) * lengths
    np.testing.assert_allclose(more, [robot.axial_stiffness + 50.0] * 3)


def test_directions_are_the_singular_vectors_with_rotations_as_arcs():
    robot, poses, length = heavy_box(), some_poses(20, seed=6), 0.4
    K = elastic_stiffness(robot, poses)
    found = stiffness_directions(robot, K, length)
    arcs = np.diag([1, 1, 1, 1 / length, 1 / length, 1 / length])
    _, singular, rows = np.linalg.svd(arcs @ K @ arcs)
    np.testing.assert_allclose(found.values, singular[:, ::-1], rtol=1e-9, atol=1e-6)
    unit = found.twists * [1, 1, 1, length, length, length]
    np.testing.assert_allclose(unit @ np.swapaxes(unit, 1, 2), [np.eye(6)] * 20, atol=1e-12)
    for mine, theirs in ((unit[:, -1], rows[:, 0]), (unit[:, 0], rows[:, -1])):
        np.testing.assert_allclose(np.abs(np.sum(mine * theirs, axis=1)), 1.0, atol=1e-9)
    # The force along the softest direction is its stiffness times the motion.
    force = (K @ found.softest[..., None])[..., 0] / [1, 1, 1, length, length, length]
    np.testing.assert_allclose(force, found.values[:, :1] * unit[:, 0], rtol=1e-6, atol=1e-6)
    assert np.all(found.values[:, -1] >= found.values[:, 0])
    np.testing.assert_array_equal(found.stiffest, found.twists[:, -1])


def test_directions_out_of_equilibrium_are_those_of_the_symmetric_part():
    robot, poses = heavy_box(), some_poses(10, seed=7)
    K = full_stiffness(robot, poses, np.full((10, 8), 2000.0))
    found = stiffness_directions(robot, K, 1.0)
    # t . K t knows the symmetric part alone, and its extremes are the values.
    along = np.einsum("nki,nij,nkj->nk", found.twists, K, found.twists)
    np.testing.assert_allclose(along, found.values, rtol=1e-9, atol=1e-6)
    assert np.abs(K - np.swapaxes(K, 1, 2)).max() > 10.0


def test_pretension_can_make_a_pose_unstable_and_the_value_says_so():
    """Radial cables to the platform's far side: it turns about as the tension pulls it.

    Each gives the rotation T (u . a) + T a^2 / l = T (-1 + 1 / 3).
    """
    anchors = np.array([[2.0, 0, 0], [-2, 0, 0], [0, 2, 0], [0, -2, 0]])
    robot = planar_example(anchors=anchors, attachments=-0.5 * anchors)
    home, pull = make_poses([[0.0, 0.0, 0.0]]), 7.0
    K = full_stiffness(robot, home, np.full((1, 4), pull))
    found = stiffness_directions(robot, K, 1.0)
    assert found.values[0, 0] == pytest.approx(-8.0 / 3.0 * pull, rel=1e-9)
    np.testing.assert_allclose(np.abs(found.softest[0]), [0.0, 0.0, 1.0], atol=1e-9)


@pytest.mark.parametrize("length", [0.0, -1.0, np.nan])
def test_a_length_of_rotations_that_is_none_is_refused(length):
    with pytest.raises(InputError, match=r"length of rotations = .* m; must be > 0"):
        stiffness_directions(planar_example(), np.eye(3)[None], length)


def test_tensions_of_another_shape_are_refused():
    with pytest.raises(InputError, match=r"tensions of shape \(8,\); must be \(2, 8\)"):
        full_stiffness(heavy_box(), some_poses(2), np.zeros(8))
