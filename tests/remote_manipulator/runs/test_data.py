"""What a run recorded: phases, inhibits, tracking, torques, events, and the files of it."""

from __future__ import annotations

import csv
from types import SimpleNamespace

import numpy as np
import pytest

from pips_drake.remote_manipulator.analog_inputs import angle_scaling
from pips_drake.remote_manipulator.configuration import JOINTS, STATIONS
from pips_drake.remote_manipulator.operator_recording import load_recording
from pips_drake.remote_manipulator.runs.data import Event, find_events
from pips_drake.remote_manipulator.runs.run_files import (
    station_letters,
    write_events,
    write_series,
)
from pips_drake.remote_manipulator.runs.simulate import all_events

from .made_run import CONFIG, flags, made_data, made_run, phases

WAY = phases("stowed", "stowed", "extraction", "extraction", "stowed", "extraction")


def test_phases_are_listed_in_order_as_often_as_they_were_entered():
    data = made_data(phase=WAY)
    assert data.phases == ["stowed", "extraction", "stowed", "extraction"]
    assert made_data().phases == ["stowed"]


@pytest.mark.parametrize(
    ("rows", "times"),
    [
        (["", "a", "", "", "", ""], 0),  # one frame in collision inhibits nothing
        (["", "a", "aA", "aA", "", ""], 1),
        (["", "aA", "", "aA", "aA", ""], 2),
        (["", "afAF", "afAF", "", "", ""], 1),  # both at once hold the same motion
        (["", "fF", "afAF", "aA", "", ""], 1),  # one takes over from the other
        (["A", "A", "", "F", "", ""], 2),  # the first frame counts too
    ],
)
def test_an_inhibit_is_counted_when_motion_stops_to_be_free(rows, times):
    assert made_data(flags=flags(*rows)).inhibits == times


def test_the_palm_is_compared_with_what_was_sent_a_frame_before():
    # The stand alone moves, so that the palm moves as much.
    heights = np.array([2.0, 2.0, 2.1, 2.3, 2.3, 2.3])
    setpoint = made_data().setpoint.copy()
    setpoint[:, 0] = heights
    late = made_data().arm.copy()
    late[1:, 0] = heights[:-1]
    np.testing.assert_allclose(
        made_data(setpoint=setpoint, arm=late).tracking_error(CONFIG), 0.0, atol=1e-15
    )
    late[3, 0] += 0.007
    error = made_data(setpoint=setpoint, arm=late).tracking_error(CONFIG)
    np.testing.assert_allclose(error, [0.0, 0.0, 0.0, 0.007, 0.0, 0.0], atol=1e-15)
    # By an angle: the whole arm turns about the stand, by its horizontal reach.
    turned = made_data().arm.copy()
    turned[2, 1] += 1e-4
    error = made_data(arm=turned).tracking_error(CONFIG)
    pitch_0 = CONFIG.arm.home[1]
    pitch_1, pitch_2 = pitch_0 + CONFIG.arm.home[2], pitch_0 + CONFIG.arm.home[2:5].sum()
    arm = CONFIG.arm
    reach = sum(
        length * np.cos(pitch)
        for length, pitch in (
            (arm.arm_0_m, pitch_0),
            (arm.arm_1_m, pitch_1),
            (arm.arm_2_m, pitch_2),
        )
    )
    # The chord is shorter than the arc by a part of 1e-8 / 24.
    assert error[2] == pytest.approx(1e-4 * reach, rel=1e-8)


def test_torques_are_shares_of_each_drives_own_limit():
    efforts = np.zeros((6, 8))
    efforts[3] = [-1000.0, 785.0, -1570.0, 537.0, 47.0, 0.0, -470.0, 100.0]
    shares = made_data(arm_efforts=efforts).torque_fractions(CONFIG)
    # The configuration's limits: 2000 N, 2 of 1570, 1074, 3 of 470 N m, 400 N.
    np.testing.assert_allclose(shares[3], [0.5, 0.5, 1.0, 0.5, 0.1, 0.0, 1.0, 0.25])
    assert not shares[[0, 1, 2, 4, 5]].any()


def test_events_are_what_changed_in_order_of_time():
    data = made_data(phase=WAY, flags=flags("", "a", "aA", "aA", "fF", ""))
    found = [(round(event.time, 9), event.kind, event.text) for event in find_events(data)]
    assert found == sorted(found, key=lambda event: event[0])
    assert set(found) == {
        (0.05, "collision", "collision of the arm begins"),
        (0.1, "inhibit", "arm motion inhibited"),
        (0.1, "phase", "stowed -> extraction"),
        (0.2, "phase", "extraction -> stowed"),
        (0.2, "collision", "collision of the arm is relieved"),
        (0.2, "collision", "collision of the finger begins"),
        (0.2, "inhibit", "arm motion free again"),
        (0.2, "inhibit", "finger motion inhibited"),
        (0.25, "phase", "stowed -> extraction"),
        (0.25, "collision", "collision of the finger is relieved"),
        (0.25, "inhibit", "finger motion free again"),
    }
    assert find_events(made_data()) == []


