"""What the operator wants in a frame: the meaning of the analog channels, without their volts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pips_drake.config import require
from pips_drake.errors import InputError, UnknownNameError
from pips_drake.remote_manipulator.configuration import STATIONS

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Where the simulation starts when it is initialized (RMS-71, Table I, channel 2).
INITIALIZE_SELECTS = ("full", "mode_1", "mode_2_or_3")

_SWITCHES = (-1, 0, 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class OperatorInputs:
    """The operator's inputs in one frame.

    Attributes:
        angles: of the master arm, (6,) rad, in the order H0 P0 P1 H2 P2 R2.
        initialize: reset the simulation.
        initialize_select: one of `INITIALIZE_SELECTS`.
        telescope: the stand: 1 longer, -1 shorter, 0 stop.
        pan, tilt: the camera's; one of them is 0.
        zoom: 1 in, -1 out.
        station: of the camera, A to M.
        prong: -1 opens (releases a payload that is held), 1 closes.
        shuttle: translation of the orbiter along x, y, z of {R}, (3,) of -1, 0 or 1.
        open_latch: open the docking port's latch, so that a docked payload can be taken away.
    """

    angles: Array
    initialize: bool = False
    initialize_select: str = "full"
    telescope: int = 0
    pan: int = 0
    tilt: int = 0
    zoom: int = 0
    station: str = "A"
    prong: int = 0
    shuttle: tuple[int, int, int] = (0, 0, 0)
    open_latch: bool = False

    def __post_init__(self) -> None:
        require(np.shape(self.angles) == (6,), "angles: shape", np.shape(self.angles), "(6,)")
        for name in ("telescope", "pan", "tilt", "zoom", "prong"):
            value = getattr(self, name)
            if value not in _SWITCHES:
                raise InputError(f"{name} = {value}; must be -1, 0 or 1")
        good = len(self.shuttle) == 3 and all(value in _SWITCHES for value in self.shuttle)
        require(good, "shuttle", self.shuttle, "three of -1, 0 or 1")
        if self.pan and self.tilt:
            raise InputError("pan and tilt together; they share a channel")
        if self.initialize_select not in INITIALIZE_SELECTS:
            kind = "initialize_select"
            raise UnknownNameError(kind, str(self.initialize_select), INITIALIZE_SELECTS)
        if self.station not in STATIONS or len(self.station) != 1:
            raise UnknownNameError("camera station", str(self.station), STATIONS)


#: Fields of `OperatorInputs` other than the angles, in the order of their channels: the columns of
#: `OperatorFrames.switches`.
FIELDS = (
    "initialize",
    "initialize_select",
    "telescope",
    "pan",
    "tilt",
    "zoom",
    "station",
    "prong",
    "shuttle_x",
    "shuttle_y",
    "shuttle_z",
    "open_latch",
)


@dataclass(frozen=True, kw_only=True, eq=False)
class OperatorFrames:
    """The operator's inputs in many frames.

    Attributes:
        angles: (N, 6) rad.
        switches: (N, 12), a column a field of `FIELDS`: -1, 0 or 1; 0 or 1 where the field is true
            or false; the number in `STATIONS` or `INITIALIZE_SELECTS` where it is a word.
    """

    angles: Array
    switches: Integers

    def __len__(self) -> int:
        return len(self.switches)

    def column(self, field: str) -> Integers:
        """A field of `FIELDS`, (N,)."""
        if field not in FIELDS:
            raise UnknownNameError("operator's field", field, FIELDS)
        return self.switches[:, FIELDS.index(field)]

    def frame(self, row: int, angles: Array | None = None) -> OperatorInputs:
        """The inputs of a row, from 0; its angles unless others are given, (6,) rad."""
        numbers: list[int] = self.switches[row].tolist()
        initialize, select, telescope, pan, tilt, zoom, station, prong, x, y, z, latch = numbers
        return OperatorInputs(
            angles=self.angles[row] if angles is None else angles,
            initialize=initialize == 1,
            initialize_select=INITIALIZE_SELECTS[select],
            telescope=telescope,
            pan=pan,
            tilt=tilt,
            zoom=zoom,
            station=STATIONS[station],
            prong=prong,
            shuttle=(x, y, z),
            open_latch=latch == 1,
        )


def frames_of(inputs: Sequence[OperatorInputs]) -> OperatorFrames:
    """Many frames, of one frame's inputs each."""
    rows = [switches_of(one) for one in inputs]
    return OperatorFrames(
        angles=np.array([one.angles for one in inputs], dtype=np.float64).reshape(-1, 6),
        switches=np.array(rows, dtype=np.int64).reshape(-1, len(FIELDS)),
    )


def switches_of(inputs: OperatorInputs) -> tuple[Any, ...]:
    """The row of `OperatorFrames.switches` that a frame's inputs are, (12,)."""
    return (
        int(inputs.initialize),
        INITIALIZE_SELECTS.index(inputs.initialize_select),
        inputs.telescope,
        inputs.pan,
        inputs.tilt,
        inputs.zoom,
        STATIONS.index(inputs.station),
        inputs.prong,
        *inputs.shuttle,
        int(inputs.open_latch),
    )
