"""Online, the solver of the offline plan gives the same postures, and their true rates."""

from __future__ import annotations

import re

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from pips_drake.errors import NotFollowableError
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.follow_the_leader import REPORT_TOLERANCE, FollowTheLeader
from pips_drake.serpentine.motion_profile import RestToRestProfile
from pips_drake.serpentine.path_file import load_path
from pips_drake.serpentine.systems.follow_the_leader_controller import FollowTheLeaderController
from pips_drake.serpentine.systems.tip_path_source import TipPathSource
from pips_drake.serpentine.tip_path import polyline_path

PERIOD = 1.0 / 64.0
INCH = 0.0254


@pytest.fixture(scope="module")
def path():
    return load_path("trajectory_4_arcs")


def online(controller, path):
    """A function of arc length and rate that gives the outputs, in one context."""
    context = controller.CreateDefaultContext()
    controller.GetInputPort("path").FixValue(context, path_value(path))

    def outputs(s, rate=0.0):
        controller.GetInputPort("tip").FixValue(context, [s, rate])
        joints = controller.GetOutputPort("joint_state").Eval(context)
        return joints.copy(), controller.GetOutputPort("solution").Eval(context).copy()

    return outputs


def path_value(path):
    value = AbstractValue.Make(object())
    value.set_value(path)
    return value


def test_ports(arm, port_sizes):
    inputs, outputs = port_sizes(FollowTheLeaderController(FollowTheLeader(arm)))
    assert inputs == {"tip": 2, "path": 0}
    assert outputs == {"joint_state": 36, "solution": 2}


@pytest.mark.parametrize("tolerance", [1e-9 * INCH, REPORT_TOLERANCE])
def test_outputs_have_feedthrough_from_tip_and_path(arm, tolerance):
    controller = FollowTheLeaderController(FollowTheLeader(arm, tolerance=tolerance))
    for source in range(2):
        for output in range(2):
            assert controller.HasDirectFeedthrough(source, output)


def test_converged_mode_has_no_state(arm):
    context = FollowTheLeaderController(FollowTheLeader(arm)).CreateDefaultContext()
    assert context.num_total_states() == 0


@pytest.mark.parametrize("variant", [{}, {"mirrored": True}])
@pytest.mark.parametrize("name", ["trajectory_1", "trajectory_4", "trajectory_4_arcs"])
def test_online_is_the_offline_plan_bit_for_bit(arm_variant, name, variant):
    arm = arm_variant(**variant)
    path = load_path(name)
    path = path.mirrored() if arm.mirrored else path
    solver = FollowTheLeader(arm)
    # Backwards and in no order, so that nothing carried over could help.
    s = np.random.default_rng(9).permutation(path.samples(2.0 * INCH))
    offline = solver.solve(path, s)
    outputs = online(FollowTheLeaderController(solver), path)
    for i, arc_length in enumerate(s):
        joints, (error, iterations) = outputs(arc_length)
        np.testing.assert_array_equal(joints[:18], offline.joints[i])
        assert (error, iterations) == (offline.spine_error[i], offline.iterations[i])


def test_every_spine_point_lies_on_the_path(arm, path):
    outputs = online(FollowTheLeaderController(FollowTheLeader(arm)), path)
    for s in path.samples(5.0 * INCH):
        spine = kinematics.spine_points(arm, outputs(s)[0][:18])[0]
        distance, _ = path.nearest(spine, 0.0, path.length)
        # The solver stops at a spine error of 1e-9 in.
        assert distance.max() < 1e-9 * INCH + 1e-14
        np.testing.assert_allclose(spine[-1], path.point(s), rtol=0, atol=1e-9 * INCH)


def test_rates_are_differences_of_the_joints(arm, path):
    outputs = online(FollowTheLeaderController(FollowTheLeader(arm)), path)
    speed, step = 0.025, 1e-4
    for s in path.samples(5.0 * INCH)[1:-1]:
        ahead, behind = outputs(s + 2.0 * step * speed)[0], outputs(s - 2.0 * step * speed)[0]
        near = outputs(s + step * speed)[0] - outputs(s - step * speed)[0]
        # Fourth order: 8/6 of the near difference less 1/12 of the far one.
        expected = (8.0 * near - (ahead - behind))[:18] / (12.0 * step)
        rates = outputs(s, speed)[0][18:]
        # Where a spine point passes from line to arc the second derivative jumps, and so may the
        # difference by its size (a few rad/m^2) times half the step times speed^2: 1e-7 rad/s.
        # Elsewhere what is left is the solver's own tolerance over the step, 2.5e-11 m: 3e-7.
        np.testing.assert_allclose(rates, expected, rtol=0, atol=1e-6)


