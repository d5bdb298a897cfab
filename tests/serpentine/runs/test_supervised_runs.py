"""Runs in which something pushes, runs away or is in the way: few decisions, a safe end."""

from __future__ import annotations

import numpy as np
import pytest

from pips_drake.scenarios import load_scenario
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.fault_config import FaultConfig
from pips_drake.serpentine.motion_words import EXTENDING, HOLD, RETRACTING, RUN
from pips_drake.serpentine.runs.run import Run, run_station
from pips_drake.serpentine.station import load_setup
from pips_drake.serpentine.supervision import Cause, Mode

from ..station_bench import Bench

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]


def run_with(fault: FaultConfig, *, duration: float, fidelity: str = "joint") -> Run:
    scenario = load_scenario("fault_runaway").config
    scenario.faults, scenario.duration_s = [fault], duration
    scenario.actuation.fidelity = fidelity
    return run_station(scenario, load_setup(scenario))


def farthest(run: Run, arm) -> float:
    """How far any spine point was from its command, m."""
    data = run.data
    points = kinematics.spine_points(arm, data.joints)
    wanted = kinematics.spine_points(arm, data.commanded_joints)
    return float(np.linalg.norm(points - wanted, axis=-1).max())


@pytest.mark.parametrize("force", [[0.0, 600.0, 0.0], [0.0, 0.0, -1000.0], [600.0, 600.0, 0.0]])
def test_a_strong_push_is_held_and_named_at_most_twice_and_let_go_when_it_is_quiet(arm, force):
    push = FaultConfig(kind="disturbance", start_s=30.0, duration_s=1.0, force_n=force)
    run = run_with(push, duration=38.0)
    found = run.supervised
    # Without hysteresis of the causes there were 7 to 10.
    modes = [one.after for one in found.decisions]
    assert modes == [Mode.HOLD] * (len(modes) - 1) + [Mode.PERMIT] and len(modes) <= 3
    assert farthest(run, arm) > 0.15
    # It stood in its place for half a second before it was let go, to a sample.
    free = found.decisions[-1].time
    error = found.log.measured[:, 4]
    waited = (found.log.time > free - 0.49) & (found.log.time <= free)
    assert error[waited].max() < 0.025
    assert np.all(found.log.modes[found.log.time > free] == Mode.PERMIT)


@pytest.mark.parametrize("fidelity", ["leg", "truss"])
def test_a_runaway_is_braked_before_the_hand_has_gone_a_tenth_of_a_metre(arm, fidelity):
    fault = FaultConfig(kind="runaway", drive="L10", start_s=2.0, size=1.0)
    run = run_with(fault, duration=5.0, fidelity=fidelity)
    found = run.supervised
    assert [(one.after, one.cause) for one in found.decisions] == [
        (Mode.HOLD, Cause.TRACKING),
        (Mode.STOP, Cause.RUNAWAY),
    ]
    # It leaves at 0.25 m/s. Held from 40 mm on and stopped 20 mm later, each seen up to a period of
    # 1/32 s late, and 2 / 64 s to the brakes: 24 mm; and what it swings on.
    assert 0.060 < farthest(run, arm) < 0.1
    assert found.safe


def test_a_runaway_next_to_the_base_whose_kick_loads_other_drives_is_stopped_before_it_hits(arm):
    # At this moment the whole arm leaves at 0.4 m/s, 82 mm from the pallet; without brakes it hits.
    run = run_with(FaultConfig(kind="runaway", drive="L3", start_s=10.0, size=-1.0), duration=15.0)
    found = run.supervised
    assert found.decisions[0].cause == Cause.FORCE
    assert (found.decisions[-1].after, found.decisions[-1].cause) == (Mode.STOP, Cause.RUNAWAY)
    assert found.safe and run.data.clearance.min() > 0.01


def test_an_operator_releases_a_retracted_arm_and_it_is_held_before_the_same_thing_again():
    scenario = load_scenario("trajectory_4_obstructed").config
    scenario.motion.tip_speed_mm_per_s = 45.0
    scenario.supervisor.patience_s = 0.5
    bench = Bench(scenario, command=RUN)

    def until(mode, seconds=10.0):
        end = bench.context.get_time() + seconds
        while bench["motion_supervisor.mode"] != mode:
            bench.advance(1.0 / 16.0)
            assert bench.context.get_time() < end
        return bench["tip_path_source.tip"][0]

    bench.advance(47.0)
    held = until(Mode.HOLD)
    until(Mode.RETRACT)
    bench.advance(4.0)
    assert bench["tip_path_source.phase"] == RETRACTING
    # Running on is going back; holding and running is going out.
    bench.command(HOLD)
    bench.advance(2.0)
    assert bench["motion_supervisor.mode"] == Mode.RETRACT
    there = bench["tip_path_source.tip"]
    assert there[1] == 0.0 and there[0] < held - 0.02
    bench.command(RUN)
    until(Mode.PERMIT, seconds=0.25)
    bench.advance(0.5)
    assert bench["tip_path_source.phase"] == EXTENDING
    assert bench["motion_supervisor.command"] == RUN
    # Held before the same thing, where it was held before: to what it goes in two looks.
    assert until(Mode.HOLD) == pytest.approx(held, abs=3e-3)
    assert bench["clearance_monitor.clearance"][0] > 0.03
