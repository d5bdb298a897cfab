"""Figures of a run: phases, flags and clearance over time; the joints; the way into the port."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
from matplotlib.ticker import LogLocator, NullFormatter
from numpy.typing import NDArray

from pips_drake.remote_manipulator.configuration import JOINTS, RemoteManipulatorConfig
from pips_drake.remote_manipulator.phases import PHASES, TABLE, Phase
from pips_drake.remote_manipulator.runs.data import FLAGS, RunData, millimetres
from pips_drake.remote_manipulator.station.station import CLEARANCE_RANGE
from pips_drake.twin.figures import (
    COLORS,
    LIMIT_COLOR,
    MUTED_COLOR,
    Limit,
    Line,
    Mark,
    Panel,
    add_mark,
    draw_panel,
    figure_style,
    new_figure,
    save_figure,
    time_series_figure,
)
from pips_drake.units import FOOT

Array = NDArray[np.float64]

_TIME = "time (s)"
#: How light the phases' bands are behind a panel.
_BAND = 0.13


def timeline_figure(file: Path, data: RunData, judged: NDArray[np.bool_]) -> None:
    """The phases, the collision and inhibit flags, and the least clearance, over time.

    Args:
        judged: the frames whose clearance is judged, (N,); the others' is drawn in grey.
    """
    with figure_style():
        figure = new_figure(6.4)
        top, middle, bottom = figure.subplots(
            3, 1, sharex=True, gridspec_kw={"height_ratios": [1.0, 0.8, 1.4]}
        )
        met = [phase for phase in Phase if phase in data.phase]
        rows = np.array([met.index(Phase(int(phase))) for phase in data.phase])
        top.set_title("Phase")
        top.plot(data.time, rows, drawstyle="steps-post", color="black")
        labels = [f"{PHASES[p].replace('_', ' ')} (mode {TABLE[p].mode})" for p in met]
        top.set_yticks(range(len(met)), labels)
        top.set_ylim(-0.6, len(met) - 0.4)
        middle.set_title("Collision and inhibit flags")
        for row, name in enumerate(FLAGS):
            color = LIMIT_COLOR if "inhibit" in name else COLORS[4]
            middle.broken_barh(
                _spans(data.time, data.flags[:, row]), (row - 0.35, 0.7), color=color
            )
        middle.set_yticks(range(len(FLAGS)), [name.replace("_", " ") for name in FLAGS])
        middle.set_ylim(-0.6, len(FLAGS) - 0.4)
        middle.invert_yaxis()
        if not np.any(data.flags):
            middle.text(0.5, 0.5, "none", transform=middle.transAxes, ha="center", va="center",
                        color=MUTED_COLOR)  # fmt: skip
        draw_panel(bottom, _clearance_panel(data, judged))
        bottom.set_xlabel(_TIME)
        for axes in (top, middle, bottom):
            _shade(axes, data)
        figure.draw_without_rendering()  # lays out, so that the mark knows where there is room
        figure.set_layout_engine("none")
        for mark in _nearest(data, judged):
            add_mark(bottom, mark)
        save_figure(figure, file)


def _clearance_panel(data: RunData, judged: NDArray[np.bool_]) -> Panel:
    """Clearance over time, in grey where it is not judged."""
    clear = data.clearance
    lines = [Line(x=data.time, y=clear, color="#999999", label="not judged: at the port")]
    if np.all(judged):
        lines = []
    lines.append(Line(x=data.time, y=np.where(judged, clear, np.nan), color=COLORS[0]))
    return Panel(
        title=f"Least clearance of arm and payload to everything else, up to {CLEARANCE_RANGE:g} m",
        y_label="clearance (m)",
        lines=lines,
        y_range=(min(0.0, float(clear.min())) - 0.04, None),
    )


def _nearest(data: RunData, judged: NDArray[np.bool_]) -> list[Mark]:
    """The least of the clearances that are judged, if anything is in range."""
    row = int(np.argmin(np.where(judged, data.clearance, np.inf)))
    pair = data.pairs[row]
    if not judged[row] or pair is None:
        return []
    # Models are called after the machine, bodies after what they are.
    first, second = (name.rpartition("::")[2].replace("_", " ") for name in pair)
    least = float(data.clearance[row])
    text = f"{millimetres(least)}, {first} to {second}"
    return [Mark(x=float(data.time[row]), y=least, text=text)]


def joints_figure(file: Path, data: RunData, config: RemoteManipulatorConfig) -> None:
    """The six angles with their hard limits, stand and prong, and the drives' shares of force."""
    arm = config.arm
    panels = [
        Panel(
            title=f"{name}, deg: {np.degrees(arm.lower[k]):g} .. {np.degrees(arm.upper[k]):g}",
            y_label="",
            lines=_sent_and_found(data, 1 + k, factor=180.0 / math.pi),
            y_range=_not_too_near(np.degrees(data.arm[:, 1 + k]), 5.0),
        )
        for k, name in enumerate(JOINTS)
    ]
    stand, gap = config.stand, config.effector
    for column, title in (
        (0, f"stand, m: {stand.lower_m:g} .. {stand.upper_m:g}"),
        (7, f"prong's gap, m: {gap.prong_closed_gap_m:g} .. {gap.prong_open_gap_m:g}"),
    ):
        lines = _sent_and_found(data, column)
        nearest = _not_too_near(data.arm[:, column], 0.1)
        panels.append(Panel(title=title, y_label="", lines=lines, y_range=nearest))
    shares = 100.0 * data.torque_fractions(config)
    panels.append(
        Panel(
            title="largest torque in each second, % of its joint's limit",
            y_label="",
            lines=[_largest(data.time, shares[:, 1:7].max(axis=1))],
            limits=[Limit(value=100.0)],
        )
    )
    panels.append(
        Panel(
            title="palm to where it was sent, most in each second, mm",
            y_label="",
            lines=[_largest(data.time, 1e3 * data.tracking_error(config))],
        )
    )
    title = "Joints with their limits: simulated (blue) and sent (grey)"
    figure = time_series_figure(panels, _TIME, title=title, columns=2, panel_height=1.6)
    save_figure(figure, file)


