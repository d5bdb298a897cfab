"""The control word has Table II's bits; every legal one round-trips, every other is refused."""

from __future__ import annotations

import re
from itertools import product

import numpy as np
import pytest

from pips_drake.errors import InputError
from pips_drake.remote_manipulator.control_word import (
    ControlWord,
    control_word,
    decode,
    decode_log,
    encode,
    legal,
)
from pips_drake.remote_manipulator.operator_inputs import OperatorInputs

#: RMS-71, Table II: field, value, and the bits that are 1, bit 0 the most significant of 24.
TABLE_2 = [
    ("initialize", True, {0}),
    ("telescope", 1, {1, 2}),
    ("telescope", -1, {1}),
    ("tilt", 1, {3, 4}),
    ("tilt", -1, {3}),
    ("pan", 1, {4, 5}),
    ("pan", -1, {5}),
    ("zoom", 1, {6, 7}),
    ("zoom", -1, {6}),
    ("prong", -1, {12}),
    ("prong", 1, {13}),
    ("finger_inhibit", True, {18}),
    ("arm_inhibit", True, {19}),
]
STATIONS = {
    "A": "0000", "B": "0001", "C": "0010", "D": "0011", "E": "0100",
    "F": "1000", "G": "1001", "H": "1010",
    "I": "1011", "J": "1100", "K": "1101", "L": "1110", "M": "1111",
}  # fmt: skip
#: initialize, telescope, tilt and pan, zoom, stations, prong, two flags, modes.
LEGAL = 2 * 3 * 5 * 3 * 13 * 3 * 4 * 4


def number(bits: set[int]) -> int:
    return int("".join("1" if position in bits else "0" for position in range(24)), 2)


@pytest.mark.parametrize(("mode", "value"), [(1, 1), (2, 2), (3, 4), (4, 8)])
def test_nothing_but_a_mode_is_one_of_the_last_four_bits(mode, value):
    assert encode(ControlWord(mode=mode)) == value
    assert decode(value) == ControlWord(mode=mode)


@pytest.mark.parametrize(("field", "value", "bits"), TABLE_2)
def test_a_function_has_its_bits(field, value, bits):
    word = ControlWord(**{field: value})
    assert encode(word) == number(bits | {23})
    assert decode(number(bits | {23})) == word


@pytest.mark.parametrize("station", STATIONS)
def test_a_station_has_its_code(station):
    bits = int(f"00000000{STATIONS[station]}000000000001", 2)
    assert encode(ControlWord(station=station)) == bits
    assert decode(bits).station == station


def test_a_word_by_hand():
    """Stand down, pan right, zoom out, station G, close, arm inhibited, mode 3."""
    word = ControlWord(telescope=-1, pan=1, zoom=-1, station="G", prong=1, arm_inhibit=True, mode=3)
    assert encode(word) == 0b010011101001010000010100
    assert decode(0b010011101001010000010100) == word


def test_the_operator_fills_the_first_fourteen_bits_and_the_program_the_last_ten():
    operator = OperatorInputs(
        angles=np.zeros(6), initialize=True, telescope=1, tilt=1, zoom=1, station="M", prong=-1
    )
    program = {"mode": 4, "finger_inhibit": True, "arm_inhibit": True}
    assert encode(control_word(operator, **program)) == number({*range(5), *range(6, 13)}) | 0x38
    idle = OperatorInputs(angles=np.zeros(6))
    assert encode(control_word(idle, **program)) >> 10 == 0
    assert encode(control_word(operator, mode=1)) & 0x3FF == 1


def every_word() -> list[ControlWord]:
    cameras = ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))
    switches, off_on = (-1, 0, 1), (False, True)
    return [
        ControlWord(
            initialize=initialize, telescope=telescope, tilt=tilt, pan=pan, zoom=zoom,
            station=station, prong=prong, finger_inhibit=finger, arm_inhibit=arm, mode=mode,
        )
        for initialize, telescope, (tilt, pan), zoom, station, prong, finger, arm, mode in product(
            off_on, switches, cameras, switches, STATIONS, switches, off_on, off_on, (1, 2, 3, 4)
        )
    ]  # fmt: skip


