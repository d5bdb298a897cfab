"""Path files: the report's tables are as printed, and a bad file is refused with row and value."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pips_drake.errors import InputError, UnknownNameError
from pips_drake.scene.packages import find_path_file
from pips_drake.serpentine.path_file import load_path, read_points

INCH = 0.0254


def table(number: int) -> np.ndarray:
    """A shipped table, (P, 3) in."""
    return read_points(find_path_file(f"trajectory_{number}")) / INCH


@pytest.mark.parametrize(("number", "rows"), [(1, 15), (2, 15), (3, 15), (4, 14)])
def test_tables_start_at_the_rail_and_have_home_in_row_2(number, rows):
    points = table(number)
    assert points.shape == (rows, 3)
    np.testing.assert_allclose(points[0], [16.255, 0.0, 0.0], rtol=0, atol=1e-13)
    np.testing.assert_allclose(points[1], [16.255, 0.0, 174.902], rtol=0, atol=1e-13)


def test_trajectories_1_to_3_differ_in_x_alone():
    """FTL-95 Appendix C: the same circle seen along x; 2 leans to one side and 3 to the other."""
    one, two, three = table(1), table(2), table(3)
    np.testing.assert_array_equal(one[:, 1:], two[:, 1:])
    np.testing.assert_array_equal(one[:, 1:], three[:, 1:])
    assert np.all(one[:, 0] == one[0, 0])
    # Mirror images in the plane x = 16.255 up to row 12, then printed otherwise.
    np.testing.assert_allclose((two + three)[:12, 0], 2 * 16.255, rtol=0, atol=1e-12)
    np.testing.assert_allclose((two + three)[12:, 0], [31.51, 30.51, 29.51], rtol=0, atol=1e-12)


def test_points_in_metres_are_taken_as_they_are(tmp_path: Path):
    file = tmp_path / "path.csv"
    file.write_text("x_m,y_m,z_m\n0.1,0.2,0.3\n0.1,0.2,4.3\n")
    np.testing.assert_array_equal(read_points(file), [[0.1, 0.2, 0.3], [0.1, 0.2, 4.3]])


def test_inches_and_metres_give_the_same_points(tmp_path: Path):
    inches, metres = tmp_path / "in.csv", tmp_path / "m.csv"
    inches.write_text("x_in,y_in,z_in\n0,0,0\n0,0,100\n")
    metres.write_text("x_m,y_m,z_m\n0,0,0\n0,0,2.54\n")
    np.testing.assert_allclose(read_points(inches), read_points(metres), rtol=1e-15)


@pytest.mark.parametrize(
    "text",
    [
        "\ufeffx_in,y_in,z_in\n0,0,0\n0,0,100\n",
        "x_in,y_in,z_in\r\n0,0,0\r\n0,0,100\r\n",
        "# a comment\n\nx_in, y_in, z_in\n0, 0, 0\n\n# another\n 0, 0, 1e2",
        '"x_in","y_in","z_in"\n"0","0","0"\n"0","0","100"\n',
    ],
    ids=["byte order mark", "carriage returns", "comments and spaces", "quotes"],
)
def test_what_spreadsheets_write_is_read(tmp_path: Path, text: str):
    file = tmp_path / "path.csv"
    file.write_bytes(text.encode())
    np.testing.assert_allclose(read_points(file), [[0, 0, 0], [0, 0, 2.54]], rtol=1e-15)


HEADER = "x_in,y_in,z_in\n"
BAD_TABLES = {
    "empty": ("", ["empty", "x_in,y_in,z_in"]),
    "comments alone": ("# nothing\n\n", ["empty"]),
    "header alone": (HEADER, ["0 rows", "two or more"]),
    "one row": (HEADER + "0,0,0\n", ["1 rows", "two or more"]),
    "short row": (HEADER + "0,0,0\n0,0,9\n0,9\n", ["row 3", "2 values", "must be 3"]),
    "long row": (HEADER + "0,0,0\n0,0,9,7\n", ["row 2", "4 values", "must be 3"]),
    "text": (HEADER + "# c\n0,0,0\n0,zero,9\n", ["row 2", "y = 'zero'", "a number"]),
    "nothing between commas": (HEADER + "0,0,0\n0,,9\n", ["row 2", "y = ''", "a number"]),
    "NaN": (HEADER + "0,0,0\n0,0,nan\n", ["row 2", "z = nan", "finite"]),
    "infinity": (HEADER + "0,0,0\n-inf,0,9\n", ["row 2", "x = -inf", "finite"]),
    "too large a number": (HEADER + "0,0,0\n1e999,0,9\n", ["row 2", "x = 1e999", "finite"]),
    "repeated point": (HEADER + "0,0,0\n0,0,9\n0,0,9\n", ["row 3 repeats row 2"]),
    "no unit": ("x,y,z\n0,0,0\n0,0,9\n", ["header 'x,y,z'", "x_in,y_in,z_in or x_m,y_m,z_m"]),
    "unknown unit": ("x_mm,y_mm,z_mm\n0,0,0\n", ["header 'x_mm,y_mm,z_mm'", "x_m,y_m,z_m"]),
    "mixed units": ("x_in,y_m,z_in\n0,0,0\n", ["header 'x_in,y_m,z_in'", "x_in,y_in,z_in"]),
    "two columns": ("x_in,y_in\n0,0\n", ["header 'x_in,y_in'"]),
    "columns in another order": ("z_in,y_in,x_in\n0,0,0\n", ["header 'z_in,y_in,x_in'"]),
    "no header": ("0,0,0\n0,0,9\n", ["header '0,0,0'"]),
    "semicolons": ("x_in;y_in;z_in\n0;0;0\n", ["header 'x_in;y_in;z_in'"]),
    "an open quote": (HEADER + '0,0,0\n0,0,"9\n', ["not a CSV table"]),
}


@pytest.mark.parametrize("case", BAD_TABLES)
def test_a_bad_table_is_refused_in_one_line_with_file_row_and_value(tmp_path: Path, case: str):
    text, words = BAD_TABLES[case]
    file = tmp_path / "bad.csv"
    file.write_text(text)
    with pytest.raises(InputError) as caught:
        read_points(file)
    message = str(caught.value)
    assert message.startswith(f"{file}: ")
    assert "\n" not in message
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    "content", [b"\x00\x01\x02", b"\xff\xfe\x00x", b"x_in,y_in,z_in\n0,0,0\n0,0,\x009\n"]
)
def test_a_binary_file_is_refused(tmp_path: Path, content: bytes):
    file = tmp_path / "bad.csv"
    file.write_bytes(content)
    with pytest.raises(InputError, match="not a text file"):
        read_points(file)


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path):
    with pytest.raises(InputError, match="no such file"):
        read_points(tmp_path / "none.csv")
    with pytest.raises(InputError, match="folder"):
        read_points(tmp_path)


def test_an_unknown_path_lists_the_known_ones():
    with pytest.raises(UnknownNameError, match="trajectory_4_arcs") as caught:
        load_path("trajectory_5")
    assert "trajectory_1" in caught.value.known


def test_a_table_may_be_loaded_as_polyline_or_smooth():
    assert not load_path("trajectory_4").is_smooth
    smooth = load_path("trajectory_4", smooth=True)
    assert smooth.is_smooth
    assert smooth.deviation > 0.0
    narrow = load_path("trajectory_4", smooth=True, corner_deviation=1e-4)
    assert narrow.deviation == pytest.approx(1e-4, rel=1e-6)


PIECES = """\
unit: m
start: [0.4, 0.0, 0.0]
direction: [0, 0, 1]
pieces:
  - {line: 4.0}
  - {arc: 0.5, angle_deg: 180, toward: [0, 1, 0]}
