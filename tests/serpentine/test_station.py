"""The whole pipe: plan, actuators, plant and monitor as one diagram, at rest and on the move."""

from __future__ import annotations

import re

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from pips_drake.errors import InputError
from pips_drake.scenarios import load_scenario
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.plan import make_plan
from pips_drake.serpentine.scenario import ClockConfig, SerpentineScenario
from pips_drake.serpentine.station import (
    BASE_FRAME,
    MakeSerpentineStation,
    gravity_in_frame_0,
    load_setup,
    mounting_pose,
)
from pips_drake.serpentine.station.supervision import supervision_latency, supervision_period
from pips_drake.serpentine.supervision import Cause, Mode
from pips_drake.serpentine.systems.tip_path_source import DONE, HOLD, RUN

INCH = 0.0254
G = 9.81
PLANT_STEP = 1.0 / 512.0


class Bench:
    """A station with its simulator, and its outputs by name."""

    def __init__(self, scenario, *, command=None, start=None):
        self.scenario, self.setup = scenario, load_setup(scenario)
        self.station = MakeSerpentineStation(scenario, setup=self.setup)
        self.simulator = Simulator(self.station)
        self.context = self.simulator.get_mutable_context()
        self.plant = self.station.GetSubsystemByName("plant")
        if command is not None:
            self.command(command)
        if start is not None:
            model = self.plant.GetModelInstanceByName("prototype")
            mine = self.plant.GetMyMutableContextFromRoot(self.context)
            self.plant.SetPositions(mine, model, start)
        self.simulator.Initialize()

    def command(self, word):
        self.station.GetInputPort("tip_path_source.command").FixValue(self.context, [word])

    def __getitem__(self, port):
        return np.array(self.station.GetOutputPort(port).Eval(self.context))

    @property
    def joints(self):
        return self["plant.state"][:18]

    def advance(self, duration):
        """Goes on for whole plant steps, and half of one, so that all updates have happened."""
        steps = round((self.context.get_time() + duration) / PLANT_STEP - 0.5)
        self.simulator.AdvanceTo((steps + 0.5) * PLANT_STEP)

    def holding_efforts(self, q):
        """What Drake's gravity takes to hold the arm at q, (18,), N and Nm."""
        mine = self.plant.CreateDefaultContext()
        self.plant.SetPositions(mine, self.plant.GetModelInstanceByName("prototype"), q)
        return -self.plant.CalcGravityGeneralizedForces(mine)[: len(q)]

    @property
    def stiffness(self):
        """Gains in the plant, (18,), N/m and Nm/rad."""
        actuators = [self.plant.get_joint_actuator(i) for i in self.plant.GetJointActuatorIndices()]
        return np.array([actuator.get_controller_gains().p for actuator in actuators])


def scenario(**changes):
    """Trajectory 4's arcs, no scene; dotted names with __ for the dots."""
    made = SerpentineScenario(path="trajectory_4_arcs")
    for name, value in changes.items():
        *parents, leaf = name.split("__")
        target = made
        for parent in parents:
            target = getattr(target, parent)
        assert hasattr(target, leaf)
        setattr(target, leaf, value)
    return made


def spine_distance(arm, q, wanted):
    """Farthest spine point from where it is wanted, m."""
    points = kinematics.spine_points(arm, np.array([q, wanted]))
    return np.linalg.norm(points[0] - points[1], axis=1).max()


def documented_ports():
    """Names of the station's ports, from its docstring."""
    text = MakeSerpentineStation.__doc__
    inputs, outputs = text.split("Input port:")[1].split("Output ports")
    found = [re.findall(r"`(\w+\.\w+)`", part.split("Latencies")[0]) for part in (inputs, outputs)]
    return set(found[0]), set(found[1])


@pytest.fixture(scope="module")
def shipped():
    return Bench(load_scenario("trajectory_4").config)


def test_every_documented_port_is_exported_and_no_other(shipped):
    station = shipped.station
    inputs = {station.get_input_port(i).get_name() for i in range(station.num_input_ports())}
    outputs = {station.get_output_port(i).get_name() for i in range(station.num_output_ports())}
    assert (inputs, outputs) == documented_ports()


