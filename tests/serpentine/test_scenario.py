"""Scenario files: little is needed, everything can be said, and nothing wrong gets through."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
import yaml

from pips_drake.config import dump_yaml, load_yaml
from pips_drake.errors import InputError
from pips_drake.scenarios import load_scenario
from pips_drake.scene.packages import list_names
from pips_drake.serpentine.scenario import SerpentineScenario

MINIMAL = "machine: serpentine\npath: trajectory_4\n"

#: Every field, with another value than the default where there is one.
ONE_OF_EVERYTHING = """
machine: serpentine
description: everything that can be said
arm: prototype
path: trajectory_3
joints: ""
rail_shift_m: 0.0
scene: trajectory_4
decompose_meshes: true
corner_deviation_in: 0.1
mounting: pad_below
mounting_position_m: [0.5, -0.5, 1.0]
motion:
  profile: fastest
  tip_speed_max_mm_per_s: 30.0
  limit_share: 0.8
  smoothing_s: 0.25
  tip_speed_mm_per_s: 20.0
  ramp_s: 1.5
  dwell_s: 2.5
  retract: false
  settle_s: 0.5
solver:
  tolerance_in: 0.1
  max_iterations: 20
actuation:
  fidelity: joint
  compensate_deflection: false
  show_uncompensated: true
clocks:
  plant_hz: 1024
  control_hz: 32
  clearance_hz: 16
  record_hz: 64
integration:
  scheme: radau3
  accuracy: 1.0e-6
supervisor:
  enabled: false
  hold_clearance_mm: 22.0
  resume_clearance_mm: 30.0
  retract_clearance_mm: 12.0
  own_hold_clearance_mm: 6.0
  own_resume_clearance_mm: 9.0
  tracking_hold_mm: 30.0
  tracking_resume_mm: 20.0
  tracking_growth_mm: 15.0
  force_fraction_hold: 0.9
  force_fraction_resume: 0.7
  closing_speed_mm_per_s: 2.0
  give_way_mm: 4.0
  hold_ramp_s: 0.75
  quiet_s: 0.75
  patience_s: 3.0
  safe_speed_fraction: 0.25
  overtime_s: 30.0
checks:
  clearance_min_mm: 30.0
  self_clearance_min_mm: 12.0
  tracking_error_max_mm: 8.0
  force_fraction_max: 0.9
  speed_fraction_max: 0.8
  joint_overrun_max_deg: 0.2
  rail_overrun_max_mm: 0.5
faults:
  - {kind: jam, drive: L5, start_s: 1.0, duration_s: 2.0}
  - kind: payload_displaced
    body: payload::payload
    offset_mm: [0.0, 10.0, 0.0]
certificate:
  enabled: false
  tolerance_mm: 1.0
  joint_error_deg: 0.1
  rail_error_mm: 2.0
view:
  direction: [1.0, 0.0, 0.5]
camera:
  enabled: true
  target_body: payload::payload
  target_m: [1.0, 2.0, 3.0]
  field_of_view_deg: 40.0
  width: 320
  height: 240
  roll_deg: 0.0
  picture_period_s: 0.25
  fps: 24
  range_near_m: 0.2
  range_far_m: 2.0
  focus_distance_m: 0.5
  aperture_m: 0.001
  blur_max_px: 1.0
  incidence_max_deg: 60.0
  pan_limit_deg: 45.0
  tilt_limit_deg: 50.0
  pan_tilt_speed_deg_per_s: 20.0
  joint_margin_deg: 1.0
  joint_speed_share: 0.25
clearance_range_m: 0.4
duration_s: 0.0625
seed: 7
"""


def load(tmp_path: Path, text: str, **overrides: str) -> SerpentineScenario:
    file = tmp_path / "scenario.yaml"
    file.write_text(text, encoding="utf-8")
    return load_yaml(SerpentineScenario, file, overrides=overrides)


def leaves(value: object, prefix: str = "") -> dict[str, object]:
    """Dotted names and values of a dataclass's fields."""
    if not dataclasses.is_dataclass(value):
        return {prefix: value}
    found: dict[str, object] = {}
    for item in dataclasses.fields(value):
        found |= leaves(getattr(value, item.name), f"{prefix}.{item.name}".lstrip("."))
    return found


