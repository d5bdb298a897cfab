"""Verdicts of runs that were made up: every check by itself, on both sides of what it asks."""

from __future__ import annotations

import numpy as np
import pytest

from pips_drake.remote_manipulator.runs.judgement import judge, judged_frames, summarize
from pips_drake.remote_manipulator.runs.sheet import write_run_sheet
from pips_drake.remote_manipulator.scenario import CheckConfig, RemoteManipulatorScenario

from .made_run import CONFIG, DOCKED, PAIR, flags, made_data, made_run, phases, pose

CAE = np.array(CONFIG.central_assembly_element.location_m)


def summary_of(data=None, *, whole=True, checks=None, **changes):
    run = made_run(made_data() if data is None else data, **changes)
    return summarize(run, CONFIG, checks or CheckConfig(), whole=whole)


def failures_of(data=None, *, whole=True, run=None, **checks):
    config = CheckConfig(**checks)
    config.validate()
    numbers = summary_of(data, whole=whole, checks=config, **(run or {}))
    return judge(RemoteManipulatorScenario(checks=config), numbers)


def near_port(*distances, **changes):
    """A run whose probe is so far in front of the port, m."""
    places = [pose(*(CAE + DOCKED + [away, 0.0, 0.0])) for away in distances]
    return made_data(len(distances), payload=np.array(places), **changes)


def test_a_run_in_which_nothing_happens_passes():
    assert failures_of() == []


def test_frames_at_the_port_and_of_a_docked_payload_are_not_judged():
    held = phases("manoeuvring", "manoeuvring", "docked_held", "docked", "manoeuvring")
    data = near_port(0.51, 0.49, 0.6, 0.6, 3.0, phase=held)
    judged = judged_frames(data, CONFIG, CheckConfig(docking_zone_m=0.5))
    np.testing.assert_array_equal(judged, [True, False, False, False, True])
    # A free payload that drifts to the port is as near.
    assert not judged_frames(near_port(0.1), CONFIG, CheckConfig()).any()


def test_the_probe_counts_and_not_the_payloads_middle():
    # Turned by half a turn about z, the probe points away from the port.
    turned = pose(*(CAE + DOCKED))
    turned[:4] = [0.0, 0.0, 0.0, 1.0]
    data = made_data(1, payload=turned[None])
    assert judged_frames(data, CONFIG, CheckConfig(docking_zone_m=0.5)).all()
    zone = 2.0 * (0.5 * CONFIG.payload.length_m + CONFIG.payload.probe_length_m)
    assert judged_frames(data, CONFIG, CheckConfig(docking_zone_m=zone - 1e-6)).all()
    assert not judged_frames(data, CONFIG, CheckConfig(docking_zone_m=zone + 1e-6)).any()


def test_least_clearance_is_of_the_frames_that_are_judged():
    data = near_port(2.0, 1.0, 0.1, clearance=np.array([0.3, 0.25, 0.01]))
    summary = summary_of(data)
    assert summary["clearance_sampled_min_m"] == 0.25
    assert summary["clearance_min_time_s"] == 0.05
    assert summary["clearance_min_pair"] == PAIR
    assert summary["clearance_in_range"]
    assert failures_of(data, clearance_min_mm=249.0) == []
    (said,) = failures_of(data, clearance_min_mm=251.0)
    words = "clearance 250.0 mm (rms_payload::payload to rms_cargo_bay::cargo_bay) at 0.05 s; "
    assert said == f"{words}must be >= 251 mm"


def test_a_run_without_a_clearance_to_judge_says_that_it_is_far():
    data = near_port(0.1, 0.1, clearance=np.array([0.0, 0.0]))
    summary = summary_of(data)
    assert summary["clearance_sampled_min_m"] == 1.0 and not summary["clearance_in_range"]


def test_contact_is_allowed_where_no_clearance_is_asked_for():
    clearance = np.array([0.3, 0.3, 0.0, -1e-3, 0.3, 0.3])
    assert failures_of(made_data(clearance=clearance)) == []


def test_phases_must_be_those_that_are_asked_for():
    way = phases("stowed", "stowed", "extraction", "extraction", "stowed", "stowed")
    asked = ["stowed", "extraction", "stowed"]
    assert failures_of(made_data(phase=way), phases=asked) == []
    (said,) = failures_of(made_data(phase=way), phases=["stowed", "extraction"])
    assert said == "phases: stowed -> extraction -> stowed; must be stowed -> extraction"
    assert failures_of(made_data(phase=way)) == [], "nothing was asked"


def test_inhibits_must_be_as_many_as_allowed():
    data = made_data(flags=flags("", "aA", "", "aA", "aA", ""))
    assert failures_of(data, inhibits_min=2, inhibits_max=2) == []
    assert failures_of(data, inhibits_max=1) == ["motion was inhibited 2 times; must be 0 .. 1"]
    said = failures_of(data, inhibits_min=3, inhibits_max=9)
    assert said == ["motion was inhibited 2 times; must be 3 .. 9"]
    assert summary_of(data)["frames_inhibited"] == 3


def test_bodies_may_be_pressed_only_so_deep():
    depth = np.array([0.0, 0.004, 0.0, 0.0102, 0.0, 0.0])
    data = made_data(penetration=depth)
    assert failures_of(data, penetration_max_mm=10.3) == []
    (said,) = failures_of(data, penetration_max_mm=10.0)
    assert said == "bodies were pressed 10.2 mm into each other at 0.15 s; must be <= 10 mm"


def test_the_palm_must_be_near_where_it_was_sent():
    arm = made_data().arm.copy()
    arm[4, 0] += 0.12
    assert failures_of(made_data(arm=arm), tracking_error_max_mm=121.0) == []
    (said,) = failures_of(made_data(arm=arm))
    assert said == "the palm was 120 mm from where it was sent; must be <= 100 mm"


