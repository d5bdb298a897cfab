"""Figures of a run that any arm-like machine has: clearance, and tracking of the plan.

Each function takes plain arrays in SI units and writes one PNG.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.twin.figures import (
    COLORS,
    MUTED_COLOR,
    Limit,
    Line,
    Mark,
    Panel,
    save_figure,
    time_series_figure,
    where_least,
)

Array = NDArray[np.float64]


def clearance_figure(
    file: Path,
    time: ArrayLike,
    distance: ArrayLike,
    *,
    pair: tuple[str, str] | tuple[()] = (),
    threshold: float | None = None,
    max_distance: float | None = None,
    own_distance: ArrayLike | None = None,
    x_axis: tuple[str, str] = ("time", "s"),
    certified: float | None = None,
) -> None:
    """Least distance of the arm to the scene over time, its least point marked.

    Args:
        time: (N,) s, or what else `x_axis` says.
        distance: (N,) m; negative in penetration.
        pair: the bodies' names at the least point.
        threshold: what the distance must not fall below, m.
        max_distance: how far the monitor looks, m. Distances of that much or more mean "nothing
            nearer"; the line has a gap there.
        own_distance: of the arm to itself, (N,) m.
        x_axis: name and unit of what the samples are listed by.
        certified: what the arm's distance to the scene is proved to be at every instant, m.
    """
    t = np.asarray(time, dtype=np.float64)
    scene = _seen(distance, max_distance)
    lines = [Line(x=t, y=scene, label="arm to scene")]
    values = [scene]
    if own_distance is not None:
        values.append(_seen(own_distance, max_distance))
        lines.append(Line(x=t, y=values[-1], label="arm to itself", color=MUTED_COLOR, width=1.0))
    marks, title = [], "Clearance: nothing within the monitor's reach"
    least = where_least(scene[:, None])
    if least is not None:
        k = least[0]
        between = f"\n{pair[0]} to\n{pair[1]}" if pair else ""
        marks = [
            Mark(x=t[k], y=scene[k], text=f"{scene[k]:.1f} mm at {t[k]:.2f} {x_axis[1]}{between}")
        ]
        title = f"Clearance: least {scene[k]:.1f} mm"
    limits = []
    if threshold is not None:
        limits = [Limit(value=threshold * 1e3, label=f"must stay above {threshold * 1e3:g} mm")]
    if certified is not None:
        lines.append(
            Line(
                x=[t[0], t[-1]],
                y=[certified * 1e3] * 2,
                label=f"proved: never below {certified * 1e3:.2f} mm",
                color=COLORS[2],
                style="--",
                width=1.2,
            )
        )
    if max_distance is not None:
        lines.append(
            Line(
                x=[t[0], t[-1]],
                y=[max_distance * 1e3] * 2,
                label="monitor's reach",
                color=MUTED_COLOR,
                style=":",
                width=1.0,
            )
        )
    low = min([0.0, *(float(np.nanmin(v)) for v in values if not np.isnan(v).all())])
    panel = Panel(
        title="least signed distance, sampled",
        y_label="distance (mm)",
        lines=lines,
        limits=limits,
        marks=marks,
        y_range=(1.1 * low, None),
    )
    x_label = f"{x_axis[0]} ({x_axis[1]})"
    save_figure(time_series_figure([panel], x_label, title=title, panel_height=3.6), file)


def tracking_figure(
    file: Path,
    time: ArrayLike,
    spine_error: ArrayLike,
    tip_error: ArrayLike,
    *,
    uncompensated: tuple[ArrayLike, ArrayLike, ArrayLike] | None = None,
    limit: float | None = None,
) -> None:
    """How far the simulated spine is from the plan at the same instant.

    Args:
        time: (N,) s.
        spine_error: largest over the spine points, (N,) m.
        tip_error: (N,) m.
        uncompensated: time (M,) s, spine error (M,) m and tip error (M,) m of the same run without
            compensation of the deflection; drawn in a panel of its own, because it is much larger.
        limit: what the spine error must stay below, m.
    """
    limits = [] if limit is None else [Limit(value=limit * 1e3, label=f"limit {limit * 1e3:g} mm")]
    runs = [("deflection compensated", time, spine_error, tip_error)]
    if uncompensated is not None:
        runs.append(("not compensated: the sag", *uncompensated))
    panels = []
    for title, when, spine, tip in runs:
        t = np.asarray(when, dtype=np.float64)
        errors = np.asarray(spine, dtype=np.float64) * 1e3
        worst = where_least(-errors[:, None])
        text = "" if worst is None else f"{errors[worst[0]]:.2f} mm at {t[worst[0]]:.2f} s"
        panels.append(
            Panel(
                title=title,
                y_label="error (mm)",
                lines=[
                    Line(x=t, y=errors, label="worst spine point"),
                    Line(x=t, y=np.asarray(tip) * 1e3, label="tip", color=COLORS[1], width=1.0),
                ],
                limits=limits,
                marks=[] if worst is None else [Mark(x=t[worst[0]], y=errors[worst[0]], text=text)],
                y_range=(0.0, None),
            )
        )
    figure = time_series_figure(
        panels, "time (s)", title="Simulated spine against the plan", panel_height=2.8
    )
    save_figure(figure, file)


def _seen(distance: ArrayLike, max_distance: float | None) -> Array:
    """Distances in mm, NaN where nothing is within the monitor's reach."""
    values = np.array(distance, dtype=np.float64)
    if max_distance is not None:
        values[values >= max_distance] = np.nan
    return values * 1e3
