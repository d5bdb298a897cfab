"""One look for all figures: style, colours, panels over a common x axis, PNG files.

Matplotlib's object-oriented interface only: no figure is registered anywhere, and nothing of the
caller's own settings changes. Figures are `WIDTH` inches wide with text that is legible when the
picture is shown 1000 pixels wide.
"""

from __future__ import annotations

import contextlib
import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.twin.output_folder import write_whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Width of a figure, in.
WIDTH = 10.0
#: Pixels per inch of the files.
DPI = 150
#: Okabe and Ito's colours, which differ for colour-blind eyes too; yellow is left out, being too
#: pale for lines.
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
#: Of limits and thresholds, and of what is worth a look.
LIMIT_COLOR = "#B22222"
MUTED_COLOR = "#6E6E6E"

_MARK_SIZE = 8.5
_STYLE: Any = {
    "font.family": "DejaVu Sans",  # comes with matplotlib, so that figures agree everywhere
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
    "axes.labelsize": 9.0,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.unicode_minus": True,
    "axes.formatter.useoffset": False,
    "axes.xmargin": 0.01,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.6,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "legend.handlelength": 1.5,
    "lines.linewidth": 1.4,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "figure.titlesize": 11.0,
    "figure.titleweight": "bold",
    "path.simplify": True,
}


@dataclass(frozen=True, kw_only=True)
class Line:
    """A line of a panel.

    Attributes:
        x, y: (N,), in the units of the axes' labels; NaN leaves a gap.
        label: for the legend; empty for none.
        color, style, width, marker: matplotlib's; by default the next colour, solid, no marker.
        steps: draw y as steps that change midway between samples.
    """

    x: ArrayLike
    y: ArrayLike
    label: str = ""
    color: str | None = None
    style: str = "-"
    width: float | None = None
    marker: str = ""
    steps: bool = False


@dataclass(frozen=True, kw_only=True)
class Limit:
    """A horizontal line that y should stay on one side of; `label` goes into the legend."""

    value: float
    label: str = ""


@dataclass(frozen=True, kw_only=True)
class Mark:
    """A point worth a look, with a text beside it."""

    x: float
    y: float
    text: str


@dataclass(frozen=True, kw_only=True)
class Panel:
    """One set of axes.

    Attributes:
        title, y_label: the label with its unit.
        lines, limits, marks: what is drawn.
        log: a logarithmic y axis.
        y_range: lower and upper end of the y axis; None leaves an end to the data.
        second_y: label of a second y axis on the right, and what y is multiplied with there.
        whole_y: only whole numbers on the y axis.
        long_legend: put the legend below the title, in rows of four; otherwise it stands in one row
            beside the title.
    """

    title: str
    y_label: str
    lines: Sequence[Line]
    limits: Sequence[Limit] = ()
    marks: Sequence[Mark] = ()
    log: bool = False
    y_range: tuple[float | None, float | None] = (None, None)
    second_y: tuple[str, float] | None = None
    whole_y: bool = False
    long_legend: bool = False


@contextlib.contextmanager
def figure_style() -> Iterator[None]:
    """Within it, what matplotlib makes and draws has our style."""
    import matplotlib as mpl
    from cycler import cycler

    with mpl.rc_context():
        mpl.rcdefaults()  # whatever a matplotlibrc of the user's says
        mpl.rcParams.update({**_STYLE, "axes.prop_cycle": cycler(color=COLORS)})
        yield


