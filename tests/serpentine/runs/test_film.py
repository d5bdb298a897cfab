"""A run's film is counted frame by frame, and the seen surface is what geometry says it must be."""

from __future__ import annotations

import sys
from pathlib import Path
from subprocess import run

import numpy as np
import pytest

from pips_drake.scenarios import load_scenario
from pips_drake.serpentine.runs import film
from pips_drake.serpentine.runs.assessment import RunData
from pips_drake.serpentine.runs.film import film_run
from pips_drake.serpentine.station import load_setup
from pips_drake.twin.summary import read_summary

#: Pan and tilt with which the camera at home looks at the payload's middle, as a run begins, rad.
AIMED_AT_HOME = np.radians([31.11, 73.94])
PICTURES = ("camera.mp4", "figures/seen_surface.png")


def check_film(file: Path, *, frames: int) -> None:
    """Size, speed and number of the frames, and that the payload is in the middle of each."""
    av = pytest.importorskip("av")
    with av.open(str(file)) as container:
        stream = container.streams.video[0]
        assert (stream.width, stream.height, float(stream.average_rate)) == (160, 120, 12.0)
        found = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
    assert len(found) == frames
    for frame in found:
        # The payload's shell is yellow and stands in the middle: more red and green than blue.
        red, green, blue = frame[50:70, 70:90].reshape(-1, 3).mean(axis=0)
        assert min(red, green) > 1.3 * blue
        assert frame.std() > 20.0, "not blank"


