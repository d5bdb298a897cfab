"""`pips check`, `simulate`, `list`, `view`, `export` and the help, as users run them."""

from __future__ import annotations

import csv
import json
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from pips_drake.config import load_yaml
from pips_drake.scene.packages import list_names, models_directory
from pips_drake.serpentine.scenario import SerpentineScenario

# In a fresh checkout the first command of each kind waits for numba's compilation.
pytestmark = pytest.mark.timeout(300)

COMMANDS = ("follow", "check", "simulate", "view", "list", "export")
IN_SI = ["d1_m", *(f"theta{j}_rad" for j in range(2, 19))]
#: Two seconds out of three minutes, without the second run that shows the sag, and without a film.
SHORT = ("--set", "duration_s=2", "actuation.show_uncompensated=false", "camera.enabled=false")


def columns(file: Path) -> list[str]:
    with file.open(newline="") as stream:
        return next(csv.reader(stream))


def table(file: Path) -> np.ndarray:
    return np.genfromtxt(file, delimiter=",", skip_header=1)


@pytest.fixture(scope="module")
def simulated(pips: Any, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The first seconds of trajectory 4: what it said, and its results."""
    folder = tmp_path_factory.mktemp("simulate")
    # Both forms of --set count, and together.
    outcome = pips("simulate", "trajectory_4", *SHORT, "--set", "motion.dwell_s=3", cwd=folder)
    return outcome, folder / "out" / "trajectory_4"


def test_a_simulation_passes_and_says_where_to_look(simulated):
    outcome, folder = simulated
    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.out.startswith("trajectory_4: PASS\n")
    assert str(Path("out") / "trajectory_4") in outcome.out
    assert "(only the first 2 s of the run)" in outcome.out
    assert [entry.name for entry in folder.parent.iterdir()] == [folder.name]


def test_a_simulations_series_have_their_columns_and_one_clock(simulated):
    _, folder = simulated
    drives = ["d1_m", "theta2_rad", *(f"L{j}_m" for j in range(3, 19))]
    efforts = ["d1_N", "theta2_Nm", *(f"L{j}_N" for j in range(3, 19))]
    expected = {
        "joints": IN_SI,
        "joints_commanded": IN_SI,
        "actuators": drives + efforts,
        "clearance": ["clearance_m", "self_clearance_m"],
        "tip": ["tip_arc_length_m", "tip_error_m", "spine_error_m", "path_deviation_m"],
    }
    for name, words in expected.items():
        assert columns(folder / f"{name}.csv") == ["time_s", *words]
        rows = table(folder / f"{name}.csv")
        np.testing.assert_allclose(rows[:, 0], np.arange(65) / 32.0)  # clocks.record_hz
        # Efforts have no value before the plant's first step.
        assert np.all(np.isfinite(rows[1:]))


def test_a_simulations_summary_has_the_keys_that_people_rely_on(simulated):
    _, folder = simulated
    summary = json.loads((folder / "summary.json").read_text())
    assert {
        "scenario",
        "verdict",
        "failures",
        "versions",
        "simulated_s",
        "wall_s",
        "real_time_rate",
        "clearance_sampled_min_m",
        "clearance_min_pair",
        "clearance_min_time_s",
        "tip_error_max_m",
        "path_deviation_max_m",
        "joint_margin_min_rad",
        "actuator_force_max_fraction",
    } <= set(summary)
    assert (summary["scenario"], summary["verdict"]) == ("trajectory_4", "pass")
    assert summary["simulated_s"] == 2.0
    assert summary["real_time_rate"] == pytest.approx(2.0 / summary["wall_s"])
    # The numbers are those of the series.
    clearance, tip = (table(folder / f"{name}.csv") for name in ("clearance", "tip"))
    assert summary["clearance_sampled_min_m"] == pytest.approx(clearance[:, 1].min(), rel=1e-9)
    assert summary["tip_error_max_m"] == pytest.approx(tip[:, 2].max(), rel=1e-9)


def test_a_simulations_scenario_loads_again_as_resolved(simulated):
    _, folder = simulated
    scenario = load_yaml(SerpentineScenario, folder / "scenario.yaml")
    assert scenario.path == "trajectory_4_arcs"
    assert scenario.duration_s == 2.0
    assert scenario.motion.dwell_s == 3.0
    assert not scenario.actuation.show_uncompensated


def test_a_simulations_pictures_diagram_and_replay_can_be_opened(simulated):
    _, folder = simulated
    figures = {file.stem: file for file in (folder / "figures").glob("*.png")}
    assert {"joints", "iterations", "path", "actuators", "clearance", "tracking"} <= set(figures)
    for file in figures.values():
        head = file.read_bytes()[:24]
        assert head[:8] == b"\x89PNG\r\n\x1a\n"
        width, height = struct.unpack(">II", head[16:24])
        assert 300 <= width <= 6000 and 200 <= height <= 8000, file.name
    dot = (folder / "diagram.dot").read_text()
    assert dot.startswith("digraph")
    assert "follow_the_leader" in dot
    assert "<html" in (folder / "replay.html").read_text()[:2000].lower()


def test_the_same_run_gives_the_same_bytes(simulated, pips_here, blank_figures, tmp_path):
    """Once in a process of its own, and once in this one."""
    _, folder = simulated
    words = ["simulate", "trajectory_4", *SHORT, "motion.dwell_s=3", "--out", "again"]
    assert pips_here(*words).code == 0
    for name in ("joints", "joints_commanded", "actuators", "clearance", "tip"):
        again = (tmp_path / "again" / f"{name}.csv").read_bytes()
        assert again == (folder / f"{name}.csv").read_bytes(), name
    assert (tmp_path / "again" / "scenario.yaml").read_bytes() == (
        folder / "scenario.yaml"
    ).read_bytes()

    for name in ("proof_commanded.npz", "proof_simulated.npz"):
        assert (tmp_path / "again" / name).read_bytes() == (folder / name).read_bytes(), name

    # Clocks differ, and only the first has pictures.
    left_out = ('wall_s"', '"real_time', '"renderings_missing"')

    def told(file: Path) -> list[str]:
        lines = file.read_text().splitlines()
        return [line for line in lines if not any(word in line for word in left_out)]

    first, second = (told(d / "summary.json") for d in (folder, tmp_path / "again"))
    assert first == second


def test_a_scenario_finds_its_files_beside_itself_from_any_folder(pips_here, tmp_path):
    project, elsewhere = tmp_path / "project", tmp_path / "elsewhere"
    (project / "paths").mkdir(parents=True)
    elsewhere.mkdir()
    # The path cannot be followed, so that the answer comes at once.
    (project / "paths" / "long.csv").write_text(
        "x_in,y_in,z_in\n16.255,0,0\n16.255,0,174.902\n16.255,0,300\n"
    )
    (project / "mine.yaml").write_text("machine: serpentine\npath: paths/long.csv\n")
    outcome = pips_here("simulate", "project/mine.yaml", "--out", "elsewhere/result")
    assert outcome.code == 1
    assert "joint d1 leaves its limits" in outcome.out
    summary = json.loads((elsewhere / "result" / "summary.json").read_text())
    assert (summary["scenario"], summary["path"]) == ("mine", "long")
    assert summary["verdict"] == "fail"
    assert (elsewhere / "result" / "scenario.yaml").is_file()


def test_a_scenario_reaches_no_file_outside_its_folder(pips_here, tmp_path):
    (tmp_path / "project").mkdir()
    (tmp_path / "secret.csv").write_text("x_in,y_in,z_in\n16.255,0,0\n16.255,0,174.902\n")
    (tmp_path / "project" / "link.csv").symlink_to(tmp_path / "secret.csv")
    for path in ("../secret.csv", str(tmp_path / "secret.csv"), "link.csv"):
        (tmp_path / "project" / "mine.yaml").write_text(f"machine: serpentine\npath: {path}\n")
        outcome = pips_here("simulate", "project/mine.yaml")
        assert outcome.code == 2
        assert "lies outside project; must be shipped or inside it" in outcome.err
    assert not (tmp_path / "out").exists()


def test_check_answers_without_writing(pips_here, tmp_path):
    outcome = pips_here("check", "trajectory_4")
    assert outcome.code == 0
    assert outcome.out.startswith("trajectory_4: PASS\n")
    assert "clearance to the scene, sampled least" in outcome.out
    assert list(tmp_path.iterdir()) == []


def test_check_writes_a_folder_when_asked(pips_here, tmp_path):
    (tmp_path / "short.csv").write_text(
        "x_in,y_in,z_in\n16.255,0,0\n16.255,0,174.902\n16.255,0,176\n"
    )
    outcome = pips_here("check", "short.csv", "--scene", "trajectory_4", "--out", "result")
    assert outcome.code == 0
    names = {str(file.relative_to(tmp_path / "result")) for file in tmp_path.rglob("result/**/*")}
    assert {"summary.json", "scenario.yaml", "figures/clearance.png"} <= names
    assert pips_here("check", "short.csv", "--out", "result").code == 2


def test_a_path_in_the_way_of_the_scene_exits_1_with_the_pair(pips_here):
    outcome = pips_here("check", "trajectory_4", "--scene", "trajectory_4_blocked")
    assert outcome.code == 1
    assert outcome.out.startswith("trajectory_4: FAIL\n")
    assert "prototype::" in outcome.out and "must be >= 25 mm" in outcome.out


def test_list_names_everything_that_is_shipped(pips, tmp_path):
    outcome = pips("list", cwd=tmp_path)
    assert (outcome.code, outcome.err) == (0, "")
    for kind in ("scenario", "path", "arm", "scene", "model"):
        assert f"{kind}s (" in outcome.out
        for name in list_names(kind):
            assert name in outcome.out


def test_export_writes_the_committed_model(pips, tmp_path):
    outcome = pips("export", "prototype", cwd=tmp_path)
    assert (outcome.code, outcome.out) == (0, "prototype.sdf\n")
    committed = models_directory() / "sdf" / "prototype" / "prototype.sdf"
    assert (tmp_path / "prototype.sdf").read_bytes() == committed.read_bytes()
    again = pips("export", "prototype", cwd=tmp_path)
    assert again.code == 2
    assert again.err == "pips: prototype.sdf exists; use --force to replace it\n"
    assert pips("export", "prototype", "--force", cwd=tmp_path).code == 0


@pytest.mark.parametrize(
    ("words", "file", "kind"),
    [
        (("--format", "urdf"), "pcr_concept.urdf", "robot"),
        (("--format", "mjcf"), "pcr_concept.xml", "mujoco"),
        (("--out", "arm.xml", "--mounting", "pad"), "arm.xml", "mujoco"),
        (("--out", "arm.urdf"), "arm.urdf", "robot"),
        (("--out", "arm", "--format", "mjcf"), "arm", "mujoco"),
    ],
)
def test_export_writes_what_other_programs_read(pips_here, tmp_path, words, file, kind):
    outcome = pips_here("export", "pcr_concept", *words)
    assert (outcome.code, outcome.out, outcome.err) == (0, f"{file}\n", "")
    assert [entry.name for entry in tmp_path.iterdir()] == [file]
    root = ElementTree.parse(tmp_path / file).getroot()
    assert root.tag == kind
    assert "pcr_concept" in root.attrib.values()
    again = pips_here("export", "pcr_concept", *words)
    assert (again.code, again.err) == (2, f"pips: {file} exists; use --force to replace it\n")


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ("--format usd", "unknown format 'usd' (did you mean 'sdf'?); known: mjcf, sdf, urdf"),
        ("--out a.txt", "a.txt: must end in one of .sdf, .urdf, .xml, or --format say which"),
        ("--format mjcf --out a.urdf", "a.urdf: is not how mjcf files end (.xml)"),
        ("--format mjcf --mounting up", "unknown mounting 'up'; known: laboratory, pad, pad_below"),
        (
            "--mounting pad",
            "--mounting pad: is for mjcf alone; whoever loads sdf says where the arm stands",
        ),
        ("--format mjcf --out .", ".: is a folder; must be a file"),
    ],
)
def test_export_refuses_what_it_cannot_write(pips_here, tmp_path, words, complaint):
    outcome = pips_here("export", "prototype", *words.split(), "--force")
    assert (outcome.code, outcome.out) == (2, "")
    assert outcome.err == f"pips: {complaint}\n"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", [".sdf", ".urdf", ".xml"])
def test_an_export_can_be_viewed(pips, pips_here, tmp_path, suffix):
    file = f"mine{suffix}"
    assert pips_here("export", "prototype", "--out", file).code == 0
    outcome = pips("view", file, "--once", cwd=tmp_path)
    assert outcome.code == 0, outcome.err
    assert "Traceback" not in outcome.err and "error" not in outcome.err


def test_view_loads_and_shows_a_model_once(pips, tmp_path):
    outcome = pips("view", "spacelab_pallet", "--once", cwd=tmp_path)
    assert outcome.code == 0, outcome.err
    assert "Traceback" not in outcome.err


@pytest.mark.parametrize("words", [[], *([name] for name in COMMANDS)])
def test_help_is_there(pips_here, words):
    outcome = pips_here(*words, "--help")
    assert outcome.code == 0
    assert outcome.out.startswith("usage: pips")
    if not words:
        assert all(name in outcome.out for name in COMMANDS)


def test_help_loads_nothing_that_takes_long(tmp_path):
    """Importing pydrake, numpy or matplotlib would be most of half a second, for text alone."""
    heavy = ("pydrake", "numpy", "scipy", "numba", "matplotlib", "yaml")
    script = (
        "import sys\n"
        "from pips_drake import cli\n"
        "for words in sys.argv[1:]:\n"
        "    try:\n"
        "        cli.main(words.split())\n"
        "    except SystemExit as end:\n"
        "        assert not end.code\n"
        f"loaded = [name for name in {heavy!r} if name in sys.modules]\n"
        "sys.exit(f'loaded {loaded}' if loaded else 0)\n"
    )
    words = ["--help", *(f"{name} --help" for name in COMMANDS)]
    root = Path(sys.modules["pips_drake"].__file__ or "").parents[1]
    done = subprocess.run(
        [sys.executable, "-c", script, *words], cwd=root, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_trajectory_4_from_start_to_end(pips_here, tmp_path):
    """The main job: out, dwell and back beside the payload."""
    outcome = pips_here("simulate", "trajectory_4")
    assert outcome.code == 0, outcome
    folder = tmp_path / "out" / "trajectory_4"
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["verdict"] == "pass"
    assert summary["cycle_completed"]
    # Out along 2.27 m at 25 mm/s with two ramps of 2 s, 5 s there, and back.
    assert summary["cycle_time_s"] == pytest.approx(2 * (2.27 / 0.025 + 2.0) + 5.0, rel=0.02)
    # The spine stays within 10 mm of the plan; without compensation the arm sags farther.
    assert summary["spine_error_max_m"] < 0.010
    assert summary["spine_error_max_uncompensated_m"] > 2.0 * summary["spine_error_max_m"]
    # The controller's postures are on the path: FACTS' 1.4 in are the links' own shortcuts.
    assert summary["path_deviation_max_m"] == pytest.approx(1.3 * 0.0254, abs=0.005)
    assert 0.3 < summary["actuator_force_max_fraction"] < 1.0
    assert summary["drive_effort_max_fraction"] < 1.0
    assert 0.0 < summary["drive_speed_max_fraction"] < 1.0
    assert summary["actuator_stroke_margin_min_m"] > 0.0
    assert summary["joint_margin_min_rad"] > 0.0
    # Measured on the shipped scene: the pallet is the nearest, 39 mm away.
    assert summary["clearance_sampled_min_m"] == pytest.approx(0.039, abs=0.002)
    assert summary["clearance_min_pair"][1].startswith("pallet")
    assert summary["self_clearance_sampled_min_m"] > 0.1
    # It comes back to where it was; theta18 points the camera.
    joints = table(folder / "joints.csv")
    np.testing.assert_allclose(joints[-1, 1:18], joints[0, 1:18], rtol=0, atol=1e-3)
