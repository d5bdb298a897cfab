"""Numbers as the computers of 1971 exchanged them: fixed point in words of 24 bits.

Bit 0 is the most significant one, as RMS-71 counts in its Table II. Table III names a scaling Bn:
after the sign (bit 0) come n bits of whole numbers and 23 - n of fractions, two's complement. B1
holds -2 <= x < 2 in steps of 2^-22, B11 holds -2048 <= x < 2048 in steps of 2^-12.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.config import require
from pips_drake.errors import InputError

Array = NDArray[np.float64]
Words = NDArray[np.int64]

#: Bits of a word.
WORD_BITS = 24
#: Words are smaller than this.
WORD_END = 1 << WORD_BITS


def step_of(integer_bits: int) -> float:
    """The last bit's worth under scaling B`integer_bits`; rounding errs by half of it at most."""
    return 2.0 ** (integer_bits - WORD_BITS + 1)


def to_words(values: ArrayLike, integer_bits: int, name: str = "number") -> Words:
    """Numbers in fixed point, each in one word of 24 bits, (...).

    Args:
        values: (...), in the unit that the word has.
        integer_bits: n of the scaling Bn, 0 .. 23.
        name: of the values, for the message.

    Raises:
        InputError: a value is not finite, or its nearest word is beyond the scaling's ends.
    """
    values = np.asarray(values, dtype=np.float64)
    steps = np.rint(values * (1.0 / step_of(integer_bits)))
    half = WORD_END // 2
    good = (steps >= -half) & (steps < half)  # neither holds for NaN
    if not good.all():
        worst = values[~good].flat[0]
        end = 2.0**integer_bits
        raise InputError(
            f"{name} = {worst:g}; must be within -{end:g} .. {end:g} (B{integer_bits})"
        )
    words: Words = steps.astype(np.int64) & (WORD_END - 1)
    return words


def from_words(words: ArrayLike, integer_bits: int) -> Array:
    """The numbers that words of 24 bits hold in fixed point, (...), exactly.

    Raises:
        InputError: more than 24 bits.
    """
    words = as_words(words)
    signed = words - ((words & (WORD_END // 2)) << 1)
    return signed * step_of(integer_bits)


def as_words(words: ArrayLike, name: str = "word") -> Words:
    """Words of 24 bits as integers, (...).

    They may come as floats: a port holds no other numbers, and 24 bits fit in one exactly.

    Raises:
        InputError: a word is no whole number, is negative, or has more than 24 bits.
    """
    given = np.asarray(words)
    require(given.dtype.kind in "iuf", name, words, "a whole number")
    good = (given >= 0) & (given < WORD_END)
    if given.dtype.kind == "f":
        good &= given == np.rint(given)
    if not good.all():
        wrong = given[~good].flat[0]
        raise InputError(f"{name} = {wrong}; must be a whole number of {WORD_BITS} bits, unsigned")
    whole: Words = given.astype(np.int64)
    return whole