@pytest.mark.slow
@pytest.mark.render
def test_a_short_run_is_filmed(tmp_path: Path) -> None:
    """The command as a user runs it."""
    pytest.importorskip("av")
    out = tmp_path / "out"
    changes = {
        "duration_s": "0.5",
        "actuation.show_uncompensated": "false",
        "camera.picture_period_s": "0.0625",
        "camera.width": "160",
        "camera.height": "120",
    }
    command = [sys.executable, "-m", "pips_drake", "simulate", "trajectory_4", "--out", str(out)]
    for key, value in changes.items():
        command += ["--set", f"{key}={value}"]
    done = run(command, capture_output=True, text=True, timeout=110, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    # Every 1/16 s of half a second, both ends included.
    check_film(out / PICTURES[0], frames=1 + 8)
    assert (out / PICTURES[1]).read_bytes().startswith(b"\x89PNG")
    summary = read_summary(out / "summary.json")
    # From the state that the pointer starts with: only the plant's own motion is left, and the
    # joint's, which the pan follows by a period.
    assert summary["camera_aim_error_max_rad"] < 2e-3
    assert summary["camera_pictures"] == 9
    assert 0.1 < summary["seen_fraction"] < 0.5, "no more than half of a convex body from one side"
    assert summary["seen_checks_hiding"] is True
    assert "seen of payload::payload" in (out / "replay.html").read_text()


#: A ball where trajectory 4's payload has its middle, in a colour that nothing else has.
MARKER_RADIUS = 0.1
BALL = f"<geometry><sphere><radius>{MARKER_RADIUS}</radius></sphere></geometry>"
MARKER = f"""<sdf version='1.9'><model name='marker'>
<pose>1.778 -1.8421 5.1537 0 0 0</pose><link name='ball'>
<collision name='c'>{BALL}</collision><visual name='v'>{BALL}
<material><diffuse>1 0 1 1</diffuse></material></visual></link></model></sdf>
"""


@pytest.mark.slow
@pytest.mark.render
@pytest.mark.timeout(300)
def test_the_target_is_in_the_middle_of_each_frame_while_the_arm_moves(tmp_path: Path) -> None:
    """Its place and size by the film's pixels alone, in a scene of nothing else."""
    av = pytest.importorskip("av")
    scene, out = tmp_path / "marker.sdf", tmp_path / "out"
    scene.write_text(MARKER)
    width, height = 320, 240
    changes = {
        "duration_s": 12,
        "motion.tip_speed_mm_per_s": 40,
        "actuation.show_uncompensated": "false",
        "camera.target_body": "marker::ball",
        "camera.picture_period_s": 1,
        "camera.width": width,
        "camera.height": height,
    }
    command = [sys.executable, "-m", "pips_drake", "simulate", "trajectory_4"]
    command += ["--scene", str(scene), "--out", str(out)]
    for key, value in changes.items():
        command += ["--set", f"{key}={value}"]
    done = run(command, capture_output=True, text=True, timeout=280, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    areas = []
    with av.open(str(out / PICTURES[0])) as container:
        for frame in container.decode(video=0):
            assert (frame.width, frame.height) == (width, height)
            red, green, blue = frame.to_ndarray(format="rgb24").astype(float).transpose(2, 0, 1)
            y, x = np.nonzero(np.minimum(red, blue) > 1.6 * green + 20.0)
            assert x.size > 100, f"no ball in frame {len(areas)}"
            middle = np.array([x.mean() - 0.5 * (width - 1), y.mean() - 0.5 * (height - 1)])
            assert np.abs(middle).max() < 0.01 * height, f"frame {len(areas)}"
            areas.append(x.size)
    # Every second, both ends included; the tip comes nearer, to where it is said to be.
    assert len(areas) == 1 + 12
    assert areas[-1] > 1.1 * areas[0]
    distance = read_summary(out / "summary.json")["camera_target_distance_end_m"]
    focal_length = 0.5 * height / np.tan(np.radians(25.0))
    radius = focal_length * MARKER_RADIUS / distance
    assert np.sqrt(areas[-1] / np.pi) == pytest.approx(radius, rel=0.03)


def standing(scenario: object, samples: int = 3) -> tuple[RunData, np.ndarray]:
    """A recorded run in which nothing moves, at home."""
    setup = load_setup(scenario)  # type: ignore[arg-type]
    q = setup.solver.solve(setup.path, [setup.path.home_arc_length]).joints[0]
    joints = np.tile(q, (samples, 1))
    nothing = np.zeros(samples)
    data = RunData(
        time=0.5 * np.arange(samples),
        tip_arc_lengths=nothing + setup.path.home_arc_length,
        commanded_joints=joints,
        joints=joints,
        joint_rates=0.0 * joints,
        joint_efforts=0.0 * joints,
        clearance=nothing,
        self_clearance=nothing,
        pairs=(None,) * samples,
        solution=np.zeros((samples, 2)),
    )
    return data, np.zeros((samples, 2))


@pytest.mark.render
def test_a_film_has_a_picture_for_each_of_its_times(tmp_path: Path) -> None:
    scenario = load_scenario("trajectory_4").config
    scenario.camera.width, scenario.camera.height = 160, 120
    data, pan_tilt = standing(scenario, samples=4)
    pan_tilt[:] = AIMED_AT_HOME
    found = film_run(tmp_path, scenario, load_setup(scenario), data=data, pan_tilt=pan_tilt)
    check_film(tmp_path / PICTURES[0], frames=4)
    assert found.summary["seen_checks_hiding"] is True
    # A convex body from one side: less than half.
    assert 0.1 < found.summary["seen_fraction"] < 0.5
    assert found.patches is not None
    assert "seen of payload::payload" in found.note


@pytest.mark.parametrize(
    "missing", ["render_available", pytest.param("video_available", marks=pytest.mark.render)]
)
def test_without_a_library_the_run_goes_on_and_says_which(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, missing: str
) -> None:
    scenario = load_scenario("trajectory_4").config
    scenario.camera.width, scenario.camera.height = 64, 48
    monkeypatch.setattr(film, missing, lambda: f"no {missing} here")
    data, pan_tilt = standing(scenario)
    pan_tilt[:] = AIMED_AT_HOME
    found = film_run(tmp_path, scenario, load_setup(scenario), data=data, pan_tilt=pan_tilt)
    assert found.summary["camera_film_missing"] == f"no {missing} here"
    assert found.summary["seen_checks_hiding"] is (missing == "video_available")
    assert found.summary["camera_aim_error_max_rad"] < 2e-3
    assert 0.1 < found.summary["seen_fraction"] < 0.5
    assert not (tmp_path / PICTURES[0]).exists()
    assert (tmp_path / PICTURES[1]).exists()


def test_a_point_as_target_has_no_surface(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = load_scenario("trajectory_4").config
    scenario.camera.target_body = ""
    scenario.camera.target_m = [1.778, -1.8421, 5.1537]
    monkeypatch.setattr(film, "render_available", lambda: "no EGL here")
    data, pan_tilt = standing(scenario)
    found = film_run(tmp_path, scenario, load_setup(scenario), data=data, pan_tilt=pan_tilt)
    assert found.patches is None
    assert "seen_fraction" not in found.summary
    # Straight ahead the target is 75 deg aside (a right triangle of 2.4 m).
    assert found.summary["camera_aim_error_max_rad"] > 1.0
    assert found.summary["camera_target_distance_end_m"] == pytest.approx(2.2, abs=0.3)


def test_pictures_are_the_samples_nearest_to_their_times() -> None:
    time = np.arange(97) / 32.0
    frames = film._frames(time, 0.5)
    np.testing.assert_allclose(time[frames], 0.5 * np.arange(7))
    assert film._frames(np.array([0.0]), 0.5).tolist() == [0]
    odd = film._frames(time, 0.1)
    assert np.abs(time[odd] - 0.1 * np.arange(len(odd))).max() <= 0.5 / 32.0 + 1e-12
