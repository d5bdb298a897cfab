"""Efforts that hold the arm are Drake's gravity forces, and the drives can make them."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from pips_drake.errors import InputError
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.drives import drives_from_joints, joint_stiffness, joints_from_drives
from pips_drake.serpentine.follow_the_leader import FollowTheLeader
from pips_drake.serpentine.mounting import MOUNTINGS, mounting_rotation
from pips_drake.serpentine.path_file import load_path
from pips_drake.serpentine.sdf import make_sdf
from pips_drake.serpentine.statics import (
    deflection_terms,
    holding_efforts,
    sag,
    write_deflection_offset,
)

INCH = 0.0254
G = 9.81
VARIANTS = [
    {},
    {"mirrored": True},
    {"offsets": [0.0] * 8},
    {"base": "gimbal"},
    {"lengths": [18.0, 14.0]},
]
GRAVITIES = [[G, 0.0, 0.0], [0.0, 0.0, -G], [1.0, -7.0, 5.0]]


def plant_holding_efforts(arm, postures, gravity):
    """What holds the arm against Drake's gravity, (N, J)."""
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModelsFromString(make_sdf(arm), "sdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("rail"))
    plant.mutable_gravity_field().set_gravity_vector(gravity)
    plant.Finalize()
    context, efforts = plant.CreateDefaultContext(), []
    for q in postures:
        plant.SetPositions(context, q)
        efforts.append(-plant.CalcGravityGeneralizedForces(context))
    return np.array(efforts)


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("gravity", GRAVITIES)
def test_holding_efforts_are_minus_the_plants_gravity_forces(
    arm_variant, random_postures, variant, gravity
):
    arm = arm_variant(**variant)
    postures = random_postures(arm, 50)
    # Efforts reach kilonewtons and kilonewton metres: sums of 18 terms in doubles.
    np.testing.assert_allclose(
        holding_efforts(arm, postures, gravity),
        plant_holding_efforts(arm, postures, gravity),
        rtol=0,
        atol=1e-10,
    )


@pytest.mark.parametrize("mirrored", [False, True])
def test_holding_efforts_are_the_gradient_of_the_potential_energy(
    arm_variant, random_postures, mirrored
):
    arm, gravity, step = arm_variant(mirrored=mirrored), np.array([3.0, -8.0, 5.0]), 1e-4
    masses = np.array([body.mass for body in arm.bodies])
    centres = np.array([body.centre for body in arm.bodies]) * arm.mirror

    def energy(q):
        frames = kinematics.frames(arm, q)[0]
        places = np.einsum("jab,jb->ja", frames[:, :3, :3], centres) + frames[:, :3, 3]
        return -masses @ places @ gravity

    for q in random_postures(arm, 5):
        efforts = holding_efforts(arm, q, gravity)[0]
        for j in range(arm.joints):
            ahead, behind = (energy(q + sign * step * np.eye(arm.joints)[j]) for sign in (1, -1))
            # Central differences: step^2 / 6 of efforts up to 5 kNm is 1e-5 Nm; roundings of
            # 10 kJ over the step 1e-8.
            assert efforts[j] == pytest.approx((ahead - behind) / (2.0 * step), abs=2e-5)


def test_with_the_rail_upright_its_drive_carries_all_that_moves(arm, random_postures):
    # FACTS' masses: carriage, crane, boxes, short links, camera head.
    mass = 40.0 + 25.0 + 3 * 24.0 + 3 * 14.0 + 2 * 7.0 + 7 * 1.5 + 4.0
    efforts = holding_efforts(arm, random_postures(arm, 20), [0.0, 0.0, -G])
    np.testing.assert_allclose(efforts[:, 0], mass * G, rtol=1e-14)


def test_the_camera_head_weighs_on_the_last_hinge(arm):
    # 4 kg, 3 in out. At home the hinges stand at 45 deg to x0 (FTL-95 Table A.1's twist).
    efforts = holding_efforts(arm, arm.joint_home, [G, 0.0, 0.0])[0]
    assert abs(efforts[-1]) == pytest.approx(4.0 * G * 3.0 * INCH * np.sqrt(0.5), rel=1e-12)


def test_efforts_are_linear_in_gravity(arm, random_postures):
    q = random_postures(arm, 10)
    parts = sum(holding_efforts(arm, q, g) for g in ([1.0, 0, 0], [0, 2.0, 0], [0, 0, -3.0]))
    np.testing.assert_allclose(holding_efforts(arm, q, [1.0, 2.0, -3.0]), parts, atol=1e-11)


def test_one_posture_gives_what_it_gives_among_others(arm, random_postures):
    q, gravity = random_postures(arm, 5), [G, 0.0, 0.0]
    together = holding_efforts(arm, q, gravity)
    assert together.shape == (5, 18)
    np.testing.assert_array_equal(holding_efforts(arm, q[3], gravity)[0], together[3])


@pytest.fixture(scope="module")
def drive_loads(arm):
    """Largest drive efforts on any of the four trajectories by mounting, (18,), N and Nm."""
    solver = FollowTheLeader(arm)
    postures = []
    for number in range(1, 5):
        path = load_path(f"trajectory_{number}")
        postures.append(solver.solve(path, path.samples(INCH)).joints)
    q = np.concatenate(postures)
    # FACTS: a = b, and 90 deg between the pins: L = 2 a sin(45 deg + theta / 2), lever its slope.
    pins = INCH * np.repeat([9.0, 7.5, 6.0, 2.7], [7, 6, 2, 1])
    lever = np.hstack([np.ones((len(q), 2)), pins * np.cos(0.25 * np.pi + 0.5 * q[:, 2:])])
    loads = {}
    for name in MOUNTINGS:
        gravity = mounting_rotation(name).T @ [0.0, 0.0, -G]
        loads[name] = np.abs(plant_holding_efforts(arm, q, gravity) / lever).max(axis=0)
    return loads


# The limits as FACTS and the arm file have them: N by box of the hinge's inner side, Nm for the
# crane.
LIMITS = {
    "large": (slice(2, 9), 25000.0),
    "medium": (slice(9, 15), 6000.0),
    "small": (slice(15, 18), 600.0),
    "crane": (slice(1, 2), 7000.0),
}


@pytest.mark.parametrize("drives", LIMITS)
def test_on_the_pad_force_limits_leave_a_factor_of_1_5_to_3_over_statics(arm, drive_loads, drives):
    which, limit = LIMITS[drives]
    if drives == "crane":
        assert arm.base_effort_limit[1] == limit
    else:
        np.testing.assert_array_equal(
            arm.linkage.force_limit[slice(which.start - 2, which.stop - 2)], limit
        )
    assert 1.5 <= limit / drive_loads["pad"][which].max() <= 3.0


@pytest.mark.parametrize("mounting", sorted(MOUNTINGS))
def test_in_every_mounting_the_drives_hold_the_arm_with_half_as_much_to_spare(
    drive_loads, mounting
):
    loads = drive_loads[mounting]
    for which, limit in LIMITS.values():
        assert limit / loads[which].max() >= 1.5
    assert 10000.0 / max(loads[0], 1e-9) >= 1.5


def test_on_the_pad_the_rail_carries_no_load_along_itself(drive_loads):
    assert drive_loads["pad"][0] < 1e-9


def test_wrong_shapes_are_refused_with_what_is_allowed(arm):
    with pytest.raises(InputError, match=r"shape \(17,\); must be \(N, 18\) for arm 'prototype'"):
        holding_efforts(arm, np.zeros(17), [0.0, 0.0, -G])
    with pytest.raises(InputError, match=r"gravity of shape \(1,\); must be \(3,\), m/s\^2"):
        holding_efforts(arm, np.zeros(18), [-G])


@pytest.mark.parametrize("mirrored", [False, True])
def test_drives_that_are_sent_farther_turn_the_joints_by_their_sag(
    arm_variant, random_postures, mirrored
):
    arm, gravity = arm_variant(mirrored=mirrored), GRAVITIES[2]
    for q in random_postures(arm, 20):
        expected = plant_holding_efforts(arm, [q], gravity)[0] / joint_stiffness(arm)
        # Efforts are Drake's to 1e-10 Nm (above), and the softest hinge has 4.7e4 Nm/rad: what is
        # left are roundings of angles, and of lengths on levers of 0.1 m.
        np.testing.assert_allclose(sag(arm, q, gravity)[0], expected, rtol=0, atol=1e-13)
        offset = np.empty(arm.joints)
        write_deflection_offset(*deflection_terms(arm, gravity), q, offset)
        turned = joints_from_drives(arm, drives_from_joints(arm, q) + offset) - q
        np.testing.assert_allclose(turned, expected, rtol=0, atol=1e-13)