@pytest.mark.parametrize("camera", [True, False])
@pytest.mark.parametrize("compensate", [True, False])
def test_every_documented_system_is_there_by_name_and_no_other(compensate, camera):
    # Both ways of the supervisor in the same four stations.
    supervised = compensate == camera
    station = MakeSerpentineStation(
        scenario(
            actuation__compensate_deflection=compensate,
            camera__enabled=camera,
            supervisor__enabled=supervised,
        )
    )
    text = MakeSerpentineStation.__doc__.split("Systems, by name:")[1].split("Input port")[0]
    names = set(re.findall(r"`(\w+)`", text))
    if not compensate:
        names.remove("deflection_compensator")
    if not camera:
        names -= {"camera_pointer", "camera_station"}
    if not supervised:
        names.remove("motion_supervisor")
    assert {system.get_name() for system in station.GetSystems()} == names
    assert station.get_name() == "serpentine_station"


def test_port_sizes_are_those_documented(shipped):
    sizes = {
        "tip_path_source.tip": 2,
        "follow_the_leader.joint_state": 36,
        "actuator_length_map.drive_state": 36,
        "actuator_servo.setpoint": 36,
        "actuator_force_map.drive_effort": 18,
        "clearance_monitor.clearance": 3,
        "clearance_monitor.witness": 7,
        "motion_supervisor.command": 1,
        "motion_supervisor.measured": 12,
        "plant.state": 36,
        "plant.net_actuation": 18,
    }
    for name, size in sizes.items():
        assert shipped.station.GetOutputPort(name).size() == size, name


def test_the_shipped_scenario_runs_for_a_sixteenth_of_a_second(shipped):
    shipped.advance(1.0 / 16.0)
    assert np.all(np.isfinite(shipped["plant.state"]))
    clearance, rate, own = shipped["clearance_monitor.clearance"]
    assert 0.0 < clearance <= shipped.scenario.clearance_range_m
    assert own > 0.01 and not np.isnan(clearance)
    assert np.isnan(rate) == (clearance == shipped.scenario.clearance_range_m)


def test_it_starts_where_the_plan_starts(shipped):
    bench = Bench(scenario())
    plan = make_plan(bench.setup.arm, bench.setup.path)
    np.testing.assert_array_equal(bench["follow_the_leader.joint_state"][:18], plan.joints[0])
    np.testing.assert_array_equal(bench["follow_the_leader.joint_state"][18:], 0.0)
    # The arm begins where it will stand: off the plan by the sag of the sag.
    assert spine_distance(bench.setup.arm, bench.joints, plan.joints[0]) < 0.2e-3
    np.testing.assert_array_equal(bench["plant.state"][18:], 0.0)


@pytest.mark.parametrize("mounting", ["laboratory", "pad", "pad_below"])
def test_the_arm_stands_in_the_world_as_mounted(mounting):
    made = scenario(mounting=mounting, mounting_position_m=[1.0, 2.0, 3.0])
    bench = Bench(made, command=HOLD)
    arm, plant = bench.setup.arm, bench.plant
    X_W0 = mounting_pose(made)
    mine = plant.GetMyContextFromRoot(bench.context)
    frames = kinematics.frames(arm, bench.joints)[0]
    for body, frame in zip(arm.bodies, frames, strict=True):
        X_WB = plant.EvalBodyPoseInWorld(mine, plant.GetBodyByName(body.name))
        expected = X_W0.GetAsMatrix4() @ frame
        np.testing.assert_allclose(X_WB.GetAsMatrix4(), expected, rtol=0, atol=1e-13)
    # Gravity stays along the world's -z.
    down = X_W0.rotation() @ gravity_in_frame_0(plant)
    np.testing.assert_allclose(down, [0.0, 0.0, -G], rtol=0, atol=1e-14)
    assert plant.GetFrameByName(BASE_FRAME).GetFixedPoseInBodyFrame().IsExactlyEqualTo(X_W0)


def test_without_compensation_the_arm_sags_by_statics_over_stiffness():
    bench = Bench(
        scenario(actuation__compensate_deflection=False),
        command=HOLD,
        # From the unsagged posture, so that it is the plant that finds the sag.
        start=load_home(),
    )
    home = bench["follow_the_leader.joint_state"][:18]
    np.testing.assert_array_equal(bench.joints, home)
    # Damping over stiffness is 5 ms: at 3 Hz 5 % of critical, so amplitude falls to 1 % within 5 s.
    bench.advance(5.0)
    turned = bench.joints - home
    expected = -bench.holding_efforts(home) / bench.stiffness
    # Within 2 %: loads are those of the straight arm, and the sag changes levers by a thousandth.
    heavy = np.abs(expected) > 1e-5
    assert heavy.sum() >= 14
    np.testing.assert_allclose(turned[heavy], expected[heavy], rtol=0.02)
    sag = kinematics.spine_points(bench.setup.arm, np.array([bench.joints, home]))[:, -1]
    statics = kinematics.jacobian(bench.setup.arm, home)[0, 3:] @ expected
    # Down is x0 on the pad.
    assert sag[0, 0] - sag[1, 0] == pytest.approx(statics[0], rel=0.02)
    assert 5e-3 < statics[0] < 50e-3


