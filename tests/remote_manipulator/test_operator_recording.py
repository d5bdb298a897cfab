"""An operator's session is read back as it was; a bad file is refused in one line."""

from __future__ import annotations

import re

import numpy as np
import pytest

from pips_drake.errors import InputError
from pips_drake.remote_manipulator.analog_inputs import angle_scaling
from pips_drake.remote_manipulator.configuration import load_configuration
from pips_drake.remote_manipulator.operator_inputs import OperatorInputs, frames_of
from pips_drake.remote_manipulator.operator_recording import (
    MOST_ROWS,
    OperatorRecording,
    load_recording,
    write_recording,
    write_volts,
)

SCALING = angle_scaling(load_configuration().arm)
ANGLES = "H0_deg,P0_deg,P1_deg,H2_deg,P2_deg,R2_deg"
HEADER = f"time_s,{ANGLES}"
VOLTS = "time_s," + ",".join(f"channel_{number}_V" for number in range(1, 14))


def write(tmp_path, text: str):
    file = tmp_path / "session.csv"
    file.write_text(text, encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def session() -> OperatorRecording:
    """Every value of every field at some time."""
    rng = np.random.default_rng(8)
    values = (-1, 0, 1)
    cameras = ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))
    inputs = [
        OperatorInputs(
            angles=rng.uniform(-1.0, 1.0, 6) * SCALING.largest_angles,
            initialize=row % 2 == 1,
            initialize_select=("full", "mode_1", "mode_2_or_3")[row % 3],
            telescope=values[row % 3],
            pan=cameras[row % 5][0],
            tilt=cameras[row % 5][1],
            zoom=values[row // 2 % 3],
            station="ABCDEFGHIJKLM"[row % 13],
            prong=values[row // 3 % 3],
            shuttle=(values[row % 3], values[row // 4 % 3], values[row // 5 % 3]),
            open_latch=row // 3 % 2 == 1,
        )
        for row in range(60)
    ]
    times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.05, 1.0, 59))])
    return OperatorRecording(times=times, frames=frames_of(inputs))


@pytest.mark.parametrize("kind", ["inputs", "volts"])
def test_a_session_reads_back_as_it_was_written(session, tmp_path, kind):
    file = tmp_path / "session.csv"
    if kind == "inputs":
        write_recording(file, session)
    else:
        write_volts(file, session, SCALING)
    read = load_recording(file, SCALING)
    np.testing.assert_array_equal(read.times, session.times)
    np.testing.assert_array_equal(read.frames.switches, session.frames.switches)
    # Into degrees or volts and back: two roundings.
    np.testing.assert_allclose(read.frames.angles, session.frames.angles, rtol=5e-16)
    assert read.duration == session.times[-1]


def test_columns_that_are_not_there_stay_off_and_comments_are_none(tmp_path):
    text = f"# by hand\n\n{HEADER},station\n0,1,2,3,4,5,6,C\n# later\n2,7,8,9,10,11,12,M\n"
    recording = load_recording(write(tmp_path, text), SCALING)
    one = recording.at(0.0)
    np.testing.assert_allclose(np.degrees(one.angles), [1, 2, 3, 4, 5, 6], rtol=1e-15)
    assert (one.station, one.initialize_select, one.initialize) == ("C", "full", False)
    assert (one.telescope, one.pan, one.tilt, one.zoom, one.prong) == (0, 0, 0, 0, 0)
    assert (one.shuttle, one.open_latch) == ((0, 0, 0), False)
    assert (
        load_recording(write(tmp_path, f"{HEADER}\n0,1,2,3,4,5,6\n"), SCALING).at(3).station == "A"
    )


def test_degrees_and_radians_are_understood_column_by_column_in_any_order(tmp_path):
    text = "time_s,prong,R2_deg,P0_rad,H0_deg,P1_rad,H2_rad,P2_rad\n0,-1,447,0.5,-90,0.25,-1,3\n"
    one = load_recording(write(tmp_path, text), SCALING).at(0.0)
    expected = [-np.pi / 2, 0.5, 0.25, -1.0, 3.0, 447.0 * np.pi / 180.0]
    np.testing.assert_allclose(one.angles, expected, rtol=1e-15)
    assert one.prong == -1


