"""The shipped scenarios with faults end as they say: at rest, clear, and the reason is known."""

from __future__ import annotations

import numpy as np
import pytest

from pips_drake.scenarios import load_scenario
from pips_drake.scene.packages import list_names
from pips_drake.serpentine.motion_words import DONE, EXTENDING
from pips_drake.serpentine.runs.check import check
from pips_drake.serpentine.runs.simulate import run_station
from pips_drake.serpentine.station import load_setup
from pips_drake.serpentine.supervision import Cause, Mode

#: What is decided, why, where the tip's motion ends, and no earlier than, s.
OUTCOMES = {
    "fault_box_1_encoders": ([Mode.HOLD, Mode.STOP], Cause.TRACKING, EXTENDING, 0.0),
    "fault_dead_encoder": ([Mode.HOLD, Mode.STOP], Cause.ENCODER, EXTENDING, 10.0),
    "fault_displaced_payload": ([Mode.HOLD, Mode.RETRACT], Cause.CLEARANCE, DONE, 0.0),
    "fault_disturbance": ([Mode.HOLD, Mode.PERMIT], Cause.FORCE, DONE, 30.0),
    "fault_jam": ([Mode.HOLD, Mode.STOP], Cause.TRACKING, EXTENDING, 20.0),
    "fault_runaway": ([Mode.HOLD, Mode.STOP], Cause.TRACKING, EXTENDING, 10.0),
}


def test_every_fault_scenario_has_an_asserted_outcome():
    assert {name for name in list_names("scenario") if name.startswith("fault_")} == set(OUTCOMES)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", OUTCOMES)
def test_a_fault_is_noticed_and_the_run_ends_at_rest_and_clear(name):
    modes, cause, phase, earliest = OUTCOMES[name]
    scenario = load_scenario(name).config
    run = run_station(scenario, load_setup(scenario))
    found = run.supervised
    assert [one.after for one in found.decisions] == modes
    assert found.decisions[0].cause == cause and found.decisions[0].time >= earliest
    assert found.phase == phase
    assert found.safe and run.data.clearance.min() > 0.0
    assert bool(found.failures()) == (modes[-1] != Mode.PERMIT)
    # Without the fault nothing of it would happen: the supervisor leaves a sound run alone.
    assert np.all(found.log.modes[found.log.time < found.decisions[0].time] == Mode.PERMIT)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_plan_knows_nothing_of_a_displaced_payload():
    scenario = load_scenario("fault_displaced_payload").config
    assert check(scenario, name="displaced").passed
