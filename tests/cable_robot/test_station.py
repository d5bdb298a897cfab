"""The whole station: statics, dynamics, faults, against what the mathematics says."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from pips_drake.cable_robot.cable_forces import cable_pull
from pips_drake.cable_robot.kinematics import Poses, cable_lengths, make_poses
from pips_drake.cable_robot.platform_motion import MotionLimits, PlatformMotion
from pips_drake.cable_robot.rest_posture import rest_posture
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.statics import distribute_tensions, general_solution
from pips_drake.cable_robot.station import (
    DisturbanceSettings,
    MakeCableRobotStation,
    StationSettings,
    add_plant,
    check_time_step,
    fastest_rates,
    least_distances,
)
from pips_drake.cable_robot.stiffness import full_stiffness
from pips_drake.cable_robot.systems.cable_forces import CableForces
from pips_drake.cable_robot.systems.length_controller import unstretched_lengths
from pips_drake.cable_robot.systems.pose_values import pose_of, pose_vector
from pips_drake.errors import InputError

from .robots import box_robot, planar_example
from .suspended import crossed_robot, quarter_pipe, suspended_robot

ROBOT = suspended_robot()
POSE = make_poses([1.0, 3.8, -0.3])
#: Drag that stills every swing within some seconds, N s/m and N m s.
STILL = (80.0, 15.0)


class Bench:
    """A station in a running simulator; outputs by name."""

    def __init__(self, motion=POSE, obstacles=(), robot=ROBOT, **settings):
        motion = motion if isinstance(motion, PlatformMotion) else PlatformMotion(motion)
        self.made = MakeCableRobotStation(
            robot, motion, StationSettings(**settings), obstacles=obstacles
        )
        self.simulator = Simulator(self.made.diagram)
        self.context = self.simulator.get_mutable_context()
        self.simulator.Initialize()

    def to(self, time):
        self.simulator.AdvanceTo(time)
        return self

    def __getitem__(self, port):
        return np.array(self.made.diagram.GetOutputPort(port).Eval(self.context))

    def log(self, port):
        return self.made.systems.logs[port].FindLog(self.context).data()


class Hung:
    """A platform on cables of fixed lengths in its plant, without winches or control."""

    def __init__(
        self, robot, pose, lengths, *, time_step, broken=None, velocity=(0, 0, 0), **cables
    ):
        builder = DiagramBuilder()
        self.machine = add_plant(builder, robot, time_step=time_step)
        plant = self.machine.plant
        forces = builder.AddSystem(CableForces(robot, int(self.machine.platform.index()), **cables))
        state = plant.get_state_output_port(self.machine.model)
        builder.Connect(state, forces.GetInputPort("platform_state"))
        constant = {"unstretched": lengths, "rate": np.zeros(robot.cables)}
        if broken is not None:
            constant["broken"] = broken
        for name, value in constant.items():
            source = builder.AddSystem(ConstantVectorSource(value))
            builder.Connect(source.get_output_port(), forces.GetInputPort(name))
        builder.Connect(
            forces.GetOutputPort("spatial_force"), plant.get_applied_spatial_force_input_port()
        )
        diagram = builder.Build()
        self.simulator = Simulator(diagram)
        self.context = plant.GetMyMutableContextFromRoot(self.simulator.get_mutable_context())
        self.robot, self.lengths, self.broken = robot, lengths, broken
        start = np.concatenate([pose_vector(pose.position[0], pose.rotation[0]), np.zeros(6)])
        start[10:] = (0.0, 0.0, 0.0) if velocity is None else velocity
        plant.SetPositionsAndVelocities(self.context, start)

    def state(self):
        return np.array(self.machine.plant.GetPositionsAndVelocities(self.context))

    def energy(self):
        """Kinetic, potential and elastic, J."""
        plant, robot = self.machine.plant, self.robot
        T = cable_pull(robot, pose_of(self.state()), self.lengths, broken=self.broken).tensions[0]
        elastic = 0.5 * np.sum(T**2 * self.lengths / robot.axial_stiffness)
        kinetic = plant.CalcKineticEnergy(self.context)
        return kinetic + plant.CalcPotentialEnergy(self.context) + elastic


@pytest.mark.parametrize("method", ["least_norm", "analytic_center"])
def test_static_tensions_are_those_of_the_statics(method):
    """With the pose away from the desired one by nothing: 1e-3 of the largest and better."""
    bench = Bench(method=method, drag=STILL).to(6.0)
    expected = distribute_tensions(ROBOT, POSE, method).tensions[0]
    np.testing.assert_allclose(bench["cable_forces.tensions"], expected, rtol=1e-6)
    np.testing.assert_allclose(bench["plant.platform_state"][4:7], POSE.position[0], atol=1e-9)


@pytest.mark.slow
def test_tensions_after_a_motion_are_those_of_the_statics_where_it_ends():
    ends = make_poses([[1.0, 3.8, -0.3], [1.4, 4.0, -0.2]])
    motion = PlatformMotion(ends, limits=MotionLimits(dwell=0.1))
    bench = Bench(motion, method="least_norm", drag=STILL).to(motion.duration + 8.0)
    expected = distribute_tensions(ROBOT, ends, "least_norm").tensions[1]
    np.testing.assert_allclose(bench["cable_forces.tensions"], expected, rtol=1e-3)
    np.testing.assert_allclose(bench["plant.platform_state"][4:7], ends.position[1], atol=1e-5)
    np.testing.assert_allclose(
        bench["pose_estimator.estimated_state"][:7], bench["plant.platform_state"][:7], atol=1e-6
    )


def test_platform_follows_the_motion():
    """The springs lag by a step, and swing by what the corners of the speed excite."""
    ends = make_poses([[1.0, 3.8, -0.3], [1.4, 4.0, -0.2]])
    motion = PlatformMotion(ends)
    bench = Bench(motion, log_period=0.02, cable_picture_period=0.04).to(motion.duration)
    wanted, was = bench.log("pose_command.desired_pose"), bench.log("plant.platform_state")
    assert np.abs(was[4:7] - wanted[4:7]).max() < 5e-3
    assert bench.log("cable_forces.tensions").min() > 0.0
    assert bench.log("controller.feasible").min() == 1.0


@pytest.mark.slow
def test_control_by_tension_brings_the_platform_there():
    ends, robot = make_poses([[1.0, 3.8, -0.3], [1.2, 3.9, -0.2]]), crossed_robot()
    for feedback in ("true", "estimated"):
        motion = PlatformMotion(ends, limits=MotionLimits(dwell=0.1))
        settings = {"control": "tension", "feedback": feedback}
        bench = Bench(motion, robot=robot, **settings).to(motion.duration + 6.0)
        # The springs' tensions are those commanded once nothing moves: no error stays.
        error = bench["plant.platform_state"][4:7] - ends.position[1]
        assert np.abs(error).max() < 1e-3
        expected = distribute_tensions(robot, ends).tensions[1]
        np.testing.assert_allclose(bench["cable_forces.tensions"], expected, atol=5.0)


def test_calibration_errors_move_the_platform_and_the_estimate_does_not_know():
    """To first order, K dx = L^T k dl: the full stiffness says by how much."""
    error = 1e-4 * np.array([1, -1, 0.5, -0.5, 0.3, 0.8, -0.6, 0.2])
    bench = Bench(calibration_error=error, drag=STILL).to(6.0)
    moved = bench["plant.platform_state"][4:7] - POSE.position[0]
    T = distribute_tensions(ROBOT, POSE).tensions
    l0 = unstretched_lengths(ROBOT, POSE, T)
    wrench = cable_pull(ROBOT, POSE, l0 + error).wrench - cable_pull(ROBOT, POSE, l0).wrench
    expected = np.linalg.solve(full_stiffness(ROBOT, POSE, T)[0], wrench[0])
    # Second order: tensions change by some percent, and cables turn.
    np.testing.assert_allclose(moved, expected[:3], atol=0.1 * np.abs(expected[:3]).max())
    assert np.linalg.norm(moved) > 3e-5
    # The estimate is made of lengths that are off by up to 0.1 mm.
    missed = bench["pose_estimator.estimated_state"][4:7] - bench["plant.platform_state"][4:7]
    assert 1e-6 < np.linalg.norm(missed) < 5e-4


def test_pendulum_swings_with_its_frequency():
    """On one cable through its centre of mass it does not turn: sqrt(g / l)."""
    length, mass = 3.0, 40.0
    anchors = np.vstack([[0.0, 0.0, 5.0], [[9.0, 9.0, k] for k in range(5)]])
    robot = CableRobot(
        name="pendulum", anchors=anchors, attachments=np.zeros((6, 3)), mass=mass,
        axial_stiffness=[1e5],
    )  # fmt: skip
    broken = np.array([0, 1, 1, 1, 1, 1.0])
    hung_length = length * (1.0 + mass * 9.81 / 1e5)
    amplitude = 0.02
    pose = make_poses(
        [hung_length * math.sin(amplitude), 0.0, 5.0 - hung_length * math.cos(amplitude)]
    )
    hung = Hung(robot, pose, np.full(6, length), time_step=1 / 400, broken=broken)
    times, x = np.arange(0.0, 14.0, 0.05), []
    for t in times:
        hung.simulator.AdvanceTo(t)
        x.append(hung.state()[4])
    x = np.array(x)
    k = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
    crossings = times[k] - x[k] * 0.05 / (x[k + 1] - x[k])
    period = np.diff(crossings).mean()
    # Amplitude 0.02 rad lengthens it by 2.5e-5; straight lines between samples are as good.
    assert period == pytest.approx(2.0 * math.pi * math.sqrt(hung_length / 9.81), rel=1e-3)
    assert len(crossings) >= 3


def test_small_swing_has_the_frequency_of_the_stiffness():
    """The softest eigenfrequency of K and M, and what a semi-implicit step makes of it."""
    T = distribute_tensions(ROBOT, POSE).tensions
    l0 = unstretched_lengths(ROBOT, POSE, T)[0]
    fastest = fastest_rates(ROBOT, POSE, T)[0]
    # Up and down is stiffest for its mass: most of the motion's crossings are of that.
    K = full_stiffness(ROBOT, POSE, T)[0]
    M = np.diag([40.0] * 3 + [40.0 / 12 * (0.16 + 0.16), 40.0 / 12 * 0.52, 40.0 / 12 * 0.52])
    rates = np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).real)
    assert fastest == pytest.approx(rates.max(), rel=1e-9)
    hung = Hung(ROBOT, POSE, l0, time_step=1 / 2000, velocity=(1e-3, 0.0, 0.0))
    x = []
    for t in np.arange(0.0, 4.0, 0.002):
        hung.simulator.AdvanceTo(t)
        x.append(hung.state()[4])
    spectrum = np.abs(np.fft.rfft((np.array(x) - np.mean(x)) * np.hanning(len(x)), 1 << 16))
    peak = 2.0 * math.pi * np.argmax(spectrum) / ((1 << 16) * 0.002)
    # 4 s resolve 0.25 Hz, their peak a tenth of it.
    assert np.abs(rates - peak).min() < 0.2


@pytest.mark.parametrize("damping_time", [0.0, 1e-3])
def test_energy_does_not_grow(damping_time):
    """Let go 5 cm off with a push, cables going slack and taut again; damping only takes."""
    T = distribute_tensions(ROBOT, POSE).tensions
    l0 = unstretched_lengths(ROBOT, POSE, T)[0]
    away = Poses(POSE.position + np.array([0.0, 0.03, 0.05]), POSE.rotation)
    hung = Hung(
        ROBOT, away, l0, time_step=1 / 2000, velocity=(0, 0, 0.3), damping_time=damping_time
    )
    start, energies, slack = hung.energy(), [], 0
    for t in np.arange(0.05, 3.0, 0.05):
        hung.simulator.AdvanceTo(t)
        energies.append(hung.energy())
        pulled = cable_pull(ROBOT, pose_of(hung.state()), l0)
        slack += int(np.any(pulled.tensions == 0.0))
    stored = start - energy_at_rest(ROBOT, l0)
    # A semi-implicit step keeps the energy to a share of omega times the step of what is stored.
    assert max(energies) - start < 0.05 * stored
    if damping_time:
        assert energies[-1] - start < -0.3 * stored
    assert slack > 3, "no cable went slack"


def energy_at_rest(robot, l0):
    return float(rest_posture(robot, POSE, l0).energy[0])


def test_step_is_refused_where_springs_would_blow_up():
    rate = fastest_rates(ROBOT, POSE, distribute_tensions(ROBOT, POSE).tensions)[0]
    check_time_step(ROBOT, POSE, 0.99 / rate)
    with pytest.raises(
        InputError, match=r"time_step = 0\.01 s; must be < 0\.0\d+ s for the cables' stiffness"
    ):
        Bench(time_step=0.01, control_period=0.04)
    with pytest.raises(InputError, match="for the cables' damping: pose 1 moves with"):
        Bench(damping_time=0.1)
    # It is no empty threat: at 2 and above a push grows without end, below it does not.
    l0 = unstretched_lengths(ROBOT, POSE, distribute_tensions(ROBOT, POSE).tensions)[0]
    sizes = []
    for share in (0.99, 2.1):
        hung = Hung(ROBOT, POSE, l0, time_step=share / rate, velocity=(1e-4, 1e-4, 1e-4))
        hung.simulator.AdvanceTo(1.0)
        sizes.append(np.abs(hung.state()[4:7] - POSE.position[0]).max())
    assert sizes[0] < 1e-4 and sizes[1] > 1e-2


def test_weighty_cables_move_the_platform_and_are_balanced_too():
    """The controller knows of no sag: 0.1 N/m takes millimetres of 11 m, and all is at rest."""
    bench = Bench(cable_weight=0.1, drag=STILL).to(6.0)
    assert bench["cable_forces.wrench"][2] == pytest.approx(40.0 * 9.81, abs=0.01)
    moved = bench["plant.platform_state"][4:7] - POSE.position[0]
    assert 1e-5 < np.linalg.norm(moved) < 5e-3


def test_disturbance_moves_the_platform_by_its_wrench_over_the_stiffness():
    force = np.array([5.0, -3.0, 4.0, 0.0, 0.0, 0.0])
    pushed = DisturbanceSettings(wrench=force, start=1.0)
    bench = Bench(disturbance=pushed, drag=STILL).to(8.0)
    moved = bench["plant.platform_state"][4:7] - POSE.position[0]
    K = full_stiffness(ROBOT, POSE, distribute_tensions(ROBOT, POSE).tensions)[0]
    expected = np.linalg.solve(K, force)[:3]
    np.testing.assert_allclose(moved, expected, atol=0.02 * np.abs(expected).max())


@pytest.mark.slow
@pytest.mark.parametrize("cable", [2, 3])
def test_platform_comes_to_rest_after_a_break_where_the_least_energy_is(cable):
    """The upper cable over the pipe, and a lower one, whose end nothing touches."""
    bench = Bench(
        obstacles=quarter_pipe(), breaks=[(cable, 0.5)], drag=(160.0, 30.0), log_period=0.02
    ).to(25.0)
    l0 = bench["winches.unstretched"]
    broken = np.eye(8)[cable]
    rest = rest_posture(ROBOT, POSE, l0, broken=broken)
    assert rest.held[0]
    state = bench["plant.platform_state"]
    np.testing.assert_allclose(state[4:7], rest.poses.position[0], atol=1e-4)
    turned = pose_of(state).rotation[0].T @ rest.poses.rotation[0]
    assert np.arccos(min(1.0, 0.5 * (np.trace(turned) - 1.0))) < 1e-3
    tensions = bench["cable_forces.tensions"]
    assert tensions[cable] == 0.0
    np.testing.assert_array_equal(tensions <= 0.0, rest.slack[0])
    np.testing.assert_allclose(tensions, rest.tensions[0], atol=5.0)
    clearance = bench.log("clearance_monitor.clearance")[0]
    assert clearance[-1] == pytest.approx(least_distances(bench.made, rest.poses)[0], abs=1e-3)
    # The swing goes beyond the rest; with this much drag not far.
    assert clearance.min() <= clearance[-1] + 1e-4


@pytest.mark.slow
def test_one_break_is_held_clear_of_the_panel_and_another_is_not():
    """Crossed cables. The third lets the platform sag; the sixth drops it into the pipe."""
    robot = crossed_robot()
    for place, cable, holds in (([4.0, 3.4, -0.5], 2, True), ([6.0, 3.3, -0.6], 5, False)):
        pose = make_poses(place)
        bench = Bench(
            pose, robot=robot, obstacles=quarter_pipe(), breaks=[(cable, 0.5)], log_period=0.01
        ).to(10.0)
        l0 = bench["winches.unstretched"]
        rest = rest_posture(robot, pose, l0, broken=np.eye(8)[cable])
        at_rest = least_distances(bench.made, rest.poses)[0]
        least = bench.log("clearance_monitor.clearance")[0].min()
        largest = bench.log("cable_forces.tensions").max()
        if holds:
            assert rest.held[0] and at_rest > 0.3 and least > 0.3
            assert largest < robot.tension_max
        else:
            assert at_rest < 0.0, "it would rest inside the panel"
            assert least < 0.01, "it does not hit the panel"


def test_distance_is_that_of_the_box_and_the_camera_head():
    """Above the pipe's deepest place the head is nearest; above the hinge's edge the box's side."""
    bench = Bench(obstacles=quarter_pipe(16))
    radius = 2.286
    middle = make_poses([0.0, 2.0 * radius - 0.15, -0.5])
    down = math.sqrt(radius**2 - 0.15**2) - 0.5 - 0.28 - 0.08
    # The staves' middles touch the arc, their edges stand back by 3 mm; the ball looks askew.
    assert least_distances(bench.made, middle)[0] == pytest.approx(down, abs=0.02)
    inside = make_poses([0.0, 4.4, -1.95])
    assert least_distances(bench.made, inside)[0] < 0.0
    assert least_distances(bench.made, make_poses([0, 0, 100.0]))[0] == 5.0
    whole = [replace(box, body="pipe") for box in quarter_pipe(16)]
    one = Bench(obstacles=whole)
    np.testing.assert_array_equal(
        least_distances(one.made, middle), least_distances(bench.made, middle)
    )
    assert one.made.systems.machine.plant.HasBodyNamed("pipe")


