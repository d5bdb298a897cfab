"""A cable robot's scenarios: what they may say."""

from __future__ import annotations

import re

import pytest

from pips_drake.cable_robot.scenario import CableRobotScenario
from pips_drake.cable_robot.tension_methods import METHODS
from pips_drake.cable_robot.words import TENSION_METHODS
from pips_drake.config import load_yaml
from pips_drake.errors import InputError

LITTLE = "machine: cable_robot\nrobot: caroca\n"


def load(folder, text):
    (folder / "scenario.yaml").write_text(text)
    return load_yaml(CableRobotScenario, folder / "scenario.yaml")


def test_tension_methods_have_the_names_that_scenarios_may_say():
    assert set(TENSION_METHODS) == set(METHODS)


def test_machine_and_robot_are_enough(tmp_path):
    scenario = load(tmp_path, LITTLE)
    assert scenario.task == "statics" and len(scenario.statics.poses) == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("machine: cable_robot\n", "robot = ''; must be a shipped robot or a file"),
        (LITTLE + "task: dance\n", "task = dance; must be"),
        (LITTLE + "statics: {poses: []}\n", "statics.poses = none"),
        (LITTLE + "statics: {poses: [{position_m: [1, 2]}]}\n", "must be three numbers"),
        (LITTLE + "statics: {poses: [{position_m: [.nan, 0, 0]}]}\n", "nan"),
        (LITTLE + "statics: {method: luck}\n", "statics.method = luck; must be"),
        (LITTLE + "statics: {wrench_N: [1]}\n", "none, 3 or 6 numbers"),
        (LITTLE + "station: {control: luck}\n", "station.control = luck; must be"),
        (LITTLE + "station: {disturbance_N: [1]}\n", "station.disturbance_N = 1 numbers"),
        (LITTLE + "survey: {flight: balloon}\n", "survey.flight = balloon; must be"),
        (LITTLE + "checks: {kinematically_stable: maybe}\n", "none or true or false"),
    ],
)
def test_a_bad_scenario_is_refused_with_its_field(tmp_path, text, message):
    with pytest.raises(InputError, match=re.escape(message)):
        load(tmp_path, text)
