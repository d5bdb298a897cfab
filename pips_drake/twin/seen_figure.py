"""Shows which part of a surface a camera has seen, and from how near."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.twin.figures import MUTED_COLOR, figure_style, new_figure, save_figure
from pips_drake.twin.surface import CylinderMap, SeenSurface

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

#: Colours from near to far.
_COLORMAP = "viridis_r"
_TICKS = (0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0)
#: How far outside their surface coloured patches are drawn, m: clear of paint on it.
_LIFT = 4e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class ColoredPatches:
    """Triangles with a colour each.

    Attributes:
        corners: (N, 3, 3) m in the world, anticlockwise from outside.
        colors: red, green, blue (N, 3), 0 to 1.
    """

    corners: Array
    colors: Array


def distance_range(seen: SeenSurface) -> tuple[float, float]:
    """Ends of the logarithmic colour scale, m: nearest and farthest that was seen, rounded."""
    if not seen.seen.any():
        return 0.1, 1.0
    distance = seen.distance[seen.seen]
    low = max(0.01, math.floor(float(distance.min()) * 10.0 + 1e-9) / 10.0)
    return low, max(low + 0.1, math.ceil(float(distance.max()) * 10.0 - 1e-9) / 10.0)


def color_patches(seen: SeenSurface, *, levels: int | None = None) -> ColoredPatches:
    """The seen patches, a little outside the surface, coloured by their least distance.

    Args:
        levels: number of different colours; any by default.
    """
    from matplotlib import colormaps

    patches = seen.surface.patches.select(seen.seen)
    low, high = distance_range(seen)
    share = np.log(seen.distance[seen.seen] / low) / math.log(high / low)
    if levels is not None:
        share = (np.minimum(np.floor(share * levels), levels - 1) + 0.5) / levels
    corners = patches.corners + _LIFT * patches.normals[:, None]
    # Two triangles a patch; the second of a patch that is a triangle has no area.
    both = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    colors = np.tile(colormaps[_COLORMAP](share)[:, :3], (2, 1))
    area = np.linalg.norm(np.cross(both[:, 1] - both[:, 0], both[:, 2] - both[:, 0]), axis=1)
    kept = area > 0.0
    return ColoredPatches(corners=both[kept], colors=colors[kept])


def seen_surface_figure(
    file: Path,
    seen: SeenSurface,
    *,
    focal_length: float,
    camera_track: ArrayLike,
    picture: NDArray[np.uint8] | None = None,
    notes: tuple[str, ...] = (),
) -> None:
    """Writes the map of the largest cylinder, unrolled, beside a picture of the body.

    Args:
        focal_length: of the camera, pixels, for the scale in pixels per mm.
        camera_track: positions of the camera, (N, 3) m in the world.
        picture: rendered, (height, width, 3); none where nothing can be rendered.
        notes: sentences below, such as what the map leaves out.
    """
    with_map = bool(seen.surface.maps)
    columns = int(with_map) + int(picture is not None)
    with figure_style():
        figure = new_figure(5.4 if picture is None or not with_map else 4.9)
        patches = seen.surface.patches
        figure.suptitle(
            f"Seen of {seen.surface.name}: {seen.area:.2f} m² of {patches.areas.sum():.2f} m², "
            f"{100.0 * seen.fraction:.0f} %"
        )
        axes: list[Any] = list(
            np.atleast_1d(figure.subplots(1, max(1, columns), width_ratios=[1.45, 1.0]))
            if columns > 1
            else [figure.subplots()]
        )
        mesh = None
        if with_map:
            mesh = _draw_map(axes[0], seen, seen.surface.maps[0], np.asarray(camera_track))
        if picture is not None:
            axes[-1].imshow(picture)
            axes[-1].set_axis_off()
            axes[-1].set_title("The arm at its path's end")
        if mesh is None:
            mesh = _scale(seen)
        if columns:
            bar = figure.colorbar(mesh, ax=axes, location="bottom", aspect=50, shrink=0.75)
            bar.set_label("least distance from the camera (m)")
            low, high = distance_range(seen)
            ticks = [tick for tick in _TICKS if low <= tick <= high]
            bar.ax.minorticks_off()
            bar.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks])
            sharp = bar.ax.secondary_xaxis("top")
            sharp.minorticks_off()
            sharp.set_xticks(ticks, [f"{focal_length / tick * 1e-3:.2g}" for tick in ticks])
            sharp.set_xlabel("pixels per mm, seen head-on")
        if notes:
            figure.supxlabel("  ".join(notes), fontsize=8.0, color=MUTED_COLOR)
    save_figure(figure, file)


def _scale(seen: SeenSurface) -> Any:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm

    return ScalarMappable(LogNorm(*distance_range(seen)), _COLORMAP)


def _draw_map(axes: Axes, seen: SeenSurface, unrolled: CylinderMap, track: Array) -> Any:
    """Angle times height of a cylinder, in degrees and m, and where the camera stood over it."""
    from matplotlib.patches import Patch, Rectangle

    grid, rows = unrolled.grid, unrolled.rows
    distance = np.where(rows >= 0, seen.distance[rows], np.nan)
    distance[~np.isfinite(distance)] = np.nan
    covered = rows < 0
    middle = 2.0 * np.pi * (np.arange(grid.around) + 0.5) / grid.around
    # What was seen stands in the middle of the map, at a round angle.
    weight = np.isfinite(distance).sum(axis=1)
    mean = math.degrees(math.atan2(weight @ np.sin(middle), weight @ np.cos(middle)))
    start = 45.0 * round(mean / 45.0) - 180.0
    shift = round(start / 360.0 * grid.around)
    edge_angle = start + 360.0 * np.arange(grid.around + 1) / grid.around
    edge_height = np.linspace(-0.5 * grid.length, 0.5 * grid.length, grid.along + 1)
    axes.set_facecolor("#EDEDED")
    axes.grid(visible=False)
    axes.add_patch(
        Rectangle(
            (edge_angle[0], edge_height[0]),
            360.0,
            grid.length,
            hatch="////",
            facecolor="#EDEDED",
            edgecolor="#C4C4C4",
            linewidth=0.0,
            zorder=0,
        )
    )
    turned = np.roll(distance, -shift, axis=0)
    mesh = axes.pcolormesh(
        edge_angle, edge_height, turned.T, cmap=_COLORMAP, norm=_scale(seen).norm, zorder=1
    )
    hidden = np.where(np.roll(covered, -shift, axis=0), 1.0, np.nan)
    axes.pcolormesh(edge_angle, edge_height, hidden.T, cmap="Greys", vmin=0.0, vmax=1.6, zorder=1)
    local = (unrolled.X_WG.inverse() @ track.T).T if len(track) else np.empty((0, 3))
    angle = np.degrees(np.arctan2(local[:, 1], local[:, 0]))
    angle = start + np.mod(angle - start, 360.0)
    over = np.abs(local[:, 2]) <= 0.5 * grid.length
    angle[~over] = np.nan
    (line,) = axes.plot(angle, local[:, 2], color="#D55E00", linewidth=1.6, zorder=3)
    line.set_label("camera stood over it")
    side = np.where(rows >= 0, seen.surface.patches.areas[rows], 0.0)
    share = side[np.isfinite(distance)].sum() / side.sum()
    axes.set(
        title=f"{unrolled.name}: {100.0 * share:.0f} % of its side seen",
        xlabel="angle about the axis (deg)",
        ylabel="height along the axis (m)",
        xlim=(edge_angle[0], edge_angle[-1]),
        ylim=(edge_height[0], edge_height[-1]),
    )
    axes.set_xticks(np.arange(start, start + 361.0, 45.0))
    handles = [line, Patch(facecolor="#EDEDED", edgecolor="#C4C4C4", hatch="////", label="unseen")]
    if covered.any():
        handles.append(Patch(facecolor="#777777", label="covered"))
    axes.legend(
        handles=handles, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.1
    )
    return mesh
