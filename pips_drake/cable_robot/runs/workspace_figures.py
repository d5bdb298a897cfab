"""Figures of a cable robot's workspace: maps of what is asked in slices, and its volume.

The bay, its doors and the posts are drawn in every map, so that a place can be found in it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap, LogNorm, Normalize
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, NullLocator, ScalarFormatter
from numpy.typing import NDArray

from pips_drake.cable_robot.accuracy import pose_errors
from pips_drake.cable_robot.capability import wrench_capability
from pips_drake.cable_robot.interference import ObstacleBox
from pips_drake.cable_robot.kinematics import Poses
from pips_drake.cable_robot.panels import BAY_HALF_LENGTH, BAY_RADIUS, DOOR_ANGLE
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.statics import characteristic_length, distribute_tensions
from pips_drake.cable_robot.stiffness import full_stiffness, stiffness_directions
from pips_drake.cable_robot.workspace import Grid, Study, make_grid, sweep
from pips_drake.errors import UnknownNameError
from pips_drake.twin.figures import (
    LIMIT_COLOR,
    MUTED_COLOR,
    figure_style,
    new_figure,
    save_figure,
)

Array = NDArray[np.float64]

AXES = "x aft (m)", "y starboard (m)", "z up (m)"
#: Classes of a place in the volume's slices, and their colours, from nothing to everything.
_CLASSES = (
    ("weight not held", "#FFFFFF"),
    ("weight held, disturbances not", "#E8E0C8"),
    ("something too near", "#E0A080"),
    ("usable", "#7FB8A0"),
)


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """What a map shows.

    Attributes:
        title: of the figure.
        label: of the colour bar, with unit.
        measure: values (N,) of poses.
        less_is_better: which end of the colours is dark.
    """

    title: str
    label: str
    measure: Callable[[CableRobot, Poses], Array]
    less_is_better: bool = True


def _tension(robot: CableRobot, poses: Poses) -> Array:
    return distribute_tensions(robot, poses, "least_norm").tensions.max(axis=1)


def _accuracy(robot: CableRobot, poses: Poses) -> Array:
    return 1e3 * pose_errors(robot, poses, 1e-3).position


def _stiffness(robot: CableRobot, poses: Poses) -> Array:
    found = distribute_tensions(robot, poses, "least_norm")
    K = full_stiffness(robot, poses, found.tensions)
    return 1e-3 * stiffness_directions(robot, K, characteristic_length(robot)).values[:, 0]


def _force(robot: CableRobot, poses: Poses) -> Array:
    return wrench_capability(robot, poses).force


def _moment(robot: CableRobot, poses: Poses) -> Array:
    return wrench_capability(robot, poses).moment


QUANTITIES: dict[str, Quantity] = {
    "tension": Quantity(
        title="Largest tension that the weight needs (least-norm tensions)",
        label="largest tension (N)",
        measure=_tension,
    ),
    "accuracy": Quantity(
        title="Worst error of the position if every length may be wrong by 1 mm",
        label="position error (mm)",
        measure=_accuracy,
    ),
    "stiffness": Quantity(
        title="Softest direction, with the least-norm tensions",
        label="softest stiffness (kN/m)",
        measure=_stiffness,
        less_is_better=False,
    ),
    "force": Quantity(
        title="Force that is borne in every direction besides the weight",
        label="force (N)",
        measure=_force,
        less_is_better=False,
    ),
    "moment": Quantity(
        title="Moment that is borne about every axis besides the weight",
        label="moment (N m)",
        measure=_moment,
        less_is_better=False,
    ),
}


def map_figure(
    file: Path,
    robot: CableRobot,
    quantity: str,
    *,
    study: Study,
    cells: float = 0.25,
    height: float = 1.0,
) -> None:
    """A quantity in four slices: from above, from the side over a panel, and two across.

    Places that cannot be used for the study are hatched.

    Args:
        quantity: of `QUANTITIES`.
        cells: size of the maps' cells, m.
        height: of the slice from above, m.
    """
    if quantity not in QUANTITIES:
        raise UnknownNameError("map", quantity, list(QUANTITIES))
    shown = QUANTITIES[quantity]
    outer, end = 2.0 * BAY_RADIUS, BAY_HALF_LENGTH - 0.5
    slices = [
        (0, 1, 2, height, f"from above, at z = {height:g} m"),
        (
            0,
            2,
            1,
            outer - 0.1,
            f"from port, at y = {outer - 0.1:.2f} m: through the starboard panels",
        ),
        (1, 2, 0, 0.0, "across, at x = 0"),
        (1, 2, 0, end, f"across, at x = {end:.2f} m"),
    ]
    grids = [_slice(robot, right, up, through, at, cells) for right, up, through, at, _ in slices]
    values = []
    for grid in grids:
        held = wrench_capability(robot, grid.poses).force >= 0.0
        values.append(np.where(held, shown.measure(robot, grid.poses), np.nan))
    usable = [sweep(robot, grid.poses, study).usable for grid in grids]
    good = np.concatenate([v[u & np.isfinite(v)] for v, u in zip(values, usable, strict=True)])
    low, high = np.quantile(good, [0.01, 0.99]) if good.size else (0.0, 1.0)
    low = max(float(low), 1e-3 * float(high), 1e-9)
    scale = LogNorm(low, max(float(high), 1.01 * low))
    colors = "viridis_r" if shown.less_is_better else "viridis"
    with figure_style():
        figure = new_figure(6.6, title=f"{shown.title}: {robot.name}")
        layout = figure.add_gridspec(10, 2, width_ratios=[1.45, 1.0])
        places = layout[:6, 0], layout[6:, 0], layout[:5, 1], layout[5:, 1]
        image: Any = None
        drawn = []
        for place, grid, value, mask, one in zip(
            places, grids, values, usable, slices, strict=True
        ):
            axes = figure.add_subplot(place)
            drawn.append(axes)
            image = _draw_slice(axes, grid, value, mask, one, scale, colors)
            draw_place(axes, robot, one[0], one[1])
            axes.set_title(one[4])
        drawn[0].set_xlabel("")  # the side view below has the same axis
        bar = figure.colorbar(image, ax=drawn, shrink=0.8, extend="both", aspect=30)
        bar.ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        bar.ax.yaxis.set_minor_locator(NullLocator())
        bar.ax.yaxis.set_major_formatter(ScalarFormatter())
        bar.set_label(shown.label)
        figure.legend(
            handles=[
                Patch(
                    facecolor="white", edgecolor=MUTED_COLOR, hatch="////", label=_unusable(study)
                ),
                Patch(facecolor="white", edgecolor=MUTED_COLOR, label="white: weight not held"),
            ],
            loc="outside lower left",
            ncols=2,
        )
        save_figure(figure, file)


def volume_figure(
    file: Path,
    robot: CableRobot,
    *,
    study: Study,
    cells: float = 0.5,
    heights: Sequence[float] = (-1.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0),
) -> dict[str, float]:
    """The workspace in slices from above, stacked; returns volumes by class, m3.

    Volumes are of the block between the posts, from the lowest to the highest slice.
    """
    heights = sorted(heights)
    reach = np.abs(robot.anchors).max(axis=0)
    with figure_style():
        columns = 3
        rows = -(-(len(heights) + 1) // columns)
        figure = new_figure(2.45 * rows + 0.9)
        cells_of_figure = figure.subplots(rows, columns, squeeze=False)
        colors = ListedColormap([color for _, color in _CLASSES])
        for axes, z in zip(cells_of_figure.ravel(), heights[::-1], strict=False):
            grid = _slice(robot, 0, 1, 2, z, cells)
            classes = _classes(robot, grid, study)
            x, y = _edges(grid, 0), _edges(grid, 1)
            axes.pcolormesh(
                x, y, grid.values(classes)[:, :, 0].T, cmap=colors, norm=BoundaryNorm(range(5), 4)
            )
            draw_place(axes, robot, 0, 1)
            axes.set_title(f"z = {z:g} m")
            axes.set_aspect("equal")
            axes.grid(False)
            axes.set_xlabel(AXES[0])
        for axes in cells_of_figure[:, 0]:
            axes.set_ylabel(AXES[1])
        for axes in cells_of_figure.ravel()[len(heights) + 1 :]:
            axes.remove()
        block = make_grid(
            [-reach[0], -reach[1], heights[0]],
            [reach[0], reach[1], heights[-1]],
            tuple(  # type: ignore[arg-type]
                max(1, round(size / cells))
                for size in (2.0 * reach[0], 2.0 * reach[1], heights[-1] - heights[0])
            ),
        )
        classes = _classes(robot, block, study)
        volumes = {name: block.measure(classes == k) for k, (name, _) in enumerate(_CLASSES)}
        total = sum(volumes.values())
        axes = cells_of_figure.ravel()[len(heights)]
        usable = block.values(classes == 3).sum(axis=(0, 1)) * block.sizes[0] * block.sizes[1]
        axes.plot(usable, block.axes[2], color=_CLASSES[3][1], marker="o", markersize=3.0)
        axes.set_title("usable area by height")
        axes.set_xlabel("usable (m2)")
        axes.set_ylabel(AXES[2])
        axes.set_xlim(0.0, 1.08 * max(usable.max(), block.cell))
        figure.suptitle(
            f"Workspace of {robot.name}, level: {volumes['usable']:.0f} of {total:.0f} m3 between "
            f"the posts, z = {heights[0]:g} .. {heights[-1]:g} m",
            x=0.01,
            horizontalalignment="left",
        )
        figure.legend(
            handles=[
                Patch(
                    facecolor=color, edgecolor=MUTED_COLOR, label=f"{name}: {volumes[name]:.0f} m3"
                )
                for name, color in _CLASSES
            ],
            loc="outside lower left",
            ncols=4,
        )
        save_figure(figure, file)
    return volumes


def _unusable(study: Study) -> str:
    return (
        f"hatched: not usable ({study.disturbance_force:g} N and {study.disturbance_moment:g} N m "
        f"not borne, or something nearer than {1e3 * study.least_clearance:g} mm)"
    )


def _slice(robot: CableRobot, right: int, up: int, through: int, at: float, cells: float) -> Grid:
    """A slice between the posts and from below the panels to the anchors."""
    reach = np.abs(robot.anchors).max(axis=0)
    low = np.array([-reach[0], -reach[1], -BAY_RADIUS])
    high = np.array([reach[0], reach[1], robot.anchors[:, 2].max()])
    low[through] = high[through] = at
    counts = [1, 1, 1]
    for axis in (right, up):
        counts[axis] = max(2, round((high[axis] - low[axis]) / cells))
    return make_grid(low, high, (counts[0], counts[1], counts[2]))


def _classes(robot: CableRobot, grid: Grid, study: Study) -> NDArray[np.int64]:
    """Index into `_CLASSES` of every cell."""
    found = sweep(robot, grid.poses, study)
    held = wrench_capability(robot, grid.poses).force >= 0.0
    classes = np.where(held, 1, 0)
    classes[found.feasible] = 2
    classes[found.usable] = 3
    return classes


def _edges(grid: Grid, axis: int) -> Array:
    centres, size = grid.axes[axis], grid.sizes[axis]
    return np.append(centres - 0.5 * size, centres[-1] + 0.5 * size)


def _draw_slice(
    axes: Axes,
    grid: Grid,
    values: Array,
    usable: NDArray[np.bool_],
    one: tuple[int, int, int, float, str],
    scale: Normalize,
    colors: str,
) -> Any:
    right, up, through = one[:3]
    block = np.take(grid.values(values), 0, axis=through).T
    mask = np.take(grid.values(usable), 0, axis=through).T
    image = axes.pcolormesh(_edges(grid, right), _edges(grid, up), block, cmap=colors, norm=scale)
    hidden = np.isfinite(block) & ~mask
    if hidden.any():
        around = (
            np.concatenate([edges[:1], centres, edges[-1:]])
            for edges, centres in ((_edges(grid, k), grid.axes[k]) for k in (right, up))
        )
        axes.contourf(
            *around,
            np.pad(hidden.astype(float), 1, mode="edge"),
            levels=[0.5, 1.5],
            colors=[(1.0, 1.0, 1.0, 0.55)],
            hatches=["////"],
        )
    axes.set_aspect("equal")
    axes.set_xlabel(AXES[right])
    axes.set_ylabel(AXES[up])
    axes.grid(False)
    return image


def draw_place(axes: Axes, robot: CableRobot, right: int, up: int) -> None:
    """The bay, the doors and the posts, in the plane of two of the world's axes."""
    line: dict[str, Any] = {"color": "black", "linewidth": 1.1}
    ends, sides = BAY_HALF_LENGTH, BAY_RADIUS
    short = np.pi - DOOR_ANGLE
    axis_y, axis_z = sides * (1.0 + np.cos(short)), sides * np.sin(short)
    low, high = axis_z - sides * np.sin(short + 0.5 * np.pi), 0.0
    edge = axis_y + sides * np.sin(short)
    if (right, up) == (0, 1):
        for y in (sides, -sides, edge, -edge):
            axes.plot([-ends, ends], [y, y], **line)
        for x in (-ends, ends):
            axes.plot([x, x], [-edge, edge], **line)
        for x in np.linspace(-ends, ends, 5)[1:-1]:  # between panels
            for side in (1.0, -1.0):
                axes.plot([x, x], [side * sides, side * edge], **{**line, "linewidth": 0.5})
    elif (right, up) == (0, 2):
        axes.plot([-ends, ends, ends, -ends, -ends], [low, low, high, high, low], **line)
    else:
        turn = np.linspace(short, short + 0.5 * np.pi, 40)
        for side in (1.0, -1.0):
            y = side * (axis_y - sides * np.cos(turn))
            axes.plot(y, axis_z - sides * np.sin(turn), **line)
        turn = np.linspace(0.0, np.pi, 60)
        axes.plot(sides * np.cos(turn), -sides * np.sin(turn), **{**line, "linewidth": 0.6})
    posts = np.unique(robot.anchors[:, :2], axis=0)
    if up == 2:
        for at in np.unique(posts[:, right]):
            axes.plot([at, at], [low, robot.anchors[:, 2].max()], color=MUTED_COLOR, linewidth=2.5)
    axes.plot(robot.anchors[:, right], robot.anchors[:, up], "s", color=LIMIT_COLOR, markersize=4.0)
    pad = 0.5
    corners = np.abs(robot.anchors).max(axis=0) + pad
    axes.set_xlim(-corners[right], corners[right])
    axes.set_ylim(*((-corners[1], corners[1]) if up == 1 else (low - pad, corners[2])))


def workspace_figures(
    folder: Path,
    robot: CableRobot,
    obstacles: Sequence[ObstacleBox],
    *,
    disturbance: tuple[float, float],
    cells: float = 0.25,
) -> dict[str, float]:
    """All maps and the volume's slices, into a folder; returns volumes by class, m3.

    Args:
        disturbance: force and moment along and about every axis, N and N m.
    """
    study = Study(
        disturbance_force=disturbance[0],
        disturbance_moment=disturbance[1],
        obstacles=obstacles,
        parts=["clearances"],
    )
    for quantity in QUANTITIES:
        map_figure(folder / f"map_{quantity}.png", robot, quantity, study=study, cells=cells)
    return volume_figure(folder / "volume.png", robot, study=study, cells=2.0 * cells)
