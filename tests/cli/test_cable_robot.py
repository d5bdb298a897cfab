"""Cable robot scenarios at the command line: what is shown, refused and kept."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
import yaml

# In a fresh checkout the first command of each kind waits for numba's compilation.
pytestmark = pytest.mark.timeout(300)


def write_scenario(folder, **changes):
    """`task.yaml`: statics of CAROCA in its middle, or as changed."""
    scenario = {
        "machine": "cable_robot",
        "robot": "caroca",
        "statics": {"poses": [{"position_m": [0.0, 0.0, 1.2]}]},
    }
    (folder / "task.yaml").write_text(yaml.safe_dump(scenario | changes))


def test_the_planar_example_is_as_derived_and_not_as_printed(pips_here, tmp_path):
    assert pips_here("simulate", "planar_example", "--out", "out").code == 0
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    (pose,) = summary["poses"]
    shortest = np.array(pose["shortest_tensions_N"])
    np.testing.assert_allclose(shortest, np.array([2.0, -1.0, -2.0, 1.0]) / np.sqrt(20.0))
    printed = np.array([0.2, -0.1, -0.2, 0.1])  # CABLE-96, section 3.2
    np.testing.assert_allclose(shortest, np.sqrt(5.0) * printed, atol=1e-12)
    (null_vector,) = np.array(pose["null_space"])
    np.testing.assert_allclose(null_vector / null_vector[0], [1.0, -1.0, 1.0, -1.0], atol=1e-12)
    motion = np.array(pose["certificate_motion"])
    np.testing.assert_allclose(motion[:2], 0.0, atol=1e-12)
    assert motion[2] > 0.0  # counter-clockwise
    assert (pose["kinematically_stable"], pose["statically_stable"]) == (False, False)
    with (tmp_path / "out/cables.csv").open() as file:
        rows = list(csv.DictReader(file))
    np.testing.assert_allclose([float(row["length_m"]) for row in rows], np.sqrt(5.0), atol=1e-8)
    for name in ("summary.html", "summary.png", "figures/pose_1.png", "scenario.yaml"):
        assert (tmp_path / "out" / name).stat().st_size > 100


def test_a_pose_that_does_not_hold_fails_and_says_by_how_much(pips_here, tmp_path):
    down = [0.0, 0.0, -50000.0, 0.0, 0.0, 0.0]
    middle = [{"position_m": [0.0, 0.0, 1.2]}]
    write_scenario(tmp_path, statics={"poses": middle, "wrench_N": down})
    outcome = pips_here("simulate", "task.yaml", "--out", "out")
    assert outcome.code == 1
    assert "pose 1: no tensions within 1 .. 10000 N hold it; they miss by" in outcome.out


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"robot": "carocka"}, "did you mean 'caroca'"),
        ({"statics": {"poses": [{"position_m": [9.0, 0.0, 1.0]}]}}, "lies outside the frame"),
        ({"statics": {"wrench_N": [1.0, 2.0, 3.0], "poses": [{"position_m": [0, 0, 1]}]}},
         "statics.wrench_N = 3 numbers; must be 6"),
        ({"statics": {"length_m": -1.0}}, "statics.length_m = -1 m; must be >= 0"),
        ({"task": "survey", "survey": {"panels": ["port_9"]}, "robot": "radiator_crossed"},
         "unknown panel 'port_9'"),
        ({"task": "survey"}, "lies outside the frame"),
        ({"task": "survey", "robot": "planar_example"}, "a planar robot"),
        ({"task": "survey", "survey": {"standoff_m": 9.0}}, "survey.standoff_m = 9 m; must be"),
        ({"task": "survey", "robot": "radiator_crossed",
          "survey": {"defects": {"smallest_mm": 9.0, "largest_mm": 3.0}}}, "9 .. 3 mm; must be"),
        ({"task": "cable_break", "cable_break": {"cable": 9}}, "cable_break.cable = 9; must be"),
        ({"task": "cable_break", "robot": "radiator_crossed",
          "cable_break": {"pose": {"position_m": [0.0, 0.0, 9.0]}}}, "lies outside the frame"),
        ({"task": "cable_break", "cable_break": {"time_s": 20.0}}, "20 s of 10 s; must be"),
        ({"task": "cable_break", "robot": "radiator_crossed",
          "cable_break": {"pose": {"position_m": [0.0, 2.4, -0.2]}}},
         "inside a panel, door or sill"),
        ({"task": "survey", "robot": "radiator_crossed", "survey": {
            "overlap": 0.8, "camera": {"width": 160, "height": 120, "field_of_view_deg": 5.0}}},
         "views of the survey = "),
        ({"task": "survey", "robot": "radiator_crossed", "survey": {"defects": {"count": 0}}},
         "survey.defects (count, new, grown, cleaned): debris to clean = 3; must be at most 0"),
        ({"task": "workspace", "robot": "planar_example"}, "a planar robot"),
        ({"task": "workspace", "workspace": {"cell_m": 0.0}}, "workspace.cell_m = 0 m; must be"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_refused_on_one_line(pips_here, tmp_path, changes, message):
    write_scenario(tmp_path, **changes)
    outcome = pips_here("simulate", "task.yaml", "--out", "out")
    assert (outcome.code, outcome.out) == (2, "")
    assert message in outcome.err and outcome.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("mass_kg: 150.0", "mass_kg: 0.0", "mass_kg = 0.0; must be > 0"),
        ("axial_stiffness_N: 4.0e+6", "axial_stiffness_N: -4.0e+6", "must be > 0"),
        ("tension_max_N: 10000.0", "tension_max_N: 0.5", "1 .. 0.5 N; must be rising"),
        ("- {anchor_m: [-3.5, -2.0, 3.5], attachment_m: [0.6, -0.3, -0.2]}\n", "", ""),
        ("[-0.6, 0.3, 0.2]", "[0.6, -0.3, -0.2]", "cables 1 and 2 have the same ends"),
        ("[-0.6, 0.3, 0.2]", "[.inf, 0.3, 0.2]", "inf"),
        (
            "region:",
            "winch: {encoder_step_mm: 1.0e+6}\nregion:",
            "encoder_step_mm = 1e+06; must be",
        ),
    ],
)
def test_a_robot_that_is_none_ends_with_one_line_and_code_2(pips_here, tmp_path, old, new, message):
    from pips_drake.scene.packages import find_file

    text = find_file("cable robot", "caroca").read_text()
    assert old in text
    changed = text.replace(old, new, 1)
    if not new:  # three cables fewer: five are left
        changed = "".join(
            line for line in text.splitlines(keepends=True) if "anchor_m: [3.5, 2.0" not in line
        ).replace(old, "", 1)
        message = "cables = 5; must be >= 6, its freedoms"
    (tmp_path / "own.yaml").write_text(changed)
    write_scenario(tmp_path, robot="own.yaml")
    outcome = pips_here("simulate", "task.yaml", "--out", "out")
    assert (outcome.code, outcome.out) == (2, "")
    assert message in outcome.err and outcome.err.count("\n") == 1
    assert not (tmp_path / "out").exists()
