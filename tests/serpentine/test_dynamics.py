"""Inverse dynamics: as Drake's, as statics at rest, and with the energy that it puts in."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.multibody.tree import MultibodyForces

from pips_drake.errors import InputError
from pips_drake.serpentine.dynamics import inverse_dynamics
from pips_drake.serpentine.runs.placed_arm import place_arm
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.statics import holding_efforts
from pips_drake.serpentine.station import gravity_in_frame_0, load_setup

GRAVITY = np.array([0.3, -9.0, 2.0])


def random_motions(arm, count):
    rng = np.random.default_rng(1995)
    q = rng.uniform(arm.joint_lower, arm.joint_upper, (count, arm.joints))
    v, a = rng.normal(size=(2, count, arm.joints))
    return q, v, a


@pytest.mark.parametrize(("name", "mounting"), [("prototype", "pad"), ("pcr_concept", "pad_below")])
def test_efforts_are_those_of_drakes_inverse_dynamics(name, mounting):
    scenario = SerpentineScenario(path="trajectory_4", arm=name, mounting=mounting)
    setup = load_setup(scenario)
    placed = place_arm(scenario, setup)
    plant, model = placed.plant, placed.model
    context = plant.GetMyContextFromRoot(placed.diagram.CreateDefaultContext())
    q, v, a = random_motions(setup.arm, 20)
    efforts = inverse_dynamics(setup.arm, q, v, a, gravity_in_frame_0(plant))
    for i in range(len(q)):
        plant.SetPositions(context, model, q[i])
        plant.SetVelocities(context, model, v[i])
        forces = MultibodyForces(plant)
        plant.CalcForceElementsContribution(context, forces)
        expected = plant.CalcInverseDynamics(context, a[i], forces)
        # Roundings of efforts of some kNm through a chain of 18, and of the poses in the SDF.
        np.testing.assert_allclose(efforts[i], expected, rtol=1e-9, atol=1e-8)


def test_at_rest_it_is_statics(arm, random_postures):
    q = random_postures(arm, 20)
    rest = np.zeros_like(q)
    # Roundings of torques of a few kNm.
    np.testing.assert_allclose(
        inverse_dynamics(arm, q, rest, rest, GRAVITY),
        holding_efforts(arm, q, GRAVITY),
        rtol=1e-12,
        atol=1e-9,
    )


def test_a_mirrored_arm_has_the_same_efforts_under_mirrored_gravity(arm_variant):
    drawn, mirrored = arm_variant(), arm_variant(mirrored=True)
    motions = random_motions(drawn, 5)
    np.testing.assert_array_equal(
        inverse_dynamics(drawn, *motions, GRAVITY),
        inverse_dynamics(mirrored, *motions, GRAVITY * [1.0, -1.0, 1.0]),
    )


def test_efforts_are_quadratic_in_speed_and_linear_in_acceleration(arm):
    """tau(q, k v, k^2 a) - g = k^2 (tau(q, v, a) - g): what makes slowing down always possible."""
    q, v, a = random_motions(arm, 10)
    hold = holding_efforts(arm, q, GRAVITY)
    moving = inverse_dynamics(arm, q, v, a, GRAVITY) - hold
    slower = inverse_dynamics(arm, q, 0.5 * v, 0.25 * a, GRAVITY) - hold
    np.testing.assert_allclose(slower, 0.25 * moving, rtol=1e-9, atol=1e-8)


def test_unusable_shapes_are_refused(arm):
    q = np.zeros((2, arm.joints))
    with pytest.raises(InputError, match=r"velocities of shape \(3, 18\); must be \(N, 18\)"):
        inverse_dynamics(arm, q, np.zeros((3, 18)), q, GRAVITY)
    with pytest.raises(InputError, match=r"positions of shape \(18,\)"):
        inverse_dynamics(arm, q[0], q, q, GRAVITY)
    with pytest.raises(InputError, match=r"gravity of shape \(2,\); must be \(3,\)"):
        inverse_dynamics(arm, q, q, q, [0.0, 1.0])
