"""Remote manipulator scenarios at the command line: what is shown, refused, ended and kept."""

from __future__ import annotations

import json
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest
import yaml

from pips_drake.scenarios import load_scenario, scenario_descriptions
from pips_drake.scene.packages import models_directory

# In a fresh checkout the first command of each kind waits for numba's compilation.
pytestmark = pytest.mark.timeout(300)

RECORDING_HEADER = "time_s,H0_deg,P0_deg,P1_deg,H2_deg,P2_deg,R2_deg,prong\n"
HOME = "-14.0,62.0,-98.0,0.0,-54.0,14.0,0\n"
SHIPPED = [
    "berth_payload",
    "capture_free_flyer",
    "collide_bay_wall",
    "dock_payload",
    "missed_docking",
    "slide_out",
]


def write_scenario(folder: Path, **changes: Any) -> None:
    """`task.yaml`: three frames of waiting, or as changed."""
    scenario = {
        "machine": "remote_manipulator",
        "operator": {"kind": "autopilot", "script": [{"do": "wait", "seconds": 0.15}]},
        "video": {"enabled": False},
    }
    (folder / "task.yaml").write_text(yaml.safe_dump(scenario | changes))


def recorded(folder: Path, text: str | bytes) -> None:
    """`task.yaml`, whose operator is `mine.csv`."""
    write_scenario(folder, operator={"kind": "recording", "recording": "mine.csv"})
    content = text if isinstance(text, bytes) else text.encode()
    (folder / "mine.csv").write_bytes(content)


def test_the_scenarios_are_listed_with_what_they_do(pips_here):
    outcome = pips_here("list")
    assert outcome.code == 0
    told = scenario_descriptions()
    scenarios = outcome.out.split("scenarios with goals")[0]
    for name in SHIPPED:
        assert load_scenario(name).machine == "remote_manipulator"
        (line,) = (line for line in scenarios.splitlines() if line.split()[:1] == [name])
        assert line.endswith(f"  {told[name]}") and told[name]


#: Options that cannot be used with such a scenario, and what is said.
OPTIONS = {
    "simulate dock_payload --set payload.support=moon": (
        "payload.support = moon; must be none or bay or port"
    ),
    "simulate dock_payload --set operator.kind=cat": "operator.kind = cat; must be autopilot or",
    "simulate dock_payload --set operator.kind=meshcat": "operator.script = 17 steps; must be some",
    "simulate dock_payload --set manipulator=rms_72": "unknown manipulator 'rms_72'",
    "simulate dock_payload --set payload_mass_kg=1e6": "payload_mass_kg = 1e+06 kg; must be 0 ..",
    "simulate dock_payload --set payload_mass_kg=nan": "payload_mass_kg = nan; must be a finite",
    "simulate dock_payload --set station=Z": "station = Z; must be of A, B, C",
    "simulate dock_payload --set stand_height_m=9": "arm: height = 9 m; must be 2 .. 4 m",
    "simulate dock_payload --set dynamics.plant_hz=77": "plant_hz = 77; must be a multiple of 20",
    "simulate dock_payload --set speed=1": "unknown key 'speed'",
    "simulate dock_payload --scene cargo_bay": (
        "machine = remote_manipulator, which takes no other scene"
    ),
    "simulate dock_payload --scene none": "which takes no other scene",
    "simulate dock_payload --decompose": (
        "machine = remote_manipulator, which has no meshes to decompose"
    ),
    "simulate dock_payloads": "unknown scenario 'dock_payloads' (did you mean 'dock_payload'?)",
    "plan dock_payload": (
        "dock_payload: machine = remote_manipulator, whose scenarios state their motion; must be "
        "planner"
    ),
    "study dock_payload": "unknown study 'dock_payload'",
}


@pytest.mark.parametrize("words", OPTIONS)
def test_what_cannot_be_used_is_refused_on_one_line(assert_refused, pips_here, tmp_path, words):
    assert_refused(pips_here(*words.split()), tmp_path, set(), OPTIONS[words])


