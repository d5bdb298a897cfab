"""Exceptions of the package.

Every error that a user can cause is a `PipsError`: its message names the object, the value, the
unit and what is allowed, and its attributes keep the data. `InputError` means that nothing could
be computed (exit code 2 at the command line); `NotFollowableError` means that the input was read
and understood, and the answer is no (exit code 1).
"""

from __future__ import annotations

import difflib
from collections.abc import Sequence

#: Longer texts are cut short where a message quotes them.
LONGEST_QUOTE = 100
#: So are lists of what there is.
LONGEST_LIST = 400


class PipsError(Exception):
    """Base class of all errors raised on purpose."""


class InputError(PipsError):
    """The input cannot be used: a missing file, a wrong unit, a value out of range."""


class UnknownNameError(InputError):
    """A name that is not in its list.

    Attributes:
        kind: what was looked up, for example ``"arm"``.
        name: the name that was asked for.
        known: the names that exist.
    """

    def __init__(self, kind: str, name: str, known: Sequence[str]) -> None:
        self.kind = kind
        self.name = name
        self.known = sorted(known)
        shown = shorten(name)
        close = difflib.get_close_matches(shown, self.known, n=1)
        hint = f" (did you mean '{close[0]}'?)" if close else ""
        listed = shorten(", ".join(self.known), LONGEST_LIST) or "none"
        super().__init__(f"unknown {kind} '{shown}'{hint}; known: {listed}")


def shorten(text: str, longest: int = LONGEST_QUOTE) -> str:
    """The text, cut to what a message can quote."""
    return text if len(text) <= longest else text[: longest - 3] + "..."


class NotFollowableError(PipsError):
    """The arm cannot follow the path, or is asked for a posture it does not have.

    Attributes:
        tip_arc_length: where on the path the tip stands, m from the path's start; None if the
            failure belongs to no tip position.
    """

    def __init__(self, message: str, tip_arc_length: float | None = None) -> None:
        self.tip_arc_length = tip_arc_length
        super().__init__(message)