def new_figure(height: float, *, title: str = "") -> Figure:
    """An empty figure of our width and `height` in, laid out by constraints."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    if title:
        figure.suptitle(title, x=0.01, horizontalalignment="left")
    return figure


def time_series_figure(
    panels: Sequence[Panel],
    x_label: str,
    *,
    title: str = "",
    columns: int = 1,
    panel_height: float = 2.2,
    second_x: tuple[str, float] | None = None,
    by_column: bool = False,
) -> Figure:
    """Panels over a common x axis (time, or another), in a grid.

    Args:
        panels: in reading order, row by row.
        x_label: with its unit.
        title: of the whole figure.
        columns: of the grid.
        panel_height: in.
        second_x: label of a second x axis below the first, and what x is multiplied with there.
        by_column: fill the grid column by column instead.
    """
    with figure_style():
        rows = math.ceil(len(panels) / columns)
        figure = new_figure(
            rows * panel_height + 0.5 + 0.4 * (bool(title) + bool(second_x)), title=title
        )
        grid = figure.subplots(rows, columns, sharex=True, squeeze=False)
        cells = (grid.T if by_column else grid).ravel()
        for axes, panel in zip(cells, panels, strict=False):
            draw_panel(axes, panel)
        for axes in cells[len(panels) :]:
            axes.remove()
        for column in grid.T:
            drawn = [axes for axes in column if axes.figure is not None]
            if not drawn:
                continue
            drawn[-1].set_xlabel(x_label)
            drawn[-1].tick_params(labelbottom=True)
            if second_x is not None:
                add_second_axis(drawn[-1], "x", *second_x)
        figure.align_ylabels()
        figure.draw_without_rendering()  # lays out, so that marks know where there is room;
        figure.set_layout_engine("none")  # once is enough, and takes most of the time
        for axes, panel in zip(cells, panels, strict=False):
            for mark in panel.marks:
                add_mark(axes, mark)
        return figure


def draw_panel(axes: Axes, panel: Panel) -> None:
    """Draws a panel, except its marks, into axes (within `figure_style`)."""
    axes.set_title(panel.title)
    axes.set_ylabel(panel.y_label)
    for line in panel.lines:
        given: dict[str, Any] = {"color": line.color, "linewidth": line.width}
        axes.plot(
            np.asarray(line.x),
            np.asarray(line.y),
            label=line.label or None,
            linestyle=line.style,
            marker=line.marker or None,
            markersize=4.0,
            drawstyle="steps-mid" if line.steps else "default",
            **{name: value for name, value in given.items() if value is not None},
        )
    for limit in panel.limits:
        axes.axhline(
            limit.value, color=LIMIT_COLOR, linestyle="--", linewidth=1.0, label=limit.label or None
        )
    if panel.log:
        axes.set_yscale("log")
        axes.grid(True, which="major")
    elif panel.limits:
        axes.margins(y=0.08)
    if panel.whole_y:
        from matplotlib.ticker import MaxNLocator

        axes.yaxis.set_major_locator(MaxNLocator(integer=True, nbins=6))
    axes.set_ylim(*panel.y_range)
    if panel.second_y is not None:
        add_second_axis(axes, "y", *panel.second_y)
    count = len(axes.get_legend_handles_labels()[1])
    if count:
        # Outside the axes, where it can cover no data.
        place: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "ncols": count}
        if panel.long_legend:
            place = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "ncols": 4}
            axes.set_title(panel.title, pad=8.0 + 13.0 * max(2, math.ceil(count / 4)))
        axes.legend(borderaxespad=0.1, columnspacing=1.0, handletextpad=0.4, **place)


def add_mark(axes: Axes, mark: Mark) -> None:
    """A ring round a point, and its text near by where it covers the fewest lines.

    The figure must have been laid out.
    """
    drawn = _pixels_of_lines(axes)
    here = axes.transData.transform((mark.x, mark.y))
    pixels = DPI / 72.0  # a typographic point
    measured = axes.text(0.0, 0.0, mark.text, fontsize=_MARK_SIZE)
    extent = measured.get_window_extent()
    measured.remove()
    size = np.array([extent.width, extent.height])

    def cost(place: tuple[float, float]) -> float:
        """Points of lines under the text there; much more if it leaves the axes."""
        near_edge = here + pixels * np.array(place)
        corner = near_edge - np.array([0.0 if place[0] > 0.0 else size[0], 0.5 * size[1]])
        low, high = corner - 3.0 * pixels, corner + size + 3.0 * pixels
        inside = axes.bbox.contains(*low) and axes.bbox.contains(*high)
        covered = np.all((drawn >= low) & (drawn <= high), axis=1)
        return float(np.count_nonzero(covered)) + (0.0 if inside else 1e6)

    places = [
        (side * across, up)
        for across in (14.0, 40.0, 80.0)
        for up in (0.0, 18.0, -18.0, 36.0, -36.0, 60.0, -60.0)
        for side in (1.0, -1.0)
    ]
    place = min(places, key=cost)
    axes.plot(
        [mark.x], [mark.y], "o", markersize=7.0, markerfacecolor="none", color="black", zorder=5
    )
    axes.annotate(
        mark.text,
        xy=(mark.x, mark.y),
        textcoords="offset points",
        xytext=place,
        horizontalalignment="left" if place[0] > 0.0 else "right",
        verticalalignment="center",
        fontsize=_MARK_SIZE,
        arrowprops={"arrowstyle": "-", "linewidth": 0.6, "shrinkB": 4.0},
        bbox={
            "boxstyle": "round,pad=0.15",
            "facecolor": "white",
            "edgecolor": "none",
            "alpha": 0.8,
        },
        zorder=6,
    )


def _pixels_of_lines(axes: Axes) -> NDArray[np.float64]:
    """Points (N, 2) px along all lines in the axes, a few pixels apart."""
    points = [np.empty((0, 2))]
    for line in axes.get_lines():
        corners = line.get_transform().transform(line.get_xydata())
        corners = corners[np.all(np.isfinite(corners), axis=1)]
        if len(corners) < 2:
            continue
        travel = np.append(0.0, np.cumsum(np.hypot(*np.diff(corners, axis=0).T)))
        at = np.linspace(0.0, travel[-1], 2 + int(travel[-1] / 3.0))
        points.append(np.column_stack([np.interp(at, travel, column) for column in corners.T]))
    return np.concatenate(points)


def add_second_axis(axes: Axes, which: str, label: str, factor: float) -> None:
    """The same axis in another unit: below the first (`which` "x") or on the right ("y")."""
    there, back = (lambda value: value * factor), (lambda value: value / factor)
    if which == "x":
        axis = axes.secondary_xaxis("bottom", functions=(there, back))
        axis.spines["bottom"].set_position(("outward", 34.0))
        axis.set_xlabel(label)
    else:
        axis = axes.secondary_yaxis("right", functions=(there, back))
        axis.set_ylabel(label)


def where_least(values: NDArray[np.float64]) -> tuple[int, int] | None:
    """Row and column of the least value (N, K) that is a number; None if none is."""
    if values.size == 0 or np.isnan(values).all():
        return None
    row, column = np.unravel_index(np.nanargmin(values), values.shape)
    return int(row), int(column)


def save_figure(figure: Figure, file: Path) -> None:
    """Writes a figure as PNG: the same figure gives the same bytes."""
    data = io.BytesIO()
    with figure_style():
        # No date and no version of matplotlib among the metadata.
        figure.savefig(data, format="png", dpi=DPI, metadata={"Software": None})
    write_whole(file, data.getvalue())
