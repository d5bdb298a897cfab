"""The operator's analog channels: volts into inputs and back (RMS-71, Table I).

Channels are numbered from 1; their voltages are fractions of a full scale V, which the report does
not give. Its misprints "+3V", "+zV" and "-3V" are halves of V.

     1  initialize: 0 run, +V initialize
     2  what is initialized: 0 the full problem, +V mode 1, -V mode 2 or 3
     3 .. 8  angles H0, P0, P1, H2, P2, R2, "scaling set by analog adjustments"
     9  stand: +V longer, -V shorter
    10  camera: +V +pan, +V/2 -pan, -V/2 +tilt, -V -tilt
    11  zoom: +V in, -V out
    12  camera station: see `station_codes`
    13  prong: +V closes, -V opens

Section VII asks for more and names no channels; these are assumed. Opening the prong releases a
payload that is held.

    14, 15, 16  translation of the orbiter along x, y, z of {R}: +V, 0, -V
    17  docking port's latch: 0 shut, -V open

All levels are eighths of V. A voltage means the level that is nearest; one that is farther than a
dead band from every level of its channel is refused, because it means nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.config import require
from pips_drake.errors import InputError
from pips_drake.remote_manipulator.configuration import JOINTS, STATIONS, ArmConfig
from pips_drake.remote_manipulator.operator_inputs import (
    FIELDS,
    Integers,
    OperatorFrames,
    OperatorInputs,
    frames_of,
)
from pips_drake.remote_manipulator.station_codes import STATION_EIGHTHS

Array = NDArray[np.float64]

#: Channels of Table I, and with the extension's.
REPORT_CHANNELS, CHANNELS = 13, 17
#: How many channels a frame may have: Table I's, with the orbiter's translation, with the latch.
#: Channels that are not there are 0 V.
CHANNEL_COUNTS = (REPORT_CHANNELS, 16, CHANNELS)
#: Full scale V, V: assumed, what analog computers of the time had.
FULL_SCALE = 10.0
#: A voltage may be this part of V away from its level: assumed. It is less than half of the eighth
#: between two stations, so no voltage has two meanings.
DEAD_BAND = 0.05
#: The full scale of an angle is this at least, rad: half a turn.
HALF_TURN = np.pi
#: Angles may exceed their full scale by this part of it: rounding.
_ROUNDING = 1e-12

_ANGLES = slice(2, 8)
_THREE = {0: 0, 1: 8, -1: -8}
#: Channel of each field, and its levels in eighths of V.
_LEVELS: Mapping[str, tuple[int, Mapping[int, int]]] = {
    "initialize": (1, {0: 0, 1: 8}),
    "initialize_select": (2, {0: 0, 1: 8, 2: -8}),
    "telescope": (9, _THREE),
    "pan": (10, {0: 0, 1: 8, -1: 4}),
    "tilt": (10, {0: 0, 1: -4, -1: -8}),
    "zoom": (11, _THREE),
    "station": (12, {number: STATION_EIGHTHS[name] for number, name in enumerate(STATIONS)}),
    "prong": (13, _THREE),
    "shuttle_x": (14, _THREE),
    "shuttle_y": (15, _THREE),
    "shuttle_z": (16, _THREE),
    "open_latch": (17, {0: 0, 1: -8}),
}


def _tables() -> tuple[Integers, Integers, NDArray[np.bool_], Integers]:
    """By field its channel's column (12,); by level from -8 to 8 its value and whether its channel
    has such a level, (12, 17) each; by value from -1 its level in eighths (12, 14)."""
    columns = np.array([_LEVELS[field][0] - 1 for field in FIELDS])
    values = np.zeros((len(FIELDS), 17), dtype=np.int64)
    legal = np.zeros((len(FIELDS), 17), dtype=bool)
    eighths = np.zeros((len(FIELDS), 14), dtype=np.int64)
    for row, field in enumerate(FIELDS):
        channel, levels = _LEVELS[field]
        for value, level in levels.items():
            values[row, level + 8] = value
            eighths[row, value + 1] = level
        for other, levels in _LEVELS.values():  # pan and tilt share a channel
            if other == channel:
                legal[row, np.array(list(levels.values())) + 8] = True
    return columns, values, legal, eighths


_COLUMNS, _VALUES, _LEGAL, _EIGHTHS = _tables()
_ROWS = np.arange(len(FIELDS))
#: Adds the fields' voltages to their channels (pan and tilt share one), (12, 17).
_TO_CHANNELS = np.eye(CHANNELS)[_COLUMNS]


@dataclass(frozen=True, kw_only=True, eq=False)
class AngleScaling:
    """The analog adjustments.

    Attributes:
        radians_per_volt: of channels 3 to 8, (6,) rad/V, positive.
        full_scale: V of Table I, V.
        dead_band: how far a voltage may be from its level, as a part of V.
    """

    radians_per_volt: Array
    full_scale: float = FULL_SCALE
    dead_band: float = DEAD_BAND

    def __post_init__(self) -> None:
        scale = np.asarray(self.radians_per_volt, dtype=np.float64)
        good = scale.shape == (6,) and bool(np.all(np.isfinite(scale) & (scale > 0.0)))
        require(good, "AngleScaling.radians_per_volt", scale.tolist(), "six numbers > 0")
        good = 0.1 <= self.full_scale <= 1000.0
        require(good, "AngleScaling.full_scale", f"{self.full_scale} V", "0.1 .. 1000 V")
        good = 0.0 < self.dead_band < 1.0 / 16.0
        require(good, "AngleScaling.dead_band", self.dead_band, "> 0 and < 1/16, half of a step")

    @property
    def largest_angles(self) -> Array:
        """The angles at full scale, (6,) rad."""
        return self.radians_per_volt * self.full_scale


def angle_scaling(arm: ArmConfig, full_scale: float = FULL_SCALE) -> AngleScaling:
    """The adjustments with which every angle that an arm can have is within full scale.

    Full scale is half a turn, or the joint's limit where that is larger: equal voltages mean equal
    angles at all joints that turn no farther.
    """
    largest = np.maximum(np.maximum(np.abs(arm.lower), np.abs(arm.upper)), HALF_TURN)
    return AngleScaling(radians_per_volt=largest / full_scale, full_scale=full_scale)


def decode_channels(volts: ArrayLike, scaling: AngleScaling) -> OperatorFrames:
    """What the operator's channels say, frame by frame.

    Args:
        volts: (N, 13), (N, 16) or (N, 17), V, channel 1 first.

    Raises:
        InputError: a voltage that is no number, between levels, or an angle beyond full scale; says
            channel and volts, and the frame where there are several.
    """
    volts = np.asarray(volts, dtype=np.float64)
    if volts.ndim != 2 or volts.shape[1] not in CHANNEL_COUNTS:
        allowed = "(N, 13), (N, 16) or (N, 17)"
        raise InputError(f"channels: shape = {volts.shape}; must be {allowed}")
    end = 2.0 * scaling.full_scale  # illegal as well, and finite
    eighths = np.zeros((len(volts), CHANNELS))
    eighths[:, : volts.shape[1]] = np.minimum(np.maximum(volts, -end), end)
    eighths *= 8.0 / scaling.full_scale
    field_eighths = eighths[:, _COLUMNS]
    nearest = np.rint(field_eighths)
    good = np.abs(field_eighths - nearest) <= 8.0 * scaling.dead_band  # which NaN is not
    good &= np.abs(nearest) <= 8.0
    levels = np.where(good, nearest, 0.0).astype(np.int64) + 8
    good &= _LEGAL[_ROWS, levels]
    angle_volts = volts[:, _ANGLES]
    within = np.abs(angle_volts) <= scaling.full_scale * (1.0 + _ROUNDING)
    if not (good.all() and within.all()):
        _refuse(volts, good, within, scaling)
    return OperatorFrames(
        angles=angle_volts * scaling.radians_per_volt, switches=_VALUES[_ROWS, levels]
    )


def decode_frame(volts: ArrayLike, scaling: AngleScaling) -> OperatorInputs:
    """What the operator's channels, (13,), (16,) or (17,) V, say in one frame."""
    return decode_channels(np.asarray(volts, dtype=np.float64)[np.newaxis], scaling).frame(0)