def test_every_legal_word_round_trips_and_no_two_are_the_same():
    words = every_word()
    assert len(words) == LEGAL
    bits = [encode(word) for word in words]
    assert len(set(bits)) == LEGAL
    log = decode_log(bits)
    for name, column in log.items():
        assert column.tolist() == [getattr(word, name) for word in words], name
    for row in range(0, LEGAL, 7):  # coprime with all the counts above
        assert decode(bits[row]) == words[row]


@pytest.mark.parametrize("last", [0, 1, 0xC01, 0x041, 0x033, 0x834])
def test_with_any_first_half_a_word_is_legal_or_refused(last):
    """One reading: `legal`, `decode` and the round trip agree, on all 4096 first halves."""
    words = (np.arange(4096) << 12) | last
    good = legal(words)
    assert good.sum() == (0 if last in (0, 0xC01, 0x041, 0x033) else LEGAL // (3 * 4 * 4))
    for word, fine in zip(words[::5].tolist(), good[::5], strict=True):
        if fine:
            assert encode(decode(word)) == word
        else:
            with pytest.raises(InputError, match=f"^control word {word:06X}: bit"):
                decode(word)


def test_of_all_words_of_24_bits_as_many_are_legal_as_have_a_meaning():
    count = sum(int(legal(np.arange(k << 20, (k + 1) << 20)).sum()) for k in range(16))
    assert count == LEGAL


FAULTS = {
    "bits 8-11 say station 5; must be 0-4 or 8-15": 0x005001,
    "bits 8-11 say station 6; must be 0-4 or 8-15": 0x006001,
    "bits 8-11 say station 7; must be 0-4 or 8-15": 0x007001,
    "bits 12 and 13 open and close the prong together": number({12, 13, 23}),
    "bits 3 and 5 tilt and pan together; they share their sign's bit": number({3, 5, 23}),
    "bit 2 is the sign of bit 1, telescope, which is off": number({2, 23}),
    "bit 4 is the sign of bits 3 and 5, tilt and pan, both off": number({4, 23}),
    "bit 7 is the sign of bit 6, zoom, which is off": number({7, 23}),
    "bits 20-23 say 0000; must have exactly one 1, the mode's": 0,
    "bits 20-23 say 0011; must have exactly one 1, the mode's": 3,
    "bits 20-23 say 1101; must have exactly one 1, the mode's": 13,
}


@pytest.mark.parametrize("message", FAULTS)
def test_an_illegal_word_is_refused_with_the_reason(message):
    bits = FAULTS[message]
    with pytest.raises(InputError, match=f"^{re.escape(f'control word {bits:06X}: {message}')}$"):
        decode(bits)
    with pytest.raises(InputError, match=f"^{re.escape(f'row 2: control word {bits:06X}: ')}"):
        decode_log([1, bits, 0])
    assert legal([bits, 1]).tolist() == [False, True]


@pytest.mark.parametrize("spare", [14, 15, 16, 17])
def test_spare_bits_are_refused(spare):
    with pytest.raises(InputError, match=r"bits 14-17 are spares; must be 0$"):
        decode(number({spare, 23}))


@pytest.mark.parametrize("bits", [-1, 1 << 24, 0x1000001, 1.5, np.nan, float(1 << 24), np.inf])
def test_what_has_not_24_bits_is_refused(bits):
    with pytest.raises(InputError, match=r"^control word = .*; must be a whole number of 24 bits"):
        decode(bits)


@pytest.mark.parametrize("kind", [int, float, np.int64, np.uint32, np.float64])
def test_a_word_may_come_from_a_port_that_holds_floats(kind):
    assert decode(kind(0x4E9414)) == decode(0x4E9414)


BAD_FIELDS = {
    "ControlWord.prong = 2; must be -1, 0 or 1": {"prong": 2},
    "ControlWord: tilt and pan together": {"tilt": 1, "pan": 1},
    "ControlWord.mode = 0; must be 1, 2, 3 or 4": {"mode": 0},
    "ControlWord.mode = 5; must be 1, 2, 3 or 4": {"mode": 5},
    "unknown camera station 'N'": {"station": "N"},
}


@pytest.mark.parametrize("message", BAD_FIELDS)
def test_a_word_that_has_no_bits_cannot_be_made(message):
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        ControlWord(**BAD_FIELDS[message])