"""


def test_pieces_in_a_file_make_the_path_they_say(tmp_path: Path):
    file = tmp_path / "turn.yaml"
    file.write_text(PIECES)
    path = load_path(file)
    assert path.name == "turn"
    # A half circle of radius 0.5 ends a diameter aside, going back.
    np.testing.assert_allclose(path.point(path.length), [0.4, 1.0, 4.0], atol=1e-15)
    np.testing.assert_allclose(path.tangent(path.length), [0.0, 0.0, -1.0], atol=1e-15)
    assert path.home_arc_length == 4.0


BAD_PIECES = {
    "unknown unit": ("unit: m", "unit: mm", ["unit = 'mm'", "in, m"]),
    "no unit": ("unit: m\n", "", ["unit = ''", "in, m"]),
    "unknown key": ("arc: 0.5", "radius: 0.5", ["pieces[1]", "'radius'", "arc"]),
    "line and arc": ("{line: 4.0}", "{line: 4.0, arc: 1.0}", ["pieces[0]", "either"]),
    "neither": ("  - {line: 4.0}\n", "  - {}\n", ["pieces[0]", "either"]),
    "arc without angle": ("angle_deg: 180, ", "", ["pieces[1]", "angle_deg"]),
    "line with an angle": ("{line: 4.0}", "{line: 4.0, angle_deg: 9}", ["pieces[0]", "angle_deg"]),
    "arc first": ("  - {line: 4.0}\n", "", ["the first must be the line"]),
    "negative line": ("line: 4.0", "line: -4.0", ["pieces[0].line = -4.0", "> 0"]),
    "zero radius": ("arc: 0.5", "arc: 0", ["pieces[1].arc = 0.0", "> 0"]),
    "two turns": (
        "angle_deg: 180",
        "angle_deg: 720",
        ["pieces[1].angle_deg = 720.0", "> 0 and <= 360"],
    ),
    "toward along the path": (
        "toward: [0, 1, 0]",
        "toward: [0, 0, 1]",
        ["pieces[1]", "must point aside"],
    ),
    "toward in the plane": ("toward: [0, 1, 0]", "toward: [0, 1]", ["toward", "three"]),
    "direction of no length": ("[0, 0, 1]", "[0, 0, 0]", ["direction", "zero"]),
    "two coordinates": ("[0.4, 0.0, 0.0]", "[0.4, 0.0]", ["start", "three numbers"]),
    "NaN": ("[0.4, 0.0, 0.0]", "[.nan, 0.0, 0.0]", ["start[0] = nan", "finite"]),
    "no pieces": (PIECES[PIECES.index("pieces:") :], "pieces: []\n", ["pieces", "first"]),
    "text for a list": ("[0, 0, 1]", "up", ["direction = 'up'", "a list"]),
}


@pytest.mark.parametrize("case", BAD_PIECES)
def test_a_bad_list_of_pieces_is_refused_in_one_line(tmp_path: Path, case: str):
    old, new, words = BAD_PIECES[case]
    assert old in PIECES
    file = tmp_path / "bad.yaml"
    file.write_text(PIECES.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        load_path(file)
    message = str(caught.value)
    assert message.startswith(f"{file}: ")
    assert "\n" not in message
    for word in words:
        assert word in message
