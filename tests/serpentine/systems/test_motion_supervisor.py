"""The supervisor's ports, and that what goes in decides what comes out, one period later."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from pips_drake.serpentine import kinematics
from pips_drake.serpentine.drives import drive_limits
from pips_drake.serpentine.motion_words import EXTEND, EXTENDING, HOLD, RETRACT, RETRACTING, RUN
from pips_drake.serpentine.supervision import Cause, Mode
from pips_drake.serpentine.supervisor_config import SupervisorConfig
from pips_drake.serpentine.systems.motion_supervisor import MEASURED, MotionSupervisor

PERIOD, OFFSET = 1.0 / 32.0, 1.0 / 64.0
SPEED = 0.025


class Bench:
    """A supervisor alone, its inputs fixed by hand."""

    def __init__(self, arm, **config):
        self.arm = arm
        self.system = MotionSupervisor(arm, config=SupervisorConfig(**config), latency=0.1)
        self.simulator = Simulator(self.system)
        self.context = self.simulator.get_mutable_context()
        self.given = {
            "clearance": [0.5, np.nan, 0.17],
            "commanded_joint_state": np.zeros(36),
            "joint_state": np.zeros(36),
            "drive_effort": np.zeros(18),
            "tip": [5.0, SPEED],
            "phase": [EXTENDING],
        }
        self.updates = 0

    def update(self, updates=1, **inputs):
        """The outputs after some updates with these inputs."""
        self.given |= inputs
        for name, value in self.given.items():
            self.system.GetInputPort(name).FixValue(self.context, value)
        self.updates += updates
        # Midway between updates.
        self.simulator.AdvanceTo(OFFSET + (self.updates - 0.5) * PERIOD)
        return {name: self[name] for name in ("command", "speed_share", "mode", "cause")}

    def __getitem__(self, port):
        value = np.array(self.system.GetOutputPort(port).Eval(self.context))
        return float(value[0]) if value.size == 1 else value

    @property
    def measured(self):
        return dict(zip(MEASURED, self["measured"], strict=True))


@pytest.fixture
def bench(arm):
    return Bench(arm)


def test_ports(arm, port_sizes):
    inputs, outputs = port_sizes(MotionSupervisor(arm))
    assert inputs == {
        "clearance": 3,
        "commanded_joint_state": 36,
        "joint_state": 36,
        "drive_effort": 18,
        "tip": 2,
        "phase": 1,
        "operator_command": 1,
        "encoder_health": 18,
        "urgent": 3,
        "own_urgent": 3,
    }
    assert outputs == {
        "command": 1,
        "speed_share": 1,
        "brake": 1,
        "mode": 1,
        "cause": 1,
        "measured": 15,
    }


def test_no_output_has_feedthrough(arm):
    assert not MotionSupervisor(arm).HasAnyDirectFeedthrough()


def test_before_the_first_decision_motion_is_permitted(bench):
    assert bench["command"] == RUN and bench["speed_share"] == 1.0
    assert (bench["mode"], bench["cause"]) == (Mode.PERMIT, Cause.NONE)
    np.testing.assert_array_equal(bench["measured"], np.zeros(15))


def test_without_an_operator_and_encoder_health_the_tip_runs(bench):
    out = bench.update()
    assert out == {"command": RUN, "speed_share": 1.0, "mode": Mode.PERMIT, "cause": Cause.NONE}


@pytest.mark.parametrize("wish", [RUN, HOLD, RETRACT])
def test_the_operators_command_passes_one_update_later(bench, wish):
    bench.update(operator_command=[RUN])
    for name, value in {**bench.given, "operator_command": [wish]}.items():
        bench.system.GetInputPort(name).FixValue(bench.context, value)
    assert bench["command"] == RUN, "not before the update"
    assert bench.update(operator_command=[wish])["command"] == wish


def test_an_arm_that_is_to_be_held_from_the_beginning_does_not_start(bench):
    for wish, command in ((HOLD, HOLD), (RETRACT, RETRACT), (EXTEND, EXTEND), (np.nan, HOLD)):
        bench.system.GetInputPort("operator_command").FixValue(bench.context, [wish])
        bench.simulator.Initialize()
        assert bench["command"] == command and bench["mode"] == Mode.PERMIT


def test_updates_come_each_period_from_the_offset_on(bench):
    for name, value in {**bench.given, "clearance": [0.001, 0.0, 0.17]}.items():
        bench.system.GetInputPort(name).FixValue(bench.context, value)
    bench.simulator.AdvanceTo(OFFSET - 1e-6)
    assert bench["mode"] == Mode.PERMIT
    bench.simulator.AdvanceTo(OFFSET + 1e-6)
    assert bench["mode"] == Mode.RETRACT


def test_it_holds_before_what_comes_nearer_and_lets_go_when_it_has_gone(bench):
    # 20 mm and 25 mm/s over 0.1 s + 0.5 s / 2.
    limit = 0.020 + SPEED * 0.35
    assert bench.update(clearance=[limit + 1e-6, -SPEED, 0.17])["mode"] == Mode.PERMIT
    out = bench.update(clearance=[limit - 1e-6, -SPEED, 0.17])
    assert out == {"command": HOLD, "speed_share": 1.0, "mode": Mode.HOLD, "cause": Cause.CLEARANCE}
    assert bench.update(clearance=[0.0249, 0.0, 0.17], tip=[5.0, 0.0])["mode"] == Mode.HOLD
    # After half a second, 16 updates, of quiet.
    assert bench.update(15, clearance=[0.0251, 0.0, 0.17])["mode"] == Mode.HOLD
    assert bench.update()["mode"] == Mode.PERMIT
    assert bench["command"] == RUN


def test_a_rate_that_is_not_given_is_taken_from_two_samples(bench):
    bench.update(clearance=[0.040, np.nan, 0.17])
    assert bench.measured["clearance_rate_m_per_s"] == 0.0
    out = bench.update(clearance=[0.0275, np.nan, 0.17])
    # 12.5 mm in a period are 0.4 m/s.
    assert bench.measured["clearance_rate_m_per_s"] == pytest.approx(-0.4, rel=1e-12)
    assert out["cause"] == Cause.CLEARANCE


def test_the_arms_distance_to_itself_is_watched_with_its_own_rate(bench):
    bench.update(clearance=[0.5, 0.0, 0.020])
    out = bench.update(clearance=[0.5, 0.0, 0.0195])
    # 0.5 mm in 1/32 s: 16 mm/s, 5.6 mm until rest, 13.9 mm left.
    assert bench.measured["self_clearance_rate_m_per_s"] == pytest.approx(-0.016, rel=1e-12)
    assert out["mode"] == Mode.PERMIT
    bench.update(clearance=[0.5, 0.0, 0.0105])
    assert bench["cause"] == Cause.SELF_CLEARANCE


def test_what_closes_in_behind_the_nearest_is_held_too(bench):
    # 45 mm at 80 mm/s: 28 mm are lost until rest, while 39 mm elsewhere stand.
    rest = {"clearance": [0.039, 0.0, 0.17]}
    assert bench.update(**rest, urgent=[0.049, -0.08, 3.0])["mode"] == Mode.PERMIT
    assert bench.update(**rest, urgent=[np.nan, np.nan, np.nan])["mode"] == Mode.PERMIT
    out = bench.update(**rest, urgent=[0.045, -0.08, 3.0])
    assert (out["mode"], out["cause"]) == (Mode.HOLD, Cause.CLEARANCE)
    assert bench.measured["urgent_pair"] == 3.0
    np.testing.assert_array_equal(bench["measured"][9:12], [0.045, -0.08, 3.0])


def test_a_part_of_the_arm_that_closes_in_behind_the_nearest_is_held_too(bench):
    # 33 mm at 80 mm/s: 28 mm are lost until rest and 5 are left, while 20 mm elsewhere stand.
    rest = {"clearance": [0.5, 0.0, 0.020]}
    assert bench.update(**rest, own_urgent=[0.0331, -0.08, 3.0])["mode"] == Mode.PERMIT
    assert bench.update(**rest, own_urgent=[np.nan, np.nan, np.nan])["mode"] == Mode.PERMIT
    out = bench.update(**rest, own_urgent=[0.0329, -0.08, 3.0])
    assert (out["mode"], out["cause"]) == (Mode.HOLD, Cause.SELF_CLEARANCE)
    np.testing.assert_array_equal(bench["measured"][12:], [0.0329, -0.08, 3.0])


def test_operators_may_back_out_of_a_hold_and_not_go_on(bench):
    bench.update(clearance=[0.025, -SPEED, 0.17], operator_command=[RUN])
    rest = {"clearance": [0.020, 0.0, 0.17], "tip": [5.0, 0.0]}
    assert bench.update(**rest)["command"] == HOLD
    assert bench.update(operator_command=[RETRACT])["command"] == RETRACT
    assert bench["speed_share"] == 1.0


def test_out_of_patience_it_goes_back_at_the_safe_speed(arm):
    bench = Bench(arm, patience_s=0.25, safe_speed_fraction=0.3)
    bench.update(clearance=[0.025, -SPEED, 0.17])
    out = bench.update(6, clearance=[0.020, 0.0, 0.17], tip=[5.0, 0.0])
    assert out["mode"] == Mode.HOLD
    out = bench.update()
    assert out == {
        "command": RETRACT,
        "speed_share": 0.3,
        "mode": Mode.RETRACT,
        "cause": Cause.CLEARANCE,
    }
    out = bench.update(clearance=[0.2, 0.01, 0.17], tip=[4.0, -0.01], phase=[RETRACTING])
    assert (out["mode"], out["command"]) == (Mode.RETRACT, RETRACT)


def test_an_arm_that_lags_is_held_and_stopped(bench):
    q = np.zeros(36)
    q[4] = 0.03  # a hinge near the base: some 0.1 m at the tip
    out = bench.update(joint_state=q)
    assert (out["mode"], out["cause"], out["command"]) == (Mode.HOLD, Cause.TRACKING, HOLD)
    points = kinematics.spine_points(bench.arm, np.array([q[:18], np.zeros(18)]))
    distances = np.linalg.norm(points[0] - points[1], axis=-1)
    assert bench.measured["tracking_error_m"] == pytest.approx(distances.max(), abs=1e-13)
    joint = bench.arm.spine_indices[int(np.argmax(distances))]
    assert bench.measured["tracking_joint"] == joint
    assert bench["brake"] == 0.0
    assert bench.update(160)["mode"] == Mode.STOP
    assert bench["brake"] == 1.0
    # Not left again.
    assert bench.update(joint_state=np.zeros(36))["command"] == HOLD
    assert bench["brake"] == 1.0


def test_an_arm_that_leaves_its_place_although_it_is_held_is_stopped_at_once(bench):
    q = np.zeros(36)
    # A hinge near the base, so that the tip is 45 mm out of its place, then 20 mm more.
    q[4] = 0.0135
    assert bench.update(joint_state=q)["mode"] == Mode.HOLD
    first = bench.measured["tracking_error_m"]
    assert bench.update(32, joint_state=q)["mode"] == Mode.HOLD
    q[4] *= (first + 0.0205) / first
    out = bench.update(joint_state=q)
    assert (out["mode"], out["cause"]) == (Mode.STOP, Cause.RUNAWAY)
    assert bench["brake"] == 1.0


def test_an_operator_releases_a_retracted_arm_by_holding_and_then_running(bench):
    away = {"clearance": [0.5, 0.0, 0.17], "tip": [4.9, 0.0], "phase": [RETRACTING]}
    assert bench.update(clearance=[0.001, 0.0, 0.17])["mode"] == Mode.RETRACT
    # Without a hold before it, running is going back.
    assert bench.update(32, **away, operator_command=[RUN])["command"] == RETRACT
    assert bench.update(operator_command=[HOLD])["mode"] == Mode.RETRACT
    out = bench.update(operator_command=[RUN])
    assert (out["mode"], out["command"], out["speed_share"]) == (Mode.PERMIT, EXTEND, 1.0)
    # Once the tip has turned it is running as before.
    assert bench.update(phase=[EXTENDING], tip=[4.9, 1e-3])["command"] == RUN


def test_a_drive_at_its_limit_is_named(bench):
    effort = np.zeros(18)
    effort[5] = -drive_limits(bench.arm)[3][5]
    out = bench.update(drive_effort=effort)
    assert (out["mode"], out["cause"]) == (Mode.HOLD, Cause.FORCE)
    assert (bench.measured["force_fraction"], bench.measured["force_drive"]) == (1.0, 5)


@pytest.mark.parametrize("health", [0.0, np.nan])
def test_an_encoder_that_fails_holds_and_is_named(bench, health):
    good = np.ones(18)
    assert bench.update(encoder_health=good)["mode"] == Mode.PERMIT
    assert bench.measured["unhealthy_encoder"] == -1
    bad = good.copy()
    bad[3] = health
    out = bench.update(encoder_health=bad)
    assert (out["mode"], out["cause"]) == (Mode.HOLD, Cause.ENCODER)
    assert bench.measured["unhealthy_encoder"] == 3
    assert bench.update(16, encoder_health=good)["mode"] == Mode.PERMIT


@pytest.mark.parametrize(
    ("port", "index"),
    [
        ("clearance", 0),
        ("clearance", 2),
        ("commanded_joint_state", 3),
        ("joint_state", 0),
        ("drive_effort", 17),
        ("tip", 1),
        ("operator_command", 0),
    ],
)
def test_what_is_no_number_stops(bench, port, index):
    bench.update(operator_command=[RUN])
    value = np.array(bench.given[port], dtype=float)
    value[index] = np.nan
    out = bench.update(**{port: value})
    assert out == {"command": HOLD, "speed_share": 1.0, "mode": Mode.STOP, "cause": Cause.INVALID}


def test_a_command_that_is_no_word_stops(bench):
    assert bench.update(operator_command=[0.5])["cause"] == Cause.INVALID


def test_a_measurement_that_is_not_connected_is_named(arm):
    system = MotionSupervisor(arm)
    with pytest.raises(RuntimeError, match="clearance"):
        Simulator(system).AdvanceTo(0.1)


def test_two_contexts_do_not_share_anything(bench):
    bench.update(clearance=[0.001, 0.0, 0.17])
    assert bench["mode"] == Mode.RETRACT
    fresh = bench.system.CreateDefaultContext()
    assert bench.system.GetOutputPort("mode").Eval(fresh)[0] == Mode.PERMIT
