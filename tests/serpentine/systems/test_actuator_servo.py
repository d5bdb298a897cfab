"""Set-points follow commands within stroke and speed."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from pips_drake.serpentine.fault_config import FaultConfig
from pips_drake.serpentine.faults import make_drive_faults
from pips_drake.serpentine.systems.actuator_servo import ActuatorServo

PERIOD = 1.0 / 64.0
INCH = 0.0254
DEGREE = np.pi / 180.0


def home_lengths():
    """The prototype's drives at home: d1 24.9 in, theta2 -90 deg, actuators a sqrt 2."""
    pins = INCH * np.repeat([9.0, 7.5, 6.0, 2.7], [7, 6, 2, 1])
    return np.concatenate([[24.9 * INCH, -0.5 * np.pi], np.sqrt(2.0) * pins])


def speed_limits():
    """FACTS: 25 mm/s; the arm file's base drives: 50 mm/s and 5 deg/s."""
    return np.append([0.05, 5.0 * DEGREE], np.full(16, 0.025))


class Bench:
    """A servo with its simulator; inputs can be changed between steps."""

    def __init__(self, arm, start, **options):
        self.servo = ActuatorServo(arm, **options)
        self.simulator = Simulator(self.servo)
        self.context = self.simulator.get_mutable_context()
        self.command(start)
        self.simulator.Initialize()

    def command(self, drives, offset=None):
        state = np.append(drives, np.zeros(18))
        self.servo.GetInputPort("drive_state").FixValue(self.context, state)
        if offset is not None:
            self.servo.GetInputPort("drive_offset").FixValue(self.context, offset)

    def advance(self, periods):
        """To midway between two updates, so that it is clear which have happened."""
        done = np.floor(self.context.get_time() / PERIOD)
        self.simulator.AdvanceTo((done + periods + 0.5) * PERIOD)
        return self.setpoint()

    def setpoint(self):
        value = self.servo.GetOutputPort("setpoint").Eval(self.context)
        return value[:18].copy(), value[18:].copy()

    def saturation(self):
        return tuple(self.servo.GetOutputPort("saturation").Eval(self.context))


def test_ports(arm, port_sizes):
    inputs, outputs = port_sizes(ActuatorServo(arm))
    assert inputs == {"drive_state": 36, "drive_offset": 18, "brake": 1}
    assert outputs == {"setpoint": 36, "saturation": 2}


def test_no_output_has_feedthrough(arm):
    assert not ActuatorServo(arm).HasAnyDirectFeedthrough()


def test_it_starts_where_it_is_commanded_at_rest(arm):
    bench = Bench(arm, home_lengths())
    drives, rates = bench.setpoint()
    np.testing.assert_array_equal(drives, home_lengths())
    np.testing.assert_array_equal(rates, 0.0)
    assert bench.saturation() == (0.0, 0.0)


def test_a_slow_command_is_reached_within_one_period(arm):
    bench = Bench(arm, home_lengths())
    bench.advance(0)
    wanted = home_lengths() + 0.5 * speed_limits() * PERIOD
    bench.command(wanted)
    drives, rates = bench.advance(1)
    # before + (wanted - before): one rounding of up to 1.6.
    np.testing.assert_allclose(drives, wanted, rtol=0, atol=5e-16)
    np.testing.assert_allclose(rates, 0.5 * speed_limits(), rtol=0, atol=1e-13)
    assert bench.saturation() == (0.0, 0.0)


def test_a_fast_command_is_followed_at_the_speed_limit_and_reached_in_its_time(arm):
    bench = Bench(arm, home_lengths())
    bench.advance(0)
    # Away from the ends of the strokes, 20.5 periods of travel at the limit; every other one back.
    sign = np.where(np.arange(18) % 2, -1.0, 1.0)
    wanted = home_lengths() + sign * 20.5 * speed_limits() * PERIOD
    bench.command(wanted)
    for k in range(1, 21):
        drives, rates = bench.advance(1)
        np.testing.assert_allclose(rates, sign * speed_limits(), rtol=0, atol=1e-13)
        np.testing.assert_allclose(
            drives, home_lengths() + sign * k * PERIOD * speed_limits(), rtol=0, atol=1e-14
        )
        assert bench.saturation() == (0.0, 18.0)
    drives, rates = bench.advance(1)
    np.testing.assert_allclose(drives, wanted, rtol=0, atol=1e-14)
    np.testing.assert_allclose(rates, 0.5 * sign * speed_limits(), rtol=0, atol=1e-12)
    drives, rates = bench.advance(1)
    np.testing.assert_allclose(rates, 0.0, rtol=0, atol=1e-12)
    assert bench.saturation() == (0.0, 0.0)


