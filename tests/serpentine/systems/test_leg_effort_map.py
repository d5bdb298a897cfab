"""The joints' efforts are what the actuators' forces make, and back."""

from __future__ import annotations

import numpy as np
import pytest

from pips_drake.serpentine.systems.actuator_force_map import ActuatorForceMap
from pips_drake.serpentine.systems.leg_effort_map import LegEffortMap


def test_ports(arm, port_sizes):
    inputs, outputs = port_sizes(LegEffortMap(arm))
    assert inputs == {"joint_state": 36, "base_effort": 2, "leg_force": 16}
    assert outputs == {"joint_effort": 18}


def test_the_output_has_feedthrough_from_all_inputs(arm):
    system = LegEffortMap(arm)
    assert all(system.HasDirectFeedthrough(i, 0) for i in range(3))


def test_a_pushing_actuator_turns_its_joint_by_its_lever(arm, evaluate):
    # Closed form at the straight hinge: the lever is a / sqrt 2, the pins 9 in from it.
    force = np.zeros(16)
    force[0] = 100.0
    effort = evaluate(
        LegEffortMap(arm),
        "joint_effort",
        joint_state=np.append(arm.joint_home, np.zeros(18)),
        base_effort=[7.0, -3.0],
        leg_force=force,
    )
    assert effort[2] == pytest.approx(100.0 * 9.0 * 0.0254 / np.sqrt(2.0), rel=1e-14)
    np.testing.assert_array_equal(effort[:2], [7.0, -3.0])
    assert np.count_nonzero(effort) == 3


@pytest.mark.parametrize("variant", [{}, {"mirrored": True}, {"base": "gimbal"}])
def test_the_force_map_gives_the_forces_back(arm_variant, random_postures, evaluate, variant):
    arm, rng = arm_variant(**variant), np.random.default_rng(8)
    for q in random_postures(arm, 5):
        state, drives = np.append(q, q), rng.uniform(-1000.0, 1000.0, 18)
        effort = evaluate(
            LegEffortMap(arm),
            "joint_effort",
            joint_state=state,
            base_effort=drives[:2],
            leg_force=drives[2:],
        )
        back = evaluate(
            ActuatorForceMap(arm), "drive_effort", joint_state=state, joint_effort=effort
        )
        np.testing.assert_allclose(back, drives, rtol=1e-14)
