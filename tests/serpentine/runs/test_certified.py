"""Certified motions: what is proved agrees with closed forms, samples and the proof file."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from pips_drake.scenarios import load_scenario
from pips_drake.serpentine.runs import certified as runs_certified
from pips_drake.serpentine.runs.certified import (
    CertifiedMotion,
    certified_failures,
    certified_numbers,
    certify_motion,
    commanded_motion,
    write_proof,
)
from pips_drake.serpentine.runs.check import check
from pips_drake.serpentine.runs.placed_arm import PlacedArm, place_arm
from pips_drake.serpentine.runs.simulate import simulate
from pips_drake.serpentine.scenario import CheckConfig, SerpentineScenario
from pips_drake.serpentine.station import load_setup, make_profile
from pips_drake.twin.certificate.verify import verify_proof
from pips_drake.twin.motion_record import RecordedMotion

# The first certificate of a machine compiles its code.
pytestmark = [pytest.mark.timeout(300), pytest.mark.usefixtures("blank_figures")]

DEGREE = np.pi / 180.0


@pytest.fixture(scope="module")
def trajectory_4() -> SerpentineScenario:
    config = load_scenario("trajectory_4", {}).config
    assert isinstance(config, SerpentineScenario)
    return config


@pytest.fixture(scope="module")
def setup(trajectory_4):
    return load_setup(trajectory_4)


@pytest.fixture(scope="module")
def placed(trajectory_4, setup) -> PlacedArm:
    return place_arm(trajectory_4, setup)


def test_the_commanded_motion_is_what_the_drives_are_told_and_when(trajectory_4, setup):
    profile = make_profile(trajectory_4, setup)
    motion = commanded_motion(trajectory_4, setup, profile)
    np.testing.assert_array_equal(np.diff(motion.times), 1.0 / 64.0)
    assert profile.duration <= motion.times[-1] < profile.duration + 2.0 / 64.0
    ends = setup.solver.solve(setup.path, [setup.path.home_arc_length, setup.path.length]).joints
    np.testing.assert_array_equal(motion.positions[[0, -1]], ends)
    np.testing.assert_array_equal(motion.deviation, 0.0)


def test_a_slow_motion_has_no_more_knots_and_says_how_far_it_is_from_them(
    trajectory_4, setup, monkeypatch
):
    monkeypatch.setattr(runs_certified, "MOST_KNOTS", 6000)
    slow = dataclasses.replace(
        trajectory_4,
        motion=dataclasses.replace(trajectory_4.motion, tip_speed_mm_per_s=5.0),
    )
    motion = commanded_motion(slow, setup, make_profile(slow, setup))
    assert 3000 < len(motion.times) <= 6001
    assert 0.0 < motion.deviation.max() < 1e-5
    rows = np.linspace(motion.times[0], motion.times[-1], 997)
    travel = [make_profile(slow, setup)(time)[0] for time in rows]
    exact = setup.solver.solve(setup.path, setup.path.home_arc_length + np.array(travel)).joints
    straight = np.column_stack(
        [np.interp(rows, motion.times, motion.positions[:, j]) for j in range(18)]
    )
    # Between ticks follow-the-leader's joints are off the ticks' chords by their curvature alone:
    # 20 rad/m^2 times (5 mm/s / 64 Hz)^2 / 8 = 1.5e-8 rad.
    assert np.all(np.abs(exact - straight) <= motion.deviation + 2e-8)


def test_proved_sampled_and_verified_clearances_agree_on_trajectory_4(
    trajectory_4, setup, placed, tmp_path
):
    s = np.linspace(setup.path.home_arc_length, setup.path.length, 300)
    joints = setup.solver.solve(setup.path, s).joints
    motion = RecordedMotion(times=np.arange(300.0), positions=joints, deviation=np.zeros(18))
    certified = certify_motion(trajectory_4, setup, motion, placed, with_errors=True)
    numbers = certified_numbers(certified, setup.arm)
    # The README's and CHANGELOG's 39.0 mm.
    assert numbers["clearance_lower_m"] == pytest.approx(0.0390, abs=1.1e-4)
    assert 0.0 <= numbers["clearance_upper_m"] - numbers["clearance_lower_m"] <= 1e-4
    assert numbers["clearance_pair"] == ["prototype::segment_3", "pallet::pallet"]
    # Errors take something, and no more than what they move the arm's farthest point: 16 hinges
    # off by 0.05 deg, the tip of a straight arm 3.6 m and the last 0.5 m from them, 28 mm (FACTS).
    loss = numbers["clearance_lower_m"] - numbers["clearance_lower_with_errors_m"]
    assert 0.001 < loss < 0.030
    write_proof(tmp_path / "proof.npz", certified)
    report = verify_proof(tmp_path / "proof.npz")
    assert report.proved, report.failures
    assert report.groups["scene"].proved_lower >= numbers["clearance_lower_m"]


def test_check_proves_what_it_samples(tmp_path):
    """The straight arm moves along itself past a wall whose distance is known."""
    (tmp_path / "straight.csv").write_text(
        "x_in,y_in,z_in\n16.255,0,0\n16.255,0,174.902\n16.255,0,176\n"
    )
    (tmp_path / "wall.sdf").write_text(
        "<sdf version='1.9'><model name='wall'><link name='wall'><collision name='box'><geometry>"
        "<box><size>1 1 1</size></box></geometry></collision></link></model></sdf>"
    )
    # The camera head ends 6 in beyond the tip; the wall begins 0.1 m beyond that.
    z = (176.0 + 6.0) * 0.0254 + 0.1 + 0.5
    (tmp_path / "wall.dmd.yaml").write_text(
        f"directives:\n- add_model: {{name: wall, file: 'file://{tmp_path}/wall.sdf'}}\n"
        "- add_weld:\n    parent: frame_0\n    child: wall::wall\n"
        f"    X_PC: {{translation: [{16.255 * 0.0254}, 0, {z}]}}\n"
    )
    scenario = SerpentineScenario(path="straight.csv", scene="wall.dmd.yaml")
    verdict = check(scenario, name="wall", out=tmp_path / "out", folder=tmp_path)
    assert verdict.passed, verdict.failures
    # d1's home is off by 3e-5 in and the arm tilts by micrometres (FACTS); the tolerance is 0.1 mm.
    assert verdict.summary["clearance_certified_min_m"] == pytest.approx(0.1, abs=1.2e-4)
    assert verdict.summary["clearance_certified_min_m"] <= 0.1 + 2e-5
    assert verify_proof(tmp_path / "out" / "proof_commanded.npz").proved


def test_without_a_certificate_nothing_is_proved(tmp_path):
    scenario = SerpentineScenario(path="trajectory_4_arcs", scene="trajectory_4")
    scenario.certificate.enabled = False
    summary = check(scenario, name="plain", out=tmp_path / "out").summary
    assert not [key for key in summary if "certif" in key]
    assert not list((tmp_path / "out").glob("*.npz"))


def test_a_simulated_motion_is_proved_and_its_proof_written(tmp_path):
    scenario = SerpentineScenario(path="trajectory_4", scene="trajectory_4", duration_s=0.5)
    scenario.actuation.show_uncompensated = False
    summary = simulate(scenario, name="short", out=tmp_path / "out").summary
    for what in ("commanded", "simulated"):
        assert verify_proof(tmp_path / "out" / f"proof_{what}.npz").proved
    simulated = summary["certificate_simulated"]
    assert simulated["clearance_lower_m"] <= summary["clearance_sampled_min_m"] + 1e-6
    assert summary["clearance_certified_min_m"] == simulated["clearance_lower_m"]
    # Half a second at 64 Hz, both ends counted.
    assert simulated["knots"] == 33
    # At rest but for the first millimetres: steps stay near their chords.
    assert simulated["deviation_max"] < 1e-4


def made_up(lower: float) -> CertifiedMotion:
    witness = SimpleNamespace(bodies=("arm::tip", "box::box"), time=3.0)
    group = SimpleNamespace(lower=lower, upper=lower, witness=witness)
    clearance = SimpleNamespace(scene=group, own=None)
    return CertifiedMotion(clearance=clearance, with_errors=None, limits=None, motion=None)


@pytest.mark.parametrize(
    ("lower", "sampled", "words"),
    [
        (0.030, 0.031, []),
        (0.024, 0.026, ["arm::tip", "24.00 mm", "box::box", "3.00 s", ">= 25 mm"]),
        # Samples have failed the verdict already.
        (0.024, 0.0241, []),
        (0.030, 0.029, ["defect"]),
        # Nothing was sampled within reach.
        (0.6, None, []),
        (0.024, None, ["24.00 mm"]),
    ],
)
def test_what_fails_between_samples_is_said_and_contradictions_too(lower, sampled, words):
    seen = {} if sampled is None else {"clearance": sampled}
    found = certified_failures(made_up(lower), CheckConfig(), what="plan", sampled=seen)
    assert len(found) == bool(words)
    for word in words:
        assert word in found[0]
