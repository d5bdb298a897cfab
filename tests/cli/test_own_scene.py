"""A scene of one's own by one option: what it says, what it leaves, and what it refuses."""

from __future__ import annotations

import importlib.util
import json
import shutil
import sys
from pathlib import Path

import pytest
import yaml

from pips_drake.scene.rendering import can_render
from pips_drake.units import INCH

# In a fresh checkout the first command of each kind waits for numba's compilation.
pytestmark = [pytest.mark.timeout(300), pytest.mark.usefixtures("blank_figures")]

# Not imported: CoACD's library and Drake's do not go well together in one process.
needs_coacd = pytest.mark.skipif(
    importlib.util.find_spec("coacd") is None, reason="the extra `meshes` is not installed"
)
#: Beside the arm: its hollow, towards +x and +y, faces away from it.
POSE = "0.5 -0.5 3.5 0 0 0"
SHORT = ("--set", "duration_s=0.5", "actuation.show_uncompensated=false")
BRIEF = "duration_s: 0.25\nactuation: {show_uncompensated: false}\ncertificate: {enabled: false}\n"


def test_check_says_where_it_stands_and_that_its_hull_is_larger(pips_here, bracket, tmp_path):
    bracket.write(tmp_path, pose=POSE)
    outcome = pips_here("check", "trajectory_4", "--scene", "bracket.sdf", "--out", "out")
    assert outcome.code == 0, outcome
    place = "bracket::body is welded to frame_0 and stands at (0.5, -0.5, 3.5) m in frame_0"
    assert place in outcome.out
    warning = "bracket::body mesh bracket.obj collides as its convex hull, up to 120 mm larger"
    assert f"warning: {warning} and 1.5 times its volume" in outcome.out
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    assert summary["scene"] == "bracket.sdf"
    assert summary["scene_placement"] == [place]
    assert summary["scene_warnings"][0].startswith(warning)
    assert summary["scene_shapes"][0]["mesh"] == "bracket.obj"
    assert (tmp_path / "out/figures/collision_shapes.png").exists() == can_render()
    text = (tmp_path / "out/scenario.yaml").read_text()
    assert text.startswith("# To repeat: pips simulate THIS_FILE --scene FILE")
    assert yaml.safe_load(text)["scene"] == "bracket.sdf"


def test_clearance_to_a_mesh_is_closed_form(pips_here, bracket, tmp_path):
    """Straight ahead, to a bracket across the way: the head's front is 6 in before the tip."""
    gap, end = 0.1, 180.0 * INCH
    (tmp_path / "ahead.csv").write_text(
        "x_in,y_in,z_in\n16.255,0,0\n16.255,0,174.902\n16.255,0,180\n"
    )
    # Its legs lie in the plane x, y; one of them is met by the whole front.
    x, y = 16.255 * INCH - 0.5 * bracket.leg_x, -0.5 * bracket.thick
    bracket.write(tmp_path, pose=f"{x!r} {y!r} {end + 6.0 * INCH + gap!r} 0 0 0")
    outcome = pips_here("check", "ahead.csv", "--scene", "bracket.sdf", "--out", "out")
    assert outcome.code == 0, outcome
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    assert summary["clearance_min_pair"] == ["prototype::camera_head", "bracket::body"]
    # The engine's own distances are good to a micrometre here: box against hull.
    assert summary["clearance_sampled_min_m"] == pytest.approx(gap, abs=1e-6)


def test_the_command_line_is_relative_to_here_and_a_scenario_to_its_folder(
    pips_here, bracket, tmp_path
):
    (tmp_path / "mine").mkdir()
    bracket.write(tmp_path / "mine", pose=POSE)
    (tmp_path / "mine/run.yaml").write_text(
        f"machine: serpentine\npath: trajectory_4\nscene: bracket.sdf\n{BRIEF}"
    )
    (tmp_path / "run.yaml").write_text(f"machine: serpentine\npath: trajectory_4\n{BRIEF}")
    inside = pips_here("simulate", "mine/run.yaml", "--out", "a")
    given = pips_here("simulate", "run.yaml", "--scene", "mine/bracket.sdf", "--out", "b")
    assert (inside.code, given.code) == (0, 0), (inside, given)
    a, b = (json.loads((tmp_path / out / "summary.json").read_text()) for out in "ab")
    assert a["clearance_sampled_min_m"] == b["clearance_sampled_min_m"]
    assert a["scene_shapes"] == b["scene_shapes"]
    # As its first line says, the result can be run again.
    again = pips_here("simulate", "b/scenario.yaml", "--scene", "mine/bracket.sdf", "--out", "c")
    assert again.code == 0, again
    c = json.loads((tmp_path / "c/summary.json").read_text())
    assert c["clearance_sampled_min_m"] == b["clearance_sampled_min_m"]
    # A path that leads out of a scenario's folder stays refused.
    (tmp_path / "mine/out.yaml").write_text(
        "machine: serpentine\npath: trajectory_4\nscene: ../bracket.sdf\n"
    )
    shutil.copy(tmp_path / "mine/bracket.sdf", tmp_path)
    assert "lies outside" in pips_here("simulate", "mine/out.yaml").err


