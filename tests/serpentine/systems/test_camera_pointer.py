"""The pointer finds its target and keeps it, within its speeds."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput

from pips_drake.errors import InputError
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.pointing import aim, make_mount
from pips_drake.serpentine.systems.camera_pointer import CameraPointer
from pips_drake.twin.camera import camera_rotation

ARM = load_arm("prototype")
MOUNT = make_mount(ARM)
PERIOD = 1.0 / 64.0
HOME = np.concatenate([ARM.joint_home, np.zeros(18)])
#: Ahead of the arm at home and to a side, within reach of joint, pan and tilt; frame {0}, m.
TIP = kinematics.frames(ARM, ARM.joint_home)[0, -1]
TARGET = TIP[:3, 3] + TIP[:3, :3] @ [1.2, -0.5, 0.4]


def record(pointer, seconds, *, state=HOME, target=None):
    """Time (N,), last joint and its rate, pan and tilt (N,) each, of joints that stand still."""
    builder = DiagramBuilder()
    builder.AddSystem(pointer)
    source = builder.AddSystem(ConstantVectorSource(state))
    builder.Connect(source.get_output_port(), pointer.GetInputPort("joint_state"))
    if target is not None:
        point = builder.AddSystem(ConstantVectorSource(target))
        builder.Connect(point.get_output_port(), pointer.GetInputPort("target"))
    logs = [
        LogVectorOutput(pointer.GetOutputPort(name), builder, PERIOD)
        for name in ("joint_state", "pan_tilt")
    ]
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(seconds)
    context = simulator.get_context()
    joints, turns = (log.FindLog(context) for log in logs)
    return joints.sample_times(), joints.data()[17], joints.data()[35], *turns.data()


def test_ports(port_sizes):
    assert port_sizes(CameraPointer(ARM)) == (
        {"joint_state": 36, "target": 3},
        {"joint_state": 36, "pan_tilt": 2},
    )


def test_only_the_joints_pass_through():
    pointer = CameraPointer(ARM, target=TARGET)
    feedthrough = [[pointer.HasDirectFeedthrough(i, j) for j in range(2)] for i in range(2)]
    assert feedthrough == [[True, False], [False, False]]


def test_all_joints_but_the_last_are_the_inputs(evaluate):
    state = np.arange(36.0)
    found = evaluate(CameraPointer(ARM, target=TARGET), "joint_state", joint_state=state)
    others = np.setdiff1d(np.arange(36), [17, 35])
    np.testing.assert_array_equal(found[others], state[others])


def test_it_starts_where_the_joint_is_and_ends_on_the_target():
    _, joint, rate, pan, tilt = record(CameraPointer(ARM, target=TARGET), 8.0)
    assert joint[0] == 0.0 and rate[0] == 0.0
    wanted = aim(ARM, MOUNT, ARM.joint_home, TARGET)
    # It closes in by exp(-2 t) once it is below its speed limit: 1e-5 of half a radian is left.
    assert joint[-1] == pytest.approx(wanted.joint, abs=1e-5)
    assert (pan[-1], tilt[-1]) == pytest.approx((wanted.pan, wanted.tilt), abs=1e-5)
    assert abs(rate[-1]) < 1e-4


def test_while_the_joint_is_under_way_the_pan_keeps_the_target():
    _, joint, _, pan, tilt = record(CameraPointer(ARM, target=TARGET), 4.0)
    for row in range(1, len(joint), 16):
        q = ARM.joint_home.copy()
        q[-1] = joint[row]
        X = kinematics.frames(ARM, q)[0, -1]
        ahead = X[:3, :3] @ camera_rotation(pan[row], tilt[row])[:, 2]
        to_target = TARGET - X[:3, 3] - MOUNT.reach * X[:3, 0]
        angle = math.atan2(np.linalg.norm(np.cross(ahead, to_target)), ahead @ to_target)
        assert angle < 1e-6


def test_speed_and_acceleration_are_bounded_and_the_rate_is_the_joints():
    _, joint, rate, _, _ = record(CameraPointer(ARM, target=TARGET), 4.0)
    # The state is what it was before the update at the logged time, the first one the initial.
    np.testing.assert_allclose(np.diff(joint), rate[1:] * PERIOD, atol=1e-12)
    assert np.abs(rate).max() <= MOUNT.joint_speed + 1e-12
    assert np.abs(np.diff(rate)).max() <= 2.0 * MOUNT.joint_speed * PERIOD + 1e-12
    # No overshoot: it comes from one side.
    wanted = aim(ARM, MOUNT, ARM.joint_home, TARGET).joint
    assert ((wanted - joint) * np.sign(wanted) >= -1e-12).all()


def test_pan_and_tilt_are_no_faster_than_the_unit():
    mount = make_mount(ARM, pan_tilt_speed=math.radians(5.0))
    pointer = CameraPointer(ARM, mount=mount)
    simulator = Simulator(pointer)
    context = simulator.get_mutable_context()
    pointer.GetInputPort("joint_state").FixValue(context, HOME)
    pointer.GetInputPort("target").FixValue(context, TARGET)
    simulator.Initialize()
    other = TIP[:3, 3] + TIP[:3, :3] @ [1.2, 0.5, -0.4]
    pointer.GetInputPort("target").FixValue(context, other)  # the target jumps
    before = pointer.GetOutputPort("pan_tilt").Eval(context).copy()
    moved = []
    for step in range(600):
        simulator.AdvanceTo((step + 0.5) * PERIOD)
        after = pointer.GetOutputPort("pan_tilt").Eval(context).copy()
        moved.append(np.abs(after - before).max())
        before = after
    assert max(moved) == pytest.approx(math.radians(5.0) * PERIOD, rel=1e-9)
    wanted = aim(ARM, mount, ARM.joint_home, other)
    np.testing.assert_allclose(before, [wanted.pan, wanted.tilt], atol=1e-5)


def test_the_target_is_one_in_the_world():
    X_W0 = RigidTransform(RollPitchYaw(0.1, -0.5, 2.0), [1.0, 2.0, 3.0])
    plain = record(CameraPointer(ARM, target=TARGET), 0.5)
    moved = record(CameraPointer(ARM, X_W0=X_W0), 0.5, target=X_W0 @ TARGET)
    np.testing.assert_allclose(moved, plain, atol=1e-12)


def test_without_a_target_the_message_says_what_to_do():
    with pytest.raises(InputError, match="CameraPointer has no target; connect its port"):
        record(CameraPointer(ARM), 0.1)


@pytest.mark.parametrize("target", [[0.0, 1.0], [0.0, np.nan, 1.0]])
def test_a_target_that_is_no_point_is_refused(target):
    with pytest.raises(InputError, match=r"camera target = .*; must be three finite numbers, m"):
        CameraPointer(ARM, target=target)