def test_a_study_of_such_a_scenario_is_refused(assert_refused, pips_here, tmp_path):
    write_scenario(tmp_path)
    (tmp_path / "study.yaml").write_text(
        "scenario: task.yaml\nvary: [{field: seed, values: [1, 2]}]\n"
    )
    outcome = pips_here("study", "study.yaml")
    assert_refused(outcome, tmp_path, {"task.yaml", "study.yaml"})
    assert "remote_manipulator" in outcome.err


def test_a_check_goes_on_as_before_and_knows_no_such_path(assert_refused, pips_here, tmp_path):
    assert_refused(pips_here("check", "dock_payload"), tmp_path, set(), "unknown path 'dock_pay")


#: Recordings that cannot be used, and what is said of them.
RECORDINGS: dict[str, tuple[str | bytes, str]] = {
    "empty": ("", "mine.csv: empty; must have a header, time_s,H0_deg"),
    "a header alone": (RECORDING_HEADER, "mine.csv: empty"),
    "a wrong unit": (
        RECORDING_HEADER.replace("P1_deg", "P1_in") + f"0,{HOME}",
        "mine.csv: line 1: unit of column 'P1_in' = 'in'; must be deg or rad",
    ),
    "minutes": (RECORDING_HEADER.replace("time_s", "time_min") + f"0,{HOME}", "must be time_s"),
    "NaN": (
        RECORDING_HEADER + f"0,{HOME}1,nan,{HOME.partition(',')[2]}",
        "mine.csv: line 3: H0_deg = 'nan'; must be a finite number",
    ),
    "back in time": (
        RECORDING_HEADER + f"0,{HOME}2,{HOME}1,{HOME}",
        "mine.csv: line 4: time_s = 1 after 2; must be more, as times increase",
    ),
    "a switch that there is not": (
        RECORDING_HEADER + f"0,{HOME}".replace(",0\n", ",2\n"),
        "mine.csv: line 2: prong = '2'; must be -1 or 0 or 1",
    ),
    "a joint too few": (
        "time_s,H0_deg\n0,0\n",
        "mine.csv: line 1: no column P0_deg or P0_rad; must have all angles",
    ),
    "binary": (bytes(range(256)), "mine.csv: not a text file"),
    "volts between two levels": (
        "time_s," + ",".join(f"channel_{k}_V" for k in range(1, 14)) + "\n0" + ",3.3" * 13 + "\n",
        "mine.csv: line 2: ",
    ),
}


@pytest.mark.parametrize("case", RECORDINGS)
def test_a_bad_recording_is_refused(assert_refused, pips_here, tmp_path, case):
    text, words = RECORDINGS[case]
    recorded(tmp_path, text)
    outcome = pips_here("simulate", "task.yaml")
    assert_refused(outcome, tmp_path, {"task.yaml", "mine.csv"}, words)


def test_a_recording_that_is_not_there_or_elsewhere_is_refused(assert_refused, pips_here, tmp_path):
    for name, words in (
        ("nowhere.csv", "unknown operator recording 'nowhere.csv'"),
        ("/etc/hostname", "lies outside"),
    ):
        write_scenario(tmp_path, operator={"kind": "recording", "recording": name})
        assert_refused(pips_here("simulate", "task.yaml"), tmp_path, {"task.yaml"}, words)


def test_a_person_must_have_a_browser_to_work_in(assert_refused, pips_here, tmp_path):
    write_scenario(tmp_path, operator={"kind": "meshcat"}, duration_s=1.0)
    outcome = pips_here("simulate", "task.yaml")
    assert_refused(outcome, tmp_path, {"task.yaml"}, "operator.kind = meshcat; must be run with")


