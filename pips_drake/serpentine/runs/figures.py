"""Figures of a serpentine arm, after FTL-95's Figures D.2 to D.4 and beyond them.

Each function takes plain arrays in SI units and writes one PNG. Nothing here computes: what a
figure says is what its arguments say.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
    Limit,
    Line,
    Mark,
    Panel,
    figure_style,
    new_figure,
    save_figure,
    time_series_figure,
    where_least,
)
from pips_drake.twin.run_figures import clearance_figure, tracking_figure
from pips_drake.units import DEGREE, INCH

__all__ = [
    "XAxis",
    "actuators_figure",
    "clearance_figure",
    "failure_figure",
    "iterations_figure",
    "joint_values_figure",
    "path_figure",
    "symbol",
    "time_axis",
    "tip_travel",
    "tracking_figure",
]

Array = NDArray[np.float64]

# Spine errors are drawn down to this part of the tolerance.
_DECADES = 1e-4
# What the posture is called at which a path cannot be followed for the first time.
FAILING = "where it fails"
# Follow-the-leader leaves the last joint at zero. It gets a panel only if it moves more than this,
# rad: a simulated one always quivers.
_STILL = 0.1 * DEGREE


@dataclass(frozen=True, kw_only=True)
class XAxis:
    """What the samples are listed by. Make one with `tip_travel` or `time_axis`.

    Attributes:
        values: (N,), in the label's unit.
        label: with its unit.
        second: label of a second axis and what the values are multiplied with there.
    """

    values: Array
    label: str
    second: tuple[str, float] | None = None


def tip_travel(tip_arc_lengths: ArrayLike, home_arc_length: float) -> XAxis:
    """Distance that the tip has travelled since home, from arc lengths (N,) m; in, and m above."""
    travel = np.asarray(tip_arc_lengths, dtype=np.float64) - home_arc_length
    return XAxis(values=travel / INCH, label="tip travel (in)", second=("tip travel (m)", INCH))


def time_axis(time: ArrayLike) -> XAxis:
    """Time (N,) s."""
    return XAxis(values=np.asarray(time, dtype=np.float64), label="time (s)")


def joint_values_figure(file: Path, arm: SerpentineArm, x: XAxis, joints: ArrayLike) -> None:
    """All joints with their limits, after FTL-95 Figure D.3: motion base first, then the modules.

    Args:
        x: from `tip_travel` or `time_axis`, N samples.
        joints: (N, joints) m and rad; NaN leaves a gap.
    """
    q = np.atleast_2d(np.asarray(joints, dtype=np.float64))
    base = len(arm.base.joint_names)
    sliding = [j for j in range(base) if arm.is_prismatic[j]]
    turning = [j for j in range(base) if not arm.is_prismatic[j]]
    panels = []
    if sliding:
        lines = [
            Line(x=x.values, y=q[:, j] / INCH, label=symbol(arm.joint_names[j])) for j in sliding
        ]
        limits = _limits(arm.joint_lower[sliding] / INCH, arm.joint_upper[sliding] / INCH)
        panels.append(
            Panel(
                title="base, sliding",
                y_label="position (in)",
                lines=lines,
                limits=limits,
                second_y=("position (m)", INCH),
            )
        )
    if turning:
        panels.append(_angle_panel("base, turning", arm, x, q, turning, from_home=True))
    for module in range(arm.modules):
        pair = [base + 2 * module, base + 2 * module + 1]
        panels.append(_angle_panel(f"module {module + 1}", arm, x, q, pair))
    last = range(base + 2 * arm.modules, arm.joints)
    rest = [j for j in last if np.any(np.abs(q[:, j]) > _STILL)]
    if rest:
        panels.append(_angle_panel("tip", arm, x, q, rest))
    figure = time_series_figure(
        panels,
        x.label,
        title=f"Joint values, arm '{arm.name}' (limits dashed)",
        columns=3,
        second_x=x.second,
    )
    save_figure(figure, file)


def iterations_figure(
    file: Path,
    x: XAxis,
    spine_error: ArrayLike,
    iterations: ArrayLike,
    *,
    tolerance: float,
) -> None:
    """Spine error and iterations at every tip point, after FTL-95 Figure D.4.

    Args:
        x: from `tip_travel`, N samples.
        spine_error: largest distance of a spine point from where it should be, (N,) m.
        iterations: (N,).
        tolerance: m.
    """
    error = np.asarray(spine_error, dtype=np.float64) / INCH
    error = np.where(np.isfinite(error), error, np.nan)
    count = np.asarray(iterations)
    few = "o" if error.size <= 100 else ""
    worst = where_least(-error[:, None])
    marks = []
    if worst is not None:
        marks = [_mark(x, error[:, None], worst, f"largest {_short(error[worst[0]])} in")]
    panels = [
        Panel(
            title="spine error after the last iteration",
            y_label="error (in)",
            lines=[Line(x=x.values, y=np.where(error > 0.0, error, np.nan), marker=few)],
            limits=[
                Limit(value=tolerance / INCH, label=f"tolerance {_short(tolerance / INCH)} in")
            ],
            marks=marks,
            log=True,
            # Errors of exact points (home) are rounding, many decades below.
            y_range=(
                _DECADES * tolerance / INCH,
                4.0 * max(tolerance / INCH, np.nanmax(error, initial=0.0)),
            ),
        ),
        Panel(
            title=f"iterations (total {int(count.sum())} at {count.size} tip points)",
            y_label="iterations",
            lines=[Line(x=x.values, y=count, marker=few, steps=True, color=COLORS[2])],
            y_range=(0.0, float(count.max(initial=1)) + 0.5),
            whole_y=True,
        ),
    ]
    figure = time_series_figure(
        panels, x.label, title="Follow-the-leader iteration", second_x=x.second
    )
    save_figure(figure, file)


def actuators_figure(
    file: Path,
    arm: SerpentineArm,
    x: XAxis,
    lengths: ArrayLike,
    forces: ArrayLike | None = None,
) -> None:
    """Actuators L3 .. : lengths with the strokes' ends, forces as fractions of their limits.

    A column for each size of actuator (equal force limit), strongest first. The title says the
    least stroke left and the largest fraction of a force, and rings mark where they are.

    Args:
        x: from `tip_travel` or `time_axis`, N samples.
        lengths: (N, A) m.
        forces: (N, A) N, positive when pushing; None leaves the lower row out.
    """
    linkage = arm.linkage
    length = np.atleast_2d(np.asarray(lengths, dtype=np.float64))
    left = np.minimum(length - linkage.length_lower, linkage.length_upper - length)
    tightest = where_least(left)
    said = []
    if tightest is not None:
        name = arm.actuator_names[tightest[1]]
        said.append(f"least stroke left {left[tightest] * 1e3:.1f} mm ({name})")
    fraction = np.full(length.shape, np.nan)
    if forces is not None:
        fraction = np.atleast_2d(np.asarray(forces, dtype=np.float64)) / linkage.force_limit
    hardest = where_least(-np.abs(fraction))
    if hardest is not None:
        name = arm.actuator_names[hardest[1]]
        said.append(f"largest force {abs(fraction[hardest]):.0%} of its limit ({name})")

    sizes = np.unique(linkage.force_limit)[::-1]
    groups = [np.flatnonzero(linkage.force_limit == size) for size in sizes]
    panels = []
    for group in groups:
        lower, upper = linkage.length_lower[group] * 1e3, linkage.length_upper[group] * 1e3
        marks = []
        if tightest is not None and tightest[1] in group:
            marks = [_mark(x, length * 1e3, tightest, arm.actuator_names[tightest[1]])]
        panels.append(
            Panel(
                title=f"{_span([arm.actuator_names[a] for a in group])}: length",
                y_label="length (mm)",
                lines=[
                    Line(x=x.values, y=length[:, a] * 1e3, label=arm.actuator_names[a])
                    for a in group
                ],
                limits=_limits(lower, upper),
                marks=marks,
                long_legend=True,
            )
        )
    for group, size in zip(groups, sizes, strict=True) if forces is not None else ():
        marks = []
        if hardest is not None and hardest[1] in group:
            marks = [_mark(x, fraction, hardest, arm.actuator_names[hardest[1]])]
        panels.append(
            Panel(
                title=f"force, limit {size / 1e3:g} kN",
                y_label="force / limit",
                lines=[Line(x=x.values, y=fraction[:, a]) for a in group],
                limits=_limits([-1.0], [1.0]),
                marks=marks,
            )
        )
    figure = time_series_figure(
        panels,
        x.label,
        title="Actuators: " + (", ".join(said) or "no posture"),
        columns=len(groups),
        panel_height=3.2,
        second_x=x.second,
    )
    save_figure(figure, file)


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


def _angle_panel(
    title: str,
    arm: SerpentineArm,
    x: XAxis,
    q: Array,
    joints: list[int],
    *,
    from_home: bool = False,
) -> Panel:
    """Angles in deg, each by default from zero, with the limits that they have in common or not."""
    lines = []
    for k, j in enumerate(joints):
        label = symbol(arm.joint_names[j])
        home = arm.joint_home[j] / DEGREE if from_home else 0.0
        if abs(home) > 1e-9:
            label += f" {'+' if home < 0.0 else '−'} {abs(home):g}°"
        lines.append(
            Line(x=x.values, y=q[:, j] / DEGREE - home, label=label, width=1.2 if k else 2.2)
        )
        # The first is wide, so that it shows under another of the same value.
    homes = arm.joint_home[joints] if from_home else 0.0
    return Panel(
        title=title,
        y_label="angle (deg)",
        lines=lines,
        limits=_limits(
            (arm.joint_lower[joints] - homes) / DEGREE, (arm.joint_upper[joints] - homes) / DEGREE
        ),
    )


def symbol(joint_name: str) -> str:
    """A joint's name as the report writes it: `theta4` is θ₄."""
    subscripts = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
    return joint_name.replace("theta", "θ").translate(subscripts)


def _short(value: float) -> str:
    """Three digits, without a needless zero in the exponent."""
    return f"{value:.3g}".replace("e-0", "e-")


def _span(names: list[str]) -> str:
    return f"{names[0]} to {names[-1]}" if len(names) > 2 else " and ".join(names)


def _limits(lower: ArrayLike, upper: ArrayLike) -> list[Limit]:
    """Lines for limits, each different one once."""
    values = np.concatenate([np.ravel(lower), np.ravel(upper)])
    return [Limit(value=float(value)) for value in np.unique(np.round(values, 6))]


def _mark(x: XAxis, y: Array, where: tuple[int, int], text: str) -> Mark:
    return Mark(x=float(x.values[where[0]]), y=float(y[where]), text=text)
