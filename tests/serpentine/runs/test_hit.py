"""What a run hit, when and how hard, against the distances between the plant's steps."""

from __future__ import annotations

import numpy as np
import pytest

from pips_drake.scenarios import load_scenario
from pips_drake.serpentine.fault_config import FaultConfig
from pips_drake.serpentine.runs.hit import find_hit
from pips_drake.serpentine.runs.judgement import judge_run
from pips_drake.serpentine.runs.placed_arm import place_arm
from pips_drake.serpentine.runs.run import run_station
from pips_drake.serpentine.station import load_setup
from pips_drake.twin.clearance import ClearanceQuery
from pips_drake.twin.motion_record import RecordedSteps

STEP = 1.0 / 512.0


def pushed(force):
    """Trajectory 4's beginning, the hand pushed along y from 0.25 s on; nobody supervises."""
    scenario = load_scenario("trajectory_4").config
    scenario.duration_s = 1.0
    scenario.camera.enabled = scenario.supervisor.enabled = scenario.certificate.enabled = False
    push = FaultConfig(kind="disturbance", start_s=0.25, force_n=[0.0, force, 0.0])
    scenario.faults = [push] if force else []
    return scenario, load_setup(scenario)


@pytest.fixture(scope="module")
def collided():
    """A run in which the hand is pushed into the pallet's wall."""
    scenario, setup = pushed(900.0)
    run = run_station(scenario, setup)
    return scenario, setup, run, judge_run(scenario, setup, run)


@pytest.mark.slow
def test_a_run_that_collides_says_what_it_hit_when_and_how_hard(collided):
    _, _, run, judgement = collided
    told = judgement.summary
    robot, other = told["hit_pair"]
    assert robot.startswith("prototype::") and other == "pallet::pallet"
    assert 0.25 < told["hit_time_s"] <= run.data.time[np.argmax(run.data.clearance <= 0.0)]
    (sentence,) = [one for one in judgement.failures if " hit " in one]
    assert f"{robot} hit {other} at {told['hit_time_s']:.3f} s" in sentence
    # The hand and what moves with it: more than the last segment, less than the arm (207 kg).
    assert 1.0 < told["hit_effective_mass_kg"] < 207.0
    speed, mass = told["hit_closing_speed_m_per_s"], told["hit_effective_mass_kg"]
    assert told["hit_energy_j"] == pytest.approx(0.5 * mass * speed**2, rel=1e-12)


@pytest.mark.slow
def test_the_closing_speed_is_the_distance_lost_in_the_last_step(collided):
    scenario, setup, run, judgement = collided
    placed, told = place_arm(scenario, setup), judgement.summary
    k = int(np.argmin(np.abs(run.steps.times - told["hit_time_s"])))
    assert run.steps.times[k] == told["hit_time_s"]
    distances = []
    for row in (k - 1, k):
        root = placed.diagram.CreateDefaultContext()
        mine = placed.plant.GetMyMutableContextFromRoot(root)
        placed.plant.SetPositions(mine, placed.model, run.steps.states[row, : setup.arm.joints])
        query = placed.scene_graph.get_query_output_port().Eval(
            placed.scene_graph.GetMyContextFromRoot(root)
        )
        near = ClearanceQuery(placed.plant, [placed.model], max_distance=0.1)
        distances.append(near.least(query)[0].distance)
    assert distances[1] <= 0.0 < distances[0], "clear in the step before"
    # A step is 6 mm here, and what turns with the hand makes the rate differ in between.
    lost = (distances[0] - distances[1]) / STEP
    assert told["hit_closing_speed_m_per_s"] == pytest.approx(lost, rel=0.02)


@pytest.mark.slow
def test_contact_acts_on_the_arm(collided):
    """Pushed on, the hand does not go through the wall, which it has met at metres a second: it
    stays within what the engine's compliant contact gives way under 900 N."""
    _, _, run, judgement = collided
    after = run.data.clearance[run.data.time > judgement.summary["hit_time_s"]]
    assert judgement.summary["hit_closing_speed_m_per_s"] > 1.0
    assert len(after) > 10 and -0.01 < after.min() < after[-1] < 0.0


@pytest.mark.slow
def test_a_run_that_touches_nothing_tells_of_no_hit():
    scenario, setup = pushed(0.0)
    run = run_station(scenario, setup)
    assert run.steps is None
    judgement = judge_run(scenario, setup, run)
    assert judgement.failures == ()
    assert not [key for key in judgement.summary if key.startswith("hit_")]


def test_an_arm_that_stands_in_something_does_not_close_in():
    scenario, setup = pushed(0.0)
    moved = FaultConfig(kind="payload_displaced", body="payload::payload")
    # Its middle to x0 = 16.255 in, y0 = 0, z0 = 4 m, where the arm begins.
    moved.offset_mm = [-1365.0, 1842.0, -1154.0]
    scenario.faults = [moved]
    placed = place_arm(scenario, setup)
    home = setup.solver.solve(setup.path, [setup.path.home_arc_length]).joints[0]
    steps = RecordedSteps(
        times=np.zeros(1), states=np.concatenate([home, np.zeros(home.size)])[None]
    )
    hit = find_hit(placed, steps)
    assert hit is not None and hit.pair[1] == "payload::payload"
    assert hit.closing_speed == 0.0 and hit.energy == 0.0
    assert hit.sentence() == f"{hit.pair[0]} touches payload::payload at 0.000 s without closing in"
    # Elsewhere nothing is touched.
    scenario.faults = []
    assert find_hit(place_arm(scenario, setup), steps) is None
