"""How a run begins: not with bodies in each other."""

from __future__ import annotations

import pytest

from pips_drake.errors import InputError
from pips_drake.remote_manipulator.runs.operators import make_operator
from pips_drake.remote_manipulator.runs.run import load_setup, make_station, run_station
from pips_drake.remote_manipulator.scenario import (
    OperatorConfig,
    PayloadStartConfig,
    RemoteManipulatorScenario,
)
from pips_drake.remote_manipulator.script import ScriptStep


def test_an_arm_inside_a_docked_payload_is_refused_with_both_names_and_what_to_give():
    scenario = RemoteManipulatorScenario(
        payload=PayloadStartConfig(support="port"),
        stand_height_m=4.0,
        operator=OperatorConfig(script=[ScriptStep(do="wait", seconds=1.0)]),
    )
    setup = load_setup(scenario)
    station = make_station(setup, make_operator(scenario, setup).system)
    message = r"and payload are 3\.\d+ m in each other; must be apart: give angles_deg"
    with pytest.raises(InputError, match=message):
        run_station(station, duration=1.0)
