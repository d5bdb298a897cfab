"""`check`: clearances against closed forms, pairs by name, and its checks."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pips_drake.config import validate
from pips_drake.serpentine.runs.check import check, scene_of_path
from pips_drake.serpentine.scenario import SerpentineScenario

pytestmark = pytest.mark.usefixtures("blank_figures")

INCH = 0.0254
#: The tip goes straight on from home by 1.098 in, so that the arm stays straight.
STRAIGHT = "x_in,y_in,z_in\n16.255,0,0\n16.255,0,174.902\n16.255,0,176\n"
SPINE_X, END_Z = 16.255 * INCH, 176.0 * INCH


@pytest.fixture
def check_beside_box(tmp_path: Path) -> Any:
    """Checks the straight path beside one box, given in frame 0 in m; more fields as keywords."""
    (tmp_path / "straight.csv").write_text(STRAIGHT)

    def run(centre: tuple[float, float, float], size: tuple[float, float, float], **fields: Any):
        (tmp_path / "wall.sdf").write_text(
            "<sdf version='1.9'><model name='wall'><link name='wall'><collision name='box'>"
            f"<geometry><box><size>{size[0]} {size[1]} {size[2]}</size></box></geometry>"
            "</collision></link></model></sdf>"
        )
        (tmp_path / "wall.dmd.yaml").write_text(
            "directives:\n"
            f"- add_model: {{name: wall, file: 'file://{tmp_path}/wall.sdf'}}\n"
            "- add_weld:\n    parent: frame_0\n    child: wall::wall\n"
            f"    X_PC: {{translation: [{centre[0]}, {centre[1]}, {centre[2]}]}}\n"
        )
        scenario = SerpentineScenario(path="straight.csv", scene="wall.dmd.yaml", **fields)
        validate(scenario)
        return check(scenario, name="wall", folder=tmp_path)

    return run


@pytest.mark.parametrize("mounting", ["laboratory", "pad", "pad_below"])
def test_a_box_ahead_is_as_near_as_the_camera_head_comes(check_beside_box, mounting):
    # The head ends 6 in beyond the tip (FACTS), which goes to z = 176 in; the box begins 0.1 m on.
    face = END_Z + 6.0 * INCH + 0.1
    verdict = check_beside_box((SPINE_X, 0.0, face + 0.5), (1.0, 1.0, 1.0), mounting=mounting)
    assert verdict.passed, verdict.failures
    # d1's home is off by 3e-5 in and the arm tilts by micrometres (FACTS).
    assert verdict.summary["clearance_sampled_min_m"] == pytest.approx(0.1, abs=2e-5)
    assert verdict.summary["clearance_min_pair"] == ["prototype::camera_head", "wall::wall"]
    # Nearest at the end of the path.
    assert verdict.summary["clearance_min_tip_arc_length_m"] == pytest.approx(END_Z, abs=1e-9)


def test_walls_around_a_segment_are_as_far_as_its_box_says(check_beside_box):
    """Segment 2 is a box 9 in wide, its middle a quarter of that aside both ways (FACTS).

    Seen along x0 and y0 it stands on edge (FTL-95 Table A.1, row 3: -45 deg): its diagonal is
    9 sqrt(2) in, and its middle stands 9 sqrt(2) / 4 in from the spine along one of the two.
    """
    asides = []
    for axis in (0, 1):
        near = []
        for side in (-1.0, 1.0):
            # Beside the middle of segment 2 (z0 = 53.8 to 75.1 in), 0.3 m from the spine.
            centre, size = [SPINE_X, 0.0, 64.5 * INCH], [0.6, 0.6, 0.1]
            centre[axis] += side * 0.35
            size[axis] = 0.1
            verdict = check_beside_box(tuple(centre), tuple(size))
            assert verdict.summary["clearance_min_pair"] == ["prototype::segment_2", "wall::wall"]
            near.append(verdict.summary["clearance_sampled_min_m"])
        assert sum(near) == pytest.approx(2 * 0.3 - 9.0 * np.sqrt(2.0) * INCH, abs=1e-4)
        asides.append(0.5 * abs(near[0] - near[1]))
    assert sorted(asides) == pytest.approx([0.0, 9.0 * np.sqrt(2.0) / 4.0 * INCH], abs=1e-4)


def test_a_box_too_near_fails_with_the_pair_and_the_distance(check_beside_box):
    face = END_Z + 6.0 * INCH + 0.010
    verdict = check_beside_box((SPINE_X, 0.0, face + 0.5), (1.0, 1.0, 1.0))
    (sentence,) = verdict.failures
    assert sentence == (
        "prototype::camera_head comes too near to wall::wall: 10.0 mm with the tip at 4.4704 m of "
        "path 'straight'; must be >= 25 mm"
    )
    assert verdict.summary["verdict"] == "fail"


def test_a_box_in_the_way_is_penetrated(check_beside_box):
    face = END_Z + 6.0 * INCH - 0.010
    verdict = check_beside_box((SPINE_X, 0.0, face + 0.5), (1.0, 1.0, 1.0))
    assert "prototype::camera_head penetrates wall::wall: -10.0 mm" in verdict.failures[0]


def test_what_is_out_of_range_is_said_to_be(check_beside_box):
    verdict = check_beside_box((SPINE_X, 0.0, 99.0), (1.0, 1.0, 1.0))
    assert verdict.passed
    assert not verdict.summary["clearance_in_range"]
    assert verdict.summary["clearance_min_pair"] == []
    assert verdict.summary["clearance_sampled_min_m"] == 0.5


def test_without_a_scene_there_is_still_the_arm_itself(tmp_path):
    (tmp_path / "straight.csv").write_text(STRAIGHT)
    verdict = check(SerpentineScenario(path="straight.csv"), name="bare", folder=tmp_path)
    assert verdict.passed
    assert verdict.summary["scene"] is None
    assert not verdict.summary["clearance_in_range"]
    assert 0.01 < verdict.summary["self_clearance_sampled_min_m"] < 0.5
    assert verdict.folder is None


@pytest.mark.parametrize(
    ("checks", "words"),
    [
        (dict(self_clearance_min_mm=400.0), "come too near to each other"),
        (dict(force_fraction_max=0.01), "% of its effort limit; must be <= 1 %"),
        (dict(speed_fraction_max=0.01), "% of its speed limit; must be <= 1 %"),
    ],
)
def test_each_check_fails_alone_when_it_asks_for_more(tmp_path, checks, words):
    (tmp_path / "straight.csv").write_text(STRAIGHT)
    scenario = SerpentineScenario(path="straight.csv")
    for name, value in checks.items():
        setattr(scenario.checks, name, value)
    verdict = check(scenario, name="strict", folder=tmp_path)
    (sentence,) = verdict.failures
    assert words in sentence


def test_the_speed_is_that_of_the_rail_on_a_straight_path(tmp_path):
    (tmp_path / "straight.csv").write_text(STRAIGHT)
    verdict = check(SerpentineScenario(path="straight.csv"), name="straight", folder=tmp_path)
    # Only d1 moves, as fast as the tip: 25 of its 50 mm/s.
    assert verdict.summary["drive_speed_max_fraction"] == pytest.approx(0.5, abs=1e-3)


def test_a_path_that_cannot_be_followed_fails_and_is_still_looked_at(tmp_path):
    (tmp_path / "long.csv").write_text(STRAIGHT.replace("176", "280"))
    scenario = SerpentineScenario(path="long.csv")
    verdict = check(scenario, name="long", folder=tmp_path, out=tmp_path / "result")
    assert "joint d1 leaves its limits" in verdict.failures[0]
    assert "self_clearance_sampled_min_m" in verdict.summary
    written = json.loads((tmp_path / "result" / "summary.json").read_text())
    assert written["failures"] == list(verdict.failures)
    assert verdict.folder == tmp_path / "result"


def test_a_paths_scene_is_the_shipped_one_of_its_name_and_never_its_own_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.csv").write_text(STRAIGHT)
    assert scene_of_path("trajectory_4") == "trajectory_4"
    assert scene_of_path("trajectory_4_arcs") == "trajectory_4"
    assert scene_of_path("mine.csv") == ""
    assert np.all([scene_of_path(name) == "" for name in ("", "nothing", str(tmp_path))])
