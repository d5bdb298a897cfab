"""A study's table: a row a case, whatever became of it."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pips_drake.twin.output_folder import write_whole
from pips_drake.twin.study.cases import Case, Outcome

#: Significant digits of numbers: more than any result has, fewer than roundings reach.
DIGITS = 10


def table_rows(
    cases: Sequence[Case], outcomes: Mapping[int, Outcome], columns: Sequence[str]
) -> list[dict[str, Any]]:
    """Rows by case number: what was varied, status, the columns, and why there are no numbers.

    Args:
        outcomes: by case number.
        columns: of the outcomes' numbers; None where a case has none.
    """
    rows = []
    for case in sorted(cases, key=lambda case: case.number):
        outcome = outcomes[case.number]
        numbers = {name: outcome.numbers.get(name) for name in columns}
        rows.append(
            {"case": case.number}
            | dict(case.values)
            | {"status": outcome.status}
            | numbers
            | {"reason": outcome.reason}
        )
    return rows


def write_table(file: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Writes rows as CSV: equal rows give equal bytes."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(rows[0])
    for row in rows:
        writer.writerow([_cell(value) for value in row.values()])
    write_whole(file, text.getvalue())


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:.{DIGITS}g}"
    return str(value)
