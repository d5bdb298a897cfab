"""Other engines say the same of the exported arm: pinocchio of the URDF, MuJoCo of the MJCF.

Drake reads the SDF, so each number comes from two files, two parsers and two ways to compute. The
fast tests collect this file without the other engines; the slow ones fail where they are missing.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.drives import joint_stiffness
from pips_drake.serpentine.mounting import MOUNTINGS, mounting_rotation
from pips_drake.serpentine.statics import holding_efforts

from .engines import Drake, Mujoco, Pinocchio

pytestmark = pytest.mark.slow

# A posture multiplies some 20 to 30 matrices of doubles, and a force sums over as many bodies; the
# files have the shortest text that reads back as the same double. So what differs is roundings: a
# hundred of them, in the greatest number of what is compared.
RELATIVE = 2e-14
#: The arm is up to 8 m long.
METRES = 8.0


ARMS = ("prototype", "prototype, mirrored", "pcr_concept", "pcr_concept, mirrored")


@pytest.fixture(scope="module", params=ARMS)
def reference(request):
    """An arm, Drake's plant, and 20 postures within the limits with rates, (20, joints)."""
    name, _, hand = request.param.partition(", ")
    arm = dataclasses.replace(load_arm(name), mirrored=bool(hand))
    rng = np.random.default_rng(18)
    q = rng.uniform(arm.joint_lower, arm.joint_upper, (20, arm.joints))
    return arm, Drake(arm), list(zip(q, rng.uniform(-1.0, 1.0, q.shape), strict=True))


@pytest.fixture(scope="module", params=[Pinocchio, Mujoco])
def peer(request, reference):
    return request.param(reference[0])


def assert_same(found, expected, scale=None):
    """Equal but for roundings in the greatest of the numbers."""
    scale = np.abs(expected).max() if scale is None else scale
    np.testing.assert_allclose(found, expected, rtol=0, atol=RELATIVE * scale)


def go(state, *engines):
    """All of them to the same posture and rates."""
    for engine in engines:
        engine.go(*state)


@pytest.mark.parametrize(
    ("quantity", "scale"),
    [
        pytest.param("poses", METRES, id="every link stands where Drake's does"),
        pytest.param("tip_jacobian", METRES, id="the tip moves as Drake's does"),
        pytest.param("gravity", None, id="gravity pulls as in Drake"),
        pytest.param("mass_matrix", None, id="the mass matrix is Drake's"),
        # With the mass matrix this is the whole of the free arm's dynamics.
        pytest.param("bias", None, id="rates ask for the efforts that they do in Drake"),
    ],
)
def test_the_arm_is_drakes(reference, peer, quantity, scale):
    _, drake, states = reference
    for state in states:
        go(state, drake, peer)
        assert_same(getattr(peer, quantity)(), getattr(drake, quantity)(), scale)


def test_every_link_weighs_what_drakes_does(reference, peer):
    arm, drake, states = reference
    for state in states:
        go(state, drake, peer)
        for found, expected, scale in zip(
            peer.inertias(), drake.inertias(), (None, METRES, None), strict=True
        ):
            assert len(found) == arm.joints
            assert_same(found, expected, scale)


def test_what_collides_stands_where_drakes_does(reference, peer):
    _, drake, states = reference
    for state in states[:5]:
        go(state, drake, peer)
        found, expected = peer.solids(), drake.solids()
        assert found.keys() == expected.keys()
        for body, poses in expected.items():
            assert_same(found[body], poses, METRES)


def test_joints_end_where_drakes_do(reference, peer):
    _, drake, _ = reference
    for found, expected in zip(peer.limits(), drake.limits(), strict=True):
        np.testing.assert_array_equal(found, expected)  # the same text in all files


def test_pinocchio_knows_the_speed_limits(reference):
    arm, drake, _ = reference
    limit = Pinocchio(arm).model.velocityLimit
    np.testing.assert_array_equal(limit, drake.plant.GetVelocityUpperLimits())


def test_mujocos_drives_are_drakes(reference):
    arm, drake, _ = reference
    model = Mujoco(arm).model
    for j, name in enumerate(arm.joint_names):
        actuator = drake.plant.GetJointActuatorByName(name)
        gains = actuator.get_controller_gains()
        assert model.actuator(j).name == name
        # A position actuator's force: gain[0] u + bias[1] q + bias[2] q', of its joint.
        assert model.actuator(j).trnid[0] == model.joint(name).id
        assert model.actuator(j).gainprm[0] == -model.actuator(j).biasprm[1] == gains.p
        assert model.actuator(j).biasprm[2] == -gains.d
    # MuJoCo makes the ends from their middle and the half between: a rounding.
    np.testing.assert_allclose(model.actuator_ctrlrange, model.jnt_range, rtol=4e-16)


def test_mujocos_contacts_are_drakes_collisions(reference):
    """Same shapes, and the same pairs left out, wherever the arm is folded into itself."""
    arm, drake, _ = reference
    mujoco = Mujoco(arm)
    rng = np.random.default_rng(30)
    postures = rng.uniform(arm.joint_lower, arm.joint_upper, (200, arm.joints))
    # Half of them coil: even hinges alike, and odd ones.
    postures[::2, 3::2] = postures[::2, 3:4]
    postures[::2, 4::2] = postures[::2, 4:5]
    seen = []
    for q in postures:
        go((q, np.zeros(arm.joints)), drake, mujoco)
        found = mujoco.touching()
        # What only just touches may not, in the other: engines are good to a micrometre or so.
        assert {pair for pair, depth in found.items() if depth > 1e-5} <= drake.touching(0.0)
        assert drake.touching(1e-5) <= set(found)
        seen += drake.touching(1e-5)
    assert len(seen) > 50
    if arm.modules > 10:  # long enough to bite its own tail
        assert len([pair for pair in seen if "rail" not in pair]) >= 5


@pytest.mark.parametrize("mounting", MOUNTINGS)
def test_in_mujoco_the_arm_holds_itself_up_and_sags_as_statics_say(reference, mounting):
    arm, _, _ = reference
    mujoco = Mujoco(arm, mounting)
    command = arm.joint_home.copy()
    command[0] = 0.5 * (arm.joint_lower[0] + arm.joint_upper[0])
    mujoco.go(command, np.zeros(arm.joints))
    mujoco.data.ctrl[:] = command
    assert mujoco.data.ncon == 0
    start = mujoco.data.site("tip").xpos.copy()
    mujoco.run(1.0)
    # Sane within the first second: nothing flies, nothing touches. (It sags by millimetres, and
    # swings about that.)
    assert np.linalg.norm(mujoco.data.site("tip").xpos - start) < 0.05
    assert np.abs(mujoco.data.qvel).max() < 0.1
    assert mujoco.data.ncon == 0
    # The slowest mode (3 Hz, 5 percent of critical damping) dies by exp(-1) a second.
    mujoco.run(30.0)
    assert np.abs(mujoco.data.qvel).max() < 1e-9
    q = mujoco.data.qpos.copy()
    gravity = mounting_rotation(mounting).T @ [0.0, 0.0, -9.81]
    expected = holding_efforts(arm, q, gravity)[0] / joint_stiffness(arm)
    # Angles of 1e-4 rad, differences of angles of 1 rad.
    np.testing.assert_allclose(command - q, expected, rtol=1e-9, atol=1e-13)
