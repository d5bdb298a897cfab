"""`follow` from Python: the verdict object, and numbers of FTL-95 and FACTS."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pips_drake.errors import InputError
from pips_drake.serpentine.runs.follow import follow

BASE = "x_in,y_in,z_in\n16.255,0,0\n16.255,0,174.902\n"


@pytest.fixture(autouse=True)
def no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures have their own tests, and take longest."""
    monkeypatch.setattr(
        "pips_drake.serpentine.runs.follow.write_plan_figures", lambda folder, plan: None
    )


def test_the_verdict_holds_what_the_summary_says(tmp_path: Path) -> None:
    verdict = follow("trajectory_4", out=tmp_path / "result")
    assert verdict.passed
    assert verdict.word == "pass"
    assert verdict.failures == ()
    assert verdict.folder == tmp_path / "result"
    assert verdict.summary["tip_positions"] == 13
    assert verdict.summary["iterations_max"] <= 6  # FACTS
    # Joints peak between the table's rows: the verdict has looked there too.
    assert verdict.summary["joint_margin_min_rad"] > 0.0


@pytest.mark.parametrize("name", [f"trajectory_{number}" for number in (1, 2, 3, 4)])
def test_the_arm_can_follow_the_reports_trajectories_in_the_reports_mode(
    tmp_path: Path, name: str
) -> None:
    verdict = follow(name, tolerance_in=0.1, out=tmp_path / "result")
    assert verdict.passed, verdict.failures
    assert verdict.summary["iterations_max"] <= 2
    assert verdict.summary["spine_error_max_m"] <= 0.1 * 0.0254


def test_the_error_of_the_reports_mode_on_trajectory_4_is_the_reports(tmp_path: Path) -> None:
    verdict = follow("trajectory_4", tolerance_in=0.1, out=tmp_path / "result")
    assert verdict.summary["spine_error_max_m"] / 0.0254 == pytest.approx(0.0676, abs=5e-5)


def test_a_step_longer_than_the_path_leaves_home_and_end(tmp_path: Path) -> None:
    verdict = follow("trajectory_4", step_in=1e6, out=tmp_path / "result")
    assert verdict.summary["tip_positions"] == 2


def test_what_cannot_be_followed_fails_with_its_folder_and_where(tmp_path: Path) -> None:
    (tmp_path / "long.csv").write_text(BASE + "16.255,0,280\n")
    verdict = follow(str(tmp_path / "long.csv"), out=tmp_path / "result")
    assert not verdict.passed
    assert verdict.word == "fail"
    (sentence,) = verdict.failures
    # Home has d1 = 24.9 in; 89.6 in further on the rail ends: z = 264.502 in, found every 1/4 in.
    assert "joint d1 leaves its limits 24.900 .. 114.500 in" in sentence
    assert "(16.255, 0.000, 264.652) in" in sentence
    assert "worst 129.998 in" in sentence
    assert (tmp_path / "result" / "joints.csv").is_file()


def test_a_fold_that_a_module_would_span_fails(tmp_path: Path) -> None:
    # 5 in up a slope of 45 degrees and back along it: within module 7's 12.76 in.
    (tmp_path / "fold.csv").write_text(BASE + "16.255,0,190\n16.255,0.1,185\n16.255,0.2,195\n")
    verdict = follow(str(tmp_path / "fold.csv"), out=tmp_path / "result")
    assert "the path folds inside the reach of module 7" in verdict.failures[0]


def test_an_arc_of_half_a_turn_is_no_fold(tmp_path: Path) -> None:
    # A half circle of 60 in turns the path back, but nowhere inside a module's sphere.
    angles = np.radians(np.arange(3.0, 181.0, 3.0))
    rows = [f"{16.255 + 60 - 60 * np.cos(a)},0,{174.902 + 60 * np.sin(a)}\n" for a in angles]
    (tmp_path / "round.csv").write_text(BASE + "".join(rows))
    verdict = follow(str(tmp_path / "round.csv"), out=tmp_path / "result")
    assert not any("folds" in sentence for sentence in verdict.failures)


def test_bad_numbers_are_refused_before_anything_is_written(tmp_path: Path) -> None:
    for bad in (dict(step_in=0.0), dict(tolerance_in=np.nan), dict(max_iterations=0)):
        with pytest.raises(InputError, match=next(iter(bad))):
            follow("trajectory_4", out=tmp_path / "result", **bad)
    assert list(tmp_path.iterdir()) == []