def encode_channels(frames: OperatorFrames, scaling: AngleScaling) -> Array:
    """The voltages of the channels that say what an operator wants, (N, 17) V.

    Raises:
        InputError: an angle beyond full scale; says which.
    """
    good = np.abs(frames.angles) <= scaling.largest_angles * (1.0 + _ROUNDING)
    for row, joint in np.argwhere(~good)[:1]:
        angle = np.degrees(frames.angles[row, joint])
        largest = np.degrees(scaling.largest_angles[joint])
        where = f"frame {row + 1}: " if len(frames) > 1 else ""
        raise InputError(
            f"{where}{JOINTS[joint]} = {angle:g} deg; must be within +-{largest:g} deg, the full "
            f"scale of channel {joint + 3}"
        )
    levels = _EIGHTHS[_ROWS, frames.switches + 1] * (scaling.full_scale / 8.0)
    volts: Array = levels @ _TO_CHANNELS
    volts[:, _ANGLES] = frames.angles / scaling.radians_per_volt
    return volts


def encode_frame(inputs: OperatorInputs, scaling: AngleScaling) -> Array:
    """The voltages of the channels that say what an operator wants in a frame, (17,) V."""
    volts: Array = encode_channels(frames_of([inputs]), scaling)[0]
    return volts


def _refuse(
    volts: Array, good: NDArray[np.bool_], within: NDArray[np.bool_], scaling: AngleScaling
) -> None:
    """Says what is wrong in the first frame that is."""
    row = int(np.flatnonzero(~(good.all(axis=1) & within.all(axis=1)))[0])
    columns = [*_COLUMNS[~good[row]], *(np.flatnonzero(~within[row]) + _ANGLES.start)]
    column = int(min(columns))
    where = f"frame {row + 1}: " if len(volts) > 1 else ""
    if _ANGLES.start <= column < _ANGLES.stop:
        joint = JOINTS[column - _ANGLES.start]
        allowed = f"within +-{scaling.full_scale:g} V ({joint})"
    else:
        legal = sorted({level for c, table in _LEVELS.values() if c == column + 1
                        for level in table.values()})  # fmt: skip
        listed = ", ".join(f"{0.125 * level * scaling.full_scale:g}" for level in legal)
        allowed = f"within {scaling.dead_band * scaling.full_scale:g} V of {listed}"
    raise InputError(f"{where}channel {column + 1} = {volts[row, column]:g} V; must be {allowed}")
