"""`pips follow`: the files, columns and numbers that people rely on (DESIGN, FTL-95 and FACTS)."""

from __future__ import annotations

import csv
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

JOINTS = ["d1", *(f"theta{j}" for j in range(2, 19))]
# In a fresh checkout the first command of each kind waits for numba's compilation.
pytestmark = pytest.mark.timeout(300)

IN_SI = ["d1_m", *(f"theta{j}_rad" for j in range(2, 19))]
IN_REPORT_UNITS = ["d1_in", *(f"theta{j}_deg" for j in range(2, 19))]
SPINE = [4, 6, 8, 10, 12, 14, 16, 18]

#: FACTS: trajectory 4 at its end, converged; in and deg.
END_OF_TRAJECTORY_4 = [
    113.194525, -89.999611, -0.000397, 0.000275, 0.000130, -3.769614, 3.995988, -24.858013,
    24.576912, -28.245154, 22.297129, -0.533363, 25.228922, 19.622858, 24.476946, 17.327377,
    17.290909, 0.0,
]  # fmt: skip


def read_table(file: Path) -> tuple[list[str], np.ndarray]:
    with file.open(newline="") as stream:
        header, *rows = csv.reader(stream)
    return header, np.array(rows, dtype=np.float64)


def png_size(file: Path) -> tuple[int, int]:
    head = file.read_bytes()[:24]
    assert head[:8] == b"\x89PNG\r\n\x1a\n", f"{file.name} is no PNG"
    width, height = struct.unpack(">II", head[16:24])
    return width, height


