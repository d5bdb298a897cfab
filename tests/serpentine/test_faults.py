"""Faults: what a scenario may say of them, and what they do to set-points and readings."""

from __future__ import annotations

import numpy as np
import pytest

from pips_drake.config import load_yaml
from pips_drake.errors import InputError, UnknownNameError
from pips_drake.serpentine.drives import drive_names, drives_from_joints
from pips_drake.serpentine.fault_config import FaultConfig
from pips_drake.serpentine.faults import (
    limits_with_faults,
    make_drive_faults,
    make_encoder_faults,
    misses_update,
    override_setpoints,
    read_encoders,
)
from pips_drake.serpentine.scenario import SerpentineScenario

SCENARIO = "machine: serpentine\npath: trajectory_4\nscene: trajectory_4\nfaults:\n  - "
GOOD = (
    "{kind: jam, drive: L3, start_s: 1.0, duration_s: 2.0}",
    "{kind: slow, drive: d1, size: 0.5}",
    "{kind: runaway, drive: theta2, size: -1.0}",
    "{kind: limited, drive: L8, size: 10.0}",
    "{kind: weak, drive: L8, size: 0.02, start_s: 1.0}\nactuation: {fidelity: leg}",
    "{kind: segment_length, segment: 6, size: -4.0}",
    "{kind: anchor, drive: L8, size: 3.0}",
    "{kind: dead, encoder: theta10}",
    "{kind: biased, encoder: d1, size: -3.0}",
    "{kind: payload_displaced, body: 'payload::payload', offset_mm: [0.0, 300.0, 0.0]}",
    "{kind: disturbance, force_n: [1.0, 0.0, 0.0], start_s: 1.0, duration_s: 1.0}",
    "{kind: late, size: 0.0}",
)
BAD = {
    "{kind: melts}": "faults.kind = melts; must be one of jam, slow",
    "{kind: jam}": "faults.drive of jam = ; must be given",
    "{kind: jam, drive: L3, size: 1.0}": "faults.size of jam = 1.0; must be left out",
    "{kind: dead, drive: L3}": "faults.drive of dead = L3; must be left out",
    "{kind: slow, drive: L3, size: 1.0}": "must be 0 .. 1, below 1",
    "{kind: runaway, drive: L3}": "must be -1 .. 1 and not 0",
    "{kind: quantised, encoder: d1}": "faults.size of quantised = 0.0; must be > 0",
    "{kind: late, size: 1.0}": "must be 0, or 2 or more",
    "{kind: jam, drive: L3, start_s: -1.0}": "faults.start_s = -1.0; must be 0 .. 86400",
    "{kind: disturbance}": "faults.force_n = [0.0, 0.0, 0.0]; must be not all zero",
    "{kind: jam, drive: L3, strength: 1.0}": "unknown key",
    "{kind: weak, drive: L3, size: 0.5}": "actuation.fidelity = joint; must be leg with a weak",
    "{kind: weak, drive: L3, size: 0.5}\nactuation: {fidelity: truss}": "= truss; must be leg",
    "{kind: weak, drive: L3, size: 0.0}": "faults.size of weak = 0.0; must be 0.001 .. 1, below 1",
    "{kind: weak, size: 0.5}": "faults.drive of weak = ; must be given",
    "{kind: segment_length, size: 3.0}": "faults.segment of segment_length = 0; must be 1 or more",
    "{kind: segment_length, segment: 1}": "= 0.0; must be -100 .. 100 and not 0",
    "{kind: segment_length, segment: 1, size: 1.0, start_s: 1.0}": "start_s of segment_length",
    "{kind: anchor, drive: L3, size: 30.0}": "faults.size of anchor = 30.0; must be -25 .. 25",
    "{kind: anchor, segment: 3, drive: L3, size: 1.0}": "segment of anchor = 3; must be left out",
    "{kind: anchor, size: 1.0}": "faults.drive of anchor = ; must be given",
}


def load(tmp_path, text: str) -> SerpentineScenario:
    file = tmp_path / "faulty.yaml"
    file.write_text(SCENARIO + text + "\n", encoding="utf-8")
    return load_yaml(SerpentineScenario, file)


@pytest.mark.parametrize("text", GOOD)
def test_a_fault_is_read(tmp_path, text):
    (fault,) = load(tmp_path, text).faults
    assert fault.kind in text


@pytest.mark.parametrize("text", BAD)
def test_a_fault_that_means_nothing_is_refused(tmp_path, text):
    with pytest.raises(InputError) as caught:
        load(tmp_path, text)
    assert BAD[text] in str(caught.value)


def test_a_name_that_the_arm_has_not_is_refused(arm):
    with pytest.raises(UnknownNameError, match="unknown drive 'L99'"):
        make_drive_faults(arm, [FaultConfig(kind="jam", drive="L99")])
    with pytest.raises(UnknownNameError, match="unknown encoder 'L3'"):
        make_encoder_faults(arm, [FaultConfig(kind="dead", encoder="L3")])
    # The base's drives are no springs between pins.
    with pytest.raises(UnknownNameError, match="unknown actuator 'd1'"):
        make_drive_faults(arm, [FaultConfig(kind="weak", drive="d1", size=0.5)])


