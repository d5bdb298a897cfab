"""The camera looks at its target: against rotations written out, and all angles tried."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from pips_drake.errors import InputError
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.drives import drive_limits, levers
from pips_drake.serpentine.pointing import aim, make_mount
from pips_drake.twin.camera import camera_rotation

ARM = load_arm("prototype")
FREE = make_mount(ARM, pan_limit=math.pi, tilt_limit=math.pi / 2)
COORDINATE = st.floats(-3.0, 3.0)


def view(arm, mount, joints, joint, pan, tilt):
    """Position and direction of the camera in frame {0}, by forward kinematics."""
    q = np.array(joints)
    q[-1] = joint
    X = kinematics.frames(arm, q)[0, -1]
    eye = X[:3, 3] + X[:3, 0] * mount.reach
    return eye, X[:3, :3] @ camera_rotation(pan, tilt)[:, 2]


def error(arm, mount, joints, target, joint, pan, tilt):
    """Angle between the view and the target, rad."""
    eye, ahead = view(arm, mount, joints, joint, pan, tilt)
    to_target = target - eye
    return math.atan2(np.linalg.norm(np.cross(ahead, to_target)), ahead @ to_target)


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6), target=st.tuples(COORDINATE, COORDINATE, COORDINATE))
@pytest.mark.parametrize("mirrored", [False, True])
def test_without_limits_the_camera_looks_at_any_target(arm_variant, mirrored, seed, target):
    arm = arm_variant(mirrored=mirrored, lengths=[12.0] * 4, offsets=[1.0] * 3)
    mount = make_mount(arm, pan_limit=math.pi, tilt_limit=math.pi / 2)
    q = np.random.default_rng(seed).uniform(arm.joint_lower, arm.joint_upper)
    found = aim(arm, mount, q, target)
    eye, _ = view(arm, mount, q, found.joint, 0.0, 0.0)
    assume(np.linalg.norm(target - eye) > 1e-3)
    left = error(arm, mount, q, np.array(target), found.joint, found.pan, found.tilt)
    assert left < 1e-7


@pytest.mark.parametrize("seed", range(20))
def test_the_last_joint_leaves_the_least_pan(seed):
    """Of all angles within its limits; by trying them."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(ARM.joint_lower, ARM.joint_upper)
    # Ahead of the camera, where a joint that is nearer to the target leaves less pan.
    X = kinematics.frames(ARM, q)[0, -2]
    ahead = [ARM.segment_length[-1] + rng.uniform(0.6, 3.0), *rng.uniform(-2.0, 2.0, 2)]
    target = X[:3, :3] @ ahead + X[:3, 3]
    found = aim(ARM, FREE, q, target)
    pans = []
    angles = np.linspace(FREE.joint_lower, FREE.joint_upper, 401)
    for angle in angles:
        q[-1] = angle
        last = kinematics.frames(ARM, q)[0, -1]
        x, y, _ = last[:3, :3].T @ (target - last[:3, 3]) - [FREE.reach, 0.0, 0.0]
        pans.append(abs(math.atan2(y, x)))
    # The angles tried are 2.4e-3 rad apart; the pan turns somewhat faster than the joint, because
    # the camera moves too: reach over distance, at most a quarter here.
    assert abs(found.pan) <= min(pans) + 1e-9
    assert found.joint == pytest.approx(angles[int(np.argmin(pans))], abs=3e-3)


def test_within_the_joints_reach_no_pan_is_left():
    q = np.zeros(18)
    q[0], q[1] = ARM.joint_home[:2]
    for angle in (-0.4, 0.0, 0.3):
        # Where it looks at this angle, and 0.2 m aside along the hinge's axis.
        eye, ahead = view(ARM, FREE, q, angle, 0.0, 0.0)
        axis = kinematics.frames(ARM, q)[0, -1, :3, 2]
        found = aim(ARM, FREE, q, eye + 1.5 * ahead + 0.2 * axis)
        assert found.joint == pytest.approx(angle, abs=1e-12)
        assert found.pan == pytest.approx(0.0, abs=1e-12)
        assert found.tilt == pytest.approx(math.atan2(0.2, 1.5), abs=1e-12)


@given(seed=st.integers(0, 10**6), target=st.tuples(COORDINATE, COORDINATE, COORDINATE))
def test_limits_are_kept(seed, target):
    mount = make_mount(ARM)
    q = np.random.default_rng(seed).uniform(ARM.joint_lower, ARM.joint_upper)
    found = aim(ARM, mount, q, target)
    assert mount.joint_lower <= found.joint <= mount.joint_upper
    assert abs(found.pan) <= mount.pan_limit
    assert abs(found.tilt) <= mount.tilt_limit


def test_on_the_hinges_axis_the_joint_stays():
    q = np.zeros(18)
    q[:2], q[-1] = ARM.joint_home[:2], 0.1
    X = kinematics.frames(ARM, q)[0, -1]
    assert aim(ARM, FREE, q, X[:3, 3] + X[:3, 2]).joint == 0.1


def test_the_mount_keeps_the_actuator_within_its_share_of_speed():
    mount = make_mount(ARM, speed_share=0.5, joint_margin=math.radians(3.0))
    angles = np.linspace(ARM.joint_lower[-1], ARM.joint_upper[-1], 50)
    speeds = []
    for angle in angles:
        q = np.zeros(18)
        q[-1] = angle
        speeds.append(levers(ARM, q)[-1] * mount.joint_speed)
    assert max(speeds) == pytest.approx(0.5 * drive_limits(ARM)[2][-1], rel=1e-3)
    assert mount.joint_upper == pytest.approx(math.radians(27.0))
    with pytest.raises(InputError, match="camera's joint margin"):
        make_mount(ARM, joint_margin=1.0)
