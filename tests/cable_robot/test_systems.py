"""Winches, controllers, estimator and faults, each alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.geometry import SceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from scipy.spatial.transform import Rotation

from pips_drake.cable_robot.cable_forces import cable_pull
from pips_drake.cable_robot.kinematics import cable_lengths, make_poses
from pips_drake.cable_robot.platform_motion import PlatformMotion
from pips_drake.cable_robot.statics import distribute_tensions, structure_matrix
from pips_drake.cable_robot.systems.cable_break import CableBreak
from pips_drake.cable_robot.systems.cable_forces import CableForces
from pips_drake.cable_robot.systems.cable_visualizer import PIECES, CableVisualizer
from pips_drake.cable_robot.systems.length_controller import LengthController
from pips_drake.cable_robot.systems.platform_disturbance import PlatformDisturbance
from pips_drake.cable_robot.systems.pose_command import PoseCommand
from pips_drake.cable_robot.systems.pose_estimator import PoseEstimator, nearest_pose
from pips_drake.cable_robot.systems.pose_values import (
    advanced,
    pose_of,
    pose_vector,
    turn,
    turn_vector,
)
from pips_drake.cable_robot.systems.tension_controller import TensionController, box_inertia
from pips_drake.cable_robot.systems.winches import Winches
from pips_drake.errors import InputError

from .suspended import crossed_robot

ROBOT = crossed_robot()
POSE = make_poses([1.0, 3.8, -0.3], [0.05, -0.02, 0.03])
VECTOR = pose_vector(POSE.position[0], POSE.rotation[0])
LENGTHS = np.full(8, 12.0)
STEP, PERIOD = 1.0 / 400.0, 0.04


class Bench:
    """A system in a simulator, its inputs fixed; outputs by name."""

    def __init__(self, system, **inputs):
        builder = DiagramBuilder()
        self.system = builder.AddSystem(system)
        self.simulator = Simulator(builder.Build())
        root = self.simulator.get_mutable_context()
        self.context = self.system.GetMyMutableContextFromRoot(root)
        for name, value in inputs.items():
            self.fix(name, value)
        self.simulator.Initialize()

    def fix(self, name, value):
        self.system.GetInputPort(name).FixValue(self.context, value)

    def __getitem__(self, name):
        return np.array(self.system.GetOutputPort(name).Eval(self.context))

    def to(self, time):
        self.simulator.AdvanceTo(time)
        return self


def winches(command=LENGTHS, tensions=100.0, **settings):
    system = Winches(ROBOT, first_lengths=LENGTHS, **settings)
    return Bench(system, command=command, tensions=np.full(8, tensions))


@given(
    st.lists(st.floats(-1, 1), min_size=4, max_size=4),
    st.lists(st.floats(-1, 1), min_size=3, max_size=3),
)
def test_pose_values_are_scipys_rotations(quaternion, vector):
    if np.linalg.norm(quaternion) < 1e-3:
        return
    R = Rotation.from_quat(quaternion).as_matrix()
    found = pose_of(pose_vector(np.ones(3), R))
    np.testing.assert_allclose(found.rotation[0], R, atol=1e-14)
    np.testing.assert_array_equal(found.position[0], np.ones(3))
    R = Rotation.from_rotvec(vector).as_matrix()
    np.testing.assert_allclose(turn(np.array(vector)), R, atol=1e-14)
    np.testing.assert_allclose(turn_vector(R), vector, atol=1e-12)


def test_winch_reaches_a_length_one_period_and_one_step_later_at_a_constant_rate():
    bench = winches(LENGTHS + 0.01)
    bench.to(STEP + 0.5 * PERIOD + 1e-6)
    # After the command is read, half of a period's steps.
    assert bench["rate"] == pytest.approx(0.01 / PERIOD)
    assert bench["unstretched"] == pytest.approx(LENGTHS + 0.005)
    bench.to(STEP + PERIOD + 1e-6)
    np.testing.assert_allclose(bench["unstretched"], LENGTHS + 0.01, atol=1e-12)
    bench.to(1.0)
    np.testing.assert_allclose(bench["unstretched"], LENGTHS + 0.01, atol=1e-12)


def test_winch_is_no_faster_than_its_speed():
    bench = winches(LENGTHS + 1.0, speed=0.5).to(1.0)
    assert bench["unstretched"] == pytest.approx(LENGTHS + 0.5, abs=0.5 * 2.1 * STEP)
    assert bench["rate"] == pytest.approx(0.5)


def test_encoders_know_steps_and_not_the_calibration_error():
    error = np.linspace(-1e-3, 1e-3, 8)
    bench = winches(LENGTHS + 0.01234, encoder_step=1e-4, calibration_error=error).to(1.0)
    np.testing.assert_allclose(bench["encoder"], 12.0123, atol=1e-12)
    np.testing.assert_allclose(bench["unstretched"], 12.0123 + error, atol=1e-12)


def test_force_readings_are_whole_steps():
    np.testing.assert_array_equal(winches(tensions=123.4, force_step=1.0)["force_reading"], 123.0)
    np.testing.assert_array_equal(winches(tensions=123.4)["force_reading"], 123.4)


def test_overloaded_winch_reels_in_no_more_and_slips_if_it_does():
    limit = {"force_limit": 2000.0}
    held = winches(LENGTHS - 0.1, tensions=2500.0, **limit).to(0.5)
    np.testing.assert_allclose(held["unstretched"], LENGTHS, atol=1e-12)
    out = winches(LENGTHS + 0.1, tensions=2500.0, **limit).to(0.5)
    np.testing.assert_allclose(out["unstretched"], LENGTHS + 0.1, atol=1e-9)
    slips = winches(LENGTHS, tensions=2500.0, overload="slip", **limit).to(0.5 * STEP)
    # The excess of 500 N is gone at 12 m / 1e6 N each newton in 0.02 s.
    assert slips["rate"] == pytest.approx(500.0 * 12.0 / 1e6 / 0.02)
    below = winches(LENGTHS - 0.1, tensions=1999.0, **limit).to(0.5)
    assert np.all(below["unstretched"] < LENGTHS - 0.09)


def test_brake_stops_all_winches_by_length_and_by_tension():
    for control, command in (("length", LENGTHS + 1.0), ("tension", np.full(8, 500.0))):
        bench = winches(command, control=control)
        bench.to(0.2)
        assert np.all(np.abs(bench["rate"]) > 0.0)
        bench.fix("brake", [1.0])
        bench.to(0.3)
        stopped = bench["unstretched"]
        bench.to(1.0)
        np.testing.assert_array_equal(bench["unstretched"], stopped)
        assert not bench["rate"].any()


def test_tension_control_reels_towards_the_command():
    bench = winches(np.full(8, 150.0), tensions=100.0, control="tension", bandwidth=20.0).to(STEP)
    assert bench["rate"] == pytest.approx(-20.0 * 12.0 / 1e6 * 50.0)
    bench.fix("command_rate", np.linspace(-0.1, 0.1, 8))
    bench.to(2.0 * STEP)
    expected = np.linspace(-0.1, 0.1, 8) - 20.0 * bench["unstretched"] / 1e6 * 50.0
    np.testing.assert_allclose(bench["rate"], expected, rtol=1e-3)


def test_cables_system_is_the_function_and_adds_what_else_acts():
    l0 = cable_lengths(ROBOT, POSE)[0] - 0.005
    twist = np.array([0.1, 0.2, -0.3, 0.2, 0.1, 0.3])
    state = np.concatenate([VECTOR, twist[3:], twist[:3]])
    broken = np.eye(8)[2]
    system = CableForces(ROBOT, 1, damping_time=1e-3, weight=0.1, drag=(10.0, 2.0))
    bench = Bench(
        system, platform_state=state, unstretched=l0, rate=np.full(8, 0.01), broken=broken,
        disturbance=np.arange(6.0),
    )  # fmt: skip
    expected = cable_pull(
        ROBOT, POSE, l0, twist=twist, rates=np.full(8, 0.01), damping_time=1e-3, weight=0.1,
        broken=broken,
    )  # fmt: skip
    np.testing.assert_allclose(bench["tensions"], expected.tensions[0], rtol=1e-9)
    np.testing.assert_allclose(bench["lengths"], expected.lengths[0])
    assert bench["tensions"][2] == 0.0
    (force,) = system.GetOutputPort("spatial_force").Eval(bench.context)
    total = expected.wrench[0] + np.arange(6.0) - np.repeat([10.0, 2.0], 3) * twist
    # 1e5 N/m times what rounding does to lengths of 12 m.
    np.testing.assert_allclose(force.F_Bq_W.translational(), total[:3], atol=1e-6)
    np.testing.assert_allclose(force.F_Bq_W.rotational(), total[3:], atol=1e-6)
    np.testing.assert_array_equal(force.p_BoBq_B, 0.0)


def test_length_controller_reels_out_what_rests_at_the_pose():
    """The springs of its lengths bear the weight there."""
    bench = Bench(LengthController(ROBOT), desired_pose=VECTOR, desired_twist=np.zeros(6))
    pulled = cable_pull(ROBOT, POSE, bench["command"])
    left = pulled.wrench[0] + ROBOT.weight_wrench(POSE.rotation)[0]
    assert np.abs(left).max() < 1e-6 and bench["feasible"] == 1.0
    np.testing.assert_allclose(pulled.tensions[0], bench["wanted_tensions"], rtol=1e-7)


def test_length_controller_looks_a_period_ahead():
    twist = np.array([0.2, -0.1, 0.05, 0.1, 0.0, -0.1])
    moving = Bench(LengthController(ROBOT), desired_pose=VECTOR, desired_twist=twist)
    turned = Rotation.from_rotvec(0.04 * twist[3:]).as_matrix() @ POSE.rotation[0]
    later = pose_vector(POSE.position[0] + 0.04 * twist[:3], turned)
    there = Bench(LengthController(ROBOT), desired_pose=later, desired_twist=np.zeros(6))
    np.testing.assert_allclose(moving["command"], there["command"], atol=1e-10)
    assert np.abs(moving["command"] - np.array(cable_lengths(ROBOT, POSE)[0])).max() > 1e-3


def test_length_controller_says_when_nothing_holds():
    above = np.concatenate([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 7.0]])
    bench = Bench(LengthController(ROBOT), desired_pose=above, desired_twist=np.zeros(6))
    assert bench["feasible"] == 0.0 and np.all(bench["wanted_tensions"] >= 0.0)


def test_tension_controller_pulls_as_its_oscillator_says():
    away = make_poses([1.02, 3.79, -0.31], [0.06, -0.02, 0.03])
    velocity, spin = np.array([0.01, 0.02, 0.03]), np.array([0.02, -0.01, 0.01])
    state = np.concatenate([pose_vector(away.position[0], away.rotation[0]), spin, velocity])
    bench = Bench(
        TensionController(ROBOT, bandwidth=3.0, damping=0.7),
        desired_pose=VECTOR, desired_twist=np.zeros(6), platform_state=state,
    )  # fmt: skip
    wrench = structure_matrix(ROBOT, away)[0] @ bench["command"]
    total = wrench + ROBOT.weight_wrench(away.rotation)[0]
    error = POSE.position[0] - away.position[0]
    np.testing.assert_allclose(total[:3], 40.0 * (9.0 * error - 4.2 * velocity), atol=1e-6)
    turned = Rotation.from_matrix(POSE.rotation[0] @ away.rotation[0].T).as_rotvec()
    J = away.rotation[0] @ box_inertia(ROBOT) @ away.rotation[0].T
    np.testing.assert_allclose(total[3:], J @ (9.0 * turned - 4.2 * spin), atol=1e-6)
    assert bench["feasible"] == 1.0
    twist = np.array([0.1, 0.0, -0.05, 0.0, 0.02, 0.0])
    bench = Bench(
        TensionController(ROBOT, bandwidth=3.0),
        desired_pose=VECTOR, desired_twist=twist, platform_state=state,
    )  # fmt: skip
    twist += 1.5 * np.concatenate([error, turned])
    step = 1e-6
    lengths = [
        cable_lengths(ROBOT, advanced(away, share * step * twist, 1.0)) for share in (-0.5, 0.5)
    ]
    rates = (lengths[1] - lengths[0])[0] / step
    # Differences of 12 m over 1e-6.
    np.testing.assert_allclose(bench["command_rate"], rates, atol=1e-8)


def test_estimate_is_the_pose_where_nothing_is_off():
    held = distribute_tensions(ROBOT, POSE)
    l0 = cable_lengths(ROBOT, POSE)[0] * 1e6 / (1e6 + held.tensions[0])
    near = make_poses([1.05, 3.75, -0.25])
    estimator = PoseEstimator(ROBOT, near)
    bench = Bench(estimator, encoder=l0, force_reading=held.tensions[0])
    np.testing.assert_allclose(bench["estimated_state"][:7], VECTOR, atol=1e-9)
    assert bench["valid"] == 1.0 and not bench["estimated_state"][7:].any()
    for slack in ([0], [0, 1]):
        forces = held.tensions[0].copy()
        forces[slack] = 0.0
        reeled_in = l0 - 0.3 * (forces == 0.0)
        bench = Bench(PoseEstimator(ROBOT, near), encoder=reeled_in, force_reading=forces)
        np.testing.assert_allclose(bench["estimated_state"][:7], VECTOR, atol=1e-8)
    forces = np.repeat([0.0, 50.0], [3, 5])
    lost = Bench(PoseEstimator(ROBOT, near), encoder=l0, force_reading=forces)
    assert lost["valid"] == 0.0
    np.testing.assert_allclose(lost["estimated_state"][4:7], near.position[0])


def test_estimated_twist_is_that_of_moving_lengths():
    twist = np.array([0.1, -0.05, 0.02, 0.03, 0.02, -0.04])
    now = pose_of(VECTOR)
    moved = pose_vector(
        POSE.position[0] + 0.04 * twist[:3], turn(0.04 * twist[3:]) @ POSE.rotation[0]
    )
    forces = np.full(8, 100.0)
    first, second = (cable_lengths(ROBOT, pose)[0] / 1.0001 for pose in (now, pose_of(moved)))
    bench = Bench(PoseEstimator(ROBOT, POSE), encoder=first, force_reading=forces)
    bench.to(0.02)
    bench.fix("encoder", second)
    bench.to(0.04 + 1e-6)
    np.testing.assert_allclose(bench["estimated_state"][7:], np.r_[twist[3:], twist[:3]], atol=1e-6)


def test_nearest_pose_gives_up_where_lengths_say_nothing():
    taut = np.ones(8, dtype=bool)
    assert nearest_pose(ROBOT, np.full(8, 1e-3), taut, POSE) is None


def test_breaks_and_brake_come_when_they_should():
    bench = Bench(CableBreak(ROBOT, breaks=[(2, 0.1), (5, 0.3)], reaction=0.05))
    for time, broken, brake in ((0.09, [], 0), (0.12, [2], 0), (0.16, [2], 1), (0.31, [2, 5], 1)):
        bench.to(time)
        np.testing.assert_array_equal(np.flatnonzero(bench["broken"]), broken)
        assert bench["brake"] == brake
    with pytest.raises(InputError, match=r"broken cable = 9; must be 1 .. 8"):
        CableBreak(ROBOT, breaks=[(8, 0.0)])


def test_pieces_of_drawn_cables_lie_from_end_to_end():
    """The first begins at the platform, the last ends at the anchor, and none leaves a gap."""
    builder = DiagramBuilder()
    system = CableVisualizer(ROBOT, scene_graph=SceneGraph())
    visualizer = builder.AddSystem(system)
    simulator = Simulator(builder.Build())
    context = visualizer.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    state = np.concatenate([VECTOR, np.zeros(6)])
    visualizer.GetInputPort("platform_state").FixValue(context, state)
    visualizer.GetInputPort("broken").FixValue(context, np.eye(8)[4])
    simulator.Initialize()
    poses = visualizer.GetOutputPort("geometry_pose").Eval(context)
    ends = POSE.position[0] + ROBOT.attachments @ POSE.rotation[0].T
    tip = np.array([0.0, 0.0, system.piece])
    for cable in range(8):
        pieces = [poses.value(system.frame(cable, number)) for number in range(PIECES)]
        np.testing.assert_allclose(pieces[-1].multiply(tip), ROBOT.anchors[cable], atol=1e-9)
        if cable == 4:
            assert pieces[0].translation()[2] < ROBOT.anchors[cable, 2] - 1.0
            continue
        np.testing.assert_allclose(pieces[0].translation(), ends[cable], atol=1e-9)
        starts = np.array([piece.translation() for piece in pieces])
        assert np.linalg.norm(np.diff(starts, axis=0), axis=1).max() < system.piece


def test_disturbance_lasts_from_its_start_to_its_end():
    bench = Bench(PlatformDisturbance(wrench=np.arange(6.0), start=0.1, end=0.2))
    for time, share in ((0.05, 0.0), (0.15, 1.0), (0.25, 0.0)):
        np.testing.assert_array_equal(bench.to(time)["disturbance"], share * np.arange(6.0))
    with pytest.raises(InputError, match=r"disturbance: times = 2 \.\. 1 s"):
        PlatformDisturbance(start=2.0, end=1.0)


def test_pose_command_says_what_the_motion_does():
    motion = PlatformMotion(
        make_poses([[0, 0, 0], [1, 0, 0]], [[0, 0, 0], [0.2, 0, 0]]), [0.0, 0.5]
    )
    bench = Bench(PoseCommand(motion))
    bench.to(2.0)
    at = motion.at(2.0)
    np.testing.assert_allclose(bench["desired_pose"], pose_vector(at.position, at.rotation))
    np.testing.assert_allclose(bench["desired_twist"], at.twist)
    assert at.twist[0] > 0.0 and bench["tilt"] == at.tilt > 0.0
    np.testing.assert_array_equal(bench["way_point"], [0.0, 0.0])
    bench.to(motion.duration + 0.1)
    np.testing.assert_array_equal(bench["way_point"], [1.0, 1.0])
    assert bench["finished"] == 1.0


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"control": "force"}, "winches: control = force; must be length or tension"),
        ({"overload": "x"}, "winches: overload = x; must be hold or slip"),
        ({"speed": 0.0}, "winches: speed = 0; must be > 0"),
        ({"encoder_step": -1.0}, "winches: encoder_step = -1; must be >= 0"),
        ({"control_period": 0.041}, "must be a multiple of 0.0025 s"),
    ],
)
def test_bad_winches_are_refused(settings, message):
    with pytest.raises(InputError, match=message):
        Winches(ROBOT, first_lengths=LENGTHS, **settings)