def test_a_path_is_all_that_a_scenario_needs(tmp_path):
    scenario = load(tmp_path, MINIMAL)
    assert scenario == SerpentineScenario(path="trajectory_4")
    # DESIGN and FACTS: what the defaults are.
    assert (scenario.arm, scenario.mounting) == ("prototype", "pad")
    assert scenario.motion.tip_speed_mm_per_s == 25.0
    clocks = scenario.clocks
    assert (clocks.plant_hz, clocks.control_hz, clocks.clearance_hz) == (512, 64, 32)
    assert scenario.actuation.compensate_deflection
    assert scenario.solver.tolerance_in == 1e-9


def test_one_of_everything_sets_every_field(tmp_path):
    scenario, default = load(tmp_path, ONE_OF_EVERYTHING), SerpentineScenario()
    values, defaults = leaves(scenario), leaves(default)
    missing = set(values) - set(leaves_of_yaml(yaml.safe_load(ONE_OF_EVERYTHING)))
    assert not missing, f"new fields, to be added to ONE_OF_EVERYTHING: {sorted(missing)}"
    # These have one allowed value, or the default is what they should say here (a path is given).
    same = {"machine", "arm", "actuation.fidelity", "joints", "rail_shift_m"}
    assert {name for name in values if values[name] == defaults[name]} == same


def leaves_of_yaml(data: object, prefix: str = "") -> list[str]:
    if not isinstance(data, dict):
        return [prefix]
    return [
        leaf
        for key, item in data.items()
        for leaf in leaves_of_yaml(item, f"{prefix}.{key}".lstrip("."))
    ]


@pytest.mark.parametrize("text", [MINIMAL, ONE_OF_EVERYTHING], ids=["minimal", "everything"])
def test_what_is_dumped_loads_equal(tmp_path, text):
    scenario = load(tmp_path, text)
    dumped = dump_yaml(scenario)
    assert load(tmp_path, dumped) == scenario
    assert dump_yaml(load(tmp_path, dumped)) == dumped
    assert sorted(leaves_of_yaml(yaml.safe_load(dumped))) == sorted(leaves(scenario))


@pytest.mark.parametrize("name", list_names("scenario"))
def test_shipped_scenarios_load_and_say_what_they_are(name):
    scenario = load_scenario(name)
    assert scenario.config.description


def test_overrides_come_last(tmp_path):
    scenario = load(
        tmp_path, MINIMAL, **{"motion.dwell_s": "2", "actuation.compensate_deflection": "false"}
    )
    assert scenario.motion.dwell_s == 2.0
    assert not scenario.actuation.compensate_deflection


def test_default_objects_are_not_shared():
    one, other = SerpentineScenario(), SerpentineScenario()
    one.motion.dwell_s = 99.0
    one.mounting_position_m[0] = 99.0
    assert other == SerpentineScenario()


