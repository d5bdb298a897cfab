"""Rest postures with winches locked: against statics, pendulums and another minimiser."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from pips_drake.cable_robot.cable_forces import cable_pull
from pips_drake.cable_robot.kinematics import Poses, cable_lengths, make_poses
from pips_drake.cable_robot.rest_posture import rest_posture
from pips_drake.cable_robot.statics import distribute_tensions
from pips_drake.errors import InputError

from .robots import box_robot, planar_example

ROBOT = replace(box_robot(crossed=True), tension_min=10.0, tension_max=2000.0)
POSES = make_poses([[0.0, 0.0, 0.0], [0.8, -0.5, 0.3], [-1.0, 0.7, -0.4]], [0.05, 0.02, -0.03])


def held_lengths(robot=ROBOT, poses=POSES):
    """Unstretched lengths with which the statics' tensions hold the platform."""
    held = distribute_tensions(robot, poses)
    assert held.feasible.all()
    EA = robot.axial_stiffness
    return cable_lengths(robot, poses) * EA / (EA + held.tensions), held.tensions


def test_platform_returns_to_where_the_statics_hold_it():
    l0, tensions = held_lengths()
    away = make_poses(POSES.position + np.array([0.1, -0.05, 0.08]), [0.15, -0.1, 0.1])
    found = rest_posture(ROBOT, away, l0)
    assert found.held.all() and not found.slack.any()
    # A residual of 1e-9 of 200 N, at the softest stiffness of some 1e3 N/m; 1e5 N/m for tensions.
    np.testing.assert_allclose(found.poses.position, POSES.position, atol=1e-9)
    np.testing.assert_allclose(found.poses.rotation, POSES.rotation, atol=1e-9)
    np.testing.assert_allclose(found.tensions, tensions, rtol=1e-7)


@pytest.mark.parametrize("cable", range(8))
def test_rest_with_a_broken_cable_is_the_least_energy(cable):
    """Of another minimiser with an energy of its own, from where the cable broke."""
    l0, _ = held_lengths()
    broken = np.eye(8)[cable]
    start = Poses(POSES.position[1:2], POSES.rotation[1:2])
    found = rest_posture(ROBOT, start, l0[1], broken=broken)
    assert found.found[0] and found.stable[0] and found.tensions[0, cable] == 0.0

    def energy(numbers):
        turned = Rotation.from_rotvec(numbers[3:]).as_matrix() @ start.rotation[0]
        ends = numbers[:3] + ROBOT.attachments @ turned.T
        stretch = np.linalg.norm(ROBOT.anchors - ends, axis=1) - l0[1]
        springs = (1.0 - broken) * ROBOT.axial_stiffness / l0[1] * np.maximum(stretch, 0.0) ** 2
        return 0.5 * springs.sum() + ROBOT.mass * 9.81 * numbers[2]

    numbers = np.concatenate([start.position[0], np.zeros(3)])
    for _ in range(3):  # again from where differences that are too coarse have left it
        least = minimize(energy, numbers, method="BFGS", options={"gtol": 1e-7})
        numbers = least.x
    assert found.energy[0] <= least.fun + 1e-9, "there is a lower place near"
    # Energies have an error of 1e-13 J, stiffnesses are 1e3 N/m and more; differences do worse.
    np.testing.assert_allclose(found.poses.position[0], numbers[:3], atol=1e-4)


def test_wrench_is_nothing_and_the_energy_rises_all_round():
    l0, _ = held_lengths()
    found = rest_posture(ROBOT, POSES, l0, broken=np.eye(8)[3])
    pulled = cable_pull(ROBOT, found.poses, l0, broken=np.eye(8)[3])
    left = pulled.wrench + ROBOT.weight_wrench(found.poses.rotation)
    assert np.abs(left).max() < 1e-6
    assert np.all(found.least_stiffness > 0.0)


def test_single_cable_holds_the_weight_but_not_the_turning():
    """The platform hangs below its anchor, stretched by m g, and turns about the cable freely."""
    one = np.ones(8)
    one[0] = 0.0
    found = rest_posture(ROBOT, make_poses([0.2, 0.1, 0.0]), np.full(8, 3.0), broken=one)
    assert found.found[0] and not found.stable[0] and not found.held[0]
    assert found.tensions[0, 0] == pytest.approx(20.0 * 9.81, rel=1e-9)
    end = found.poses.position[0] + found.poses.rotation[0] @ ROBOT.attachments[0]
    below = np.array([0.0, 0.0, 3.0 * (1.0 + 20.0 * 9.81 / ROBOT.axial_stiffness[0])])
    np.testing.assert_allclose(end, ROBOT.anchors[0] - below, atol=1e-8)
    np.testing.assert_allclose(found.poses.position[0, :2], ROBOT.anchors[0, :2], atol=1e-8)


def test_nothing_holds_a_platform_without_cables():
    found = rest_posture(ROBOT, make_poses([0, 0, 0]), np.full(8, 3.0), broken=np.ones(8))
    assert not found.found[0] and not found.stable[0] and not found.held[0]


def test_overloaded_cables_hold_nothing():
    l0, _ = held_lengths()
    weak = replace(ROBOT, tension_min=0.0, tension_max=100.0)
    found = rest_posture(weak, POSES, l0)
    assert found.stable.all() and not found.within_bounds.any() and not found.held.any()


def test_bad_input_is_refused():
    pose = make_poses([0, 0, 0])
    with pytest.raises(InputError, match="a planar robot; rest postures are of robots in space"):
        rest_posture(planar_example(), pose, np.ones(4))
    with pytest.raises(InputError, match="unstretched length = -1 m; must be > 0"):
        rest_posture(ROBOT, pose, -np.ones(8))
