"""A cable that breaks: held or not, in the swing and at rest."""

from __future__ import annotations

import json

import numpy as np
import pytest

from pips_drake.scenarios import load_scenario, simulate
from pips_drake.twin.recording import read_csv

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", params=["cable_break", "cable_break_struck"])
def run(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp(request.param) / "out"
    return request.param, simulate(load_scenario(request.param), out=folder), folder


def test_one_shipped_case_can_be_held_and_one_cannot(run):
    name, verdict, _ = run
    summary = verdict.summary
    if name == "cable_break":
        assert verdict.passed
        assert min(summary["clearance_sampled_min_m"], summary["rest_clearance_m"]) >= 0.1
    else:
        assert not verdict.passed
        assert summary["rest_clearance_m"] < 0.0 and summary["clearance_sampled_min_m"] < 0.005
        assert "at rest without the cable" in verdict.failures[0]
        assert "the platform touches" in verdict.failures[1]


def test_the_swing_ends_where_the_rest_posture_is(run):
    name, verdict, folder = run
    if name == "cable_break_struck":
        pytest.skip("the panel is in the way of the rest")
    series = read_csv(folder / "platform.csv")
    last = np.array([series.column(f"{axis}_m")[-1] for axis in "xyz"])
    rest = np.array(verdict.summary["rest_position_m"])
    # It still swings a little after ten seconds.
    assert np.linalg.norm(last - rest) < 0.02
    moved = np.array([series.column(f"{axis}_m")[0] for axis in "xyz"]) - rest
    assert np.linalg.norm(moved) > 0.1


def test_the_broken_cable_pulls_no_more_and_none_pushes(run):
    _, verdict, folder = run
    series = read_csv(folder / "platform.csv")
    broken = series.column(f"tension_{verdict.summary['cable']}_N")
    assert np.all(broken[series.time < 0.49] > 10.0)
    assert np.all(broken[series.time > 0.52] == 0.0)
    assert all(np.all(series.column(f"tension_{k}_N") >= 0.0) for k in range(1, 9))


def test_the_folder_has_what_one_looks_at(run):
    _, _, folder = run
    for name in ("replay.html", "summary.html", "summary.png", "figures/swing.png",
                 "figures/before.png", "figures/rest.png", "diagram.dot"):  # fmt: skip
        assert (folder / name).stat().st_size > 1000
    assert json.loads((folder / "summary.json").read_text())["real_time_rate"] > 0.0


def test_a_push_and_hanging_cables_change_the_swing(run, tmp_path):
    name, verdict, _ = run
    if name == "cable_break_struck":
        pytest.skip("once is enough")
    pushed = {
        "station.sag": "true",
        "station.disturbance_N": "[0, -150, 0, 0, 0, 0]",
        "station.disturbance_start_s": "0.5",
        "station.disturbance_end_s": "1.5",
        "cable_break.duration_s": "3",
    }
    other = simulate(load_scenario(name, pushed), out=tmp_path / "out")
    # Towards the hinge: nearer to the panel.
    least = [found.summary["clearance_sampled_min_m"] for found in (verdict, other)]
    assert least[1] < least[0] - 0.05
