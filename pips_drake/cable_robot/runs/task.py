"""What a task gives: numbers, failures, and what stands on the summary sheet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from pips_drake.twin.sheet import SheetPicture, SheetRow


@dataclass(frozen=True, kw_only=True)
class TaskResult:
    """The result of a scenario's task.

    Attributes:
        numbers: for `summary.json`.
        failures: sentences; empty if everything was passed.
        lead: one line for the sheet.
        rows, pictures: of the sheet; the first picture is the large one.
    """

    numbers: Mapping[str, Any]
    failures: Sequence[str]
    lead: str
    rows: Sequence[SheetRow] = field(default_factory=list)
    pictures: Sequence[SheetPicture] = field(default_factory=list)