#: What a machine's file may not say: text, what stands there instead, and words.
MACHINES = {
    "an unknown key": ("length_m: 15.24", "long_m: 15.24", "payload: unknown key 'long_m'"),
    "NaN": ("mass_kg: 10000.0", "mass_kg: .nan", "payload.mass_kg = nan; must be a finite number"),
    "a payload that is too long": (
        "length_m: 15.24",
        "length_m: 18.5",
        "PayloadConfig.length_m = 18.5 m; must be 0 .. 18.288 m",
    ),
    "a payload that the bay has no room for": (
        "across_flats_m: 4.2672\n  mass_kg: 10000.0",
        "across_flats_m: 4.572\n  mass_kg: 10000.0",
        "must be < ",
    ),
    "limits crossed": ("lower_deg: -2.0, upper_deg: 145.0", "lower_deg: 200.0, upper_deg: 145.0",
                       "joint P0: limits = 200.0 .. 145.0 deg; must be rising"),
}  # fmt: skip


@pytest.mark.parametrize("case", MACHINES)
def test_a_bad_machine_is_refused(assert_refused, pips_here, tmp_path, case):
    old, new, words = MACHINES[case]
    text = (models_directory() / "manipulators" / "rms_71.yaml").read_text()
    assert text.count(old) == 1, case
    (tmp_path / "mine.yaml").write_text(text.replace(old, new))
    write_scenario(tmp_path, manipulator="mine.yaml")
    outcome = pips_here("simulate", "task.yaml")
    assert_refused(outcome, tmp_path, {"task.yaml", "mine.yaml"}, "mine.yaml: ", words)


@pytest.fixture
def plain(blank_figures: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """No figures, no pictures, no replay."""
    runs = "pips_drake.remote_manipulator.runs"
    monkeypatch.setattr(f"{runs}.pictures.render_available", lambda: "not wanted in this test")
    for name in ("timeline_figure", "joints_figure", "docking_figure", "write_run_replay"):
        monkeypatch.setattr(f"{runs}.simulate.{name}", lambda *args, **kwargs: None)


def test_a_run_that_passes_says_so_and_where_to_look(plain, pips_here, tmp_path):
    write_scenario(tmp_path)
    outcome = pips_here("simulate", "task.yaml")
    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.out.startswith("task: PASS\n")
    assert str(Path("out") / "task") in outcome.out
    assert "stowed" in outcome.out


def test_a_run_that_fails_exits_1_and_keeps_its_folder(plain, pips_here, tmp_path):
    for changes, words in (
        ({"checks": {"phases": ["docked"]}}, "phases: stowed; must be docked"),
        (
            {
                "operator": {
                    "kind": "autopilot",
                    "script": [
                        {"do": "wait", "seconds": 0.1},
                        {"do": "carry", "by_m": [0.0, 0.0, -40.0]},
                    ],
                }
            },
            "step 2 (carry): the arm cannot hold its palm at (",
        ),
    ):
        write_scenario(tmp_path, **changes)
        outcome = pips_here("simulate", "task.yaml", "--force")
        assert (outcome.code, outcome.err) == (1, "")
        assert outcome.out.startswith("task: FAIL\n") and words in outcome.out
        summary = json.loads((tmp_path / "out" / "task" / "summary.json").read_text())
        assert summary["verdict"] == "fail" and words in summary["failures"][0]
        # Nothing half made beside it.
        assert [entry.name for entry in (tmp_path / "out").iterdir()] == ["task"]


@pytest.mark.slow
def test_an_interrupted_run_leaves_nothing(start_pips, tmp_path):
    write_scenario(
        tmp_path, operator={"kind": "autopilot", "script": [{"do": "wait", "seconds": 1e4}]}
    )
    process: subprocess.Popen[str] = start_pips("simulate", "task.yaml", cwd=tmp_path)
    with process:
        try:
            deadline = time.monotonic() + 120.0
            while not list(tmp_path.glob("**/.*.partial")) and time.monotonic() < deadline:
                assert process.poll() is None
                time.sleep(0.02)
            time.sleep(1.0)
            process.send_signal(signal.SIGINT)
            out, err = process.communicate(timeout=60)
        finally:
            process.kill()
    # Interrupted in code that was compiled from text, Python ends by SIGINT itself: to a shell that
    # is 130 too.
    assert process.returncode in (130, -signal.SIGINT)
    assert (out, err) == ("", "pips: interrupted; nothing was written\n")
    assert [entry.name for entry in tmp_path.iterdir()] == ["task.yaml"]
