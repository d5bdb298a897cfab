"""`simulate` of a remote manipulator: a short run's whole folder, runs that end early, the task."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pips_drake.config import load_yaml
from pips_drake.errors import InputError
from pips_drake.remote_manipulator.runs import pictures
from pips_drake.remote_manipulator.runs import simulate as module
from pips_drake.remote_manipulator.runs.simulate import simulate
from pips_drake.remote_manipulator.scenario import RemoteManipulatorScenario
from pips_drake.scenarios import load_scenario

pytestmark = pytest.mark.timeout(300)

#: Two seconds, in a tenth of one.
SHORT = """
machine: remote_manipulator
description: the stand a little up
operator:
  kind: autopilot
  script:
  - {do: telescope, to_m: 2.05}
  - {do: camera, station: K, zoom_deg: -2.0}
  - {do: wait, seconds: 0.5}
video: {enabled: false}
"""
#: Files of every run, without pictures.
FILES = {
    "summary.json",
    "summary.png",
    "summary.html",
    "scenario.yaml",
    "joints.csv",
    "payload.csv",
    "program.csv",
    "cameras.csv",
    "channels.csv",
    "operator.csv",
    "events.csv",
    "replay.html",
    "diagram.dot",
    "figures/timeline.png",
    "figures/joints.png",
}


def load(folder: Path, text: str) -> RemoteManipulatorScenario:
    (folder / "scenario.yaml").write_text(text)
    return load_yaml(RemoteManipulatorScenario, folder / "scenario.yaml")


def table(file: Path) -> dict[str, np.ndarray]:
    with file.open(newline="") as stream:
        header, *rows = csv.reader(stream)
    values = np.array([[float(cell or "nan") for cell in row] for row in rows])
    return dict(zip(header, values.T, strict=True))


@pytest.fixture
def plain(blank_figures: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """No figures, no pictures, no replay, a sheet of one pixel: what else there is is quick."""
    monkeypatch.setattr(pictures, "render_available", lambda: "not wanted in this test")
    for name in ("timeline_figure", "joints_figure", "docking_figure", "write_run_replay"):
        monkeypatch.setattr(module, name, lambda *args, **kwargs: None)


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The short run, figures and all, but for pictures."""
    folder = tmp_path_factory.mktemp("short")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pictures, "render_available", lambda: "not wanted in this test")
        verdict = simulate(load(folder, SHORT), name="short", out=folder / "result")
    return verdict, folder / "result"


def test_a_run_writes_everything_that_there_is_to_write(short):
    verdict, folder = short
    assert verdict.passed, verdict.failures
    found = {str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file()}
    assert found == FILES
    assert verdict.folder == folder
    for file in folder.rglob("*.png"):
        assert file.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n", file.name
    assert (folder / "replay.html").stat().st_size > 500_000
    assert "collision_program" in (folder / "diagram.dot").read_text()
    assert load_yaml(RemoteManipulatorScenario, folder / "scenario.yaml").station == "C"


def test_its_summary_is_that_of_its_series(short):
    verdict, folder = short
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["verdict"], summary["failures"], summary["scenario"]) == ("pass", [], "short")
    assert summary["renderings_missing"] == "not wanted in this test"
    assert summary["stations"] == "CK"
    assert summary["phases"] == ["stowed"] and summary["inhibits"] == 0
    assert summary["operator_finished"] and not summary["operator_stopped"]
    assert summary["frames"] == len(table(folder / "joints.csv")["time_s"])
    clearance = table(folder / "program.csv")["clearance_m"]
    assert summary["clearance_sampled_min_m"] == pytest.approx(clearance.min(), rel=1e-9)
    assert summary["simulated_s"] == pytest.approx(verdict.summary["simulated_s"])
    with (folder / "events.csv").open(newline="") as stream:
        events = list(csv.reader(stream))
    assert events[0] == ["time_s", "kind", "text"]
    told = [f"{time} s, {kind}: {text}" for time, kind, text in events[1:]]
    assert summary["events"] == told


def test_frames_are_a_twentieth_of_a_second_apart_and_the_arm_does_what_was_asked(short):
    _, folder = short
    joints, cameras = table(folder / "joints.csv"), table(folder / "cameras.csv")
    time = joints["time_s"]
    np.testing.assert_allclose(time, 0.05 * np.arange(len(time)), atol=1e-9)
    # Up by 5 cm at 6 cm/s, and there it stays; a frame more or less, and 2 mm of the servo.
    assert joints["stand_m"][0] == 2.0
    assert joints["stand_m"][-1] == pytest.approx(2.05, abs=0.06 * 0.05 + 0.002)
    assert joints["stand_sent_m"].max() <= 2.05 + 0.06 * 0.05 + 1e-9
    # Looking from K, two degrees narrower than the 60 that all cameras begin with.
    assert cameras["station"][-1] == 10 and cameras["station"][0] == 2
    assert np.degrees(cameras["field_of_view_rad"][-1]) == pytest.approx(58.0, abs=1e-9)


@pytest.fixture
def short_scenario(tmp_path: Path) -> Callable[..., RemoteManipulatorScenario]:
    def make(**checks: Any) -> RemoteManipulatorScenario:
        scenario = load(tmp_path, SHORT)
        scenario.operator.script = scenario.operator.script[1:2]  # one camera, zoomed: 0.1 s
        for name, value in checks.items():
            setattr(scenario.checks, name, value)
        return scenario

    return make