def _sent_and_found(data: RunData, column: int, *, factor: float = 1.0) -> list[Line]:
    """Of an entry of the arm vector: where it was sent, a broad line below, and where it was."""
    return [
        Line(x=data.time, y=factor * data.setpoint[:, column], color="#BBBBBB", width=3.5),
        Line(x=data.time, y=factor * data.arm[:, column], color=COLORS[0]),
    ]


def _not_too_near(values: Array, least: float) -> tuple[float | None, float | None]:
    """A range for an axis, so that rounding does not look like motion."""
    middle = 0.5 * float(values.min() + values.max())
    rests = float(np.ptp(values)) < 0.8 * least
    return (middle - 0.5 * least, middle + 0.5 * least) if rests else (None, None)


def _largest(time: Array, values: Array, period: float = 1.0) -> Line:
    """The largest value (not of NaN) of each period, s."""
    known = np.isfinite(values)
    time, values = time[known], values[known]
    if not len(time):
        return Line(x=time, y=values)
    starts = np.flatnonzero(np.diff(np.floor(time / period), prepend=-1.0) != 0.0)
    return Line(x=time[starts], y=np.maximum.reduceat(values, starts))


def docking_figure(file: Path, data: RunData, config: RemoteManipulatorConfig) -> bool:
    """Distance and angle to docking while the payload is held near the port; False: it never is."""
    distance, angle = data.display["docking_distance_m"], data.display["docking_angle_rad"]
    held = np.array([TABLE[Phase(int(phase))].grasped for phase in data.phase])
    near = held & (distance < 2.0)
    if np.count_nonzero(near) < 2:
        return False
    first, last = np.flatnonzero(near)[[0, -1]]
    rows = slice(first, last + 1)
    allowed = math.degrees(math.acos(1.0 - 2.0**config.docking.cosine_deficit_log2))
    panels = [
        Panel(
            title="Probe's middle to port's",
            y_label="distance (m)",
            lines=[Line(x=data.time[rows], y=distance[rows])],
            limits=[Limit(value=config.docking.distance_ft * FOOT, label="docks below")],
            marks=_decided(data, rows, distance),
            log=True,
        ),
        Panel(
            title="Angle between the y axes of probe and port",
            y_label="angle (deg)",
            lines=[Line(x=data.time[rows], y=np.degrees(angle[rows]))],
            limits=[Limit(value=allowed, label="docks below")],
        ),
    ]
    title = "Docking: the payload's probe and the CAE's port"
    figure = time_series_figure(panels, _TIME, title=title, panel_height=2.4)
    axis = figure.axes[0].yaxis
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())
    save_figure(figure, file)
    return True


def _decided(data: RunData, rows: slice, distance: Array) -> list[Mark]:
    docked = Phase.DOCKED_HELD
    when = np.flatnonzero((data.phase[1:] == docked) & (data.phase[:-1] != docked)) + 1
    return [
        Mark(x=float(data.time[row]), y=float(distance[row]), text="docked")
        for row in when[:1]
        if rows.start <= row < rows.stop
    ]


def _spans(time: Array, flag: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Starts and lengths of the times when a flag is up; at least as long as can be seen."""
    edges = np.diff(np.concatenate([[0], flag.astype(int), [0]]))
    least = 0.002 * float(time[-1] - time[0])
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return [
        (float(time[a]), max(float(time[min(b, len(time) - 1)] - time[a]), least))
        for a, b in zip(starts.tolist(), ends.tolist(), strict=True)
    ]


def _shade(axes, data: RunData) -> None:  # type: ignore[no-untyped-def]
    """A light band for each phase."""
    changes = [0, *(np.flatnonzero(np.diff(data.phase)) + 1), len(data.time) - 1]
    for first, last in itertools.pairwise(changes):
        color = COLORS[int(data.phase[first]) % 6]
        axes.axvspan(
            float(data.time[first]), float(data.time[last]), color=color, alpha=_BAND, linewidth=0
        )