def test_platform_on_the_panel_is_stopped_by_it():
    """All upper cables let go at once: it falls into the pipe and lies there."""
    breaks = [(cable, 0.2) for cable in range(8)]
    bench = Bench(obstacles=quarter_pipe(), breaks=breaks).to(3.0)
    assert -0.02 < bench["clearance_monitor.clearance"][0] < 0.02
    assert bench["plant.platform_state"][6] < -1.0
    assert not bench["cable_forces.tensions"].any()


def test_bad_settings_are_refused():
    for settings, message in (
        ({"control": "x"}, "station: control = x; must be length or tension"),
        ({"feedback": "x"}, "station: feedback = x; must be true or estimated"),
        ({"control_period": 0.0}, "winches: control_period = 0 s"),
        ({"time_step": -1.0}, r"time_step = -1 s; must be in \(0, 0.1\] s"),
    ):
        with pytest.raises(InputError, match=message):
            Bench(**settings)
    with pytest.raises(InputError, match="a planar robot"):
        Bench(make_poses([0, 0, 0]), robot=planar_example())
    twice = quarter_pipe(2)
    with pytest.raises(InputError, match=r"stave_1 \(twice\)"):
        Bench(obstacles=[twice[0], twice[0]])


def test_a_platform_without_a_box_has_no_clearance():
    robot = replace(box_robot(crossed=True), tension_min=10.0, tension_max=2000.0)
    bench = Bench(make_poses([0.0, 0.0, 0.0]), robot=robot)
    assert bench.made.systems.clearance_monitor is None
    with pytest.raises(InputError, match="no collision geometry"):
        least_distances(bench.made, POSE)
    assert np.all(general_solution(robot, POSE).rank == 6)
    assert np.all(cable_lengths(robot, POSE) > 0.0)
