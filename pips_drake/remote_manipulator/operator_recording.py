"""An operator's session as a CSV file: what was wanted over time, or the volts of the channels.

Of inputs, with units in the header, a row whenever something changes or an angle bends:

    time_s,H0_deg,P0_deg,P1_deg,H2_deg,P2_deg,R2_deg,telescope,pan,tilt,zoom,station,prong
    0.0,-14.0,62.0,-98.0,0.0,-54.0,14.0,0,0,0,0,A,0
    5.0,-14.0,60.0,-98.0,0.0,-54.0,14.0,0,0,1,0,F,-1

Angles may be in `_deg` or `_rad`. The time and the six angles must be there; columns that are not
say what stays off: `telescope`, `pan`, `tilt`, `zoom`, `prong`, `shuttle_x`, `shuttle_y`,
`shuttle_z` (-1, 0 or 1), `initialize`, `open_latch` (0 or 1), `station` (A to M; A) and
`initialize_select` (full, mode_1 or mode_2_or_3; full).

Of volts: `time_s,channel_1_V,...,channel_13_V`, and channels up to 17 if they were recorded.

Lines that start with # are comments. Between rows the angles go on straight lines and everything
else stays as it was. An angle may jump: the machine follows as fast as it can.
"""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pips_drake.config import read_text, require
from pips_drake.errors import InputError, UnknownNameError, shorten
from pips_drake.remote_manipulator.analog_inputs import (
    CHANNEL_COUNTS,
    CHANNELS,
    AngleScaling,
    decode_channels,
    encode_channels,
)
from pips_drake.remote_manipulator.configuration import JOINTS, STATIONS
from pips_drake.remote_manipulator.operator_inputs import (
    FIELDS,
    INITIALIZE_SELECTS,
    OperatorFrames,
    OperatorInputs,
)
from pips_drake.units import DEGREE

Array = NDArray[np.float64]

TIME_COLUMN = "time_s"
#: Units of an angle's column, rad.
ANGLE_UNITS = {"deg": DEGREE, "rad": 1.0}
#: Longer recordings (rows) are refused: at 20 a second it is nearly three hours.
MOST_ROWS = 200_000
#: Times beyond this are mistakes, s.
LONGEST = 86_400.0
#: The file that 200,000 rows of 18 columns make at most, bytes.
_LARGEST_FILE = 80_000_000

_WORDS: Mapping[str, Sequence[str]] = {
    "station": STATIONS,
    "initialize_select": INITIALIZE_SELECTS,
}
#: Fields that are off or on; other fields without words are -1, 0 or 1.
_ON_OFF = ("initialize", "open_latch")
_VOLT_COLUMNS = tuple(f"channel_{number}_V" for number in range(1, CHANNELS + 1))
_ANGLE_COLUMNS = {f"{joint}_{unit}": (joint, unit) for joint in JOINTS for unit in ANGLE_UNITS}


@dataclass(frozen=True, kw_only=True, eq=False)
class OperatorRecording:
    """What an operator wanted, over time.

    Attributes:
        times: (T,) s, from 0, increasing.
        frames: the inputs at these times, (T,).
    """

    times: Array
    frames: OperatorFrames

    def __post_init__(self) -> None:
        count = len(self.times)
        require(count >= 1, "operator's recording: rows", count, "1 or more")
        require(count == len(self.frames), "operator's recording: times", count,
                f"{len(self.frames)}, as many as frames")  # fmt: skip
        good = bool(np.all(np.isfinite(self.times)) and np.all(np.diff(self.times) > 0.0))
        good = good and self.times[0] == 0.0
        require(good, "operator's recording: times", self.times, "from 0, increasing")

    @property
    def duration(self) -> float:
        """When the last row is, s."""
        return float(self.times[-1])

    def at(self, time: float) -> OperatorInputs:
        """What is wanted at a time, s: angles between rows' are interpolated, switches held."""
        times = self.times
        row = max(int(np.searchsorted(times, time, side="right")) - 1, 0)
        angles = self.frames.angles[row]
        if time > times[row] and row + 1 < len(times):
            part = (time - times[row]) / (times[row + 1] - times[row])
            angles = angles + part * (self.frames.angles[row + 1] - angles)
        return self.frames.frame(row, angles)


