"""A study's figure: numbers over what was varied first, a line for each of the rest."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pips_drake.twin.figures import COLORS, Limit, Line, Panel, save_figure, time_series_figure

#: With more lines nobody can tell them apart.
MOST_LINES = len(COLORS)
_STYLES = ("-", "--", ":", "-.")


def study_figure(
    file: Path,
    rows: Sequence[Mapping[str, Any]],
    *,
    x: str,
    others: Sequence[str],
    columns: Mapping[str, tuple[str, str, float]],
    title: str,
    limits: Mapping[str, float] | None = None,
) -> None:
    """Draws a panel a column over `x`; rows without the number leave a gap.

    A column in which all rows are alike has no panel.

    Args:
        rows: the table's.
        x: what was varied, numbers or words; words stand in the table's order.
        others: what else was varied: a line for each combination, up to `MOST_LINES`.
        columns: the panel's title, unit and factor by column name.
        limits: by column, where a limit is, in the table's unit.
    """
    limits = limits or {}
    groups: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault(tuple(row[name] for name in others), []).append(row)
    drawn = dict(itertools.islice(groups.items(), MOST_LINES))
    words = list(dict.fromkeys(row[x] for row in rows if isinstance(row[x], str)))
    panels: list[Panel] = []
    for column, (name, unit, factor) in columns.items():
        if len({row.get(column) for row in rows}) < 2 and len(rows) > 1:
            continue
        lines = []
        for index, (values, members) in enumerate(drawn.items()):
            label = ", ".join(
                f"{_short(other)} {_word(value)}"
                for other, value in zip(others, values, strict=True)
            )
            points = [(_place(row[x], words), row.get(column)) for row in members]
            if not words:
                points.sort(key=lambda point: float(point[0]))
            lines.append(
                Line(
                    x=[place for place, _ in points],
                    y=[float("nan") if y is None else float(y) * factor for _, y in points],
                    label=label if not panels else "",
                    color=COLORS[index],
                    style=_STYLES[index % len(_STYLES)],
                    marker="o",
                )
            )
        panels.append(
            Panel(
                title=name,
                y_label=unit,
                lines=lines,
                limits=[Limit(value=limits[column] * factor)] if column in limits else [],
                long_legend=True,
            )
        )
    x_label = x if not words else f"{x}: " + ", ".join(f"{i} {w}" for i, w in enumerate(words))
    if not panels:  # nothing could be computed; the table says why
        return
    figure = time_series_figure(panels, x_label, title=title, columns=2, panel_height=2.0)
    save_figure(figure, file)


def _place(value: Any, words: Sequence[str]) -> float:
    return float(words.index(value)) if isinstance(value, str) else float(value)


def _short(field: str) -> str:
    return field.rpartition(".")[2].replace("_", " ")


def _word(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float | int) else str(value)
