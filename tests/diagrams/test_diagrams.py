"""Every diagram script runs, for a short time, and prints or writes what it promises."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

DIAGRAMS = Path(__file__).resolve().parents[2] / "diagrams"


def _run(script: str, *args: str, cwd: Path) -> str:
    result = subprocess.run(
        [sys.executable, str(DIAGRAMS / script), *args],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=110,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


def test_every_script_has_a_test():
    tested = {
        "follow_the_leader_in_meshcat.py",
        "serpentine_station.py",
        "arm_in_your_diagram.py",
        "render_to_file.py",
        "teleoperate.py",
        "remote_manipulator_station.py",
        "cable_robot_station.py",
    }
    assert {file.name for file in DIAGRAMS.glob("*.py")} == tested


def test_follow_the_leader_shows_itself_on_localhost(tmp_path):
    out = _run("follow_the_leader_in_meshcat.py", "--seconds", "1", cwd=tmp_path)
    assert re.search(r"open http://localhost:\d+", out)


def test_the_station_reports_a_clearance_that_stays_put_while_the_arm_stands(tmp_path):
    out = _run("serpentine_station.py", "--seconds", "0.5", cwd=tmp_path)
    distances = [float(text) for text in re.findall(r"clearance\s+([\d.]+) mm", out)]
    # The tip has moved 3 mm along the base line after half a second; the pallet's wall is beside
    # it, so the distance does not change in the printed digit.
    assert len(distances) == 6
    assert max(distances) - min(distances) <= 0.1


def test_the_arm_in_another_diagram_sags_by_its_statics(tmp_path):
    out = _run("arm_in_your_diagram.py", "--seconds", "2", cwd=tmp_path)
    sag = float(re.search(r"hangs ([\d.]+) mm", out).group(1))
    # Statics over stiffness: 17.0 mm at home, 8.2 mm at the path's end; this is near the middle.
    assert 8.0 < sag < 17.5


def test_the_remote_manipulators_elbow_follows_its_master_arm(tmp_path):
    out = _run("remote_manipulator_station.py", "--seconds", "2", cwd=tmp_path)
    angles = [float(text) for text in re.findall(r"elbow at\s+(-?[\d.]+) deg", out)]
    assert angles[0] == -98.0
    # No faster than the joint's 1.78 deg/s; a frame and a control period behind.
    assert 1.78 * 1.6 < angles[-1] - angles[0] <= 1.78 * 2.0
    assert out.count("stowed") == 6


def test_the_cable_robots_platform_follows_its_way_points(tmp_path):
    out = _run("cable_robot_station.py", "--seconds", "5", cwd=tmp_path)
    off = [float(text) for text in re.findall(r"([\d.]+) mm off", out)]
    # Cables stretch by what is commanded away; what is left is the command's delay and swinging.
    assert len(off) == 6 and max(off) < 5.0
    assert min(float(text) for text in re.findall(r"tensions (\d+) ", out)) > 10.0


@pytest.mark.slow
@pytest.mark.render
def test_rendering_writes_a_picture(tmp_path):
    _run("render_to_file.py", "--out", "end.png", cwd=tmp_path)
    assert (tmp_path / "end.png").read_bytes().startswith(b"\x89PNG")
