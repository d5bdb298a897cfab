"""Motions given by joints are read back to the last digit; a bad file is refused in one line."""

from __future__ import annotations

import re

import numpy as np
import pytest

from pips_drake.errors import InputError
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.joint_motion import JointMotion
from pips_drake.serpentine.joint_motion_file import read_joint_motion, write_joint_motion

DEGREE = np.pi / 180.0


@pytest.fixture(scope="module")
def arm():
    return load_arm("prototype")


@pytest.fixture(scope="module")
def motion(arm):
    rng = np.random.default_rng(6)
    joints = arm.joint_home + 0.1 * rng.standard_normal((5, arm.joints))
    return JointMotion(times=np.array([0.0, 0.1, 1.0 / 3.0, 2.0, np.pi]), joints=joints)


@pytest.mark.parametrize("suffix", ["csv", "npz"])
def test_what_is_written_reads_back_to_the_last_digit(arm, motion, tmp_path, suffix):
    file = tmp_path / f"motion.{suffix}"
    write_joint_motion(file, arm, motion)
    read = read_joint_motion(file, arm)
    np.testing.assert_array_equal(read.times, motion.times)
    np.testing.assert_array_equal(read.joints, motion.joints)


def test_inches_and_degrees_are_understood_column_by_column(arm, tmp_path):
    names = list(arm.joint_names)
    header = ["time_s", "d1_in", "theta2_deg", *(f"{name}_rad" for name in names[2:])]
    rows = [["0", "30", "-18", *["0.5"] * 16], ["2", "40", "90", *["0"] * 16]]
    text = "\n".join(",".join(row) for row in (header, *rows))
    (tmp_path / "m.csv").write_text("# by hand\n" + text + "\n")
    read = read_joint_motion(tmp_path / "m.csv", arm)
    np.testing.assert_allclose(read.joints[:, 0], [0.762, 1.016], rtol=1e-15)
    np.testing.assert_allclose(read.joints[:, 1], [-18 * DEGREE, np.pi / 2], rtol=1e-15)
    np.testing.assert_array_equal(read.joints[:, 2], [0.5, 0.0])


HEADER = "HEADER"
BAD_TABLES = {
    "": "empty; must have a header such as time_s,d1_m and rows",
    "t_s,a\n0,1\n": "column 1 is 't_s'; must be time_s",
    "time_s,d1_m\n0,1\n1,1\n": "1 joints; must be the 18 of arm 'prototype'",
    "HEADER\n0ROW\n": "number of rows = 1; must be 2 or more",
    "HEADER\n0ROW\n1,2\n": "row 2 has 2 values; must be 19",
    "HEADER\n0ROW\nx ROW\n": "row 2, time_s = 'x'; must be a number",
    "HEADER\n0ROW\nnanROW\n": "row 2, time_s = nan; must be finite",
    "HEADER\n0ROW\n0ROW\n": "row 2, time_s = 0 after 0; must increase",
    "HEADER\n0ROW\n2ROW\n1ROW\n": "row 3, time_s = 1 after 2; must increase",
    "HEADER\n1ROW\n2ROW\n": "row 1, time_s = 1.0; must be 0",
    "HEADER\n0ROW\n1e6ROW\n": "time_s = 1000000.0; must be <= 86400",
    "HEADER\n0ROW\n1_0ROW\n": "row 2, time_s = '1_0'; must be a number",
}


@pytest.mark.parametrize("text", BAD_TABLES)
def test_a_bad_table_is_refused_by_row_and_value(arm, tmp_path, text):
    header = ",".join(("time_s", *arm.joint_columns))
    file = tmp_path / "bad.csv"
    file.write_text(
        text.replace(HEADER, header).replace("x ROW", "x" + ",0" * 18).replace("ROW", ",0" * 18)
    )
    with pytest.raises(InputError, match=re.escape(BAD_TABLES[text])) as raised:
        read_joint_motion(file, arm)
    assert "\n" not in str(raised.value)
    assert str(raised.value).startswith(str(file))


def test_a_column_without_its_unit_or_of_another_joint_is_refused(arm, tmp_path):
    for wrong in ("theta2", "theta2_m", "theta3_rad"):
        columns = [wrong if name == "theta2_rad" else name for name in arm.joint_columns]
        (tmp_path / "m.csv").write_text(",".join(["time_s", *columns]) + "\n0" + ",0" * 18)
        words = f"column 3 is '{wrong}'; must be theta2_rad or theta2_deg"
        with pytest.raises(InputError, match=re.escape(words)):
            read_joint_motion(tmp_path / "m.csv", arm)


def test_a_value_that_no_arm_has_is_refused_in_its_own_unit(arm, tmp_path):
    header = ",".join(("time_s", "d1_in", *arm.joint_columns[1:]))
    text = f"{header}\n0" + ",0" * 18 + "\n1,1e9" + ",0" * 17
    (tmp_path / "m.csv").write_text(text)
    with pytest.raises(InputError, match=r"row 2, d1_in = 1e\+09; must be within \+-39370"):
        read_joint_motion(tmp_path / "m.csv", arm)


def archives(arm):
    columns, times = np.array(arm.joint_columns), np.array([0.0, 1.0])
    good = {"columns": columns, "time_s": times, "joints": np.zeros((2, arm.joints))}
    return {
        "no array 'joints'": {k: good[k] for k in ("columns", "time_s")},
        "columns = of type": good | {"columns": np.arange(18)},
        "joints = of type": good | {"joints": np.full((2, 18), "a")},
        "shapes = (2,) and (3, 18); must be": good | {"joints": np.zeros((3, 18))},
        "row 2, d1_m is no finite number": good
        | {"joints": np.vstack([np.zeros(18), np.full(18, np.nan)])},
        "must be the 18 of arm": good | {"columns": columns[:1], "joints": np.zeros((2, 1))},
        # Objects would be unpickled, which may run anything.
        "cannot be read as an archive of arrays": good | {"joints": np.array([[None] * 18] * 2)},
    }


@pytest.mark.parametrize("case", range(7))
def test_a_bad_archive_is_refused_and_nothing_is_unpickled(arm, tmp_path, case):
    words, arrays = list(archives(arm).items())[case]
    file = tmp_path / "bad.npz"
    np.savez(file, **arrays)
    with pytest.raises(InputError, match=re.escape(words)):
        read_joint_motion(file, arm)


def test_what_is_no_archive_or_no_motion_is_refused(arm, motion, tmp_path):
    (tmp_path / "text.npz").write_text("time_s")
    with pytest.raises(InputError, match="cannot be read as an archive of arrays"):
        read_joint_motion(tmp_path / "text.npz", arm)
    for name in ("none.npz", "none.csv"):
        with pytest.raises(InputError, match="no such file"):
            read_joint_motion(tmp_path / name, arm)
    with pytest.raises(InputError, match=r"ends with '\.txt'; must be \.csv or \.npz"):
        read_joint_motion(tmp_path / "motion.txt", arm)
    with pytest.raises(InputError, match=r"joints = 18; must be 42 for arm 'cmu_92'"):
        write_joint_motion(tmp_path / "m.csv", load_arm("cmu_92"), motion)
