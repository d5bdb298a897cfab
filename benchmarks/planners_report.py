"""Table, listing and figure of what `benchmarks.planners` ran."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from pips_drake.twin.figures import COLORS, MUTED_COLOR

#: What is told of the runs that are certified: key, unit and what it is.
MEASURED = (
    ("total_s", "s", "time to the first certified motion"),
    ("tip_path_m", "m", "tip's way"),
    ("clearance_mm", "mm", "least clearance, proved"),
    ("largest_angle_deg", "deg", "largest joint angle"),
)


def groups(results: Sequence[dict[str, Any]]) -> dict[tuple[str, str], list[dict[str, Any]]]:
    """Runs by goal and planner, in the order in which they come."""
    found: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for one in results:
        found.setdefault((one["goal"], one["planner"]), []).append(one)
    return found


def sentence(one: dict[str, Any]) -> str:
    """One run."""
    text = f"{one['goal']}, {one['planner']}, seed {one['seed']}: "
    if one.get("error"):
        return text + "error: " + one["error"].strip().splitlines()[-1]
    if not one["certified"]:
        tried = one.get("motions", 0)
        return f"{text}no certified motion in {one['total_s']:.1f} s ({tried} tried)"
    return text + ", ".join(f"{one[key]:.3g} {unit}" for key, unit, _ in MEASURED)


def table(results: Sequence[dict[str, Any]]) -> str:
    """Medians of the certified runs, with the least and the most, Markdown."""
    head = ["goal", "planner", "certified", *(f"{what}, {unit}" for _, unit, what in MEASURED)]
    lines = [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
    for (goal, planner), runs in groups(results).items():
        good = [one for one in runs if one["certified"]]
        row = [goal, planner, f"{len(good)} of {len(runs)}"]
        for key, _, _ in MEASURED:
            values = [one[key] for one in good]
            row.append(_spread(values) if values else "")
        lines.append(f"| {' | '.join(row)} |")
    return "\n".join(lines)


def listing(results: Sequence[dict[str, Any]], columns: Sequence[str]) -> str:
    """Every run as a line of CSV."""
    out = io.StringIO()
    writer = csv.DictWriter(out, columns, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    for one in results:
        rounded = {key: _short(value) for key, value in one.items()}
        writer.writerow(rounded)
    return out.getvalue()


def draw(results: Sequence[dict[str, Any]], file: Path) -> None:
    """Every run as a mark, a panel a quantity; runs without a certified motion stand apart."""
    runs_of = groups(results)
    names = [f"{planner}, {goal}" for goal, planner in runs_of]
    figure = Figure(figsize=(11.0, 1.6 + 0.42 * len(names)), dpi=150, layout="constrained")
    panels = figure.subplots(1, len(MEASURED), sharey=True)
    planners = list(dict.fromkeys(planner for _, planner in runs_of))
    for axes, (key, unit, what) in zip(panels, MEASURED, strict=True):
        for row, ((_, planner), runs) in enumerate(runs_of.items()):
            place = row + np.linspace(-0.25, 0.25, max(2, len(runs)))[: len(runs)]
            color = COLORS[planners.index(planner)]
            for y, one in zip(place, runs, strict=True):
                if one["certified"]:
                    axes.plot(one[key], y, "o", color=color, ms=4.0, mew=0.0, alpha=0.7)
                elif key == "total_s":
                    axes.plot(one.get("total_s", 0.0), y, "x", color=MUTED_COLOR, ms=4.0)
        if key == "total_s":
            axes.set_xscale("log")
            axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axes.xaxis.set_major_formatter("{x:g}")
            axes.xaxis.set_minor_formatter("")
        else:
            axes.set_xlim(left=0.0)
        axes.set_xlabel(f"{what}, {unit}", fontsize=8.0)
        axes.tick_params(labelsize=7.5)
        axes.spines[["top", "right"]].set_visible(False)
    panels[0].set_yticks(range(len(names)), names)
    panels[0].set_ylim(len(names) - 0.5, -0.5)
    figure.suptitle("Each run a dot; a cross: no certified motion in the time", fontsize=9.0)
    figure.savefig(file, metadata={"Software": None})


def _spread(values: Sequence[float]) -> str:
    """Median, and least to most."""
    return f"{np.median(values):.3g} ({min(values):.3g} .. {max(values):.3g})"


def _short(value: Any) -> Any:
    return f"{value:.5g}" if isinstance(value, float) else value
