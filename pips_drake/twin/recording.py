"""Series of numbers over time (or another index), and their CSV files."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pips_drake.errors import InputError, UnknownNameError
from pips_drake.twin.output_folder import write_whole

Array = NDArray[np.float64]

#: The index column unless told otherwise.
TIME_COLUMN = "time_s"
# 13 digits are within 5e-13 of the number; all 17 would make files a third larger for nothing.
_FORMAT = "%.13g"


@dataclass(frozen=True, kw_only=True, eq=False)
class Series:
    """Columns of numbers, a row a sample.

    Attributes:
        time: (N,) s, or what else the rows are listed by; finite.
        values: (N, K), in the units that the columns' names end with.
        columns: K names with their units, such as `d1_m` or `theta2_rad`; none twice.
    """

    time: Array
    values: Array
    columns: tuple[str, ...]

    def __post_init__(self) -> None:
        set_field = object.__setattr__
        set_field(self, "time", np.asarray(self.time, dtype=np.float64))
        set_field(self, "values", np.asarray(self.values, dtype=np.float64))
        set_field(self, "columns", tuple(self.columns))
        expected = (len(self.time) if self.time.ndim == 1 else None, len(self.columns))
        if self.time.ndim != 1 or self.values.shape != expected:
            raise InputError(
                f"Series: time of shape {self.time.shape}, values of shape {self.values.shape}, "
                f"{len(self.columns)} columns; must be (N,), (N, K), K"
            )
        repeated = sorted({name for name in self.columns if self.columns.count(name) > 1})
        if repeated:
            raise InputError(f"Series: columns {', '.join(repeated)} twice; each must differ")
        if not np.all(np.isfinite(self.time)):
            raise InputError("Series: time must be finite numbers")

    def column(self, name: str) -> Array:
        """The values (N,) of one column."""
        if name not in self.columns:
            raise UnknownNameError("column", name, self.columns)
        return self.values[:, self.columns.index(name)]

    def select(self, names: Sequence[str]) -> Series:
        """The series of these columns alone, in this order."""
        values = [self.column(name) for name in names]
        shape = (len(self.time), len(values))
        stacked = np.column_stack(values) if values else np.empty(shape)
        return Series(time=self.time, values=stacked, columns=tuple(names))


def write_csv(series: Series, file: Path, *, index: str = TIME_COLUMN) -> None:
    """Writes a series; `time` becomes the first column, named `index`.

    Numbers read back within 5e-13 of themselves; NaN is written as `nan`.
    """
    if index in series.columns:
        raise InputError(f"{file.name}: column '{index}' is the index and a value; one must go")
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow([index, *series.columns])
    # `+ 0.0` turns -0 into 0.
    np.savetxt(text, np.column_stack([series.time, series.values]) + 0.0, _FORMAT, delimiter=",")
    write_whole(file, text.getvalue())


def read_csv(file: Path, *, index: str = TIME_COLUMN) -> Series:
    """Reads what `write_csv` wrote.

    Raises:
        InputError: no such file, another index column, or a row that is not numbers.
    """
    try:
        rows = list(csv.reader(file.read_text(encoding="utf-8-sig").splitlines()))
    except FileNotFoundError:
        raise InputError(f"{file}: no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{file}: cannot be read as text in UTF-8 ({error})") from None
    header = rows[0] if rows else []
    if header[:1] != [index]:
        found = f"'{header[0]}'" if header else "nothing"
        raise InputError(f"{file}: the first column is {found}; must be '{index}'")
    table = np.empty((len(rows) - 1, len(header)))
    for line, row in enumerate(rows[1:], start=2):
        if len(row) != len(header):
            raise InputError(f"{file}: line {line} has {len(row)} values; must be {len(header)}")
        try:
            table[line - 2] = [float(cell) for cell in row]
        except ValueError as error:
            raise InputError(f"{file}: line {line}: {error}; must be numbers") from None
    try:
        return Series(time=table[:, 0], values=table[:, 1:], columns=tuple(header[1:]))
    except InputError as error:
        raise InputError(f"{file}: {error}") from None