def test_set_points_never_move_faster_than_their_rates_say(arm):
    bench, rng = Bench(arm, home_lengths()), np.random.default_rng(8)
    before, _ = bench.advance(0)
    for _ in range(100):
        bench.command(home_lengths() + rng.normal(0.0, 2.0, 18) * speed_limits() * PERIOD)
        drives, rates = bench.advance(1)
        np.testing.assert_allclose(drives - before, rates * PERIOD, rtol=0, atol=5e-16)
        assert np.all(np.abs(rates) <= speed_limits() * (1.0 + 1e-15))
        before = drives


def test_commands_stop_at_the_ends_of_the_strokes(arm):
    # FACTS: joint limits +-30 deg of an isosceles triangle, and 2 mm of overtravel beyond.
    pins = INCH * np.repeat([9.0, 7.5, 6.0, 2.7], [7, 6, 2, 1])
    shortest = np.append(
        [24.9 * INCH - 0.002, -121.0 * DEGREE], 2.0 * pins * np.sin(30.0 * DEGREE) - 0.002
    )
    longest = np.append(
        [114.5 * INCH + 0.002, -59.0 * DEGREE], 2.0 * pins * np.sin(60.0 * DEGREE) + 0.002
    )
    bench = Bench(arm, home_lengths())
    # The rail is the slowest: 89.6 in at 50 mm/s.
    for end, wanted, travel in ((longest, 1.0, 46.0), (shortest, -1.0, 46.0)):
        bench.command(home_lengths() + wanted * 10.0)
        drives, rates = bench.advance(int(travel / PERIOD))
        np.testing.assert_allclose(drives, end, rtol=0, atol=1e-13)
        np.testing.assert_array_equal(rates, 0.0)
        assert bench.saturation() == (18.0, 0.0)


def test_a_command_beyond_the_stroke_at_the_start_is_cut_at_once(arm):
    drives, rates = Bench(arm, home_lengths() - 10.0).setpoint()
    assert drives[0] == pytest.approx(24.9 * INCH - 0.002, abs=1e-15)
    np.testing.assert_array_equal(rates, 0.0)


def test_the_offset_is_added_to_the_command(arm):
    bench = Bench(arm, home_lengths())
    bench.advance(0)
    offset = 0.25 * speed_limits() * PERIOD
    bench.command(home_lengths(), offset)
    drives, _ = bench.advance(1)
    np.testing.assert_allclose(drives, home_lengths() + offset, rtol=0, atol=5e-16)


def test_an_unconnected_offset_means_none(arm):
    apart, zero = Bench(arm, home_lengths()), Bench(arm, home_lengths())
    wanted = home_lengths() + 0.3 * speed_limits() * PERIOD
    apart.command(wanted)
    zero.command(wanted, np.zeros(18))
    np.testing.assert_array_equal(apart.advance(3)[0], zero.advance(3)[0])


class TestBrake:
    """Whatever a drive is told, and whatever ails it, a brake stops it where it stands."""

    FAULTS = (
        FaultConfig(kind="runaway", drive="L10", size=1.0),
        FaultConfig(kind="runaway", drive="d1", size=-0.5),
        FaultConfig(kind="slow", drive="L5", size=0.2),
        FaultConfig(kind="jam", drive="L6"),
        FaultConfig(kind="late", size=3.0),
    )

    def bench(self, arm, faults):
        bench = Bench(arm, home_lengths(), faults=make_drive_faults(arm, faults))
        bench.command(home_lengths() + 0.02)
        bench.advance(6)
        return bench

    def brake(self, bench, value):
        bench.servo.GetInputPort("brake").FixValue(bench.context, [value])

    @pytest.mark.parametrize("faults", [(), *((fault,) for fault in FAULTS), FAULTS])
    def test_every_set_point_stands_from_the_next_update_on(self, arm, faults):
        bench = self.bench(arm, faults)
        before, rates = bench.setpoint()
        assert np.any(rates != 0.0) or (faults and faults[0].kind == "late")
        self.brake(bench, 1.0)
        for periods in (1, 1, 64):
            drives, rates = bench.advance(periods)
            np.testing.assert_array_equal(drives, before)
            np.testing.assert_array_equal(rates, 0.0)
        assert bench.saturation() == (0.0, 0.0)

    def test_let_go_the_drives_go_on_from_where_they_stand(self, arm):
        bench = self.bench(arm, ())
        before, _ = bench.setpoint()
        self.brake(bench, 1.0)
        bench.advance(10)
        self.brake(bench, 0.0)
        drives, rates = bench.advance(1)
        np.testing.assert_allclose(rates, speed_limits(), rtol=0, atol=1e-13)
        np.testing.assert_allclose(drives - before, speed_limits() * PERIOD, rtol=0, atol=1e-14)

    def test_a_brake_that_is_no_number_is_set(self, arm):
        bench = self.bench(arm, ())
        self.brake(bench, np.nan)
        np.testing.assert_array_equal(bench.advance(1)[1], 0.0)


def test_a_missing_command_is_named(arm):
    servo = ActuatorServo(arm)
    with pytest.raises(RuntimeError, match="drive_state"):
        Simulator(servo).Initialize()
