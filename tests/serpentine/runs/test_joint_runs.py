"""The twin runs, checks and judges motions that are given by joints."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from pips_drake.errors import InputError
from pips_drake.scenarios import load_scenario
from pips_drake.scenarios import simulate as simulate_loaded
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.joint_motion import JointMotion
from pips_drake.serpentine.joint_motion_file import read_joint_motion, write_joint_motion
from pips_drake.serpentine.joint_motion_pacing import paced
from pips_drake.serpentine.motion_words import DONE
from pips_drake.serpentine.runs.assessment import Assessment
from pips_drake.serpentine.runs.check import check
from pips_drake.serpentine.runs.run import run_station
from pips_drake.serpentine.runs.scene_report import with_joint_motion_file
from pips_drake.serpentine.runs.simulate import simulate
from pips_drake.serpentine.runs.study import _task
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import load_setup, make_profile
from pips_drake.serpentine.supervision import Mode
from pips_drake.twin.study.study_file import StudyFile
from pips_drake.twin.summary import versions

PERIOD = 1.0 / 64.0


@pytest.fixture(scope="module")
def arm():
    return load_arm("prototype")


@pytest.fixture(scope="module")
def aside(arm):
    """Out by 0.1 m, the whole arm a little aside and back: no path of the tip says so."""
    joints = np.tile(arm.joint_home, (4, 1))
    joints[1:, 0] += 0.1
    joints[2, [2, 5, 8]] += [0.02, 0.03, -0.04]
    return paced(arm, JointMotion(times=np.array([0.0, 4.0, 6.0, 8.0]), joints=joints))


def make_scenario(**changes):
    scenario = SerpentineScenario(joints="given.csv")
    scenario.certificate.enabled = False
    scenario.motion.dwell_s, scenario.motion.settle_s = 0.5, 0.5
    return dataclasses.replace(scenario, **changes)


def test_a_path_scenario_and_its_joints_do_the_same():
    scenario = make_scenario(joints="", path="trajectory_1", duration_s=3.0)
    # So short a ramp that the joints' clock is at its full rate after one period.
    scenario.supervisor.hold_ramp_s = PERIOD
    scenario.motion.ramp_s = 1.0
    by_path = load_setup(scenario)
    profile = make_profile(scenario, by_path)
    # That first period takes it half a period ahead: this is where its rows stand.
    ticks = np.arange(4 * 64)
    travel = np.array([profile(tick * PERIOD)[0] for tick in ticks])
    path = by_path.path
    solution = by_path.solver.solve(path, path.home_arc_length + travel)
    times = np.concatenate([[0.0], (ticks[1:] - 0.5) * PERIOD])
    motion = JointMotion(times=times, joints=solution.joints)
    by_joints = load_setup(scenario, joint_motion=motion)
    first, second = (run_station(scenario, setup) for setup in (by_path, by_joints))
    np.testing.assert_array_equal(second.data.time, first.data.time)
    # Both interpolate nothing at updates: what differs is the clock's rounding.
    np.testing.assert_allclose(
        second.data.commanded_joints, first.data.commanded_joints, rtol=0, atol=1e-11
    )
    np.testing.assert_allclose(second.data.joints, first.data.joints, rtol=0, atol=1e-9)
    assert np.ptp(first.data.joints[:, 0]) > 0.03
    # Where each spine point should be is where the commanded joints have it.
    errors = Assessment.of(scenario, by_joints, second.data)
    wanted = kinematics.spine_points(by_path.arm, first.data.commanded_joints)
    reached = kinematics.spine_points(by_path.arm, first.data.joints)
    expected = np.linalg.norm(reached - wanted, axis=-1)
    np.testing.assert_allclose(errors.spine_errors, expected, rtol=0, atol=1e-8)
    assert errors.deviation is None


@pytest.mark.slow
def test_coarser_rows_are_off_by_what_straight_lines_leave():
    scenario = make_scenario(joints="", path="trajectory_1", duration_s=2.0)
    scenario.supervisor.hold_ramp_s = PERIOD
    scenario.motion.ramp_s = 1.0
    by_path = load_setup(scenario)
    profile, step = make_profile(scenario, by_path), 0.25
    times = np.append(0.0, np.arange(0.5 * PERIOD, 3.0, step))
    # Half a period behind, as above.
    travel = np.array([profile(t + 0.5 * PERIOD if t else 0.0)[0] for t in times])
    path = by_path.path
    joints = by_path.solver.solve(path, path.home_arc_length + travel).joints
    coarse = load_setup(scenario, joint_motion=JointMotion(times=times, joints=joints))
    first, second = (run_station(scenario, setup) for setup in (by_path, coarse))
    off = np.abs(second.data.commanded_joints - first.data.commanded_joints)[:, 0].max()
    # The base moves with the tip, whose acceleration is at most 1.5 v / ramp; the farthest from a
    # chord is a dt^2 / 8.
    bound = 1.5 * 0.025 / 1.0 * step**2 / 8.0
    assert 0.3 * bound < off < 1.05 * bound


@pytest.mark.slow
def test_it_goes_out_dwells_and_comes_back_under_the_supervisor(arm, aside):
    scenario = make_scenario(scene="trajectory_4")
    setup = load_setup(scenario, joint_motion=aside)
    run = run_station(scenario, setup)
    assert run.supervised is not None
    assert (run.supervised.mode, run.supervised.phase) == (Mode.PERMIT, DONE)
    assert run.supervised.completed
    judged = Assessment.of(scenario, setup, run.data)
    assert judged.failures() == []
    summary = judged.summary()
    assert summary["path_deviation_max_m"] is None
    assert summary["spine_error_max_m"] < 2e-3
    # To the end and back to the beginning.
    commanded = run.data.commanded_joints
    middle = int(np.argmax(run.data.tip_arc_lengths))
    np.testing.assert_allclose(commanded[middle], aside.joints[-1], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(commanded[[0, -1]], aside.joints[[0, 0]])


@pytest.mark.slow
def test_the_supervisor_holds_what_swings_into_the_scene_and_takes_it_back(arm):
    joints = np.tile(arm.joint_home, (3, 1))
    joints[1:, 0] += 0.05
    joints[2, [4, 6]] -= 0.15  # towards the pallet's wall, which stands 121 mm away
    motion = paced(arm, JointMotion(times=np.array([0.0, 3.0, 23.0]), joints=joints))
    scenario = make_scenario(scene="trajectory_4")
    scenario.motion.retract = False
    scenario.supervisor.patience_s = 1.0
    setup = load_setup(scenario, joint_motion=motion)
    run = run_station(scenario, setup)
    assert run.supervised is not None
    assert [one.after for one in run.supervised.decisions] == [Mode.HOLD, Mode.RETRACT]
    assert run.supervised.safe
    # It came to rest clear of the wall, and went back as it had come.
    assert run.data.clearance.min() > 0.9e-3 * scenario.supervisor.hold_clearance_mm
    np.testing.assert_array_equal(run.data.commanded_joints[-1], motion.joints[0])
    assert np.ptp(run.data.commanded_joints[:, 4]) < 0.15


def test_check_judges_joints_without_a_run(arm, aside):
    scenario = make_scenario(scene="trajectory_4")
    scenario.certificate.enabled = True
    verdict = check(scenario, name="aside", joint_motion=aside)
    assert verdict.failures == ()
    summary = verdict.summary
    certified = summary["certificate_commanded"]["clearance_lower_m"]
    assert 0.0 < certified <= summary["clearance_sampled_min_m"] + 1e-6
    assert summary["motion_duration_s"] == aside.duration
    assert 0.0 < summary["drive_speed_max_fraction"] < 1.0
    assert 0.0 < summary["drive_effort_max_fraction"] < 1.0
    assert "path" not in summary


def test_check_says_what_the_arm_cannot_do(arm):
    joints = np.tile(arm.joint_home, (3, 1))
    joints[1, 5] += 1.0
    motion = JointMotion(times=np.array([0.0, 0.5, 9.0]), joints=joints)
    verdict = check(make_scenario(), name="bad", joint_motion=motion)
    limits, stroke, speed = verdict.failures
    assert limits.startswith("joint theta6 leaves its limits -30.000 .. 30.000 deg: 57.296 deg")
    assert stroke.startswith("actuator L6 would be ")
    assert speed.startswith("drive L6 would need ")


@pytest.mark.slow
def test_what_breaks_a_limit_is_not_run(arm, tmp_path):
    joints = np.tile(arm.joint_home, (2, 1))
    joints[1, 0] -= 0.1
    motion = JointMotion(times=np.array([0.0, 9.0]), joints=joints)
    verdict = simulate(make_scenario(), name="bad", out=tmp_path / "out", joint_motion=motion)
    (failure,) = verdict.failures
    assert failure.startswith("joint d1 leaves its limits")
    assert "simulated_s" not in verdict.summary
    assert (tmp_path / "out" / "figures" / "joints.png").is_file()


def test_a_rail_that_stands_where_it_stands_is_not_shifted(aside):
    with pytest.raises(InputError, match=r"rail_shift_m = 0.5; must be 0 for arm 'prototype'"):
        load_setup(make_scenario(rail_shift_m=0.5), joint_motion=aside)


def test_a_scenario_with_joints_has_no_path_to_ask_for(aside):
    with pytest.raises(InputError, match="motion 'planned' is given by joints; must follow a path"):
        _ = load_setup(make_scenario(), joint_motion=aside).path


def test_the_joints_file_lies_inside_the_scenarios_folder(arm, aside, tmp_path):
    (tmp_path / "inner").mkdir()
    write_joint_motion(tmp_path / "m.csv", arm, aside)
    with pytest.raises(InputError, match="lies outside"):
        load_setup(make_scenario(joints="../m.csv"), folder=tmp_path / "inner")
    setup = load_setup(make_scenario(joints="m.csv"), folder=tmp_path)
    assert setup.motion.name == "m"
    np.testing.assert_array_equal(setup.motion.home, arm.joint_home)


def test_a_long_motion_is_written_as_an_archive_that_reads_back(arm, tmp_path):
    joints = np.tile(arm.joint_home, (6000, 1))
    joints[:, 0] += np.linspace(0.0, 0.1, 6000)
    motion = JointMotion(times=0.01 * np.arange(6000.0), joints=joints)
    setup = load_setup(make_scenario(), joint_motion=motion)
    written = with_joint_motion_file(make_scenario(), setup, tmp_path)
    assert (written.joints, written.path) == ("joint_motion.npz", "")
    again = load_setup(written, folder=tmp_path)
    assert again.motion.version == setup.motion.version


def test_a_study_varies_no_joints_that_are_given(arm, aside, tmp_path):
    write_joint_motion(tmp_path / "m.csv", arm, aside)
    (tmp_path / "run.yaml").write_text("machine: serpentine\njoints: m.csv\n")
    study = StudyFile(scenario="run.yaml", vary=[], description="d")
    with pytest.raises(InputError, match="joints are given; a study varies an arm on a path"):
        _task(study, tmp_path / "run.yaml", {})


@pytest.mark.slow
def test_a_run_is_written_whole_and_runs_again_from_what_it_wrote(arm, aside, tmp_path):
    scenario = make_scenario(scene="trajectory_4")
    scenario.certificate.enabled = True
    out = tmp_path / "first"
    verdict = simulate(scenario, name="aside", out=out, joint_motion=aside)
    assert verdict.failures == ()
    files = ("replay.html", "tip.csv", "joints.csv", "proof_commanded.npz", "proof_simulated.npz",
             "summary.png", "figures/path.png", "figures/tracking.png")  # fmt: skip
    assert [name for name in files if not (out / name).is_file()] == []
    read = read_joint_motion(out / "joint_motion.csv", arm)
    np.testing.assert_array_equal(read.joints, aside.joints)
    loaded = load_scenario(str(out / "scenario.yaml"))
    assert (loaded.config.joints, loaded.config.path) == ("joint_motion.csv", "")
    again = simulate_loaded(loaded, out=tmp_path / "second")
    assert again.passed
    # Another name and another clock on the wall; the rest is the same, byte for byte.
    for name in ("joints.csv", "tip.csv", "clearance.csv", "supervisor.csv"):
        assert (tmp_path / "second" / name).read_bytes() == (out / name).read_bytes()
    summary = json.loads((out / "summary.json").read_text())
    assert summary["versions"] == versions()
    assert summary["cycle_completed"]
    assert summary["path_deviation_max_m"] is None


@pytest.mark.slow
def test_the_arm_of_twenty_links_does_what_it_is_given():
    arm = load_arm("cmu_92")
    joints = np.tile(arm.joint_home, (4, 1))
    joints[1:, 0] += 0.2
    # A wave through all hinges, which leaves the tip nearly where it was.
    joints[2, 3:41] += 0.02 * np.sin(np.arange(38))
    motion = paced(arm, JointMotion(times=np.array([0.0, 8.0, 12.0, 16.0]), joints=joints))
    scenario = make_scenario(arm="cmu_92", scene="cargo_bay", mounting="laboratory")
    scenario.rail_shift_m = -5.334
    scenario.motion.retract = False
    setup = load_setup(scenario, joint_motion=motion)
    assert setup.rail_shift == -5.334
    run = run_station(scenario, setup)
    judged = Assessment.of(scenario, setup, run.data)
    assert judged.failures() == []
    # Half of what the check allows: what is left rings at the arm's lowest mode.
    assert judged.spine_errors.max() < 5e-3
    assert run.supervised is not None
    assert run.supervised.completed
    # The rail's shift counts: the tip begins 0.25 m before the port, and what it nears is the bay.
    pair = judged.data.pairs[judged.nearest]
    assert pair is not None
    assert pair[1].startswith("bay::")
