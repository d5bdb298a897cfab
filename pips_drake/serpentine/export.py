"""The formats that an arm can be exported in, by name and by a file's suffix."""

from __future__ import annotations

from enum import Enum
from pathlib import Path

from pips_drake.errors import InputError, UnknownNameError
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.mjcf import make_mjcf
from pips_drake.serpentine.sdf import make_sdf
from pips_drake.serpentine.urdf import make_urdf


class Format(Enum):
    """A format; its value is what its files end in."""

    SDF = ".sdf"
    URDF = ".urdf"
    MJCF = ".xml"

    @property
    def word(self) -> str:
        """As the command line calls it."""
        return self.name.lower()


def choose_format(word: str | None, file: Path | None) -> Format:
    """The format of a word (`sdf`, `urdf`, `mjcf`), else of a file's suffix, else SDF.

    Raises:
        InputError: no such word; without one, a suffix of no format; or the two disagree.
    """
    suffix = file.suffix.lower() if file is not None and not file.is_dir() else ""
    by_suffix = {format.value: format for format in Format}.get(suffix)
    if word is None:
        if suffix and by_suffix is None:
            known = ", ".join(format.value for format in Format)
            raise InputError(f"{file}: must end in one of {known}, or --format say which")
        return by_suffix or Format.SDF
    by_word = {format.word: format for format in Format}
    if word not in by_word:
        raise UnknownNameError("format", word, list(by_word))
    if by_suffix not in (None, by_word[word]):
        raise InputError(f"{file}: is not how {word} files end ({by_word[word].value})")
    return by_word[word]


def make_export(arm: SerpentineArm, format: Format, *, mounting: str | None = None) -> str:
    """The text of an arm in a format.

    Args:
        mounting: how the arm's base stands in the world, in MJCF alone; `laboratory` by default.

    Raises:
        InputError: no such mounting, or one where the format has none.
    """
    if format is Format.MJCF:
        return make_mjcf(arm, mounting or "laboratory")
    if mounting is not None:
        raise InputError(
            f"--mounting {mounting}: is for mjcf alone; whoever loads {format.word} says where the "
            "arm stands"
        )
    return make_sdf(arm) if format is Format.SDF else make_urdf(arm)
