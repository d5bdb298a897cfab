"""A survey drawn: maps of the panels, errors of places, recall by size."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pips_drake.twin.figures import COLORS, LIMIT_COLOR, MUTED_COLOR, figure_style, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pips_drake.cable_robot.defect_map import Finding
    from pips_drake.cable_robot.runs.survey import Survey, SurveyRun
    from pips_drake.cable_robot.survey_comparison import SurveyComparison

_MARKERS = {"scratch": "_", "ding": "o", "debris": "D"}


def map_figure(survey: Survey, comparison: SurveyComparison | None, *, title: str) -> Figure:
    """The panels unrolled as a person over the bay sees them: forward left, port above.

    Findings by kind and size; with a comparison new ones and grown ones in colour, gone ones
    crossed. Missed defects are rings with their size.
    """
    panels = {panel.name: panel for panel in survey.raster.panels}
    sides = [side for side in ("port", "starboard") if any(n.startswith(side) for n in panels)]
    columns = sorted({panel.number for panel in panels.values()})
    new = {f.name for f in comparison.new} if comparison else set()
    grown = {late.name for _, late in comparison.grown} if comparison else set()
    with figure_style():
        figure = new_figure(1.3 + 7.0 * len(sides) / max(len(columns), 2), title=title)
        grid = figure.subplots(len(sides), len(columns), squeeze=False)
        for side, row in zip(sides, grid, strict=True):
            for axes, number in zip(row, columns, strict=True):
                name = f"{side}_{number}"
                if name not in panels:
                    axes.set_axis_off()
                    continue
                panel = panels[name]
                for finding in (f for f in survey.findings if f.panel == name):
                    color = COLORS[0]
                    if finding.name in new:
                        color = LIMIT_COLOR
                    elif finding.name in grown:
                        color = COLORS[4]
                    _draw(axes, finding, color)
                for finding in comparison.gone if comparison else ():
                    if finding.panel == name:
                        axes.plot(finding.u, finding.v, "x", color=MUTED_COLOR, markersize=7.0)
                for defect in survey.check.missed:
                    if defect.panel == name:
                        axes.plot(
                            defect.u, defect.v, "o", color="black", markersize=11.0,
                            markerfacecolor="none",
                        )  # fmt: skip
                        axes.annotate(
                            f"{1e3 * defect.size_m:.1f} mm", (defect.u, defect.v),
                            textcoords="offset points", xytext=(8.0, 3.0), fontsize=7.0,
                        )  # fmt: skip
                axes.set_xlim(0.0, panel.length)
                # The hinge is in the middle of the page, between the sides.
                axes.set_ylim(*((0.0, panel.width) if side == "port" else (panel.width, 0.0)))
                axes.set_aspect("equal")
                share = 100.0 * survey.coverage[name]
                axes.set_title(f"{name.replace('_', ' ')}, {share:.1f} % seen")
                if axes is row[0]:
                    axes.set_ylabel("v from the hinge (m)")
                if side == sides[-1]:
                    axes.set_xlabel("u aft (m)")
        _legend(figure, comparison is not None, bool(survey.check.missed))
    return figure


def _draw(axes, finding: Finding, color: str) -> None:  # type: ignore[no-untyped-def]
    size = min(3.0 + 0.25 * 1e3 * finding.size_m, 30.0)
    axes.plot(
        finding.u, finding.v, _MARKERS[finding.kind], color=color, markersize=size,
        markerfacecolor="none", markeredgewidth=1.4, clip_on=False,
    )  # fmt: skip


def _legend(figure: Figure, compared: bool, missed: bool) -> None:
    from matplotlib.lines import Line2D

    def entry(marker: str, color: str, label: str) -> Line2D:
        return Line2D([], [], linestyle="", marker=marker, color=color, label=label,
                      markerfacecolor="none", markeredgewidth=1.4)  # fmt: skip

    handles = [entry(marker, COLORS[0], kind) for kind, marker in _MARKERS.items()]
    if compared:
        handles += [
            entry("s", LIMIT_COLOR, "new"),
            entry("s", COLORS[4], "grown"),
            entry("x", MUTED_COLOR, "gone"),
        ]
    if missed:
        handles.append(entry("o", "black", "missed (ringed, true size)"))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))


def places_figure(run: SurveyRun) -> Figure:
    """Errors of places of both maps, in u and v, within the circle that was predicted."""
    with figure_style():
        figure = new_figure(4.6, title="Where findings are, less where their defects are")
        grid = figure.subplots(1, len(run.surveys), squeeze=False)[0]
        for axes, survey, words in zip(grid, run.surveys, ("before", "after"), strict=False):
            offsets = 1e3 * survey.check.offsets
            radius = 1e3 * survey.tolerance
            around = np.linspace(0.0, 2.0 * np.pi, 200)
            axes.plot(radius * np.cos(around), radius * np.sin(around), "--", color=LIMIT_COLOR,
                      linewidth=1.0, label=f"predicted at most, {radius:.1f} mm")  # fmt: skip
            axes.plot(offsets[:, 0], offsets[:, 1], "o", color=COLORS[0], markersize=4.0,
                      markerfacecolor="none", label=f"{len(offsets)} findings")  # fmt: skip
            axes.set_aspect("equal")
            axes.set_title(f"{words} the mission")
            axes.set_xlabel("along u (mm)")
            axes.set_ylabel("along v (mm)")
            axes.legend(loc="upper right")
    return figure


def recall_figure(run: SurveyRun) -> Figure:
    """Found, missed and false alarms of all surveys together, by class of size."""
    classes = [survey.check.classes for survey in run.surveys]
    found = [sum(c.found for c in same) for same in zip(*classes, strict=True)]
    there = [sum(c.defects for c in same) for same in zip(*classes, strict=True)]
    false = [sum(c.false_alarms for c in same) for same in zip(*classes, strict=True)]
    labels = [
        f"{1e3 * c.low:g} .. {1e3 * c.high:g}" if np.isfinite(c.high) else f">= {1e3 * c.low:g}"
        for c in classes[0]
    ]
    places = np.arange(len(labels))
    with figure_style():
        figure = new_figure(4.0, title="Found and missed, by size")
        axes = figure.subplots()
        axes.bar(places - 0.2, found, 0.4, color=COLORS[2], label="found")
        missed = np.subtract(there, found)
        axes.bar(places - 0.2, missed, 0.4, bottom=found, color=LIMIT_COLOR, label="missed")
        axes.bar(places + 0.2, false, 0.4, color=MUTED_COLOR, label="false alarms")
        for place, good, total in zip(places, found, there, strict=True):
            if total:
                axes.text(place - 0.2, total, f"{good} of {total}", ha="center", va="bottom",
                          fontsize=8.0)  # fmt: skip
        axes.set_xticks(places, labels)
        axes.set_xlabel("longest extent (mm); of false alarms as measured")
        axes.set_ylabel("number, all surveys")
        axes.legend(loc="upper left")
    return figure
