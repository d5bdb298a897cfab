"""Path files: CSV tables of points and YAML lists of lines and arcs.

A CSV has a header `x_in,y_in,z_in` or `x_m,y_m,z_m`; without a recognised unit it is refused. Row 1
is the base end of the straight line, row 2 the home tip (FTL-95 Appendix C). Lines that start with
`#` are comments. A YAML file states pieces as `models/paths/trajectory_4_arcs.yaml` does.
"""

import csv
import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pips_drake.config import load_yaml, read_text, require
from pips_drake.errors import InputError
from pips_drake.scene.packages import find_path_file
from pips_drake.serpentine.tip_path import PathBuilder, TipPath, blended_path, polyline_path
from pips_drake.units import LENGTH_UNITS

Array = NDArray[np.float64]

#: Coordinates, lengths and radii beyond this (m) are mistakes: the arm is 4 m long.
LARGEST = 1000.0


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
        if self.unit not in LENGTH_UNITS:
            raise InputError(f"unit = '{self.unit}'; must be one of {', '.join(LENGTH_UNITS)}")
        for name in ("start", "direction"):
            if len(getattr(self, name)) != 3:
                raise InputError(f"{name} = {getattr(self, name)}; must be three numbers")
        if not self.pieces or self.pieces[0].line is None:
            raise InputError("pieces: the first must be the line from the base to the home tip")
        largest = LARGEST / LENGTH_UNITS[self.unit]
        for value in self.start:
            require(abs(value) <= largest, "start", value, f"within +-{largest:.6g} {self.unit}")
        for index, piece in enumerate(self.pieces):
            for name in ("line", "arc"):
                value = getattr(piece, name) or 0.0
                allowed = f"<= {largest:.6g} {self.unit}"
                require(value <= largest, f"pieces[{index}].{name}", value, allowed)


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
            return blended_path(points, file.stem, corner_deviation=corner_deviation)
        return polyline_path(points, file.stem)
    except InputError as error:
        raise InputError(f"{file}: {error}") from None


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
    raise InputError(f"{file}: header '{','.join(header)}' names no unit; must be {allowed}")


def _read_row(file: Path, number: int, row: list[str], unit: str) -> list[float]:
    if len(row) != 3:
        raise InputError(f"{file}: row {number} has {len(row)} values; must be 3 (x, y, z)")
    values, largest = [], LARGEST / LENGTH_UNITS[unit]
    for axis, word in zip("xyz", row, strict=True):
        try:
            value = float(word)
        except ValueError:
            raise InputError(f"{file}: row {number}, {axis} = '{word}'; must be a number") from None
        if not math.isfinite(value):
            raise InputError(f"{file}: row {number}, {axis} = {word.strip()}; must be finite")
        if abs(value) > largest:
            raise InputError(
                f"{file}: row {number}, {axis} = {word.strip()}; must be within "
                f"+-{largest:.6g} {unit}"
            )
        values.append(value)
    return values


def _read_pieces(file: Path) -> TipPath:
    config = load_yaml(PathFile, file)
    scale = LENGTH_UNITS[config.unit]
    try:
        builder = PathBuilder(start=np.array(config.start) * scale, direction=config.direction)
        for piece in config.pieces:
            if piece.line is not None:
                builder.line(piece.line * scale)
            elif piece.arc is not None and piece.angle_deg is not None:
                builder.arc(
                    radius=piece.arc * scale,
                    angle=math.radians(piece.angle_deg),
                    toward=np.array(piece.toward),
                )
        return builder.build(file.stem)
    except InputError as error:
        raise InputError(f"{file}: {error}") from None