def load_recording(file: Path, scaling: AngleScaling) -> OperatorRecording:
    """Reads a recording of inputs or of volts.

    Args:
        scaling: what volts mean; angles beyond its full scale are refused in either kind.

    Raises:
        InputError: one line that names file, line and value.
    """
    header, rows, lines = _read_table(file)
    head = f"{file}: line {lines[0]}"
    if header[0] != TIME_COLUMN:
        raise InputError(f"{head}: column 1 is '{shorten(header[0])}'; must be {TIME_COLUMN}")
    for name, count in Counter(header).items():
        require(count == 1, f"{head}: number of columns '{shorten(name)}'", count, "1")
    where = [f"{file}: line {line}" for line in lines[1:]]
    times = _numbers(where, TIME_COLUMN, [row[0] for row in rows])
    require(times[0] == 0.0, f"{where[0]}: {TIME_COLUMN}", f"{times[0]:g}", "0 in the first row")
    for row in np.flatnonzero(np.diff(times) <= 0.0)[:1] + 1:
        value = f"{times[row]:g} after {times[row - 1]:g}"
        require(False, f"{where[row]}: {TIME_COLUMN}", value, "more, as times increase")
    name = f"{where[-1]}: {TIME_COLUMN}"
    require(times[-1] <= LONGEST, name, f"{times[-1]:g}", f"<= {LONGEST:g}")
    columns = dict(zip(header[1:], list(zip(*rows, strict=True))[1:], strict=True))
    read = _volts if any(name.startswith("channel_") for name in columns) else _inputs
    frames = read(head, where, columns, scaling)
    return OperatorRecording(times=times, frames=frames)


def write_recording(file: Path, recording: OperatorRecording) -> None:
    """Writes the inputs of a recording, all columns, for `load_recording` to read back.

    Degrees have 17 digits, so that angles are the same up to one rounding.
    """
    frames = recording.frames
    words = {field: np.array(list(known)) for field, known in _WORDS.items()}
    columns = [
        [f"{time:.17g}" for time in recording.times],
        *([f"{angle:.17g}" for angle in column] for column in (frames.angles / DEGREE).T),
    ]
    for field in FIELDS:
        numbers = frames.column(field)
        columns.append((words[field][numbers] if field in words else numbers).tolist())
    header = [TIME_COLUMN, *(f"{joint}_deg" for joint in JOINTS), *FIELDS]
    _write(file, header, columns)


def write_volts(file: Path, recording: OperatorRecording, scaling: AngleScaling) -> None:
    """Writes the volts of a recording's 17 channels, for `load_recording` to read back.

    Raises:
        InputError: an angle beyond full scale.
    """
    volts = encode_channels(recording.frames, scaling) + 0.0  # which turns -0 into 0
    table = np.column_stack([recording.times, volts])
    columns = [[f"{value:.17g}" for value in column] for column in table.T]
    _write(file, [TIME_COLUMN, *_VOLT_COLUMNS], columns)


def _write(file: Path, header: Sequence[str], columns: Sequence[Sequence[object]]) -> None:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(zip(*columns, strict=True))
    file.write_text(text.getvalue(), encoding="utf-8")


def _read_table(file: Path) -> tuple[list[str], list[list[str]], list[int]]:
    """Header, rows of a CSV, and the numbers of their lines, the header's first."""
    text = read_text(file, largest=_LARGEST_FILE)
    if "\0" in text:
        raise InputError(f"{file}: not a text file")
    count = text.count("\n")
    require(count <= 2 * MOST_ROWS, f"{file}: number of lines", count, f"<= {2 * MOST_ROWS}")
    kept = [
        (number, line)
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip() and not line.startswith("#")
    ]
    count = len(kept) - 1
    if count < 1:
        raise InputError(f"{file}: empty; must have a header, {TIME_COLUMN},H0_deg,..., and rows")
    require(count <= MOST_ROWS, f"{file}: number of rows", count, f"<= {MOST_ROWS}")
    table: list[list[str]] = []
    for number, line in kept:
        try:
            cells = next(csv.reader([line], strict=True))
        except csv.Error as error:
            raise InputError(f"{file}: line {number}: not a row of a table ({error})") from None
        if table and len(cells) != len(table[0]):
            what = f"{file}: line {number}: {len(cells)} values"
            raise InputError(f"{what}; must be {len(table[0])}, as the header has")
        table.append([cell.strip() for cell in cells])
    header, *rows = table
    return header, rows, [number for number, _ in kept]


