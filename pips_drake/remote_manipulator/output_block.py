"""The output block: what the collision program sends to the scene program in every frame.

RMS-71, section IV.C (XMITESG): 32 words of 24 bits. The order within its parts is assumed.

     0       the control word
     1 .. 12 sine and cosine of H0, then of P0, P1, H2, P2 and R2
    13 .. 24 three separating planes: x, y and z of the unit normal, then the distance
    25 .. 31 blank: 0

A plane is A x + B y + C z - D = 0 in {R}, with D the perpendicular distance to the origin in ft.
Scaling of the fixed point, in Table III's words (assumed for this block; the table has B11 for
positions): B1 for sines, cosines and normals, B11 for distances.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.config import require
from pips_drake.errors import InputError
from pips_drake.remote_manipulator.configuration import JOINTS
from pips_drake.remote_manipulator.control_word import ControlWord, decode, encode
from pips_drake.remote_manipulator.words import Words, as_words, from_words, step_of, to_words
from pips_drake.units import FOOT

Array = NDArray[np.float64]

#: Words of a block.
BLOCK_WORDS = 32
#: Separating planes in it.
PLANES = 3
#: Scaling of sines, cosines and normals, and of distances in ft.
UNIT_SCALING, DISTANCE_SCALING = 1, 11
#: How much the square of a unit vector may differ from 1 after rounding. Each component errs by h,
#: half of a step; the square by 2 h (|a| + |b| + |c|) + 3 h^2 < 4 h, as the sum is sqrt(3) at most.
SQUARE_TOLERANCE = 4.0 * 0.5 * step_of(UNIT_SCALING)
#: How much the square of a normal may differ from 1 before rounding.
_UNIT = 1e-9

_ANGLES, _PLANES = slice(1, 13), slice(13, 25)
_FIRST_BLANK = 25


@dataclass(frozen=True, kw_only=True, eq=False)
class OutputBlock:
    """What a block says.

    Attributes:
        word: the control word.
        sines, cosines: of the six angles H0 P0 P1 H2 P2 R2, (6,) each.
        normals: of the separating planes, (3, 3), unit vectors in {R}.
        distances: of the separating planes from {R}'s origin along their normals, (3,) m.
    """

    word: ControlWord
    sines: Array
    cosines: Array
    normals: Array
    distances: Array

    @property
    def angles(self) -> Array:
        """The six angles, (6,) rad, within +-pi: a block does not know whole turns."""
        angles: Array = np.arctan2(self.sines, self.cosines)
        return angles


def encode_block(
    word: ControlWord, angles: ArrayLike, normals: ArrayLike, distances: ArrayLike
) -> Words:
    """The words of a block, (32,).

    Args:
        angles: H0 P0 P1 H2 P2 R2, (6,) rad.
        normals: of the three separating planes, (3, 3), unit vectors in {R}.
        distances: of the planes from {R}'s origin along their normals, (3,) m.

    Raises:
        InputError: a number is not finite, a normal is no unit vector, or a distance is beyond what
            a word holds.
    """
    angles = np.asarray(angles, dtype=np.float64)
    normals = np.asarray(normals, dtype=np.float64)
    distances = np.asarray(distances, dtype=np.float64)
    require(angles.shape == (6,), "output block: angles: shape", angles.shape, "(6,)")
    require(normals.shape == (3, 3), "output block: normals: shape", normals.shape, "(3, 3)")
    require(distances.shape == (3,), "output block: distances: shape", distances.shape, "(3,)")
    if not np.isfinite(angles).all():
        joint = int(np.flatnonzero(~np.isfinite(angles))[0])
        raise InputError(f"output block: {JOINTS[joint]} = {angles[joint]} rad; must be finite")
    block = np.zeros(BLOCK_WORDS, dtype=np.int64)
    block[0] = encode(word)
    _require_units(normals, _UNIT)
    units = np.empty(21)
    units[0:12:2], units[1:12:2], units[12:] = np.sin(angles), np.cos(angles), normals.ravel()
    words = to_words(units, UNIT_SCALING)
    block[_ANGLES] = words[:12]
    planes = block[_PLANES].reshape(PLANES, 4)
    planes[:, :3] = words[12:].reshape(PLANES, 3)
    planes[:, 3] = to_words(distances * (1.0 / FOOT), DISTANCE_SCALING, "plane's distance, ft")
    return block


def decode_block(block: ArrayLike) -> OutputBlock:
    """What a block of 32 words says.

    Raises:
        InputError: not 32 words of 24 bits, an illegal control word, a blank word that is not 0, or
            a pair of sine and cosine or a normal that is no unit vector.
    """
    words = as_words(block, "output block: word")
    require(words.shape == (BLOCK_WORDS,), "output block: shape", words.shape, "(32,)")
    word = decode(int(words[0]))
    for blank in np.flatnonzero(words[_FIRST_BLANK:])[:1] + _FIRST_BLANK:
        raise InputError(f"output block: word {blank} = {words[blank]:06X}; must be blank, 0")
    pairs = from_words(words[_ANGLES], UNIT_SCALING).reshape(6, 2)
    planes = words[_PLANES].reshape(PLANES, 4)
    normals = from_words(planes[:, :3], UNIT_SCALING)
    excess = np.sum(pairs * pairs, axis=1) - 1.0
    for joint in np.flatnonzero(np.abs(excess) > SQUARE_TOLERANCE)[:1]:
        name = f"output block: {JOINTS[joint]}: sin^2 + cos^2"
        raise InputError(f"{name} = {1.0 + excess[joint]:.9g}; must be 1 within rounding")
    _require_units(normals, SQUARE_TOLERANCE)
    return OutputBlock(
        word=word,
        sines=pairs[:, 0],
        cosines=pairs[:, 1],
        normals=normals,
        distances=from_words(planes[:, 3], DISTANCE_SCALING) * FOOT,
    )


def _require_units(normals: Array, tolerance: float) -> None:
    squares = np.sum(normals * normals, axis=1)
    good = np.abs(squares - 1.0) <= tolerance
    for plane in np.flatnonzero(~good)[:1]:
        length = float(np.sqrt(squares[plane]))
        name = f"output block: plane {plane + 1}: length of the normal"
        raise InputError(f"{name} = {length:.9g}; must be 1")
