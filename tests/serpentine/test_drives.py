"""Drives: the base's joints as they are, every other through its actuator."""

from __future__ import annotations

import numpy as np

from pips_drake.serpentine.drives import (
    drive_columns,
    drive_efforts,
    drive_limits,
    drives_from_joints,
    effort_columns,
    joint_effort_limit,
    joint_stiffness,
    joints_from_drives,
    levers,
)

INCH = 0.0254
DEGREE = np.pi / 180.0
# FACTS, the assumed table: boxes of joints 3 to 18 by the segment on the inner side of the hinge.
PINS = INCH * np.repeat([9.0, 7.5, 6.0, 2.7], [7, 6, 2, 1])
STIFFNESS = np.repeat([4e7, 3e7, 2e7], [7, 6, 3])


def test_columns_have_names_and_units(arm):
    lengths = [f"L{j}" for j in range(3, 19)]
    assert drive_columns(arm) == ("d1_m", "theta2_rad", *(f"{name}_m" for name in lengths))
    assert effort_columns(arm) == ("d1_N", "theta2_Nm", *(f"{name}_N" for name in lengths))


def test_lengths_are_those_of_isosceles_triangles(arm, random_postures):
    q = random_postures(arm, 50)
    drives = drives_from_joints(arm, q)
    np.testing.assert_array_equal(drives[:, :2], q[:, :2])
    expected = 2.0 * PINS * np.sin(0.5 * (0.5 * np.pi + q[:, 2:]))
    np.testing.assert_allclose(drives[:, 2:], expected, rtol=0, atol=2e-16)


def test_joints_come_back_from_their_drives(arm, random_postures):
    q = random_postures(arm, 200)
    np.testing.assert_allclose(joints_from_drives(arm, drives_from_joints(arm, q)), q, atol=1e-14)


def test_a_length_without_a_triangle_gives_nan_at_its_own_place(arm):
    drives = drives_from_joints(arm, arm.joint_home)
    drives[5] = 3.0 * PINS[3]
    assert np.flatnonzero(np.isnan(joints_from_drives(arm, drives))).tolist() == [5]


def test_levers_are_derivatives_of_the_drives(arm, random_postures):
    q, step = random_postures(arm, 50), 1e-5
    ahead, behind = drives_from_joints(arm, q + step), drives_from_joints(arm, q - step)
    # step^2 of the third derivative (below 0.1 m), and roundings over the step (d1 up to 3 m).
    np.testing.assert_allclose(levers(arm, q), (ahead - behind) / (2 * step), rtol=0, atol=1e-10)


def test_efforts_do_the_joints_work(arm, random_postures):
    q = random_postures(arm, 50)
    rng = np.random.default_rng(11)
    tau, v, step = rng.normal(size=q.shape), rng.normal(size=q.shape), 1e-5
    rates = (drives_from_joints(arm, q + step * v) - drives_from_joints(arm, q - step * v)) / (
        2.0 * step
    )
    power = np.sum(drive_efforts(arm, q, tau) * rates, axis=1)
    # Efforts up to some 30 (1 over a lever of 0.1 m) times the differences' 1e-10, 18 of them.
    np.testing.assert_allclose(power, np.sum(tau * v, axis=1), rtol=0, atol=1e-7)


def test_limits_are_those_of_the_assumed_table(arm):
    lower, upper, speed, effort = drive_limits(arm)
    # +-30 deg about 90 between the pins, and 2 mm more each way.
    np.testing.assert_allclose(lower[2:], 2.0 * PINS * np.sin(30.0 * DEGREE) - 0.002, atol=1e-15)
    np.testing.assert_allclose(upper[2:], 2.0 * PINS * np.sin(60.0 * DEGREE) + 0.002, atol=1e-15)
    np.testing.assert_allclose(lower[:2], [24.9 * INCH, -120.0 * DEGREE], rtol=1e-15)
    np.testing.assert_allclose(upper[:2], [114.5 * INCH, -60.0 * DEGREE], rtol=1e-15)
    np.testing.assert_allclose(speed, [0.05, 5.0 * DEGREE] + [0.025] * 16, rtol=1e-15)
    forces = [25000.0] * 7 + [6000.0] * 6 + [600.0] * 3
    np.testing.assert_allclose(effort, [10000.0, 7000.0, *forces], rtol=1e-15)


def test_limits_are_copies(arm):
    for values in drive_limits(arm):
        values[:] = np.nan
    assert all(np.all(np.isfinite(values)) for values in drive_limits(arm))


def test_hinges_are_as_stiff_as_their_actuators_on_their_levers(arm):
    # Straight: lever a cos(45 deg), so K = k a^2 / 2, and its torque limit F a / sqrt 2.
    stiffness = joint_stiffness(arm)
    np.testing.assert_allclose(stiffness[:2], [2e7, 4e6], rtol=1e-15)
    np.testing.assert_allclose(stiffness[2:], STIFFNESS * PINS**2 / 2.0, rtol=1e-14)
    limit = joint_effort_limit(arm)
    forces = np.repeat([25000.0, 6000.0, 600.0], [7, 6, 3])
    np.testing.assert_allclose(limit[2:], forces * PINS / np.sqrt(2.0), rtol=1e-14)


def test_the_true_stiffness_departs_from_the_constant_one_as_documented(arm):
    # k a^2 cos^2(45 + theta / 2): at -30 deg 3/2, at +30 deg 1/2 of that at zero.
    for angle, share in ((-30.0, 1.5), (30.0, 0.5)):
        true = arm.linkage.joint_stiffness(np.full(16, angle * DEGREE))
        np.testing.assert_allclose(true / joint_stiffness(arm)[2:], share, rtol=1e-14)


def test_many_postures_give_what_each_gives_alone(arm, random_postures):
    q = random_postures(arm, 3)
    for function in (drives_from_joints, levers):
        together = function(arm, q)
        for i in range(3):
            np.testing.assert_array_equal(function(arm, q[i]), together[i])
