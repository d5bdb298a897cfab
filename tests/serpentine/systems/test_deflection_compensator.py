"""What the drives are sent farther is what gravity's effort makes of their stiffness."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from pips_drake.errors import InputError
from pips_drake.serpentine.sdf import make_sdf
from pips_drake.serpentine.systems.actuator_angle_map import ActuatorAngleMap
from pips_drake.serpentine.systems.actuator_length_map import ActuatorLengthMap
from pips_drake.serpentine.systems.deflection_compensator import DeflectionCompensator

GRAVITY = np.array([9.81, 0.0, 0.0])  # x0 is down in the pad mounting


def plant_of(arm, gravity):
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModelsFromString(make_sdf(arm), "sdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("rail"))
    plant.mutable_gravity_field().set_gravity_vector(gravity)
    plant.Finalize()
    return plant


def test_ports(arm, port_sizes):
    system = DeflectionCompensator(arm, gravity=GRAVITY)
    assert port_sizes(system) == ({"joint_state": 36}, {"drive_offset": 18})


def test_the_output_has_feedthrough(arm):
    assert DeflectionCompensator(arm, gravity=GRAVITY).HasAnyDirectFeedthrough()


@pytest.mark.parametrize("variant", [{}, {"mirrored": True}, {"base": "gimbal"}])
@pytest.mark.parametrize("gravity", [GRAVITY, [1.0, -9.0, 3.0]])
def test_the_set_points_pull_as_hard_as_gravity(
    arm_variant, random_postures, evaluate, variant, gravity
):
    arm = arm_variant(**variant)
    plant = plant_of(arm, gravity)
    context = plant.CreateDefaultContext()
    actuators = [plant.get_joint_actuator(i) for i in plant.GetJointActuatorIndices()]
    gains = np.array([actuator.get_controller_gains().p for actuator in actuators])
    compensator = DeflectionCompensator(arm, gravity=gravity)
    for q in random_postures(arm, 10):
        state = np.append(q, np.zeros(18))
        drives = evaluate(ActuatorLengthMap(arm), "drive_state", joint_state=state)
        drives[:18] += evaluate(compensator, "drive_offset", joint_state=state)
        aim = evaluate(ActuatorAngleMap(arm), "joint_state", drive_state=drives)[:18]
        plant.SetPositions(context, q)
        load = plant.CalcGravityGeneralizedForces(context)
        # aim - q is a difference of numbers up to 3 with roundings of 4e-16, times up to 2e7 N/m.
        np.testing.assert_allclose(gains * (aim - q), -load, rtol=0, atol=1e-7)


def test_without_gravity_there_is_no_offset(arm, random_postures, evaluate):
    compensator = DeflectionCompensator(arm, gravity=np.zeros(3))
    state = np.append(random_postures(arm, 1)[0], np.zeros(18))
    np.testing.assert_array_equal(evaluate(compensator, "drive_offset", joint_state=state), 0.0)


@pytest.mark.parametrize("gravity", [[9.81], [0.0, 0.0, np.nan], 9.81])
def test_a_gravity_that_is_no_vector_is_refused(arm, gravity):
    with pytest.raises(InputError, match=r"gravity = .*; must be three finite numbers, m/s\^2"):
        DeflectionCompensator(arm, gravity=gravity)


@pytest.mark.parametrize("variant", [{}, {"mirrored": True}])
def test_along_legs_each_actuator_is_pressed_together_as_hard_as_gravity_loads_it(
    arm_variant, random_postures, evaluate, variant
):
    arm = arm_variant(**variant)
    plant = plant_of(arm, GRAVITY)
    context = plant.CreateDefaultContext()
    compensator = DeflectionCompensator(arm, gravity=GRAVITY, along_legs=True)
    lengths = ActuatorLengthMap(arm)
    # The arm's README: 40, 30 and 20 MN/m; the rail's and the crane's own.
    stiffness = np.append([2e7, 4e6], np.repeat([4e7, 3e7, 2e7], [7, 6, 3]))
    step = 1e-6
    for q in random_postures(arm, 10):
        state = np.append(q, np.zeros(18))
        offset = evaluate(compensator, "drive_offset", joint_state=state)
        ahead, behind = (
            evaluate(lengths, "drive_state", joint_state=state + sign * step)[:18]
            for sign in (1.0, -1.0)
        )
        plant.SetPositions(context, q)
        load = plant.CalcGravityGeneralizedForces(context)
        # Virtual work; central differences of lengths of up to 3 m are good to 1e-9 of them.
        work = stiffness * offset * (ahead - behind) / (2.0 * step)
        np.testing.assert_allclose(work, -load, rtol=1e-8, atol=1e-6)