def test_between_rows_angles_go_on_straight_lines_and_switches_are_held(tmp_path):
    text = f"{HEADER},telescope\n0,0,10,0,0,0,0,1\n4,8,10,0,0,0,-400,-1\n5,8,20,0,0,0,0,0\n"
    recording = load_recording(write(tmp_path, text), SCALING)
    for time, heading, pitch, roll, telescope in (
        (-1.0, 0.0, 10.0, 0.0, 1),
        (0.0, 0.0, 10.0, 0.0, 1),
        (1.0, 2.0, 10.0, -100.0, 1),
        (3.9999999, 7.9999998, 10.0, -399.99999, 1),
        (4.0, 8.0, 10.0, -400.0, -1),
        (4.25, 8.0, 12.5, -300.0, -1),
        (5.0, 8.0, 20.0, 0.0, 0),
        (1e9, 8.0, 20.0, 0.0, 0),
    ):
        inputs = recording.at(time)
        expected = [heading, pitch, 0.0, 0.0, 0.0, roll]
        # Roundings of numbers up to 400.
        np.testing.assert_allclose(np.degrees(inputs.angles), expected, rtol=0.0, atol=1e-12)
        assert inputs.telescope == telescope


def test_asking_a_recording_does_not_change_it(tmp_path):
    recording = load_recording(
        write(tmp_path, f"{HEADER}\n0,1,2,3,4,5,6\n1,2,3,4,5,6,7\n"), SCALING
    )
    before = recording.frames.angles.copy()
    for time in (0.0, 0.5, 1.0):
        recording.at(time)
    np.testing.assert_array_equal(recording.frames.angles, before)


def test_volts_of_thirteen_channels_are_a_session(tmp_path):
    text = f"{VOLTS}\n0,10,-10,5,0,0,0,0,10,-10,5,10,7.5,-10\n0.05,0,0,0,0,0,0,0,0,0,0,0,-7.6,0\n"
    recording = load_recording(write(tmp_path, text), SCALING)
    one, two = recording.at(0.0), recording.at(0.05)
    assert (one.initialize, one.initialize_select) == (True, "mode_2_or_3")
    np.testing.assert_allclose(np.degrees(one.angles), [90, 0, 0, 0, 0, 447], rtol=1e-15)
    assert (one.telescope, one.pan, one.zoom, one.station, one.prong) == (-1, -1, 1, "B", -1)
    assert two.station == "I"


ROW = ",0,0,0,0,0,0"
BAD_SESSIONS = {
    "": "empty; must have a header, time_s,H0_deg,..., and rows",
    "# nothing\n\n": "empty; must have a header, time_s,H0_deg,..., and rows",
    "HEADER\n": "empty; must have a header, time_s,H0_deg,..., and rows",
    "a\0b\nc\n": "not a text file",
    "time_s\n0\n": "line 1: no column H0_deg or H0_rad; must have all angles",
    "# x\nt\n0\n": "line 2: column 1 is 't'; must be time_s",
    "time_ms,H0_deg\n0,1\n": "line 1: column 1 is 'time_ms'; must be time_s",
    "HEADER,zoom,zoom\n0ROW,1,1\n": "line 1: number of columns 'zoom' = 2; must be 1",
    "HEADER,H0_rad\n0ROW,1\n": "line 1: columns H0_deg and H0_rad; must be one of them",
    "HEADER,H0_in\n0ROW,1\n": "line 1: unit of column 'H0_in' = 'in'; must be deg or rad",
    "HEADER,P2\n0ROW,1\n": "line 1: unit of column 'P2' = ''; must be deg or rad",
    "HEADER,zooom\n0ROW,1\n": "line 1: unknown column 'zooom' (did you mean 'zoom'?); known: H",
    "HEADER\n0ROW\n1ROW,3\n": "line 3: 8 values; must be 7, as the header has",
    "HEADER\n0ROW\n1\n": "line 3: 1 values; must be 7, as the header has",
    'HEADER\n0,"1,0,0,0,0,0\n': "line 2: not a row of a table (unexpected end of data)",
    "HEADER\n0ROW\n#\n\nxROW\n": "line 5: time_s = 'x'; must be a finite number",
    "HEADER\n0ROW\nnanROW\n": "line 3: time_s = 'nan'; must be a finite number",
    "HEADER\n0,0,0,inf,0,0,0\n": "line 2: P1_deg = 'inf'; must be a finite number",
    "HEADER\n0,0,0,1_0,0,0,0\n": "line 2: P1_deg = '1_0'; must be a finite number",
    "HEADER\n0,0,0,,0,0,0\n": "line 2: P1_deg = ''; must be a finite number",
    "HEADER\n1ROW\n": "line 2: time_s = 1; must be 0 in the first row",
    "HEADER\n0ROW\n0ROW\n": "line 3: time_s = 0 after 0; must be more, as times increase",
    "HEADER\n0ROW\n2ROW\n1ROW\n": "line 4: time_s = 1 after 2; must be more, as times increase",
    "HEADER\n0ROW\n1e6ROW\n": "line 3: time_s = 1e+06; must be <= 86400",
    "HEADER\n0ROW\n1,0,181,0,0,0,0\n": "line 3: P0_deg = 181; must be within +-180, full scale",
    "HEADER,zoom\n0ROW,2\n": "line 2: zoom = '2'; must be -1 or 0 or 1",
    "HEADER,zoom\n0ROW,1.0\n": "line 2: zoom = '1.0'; must be -1 or 0 or 1",
    "HEADER,open_latch\n0ROW,-1\n": "line 2: open_latch = '-1'; must be 0 or 1",
    "HEADER,station\n0ROW,N\n": "line 2: station = 'N'; must be A, B, C, D, E, F, G, H, I, J, K",
    "HEADER,initialize_select\n0ROW,mode\n": "line 2: initialize_select = 'mode'; must be full, ",
    "HEADER,pan,tilt\n0ROW,0,1\n1ROW,1,-1\n": "line 3: pan and tilt together; must be one, they",
    "VOLTS\n0VOLT\n#\n1,0,0,11,0,0,0,0,0,0,0,0,0,0\n": "line 4: channel 3 = 11 V; must be within",
    "VOLTS\n0VOLT\n1,5,0,0,0,0,0,0,0,0,0,0,0,0\n": "line 3: channel 1 = 5 V; must be within ",
    "VOLTS\n0,nan,0,0,0,0,0,0,0,0,0,0,0,0\n": "line 2: channel_1_V = 'nan'; must be a finite",
    "VOLTS,channel_14_V\n0VOLT,0\n": "line 1: 14 channels; must be one of 13, 16, 17",
    "VOLTS,zoom\n0VOLT,0\n": "line 1: column 15 is 'zoom'; must be channel_14_V",
    "time_s,channel_1_mV\n0,0\n": "line 1: column 2 is 'channel_1_mV'; must be channel_1_V",
    "time_s,channel_2_V\n0,0\n": "line 1: column 2 is 'channel_2_V'; must be channel_1_V",
    "HEADER,channel_1_V\n0ROW,0\n": "line 1: column 2 is 'H0_deg'; must be channel_1_V",
}


