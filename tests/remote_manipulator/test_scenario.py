"""Scenarios of the remote manipulator: every field is read, judged and written back."""

from __future__ import annotations

import re
from dataclasses import fields
from typing import Any

import numpy as np
import pytest
import yaml

from pips_drake.config import dump_yaml, load_yaml
from pips_drake.errors import InputError
from pips_drake.remote_manipulator.phases import PHASES, SUPPORTS
from pips_drake.remote_manipulator.runs.run import load_setup
from pips_drake.remote_manipulator.scenario import RemoteManipulatorScenario
from pips_drake.remote_manipulator.script import WORDS, ScriptStep
from pips_drake.scenarios import load_scenario, scenario_descriptions

#: The least that a scenario must say.
LITTLE = "machine: remote_manipulator\noperator: {kind: autopilot, script: [{do: open}]}\n"


def load(folder, text):
    (folder / "scenario.yaml").write_text(text)
    return load_yaml(RemoteManipulatorScenario, folder / "scenario.yaml")


def test_machine_and_operator_are_enough(tmp_path):
    scenario = load(tmp_path, LITTLE)
    assert scenario.operator.script == [ScriptStep(do="open")]
    setup = load_setup(scenario)
    np.testing.assert_array_equal(setup.plant.arm_vector[1:7], setup.config.arm.home)
    assert setup.plant.support == "bay" and setup.jets is None
    assert setup.config.payload.mass_kg == 10000.0


def test_every_field_may_be_stated_and_is_written_back(tmp_path):
    text = """
machine: remote_manipulator
description: everything
payload:
  support: none
  position_m: [9.0, -2.0, -6.0]
  rpy_deg: [1.0, 2.0, 3.0]
  velocity_m_s: [0.01, 0.0, 0.0]
  spin_deg_s: [0.0, 0.1, 0.0]
  limit_cycle: {enabled: true, dead_band_deg: 1.0, torque_N_m: 50.0}
payload_mass_kg: 5000.0
stand_height_m: 3.0
angles_deg: [0.0, 60.0, -90.0, 1.0, -50.0, 2.0]
cae_offset_m: [0.1, 0.0, 0.0]
operator: {kind: random}
program: {collision: report, inhibit: literal, slide_along_walls: true,
  snap_to_right_angles: true, limit_master_rates: false}
dynamics: {plant_hz: 200, orbiter_translates: true}
station: I
video: {enabled: false, width: 320, height: 240, fps: 5, speed: 8.0, insets: [A]}
checks: {phases: [free_flying], inhibits_min: 1, inhibits_max: 9, clearance_min_mm: 5.0,
  docking_zone_m: 0.4, penetration_max_mm: 5.0, tracking_error_max_mm: 50.0}
duration_s: 10.0
seed: 5
"""
    scenario = load(tmp_path, text)
    assert load(tmp_path, dump_yaml(scenario)) == scenario
    default = RemoteManipulatorScenario()
    same = {"machine", "manipulator"}
    for name in {field.name for field in fields(scenario)} - same:
        assert getattr(scenario, name) != getattr(default, name), name
    setup = load_setup(scenario)
    assert setup.config.payload.mass_kg == 5000.0
    np.testing.assert_allclose(setup.plant.arm_vector[:2], [3.0, 0.0])
    assert setup.plant.X_RP is not None
    np.testing.assert_allclose(setup.plant.X_RP.translation(), [9.0, -2.0, -6.0])
    np.testing.assert_allclose(setup.plant.spin, [0.0, np.radians(0.1), 0.0])
    assert setup.jets is not None and setup.jets.dead_band == pytest.approx(np.radians(1.0))
    assert (setup.program.collision, setup.program.inhibit) == ("report", "literal")
    assert setup.program.slide_along_walls and setup.program.snap_to_right_angles
    assert not setup.program.limit_master_rates
    assert setup.plant.time_step == 1 / 200


