"""Path files: CSV tables of points and YAML lists of lines and arcs.

A CSV has a header `x_in,y_in,z_in` or `x_m,y_m,z_m`; without a recognised unit it is refused. Row 1
is the base end of the straight line, row 2 the home tip (FTL-95 Appendix C). Lines that start with
`#` are comments. A YAML file states pieces as `models/paths/trajectory_4_arcs.yaml` does.
"""

import csv
import math
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pips_drake.config import load_yaml, read_text, require
from pips_drake.errors import InputError, shorten
from pips_drake.scene.packages import find_path_file
from pips_drake.serpentine.tip_path import PathBuilder, TipPath, blended_path, polyline_path
from pips_drake.units import LENGTH_UNITS

Array = NDArray[np.float64]

#: Coordinates, lengths and radii beyond this (m) are mistakes: the arm is 4 m long.
LARGEST = 1000.0
#: Rows and pieces: more would take hours and fill the memory.
MOST_ROWS = 20_000


@dataclass
class PieceConfig:
    """A line of a length, or an arc of a radius that turns by angle_deg toward a side."""

    line: float | None = None
    arc: float | None = None
    angle_deg: float | None = None
    toward: list[float] | None = None

    def validate(self) -> None:
        if (self.line is None) == (self.arc is None):
            raise InputError("pieces: each must have either 'line' or 'arc'")
        if self.arc is not None and (self.angle_deg is None or self.toward is None):
            raise InputError("pieces: an arc needs 'angle_deg' and 'toward'")
        if self.line is not None and (self.angle_deg is not None or self.toward is not None):
            raise InputError("pieces: a line has no 'angle_deg' and no 'toward'")


@dataclass
class PathFile:
    """A path of lines and arcs; lengths in `unit`. The home tip is the end of the first piece."""

    unit: str = ""
    start: list[float] = field(default_factory=list)
    direction: list[float] = field(default_factory=list)
    pieces: list[PieceConfig] = field(default_factory=list)

    def validate(self) -> None:
        known = f"one of {', '.join(LENGTH_UNITS)}"
        require(self.unit in LENGTH_UNITS, "unit", f"'{shorten(self.unit)}'", known)
        for name in ("start", "direction"):
            value = getattr(self, name)
            require(len(value) == 3, name, value, "three numbers")
        if not self.pieces or self.pieces[0].line is None:
            raise InputError("pieces: the first must be the line from the base to the home tip")
        most = len(self.pieces) <= MOST_ROWS
        require(most, "number of pieces", len(self.pieces), f"<= {MOST_ROWS}")
        largest = LARGEST / LENGTH_UNITS[self.unit]
        for value in self.start:
            require(abs(value) <= largest, "start", value, f"within +-{largest:.6g} {self.unit}")
        for index, piece in enumerate(self.pieces):
            where = f"pieces[{index}]"
            for name in ("line", "arc"):
                value, allowed = getattr(piece, name), f"> 0 and <= {largest:.6g} {self.unit}"
                good = value is None or 0.0 < value <= largest
                require(good, f"{where}.{name}", value, allowed)
            angle, toward = piece.angle_deg, piece.toward
            good = angle is None or 0.0 < angle <= 360.0
            require(good, f"{where}.angle_deg", angle, "> 0 and <= 360")
            require(toward is None or len(toward) == 3, f"{where}.toward", toward, "three numbers")


def load_path(
    name: str | Path, *, smooth: bool = False, corner_deviation: float = math.inf
) -> TipPath:
    """The path of a shipped name (`trajectory_4`) or of a file.

    Args:
        smooth: blend the corners of a table (`blended_path`); a path of lines and arcs is smooth
            as it is.
        corner_deviation: how far a blended corner may pass from its point, m.

    Raises:
        InputError: unknown name, or a file that cannot be used; the message says which row.
    """
    file = find_path_file(str(name))
    if file.suffix in (".yaml", ".yml"):
        return _read_pieces(file)
    points = read_points(file)
    try:
        if smooth:
            path = blended_path(points, file.stem, corner_deviation=corner_deviation)
        else:
            path = polyline_path(points, file.stem)
    except InputError as error:
        raise InputError(f"{file}: {error}") from None
    return replace(path, source=str(file))


def read_points(file: Path) -> Array:
    """Points (P, 3) m of a CSV table.

    Raises:
        InputError: names file, row and value. Row numbers count the table's own rows from 1, as
            FTL-95 does; the header and comments do not count.
    """
    text = read_text(file)
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    if "\0" in text:
        raise InputError(f"{file}: not a text file")
    if not lines:
        raise InputError(f"{file}: empty; must have a header such as x_in,y_in,z_in and rows")
    try:
        header, *rows = csv.reader(lines, strict=True)
    except csv.Error as error:
        raise InputError(f"{file}: not a CSV table ({error})") from None
    require(len(rows) <= MOST_ROWS, f"{file}: number of rows", len(rows), f"<= {MOST_ROWS}")
    unit = _length_unit(file, [column.strip() for column in header])
    scale = LENGTH_UNITS[unit]
    points = np.array(
        [_read_row(file, number, row, unit) for number, row in enumerate(rows, start=1)]
    )
    if len(points) < 2:
        raise InputError(
            f"{file}: {len(points)} rows of points; must have two or more (base end, home tip)"
        )
    gaps = np.linalg.norm(np.diff(points, axis=0), axis=1) * scale
    for number in np.flatnonzero(gaps < 1e-6) + 2:
        raise InputError(f"{file}: row {number} repeats row {number - 1}; must be another point")
    return points * scale


def _length_unit(file: Path, header: list[str]) -> str:
    for unit in LENGTH_UNITS:
        if header == [f"{axis}_{unit}" for axis in "xyz"]:
            return unit
    allowed = " or ".join(",".join(f"{axis}_{unit}" for axis in "xyz") for unit in LENGTH_UNITS)
    shown = shorten(",".join(header))
    raise InputError(f"{file}: header '{shown}' names no unit; must be {allowed}")


def _read_row(file: Path, number: int, row: list[str], unit: str) -> list[float]:
    if len(row) != 3:
        raise InputError(f"{file}: row {number} has {len(row)} values; must be 3 (x, y, z)")
    values, largest = [], LARGEST / LENGTH_UNITS[unit]
    for axis, word in zip("xyz", row, strict=True):
        where, shown = f"{file}: row {number}, {axis}", shorten(word.strip())
        try:
            if "_" in word:  # which is a number to Python alone
                raise ValueError
            value = float(word)
        except ValueError:
            raise InputError(f"{where} = '{shown}'; must be a number") from None
        require(math.isfinite(value), where, shown, "finite")
        require(abs(value) <= largest, where, shown, f"within +-{largest:.6g} {unit}")
        values.append(value)
    return values


def _read_pieces(file: Path) -> TipPath:
    config = load_yaml(PathFile, file)
    scale = LENGTH_UNITS[config.unit]
    try:
        where = str(file)
        builder = PathBuilder(start=np.array(config.start) * scale, direction=config.direction)
        for index, piece in enumerate(config.pieces):
            where = f"{file}: pieces[{index}]"
            if piece.line is not None:
                builder.line(piece.line * scale)
            elif piece.arc is not None and piece.angle_deg is not None:
                builder.arc(
                    radius=piece.arc * scale,
                    angle=math.radians(piece.angle_deg),
                    toward=np.array(piece.toward),
                )
        return replace(builder.build(file.stem), source=str(file))
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
