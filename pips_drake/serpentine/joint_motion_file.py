"""Files of motions given by joints: CSV tables to read and edit, `.npz` archives for long ones.

A CSV has a header `time_s,d1_m,theta2_rad,...`: the time, then every joint of the arm in its order,
with its unit: `_m` or `_in` for what slides, `_rad` or `_deg` for what turns. Lines that start with
`#` are comments. An archive holds `columns` (J,), the joints' columns of such a header, `time_s`
(K,) and `joints` (K, J). Between rows the joints move on straight lines (`JointMotion`).
"""

from __future__ import annotations

import csv
import io
import math
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pips_drake.config import read_text, require
from pips_drake.errors import InputError, shorten
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.joint_motion import JointMotion
from pips_drake.units import JOINT_UNITS

Array = NDArray[np.float64]

#: First column of a table, and name of the times in an archive.
TIME_COLUMN = "time_s"
#: Longer motions than this (rows) are refused: at 64 rows a second it is 50 minutes.
MOST_ROWS = 200_000
#: An archive that unpacks to more than this (bytes) is refused unread.
LARGEST_ARCHIVE = 500_000_000
#: Times beyond this are mistakes, s; and joint values, m or rad.
LONGEST, LARGEST = 86_400.0, 1000.0


def read_joint_motion(file: Path, arm: SerpentineArm) -> JointMotion:
    """The motion that a `.csv` or `.npz` file holds, for an arm.

    Raises:
        InputError: one line that names file, row and value.
    """
    if file.suffix == ".csv":
        columns, table = _read_table(file)
    elif file.suffix == ".npz":
        columns, table = _read_archive(file)
    else:
        raise InputError(f"{file}: a joint motion ends with '{file.suffix}'; must be .csv or .npz")
    units = _units(file, arm, columns)
    require(len(table) >= 2, f"{file}: number of rows", len(table), "2 or more")
    times, joints = table[:, 0], table[:, 1:]
    for row, column in np.argwhere(~np.isfinite(table))[:1]:
        name = (TIME_COLUMN, *columns)[column]
        raise InputError(f"{file}: row {row + 1}, {name} is no finite number")
    require(times[0] == 0.0, f"{file}: row 1, {TIME_COLUMN}", times[0], "0")
    for row in np.flatnonzero(np.diff(times) <= 0.0)[:1] + 1:
        raise InputError(
            f"{file}: row {row + 1}, {TIME_COLUMN} = {times[row]:g} after {times[row - 1]:g}; must "
            "increase"
        )
    require(times[-1] <= LONGEST, f"{file}: {TIME_COLUMN}", times[-1], f"<= {LONGEST:g}")
    joints = joints * units
    for row, column in np.argwhere(np.abs(joints) > LARGEST)[:1]:
        raise InputError(
            f"{file}: row {row + 1}, {columns[column]} = {table[row, column + 1]:g}; must "
            f"be within +-{LARGEST / units[column]:g}"
        )
    return JointMotion(times=times.copy(), joints=joints)


def write_joint_motion(file: Path, arm: SerpentineArm, motion: JointMotion) -> None:
    """Writes what `read_joint_motion` reads back to the last digit, in m and rad.

    Raises:
        InputError: neither `.csv` nor `.npz`, or a motion of another number of joints.
    """
    require(
        motion.joints.shape[1] == arm.joints, "joint motion: joints", motion.joints.shape[1],
        f"{arm.joints} for arm '{arm.name}'",
    )  # fmt: skip
    if file.suffix == ".npz":
        np.savez_compressed(
            file, columns=np.array(arm.joint_columns), time_s=motion.times, joints=motion.joints
        )
        return
    if file.suffix != ".csv":
        raise InputError(f"{file}: a joint motion ends with '{file.suffix}'; must be .csv or .npz")
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow([TIME_COLUMN, *arm.joint_columns])
    table = np.column_stack([motion.times, motion.joints])
    np.savetxt(text, table + 0.0, "%.17g", delimiter=",")  # `+ 0.0` turns -0 into 0
    file.write_text(text.getvalue(), encoding="utf-8")