BAD = {
    "machine: crane\npath: a": "machine = crane; must be serpentine",
    "machine: serpentine": "path = ''; must be a shipped path or a file, or joints given",
    MINIMAL + "joints: a.csv": "joints = 'a.csv'; must be empty with a path",
    MINIMAL + "rail_shift_m: 1": "rail_shift_m = 1.0; must be 0 with a path",
    "machine: serpentine\njoints: a.csv\nrail_shift_m: 2e3": (
        "rail_shift_m = 2000.0; must be within +-1000"
    ),
    MINIMAL + "mounting: ceiling": (
        "unknown mounting 'ceiling'; known: laboratory, pad, pad_below"
    ),
    MINIMAL + "mounting_position_m: [0, 1]": "mounting_position_m = [0.0, 1.0]; must be 3 numbers",
    MINIMAL + "corner_deviation_in: -1": "corner_deviation_in = -1.0; must be >= 0",
    MINIMAL + "motion: {tip_speed_mm_per_s: 0}": "motion.tip_speed_mm_per_s = 0.0; must be > 0",
    MINIMAL + "motion: {ramp_s: -2}": "motion.ramp_s = -2.0; must be > 0",
    MINIMAL + "motion: {profile: fast}": "motion.profile = fast; must be constant or fastest",
    MINIMAL + "motion: {tip_speed_max_mm_per_s: -1}": "tip_speed_max_mm_per_s = -1.0; must be 0 or",
    MINIMAL + "motion: {limit_share: 1.1}": "motion.limit_share = 1.1; must be 0.01 .. 1",
    MINIMAL + "motion: {smoothing_s: -1}": "motion.smoothing_s = -1.0; must be 0 .. 60",
    MINIMAL + "motion: {dwell_s: -1}": "motion.dwell_s = -1.0; must be >= 0",
    MINIMAL + "motion: {dwell_s: .nan}": "motion.dwell_s = nan; must be a finite number",
    MINIMAL + "motion: {dwel_s: 1}": "unknown key 'dwel_s' (did you mean 'dwell_s'?)",
    MINIMAL + "solver: {tolerance_in: 0}": "solver.tolerance_in = 0.0; must be > 0",
    MINIMAL + "solver: {max_iterations: 0}": "solver.max_iterations = 0; must be >= 1",
    MINIMAL + "actuation: {fidelity: wire}": "actuation.fidelity = wire; must be joint, leg, truss",
    MINIMAL + "actuation: {fidelity: leg}\nintegration: {scheme: radau3}": (
        "actuation.fidelity = leg; must be joint with integration.scheme radau3"
    ),
    MINIMAL + "clocks: {control_hz: 50}": "clocks.control_hz = 50; must be a power of two, 1 or",
    MINIMAL + "clocks: {control_hz: 1024}": "clocks.control_hz = 1024; must be <= plant_hz",
    MINIMAL + "clocks: {plant_hz: 0}": "clocks.plant_hz = 0; must be a power of two, 1 or more",
    MINIMAL + "integration: {scheme: rk4}": "integration.scheme = rk4; must be discrete or radau3",
    MINIMAL + "integration: {accuracy: 0}": "integration.accuracy = 0.0; must be 1e-10 .. 0.01",
    MINIMAL + "checks: {force_fraction_max: 0}": "checks.force_fraction_max = 0.0; must be > 0",
    MINIMAL + "supervisor: {hold_clearance_mm: 25}": (
        "supervisor.resume_clearance_mm = 25.0; must be > hold_clearance_mm (25)"
    ),
    MINIMAL + "supervisor: {resume_clearance_mm: 600}": (
        "clearance_range_m = 0.5; must be > supervisor.resume_clearance_mm"
    ),
    MINIMAL + "view: {direction: [0, 0, 0]}": "direction = [0.0, 0.0, 0.0]; must be three numbers",
    MINIMAL + "camera: {width: 321}": "camera.width = 321; must be even and > 0",
    MINIMAL + "camera: {fps: 0}": "camera.fps = 0; must be > 0",
    MINIMAL + "camera: {range_far_m: 0.05}": "camera.range_far_m = 0.05; must be > range_near_m",
    MINIMAL + "camera: {target_m: [0, 1]}": "camera.target_m = [0.0, 1.0]; must be 3 numbers",
    MINIMAL + "camera: {tilt_limit_deg: 91}": "camera.tilt_limit_deg = 91.0; must be > 0 and <= 90",
    MINIMAL + "clearance_range_m: 0": "clearance_range_m = 0.0; must be > 0",
    MINIMAL + "clearance_range_m: 0.02": "must be > the clearances that checks ask for",
    MINIMAL + "duration_s: -1": "duration_s = -1.0; must be >= 0",
    MINIMAL + "seed: 1.5": "seed = 1.5; must be a whole number",
    MINIMAL + "motion: 3": "motion = 3; must be a mapping",
}


@pytest.mark.parametrize("text", BAD)
def test_a_bad_value_is_refused_in_one_line_that_says_what_is_allowed(tmp_path, text):
    with pytest.raises(InputError) as caught:
        load(tmp_path, text)
    message = str(caught.value)
    assert BAD[text] in message
    assert message.startswith(str(tmp_path / "scenario.yaml")) and "\n" not in message
