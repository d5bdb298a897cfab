"""`simulate` from Python: scenarios with little and with everything, and ones that must fail."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pips_drake.config import dump_yaml, load_yaml
from pips_drake.errors import InputError
from pips_drake.serpentine.runs import simulate as module
from pips_drake.serpentine.runs.run import run_station
from pips_drake.serpentine.runs.simulate import simulate
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import load_setup

pytestmark = [pytest.mark.timeout(300), pytest.mark.usefixtures("blank_figures")]

BASE = "x_in,y_in,z_in\n16.255,0,0\n16.255,0,174.902\n"


def load(folder: Path, text: str) -> SerpentineScenario:
    (folder / "scenario.yaml").write_text(text)
    return load_yaml(SerpentineScenario, folder / "scenario.yaml")


def test_a_machine_and_a_path_are_enough(tmp_path):
    scenario = load(tmp_path, "machine: serpentine\npath: trajectory_4\n")
    scenario.duration_s = 1 / 16
    verdict = simulate(scenario, name="little", out=tmp_path / "result")
    assert verdict.passed, verdict.failures
    assert verdict.folder == tmp_path / "result"
    assert verdict.summary["scenario"] == "little"
    assert verdict.summary["simulated_s"] == 1 / 16
    assert not verdict.summary["clearance_in_range"]  # there is no scene
    written = json.loads((tmp_path / "result" / "summary.json").read_text())
    assert written["tip_error_max_m"] == pytest.approx(verdict.summary["tip_error_max_m"])
    assert (tmp_path / "result" / "replay.html").stat().st_size > 100_000


def test_every_field_may_be_stated(tmp_path):
    """What is dumped states every field; here the values are not the defaults either."""
    (tmp_path / "straight.csv").write_text(BASE + "16.255,0,180\n")
    scenario = SerpentineScenario(path="straight.csv", scene="trajectory_4", seed=7)
    scenario.mounting, scenario.mounting_position_m = "laboratory", [1.0, -2.0, 0.5]
    scenario.corner_deviation_in, scenario.clearance_range_m = 0.1, 0.25
    scenario.duration_s = 1 / 16
    scenario.motion.tip_speed_mm_per_s, scenario.motion.ramp_s = 10.0, 1.0
    scenario.motion.retract = False
    scenario.solver.tolerance_in, scenario.solver.max_iterations = 0.1, 9
    scenario.actuation.show_uncompensated = True
    scenario.clocks.plant_hz, scenario.clocks.control_hz = 256, 32
    scenario.clocks.clearance_hz, scenario.clocks.record_hz = 16, 64
    scenario.checks.clearance_min_mm, scenario.checks.force_fraction_max = 5.0, 0.9
    text = dump_yaml(scenario)
    assert load(tmp_path, text) == scenario
    verdict = simulate(scenario, name="all", out=tmp_path / "result", folder=tmp_path)
    assert verdict.passed, verdict.failures
    assert (tmp_path / "result" / "scenario.yaml").read_text() == text
    # The same arm without compensation sags, and is told beside the other.
    without = verdict.summary["spine_error_max_uncompensated_m"]
    assert without > 10.0 * verdict.summary["spine_error_max_m"]
    rows = np.genfromtxt(tmp_path / "result" / "joints.csv", delimiter=",", skip_header=1)
    np.testing.assert_allclose(rows[:, 0], np.arange(5) / 64.0)  # 64 Hz for 1/16 s


def test_the_arm_starts_at_rest_where_it_is_commanded(tmp_path):
    scenario = SerpentineScenario(path="trajectory_4", duration_s=0.25)
    run = run_station(scenario, load_setup(scenario))
    data = run.data
    np.testing.assert_allclose(data.time, np.arange(9) / 32.0)
    np.testing.assert_allclose(data.joint_rates[0], 0.0, atol=1e-12)
    # The tip has gone less than a tenth of a millimetre, smoothly; the arm has not been shaken.
    np.testing.assert_allclose(data.joints, data.commanded_joints, rtol=0, atol=1e-4)
    assert np.all(np.isnan(data.joint_efforts[0]))
    assert np.all(np.isfinite(data.joint_efforts[1:]))


def test_what_cannot_be_followed_is_not_simulated(tmp_path, monkeypatch):
    def run(*args: Any, **kwargs: Any) -> None:
        raise AssertionError("simulated")

    monkeypatch.setattr(module, "run_station", run)
    (tmp_path / "long.csv").write_text(BASE + "16.255,0,280\n")
    scenario = SerpentineScenario(path="long.csv")
    verdict = simulate(scenario, name="long", out=tmp_path / "result", folder=tmp_path)
    assert not verdict.passed
    assert "joint d1 leaves its limits" in verdict.failures[0]
    summary = json.loads((tmp_path / "result" / "summary.json").read_text())
    assert (summary["verdict"], summary["scenario"]) == ("fail", "long")
    assert (tmp_path / "result" / "scenario.yaml").is_file()


def test_an_error_while_it_runs_leaves_nothing(tmp_path, monkeypatch):
    def run(*args: Any, **kwargs: Any) -> None:
        raise InputError("no")

    monkeypatch.setattr(module, "run_station", run)
    scenario = SerpentineScenario(path="trajectory_4")
    with pytest.raises(InputError, match="no"):
        simulate(scenario, name="bad", out=tmp_path / "a" / "result")
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_is_given_up_fails_and_keeps_its_folder(tmp_path):
    # Three iterations reach 1e-9 in on the straight base line, not once the arm bends.
    text = """
machine: serpentine
path: trajectory_4_arcs
solver: {max_iterations: 3}
motion: {tip_speed_mm_per_s: 100.0, ramp_s: 0.5}
duration_s: 4.0
"""
    verdict = simulate(load(tmp_path, text), name="given_up", out=tmp_path / "run")
    assert not verdict.passed
    (failure,) = verdict.failures
    assert "given up" in failure
    assert "after 3 iterations" in failure
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["verdict"] == "fail"
    assert (tmp_path / "run" / "summary.html").is_file()
