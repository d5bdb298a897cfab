"""Figures of a path and the arm on it (FTL-95 Figure D.2), and of where it cannot be followed."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike, NDArray

from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.twin.figures import (
    COLORS,
    LIMIT_COLOR,
    MUTED_COLOR,
    WIDTH,
    figure_style,
    new_figure,
    save_figure,
)
from pips_drake.units import INCH

Array = NDArray[np.float64]

# What the posture is called at which a path cannot be followed for the first time.
FAILING = "where it fails"


def path_figure(
    file: Path,
    arm: SerpentineArm,
    path_points: ArrayLike,
    postures: Mapping[str, ArrayLike],
    *,
    table_points: ArrayLike | None = None,
    failing_tip: ArrayLike | None = None,
    failing_posture: ArrayLike | None = None,
    title: str = "Path and postures",
) -> None:
    """Path and arm in views of frame {0}, after FTL-95 Figure D.2; inches, equal scales.

    The views stand as in a drawing: x0 over z0; beside it, seen along z0, x0 over y0; and where the
    path leaves that plane, below it, seen along x0, y0 over z0.

    Args:
        path_points: points along the path, (P, 3) m, dense enough to draw arcs.
        postures: joint values (joints,) m and rad by name, such as `home` and `end`.
        table_points: the points that the path was made of, (T, 3) m.
        failing_tip: where the tip stands (3,) m when the path cannot be followed for the first
            time; None: it can be followed.
        failing_posture: the arm there, joint values (joints,); NaN if it has no posture there.
    """
    path = np.asarray(path_points, dtype=np.float64) / INCH
    if failing_posture is not None:
        postures = {**postures, FAILING: failing_posture}
    spines = {
        name: kinematics.centre_line(arm, q)[0] / INCH
        for name, q in postures.items()
        if np.all(np.isfinite(np.asarray(q)))
    }
    table = np.empty((0, 3)) if table_points is None else np.asarray(table_points) / INCH
    tips = np.empty((0, 3)) if failing_tip is None else np.asarray(failing_tip)[None] / INCH
    everything = np.concatenate([path, table, tips, *spines.values()])
    low, high = everything.min(axis=0), everything.max(axis=0)
    size = float((high - low).max())
    aside = float(high[1] - low[1]) > 0.01 * size
    room = 0.04 * size
    low, high = low - room, high + room
    # The view along z0 is wide enough for its title.
    narrow = max(0.0, 0.2 * float(high[2] - low[2]) - float(high[1] - low[1]))
    low[1], high[1] = low[1] - 0.5 * narrow, high[1] + 0.5 * narrow
    width, depth, height = (float(high[axis] - low[axis]) for axis in (2, 1, 0))
    heights = [height, depth] if aside else [height]
    inches = (WIDTH - 1.6) * sum(heights) / (width + depth)
    with figure_style():
        # High enough that the width decides about the scale of all views: it is one.
        words = 1.7 + 0.9 * (len(heights) - 1)
        figure = new_figure(float(np.clip(inches, 2.0, 9.0)) + words, title=title)
        cells = figure.subplots(
            len(heights), 2, width_ratios=[width, depth], height_ratios=heights, squeeze=False
        )
        views = [
            (cells[0, 0], 2, 0, "seen along y0"),
            (cells[0, 1], 1, 0, "seen along z0"),
        ]
        if aside:
            views.append((cells[1, 0], 2, 1, "seen along x0"))
            cells[1, 1].remove()
        for axes, across, up, name in views:
            _draw_path_view(axes, across, up, path=path, table=table, tips=tips, spines=spines)
            axes.set_aspect("equal")
            axes.set_xlim(low[across], high[across])
            axes.set_ylim(low[up], high[up])
            axes.set_xlabel(f"{'xyz'[across]}0 (in)")
            axes.set_ylabel(f"{'xyz'[up]}0 (in)")
            axes.set_title(name)
        cells[0, 1].set_ylabel("")
        cells[0, 1].tick_params(labelleft=False)
        handles, labels = cells[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 4))
    save_figure(figure, file)


def failure_figure(
    file: Path,
    arm: SerpentineArm,
    path_points: ArrayLike,
    failing_tip: ArrayLike,
    failing_posture: ArrayLike,
    sentences: Sequence[str],
    *,
    table_points: ArrayLike | None = None,
) -> None:
    """The surroundings of the place where a path cannot be followed for the first time.

    Args:
        path_points: (P, 3) m, dense enough to draw what is within 20 in of that place.
        failing_tip: where the tip stands there, (3,) m.
        failing_posture: joint values (joints,) there, m and rad; NaN if the arm has no posture.
        sentences: what is wrong; the first ones stand above the views.
    """
    path = np.asarray(path_points, dtype=np.float64) / INCH
    table = np.empty((0, 3)) if table_points is None else np.asarray(table_points) / INCH
    tip = np.asarray(failing_tip, dtype=np.float64) / INCH
    spines = {}
    if np.all(np.isfinite(np.asarray(failing_posture))):
        spines[FAILING] = kinematics.centre_line(arm, failing_posture)[0] / INCH
    shown = [*sentences[:3]]
    if len(sentences) > 3:
        shown.append(f"(and {len(sentences) - 3} more, in summary.json)")
    said = "\n".join(textwrap.fill(sentence, 150) for sentence in shown)
    with figure_style():
        figure = new_figure(4.4 + 0.17 * said.count("\n"))
        cells = figure.subplots(1, 3)
        for axes, (across, up) in zip(cells, ((2, 0), (1, 0), (2, 1)), strict=True):
            _draw_path_view(axes, across, up, path=path, table=table, tips=tip[None], spines=spines)
            axes.set_aspect("equal")
            axes.set_xlim(tip[across] - 20.0, tip[across] + 20.0)
            axes.set_ylim(tip[up] - 20.0, tip[up] + 20.0)
            axes.set_xlabel(f"{'xyz'[across]}0 (in)")
            axes.set_ylabel(f"{'xyz'[up]}0 (in)")
            axes.set_title(f"seen along {'xyz'[3 - across - up]}0")
        handles, labels = cells[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
        figure.legend([], [], loc="outside upper left", title=said, title_fontsize="small")
    save_figure(figure, file)


def _draw_path_view(
    axes: Axes,
    across: int,
    up: int,
    *,
    path: Array,
    table: Array,
    tips: Array,
    spines: Mapping[str, Array],
) -> None:
    """One view of `path_figure`: coordinates `across` and `up` of points (N, 3) in."""
    axes.plot(
        path[:, across], path[:, up], color=MUTED_COLOR, linewidth=4.0, alpha=0.35, label="path"
    )
    if table.size:
        axes.plot(
            table[:, across],
            table[:, up],
            "o",
            color="black",
            markersize=3.5,
            markerfacecolor="white",
            label="table points",
            zorder=4,
        )
    for k, (name, spine) in enumerate(spines.items()):
        # Ever thinner, so that postures show under each other where they share the path.
        width = max(1.2, 3.4 - 1.1 * k)
        color = LIMIT_COLOR if name == FAILING else COLORS[k]
        axes.plot(spine[:, across], spine[:, up], label=name, linewidth=width, color=color)
        even = spine[1::2]  # spine points 4, 6, ...: the ones that follow the path
        axes.plot(even[:, across], even[:, up], ".", color=color, markersize=7.0)
    if tips.size:
        axes.plot(
            tips[:, across],
            tips[:, up],
            "X",
            color=LIMIT_COLOR,
            markeredgecolor="white",
            markersize=11.0,
            label="cannot be followed from this tip on",
            zorder=6,
        )
