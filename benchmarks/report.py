"""Tables, JSON and the figure of what was measured."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.measuring import Array, Line
from pips_drake.twin.figures import COLORS, LIMIT_COLOR, MUTED_COLOR

#: Marks in a document around the part that is measured.
BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"
_HEADER = ("What", "Ours", "Beside", "Theirs", "Our speed is", "Aim", "Met", "What limits it")


def markdown(lines: Sequence[Line], machine: Mapping[str, str]) -> str:
    """Machine, table, agreement and breakdowns."""
    versions = ", ".join(f"{name} {version}" for name, version in list(machine.items())[4:])
    text = [
        f"{machine['date']}: {machine['processor']}, {machine['cores']} cores, "
        f"{machine['system']}; {versions}.",
        "",
        *_table(_HEADER, [_row(line) for line in lines]),
        "",
        "Medians, with the middle half of the rounds in brackets. A ratio is the median of the "
        "rounds' own ratios.",
    ]
    for line in lines:
        if line.parts:
            text += ["", f"{line.what}, ms of processor time a simulated second:", ""]
            total = sum(line.parts.values())
            rows = [(name, f"{ms:.1f}", f"{100 * ms / total:.0f} %") for name, ms in _by_size(line)]
            text += _table(("Part", "ms", "of all"), rows)
    agreeing = [line for line in lines if line.agreement]
    if agreeing:
        text += ["", "How far the answers are apart:", ""]
        rows = [
            (
                f"{line.what}; {line.beside}",
                ", ".join(f"{name} {value:.3g}" for name, value in line.agreement.items()),
            )
            for line in agreeing
        ]
        text += _table(("Comparison", "Found"), rows)
    return "\n".join(text) + "\n"


def to_json(lines: Sequence[Line], machine: Mapping[str, str]) -> str:
    """Everything measured, each round of it."""
    content = {"machine": dict(machine), "lines": [_plain(line) for line in lines]}
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def put_into(document: str, table: str) -> str:
    """A document with the part between its two marks replaced by the table.

    Raises:
        ValueError: the document lacks a mark.
    """
    before, begin, rest = document.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise ValueError(f"no '{BEGIN}' with '{END}' behind it")
    return f"{before}{BEGIN}\n\n{table}\n{END}{after}"


def draw(lines: Sequence[Line], machine: Mapping[str, str], file: Path) -> None:
    """Bars of our speed over the peer's, from 1 on, with the aims as marks."""
    shown = [line for line in lines if line.ratio is not None][::-1]
    figure = Figure(figsize=(10.0, 1.1 + 0.5 * len(shown)), dpi=150, layout="constrained")
    axes = figure.subplots()
    end = 8.0 * max([2.0, *(max(line.ratio or 1.0, line.ratio_aim or 1.0) for line in shown)])
    for i, line in enumerate(shown):
        ratio = float(line.ratio or np.nan)
        missed = line.ratio_aim is not None and ratio < line.ratio_aim
        color = COLORS[4] if missed else COLORS[0]
        axes.barh(i, ratio - 1.0, left=1.0, height=0.55, color=color)
        axes.text(0.95 * end, i, f"{_digits(ratio)} times", va="center", ha="right", fontsize=8.5)
        if line.ratio_aim is not None:
            axes.plot([line.ratio_aim] * 2, [i - 0.38, i + 0.38], color=LIMIT_COLOR, lw=2.0)
    axes.axvline(1.0, color=MUTED_COLOR, lw=1.0)
    axes.set_xscale("log")
    axes.set_xlim(0.5 * min([0.5, *(line.ratio or 1.0 for line in shown)]), end)
    axes.xaxis.set_major_formatter("{x:g}")
    names = [f"{line.what}\nbeside {line.beside}" for line in shown]
    axes.set_yticks(range(len(shown)), names, fontsize=7.5)
    axes.set_xlabel("our speed over theirs (red mark: aim; orange bar: missed)")
    axes.set_title(f"{machine['date']}, {machine['processor']}", loc="right", fontsize=8.0)
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(file, metadata={"Software": None})


def _row(line: Line) -> tuple[str, ...]:
    met = ", ".join("yes" if good else "**no**" for good in line.aims.values())
    ratio = "" if line.ratio is None else f"{_spread(line.ratios)} times theirs"
    theirs = f"{_spread(line.peer)} {line.unit}" if line.peer.size else ""
    ours = f"{_spread(line.ours)} {line.unit}"
    return line.what, ours, line.beside, theirs, ratio, ", ".join(line.aims), met, line.limits


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    cells = [header, ["---"] * len(header), *rows]
    return ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in cells]


def _by_size(line: Line) -> list[tuple[str, float]]:
    return sorted(line.parts.items(), key=lambda part: -part[1])


def _spread(values: Array) -> str:
    """The median, and where the middle half lies."""
    low, middle, high = (_digits(value) for value in np.percentile(values, [25, 50, 75]))
    return f"{middle} ({low} .. {high})"


def _digits(value: float) -> str:
    """Three digits, and no exponent."""
    if value >= 100.0:
        return f"{value:,.0f}"
    return f"{value:.3g}"


def _plain(line: Line) -> dict[str, Any]:
    return {
        "name": line.name,
        "what": line.what,
        "beside": line.beside,
        "unit": line.unit,
        "ours": line.ours.tolist(),
        "peer": line.peer.tolist(),
        "ours_median": float(np.median(line.ours)),
        "peer_median": float(np.median(line.peer)) if line.peer.size else None,
        "ratio": line.ratio,
        "ratio_aim": line.ratio_aim,
        "value_aim": line.value_aim,
        "aims": line.aims,
        "limits": line.limits,
        "agreement": dict(line.agreement),
        "parts": dict(line.parts),
    }
