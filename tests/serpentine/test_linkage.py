"""The actuators' lengths follow from their triangles, and force and speed from the same lever."""

from __future__ import annotations

import numpy as np
import pytest

from pips_drake.serpentine.linkage import Linkage


@pytest.fixture
def scalene() -> Linkage:
    """Two actuators whose pins stand at different distances, away from 90 deg."""
    return Linkage.make(
        anchor_inner=np.array([0.20, 0.15]),
        anchor_outer=np.array([0.12, 0.25]),
        pin_angle=np.radians([80.0, 110.0]),
        stiffness=np.array([4e7, 2e7]),
        force_limit=np.array([1e4, 1e3]),
        speed_limit=np.array([0.02, 0.03]),
        angle_lower=np.radians([-30.0, -25.0]),
        angle_upper=np.radians([30.0, 20.0]),
        overtravel=0.002,
    )


def angles(count: int = 201) -> np.ndarray:
    """Hinge angles (N, 2), rad, through the joints' range and a little beyond."""
    return np.linspace(-0.6, 0.6, count)[:, None] * np.ones(2)


def test_length_is_the_distance_between_the_pins(scalene):
    # Pins as points in the plane: one at angle 0, the other at pin_angle + theta.
    theta = angles()
    a, b, phi = scalene.anchor_inner, scalene.anchor_outer, scalene.pin_angle + theta
    distance = np.abs(a - b * np.exp(1j * phi))
    np.testing.assert_allclose(scalene.length(theta), distance, rtol=0, atol=1e-15)


def test_angle_undoes_length(scalene, arm):
    # Conditioning of arccos at 45 deg and more from its ends: a few roundings.
    np.testing.assert_allclose(scalene.angle(scalene.length(angles())), angles(), atol=1e-14)
    rng = np.random.default_rng(1)
    theta = rng.uniform(arm.joint_lower[2:], arm.joint_upper[2:], size=(500, 16))
    np.testing.assert_allclose(arm.linkage.angle(arm.linkage.length(theta)), theta, atol=1e-14)


def test_an_equal_sided_right_triangle_has_the_textbook_length_and_lever(arm):
    # Straight hinge, pins at a = b, square: L = a sqrt 2, lever = a / sqrt 2.
    a = arm.linkage.anchor_inner
    zero = np.zeros(16)
    np.testing.assert_allclose(arm.linkage.length(zero), a * np.sqrt(2.0), rtol=1e-15)
    np.testing.assert_allclose(arm.linkage.lever(zero), a / np.sqrt(2.0), rtol=1e-15)


def test_lever_is_the_derivative_of_length(scalene):
    # Central difference: h^2 L''' / 6 is below 1e-11 m and rounding 1e-16 / h as well.
    h = 1e-5
    theta = angles()
    slope = (scalene.length(theta + h) - scalene.length(theta - h)) / (2.0 * h)
    np.testing.assert_allclose(scalene.lever(theta), slope, rtol=0, atol=1e-10)


def test_virtual_work_of_force_and_torque_is_the_same(scalene):
    """A force along the actuator, applied at the pin, has the torque force * lever."""
    theta, force = angles(), 1234.0
    b, phi = scalene.anchor_outer, scalene.pin_angle + theta
    pin = b * np.exp(1j * phi)
    direction = (pin - scalene.anchor_inner) / np.abs(pin - scalene.anchor_inner)
    torque = np.imag(np.conj(pin) * direction * force)  # r x F in the plane
    np.testing.assert_allclose(force * scalene.lever(theta), torque, rtol=1e-13)


def test_joint_stiffness_is_the_second_derivative_of_the_stored_energy(scalene):
    # About the rest length the spring's energy is k (L(theta + e) - L(theta))^2 / 2. Its second
    # difference errs by e^2 relative (1e-6) from curvature of L.
    theta, e = angles(11), 1e-3

    def energy(delta: float) -> np.ndarray:
        stretch = scalene.length(theta + delta) - scalene.length(theta)
        return 0.5 * scalene.stiffness * stretch**2

    second = (energy(e) + energy(-e)) / e**2
    np.testing.assert_allclose(scalene.joint_stiffness(theta), second, rtol=1e-5)


def test_strokes_end_at_the_joints_limits_plus_overtravel(scalene):
    lower, upper = np.radians([-30.0, -25.0]), np.radians([30.0, 20.0])
    a, b, phi = scalene.anchor_inner, scalene.anchor_outer, scalene.pin_angle
    short = np.sqrt(a**2 + b**2 - 2 * a * b * np.cos(phi + lower)) - 0.002
    long = np.sqrt(a**2 + b**2 - 2 * a * b * np.cos(phi + upper)) + 0.002
    np.testing.assert_allclose(scalene.length_lower, short, rtol=1e-14)
    np.testing.assert_allclose(scalene.length_upper, long, rtol=1e-14)


def test_a_length_that_closes_no_triangle_gives_nan(scalene):
    a, b = scalene.anchor_inner, scalene.anchor_outer
    assert np.all(np.isnan(scalene.angle(a + b + 1e-6)))
    assert np.all(np.isnan(scalene.angle(np.abs(a - b) - 1e-6)))
    # Just inside the stretched triangle it is 180 deg less sqrt(2 (a + b) / (a b) 1e-12 m).
    np.testing.assert_allclose(scalene.angle(a + b - 1e-12), np.pi - scalene.pin_angle, atol=1e-5)


def test_any_leading_shape_is_kept(scalene):
    theta = np.zeros((4, 5, 2))
    assert scalene.length(theta).shape == (4, 5, 2)
    assert scalene.lever(theta).shape == (4, 5, 2)
    assert scalene.angle(scalene.length(theta)).shape == (4, 5, 2)