def _numbers(where: Sequence[str], column: str, words: Sequence[str]) -> Array:
    """A column's finite numbers, (T,)."""
    numbers = np.empty(len(words))
    for row, word in enumerate(words):
        try:
            value = math.nan if "_" in word else float(word)  # 1_0 is a number to Python alone
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            shown = shorten(word)
            raise InputError(f"{where[row]}: {column} = '{shown}'; must be a finite number")
        numbers[row] = value
    return numbers


def _volts(
    head: str, where: Sequence[str], columns: Mapping[str, Sequence[str]], scaling: AngleScaling
) -> OperatorFrames:
    """The inputs of a table of volts."""
    names = list(columns)
    if len(names) not in CHANNEL_COUNTS or tuple(names) != _VOLT_COLUMNS[: len(names)]:
        for number, name in enumerate(names[:CHANNELS]):
            expected = _VOLT_COLUMNS[number]
            if name != expected:
                place = f"{head}: column {number + 2}"
                raise InputError(f"{place} is '{shorten(name)}'; must be {expected}")
        counts = ", ".join(str(count) for count in CHANNEL_COUNTS)
        raise InputError(f"{head}: {len(names)} channels; must be one of {counts}")
    volts = np.column_stack([_numbers(where, name, columns[name]) for name in names])
    try:
        return decode_channels(volts, scaling)
    except InputError as several:
        for row, one in enumerate(volts):  # the frame's number is not the line's
            try:
                decode_channels(one[np.newaxis], scaling)
            except InputError as error:
                raise InputError(f"{where[row]}: {error}") from None
        raise several


def _inputs(
    head: str, where: Sequence[str], columns: Mapping[str, Sequence[str]], scaling: AngleScaling
) -> OperatorFrames:
    """The inputs of a table of inputs."""
    angles = np.zeros((len(where), len(JOINTS)))
    found: dict[str, str] = {}
    for name in columns:
        if name in FIELDS:
            continue
        if name not in _ANGLE_COLUMNS:
            joint, _, unit = name.partition("_")
            if joint in JOINTS:
                what = f"{head}: unit of column '{shorten(name)}'"
                raise InputError(f"{what} = '{shorten(unit)}'; must be {' or '.join(ANGLE_UNITS)}")
            error = UnknownNameError("column", name, (*_ANGLE_COLUMNS, *FIELDS))
            raise InputError(f"{head}: {error}")
        joint, unit = _ANGLE_COLUMNS[name]
        if joint in found:
            raise InputError(f"{head}: columns {found[joint]} and {name}; must be one of them")
        found[joint] = name
        numbers = _numbers(where, name, columns[name])
        index = JOINTS.index(joint)
        angles[:, index] = numbers * ANGLE_UNITS[unit]
        largest = scaling.largest_angles[index]
        for row in np.flatnonzero(np.abs(angles[:, index]) > largest * (1.0 + 1e-12))[:1]:
            allowed = f"within +-{largest / ANGLE_UNITS[unit]:g}, full scale"
            require(False, f"{where[row]}: {name}", f"{numbers[row]:g}", allowed)
    for joint in JOINTS:
        if joint not in found:
            raise InputError(f"{head}: no column {joint}_deg or {joint}_rad; must have all angles")
    switches = np.zeros((len(where), len(FIELDS)), dtype=np.int64)
    for index, field in enumerate(FIELDS):
        if field in columns:
            switches[:, index] = _switches(where, field, columns[field])
    both = (switches[:, FIELDS.index("pan")] != 0) & (switches[:, FIELDS.index("tilt")] != 0)
    for row in np.flatnonzero(both)[:1]:
        raise InputError(f"{where[row]}: pan and tilt together; must be one, they share a channel")
    return OperatorFrames(angles=angles, switches=switches)


def _switches(where: Sequence[str], field: str, words: Sequence[str]) -> list[int]:
    """A field's column as numbers, (T,)."""
    if field in _WORDS:
        known = {word: number for number, word in enumerate(_WORDS[field])}
        allowed = ", ".join(known)
    else:
        known = {"0": 0, "1": 1} if field in _ON_OFF else {"-1": -1, "0": 0, "1": 1}
        allowed = " or ".join(known)
    numbers = [known.get(word) for word in words]
    for row, number in enumerate(numbers):
        if number is None:
            require(False, f"{where[row]}: {field}", f"'{shorten(words[row])}'", allowed)
    return [number for number in numbers if number is not None]