def load_home():
    """Follow-the-leader's joints at trajectory 4's home."""
    setup = load_setup(scenario())
    return setup.solver.solve(setup.path, [setup.path.home_arc_length]).joints[0]


@pytest.fixture(scope="module")
def standing():
    """Held at home, compensated, from the uncompensated posture: 17 mm down at the tip."""
    home = load_home()
    rest = Bench(scenario(), command=HOLD)
    sagged = home - rest.holding_efforts(home) / rest.stiffness
    bench = Bench(scenario(), command=HOLD, start=sagged)
    assert spine_distance(bench.setup.arm, bench.joints, home) > 10e-3
    bench.advance(5.0)
    return bench


def test_with_compensation_the_arm_stands_within_0_2_mm(standing):
    home = standing["follow_the_leader.joint_state"][:18]
    assert spine_distance(standing.setup.arm, standing.joints, home) < 0.2e-3


def test_at_rest_the_drives_forces_are_the_static_holding_forces(standing):
    q = standing.joints
    # Closed form: lever of the isosceles triangle, a cos(45 deg + theta / 2).
    pins = INCH * np.repeat([9.0, 7.5, 6.0, 2.7], [7, 6, 2, 1])
    lever = np.append([1.0, 1.0], pins * np.cos(0.25 * np.pi + 0.5 * q[2:]))
    expected = standing.holding_efforts(q) / lever
    found = standing["actuator_force_map.drive_effort"]
    # 1 %, of what is left of the motion after 5 s; the rail carries no load along itself here.
    np.testing.assert_allclose(found[1:], expected[1:], rtol=0.01)
    assert abs(found[0]) < 1.0


def test_the_default_start_is_at_rest():
    bench = Bench(scenario(), command=HOLD)
    bench.advance(0.5)
    # A start off its standing posture would swing by its sag; 1e-6 is a ten thousandth of that.
    assert np.abs(bench["plant.state"][18:]).max() < 1e-6


def test_an_unconnected_command_means_run():
    bench = Bench(scenario())
    bench.advance(0.5)
    assert bench["tip_path_source.tip"][1] > 0.0


@pytest.fixture(scope="module")
def moving():
    """The first 4 s of trajectory 4 at 40 mm/s: samples by port, every 1/64 s."""
    bench = Bench(scenario(motion__tip_speed_mm_per_s=40.0, motion__ramp_s=1.0))
    ports = [
        "tip_path_source.tip",
        "follow_the_leader.joint_state",
        "actuator_servo.setpoint",
        "actuator_servo.saturation",
        "actuator_length_map.drive_state",
        "actuator_force_map.drive_effort",
        "plant.state",
        "plant.net_actuation",
    ]
    rows = {port: [] for port in ports}
    for _ in range(256):
        bench.advance(1.0 / 64.0)
        for port in ports:
            rows[port].append(bench[port])
    return bench, {port: np.array(values) for port, values in rows.items()}


def test_on_the_move_no_drive_saturates(moving):
    _, rows = moving
    np.testing.assert_array_equal(rows["actuator_servo.saturation"], 0.0)


def test_on_the_move_set_points_are_the_commands_one_period_late_and_compensated(moving):
    bench, rows = moving
    arm = bench.setup.arm
    pins = INCH * np.repeat([9.0, 7.5, 6.0, 2.7], [7, 6, 2, 1])
    q = rows["follow_the_leader.joint_state"][:-1, :18]
    efforts = np.array([bench.holding_efforts(posture) for posture in q])
    aim = q + efforts / bench.stiffness
    expected = np.hstack([aim[:, :2], 2.0 * pins * np.sin(0.25 * np.pi + 0.5 * aim[:, 2:])])
    found = rows["actuator_servo.setpoint"][1:, :18]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    assert arm.joints == 18


def test_on_the_move_the_arm_follows_the_plan_within_the_latency_and_a_millimetre(moving):
    bench, rows = moving
    arm = bench.setup.arm
    wanted = rows["follow_the_leader.joint_state"][:, :18]
    reached = rows["plant.state"][:, :18]
    points = kinematics.spine_points(arm, wanted) - kinematics.spine_points(arm, reached)
    error = np.linalg.norm(points, axis=-1).max(axis=1)
    # Documented: at most 3 control periods and 2 plant steps behind, at the tip's speed.
    latency = 3.0 / 64.0 + 2.0 / 512.0
    assert error.max() < 0.040 * latency + 1e-3
    # And the bound for it all.
    assert error.max() < 10e-3