def test_rates_are_proportional_to_the_tips_and_zero_at_rest(arm, path):
    outputs = online(FollowTheLeaderController(FollowTheLeader(arm)), path)
    s = path.home_arc_length + 0.6 * path.travel
    np.testing.assert_array_equal(outputs(s, 0.0)[0][18:], 0.0)
    forward, back = outputs(s, 0.02)[0][18:], outputs(s, -0.02)[0][18:]
    assert np.abs(forward).max() > 1e-3
    np.testing.assert_array_equal(back, -forward)


def test_a_changed_path_is_seen_at_once(arm, path):
    controller = FollowTheLeaderController(FollowTheLeader(arm))
    context = controller.CreateDefaultContext()
    controller.GetInputPort("tip").FixValue(context, [path.home_arc_length + 0.5, 0.0])
    joints = []
    for name in ("trajectory_4_arcs", "trajectory_1", "trajectory_4_arcs"):
        controller.GetInputPort("path").FixValue(context, path_value(load_path(name)))
        joints.append(controller.GetOutputPort("joint_state").Eval(context).copy())
    assert np.abs(joints[1] - joints[0]).max() > 0.01
    np.testing.assert_array_equal(joints[2], joints[0])


def test_reports_mode_carries_the_module_lengths_as_state(arm, path):
    solver = FollowTheLeader(arm, tolerance=REPORT_TOLERANCE)
    controller = FollowTheLeaderController(solver, period=PERIOD)
    context = controller.CreateDefaultContext()
    start = context.get_discrete_state_vector().CopyToVector() / INCH
    # FACTS: Q_AVG of Table A.2 to six decimals.
    average = [21.205889, 21.205889, 17.507598, 17.213567, 17.213567, 13.410085, 12.761790]
    np.testing.assert_allclose(start, average, rtol=0, atol=5e-7)


def test_reports_mode_is_the_offline_sweep_bit_for_bit(arm, path):
    solver = FollowTheLeader(arm, tolerance=REPORT_TOLERANCE)
    builder = DiagramBuilder()
    profile = RestToRestProfile.make(travel=path.travel, speed=0.5, ramp=0.5)
    source = builder.AddSystem(TipPathSource(path, profile, retract=False, period=PERIOD))
    controller = builder.AddSystem(FollowTheLeaderController(solver, period=PERIOD))
    for port in ("tip", "path"):
        builder.Connect(source.GetOutputPort(port), controller.GetInputPort(port))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = simulator.get_context()
    tips, joints, solutions = [], [], []

    def sample():
        tip = source.GetOutputPort("tip").Eval(source.GetMyContextFromRoot(context))
        mine = controller.GetMyContextFromRoot(context)
        tips.append(tip[0])
        joints.append(controller.GetOutputPort("joint_state").Eval(mine)[:18].copy())
        solutions.append(controller.GetOutputPort("solution").Eval(mine).copy())

    sample()  # home, before the update at time 0
    for k in range(150):
        simulator.AdvanceTo((k + 0.5) * PERIOD)
        sample()
    offline = solver.solve(path, tips)
    np.testing.assert_array_equal(joints, offline.joints)
    np.testing.assert_array_equal(solutions, np.c_[offline.spine_error, offline.iterations])
    # The report's Figure D.4: two iterations at first, one after, error below 0.1 in.
    assert offline.iterations.tolist() == [2] + [1] * 150
    assert np.max(solutions, axis=0)[0] < REPORT_TOLERANCE
    # It is another answer than the converged one, by up to the tolerance.
    converged = FollowTheLeader(arm).solve(path, tips).joints
    assert np.abs(converged - joints).max() > 1e-6


def test_a_tip_off_the_path_is_refused_with_the_place(arm):
    # The path's start is too near for the arm: Table C.4 with its base end moved up by 100 in.
    short = polyline_path(
        INCH * np.array([[16.255, 0.0, 100.0], [16.255, 0.0, 174.902], [16.255, 0.0, 200.0]]),
        "short",
    )
    outputs = online(FollowTheLeaderController(FollowTheLeader(arm)), short)
    s = short.home_arc_length + 0.1
    with pytest.raises(NotFollowableError) as caught:
        outputs(s)
    place = re.escape(f"tip at {s:.4f} m of path 'short'")
    assert re.match(place + r".*module \d needs [\d.]+ in", str(caught.value))
    assert caught.value.tip_arc_length == s


def test_too_few_iterations_are_refused_with_the_error_that_is_left(arm, path):
    solver = FollowTheLeader(arm, max_iterations=2)
    outputs = online(FollowTheLeaderController(solver), path)
    with pytest.raises(NotFollowableError, match=r"spine error .* in after 2 iterations"):
        outputs(path.length)