#: What is changed in `LITTLE`, by dotted name, and what is said of it.
BAD: dict[str, tuple[dict[str, str], str]] = {
    "another place": (
        {"payload.support": "moon"},
        "payload.support = moon; must be none or bay or port",
    ),
    "a held payload that moves": (
        {"payload.velocity_m_s": "[1, 0, 0]"},
        "velocity and spin = not zero; must be zero unless support is none",
    ),
    "a held payload somewhere else": (
        {"payload.position_m": "[1, 2, 3]"},
        "position, rpy or limit cycle = given; must be left out unless support is none",
    ),
    "a flat place": ({"payload.position_m": "[1, 2]"}, "payload.position_m = [1.0, 2.0]; must be"),
    "no such operator": ({"operator.kind": "cat"}, "operator.kind = cat; must be autopilot or"),
    "no script": ({"operator.script": "[]"}, "operator.script = 0 steps; must be some if"),
    "a script too many": (
        {"operator.kind": "random", "duration_s": "1"},
        "operator.script = 1 steps; must be some if, and only if",
    ),
    "no recording": (
        {"operator.kind": "recording", "operator.script": "[]"},
        "operator.recording = ''; must be a file if",
    ),
    "no end": (
        {"operator.kind": "random", "operator.script": "[]"},
        "duration_s = 0.0; must be > 0 with this operator",
    ),
    "days": ({"duration_s": "1e6"}, "duration_s = 1000000.0; must be <= 86400"),
    "no such station": ({"station": "Z"}, "station = Z; must be of A, B, C"),
    "two stations": ({"station": "AB"}, "station = AB; must be of A, B, C"),
    "five angles": ({"angles_deg": "[0, 0, 0, 0, 0]"}, "angles_deg = [0.0, 0.0, 0.0, 0.0, 0.0]"),
    "an odd clock": ({"dynamics.plant_hz": "110"}, "plant_hz = 110; must be a multiple of 20"),
    "a slow clock": ({"dynamics.plant_hz": "20"}, "plant_hz = 20; must be a multiple of 20, 60"),
    "an odd picture": ({"video.width": "161"}, "video.width = 161; must be even"),
    "an inset from nowhere": ({"video.insets": "[Q]"}, "video.insets = Q; must be of A, B"),
    "no such phase": ({"checks.phases": "[landed]"}, "checks.phases = landed; must be of stowed"),
    "few inhibits": ({"checks.inhibits_min": "2"}, "inhibits_max = 0; must be >= inhibits_min"),
    "no penetration": ({"checks.penetration_max_mm": "0"}, "penetration_max_mm = 0.0; must be >"),
    "a wide band": ({"payload.limit_cycle.dead_band_deg": "90"}, "dead_band_deg = 90.0; must be"),
    "NaN": ({"payload_mass_kg": ".nan"}, "payload_mass_kg = nan; must be a finite number"),
    "an unknown key": ({"speed": "1"}, "unknown key 'speed'"),
    "an unknown key inside": ({"program.speed": "1"}, "program: unknown key 'speed'"),
    "an unknown word": ({"operator.script": "[{do: dance}]"}, "unknown step of the script: do"),
    "a step without its number": (
        {"operator.script": "[{do: telescope}]"},
        "step telescope: no to_m; must have one",
    ),
    "a number that a step has not": (
        {"operator.script": "[{do: open, height_m: 1}]"},
        "step open: height_m given; it takes nothing",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_scenario_is_refused_with_its_field(tmp_path, case):
    changes, words = BAD[case]
    plain: Any = yaml.safe_load(LITTLE)
    for dotted, value in changes.items():
        *parents, leaf = dotted.split(".")
        place = plain
        for parent in parents:
            place = place.setdefault(parent, {})
        place[leaf] = yaml.safe_load(value)
        if value == "1e6":
            place[leaf] = 1e6
    with pytest.raises(InputError) as caught:
        load(tmp_path, yaml.safe_dump(plain))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_the_machine_cannot_be_is_refused_before_anything_is_built(tmp_path):
    for field, value, words in (
        ("payload_mass_kg", 1e6, "payload_mass_kg = 1e+06 kg; must be 0 .. 29484 kg"),
        ("manipulator", "nowhere", "unknown manipulator 'nowhere'"),
    ):
        scenario = load(tmp_path, LITTLE)
        setattr(scenario, field, value)
        with pytest.raises(InputError, match=re.escape(words)):
            load_setup(scenario)


def shipped():
    names = []
    for name in scenario_descriptions():
        if load_scenario(name).machine == "remote_manipulator":
            names.append(name)
    return names


def test_shipped_scenarios_are_those_of_the_task_and_use_every_part_of_it():
    names = shipped()
    assert set(names) >= {
        "dock_payload",
        "berth_payload",
        "capture_free_flyer",
        "slide_out",
        "collide_bay_wall",
        "missed_docking",
    }
    words, supports, asked = set(), set(), set()
    for name in names:
        config = load_scenario(name).config
        load_setup(config)
        words |= {step.do for step in config.operator.script}
        supports.add(config.payload.support)
        asked |= set(config.checks.phases)
        assert config.checks.phases, (
            f"{name} asks for no phases, so it could not fail to do its task"
        )
    assert words <= set(WORDS)
    assert supports == set(SUPPORTS)
    assert asked == set(PHASES)
