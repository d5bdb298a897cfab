"""The output block holds what it is given within rounding; what is no block is refused."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pips_drake.errors import InputError
from pips_drake.remote_manipulator.control_word import ControlWord, encode
from pips_drake.remote_manipulator.output_block import SQUARE_TOLERANCE, decode_block, encode_block
from pips_drake.remote_manipulator.words import from_words, to_words

FOOT = 0.3048
WORD = ControlWord(station="F", mode=2, arm_inhibit=True, finger_inhibit=True)
NORMALS = np.array([[1.0, 0.0, 0.0], [0.0, -0.6, 0.8], [0.0, 0.0, -1.0]])
#: Half of the last bit of B1 (22 bits of fraction) and of B11 (12 bits of fraction, in ft).
UNIT_ROUNDING, DISTANCE_ROUNDING = 2.0**-23, 2.0**-13 * FOOT


def block(angles=(0.1, 0.2, -0.3, 1.0, -2.0, 7.0), normals=NORMALS, distances=(1.0, -2.0, 0.5)):
    return encode_block(WORD, angles, normals, distances)


#: Bits after the sign, value, word: two's complement by hand.
WORDS = [
    (1, 0.0, 0x000000),
    (1, 1.0, 0x400000),
    (1, 0.5, 0x200000),
    (1, -1.0, 0xC00000),
    (1, -2.0, 0x800000),
    (1, 2.0**-22, 0x000001),
    (1, -(2.0**-22), 0xFFFFFF),
    (11, 1.0, 0x001000),
    (11, -1.0, 0xFFF000),
    (11, 2048.0 - 2.0**-12, 0x7FFFFF),
    (11, -2048.0, 0x800000),
    (16, 1.0, 0x000080),
    (23, 1.0, 0x000001),
    (0, -1.0, 0x800000),
]


@pytest.mark.parametrize(("bits", "value", "word"), WORDS)
def test_a_number_has_its_word(bits, value, word):
    assert to_words(value, bits) == word
    assert from_words(word, bits) == value


@pytest.mark.parametrize(
    ("bits", "value"),
    [
        (1, 2.0),
        (1, 2.0 - 2.0**-24),  # rounds to 2, which is beyond
        (1, -2.0 - 2.0**-22),
        (11, 2048.0),
        (11, -2049.0),
        (11, np.nan),
        (11, np.inf),
        (11, -np.inf),
    ],
)
def test_what_no_word_holds_is_refused(bits, value):
    end = {1: "-2 .. 2", 11: "-2048 .. 2048"}[bits]
    with pytest.raises(InputError, match=rf"^speed = .*; must be within {end} \(B{bits}\)$"):
        to_words([0.0, value], bits, "speed")


@given(value=st.floats(-1.9999, 1.9999), bits=st.sampled_from([1, 3, 11, 16]))
@settings(max_examples=200, derandomize=True, deadline=None)
def test_rounding_errs_by_half_of_the_last_bit(value, bits):
    value *= 2.0 ** (bits - 1)
    assert abs(from_words(to_words(value, bits), bits) - value) <= 2.0 ** (bits - 24)


def test_every_word_is_read_and_written_back():
    words = np.arange(0, 1 << 24, 61)  # 61 is odd, so that the last bits take all their values
    np.testing.assert_array_equal(to_words(from_words(words, 11), 11), words)


def test_a_block_by_hand():
    words = encode_block(
        WORD,
        np.radians([0.0, 90.0, -90.0, 180.0, 30.0, 447.0]),
        NORMALS,
        np.array([0.0, 10.0, -0.5]) * FOOT,
    )
    assert words[0] == encode(WORD)
    one, minus, half, zero = 0x400000, 0xC00000, 0x200000, 0
    cosine_30 = round(np.sqrt(0.75) * 2**22)
    expected = [zero, one, one, zero, minus, zero, zero, minus, half, cosine_30]
    assert words[1:11].tolist() == expected
    # 447 deg is 87 deg: a block knows no whole turns.
    np.testing.assert_allclose(
        from_words(words[11:13], 1), [np.sin(np.radians(87.0)), np.cos(np.radians(87.0))],
        atol=UNIT_ROUNDING,
    )  # fmt: skip
    assert words[13:17].tolist() == [one, 0, 0, 0]
    assert words[17:21].tolist() == [0, (1 << 24) - round(0.6 * 2**22), round(0.8 * 2**22), 0xA000]
    assert words[21:25].tolist() == [0, 0, minus, 0xFFF800]
    assert words[25:].tolist() == [0] * 7


def test_blocks_round_trip_within_half_of_the_last_bit():
    rng = np.random.default_rng(3)
    for _ in range(200):
        angles = rng.uniform(-7.8, 7.8, 6)
        normals = rng.normal(size=(3, 3))
        normals /= np.linalg.norm(normals, axis=1)[:, np.newaxis]
        distances = rng.uniform(-600.0, 600.0, 3)
        words = encode_block(WORD, angles, normals, distances)
        assert words.shape == (32,)
        assert words.min() >= 0
        assert words.max() < 1 << 24
        back = decode_block(words)
        assert back.word == WORD
        # On top of the half bit some roundings of double precision, a thousandth of it.
        bound = 1.001 * UNIT_ROUNDING
        np.testing.assert_allclose(back.sines, np.sin(angles), rtol=0.0, atol=bound)
        np.testing.assert_allclose(back.cosines, np.cos(angles), rtol=0.0, atol=bound)
        np.testing.assert_allclose(back.normals, normals, rtol=0.0, atol=bound)
        bound = 1.001 * DISTANCE_ROUNDING
        np.testing.assert_allclose(back.distances, distances, rtol=0.0, atol=bound)
        # Sine and cosine both err by half a bit: the angle by sqrt(2) of that.
        turns = np.exp(1j * (back.angles - angles))
        assert np.abs(np.angle(turns)).max() <= 1.5 * UNIT_ROUNDING
        # What was read is sent again as the same words.
        again = encode_block(back.word, back.angles, normals, back.distances)
        np.testing.assert_array_equal(again[[0, 16, 20, 24]], words[[0, 16, 20, 24]])


def test_a_block_may_come_from_a_port_that_holds_floats():
    back = decode_block(block().astype(float))
    assert back.word == WORD
    np.testing.assert_array_equal(back.sines, decode_block(block()).sines)


def test_the_longest_rounding_of_a_unit_vector_is_within_its_tolerance():
    """The worst case is reached nearly: equal components, all rounded the same way."""
    worst = np.sqrt(np.float64(3.0)) * 2.0 * UNIT_ROUNDING
    assert 0.8 * SQUARE_TOLERANCE < worst + 3.0 * UNIT_ROUNDING**2 < SQUARE_TOLERANCE


DAMAGES = {
    "shape = (31,); must be (32,)": lambda words: words[:31],
    "word = -1; must be a whole number of 24 bits": lambda words: put(words, 5, -1),
    "word = 16777216; must be a whole number of 24": lambda words: put(words, 31, 1 << 24),
    "word = 0.5; must be a whole": lambda words: put(words.astype(float), 1, 0.5),
    "word = nan; must be a whole": lambda words: put(words.astype(float), 1, np.nan),
    "word 25 = 000007; must be blank, 0": lambda words: put(words, 25, 7),
    "word 31 = FFFFFF; must be blank, 0": lambda words: put(words, 31, 0xFFFFFF),
    "H0: sin^2 + cos^2 = ": lambda words: put(words, 2, words[2] + 4),
    "R2: sin^2 + cos^2 = 0.": lambda words: put(words, 11, 0),
    "plane 1: length of the normal = 0; must be 1": lambda words: put(words, 13, 0),
    "plane 2: length of the normal = 1.": lambda words: put(words, 19, words[19] + 4),
}


def put(words: np.ndarray, index: int, value: float) -> np.ndarray:
    words = words.copy()
    words[index] = value
    return words


@pytest.mark.parametrize("message", DAMAGES)
def test_a_damaged_block_is_refused(message):
    with pytest.raises(InputError, match=f"^{re.escape(f'output block: {message}')}"):
        decode_block(DAMAGES[message](block()))


def test_an_illegal_control_word_makes_an_illegal_block():
    with pytest.raises(InputError, match=r"^control word 000000: bits 20-23"):
        decode_block(put(block(), 0, 0))


REFUSED = {
    "output block: angles: shape = (5,); must be (6,)": {"angles": np.zeros(5)},
    "output block: normals: shape = (3,); must be (3, 3)": {"normals": np.zeros(3)},
    "output block: distances: shape = (2,); must be (3,)": {"distances": np.zeros(2)},
    "output block: P0 = nan rad; must be finite": {"angles": [0, np.nan, 0, 0, 0, 0]},
    "output block: R2 = inf rad; must be finite": {"angles": [0, 0, 0, 0, 0, np.inf]},
    "output block: plane 1: length of the normal = 1.1": {"normals": 1.1 * NORMALS},
    "output block: plane 1: length of the normal = nan": {"normals": np.nan * NORMALS},
    "output block: plane 1: length of the normal = 0;": {"normals": np.zeros((3, 3))},
    "plane's distance, ft = 2132.55; must be within -2048 ..": {"distances": [0.0, 650.0, 0.0]},
    "plane's distance, ft = nan; must be within -2048 ..": {"distances": [0.0, np.nan, 0.0]},
}


@pytest.mark.parametrize("message", REFUSED)
def test_what_no_block_holds_is_refused(message):
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        block(**REFUSED[message])
