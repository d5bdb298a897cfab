"""The answer of a command: passed or not, why, and the numbers behind it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What `pips follow`, `pips check` and `pips simulate` return.

    Attributes:
        failures: sentences; empty if and only if everything was passed.
        summary: what `summary.json` holds.
        folder: where the results are; None when nothing was written.
    """

    failures: tuple[str, ...]
    summary: Mapping[str, Any] = field(repr=False)
    folder: Path | None = None

    @property
    def passed(self) -> bool:
        """Whether nothing failed."""
        return not self.failures

    @property
    def word(self) -> str:
        """`pass` or `fail`."""
        return "pass" if self.passed else "fail"