def _units(file: Path, arm: SerpentineArm, columns: Sequence[str]) -> Array:
    """What each column's numbers are multiplied with, (J,).

    Raises:
        InputError: the columns are not the arm's.
    """
    if len(columns) != arm.joints:
        raise InputError(
            f"{file}: {len(columns)} joints; must be the {arm.joints} of arm '{arm.name}'"
        )
    units = np.empty(arm.joints)
    for j, (name, sliding) in enumerate(zip(arm.joint_names, arm.is_prismatic, strict=True)):
        allowed = [f"{name}_{unit}" for unit in (("m", "in") if sliding else ("rad", "deg"))]
        if columns[j] not in allowed:
            raise InputError(
                f"{file}: column {j + 2} is '{shorten(columns[j])}'; must be {' or '.join(allowed)}"
            )
        units[j] = JOINT_UNITS[columns[j].rpartition("_")[2]]
    return units


def _read_table(file: Path) -> tuple[tuple[str, ...], Array]:
    """The joints' columns and the table (K, 1 + J) of a CSV, in its own units."""
    text = read_text(file, largest=LARGEST_ARCHIVE)
    if "\0" in text:
        raise InputError(f"{file}: not a text file")
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    if not lines:
        raise InputError(f"{file}: empty; must have a header such as {TIME_COLUMN},d1_m and rows")
    require(len(lines) - 1 <= MOST_ROWS, f"{file}: number of rows", len(lines) - 1,
            f"<= {MOST_ROWS}")  # fmt: skip
    try:
        header, *rows = csv.reader(lines, strict=True)
    except csv.Error as error:
        raise InputError(f"{file}: not a CSV table ({error})") from None
    header = [column.strip() for column in header]
    if header[0] != TIME_COLUMN:
        raise InputError(f"{file}: column 1 is '{shorten(header[0])}'; must be {TIME_COLUMN}")
    table = np.empty((len(rows), len(header)))
    for number, row in enumerate(rows, start=1):
        if len(row) != len(header):
            raise InputError(f"{file}: row {number} has {len(row)} values; must be {len(header)}")
        for column, word in enumerate(row):
            table[number - 1, column] = _number(file, number, header[column], word)
    return tuple(header[1:]), table


def _number(file: Path, row: int, column: str, word: str) -> float:
    where, shown = f"{file}: row {row}, {column}", shorten(word.strip())
    try:
        if "_" in word:  # which is a number to Python alone
            raise ValueError
        value = float(word)
    except ValueError:
        raise InputError(f"{where} = '{shown}'; must be a number") from None
    require(math.isfinite(value), where, shown, "finite")
    return value


def _read_archive(file: Path) -> tuple[tuple[str, ...], Array]:
    """The same of an archive."""
    try:
        with zipfile.ZipFile(file) as archive:
            size = sum(part.file_size for part in archive.infolist())
        require(size <= LARGEST_ARCHIVE, f"{file}: unpacked size", f"{size} bytes",
                f"<= {LARGEST_ARCHIVE}")  # fmt: skip
        with np.load(file, allow_pickle=False) as data:
            names = ("columns", TIME_COLUMN, "joints")
            missing = [name for name in names if name not in data]
            if missing:
                raise InputError(f"{file}: no array '{missing[0]}'; must have {', '.join(names)}")
            columns, times, joints = (data[name] for name in names)
    except FileNotFoundError:
        raise InputError(f"{file}: no such file") from None
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, NotImplementedError) as error:
        reason = shorten(" ".join(str(error).split()))
        raise InputError(f"{file}: cannot be read as an archive of arrays ({reason})") from None
    good = columns.ndim == 1 and columns.dtype.kind == "U"
    require(good, f"{file}: columns", f"of type {columns.dtype}", "a list of texts")
    for name, array in ((TIME_COLUMN, times), ("joints", joints)):
        require(array.dtype.kind in "fiu", f"{file}: {name}", f"of type {array.dtype}", "numbers")
    good = times.ndim == 1 and joints.shape == (len(times), len(columns))
    allowed = f"(K,) and (K, {len(columns)})"
    require(good, f"{file}: shapes", f"{times.shape} and {joints.shape}", allowed)
    require(len(times) <= MOST_ROWS, f"{file}: number of rows", len(times), f"<= {MOST_ROWS}")
    table = np.column_stack([times, joints]).astype(np.float64)
    return tuple(columns.tolist()), table