def test_a_joint_must_not_be_beyond_its_hard_limit():
    arm = made_data().arm.copy()
    arm[:, 3] = np.radians(2.4 + 0.4)  # P1's upper limit and less than half of a degree
    # Sent there too, or the palm would be far from where it was sent.
    sent = made_data().setpoint.copy()
    sent[:, 3] = arm[:, 3]
    assert failures_of(made_data(arm=arm, setpoint=sent)) == []
    arm[2, 3] = sent[1, 3] = np.radians(2.4 + 0.6)
    (said,) = failures_of(made_data(arm=arm, setpoint=sent))
    assert said == "joint P1 was 0.60 deg beyond its hard limit; must be within"


def test_an_operator_must_be_done_unless_the_scenario_ends_the_run():
    (said,) = failures_of(run={"finished": False})
    assert said == "the operator was not done after 4 s"
    assert failures_of(run={"finished": False}, whole=False) == []


def test_an_operator_that_cannot_go_on_fails_the_run():
    why = "step 3 (carry): the arm cannot hold its palm there"
    for whole in (True, False):
        assert failures_of(run={"finished": False, "stopped": why}, whole=whole) == [why]


def test_docking_is_told_as_the_frame_that_decided_saw_it():
    way = phases(*["manoeuvring"] * 3, *["docked_held"] * 3)
    display = made_data().display | {
        "docking_distance_m": np.array([0.3, 0.2, 0.1, 0.07, 0.0, 0.0]),
        "docking_angle_rad": np.array([0.03, 0.02, 0.01, 0.005, 0.0, 0.0]),
    }
    summary = summary_of(made_data(phase=way, display=display))
    assert summary["docked_at_s"] == pytest.approx(0.15)
    assert (summary["docking_distance_m"], summary["docking_angle_rad"]) == (0.07, 0.005)
    # A grasp of a payload that is docked already is no docking.
    grasped = made_data(phase=phases(*["docked"] * 3, *["docked_held"] * 3), display=display)
    assert "docked_at_s" not in summary_of(grasped)


def test_numbers_name_the_joint_that_they_are_of():
    efforts = np.zeros((6, 8))
    efforts[0] = np.nan  # before the first step nothing has acted
    efforts[4, 5] = -0.8 * 470.0
    arm = made_data().arm.copy()
    arm[2, 4] = np.radians(121.3 - 3.0)
    summary = summary_of(made_data(arm_efforts=efforts, arm=arm))
    assert summary["torque_fraction_max"] == pytest.approx(0.8)
    assert summary["torque_fraction_max_joint"] == "P2"
    assert summary["joint_margin_min_rad"] == pytest.approx(np.radians(3.0))
    assert summary["joint_margin_min_joint"] == "H2"
    assert summary["phase_times_s"] == [0.0]
    assert summary["real_time_rate"] == 2.0


def test_a_run_of_one_frame_has_a_summary():
    efforts = np.full((1, 8), np.nan)
    summary = summary_of(made_data(1, arm_efforts=efforts))
    assert summary["torque_fraction_max"] == 0.0
    assert summary["phases"] == ["stowed"]


def sheet(tmp_path, data, **checks):
    config = CheckConfig(**checks)
    summary = summary_of(data, checks=config) | {"scenario": "made"}
    failures = judge(RemoteManipulatorScenario(checks=config), summary)
    write_run_sheet(tmp_path, summary, failures, config)
    assert (tmp_path / "summary.png").is_file()
    return (tmp_path / "summary.html").read_text()


def row(label, value, allowed, good):
    kind = {True: "good", False: "bad", None: ""}[good]
    return f'<tr class="{kind}"><td>{label}</td><td>{value}</td><td>{allowed}</td></tr>'


def test_the_sheet_has_every_number_beside_what_is_allowed(tmp_path, blank_figures):
    text = sheet(tmp_path, made_data(), clearance_min_mm=100.0)
    assert "made: PASS" in text or ("PASS" in text and "made" in text)
    label = "clearance of arm and payload"
    assert row(label, "over 1000 mm", "&gt;= 100 mm", True) in text
    assert row("motion inhibited", "0 times", "0 .. 0", True) in text
    assert row("deepest contact", "0.00 mm", "&lt;= 10 mm", True) in text
    assert row("palm to where it was sent", "0 mm", "&lt;= 100 mm", True) in text
    assert "10000 kg" in text and "stowed, in 4 s" in text
    assert "when docked" not in text


def test_the_sheet_shows_what_was_not_kept(tmp_path, blank_figures):
    data = made_data(
        penetration=np.full(6, 0.02),
        clearance=np.full(6, 0.04),
        flags=flags("", "aA", "", "", "", ""),
    )
    text = sheet(tmp_path, data, clearance_min_mm=100.0)
    assert "FAIL" in text
    label = "clearance of arm and payload"
    assert row(label, "40 mm", "&gt;= 100 mm", False) in text
    assert row("deepest contact", "20.00 mm", "&lt;= 10 mm", False) in text
    assert row("motion inhibited", "1 times", "0 .. 0", False) in text
    assert "<li>motion was inhibited 1 times; must be 0 .. 0</li>" in text
    # Where nothing is asked of a number, it is neither good nor bad.
    assert row(label, "40 mm", "", None) in sheet(tmp_path, data)
    # Half a millimetre of contact is not "-0 mm".
    pressed = made_data(clearance=np.full(6, -4.6e-4))
    assert row(label, "-0.5 mm", "", None) in sheet(tmp_path, pressed)