@pytest.fixture(scope="module")
def followed(pips: Any, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The default run of trajectory 4 in a folder of its own: what it said, and its results."""
    folder = tmp_path_factory.mktemp("follow")
    return pips("follow", "trajectory_4", cwd=folder), folder / "out" / "follow_trajectory_4"


def test_it_passes_says_so_and_leaves_nothing_else(followed):
    outcome, folder = followed
    assert outcome.code == 0
    assert outcome.err == ""
    assert outcome.out.startswith("trajectory_4: PASS\n")
    assert str(Path("out") / "follow_trajectory_4") in outcome.out
    assert [entry.name for entry in folder.parent.iterdir()] == [folder.name]
    names = {str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file()}
    assert names == {
        "joints.csv",
        "joints_in_deg.csv",
        "spine_points.csv",
        "actuators.csv",
        "summary.json",
        "figures/joints.png",
        "figures/iterations.png",
        "figures/path.png",
    }


def test_tables_have_the_columns_that_people_rely_on(followed):
    _, folder = followed
    counts = ["iterations", "spine_error_m"]
    assert read_table(folder / "joints.csv")[0] == ["tip_arc_length_m", *IN_SI, *counts]
    assert read_table(folder / "joints_in_deg.csv")[0] == [
        "tip_arc_length_in",
        *IN_REPORT_UNITS,
        "iterations",
        "spine_error_in",
    ]
    points = [f"{axis}{j}_m" for j in SPINE for axis in "xyz"]
    assert read_table(folder / "spine_points.csv")[0] == ["tip_arc_length_m", *points]
    actuators = [f"L{j}_m" for j in range(3, 19)]
    assert read_table(folder / "actuators.csv")[0] == ["tip_arc_length_m", *actuators]


def test_the_end_posture_is_that_of_the_facts(followed):
    _, folder = followed
    _, rows = read_table(folder / "joints_in_deg.csv")
    # FACTS prints six decimals.
    np.testing.assert_allclose(rows[-1, 1:19], END_OF_TRAJECTORY_4, rtol=0, atol=6e-7)


def test_both_joint_tables_say_the_same(followed):
    _, folder = followed
    (_, si), (_, report) = (read_table(folder / f"{n}.csv") for n in ("joints", "joints_in_deg"))
    # 13 digits are written.
    np.testing.assert_allclose(si[:, :2], report[:, :2] * 0.0254, rtol=1e-11)
    np.testing.assert_allclose(np.degrees(si[:, 2:19]), report[:, 2:19], rtol=1e-11)
    np.testing.assert_array_equal(si[:, 19], report[:, 19])


def test_the_tip_visits_the_tables_points_and_spine_point_18_is_there(followed):
    from pips_drake.scene.packages import find_path_file

    _, folder = followed
    _, rows = read_table(folder / "spine_points.csv")
    text = find_path_file("trajectory_4").read_text()
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    table = np.array([line.split(",") for line in lines[2:]], dtype=np.float64) * 0.0254
    np.testing.assert_allclose(rows[:, -3:], table, rtol=0, atol=1e-12)


def test_actuator_lengths_are_the_triangles_of_their_pins(followed):
    _, folder = followed
    _, joints = read_table(folder / "joints.csv")
    _, lengths = read_table(folder / "actuators.csv")
    # FACTS: L^2 = a^2 + b^2 - 2 a b cos(phi0 + theta), a = b = 9, 7.5 and 6 in, phi0 = 90 deg; the
    # last one's pins are in the camera head (models/arms/prototype.yaml).
    a = 0.0254 * np.array([9.0] * 7 + [7.5] * 6 + [6.0] * 2 + [2.7])
    expected = np.sqrt(2.0 * a**2 * (1.0 - np.cos(0.5 * np.pi + joints[:, 3:19])))
    np.testing.assert_allclose(lengths[:, 1:], expected, rtol=1e-10)


def test_the_summary_says_verdict_numbers_and_versions(followed):
    _, folder = followed
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["verdict"] == "pass"
    assert summary["failures"] == []
    assert (summary["arm"], summary["path"]) == ("prototype", "trajectory_4")
    assert summary["tip_positions"] == summary["tip_positions_solved"] == 13
    assert summary["iterations_max"] <= 6  # FACTS
    assert summary["spine_error_max_m"] <= 1e-9 * 0.0254
    # FACTS: about 1.4 in from the path at worst.
    assert summary["path_deviation_max_m"] == pytest.approx(1.4 * 0.0254, rel=0.1)
    assert 0.0 < summary["joint_margin_min_rad"] < np.radians(30.0)
    assert {"pips_drake", "drake", "python", "numpy"} <= set(summary["versions"])


def test_figures_are_pictures_that_can_be_read(followed):
    _, folder = followed
    for file in (folder / "figures").iterdir():
        width, height = png_size(file)
        assert 600 <= width <= 6000 and 400 <= height <= 8000, file.name


def test_the_reports_tolerance_gives_the_reports_iterations(pips_here, no_figures, tmp_path):
    """FTL-95 Figure D.4: two iterations at the first point, one after; 0.0676 in at most."""
    outcome = pips_here("follow", "trajectory_4", "--tolerance_in", "0.1", "--out", "report")
    assert outcome.code == 0
    header, rows = read_table(tmp_path / "report" / "joints_in_deg.csv")
    assert list(rows[:, header.index("iterations")]) == [2.0] + [1.0] * 12
    assert rows[:, header.index("spine_error_in")].max() == pytest.approx(0.0676, abs=5e-5)


def test_a_step_puts_tips_that_far_apart_with_the_end_included(pips_here, no_figures, tmp_path):
    outcome = pips_here("follow", "trajectory_4", "--step_in", "0.25", "--out", "fine")
    assert outcome.code == 0
    _, rows = read_table(tmp_path / "fine" / "joints_in_deg.csv")
    tips = rows[:, 0]
    assert tips[0] == pytest.approx(174.902, abs=1e-9)  # FACTS: home
    np.testing.assert_allclose(np.diff(tips)[:-1], 0.25, atol=1e-9)
    assert 0.0 < tips[-1] - tips[-2] <= 0.25 + 1e-9
    # The end is the table's last point: its posture is that of the facts again.
    np.testing.assert_allclose(rows[-1, 1:19], END_OF_TRAJECTORY_4, rtol=0, atol=6e-7)


def test_it_runs_on_a_file_of_ones_own_in_metres(pips_here, no_figures, tmp_path):
    (tmp_path / "straight.csv").write_text(
        "x_m,y_m,z_m\n0.412877,0,0\n0.412877,0,4.4425108\n0.412877,0,4.6\n"
    )
    assert pips_here("follow", "straight.csv").code == 0
    _, rows = read_table(tmp_path / "out" / "follow_straight" / "joints.csv")
    # Straight on: only the rail moves, by as much as the tip.
    assert rows[-1, 1] - rows[0, 1] == pytest.approx(4.6 - 4.4425108, abs=1e-9)
    # Equal angles at both: FACTS' -0.000389 deg and less, as the base is off its line by 1e-4 in.
    np.testing.assert_allclose(rows[:, 3:19], 0.0, atol=1e-5)