def test_a_camera_without_its_target_is_left_out_and_that_is_said(pips_here, bracket, tmp_path):
    bracket.write(tmp_path, pose=POSE)
    outcome = pips_here(
        "simulate", "trajectory_4", "--scene", "bracket.sdf", *SHORT, "--out", "out"
    )
    assert outcome.code == 0, outcome
    assert "no camera: its target 'payload::payload' is not in this scene" in outcome.out
    assert "(known: bracket::body)" in outcome.out
    assert not (tmp_path / "out/camera.mp4").exists()


@needs_coacd
def test_decompose_splits_the_mesh(pips_here, bracket, tmp_path):
    bracket.write(tmp_path, pose=POSE)
    words = ("check", "trajectory_4", "--scene", "bracket.sdf", "--decompose", "--out", "out")
    outcome = pips_here(*words)
    assert outcome.code == 0, outcome
    assert "warning" not in outcome.out
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    (shape,) = summary["scene_shapes"]
    assert shape["convex_parts"] >= 2
    assert max(shape["larger_than_mesh_max_m"], shape["left_out_of_mesh_max_m"]) < 1e-3
    assert yaml.safe_load((tmp_path / "out/scenario.yaml").read_text())["decompose_meshes"]


@needs_coacd
def test_the_arm_may_reach_into_a_hollow_once_the_mesh_is_split(pips_here, bracket, tmp_path):
    """Straight into the corner of a bracket five times as large; its hull fills that corner."""
    (tmp_path / "ahead.csv").write_text(
        "x_in,y_in,z_in\n16.255,0,0\n16.255,0,174.902\n16.255,0,180\n"
    )
    large = bracket.mesh.replace("</uri>", "</uri><scale>5 5 5</scale>")
    from_legs = 5.0 * bracket.thick + 0.4  # m: inside the hull, 0.4 m from both legs
    place = f"{16.255 * INCH - from_legs!r} {-from_legs!r} {178.0 * INCH!r} 0 0 0"
    bracket.write(tmp_path, pose=place, seen=large, collides=large)
    words = ("check", "ahead.csv", "--scene", "bracket.sdf")
    whole, split = pips_here(*words), pips_here(*words, "--decompose", "--out", "out")
    assert whole.code == 1
    assert "penetrates bracket::body" in whole.out and "up to 600 mm larger" in whole.out
    assert split.code == 0, split
    least = json.loads((tmp_path / "out/summary.json").read_text())["clearance_sampled_min_m"]
    # From the legs' faces to the middle, less half the head's width (turned by 45 deg or not).
    assert 0.4 - 0.15 < least < 0.4


CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
#: What stands in bracket.obj or bracket.sdf instead, and what is said of it.
BAD: dict[str, tuple[str, str, str]] = {
    "flat mesh": ("bracket.obj", CORNERS.replace("0 0 1", "1 1 0") + "f 1 2 3\nf 2 4 3\n", "flat"),
    "a line": ("bracket.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "co-linear"),
    "no mesh": ("bracket.obj", "hello", "fewer than three vertices"),
    "no such vertex": ("bracket.obj", CORNERS + "f 1 2 9\n", "bracket."),
    "missing mesh": ("bracket.obj", "", "bracket.obj"),
    "unknown tag": (
        "bracket.sdf",
        "<sdf version='1.9'><model name='m'><hue/></model></sdf>",
        "hue",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_scene_is_refused_on_one_line(pips_here, bracket, tmp_path, case):
    name, content, words = BAD[case]
    bracket.write(tmp_path)
    (tmp_path / name).write_text(content)
    if case == "missing mesh":
        (tmp_path / name).unlink()
    before = sorted(tmp_path.iterdir())
    for command in (("check", "trajectory_4", "--out", "out"), ("simulate", "trajectory_4")):
        outcome = pips_here(*command, "--scene", "bracket.sdf")
        assert (outcome.code, outcome.out) == (2, ""), outcome
        assert outcome.err.startswith("pips: ") and outcome.err.count("\n") == 1
        assert words in outcome.err
        assert sorted(tmp_path.iterdir()) == before


def test_a_folder_is_no_scene(pips_here, tmp_path):
    Path(tmp_path / "things").mkdir()
    outcome = pips_here("simulate", "trajectory_4", "--scene", "things")
    assert outcome.code == 2
    assert "scene 'things' is a folder; must be a shipped name or a file" in outcome.err


def test_without_the_library_decompose_names_the_extra(pips_here, bracket, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "coacd", None)
    bracket.write(tmp_path)
    outcome = pips_here("check", "trajectory_4", "--scene", "bracket.sdf", "--decompose")
    assert outcome.code == 2
    assert "CoACD is missing; install it with the extra `meshes`" in outcome.err
