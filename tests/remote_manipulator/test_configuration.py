"""The machine's one configuration file: what it holds, and what it refuses."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from pips_drake.errors import InputError
from pips_drake.remote_manipulator.configuration import (
    JOINTS,
    STATIONS,
    load_configuration,
)
from pips_drake.scene.packages import find_file

SHIPPED = find_file("manipulator", "rms_71").read_text(encoding="utf-8")


def write(folder: Path, *, old: str, new: str) -> str:
    assert old in SHIPPED
    file = folder / "own.yaml"
    file.write_text(SHIPPED.replace(old, new, 1), encoding="utf-8")
    return str(file)


def test_the_shipped_machine_has_six_joints_and_thirteen_stations_in_order():
    config = load_configuration()
    assert [joint.name for joint in config.arm.joints] == list(JOINTS)
    assert "".join(station.name for station in config.cameras.stations) == STATIONS


def test_limits_and_rates_are_the_flight_arms():
    arm = load_configuration().arm
    np.testing.assert_allclose(np.degrees(arm.upper), [180, 145, 2.4, 121.3, 121.4, 447])
    np.testing.assert_allclose(np.degrees(arm.lower), [-180, -2, -161, -121.3, -121.4, -447])
    np.testing.assert_allclose(np.degrees(arm.rates), [1.27, 1.27, 1.78, 2.64, 2.64, 2.64])
    np.testing.assert_allclose(arm.torques, [1570, 1570, 1074, 470, 470, 470])


def test_the_reports_numbers_are_as_printed():
    config = load_configuration()
    acquisition, docking = config.acquisition, config.docking
    assert (acquisition.front_ft, acquisition.rear_ft, acquisition.top_ft) == (0.5, 0.5, 1 / 16)
    assert acquisition.far_ft == 8.0
    assert (docking.distance_ft, docking.cosine_deficit_log2) == (0.25, -10)
    # About 2 deg 32 min.
    assert np.degrees(np.arccos(1 - 2.0**-10)) == pytest.approx(2 + 32 / 60, abs=1 / 60)
    assert (config.cameras.narrowest_deg, config.cameras.widest_deg) == (25.0, 60.0)


def test_the_payload_leaves_room_in_the_bay():
    config = load_configuration()
    bay, payload = config.cargo_bay, config.payload
    side = 0.5 * (bay.width_m - payload.across_flats_m)
    assert side == pytest.approx(0.1524)  # 6 in
    bottom = payload.location_m[2] + 0.5 * payload.across_flats_m
    assert 0.0 < bay.location_m[2] + bay.depth_m - bottom < 0.2


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("length_m: 15.24", "length_m: 19.0", "length_m = 19.0 m; must be 0 .. 18.288 m"),
        ("length_m: 15.24", "length_m: 18.2", "length_m = 18.8 m; must be < 18.288 m, the bay's"),
        ("across_flats_m: 4.2672", "across_flats_m: 4.571", None),
        ("across_flats_m: 4.2672", "across_flats_m: 4.573", "must be 0 .. 4.572 m"),
        ("mass_kg: 10000.0", "mass_kg: 40000.0", "mass_kg = 40000.0 kg; must be 0 .. 29484 kg"),
        ("{name: P0,", "{name: P9,", "ArmConfig.joints = "),
        ("lower_deg: -2.0", "lower_deg: 150.0", "joint P0: limits = 150.0 .. 145.0 deg"),
        ("arm_0_m: 6.378", "arm_0_m: -6.378", "ArmConfig.arm_0_m = -6.378; must be > 0"),
        ("arm_0_m: 6.378", "arm_0_m: .nan", "must be a finite number"),
        ("upper_m: 4.0", "upper_m: 1.0", "StandConfig.upper_m = 1.0; must be > lower_m"),
        ("prong_open_gap_m: 0.60", "prong_open_gap_m: 0.1", "must be > prong_closed_gap_m"),
        ("home_deg: [-14.0,", "home_deg: [-190.0,", "ArmConfig.home_deg: H0 = -190.0 deg"),
        ("home_deg: [-14.0, ", "home_deg: [", "ArmConfig.home_deg = "),
        ("widest_deg: 60.0", "widest_deg: 20.0", "CamerasConfig.widest_deg = 20.0"),
        ("port_offset_m: 1.25", "port_offset_m: 9.0", "on the CAE: within half of height_m"),
        ("front_ft: 0.5", "front_ft: 5.0", "longer than acquisition.front_ft + rear_ft"),
        ("cosine_deficit_log2: -10", "cosine_deficit_log2: 3", "must be -40 .. -1"),
        ("name: rms_71", "nome: rms_71", "unknown key"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_with_one_line(tmp_path, old, new, message):
    file = write(tmp_path, old=old, new=new)
    if message is None:
        load_configuration(file)
        return
    with pytest.raises(InputError, match=re.escape(message)) as refused:
        load_configuration(file)
    assert "\n" not in str(refused.value)


def test_an_unknown_machine_lists_the_shipped_one():
    with pytest.raises(InputError, match="rms_71"):
        load_configuration("rms_72")
