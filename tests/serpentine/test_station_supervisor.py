"""The supervisor in the station: it holds and stops the arm, in time, and may be left out."""

from __future__ import annotations

import numpy as np
import pytest

from pips_drake.serpentine.drives import drive_limits
from pips_drake.serpentine.fault_config import FaultConfig
from pips_drake.serpentine.scenario import ClockConfig
from pips_drake.serpentine.station import MakeSerpentineStation
from pips_drake.serpentine.station.supervision import supervision_latency, supervision_period
from pips_drake.serpentine.supervision import Cause, Mode
from pips_drake.serpentine.systems.motion_supervisor import MEASURED
from pips_drake.serpentine.systems.tip_path_source import HOLD, RUN

from .station_bench import PLANT_STEP, Bench, load_home, scenario, spine_distance
from .supervised_moments import CONFIG


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


def test_a_stop_brakes_a_drive_that_runs_away_in_its_latency():
    # The hand leaves its place at 0.2 m/s, 20 s of stroke at the drive's own speed.
    faults = [FaultConfig(kind="runaway", drive="L10", start_s=1.0, size=1.0)]
    bench = Bench(scenario(faults=faults))
    while bench["motion_supervisor.mode"] != Mode.STOP:
        bench.advance(PLANT_STEP)
        assert bench.context.get_time() < 1.5
    assert bench["motion_supervisor.cause"] == Cause.RUNAWAY
    drives = bench["actuator_servo.setpoint"]
    assert drives[18 + 9] != 0.0
    # The servo's next update, with two plant steps until the arm has it.
    bench.advance(1.0 / 64.0)
    braked = bench["actuator_servo.setpoint"]
    np.testing.assert_array_equal(braked[18:], 0.0)
    # What was on its way when the brake was set: less than a period of the drive's speed.
    assert abs(braked[9] - drives[9]) <= abs(drives[18 + 9]) / 64.0
    bench.advance(1.0)
    np.testing.assert_array_equal(bench["actuator_servo.setpoint"], braked)
    before = bench.joints
    bench.advance(0.25)
    # It stands as its drives do; a swing that dies out is left.
    assert spine_distance(bench.setup.arm, bench.joints, before) < 1e-3


def test_brakes_at_full_speed_overload_no_drive_and_leave_the_arm_where_it_was():
    bench = Bench(scenario(), command=RUN)
    bench.advance(2.0)
    speed = bench["tip_path_source.tip"][1]
    assert speed == pytest.approx(0.025)
    bench.command(0.5)  # no word: a stop at once
    while bench["motion_supervisor.mode"] != Mode.STOP:
        bench.advance(PLANT_STEP)
    start, limits, loads = bench.joints, drive_limits(bench.setup.arm)[3], []
    for _ in range(256):
        bench.advance(PLANT_STEP)
        loads.append(np.abs(bench["actuator_force_map.drive_effort"] / limits).max())
    assert max(loads) < CONFIG.force_fraction_hold
    # 2 / 64 s until the servo's set-point stands, two plant steps, and a swing of as much again.
    gone = spine_distance(bench.setup.arm, bench.joints, start)
    assert gone < 2.0 * speed * (2.0 / 64.0 + 2.0 / 512.0)


def test_a_folded_arm_that_moves_sees_what_closes_in_on_itself():
    # Half a radian at every other hinge: two of its bodies are 0.127 m apart. Its drives pull it
    # straight.
    folded = load_home()
    folded[2::2] = -0.5
    bench = Bench(scenario(), start=folded)
    bench.advance(0.125)
    seen = dict(zip(MEASURED, bench["motion_supervisor.measured"], strict=True))
    # What will be nearest stands no nearer than what is.
    assert seen["self_clearance_m"] - 1e-12 <= seen["self_urgent_clearance_m"] < 0.15
    assert abs(seen["self_urgent_rate_m_per_s"]) > 1e-3
    monitor = bench.station.GetSubsystemByName("clearance_monitor")
    pair = monitor.pair_name(seen["self_urgent_pair"])
    assert all(name.startswith("prototype::") for name in pair)
    assert np.isnan(seen["urgent_pair"])  # there is no scene


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
