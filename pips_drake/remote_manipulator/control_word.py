"""The scene generator's control word: what the collision program tells the scene program.

RMS-71, Table II; bit 0 is the most significant one of 24:

    0  initialize                12, 13  open, close the prong
    1, 2  telescope, its sign    14 .. 17  spare
    3, 5  tilt, pan              18, 19  finger's, arm's motion inhibit flag
    4  sign of tilt or pan       20 .. 23  mode 4, 3, 2, 1
    6, 7  zoom, in or out
    8 .. 11  station's code

A sign is 1 for "positive" and for zooming in. The 14 most significant bits are the operator's, the
ten least significant ones the program's (READADC and PACSGW).

Table II does not say what is illegal. Here a word has one meaning and a meaning has one word, so
these are refused: codes of no station (5 to 7), both of open and close, both of pan and tilt, a
sign whose function is off, spare bits, and none or several of the mode bits. Any flags go with any
mode: it is the program that decides when to inhibit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pips_drake.config import require
from pips_drake.errors import InputError, UnknownNameError
from pips_drake.remote_manipulator.configuration import STATIONS
from pips_drake.remote_manipulator.operator_inputs import OperatorInputs
from pips_drake.remote_manipulator.station_codes import STATION_CODES, STATIONS_BY_CODE
from pips_drake.remote_manipulator.words import WORD_BITS, WORD_END, as_words

#: Modes of the task: acquisition, extraction, manoeuvring, docked.
MODES = (1, 2, 3, 4)

_SWITCHES = (-1, 0, 1)


@dataclass(frozen=True, kw_only=True)
class ControlWord:
    """What a control word says.

    Attributes:
        initialize: the scene returns to its initial values.
        telescope: the stand: 1 longer, -1 shorter, 0 stop.
        tilt, pan: the camera's; one of them is 0.
        zoom: 1 in, -1 out.
        station: of the camera, A to M.
        prong: -1 opens, 1 closes.
        finger_inhibit, arm_inhibit: motion inhibit flags.
        mode: 1 to 4.
    """

    initialize: bool = False
    telescope: int = 0
    tilt: int = 0
    pan: int = 0
    zoom: int = 0
    station: str = "A"
    prong: int = 0
    finger_inhibit: bool = False
    arm_inhibit: bool = False
    mode: int = 1

    def __post_init__(self) -> None:
        for name in ("telescope", "tilt", "pan", "zoom", "prong"):
            value = getattr(self, name)
            if value not in _SWITCHES:
                raise InputError(f"ControlWord.{name} = {value}; must be -1, 0 or 1")
        if self.tilt and self.pan:
            raise InputError("ControlWord: tilt and pan together; they share their sign's bit")
        if self.mode not in MODES:
            raise InputError(f"ControlWord.mode = {self.mode}; must be 1, 2, 3 or 4")
        if self.station not in STATION_CODES:
            raise UnknownNameError("camera station", str(self.station), STATIONS)


def control_word(
    inputs: OperatorInputs, *, mode: int, finger_inhibit: bool = False, arm_inhibit: bool = False
) -> ControlWord:
    """The control word of a frame: the operator's inputs, and what the program found."""
    return ControlWord(
        initialize=inputs.initialize,
        telescope=inputs.telescope,
        tilt=inputs.tilt,
        pan=inputs.pan,
        zoom=inputs.zoom,
        station=inputs.station,
        prong=inputs.prong,
        finger_inhibit=finger_inhibit,
        arm_inhibit=arm_inhibit,
        mode=mode,
    )


def encode(word: ControlWord) -> int:
    """The 24 bits of a control word, as a number 0 .. 2^24 - 1."""
    bits = int(word.initialize)
    bits = bits << 2 | _with_sign(word.telescope)
    # The camera's three bits are tilt, sign and pan.
    tilt = _with_sign(word.tilt)
    pan = _with_sign(word.pan)
    bits = bits << 3 | tilt << 1 | (pan & 1) << 1 | pan >> 1
    bits = bits << 2 | _with_sign(word.zoom)
    bits = bits << 4 | STATION_CODES[word.station]
    bits = bits << 2 | (word.prong == -1) << 1 | (word.prong == 1)
    bits = bits << 4  # spares
    bits = bits << 2 | bool(word.finger_inhibit) << 1 | bool(word.arm_inhibit)
    return bits << 4 | 1 << (word.mode - 1)


