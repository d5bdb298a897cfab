"""Which limit holds a motion back: its numbers and figure, and what a check and a run use."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest
from PIL import Image
from pydrake.systems.framework import DiagramBuilder

from pips_drake.cli import main
from pips_drake.errors import InputError, NotFollowableError
from pips_drake.serpentine.runs.assessment import Assessment
from pips_drake.serpentine.runs.check import check
from pips_drake.serpentine.runs.motion_report import motion_report, steady_speed_limits
from pips_drake.serpentine.runs.run import run_station
from pips_drake.serpentine.runs.simulate import simulate
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.statics import holding_efforts
from pips_drake.serpentine.station import (
    gravity_in_frame_0,
    load_setup,
    make_constant_profile,
    make_fastest_motion,
    make_plant,
    make_profile,
)


def fastest_scenario(**changes) -> SerpentineScenario:
    scenario = SerpentineScenario(path="trajectory_4_arcs", **changes)
    scenario.motion.profile = "fastest"
    return scenario


def test_the_scenario_chooses_between_constant_and_fastest():
    scenario = SerpentineScenario(path="trajectory_4_arcs")
    setup = load_setup(scenario)
    assert make_profile(scenario, setup) == make_constant_profile(scenario, setup)
    scenario.motion.profile = "fastest"
    profile = make_profile(scenario, setup)
    assert profile.duration == make_fastest_motion(scenario, setup).profile.duration
    assert profile.duration < 0.6 * make_constant_profile(scenario, setup).duration


@pytest.mark.parametrize("mounting", ["laboratory", "pad", "pad_below"])
def test_gravity_is_the_plants(mounting):
    scenario = fastest_scenario(mounting=mounting)
    setup = load_setup(scenario)
    plant, _, _ = make_plant(DiagramBuilder(), setup, scenario)
    motion = make_fastest_motion(scenario, setup).motion
    travel = 0.5 * (motion.travel[:1] + motion.travel[1:2])
    q = setup.solver.solve(setup.path, setup.path.home_arc_length + travel).joints
    hold = holding_efforts(setup.arm, q, gravity_in_frame_0(plant))[0]
    # The rail and the crane have no lever. Roundings of kilonewtons.
    np.testing.assert_allclose(motion.hold[0, :2], hold[:2], rtol=1e-9, atol=1e-6)


def test_the_report_says_which_limit_binds_where(tmp_path):
    scenario = SerpentineScenario(path="trajectory_4_arcs")
    numbers, failures = motion_report(scenario, load_setup(scenario), figure=tmp_path / "f.png")
    assert failures == []
    assert numbers["motion_profile"] == "constant"
    assert numbers["motion_duration_s"] == numbers["motion_duration_constant_s"]
    assert numbers["motion_duration_fastest_s"] < 0.6 * numbers["motion_duration_constant_s"]
    assert list(numbers["motion_binding_limits_s"]) == ["d1 speed", "d1 acceleration"]
    rows = numbers["motion_binding_segments"]
    assert rows[0][1] == 0.0
    for before, after in itertools.pairwise(rows):
        assert before[2] == after[1]  # they cover the path
    assert numbers["motion_fastest_speed_max_fraction"] == pytest.approx(0.95, abs=1e-3)
    assert numbers["motion_fastest_force_max_fraction"] < 0.6
    with Image.open(tmp_path / "f.png") as picture:
        assert picture.size == (1500, 1500)
        # The two limits' colours are in it.
        colors = {color for _, color in picture.convert("RGB").getcolors(1 << 20)}
        assert {(0x00, 0x72, 0xB2), (0xD5, 0x5E, 0x00)} <= colors


def test_the_fastest_motion_nowhere_exceeds_a_curve_of_the_figure():
    scenario = SerpentineScenario(path="trajectory_4_arcs")
    found = make_fastest_motion(scenario, load_setup(scenario))
    bounds = steady_speed_limits(found)[:, : found.limits.speed.shape[1]].min(axis=1)
    speed = np.sqrt(np.minimum(found.squared_speed[1:], found.squared_speed[:-1]))
    assert np.all(speed <= bounds * (1.0 + 1e-9))


def test_without_smoothness_the_constant_motion_still_has_its_numbers():
    scenario = SerpentineScenario(path="trajectory_4", corner_deviation_in=0.0)
    setup = load_setup(scenario)
    numbers, failures = motion_report(scenario, setup)
    assert failures == []
    assert "has corners" in numbers["motion_fastest_missing"]
    scenario.motion.profile = "fastest"
    for wanted in (motion_report, make_profile):
        with pytest.raises(InputError, match=r"path 'trajectory_4' has corners"):
            wanted(scenario, setup)


def test_a_share_that_cannot_hold_the_arm_fails_a_check():
    scenario = fastest_scenario()
    scenario.motion.limit_share = 0.3
    setup = load_setup(scenario)
    with pytest.raises(NotFollowableError, match="at rest"):
        make_profile(scenario, setup)
    verdict = check(scenario, name="weak")
    assert not verdict.passed
    assert "no fastest motion: no motion keeps the limits: at rest" in verdict.failures[0]


def test_a_check_judges_the_motion_that_is_wanted(tmp_path, blank_figures):
    verdict = check(fastest_scenario(), name="fast", out=tmp_path / "out")
    assert verdict.passed, verdict.failures
    assert verdict.summary["drive_speed_max_fraction"] == pytest.approx(0.95, abs=1e-3)
    written = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert written["motion_duration_s"] == written["motion_duration_fastest_s"]
    assert list(written["motion_binding_limits_s"]) == ["d1 speed", "d1 acceleration"]
    assert (tmp_path / "out" / "figures" / "fastest_motion.png").is_file()


def test_the_command_says_how_long_and_what_holds_it_back(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["check", "trajectory_4_arcs", "--scene", "none"])
    assert ended.value.code == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "way out at constant speed 92.97 s" in printed
    assert "way out as fast as the drives can 48.5 s" in printed
    assert "held back by d1 speed (98 %), d1 acceleration (2 %)" in printed


def test_a_run_may_be_the_fastest(tmp_path, blank_figures):
    scenario = fastest_scenario(duration_s=1 / 16)
    scenario.certificate.enabled, scenario.actuation.show_uncompensated = False, False
    verdict = simulate(scenario, name="fast", out=tmp_path / "out")
    assert verdict.passed, verdict.failures
    assert verdict.summary["motion_profile"] == "fastest"
    assert verdict.summary["cycle_time_s"] == pytest.approx(
        2 * verdict.summary["motion_duration_fastest_s"] + scenario.motion.dwell_s
    )
    assert (tmp_path / "out" / "figures" / "fastest_motion.png").is_file()


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("path", ["trajectory_4_arcs", "trajectory_2"])
def test_the_simulated_arm_stays_within_its_drives_limits(path):
    """The whole twin, out and back: what the plan keeps, the plant keeps."""
    scenario = SerpentineScenario(path=path, scene="trajectory_4" if "4" in path else "")
    scenario.motion.profile, scenario.motion.dwell_s = "fastest", 1.0
    setup = load_setup(scenario)
    run = run_station(scenario, setup)
    found = Assessment.of(scenario, setup, run.data)
    assert found.failures() == []
    # It is that fast, and not faster.
    assert 0.94 < found.speed_fractions.max() <= 1.0
    assert np.nanmax(found.effort_fractions) <= 1.0
    # The rail's set-points lag the command by 1.5 periods at 48 mm/s, about 1 mm.
    assert found.spine_errors.max() < 2e-3
    assert run.data.tip_arc_lengths.max() == pytest.approx(setup.path.length)
    assert run.data.tip_arc_lengths[-1] == pytest.approx(setup.path.home_arc_length)