def one(arm, **values):
    (fault,) = make_drive_faults(arm, [FaultConfig(**values)])
    return fault


def encoder(arm, **values):
    (fault,) = make_encoder_faults(arm, [FaultConfig(**values)])
    return fault


def test_a_fault_lasts_from_its_start_to_its_end(arm):
    fault = one(arm, kind="jam", drive="L3", start_s=1.0, duration_s=0.5)
    assert [fault.is_active(t) for t in (0.99, 1.0, 1.49, 1.5)] == [False, True, True, False]
    assert one(arm, kind="jam", drive="L3", start_s=1.0).is_active(1e5)


def test_a_slow_drive_has_a_share_of_its_speed(arm):
    fault = one(arm, kind="slow", drive="L4", size=0.25)
    ones = np.ones(arm.joints)
    speed = limits_with_faults([fault], 0.0, -ones, ones, ones)[2]
    assert drive_names(arm)[3] == "L4" and speed[3] == 0.25
    assert np.delete(speed, 3).tolist() == [1.0] * (arm.joints - 1)


def test_a_limited_drive_stands_where_its_joint_has_the_angle(arm):
    fault = one(arm, kind="limited", drive="L8", size=10.0)
    j = drive_names(arm).index("L8")
    # Truth: the triangle's lengths at the two angles.
    ends = []
    for angle in np.radians([-10.0, 10.0]):
        posture = np.zeros(arm.joints)
        posture[j] = angle
        ends.append(drives_from_joints(arm, posture)[j])
    assert (fault.lower, fault.upper) == pytest.approx((min(ends), max(ends)), abs=1e-12)


@pytest.mark.parametrize(("kind", "size", "moved"), [("jam", 0.0, 0.0), ("runaway", -0.5, -0.05)])
def test_what_a_servo_made_is_overridden(arm, kind, size, moved):
    fault = one(arm, kind=kind, drive="L3", size=size)
    n, limit = arm.joints, 10.0 * np.ones(arm.joints)
    setpoint = np.full(2 * n, 7.0)
    override_setpoints([fault], 0.0, 0.1, (-limit, limit, np.ones(n)), np.full(n, 2.0), setpoint)
    # Half of 1 m/s for 0.1 s.
    assert setpoint[2] == pytest.approx(2.0 + moved, abs=1e-15)
    assert setpoint[n + 2] == pytest.approx(moved / 0.1, abs=1e-12)
    assert np.delete(setpoint, [2, n + 2]).tolist() == [7.0] * (2 * n - 2)


def test_a_runaway_drive_stops_at_the_end_of_its_stroke(arm):
    fault = one(arm, kind="runaway", drive="L3", size=1.0)
    n = arm.joints
    limits = (np.zeros(n), np.full(n, 1.0), np.ones(n))
    setpoint = np.zeros(2 * n)
    override_setpoints([fault], 0.0, 0.1, limits, np.full(n, 0.96), setpoint)
    assert (setpoint[2], setpoint[n + 2]) == pytest.approx((1.0, 0.4), abs=1e-12)


def test_late_servos_miss_updates(arm):
    every_third = one(arm, kind="late", size=3.0, start_s=1.0)
    missed = [misses_update([every_third], k / 4.0, 0.25) for k in range(9)]
    assert missed == [False] * 4 + [True, True, False, True, True]
    none = one(arm, kind="late", start_s=0.0, duration_s=0.5)
    assert [misses_update([none], k / 4.0, 0.25) for k in range(3)] == [True, True, False]


def test_encoders_read_what_their_faults_let_them(arm):
    n = arm.joints
    before, state = np.full(2 * n, 0.5), np.full(2 * n, 0.111)
    faults = [
        encoder(arm, kind="dead", encoder="theta3"),
        encoder(arm, kind="stuck", encoder="theta4"),
        encoder(arm, kind="biased", encoder="theta5", size=1.0),
        encoder(arm, kind="biased", encoder="d1", size=1.0),
        encoder(arm, kind="quantised", encoder="theta6", size=5.0),
    ]
    reading, health = read_encoders(faults, 0.0, before, state)
    # 0.111 rad is 6.36 deg; 1 mm for the rail.
    expected = {2: 0.0, 3: 0.5, 4: 0.111 + np.pi / 180.0, 0: 0.112, 5: np.pi / 36.0}
    for j in range(n):
        assert reading[j] == pytest.approx(expected.get(j, 0.111), abs=1e-12)
    assert np.flatnonzero(health == 0.0).tolist() == [2] and health.sum() == n - 1
    assert reading[n + 2] == reading[n + 3] == 0.0
    np.testing.assert_array_equal(state, 0.111)