def test_a_run_that_keeps_not_what_it_must_fails_and_says_what(plain, short_scenario, tmp_path):
    scenario = short_scenario(phases=["stowed", "extraction"], clearance_min_mm=200.0)
    verdict = simulate(scenario, name="poor", out=tmp_path / "result")
    assert not verdict.passed
    phases, clearance = verdict.failures
    assert phases == "phases: stowed; must be stowed -> extraction"
    assert clearance.startswith("clearance 150.4 mm (") and clearance.endswith("must be >= 200 mm")
    summary = json.loads((tmp_path / "result" / "summary.json").read_text())
    assert summary["verdict"] == "fail" and summary["failures"] == list(verdict.failures)
    assert "FAIL" in (tmp_path / "result" / "summary.html").read_text()


def test_a_step_that_the_arm_cannot_do_ends_the_run_and_the_folder_shows_where(
    plain, short_scenario, tmp_path
):
    scenario = short_scenario()
    (tmp_path / "far.yaml").write_text("{do: carry, by_m: [30.0, 0.0, 0.0]}")
    far = load_yaml(type(scenario.operator.script[0]), tmp_path / "far.yaml")
    for script, step in (([*scenario.operator.script, far], 2), ([far], 1)):
        scenario.operator.script = script
        out = tmp_path / f"result_{step}"
        verdict = simulate(scenario, name="far", out=out)
        (said,) = verdict.failures
        assert said.startswith(f"step {step} (carry): the arm cannot hold its palm at (")
        # Until there, everything is told; in the first step that is the first frame alone.
        frames = len(table(out / "joints.csv")["time_s"])
        assert frames == 1 if step == 1 else frames > 2
        assert json.loads((out / "summary.json").read_text())["operator_stopped"] == said
        assert said.replace("'", "&#x27;") in (out / "summary.html").read_text()


def test_a_run_may_end_before_its_operator(plain, short_scenario, tmp_path):
    scenario = short_scenario()
    scenario.operator.script = load(tmp_path, SHORT).operator.script
    scenario.duration_s = 0.2
    verdict = simulate(scenario, name="cut", out=tmp_path / "result")
    assert verdict.passed, verdict.failures
    assert verdict.summary["simulated_s"] == pytest.approx(0.2)


def test_a_run_that_diverges_is_given_up_and_keeps_its_folder(
    plain, short_scenario, tmp_path, monkeypatch
):
    def run(*args: Any, **kwargs: Any) -> None:
        raise module.DivergedError(0.5)

    monkeypatch.setattr(module, "run_station", run)
    verdict = simulate(short_scenario(), name="wild", out=tmp_path / "result")
    assert not verdict.passed and "given up" in verdict.failures[0]
    assert json.loads((tmp_path / "result" / "summary.json").read_text())["verdict"] == "fail"
    assert "FAIL" in (tmp_path / "result" / "summary.html").read_text()


def test_the_same_run_gives_the_same_numbers(plain, tmp_path, short):
    simulate(load(tmp_path, SHORT), name="short", out=tmp_path / "again")
    for file in sorted(short[1].glob("*.csv")):
        assert (tmp_path / "again" / file.name).read_bytes() == file.read_bytes(), file.name


def test_no_other_scene_can_be_given(plain, short_scenario, tmp_path):
    with pytest.raises(InputError, match="takes no other scene"):
        simulate(short_scenario(), name="s", out=tmp_path / "result", scene_file=tmp_path / "a.sdf")
    assert not (tmp_path / "result").exists()


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_payload_is_docked(tmp_path, capsys):
    """RMS-71's whole task, with its figures and pictures but for the film."""
    scenario = load_scenario("dock_payload").config
    scenario.video.enabled = False
    out = tmp_path / "dock_payload"
    verdict = simulate(scenario, name="dock_payload", out=out)
    summary = verdict.summary
    with capsys.disabled():
        print(
            f"\ndock_payload: {verdict.word}, {' -> '.join(summary['phases'])}, "
            f"{summary['simulated_s']:.0f} s at {summary['real_time_rate']:.1f} times real time, "
            f"clearance {1e3 * summary['clearance_sampled_min_m']:.0f} mm, docked at "
            f"{1e3 * summary['docking_distance_m']:.1f} mm"
        )
    assert verdict.passed, verdict.failures
    expected = ["stowed", "extraction", "manoeuvring", "docked_held", "docked"]
    assert summary["phases"] == expected
    # Docked within RMS-71's 0.25 ft and 2 deg 32 min, at rest in the port at the end.
    assert summary["docking_distance_m"] <= 0.25 * 0.3048
    assert summary["docking_angle_rad"] <= np.radians(2.0 + 32.0 / 60.0)
    assert summary["weld_slip_max_m"] < 1e-3
    found = {str(file.relative_to(out)) for file in out.rglob("*") if file.is_file()}
    drawn = {"figures/phases.png", "figures/stations.png"}
    if "renderings_missing" in summary:
        drawn = set()
    assert found == FILES | drawn | {"figures/docking.png"}
    # The payload has not moved since it was let go.
    program, payload = table(out / "program.csv"), table(out / "payload.csv")
    docked = program["phase"] == 1
    assert docked.any()
    places = np.column_stack([payload[name][docked] for name in ("x_m", "y_m", "z_m")])
    assert np.abs(places - places[0]).max() < 1e-3
