"""A flat view beside a replay's three-dimensional one, whose lines move with the replay's time.

It knows no machine: whoever has a flat view of a motion says what stands in it, and what moves.
"""

from __future__ import annotations

import base64
import io
import json
import string
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError

Array = NDArray[np.float64]

_PAGE = Path(__file__).with_name("replay_panel.html")


@dataclass(frozen=True, kw_only=True)
class CameraView:
    """Where the three-dimensional view can be looked at from, by a button.

    Attributes:
        label: of the button.
        eye, target: where the camera stands and looks at, (3,) m in the world.
    """

    label: str
    eye: ArrayLike
    target: ArrayLike


@dataclass(frozen=True, kw_only=True, eq=False)
class PanelLine:
    """A line in a panel; NaN leaves a gap.

    Attributes:
        points: (N, 2), in the units of the axes' labels.
        color: as CSS has it.
        label: for the legend; empty for none.
        width: pixels.
        dashed: or solid.
        marker: a star at each point instead of a line.
    """

    points: ArrayLike
    color: str
    label: str = ""
    width: float = 2.0
    dashed: bool = False
    marker: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class ReplayPanel:
    """A flat view below the three-dimensional one.

    Attributes:
        title: above it.
        x_label, y_label: with their units.
        x_range, y_range: what is shown.
        picture: behind the lines over the whole range, (rows, columns, 3), 0 to 1; row 0 lowest.
        lines: that stand, the last on top.
        times: of the moving line, ascending, (T,) s on the recorded positions' clock.
        moving: that line at these times, T times (N, 2); where it is between two is not made up.
        moving_color, moving_width, moving_label: as of a `PanelLine`.
        views: of the three-dimensional view.
        see_through: scoped names of bodies that it shows faintly at first, since they stand before
            what moves; a button shows them as they are.
    """

    title: str
    x_label: str
    y_label: str
    x_range: tuple[float, float]
    y_range: tuple[float, float]
    picture: ArrayLike | None = None
    lines: Sequence[PanelLine] = ()
    times: ArrayLike = field(default_factory=lambda: np.zeros(0))
    moving: Sequence[ArrayLike] = ()
    moving_color: str = "#16324f"
    moving_width: float = 5.0
    moving_label: str = ""
    views: Sequence[CameraView] = ()
    see_through: Sequence[str] = ()


def panel_html(panel: ReplayPanel, start: float) -> str:
    """What stands in the page for a panel, after the replay's own controls.

    Args:
        start: time of the replay's first sample, s.

    Raises:
        InputError: not as many lines as times.
    """
    times = np.asarray(panel.times, dtype=np.float64)
    if times.shape != (len(panel.moving),):
        raise InputError(
            f"replay panel: times of shape {times.shape} for {len(panel.moving)} lines; must be "
            "one each"
        )
    data = {
        "title": panel.title,
        "labels": [panel.x_label, panel.y_label],
        "ranges": [list(map(float, panel.x_range)), list(map(float, panel.y_range))],
        "picture": _png(panel.picture) if panel.picture is not None else "",
        "lines": [
            {
                "points": _rounded(line.points),
                "color": line.color,
                "label": line.label,
                "width": line.width,
                "dashed": line.dashed,
                "marker": line.marker,
            }
            for line in panel.lines
        ],
        "times": (times - start).round(3).tolist(),
        "moving": [_rounded(line) for line in panel.moving],
        "mover": {
            "color": panel.moving_color,
            "width": panel.moving_width,
            "label": panel.moving_label,
        },
        "views": [
            {
                "label": view.label,
                "eye": np.asarray(view.eye, dtype=np.float64).round(4).tolist(),
                "target": np.asarray(view.target, dtype=np.float64).round(4).tolist(),
            }
            for view in panel.views
        ],
        "see_through": list(panel.see_through),
    }
    text = json.dumps(data, allow_nan=False).replace("<", "\\u003c")
    return string.Template(_PAGE.read_text(encoding="utf-8")).substitute(data=text)


def _rounded(points: ArrayLike) -> list[list[float] | None]:
    """Points as JSON has them: three digits, and null in a gap."""
    rows = np.asarray(points, dtype=np.float64).reshape(-1, 2)
    return [None if np.isnan(row).any() else row.round(3).tolist() for row in rows]


def _png(picture: ArrayLike) -> str:
    """A picture as an address that holds it."""
    from matplotlib.image import imsave

    data = io.BytesIO()
    rows: Any = np.clip(np.asarray(picture, dtype=np.float64)[::-1], 0.0, 1.0)
    nameless: Any = {"Software": None}  # the same picture gives the same bytes
    imsave(data, rows, format="png", metadata=nameless)
    return "data:image/png;base64," + base64.b64encode(data.getvalue()).decode()