def decode(bits: int) -> ControlWord:
    """What the 24 bits of a control word say.

    Raises:
        InputError: an illegal word; says which bits are wrong.
    """
    bits = int(as_words(bits, "control word")) if not isinstance(bits, int) else bits
    if not 0 <= bits < WORD_END:
        raise InputError(f"control word = {bits}; must be a whole number of {WORD_BITS} bits")
    for wrong, message in _FAULTS:
        if wrong(bits):
            raise InputError(f"control word {bits:06X}: {message(bits)}")
    return ControlWord(
        initialize=bool(_bit(bits, 0)),
        telescope=_signed(bits, 1, 2),
        tilt=_signed(bits, 3, 4),
        pan=_signed(bits, 5, 4),
        zoom=_signed(bits, 6, 7),
        station=STATIONS_BY_CODE[_code(bits)],
        prong=_bit(bits, 13) - _bit(bits, 12),
        finger_inhibit=bool(_bit(bits, 18)),
        arm_inhibit=bool(_bit(bits, 19)),
        mode=(bits & 15).bit_length(),
    )


def decode_log(words: ArrayLike) -> dict[str, np.ndarray[Any, Any]]:
    """The fields of many control words by name, (N,) each: stations are letters, flags boolean.

    Args:
        words: (N,), whole numbers.

    Raises:
        InputError: an illegal word; says its row and which bits are wrong.
    """
    bits = as_words(words, "control word")
    require(bits.ndim == 1, "control words: shape", bits.shape, "(N,)")
    for wrong, message in _FAULTS:
        for row in np.flatnonzero(wrong(bits))[:1]:
            value = int(bits[row])
            raise InputError(f"row {row + 1}: control word {value:06X}: {message(value)}")
    letters = np.array([STATIONS_BY_CODE.get(code, "") for code in range(16)])
    mode = sum((number * _bit(bits, WORD_BITS - number) for number in MODES), np.zeros_like(bits))
    return {
        "initialize": _bit(bits, 0) == 1,
        "telescope": _signed(bits, 1, 2),
        "tilt": _signed(bits, 3, 4),
        "pan": _signed(bits, 5, 4),
        "zoom": _signed(bits, 6, 7),
        "station": letters[_code(bits)],
        "prong": _bit(bits, 13) - _bit(bits, 12),
        "finger_inhibit": _bit(bits, 18) == 1,
        "arm_inhibit": _bit(bits, 19) == 1,
        "mode": mode,
    }


def legal(words: ArrayLike) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Which words of 24 bits are control words, (N,)."""
    bits = as_words(words, "control word")
    good = np.ones(bits.shape, dtype=bool)
    for wrong, _ in _FAULTS:
        good &= np.logical_not(wrong(bits))
    return good


def _with_sign(value: int) -> int:
    """The two bits of a function and its sign: 0, 2 or 3."""
    return 3 if value > 0 else 2 if value < 0 else 0


def _bit(bits: Any, position: int) -> Any:
    """A bit by Table II's position: of a number, or of words (N,)."""
    return (bits >> (WORD_BITS - 1 - position)) & 1


def _signed(bits: Any, function: int, sign: int) -> Any:
    """A function that is off, or has the sign that another bit says."""
    return _bit(bits, function) * (2 * _bit(bits, sign) - 1)


def _code(bits: Any) -> Any:
    return (bits >> 12) & 15


def _sign_alone(sign: int, *functions: int) -> Callable[[Any], Any]:
    """Whether a sign stands while all its functions are off, of a number or of words (N,)."""
    sign_mask = 1 << (WORD_BITS - 1 - sign)
    mask = sum((1 << (WORD_BITS - 1 - function) for function in functions), sign_mask)
    return lambda bits: (bits & mask) == sign_mask


#: What makes a word illegal, of a number or of words (N,), and how a number's fault is told.
_FAULTS: tuple[tuple[Callable[[Any], Any], Callable[[int], str]], ...] = (
    (
        lambda bits: (_code(bits) >= 5) & (_code(bits) <= 7),
        lambda bits: f"bits 8-11 say station {_code(bits)}; must be 0-4 or 8-15",
    ),
    (
        lambda bits: (bits & 0xC00) == 0xC00,
        lambda bits: "bits 12 and 13 open and close the prong together",
    ),
    (
        lambda bits: (bits & 0x140000) == 0x140000,
        lambda bits: "bits 3 and 5 tilt and pan together; they share their sign's bit",
    ),
    (_sign_alone(2, 1), lambda bits: "bit 2 is the sign of bit 1, telescope, which is off"),
    (
        _sign_alone(4, 3, 5),
        lambda bits: "bit 4 is the sign of bits 3 and 5, tilt and pan, both off",
    ),
    (_sign_alone(7, 6), lambda bits: "bit 7 is the sign of bit 6, zoom, which is off"),
    (lambda bits: (bits & 0x3C0) != 0, lambda bits: "bits 14-17 are spares; must be 0"),
    (
        lambda bits: ((bits & 15) == 0) | ((bits & 15 & ((bits & 15) - 1)) != 0),
        lambda bits: f"bits 20-23 say {bits & 15:04b}; must have exactly one 1, the mode's",
    ),
)
