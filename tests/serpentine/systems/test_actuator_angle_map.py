"""The joint state that drives hold: the triangles solved for their angles."""

from __future__ import annotations

import numpy as np
import pytest

from pips_drake.errors import InputError
from pips_drake.serpentine.systems.actuator_angle_map import ActuatorAngleMap
from pips_drake.serpentine.systems.actuator_length_map import ActuatorLengthMap

PERIOD = 1.0 / 64.0


def pins(arm):
    """a = b (A,) m of the prototype: FACTS' table, by the box on each hinge's inner side."""
    return 0.0254 * np.repeat([9.0, 7.5, 6.0, 2.7], [7, 6, 2, 1])


def test_ports(arm, port_sizes):
    assert port_sizes(ActuatorAngleMap(arm)) == ({"drive_state": 36}, {"joint_state": 36})


def test_the_output_has_feedthrough(arm):
    assert ActuatorAngleMap(arm).HasAnyDirectFeedthrough()


def test_angles_close_the_triangles(arm, random_postures, evaluate):
    system, a = ActuatorAngleMap(arm), pins(arm)
    for q in random_postures(arm, 20):
        lengths = 2.0 * a * np.sin(0.5 * (0.5 * np.pi + q[2:]))  # isosceles
        state = evaluate(
            system, "joint_state", drive_state=np.concatenate([q[:2], lengths, np.zeros(18)])
        )
        # arccos of a cosine between -0.5 and 0.5, from lengths with roundings: some 1e-15 rad.
        np.testing.assert_allclose(state[:18], q, rtol=0, atol=1e-14)


@pytest.mark.parametrize("variant", [{}, {"mirrored": True}, {"lengths": [15.0, 12.0]}])
def test_it_undoes_the_length_map_rates_too(arm_variant, random_postures, evaluate, variant):
    arm = arm_variant(**variant)
    lengths, angles = ActuatorLengthMap(arm), ActuatorAngleMap(arm)
    rng = np.random.default_rng(5)
    for q in random_postures(arm, 10):
        state = np.append(q, rng.uniform(-0.1, 0.1, arm.joints))
        drives = evaluate(lengths, "drive_state", joint_state=state)
        back = evaluate(angles, "joint_state", drive_state=drives)
        np.testing.assert_allclose(back, state, rtol=0, atol=1e-14)


def test_with_a_period_the_rates_carry_the_joints_from_where_they_were(arm, random_postures):
    a, rng = pins(arm), np.random.default_rng(6)
    system = ActuatorAngleMap(arm, period=PERIOD)
    context = system.CreateDefaultContext()
    for q in random_postures(arm, 10):
        lengths = np.append(q[:2], 2.0 * a * np.sin(0.5 * (0.5 * np.pi + q[2:])))
        rates = rng.uniform(-0.025, 0.025, 18)
        system.GetInputPort("drive_state").FixValue(context, np.append(lengths, rates))
        now, v = np.split(system.GetOutputPort("joint_state").Eval(context), 2)
        before = lengths - PERIOD * rates
        angles = 2.0 * np.arcsin(before[2:] / (2.0 * a)) - 0.5 * np.pi
        # Rounding of d1 (up to 2.9 m) and of the angles.
        np.testing.assert_allclose(
            now - PERIOD * v, np.append(before[:2], angles), rtol=0, atol=1e-14
        )


def test_a_length_that_closes_no_triangle_is_refused_by_name(arm, evaluate):
    a = pins(arm)
    drives = np.concatenate([arm.joint_home[:2], np.sqrt(2.0) * a, np.zeros(18)])
    drives[4] = 0.5  # L5: longer than both anchors of 9 in
    message = r"L5_m = 0\.5000; must be a length with which the actuator and its two anchors close"
    with pytest.raises(InputError, match=message):
        evaluate(ActuatorAngleMap(arm), "joint_state", drive_state=drives)


def test_a_rate_that_comes_from_no_triangle_is_refused_too(arm, evaluate):
    drives = np.concatenate([arm.joint_home[:2], np.sqrt(2.0) * pins(arm), np.zeros(18)])
    drives[18 + 3] = 50.0  # L4 would have had a length below zero and beyond both anchors
    with pytest.raises(InputError, match=r"L4_m = -0\.\d+; must be a length"):
        evaluate(ActuatorAngleMap(arm, period=PERIOD), "joint_state", drive_state=drives)
