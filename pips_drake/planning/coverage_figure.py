"""Draws what a scan has seen: the surface unfolded."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from pips_drake.planning.coverage import ScanCoverage

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_coverage(axes: Axes, coverage: ScanCoverage, *, track: ArrayLike | None = None) -> None:
    """The surface unfolded, along to the right and around upwards: seen, seen again, and not.

    Args:
        track: where the tip went, (K, 3) m in the world.
    """
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch, Rectangle

    looks = (
        ("#f1efe9", "not seen"),
        ("#d1495b", "behind an obstacle"),
        ("#5a6270", "something lies on it"),
        ("#9fd3c0", "seen once"),
        ("#1a7f64", "seen again"),
    )
    code = np.where(coverage.hidden >= 0, 1, 0)
    code[coverage.seen] = 3
    code[coverage.seen & (coverage.passes > 1)] = 4
    code[coverage.covered] = 2
    target = coverage.target
    degrees = np.degrees(target.around)
    axes.imshow(
        code.T,
        origin="lower",
        extent=(*target.along, degrees[0], degrees[1]),
        aspect="auto",
        cmap=ListedColormap([color for color, _ in looks]),
        vmin=-0.5,
        vmax=len(looks) - 0.5,
        interpolation="nearest",
    )
    # What is white beyond it belongs to no target.
    (low, high), wide = target.along, degrees[1] - degrees[0]
    frame = Rectangle((low, degrees[0]), high - low, wide, fill=False, edgecolor="#5a6270")
    axes.add_patch(frame)
    handles: list[Any] = [
        Patch(facecolor=color, edgecolor="#8b8f96", label=label)
        for k, (color, label) in enumerate(looks)
        if (code == k).any()
    ]
    if track is not None:
        along, around, _ = target.from_world(track)
        # A line across the seam would cross the whole picture.
        seam = np.abs(np.diff(around)) > math.pi
        shown = np.degrees(np.where(np.append(seam, False), np.nan, around))
        handles += axes.plot(along, shown, color="#16324f", linewidth=0.8, label="the tip's way")
    axes.legend(
        handles=handles,
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
        ncols=len(handles),
        frameon=False,
        fontsize="small",
        columnspacing=1.2,
        handlelength=1.4,
    )
    axes.set_xlabel("along the axis, m")
    axes.set_ylabel("around it, deg")
