"""The shipped scenarios with faults end as they say: at rest, clear, and the reason is known."""

from __future__ import annotations

from itertools import groupby

import numpy as np
import pytest

from pips_drake.scenarios import load_scenario
from pips_drake.scene.packages import list_names
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.motion_words import DONE, EXTENDING
from pips_drake.serpentine.runs.assessment import Assessment
from pips_drake.serpentine.runs.check import check
from pips_drake.serpentine.runs.simulate import run_station
from pips_drake.serpentine.station import load_setup
from pips_drake.serpentine.supervision import Cause, Mode

#: What is decided, why at first, where the tip's motion ends, and no earlier than, s.
OUTCOMES = {
    # The controller believes in another arm all the time: the first decision, or none.
    "fault_anchor": ([Mode.HOLD, Mode.STOP], Cause.TRACKING, EXTENDING, 0.0),
    "fault_biased_encoder": ([Mode.HOLD, Mode.STOP], Cause.TRACKING, EXTENDING, 10.0),
    "fault_box_1_encoders": ([Mode.HOLD, Mode.STOP], Cause.TRACKING, EXTENDING, 0.0),
    "fault_dead_encoder": ([Mode.HOLD, Mode.STOP], Cause.ENCODER, EXTENDING, 10.0),
    "fault_displaced_payload": ([Mode.HOLD, Mode.RETRACT], Cause.CLEARANCE, DONE, 0.0),
    "fault_disturbance": ([Mode.HOLD, Mode.PERMIT], Cause.FORCE, DONE, 30.0),
    "fault_jam": ([Mode.HOLD, Mode.STOP], Cause.TRACKING, EXTENDING, 20.0),
    "fault_late": ([Mode.HOLD, Mode.PERMIT], Cause.TRACKING, DONE, 20.0),
    "fault_quantised_encoder": ([Mode.HOLD, Mode.STOP], Cause.TRACKING, EXTENDING, 0.0),
    "fault_runaway": ([Mode.HOLD, Mode.STOP], Cause.TRACKING, EXTENDING, 10.0),
    "fault_segment_length": ([], Cause.NONE, DONE, 0.0),
    "fault_slow": ([Mode.HOLD, Mode.STOP], Cause.TRACKING, EXTENDING, 10.0),
    "fault_stuck_encoder": ([Mode.HOLD, Mode.STOP], Cause.TRACKING, EXTENDING, 20.0),
    # It falls towards the pallet before it is out of its place.
    "fault_weak_actuator": ([Mode.HOLD, Mode.STOP], Cause.CLEARANCE, EXTENDING, 10.0),
}


#: How far the arm may get out of its way, m. A drive runs away by 40 mm until it is held, and by 20
#: more until it is stopped; at the hand's 0.25 m/s the looks and the brakes come 24 mm late.
FARTHEST = {"fault_runaway": 0.1}


def test_every_fault_scenario_has_an_asserted_outcome():
    assert {name for name in list_names("scenario") if name.startswith("fault_")} == set(OUTCOMES)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", OUTCOMES)
def test_a_fault_is_noticed_and_the_run_ends_at_rest_and_clear(arm, name):
    modes, cause, phase, earliest = OUTCOMES[name]
    scenario = load_scenario(name).config
    setup = load_setup(scenario)
    run = run_station(scenario, setup)
    found = run.supervised
    # A mode may go on for another reason.
    assert [mode for mode, _ in groupby(one.after for one in found.decisions)] == modes
    first = found.decisions[0].time if modes else np.inf
    assert not modes or (found.decisions[0].cause == cause and first >= earliest)
    assert found.phase == phase
    assert found.safe and run.data.clearance.min() > 0.0
    assert bool(found.failures()) == (modes[-1:] not in ([], [Mode.PERMIT]))
    if name in FARTHEST:
        joints = run.data.joints, run.data.commanded_joints
        points, wanted = (kinematics.spine_points(arm, one) for one in joints)
        assert np.linalg.norm(points - wanted, axis=-1).max() < FARTHEST[name]
        assert found.decisions[-1].cause == Cause.RUNAWAY
    # Without the fault nothing of it would happen: the supervisor leaves a sound run alone.
    assert np.all(found.log.modes[found.log.time < first] == Mode.PERMIT)
    # Whether it was noticed or not, the verdict says what was wrong.
    judged = Assessment.of(scenario, setup, run.data)
    assert found.failures() + judged.failures()


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_plan_knows_nothing_of_a_displaced_payload():
    scenario = load_scenario("fault_displaced_payload").config
    assert check(scenario, name="displaced").passed


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_plan_knows_nothing_of_a_longer_segment():
    scenario = load_scenario("fault_segment_length").config
    scenario.certificate.enabled = False
    scenario.faults[0].size = 100.0
    with_fault = check(scenario, name="longer")
    scenario.faults = []
    without = check(scenario, name="longer")
    assert with_fault.passed and with_fault.summary == without.summary
