"""Actuators do the same work as the joints they move."""

from __future__ import annotations

import numpy as np
import pytest

from pips_drake.serpentine.systems.actuator_force_map import ActuatorForceMap
from pips_drake.serpentine.systems.actuator_length_map import ActuatorLengthMap


def test_ports(arm, port_sizes):
    inputs, outputs = port_sizes(ActuatorForceMap(arm))
    assert inputs == {"joint_state": 36, "joint_effort": 18}
    assert outputs == {"drive_effort": 18}


def test_the_output_has_feedthrough_from_both_inputs(arm):
    system = ActuatorForceMap(arm)
    assert system.HasDirectFeedthrough(0, 0) and system.HasDirectFeedthrough(1, 0)


@pytest.mark.parametrize("variant", [{}, {"mirrored": True}, {"lengths": [15.0, 12.0]}])
def test_the_drives_work_is_the_joints_work(arm_variant, random_postures, evaluate, variant):
    arm = arm_variant(**variant)
    lengths, n, rng = ActuatorLengthMap(arm), arm.joints, np.random.default_rng(7)
    step = 1e-6
    for q in random_postures(arm, 10):
        tau = rng.uniform(-1000.0, 1000.0, n)
        force = evaluate(
            ActuatorForceMap(arm), "drive_effort", joint_state=np.append(q, q), joint_effort=tau
        )
        for j in range(n):
            moved = []
            for sign in (1.0, -1.0):
                other = q.copy()
                other[j] += sign * step
                state = np.append(other, np.zeros(n))
                moved.append(evaluate(lengths, "drive_state", joint_state=state)[:n])
            # Central differences of lengths (d1 up to 3 m): roundings over the step, 1e-9 relative.
            work = force @ (moved[0] - moved[1])
            assert work == pytest.approx(tau[j] * 2.0 * step, rel=1e-8)


def test_a_pushing_actuator_is_positive(arm, evaluate):
    # Closed form at the straight hinge: L = 2 a sin(45 deg + theta / 2), so dL/dtheta = a / sqrt 2.
    effort = np.zeros(18)
    effort[2] = 100.0
    state = np.append(arm.joint_home, np.zeros(18))
    force = evaluate(ActuatorForceMap(arm), "drive_effort", joint_state=state, joint_effort=effort)
    assert force[2] == pytest.approx(100.0 * np.sqrt(2.0) / (9.0 * 0.0254), rel=1e-14)
    assert np.count_nonzero(force) == 1