def test_what_the_welds_did_stands_among_the_events():
    switched = SimpleNamespace(time=0.12, action="hold", name="grasp")
    reset = SimpleNamespace(time=0.01, action="reset", name="")
    events = all_events(made_run(made_data(phase=WAY), attachments=[switched, reset]))
    texts = [(event.kind, event.text) for event in events]
    assert texts[:3] == [
        ("attachment", "reset"),
        ("phase", "stowed -> extraction"),
        ("attachment", "hold grasp"),
    ]


def read(file):
    with file.open(newline="") as stream:
        header, *rows = csv.reader(stream)
    return header, np.array(rows, dtype=float)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The files of a run in which every number is another one."""
    rng = np.random.default_rng(71)
    data = made_data()
    changes = {
        name: rng.normal(size=getattr(data, name).shape)
        for name in ("arm_efforts", "payload", "cae", "camera", "clearance", "penetration")
    }
    changes["display"] = {name: rng.normal(size=6) for name in data.display}
    changes["arm"] = data.arm + 0.01 * rng.normal(size=data.arm.shape)
    changes["setpoint"] = data.setpoint + 0.01 * rng.normal(size=data.setpoint.shape)
    changes["phase"], changes["flags"] = WAY, flags("", "a", "f", "A", "F", "af")
    changes["station"] = np.array([2, 2, 0, 0, 2, 12])
    made = made_data(**changes)
    path = tmp_path_factory.mktemp("series")
    write_series(path, made, CONFIG)
    return path, made


def test_every_series_has_its_clock_and_units_in_its_header(folder):
    path, _ = folder
    names = {"joints", "payload", "program", "cameras", "channels", "operator"}
    assert {file.stem for file in path.iterdir()} == names
    for name in names - {"operator"}:
        header, _ = read(path / f"{name}.csv")
        assert header[0] == "time_s"
        assert len(set(header)) == len(header)
    header, _ = read(path / "joints.csv")
    angles = [f"{name}_rad" for name in JOINTS]
    assert header[1:9] == ["stand_m", *angles, "gap_m"]
    sent = [f"{name}_sent_rad" for name in JOINTS]
    assert header[9:17] == ["stand_sent_m", *sent, "gap_sent_m"]
    torques = [f"{name}_effort_N_m" for name in JOINTS]
    assert header[17:] == ["stand_effort_N", *torques, "gap_effort_N"]
    header, _ = read(path / "channels.csv")
    assert header[1:] == [f"channel_{k}_V" for k in range(1, 18)]
    header, _ = read(path / "cameras.csv")
    assert header[1:] == ["station", "pan_rad", "tilt_rad", "field_of_view_rad"]


def test_series_read_back_are_what_was_recorded(folder):
    path, data = folder
    # Of recorded numbers 13 digits are written.
    same = dict(rtol=1e-12, atol=0.0)
    _, rows = read(path / "joints.csv")
    np.testing.assert_allclose(rows[:, 0], data.time, **same)
    np.testing.assert_allclose(rows[:, 1:9], data.arm, **same)
    np.testing.assert_allclose(rows[:, 9:17], data.setpoint[:, :8], **same)
    np.testing.assert_allclose(rows[:, 17:], data.arm_efforts, **same)
    header, rows = read(path / "payload.csv")
    np.testing.assert_allclose(rows[:, 1:8], data.payload, **same)
    np.testing.assert_allclose(rows[:, 8:], data.cae, **same)
    assert header[1:8] == [name.removeprefix("cae_") for name in header[8:]]
    header, rows = read(path / "program.csv")
    columns = dict(zip(header, rows.T, strict=True))
    np.testing.assert_array_equal(columns["phase"], data.phase)
    for k, name in enumerate(("arm_collision", "finger_collision", "arm_inhibit")):
        np.testing.assert_array_equal(columns[name], data.flags[:, k])
    for name, values in data.display.items():
        np.testing.assert_allclose(columns[name], values, **same)
    np.testing.assert_allclose(columns["clearance_m"], data.clearance, **same)


def test_the_operators_file_loads_again_as_a_recording(folder):
    path, data = folder
    recording = load_recording(path / "operator.csv", angle_scaling(CONFIG.arm))
    np.testing.assert_array_equal(recording.times, data.time)
    # Volts and degrees are both in between.
    np.testing.assert_allclose(
        recording.frames.angles, np.tile(CONFIG.arm.home, (6, 1)), rtol=1e-14
    )
    assert recording.at(0.1).station == "A"  # as the channels say


def test_events_are_a_table_of_times_kinds_and_words(tmp_path):
    write_events(tmp_path, [Event(time=1.25, kind="phase", text='a, "b" -> c')])
    with (tmp_path / "events.csv").open(newline="") as stream:
        assert list(csv.reader(stream)) == [
            ["time_s", "kind", "text"],
            ["1.25", "phase", 'a, "b" -> c'],
        ]


def test_stations_are_the_letters_that_were_chosen(folder):
    assert station_letters(folder[1]) == "CACM"
    assert STATIONS[12] == "M"