def test_but_for_the_latency_the_arm_is_on_the_plan_within_0_2_mm(moving):
    bench, rows = moving
    arm = bench.setup.arm
    wanted = kinematics.spine_points(arm, rows["follow_the_leader.joint_state"][:, :18])
    reached = kinematics.spine_points(arm, rows["plant.state"][:, :18])
    # Samples are a control period apart: two periods, and the plant's two steps, which at 40 mm/s
    # are the 0.16 mm that remain.
    error = np.linalg.norm(reached[2:] - wanted[:-2], axis=-1)
    assert error.max() < 0.2e-3


def test_on_the_move_drive_efforts_do_the_joints_work(moving):
    _, rows = moving
    pins = INCH * np.repeat([9.0, 7.5, 6.0, 2.7], [7, 6, 2, 1])
    q = rows["plant.state"][:, :18]
    lever = np.hstack([np.ones((len(q), 2)), pins * np.cos(0.25 * np.pi + 0.5 * q[:, 2:])])
    np.testing.assert_allclose(
        rows["actuator_force_map.drive_effort"] * lever, rows["plant.net_actuation"], rtol=1e-12
    )


def test_on_the_move_no_drive_is_kicked(moving):
    bench, rows = moving
    # The rail accelerates all that moves (207.5 kg) by at most 1.5 speed / ramp; it answered
    # updates with kilonewtons when set-points stood still between them.
    inertia = 207.5 * 1.5 * 0.040 / 1.0
    assert np.abs(rows["actuator_force_map.drive_effort"][:, 0]).max() < 5.0 * inertia
    assert np.all(
        np.abs(rows["plant.net_actuation"])
        <= [
            bench.plant.get_joint_actuator(i).effort_limit()
            for i in bench.plant.GetJointActuatorIndices()
        ]
    )


def test_the_same_run_twice_is_the_same_to_the_last_bit():
    states = []
    for _ in range(2):
        bench = Bench(scenario())
        bench.advance(0.25)
        states.append(bench["plant.state"])
    np.testing.assert_array_equal(*states)


def test_hold_stops_the_arm_and_run_goes_on():
    bench = Bench(scenario())
    bench.advance(3.0)
    bench.command(HOLD)
    bench.advance(2.0)
    assert bench["tip_path_source.tip"][1] == 0.0
    # At rest but for what swings on: a tenth of the rail's speed.
    assert np.abs(bench["plant.state"][18]) < 2.5e-3
    bench.command(RUN)
    bench.advance(2.0)
    assert bench["tip_path_source.tip"][1] == pytest.approx(0.025, abs=1e-12)


def test_a_supervised_arm_is_held_when_an_encoder_fails_and_stopped_when_it_stays_so():
    bench = Bench(scenario(supervisor__patience_s=1.0))
    health = bench.station.GetInputPort("motion_supervisor.encoder_health")
    bench.advance(2.0)
    assert bench["motion_supervisor.mode"] == Mode.PERMIT
    before = bench["tip_path_source.tip"]
    assert before[1] > 0.02
    health.FixValue(bench.context, np.arange(18) != 7)
    bench.advance(0.75)
    assert (bench["motion_supervisor.mode"], bench["motion_supervisor.cause"]) == (
        Mode.HOLD,
        Cause.ENCODER,
    )
    # At most a supervision period of 1/32 s and a control period late, and half a second's ramp, of
    # which the mean speed is half; the tip is no faster than 25 mm/s.
    gone = bench["tip_path_source.tip"] - before
    assert bench["tip_path_source.tip"][1] == 0.0
    assert gone[0] <= 0.025 * (1.0 / 32.0 + 1.0 / 64.0 + 0.25)
    bench.advance(0.5)
    assert bench["motion_supervisor.mode"] == Mode.STOP
    # Nobody gets past a stop.
    health.FixValue(bench.context, np.ones(18))
    bench.command(RUN)
    bench.advance(0.25)
    assert bench["motion_supervisor.command"] == HOLD
    assert bench["tip_path_source.tip"][1] == 0.0


def test_without_a_supervisor_the_operator_has_the_path_source():
    bench = Bench(scenario(supervisor__enabled=False), command=HOLD)
    ports = [
        bench.station.get_input_port(i).get_name() for i in range(bench.station.num_input_ports())
    ]
    assert ports == ["tip_path_source.command"]
    bench.advance(0.25)
    assert bench["tip_path_source.tip"][1] == 0.0