@pytest.mark.parametrize("text", BAD_SESSIONS)
def test_a_bad_session_is_refused_by_line_and_value(tmp_path, text):
    full = text.replace("HEADER", HEADER).replace("ROW", ROW)
    file = write(tmp_path, full.replace("VOLTS", VOLTS).replace("VOLT", ",0" * 13))
    expected = f"^{re.escape(f'{file}: {BAD_SESSIONS[text]}')}"
    with pytest.raises(InputError, match=expected) as raised:
        load_recording(file, SCALING)
    assert "\n" not in str(raised.value)


def test_what_is_no_text_no_file_or_too_long_is_refused(tmp_path):
    file = tmp_path / "session.csv"
    with pytest.raises(InputError, match=r"session.csv: no such file$"):
        load_recording(file, SCALING)
    file.write_bytes(b"time_s,\xff\xfe\n")
    with pytest.raises(InputError, match=r"session.csv: not a text file in UTF-8$"):
        load_recording(file, SCALING)
    file.write_text("time_s\n" + "0\n" * (MOST_ROWS + 1))
    with pytest.raises(
        InputError, match=r"session.csv: number of rows = 200001; must be <= 200000"
    ):
        load_recording(file, SCALING)
    file.write_text("time_s\n" + "\n" * (2 * MOST_ROWS))
    with pytest.raises(InputError, match=r"session.csv: number of lines = 400001; must be <= 4"):
        load_recording(file, SCALING)
    with pytest.raises(InputError, match=r": is a folder, not a file$"):
        load_recording(tmp_path, SCALING)


def test_a_file_too_large_for_any_session_is_not_read(tmp_path):
    file = tmp_path / "session.csv"
    with file.open("wb") as stream:
        stream.truncate(80_000_001)  # a hole: nothing is stored
    with pytest.raises(InputError, match=r"size = 80000001 bytes; must be <= 80000000$"):
        load_recording(file, SCALING)


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([], "operator's recording: rows = 0; must be 1 or more"),
        ([0.0], "operator's recording: times = 1; must be 2, as many as frames"),
        ([0.0, 0.0], "operator's recording: times = "),
        ([1.0, 2.0], "operator's recording: times = "),
        ([0.0, np.nan], "operator's recording: times = "),
    ],
)
def test_a_session_with_other_times_than_increasing_from_0_cannot_be_made(times, message):
    frames = frames_of([OperatorInputs(angles=np.zeros(6))] * 2)
    with pytest.raises(InputError, match=f"^{message}"):
        OperatorRecording(times=np.array(times), frames=frames)
