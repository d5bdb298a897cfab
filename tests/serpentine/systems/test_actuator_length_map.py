"""Lengths are the distances between the pins, and their rates derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from pips_drake.serpentine.systems.actuator_length_map import ActuatorLengthMap


def test_ports(arm, port_sizes):
    assert port_sizes(ActuatorLengthMap(arm)) == ({"joint_state": 36}, {"drive_state": 36})


def test_the_output_has_feedthrough(arm):
    assert ActuatorLengthMap(arm).HasAnyDirectFeedthrough()


def test_lengths_are_the_distances_between_the_pins(arm, random_postures, evaluate):
    system = ActuatorLengthMap(arm)
    # FACTS: pins a = b = the box's width from the hinge and 90 deg apart when it is straight. An
    # actuator belongs to the box on its inner side: L3 to L9 large, L10 to L15 medium, then small.
    pins = 0.0254 * np.repeat([9.0, 7.5, 6.0, 2.7], [7, 6, 2, 1])
    for q in random_postures(arm, 20):
        drives = evaluate(system, "drive_state", joint_state=np.append(q, np.zeros(18)))
        distance = np.abs(pins - pins * np.exp(1j * (0.5 * np.pi + q[2:])))
        np.testing.assert_array_equal(drives[:2], q[:2])
        # A few roundings of lengths of a third of a metre.
        np.testing.assert_allclose(drives[2:18], distance, rtol=0, atol=1e-15)


@pytest.mark.parametrize("variant", [{}, {"mirrored": True}, {"lengths": [15.0, 12.0]}])
def test_rates_are_differences_of_lengths(arm_variant, random_postures, evaluate, variant):
    arm = arm_variant(**variant)
    system, n = ActuatorLengthMap(arm), arm.joints
    rng = np.random.default_rng(4)
    step = 1e-6
    for q in random_postures(arm, 10):
        v = rng.uniform(-1.0, 1.0, n)
        ahead = evaluate(system, "drive_state", joint_state=np.append(q + step * v, v))[:n]
        behind = evaluate(system, "drive_state", joint_state=np.append(q - step * v, v))[:n]
        rates = evaluate(system, "drive_state", joint_state=np.append(q, v))[n:]
        # Central differences: step^2 of the third derivative, and roundings of d1 (3 m) over step.
        np.testing.assert_allclose(rates, (ahead - behind) / (2.0 * step), rtol=0, atol=1e-9)