def test_the_supervisors_latency_is_the_stations():
    # By default: 1/32 s until sampled, 1/64 s until decided, and 3/64 s + 2/512 s to the plant.
    latency = 1.0 / 32.0 + 1.0 / 64.0 + 3.0 / 64.0 + 2.0 / 512.0
    assert supervision_latency(ClockConfig()) == latency
    supervisor = MakeSerpentineStation(scenario()).GetSubsystemByName("motion_supervisor")
    # v t + v^2 / (2 a) with a = v / ramp, for each v: half the ramp's time.
    assert supervisor.thresholds.stopping_time == latency + 0.25


@pytest.mark.parametrize(
    ("clearance_hz", "control_hz", "period", "offset"),
    [(32, 64, 1 / 32, 1 / 64), (64, 64, 1 / 64, 0.0), (128, 32, 1 / 32, 0.0), (1, 64, 1.0, 1 / 64)],
)
def test_the_supervisor_decides_as_often_as_there_is_something_new(
    clearance_hz, control_hz, period, offset
):
    clocks = ClockConfig(clearance_hz=clearance_hz, control_hz=control_hz)
    assert supervision_period(clocks) == (period, offset)


def test_interpolated_set_points_do_not_drift_from_the_servos():
    bench = Bench(scenario(motion__tip_speed_mm_per_s=40.0))
    bench.advance(10.0)  # far enough for the hinges to turn
    bench.command(HOLD)
    bench.advance(1.5)
    wanted = bench["follow_the_leader.joint_state"][:18]
    assert np.abs(wanted[2:]).max() > 0.1
    aim = wanted + bench.holding_efforts(wanted) / bench.stiffness
    interpolator = bench.station.GetSubsystemByName("setpoint_interpolator")
    mine = interpolator.GetMyContextFromRoot(bench.context)
    found = mine.get_discrete_state_vector().CopyToVector()
    # Roundings of some 6000 sums of numbers up to 3. Sums of derivatives are off by 1e-6.
    np.testing.assert_allclose(found, aim, rtol=0, atol=1e-11)


def test_a_path_whose_home_cannot_be_reached_is_refused(tmp_path):
    (tmp_path / "aside.csv").write_text("x_in,y_in,z_in\n60,0,0\n60,0,174.902\n60,0,190\n")
    made = scenario()
    made.path = "aside.csv"
    setup = load_setup(made, folder=tmp_path)
    with pytest.raises(InputError, match=r"tip at .* of path 'aside' .*motion base does not reach"):
        MakeSerpentineStation(made, setup=setup)


def test_names_that_are_not_there_are_refused():
    for field, kind in (("arm", "arm"), ("path", "path"), ("scene", "scene")):
        with pytest.raises(InputError, match=f"unknown {kind} 'nowhere'"):
            load_setup(scenario(**{field: "nowhere"}))


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_trajectory_4_out_and_back_keeps_to_the_plan_and_within_the_drives():
    bench = Bench(load_scenario("trajectory_4").config)
    arm = bench.setup.arm
    source = bench.station.GetSubsystemByName("tip_path_source")
    limits = np.append(arm.base_effort_limit, arm.linkage.force_limit)
    errors, fractions, clearances = [], [], []
    while bench.context.get_time() < source.duration + 1.0:
        bench.advance(1.0 / 16.0)
        wanted = bench["follow_the_leader.joint_state"][:18]
        errors.append(spine_distance(arm, bench.joints, wanted))
        fractions.append(np.abs(bench["actuator_force_map.drive_effort"]) / limits)
        clearances.append(bench["clearance_monitor.clearance"])
        assert not bench["actuator_servo.saturation"].any()
    assert bench["tip_path_source.phase"][0] == DONE
    # The issue: within 10 mm of the plan with compensation on.
    assert max(errors) < 10e-3
    assert np.max(fractions) < 1.0
    least = np.min(clearances, axis=0)
    assert least[0] > 0.025 and least[2] > 0.010
    # Home again.
    assert spine_distance(arm, bench.joints, load_home()) < 0.5e-3


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("mounting", ["laboratory", "pad_below"])
def test_other_mountings_follow_the_arcs_within_10_mm(mounting):
    bench = Bench(scenario(mounting=mounting, motion__retract=False))
    source, errors = bench.station.GetSubsystemByName("tip_path_source"), []
    while bench.context.get_time() < source.duration:
        bench.advance(1.0 / 8.0)
        wanted = bench["follow_the_leader.joint_state"][:18]
        errors.append(spine_distance(load_arm("prototype"), bench.joints, wanted))
    assert max(errors) < 10e-3
