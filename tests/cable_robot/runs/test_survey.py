"""A survey from its scenario to its report, against what was painted on the panels."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
import yaml

from pips_drake.cable_robot.defect_map import compare_with_truth
from pips_drake.cable_robot.defects import Defect
from pips_drake.cable_robot.panels import PANEL_LENGTH, PANEL_WIDTH
from pips_drake.scenarios import load_scenario, simulate
from pips_drake.scene.packages import scenarios_directory

pytestmark = [pytest.mark.slow, pytest.mark.render]


def write_scenario(folder, **survey):
    """The shipped survey, of one panel of each side and at rest, or as changed."""
    file = scenarios_directory() / "radiator_survey.yaml"
    scenario = yaml.safe_load(file.read_text())
    scenario["survey"] |= {"panels": ["port_2", "starboard_4"], "flight": "rest"}
    scenario["survey"]["defects"] |= {"count": 20, "new": 3, "grown": 3, "cleaned": 2}
    scenario["survey"] |= survey
    (folder / "small.yaml").write_text(yaml.safe_dump(scenario))
    return folder / "small.yaml"


@pytest.fixture(scope="module")
def survey(tmp_path_factory):
    folder = tmp_path_factory.mktemp("survey")
    verdict = simulate(load_scenario(str(write_scenario(folder))), out=folder / "out")
    return verdict, folder / "out"


def rows_of(file):
    with file.open() as text:
        return list(csv.DictReader(text))


def truth_of(file):
    return [
        Defect(
            kind=row["kind"],
            panel=row["panel"],
            u=float(row["u_m"]),
            v=float(row["v_m"]),
            size_m=1e-3 * float(row["size_mm"]),
            width_m=1e-3 * float(row["size_mm"]),
        )
        for row in rows_of(file)
    ]


def test_every_defect_from_five_millimetres_on_is_found_where_it_is(survey):
    verdict, _ = survey
    assert verdict.passed
    for label in ("before", "after"):
        numbers = verdict.summary[f"survey_{label}"]
        large = [row for row in numbers["by_size"] if row["from_mm"] >= 5.0]
        assert sum(row["defects"] for row in large) >= 10
        assert all(row["found"] == row["defects"] for row in large)
        assert numbers["coverage_share"] > 0.999
        assert numbers["map_error_max_m"] <= numbers["map_error_predicted_m"] < 0.02
        # Lengths are measured to two pixels.
        assert numbers["size_error_max_m"] < 2e-3


def test_both_surveys_together_say_what_the_mission_did(survey):
    verdict, folder = survey
    before, after = (truth_of(folder / f"truth_{label}.csv") for label in ("before", "after"))
    places = [{(d.panel, d.u, d.v): d.size_m for d in part} for part in (before, after)]
    compared = verdict.summary["comparison"]
    assert len(compared["new"]) == len(places[1].keys() - places[0].keys()) == 3
    assert len(compared["gone"]) == len(places[0].keys() - places[1].keys()) == 2
    both = places[0].keys() & places[1].keys()
    grown = [place for place in both if places[1][place] > places[0][place] + 1e-4]
    assert len(compared["grown"]) == len(grown) == 3


def test_a_mirrored_or_shifted_map_would_be_noticed(survey):
    verdict, folder = survey
    tolerance = verdict.summary["survey_before"]["map_error_predicted_m"]
    truth = truth_of(folder / "truth_before.csv")
    found = [
        replace(defect, u=float(row["u_m"]), v=float(row["v_m"]), panel=row["panel"])
        for row in rows_of(folder / "findings_before.csv")
        for defect in truth[:1]
    ]
    maps = {
        "as it is": found,
        "mirrored along u": [replace(f, u=PANEL_LENGTH - f.u) for f in found],
        "mirrored along v": [replace(f, v=PANEL_WIDTH - f.v) for f in found],
        "shifted": [replace(f, u=f.u + 1.5 * tolerance) for f in found],
        "port for starboard": [
            replace(f, panel={"port_2": "starboard_4", "starboard_4": "port_2"}[f.panel])
            for f in found
        ],
    }
    for words, one in maps.items():
        named = [type("Named", (), {**vars(f), "name": str(k)})() for k, f in enumerate(one)]
        recall = compare_with_truth(named, truth, tolerance).recall()
        assert (recall == 1.0) == (words == "as it is"), words
        assert words == "as it is" or recall < 0.3


def test_the_report_has_every_finding_with_its_picture(survey):
    verdict, folder = survey
    page = (folder / "report.html").read_text()
    findings = rows_of(folder / "findings_after.csv")
    assert len(findings) == verdict.summary["survey_after"]["findings"] > 0
    for row in findings:
        assert f'<tr id="{row["name"]}">' in page
    assert page.count("data:image/png;base64,") >= len(findings) + 3
    assert "http" not in page  # opens without a network
    for name in ("map_before.png", "map_after.png", "places.png", "recall.png"):
        assert (folder / "figures" / name).stat().st_size > 10_000
    assert (folder / "replay.html").stat().st_size > 1_000_000
    views = rows_of(folder / "views_before.csv")
    assert len(views) == verdict.summary["survey_before"]["pictures"]
    assert np.all(np.diff([float(row["time_s"]) for row in views]) > 0.0)


def test_the_same_seed_gives_the_same_map(survey, tmp_path):
    _, folder = survey
    simulate(load_scenario(str(write_scenario(tmp_path))), out=tmp_path / "again")
    for name in ("findings_after.csv", "comparison.csv", "report.html"):
        assert (tmp_path / "again" / name).read_bytes() == (folder / name).read_bytes()


def test_a_survey_that_looks_from_too_far_misses_small_ones_and_says_which(tmp_path):
    file = write_scenario(
        tmp_path,
        after_mission=False,
        panels=["port_2"],
        camera={"width": 320, "height": 240},
    )
    verdict = simulate(load_scenario(str(file)), out=tmp_path / "out")
    assert not verdict.passed
    assert "missed" in verdict.failures[0] and "mm" in verdict.failures[0]
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    assert len(summary["survey_before"]["missed_names"]) == summary["survey_before"]["missed"] > 0
