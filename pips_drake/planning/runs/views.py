"""Three views of a plan in one figure: in three dimensions, along the axis, and the gap unfolded.

They are CMU-92's displays. What is drawn of the scene and of the arm is what collides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.planning.occupancy import Occupancy
from pips_drake.planning.runs.outlines import (
    BODY_COLORS,
    DrawnShape,
    arm_corners,
    drawn_shapes,
    polygon,
    unfolded_line,
    unfolded_marks,
    unfolded_picture,
    unfolded_polygons,
    unfolding,
)
from pips_drake.scene.meshes import convex_hull
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.twin.figures import COLORS, figure_style, new_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

#: Of paths, in their order; alternatives take the next ones.
PATH_COLORS = (COLORS[1], COLORS[2], COLORS[3], COLORS[0], COLORS[5])
ARM_COLOR, GOAL_COLOR = "#16324f", COLORS[4]
# Edges of what stands around a workspace.
_FAR: dict[str, Any] = {"linewidths": 0.3, "alpha": 0.4}
#: The first of several postures is drawn with this opacity, the last fully.
FAINTEST = 0.18


@dataclass(frozen=True, kw_only=True, eq=False)
class ViewedPath:
    """A path to draw.

    Attributes:
        points: (N, 3) m in frame 0.
        label: for the legend.
        alternative: drawn dashed, as one that was not taken.
    """

    points: ArrayLike
    label: str = "path of the tip"
    alternative: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class _Scene:
    """What all three views draw, in the grid's frame; bodies and boxes of the arm in frame 0."""

    occupancy: Occupancy
    shapes: list[DrawnShape]
    paths: list[tuple[Array, dict[str, Any]]]
    postures: list[tuple[Array, float]]
    goals: Array

    def local(self, points: Array) -> Array:
        grid = self.occupancy.grid.arrays
        rows: Array = (points - grid.origin) @ grid.rotation
        return rows


def draw_views(
    file: Path,
    *,
    occupancy: Occupancy,
    arm: SerpentineArm,
    paths: Sequence[ViewedPath] = (),
    postures: ArrayLike | None = None,
    shift: float = 0.0,
    goals: ArrayLike = (),
    title: str = "",
) -> None:
    """Draws a plan from three sides.

    Args:
        file: a PNG file.
        occupancy: of the workspace: what is drawn is its part of the scene. In one that is a box
            the third view unfolds what is around its widest upright cylinder, and without one it is
            a side view.
        paths: of the tip, and others that were not taken.
        postures: of the arm, (K, joints) m and rad, from faint to strong.
        shift: of the arm's frame {0} along z0, m (`anchor_path` has it).
        goals: (G, 3) m in frame 0; numbered if there are several.
        title: of the figure.
    """
    scene = _make_scene(occupancy, arm, paths, postures, shift, goals)
    first = scene.paths[-1][0][0] if scene.paths else None
    unfolded = unfolding(occupancy, middle=first)
    with figure_style():
        figure = new_figure(9.2, title=title)
        layout = figure.add_gridspec(2, 2, width_ratios=(1.25, 1.0), height_ratios=(1.3, 1.0))
        space: Any = figure.add_subplot(layout[0, 0], projection="3d")
        _draw_space(space, scene)
        top = figure.add_subplot(layout[0, 1])
        _draw_flat(top, scene, (0, 1), "Along the axis")
        flat = figure.add_subplot(layout[1, :])
        if unfolded is not None:
            _draw_unfolded(flat, scene, unfolded)
        else:
            _draw_flat(flat, scene, (2, 0), "From the side")
        handles = _legend(scene)
        figure.legend(handles=handles, loc="outside lower center", ncols=min(8, len(handles)))
        save_figure(figure, file)


def _make_scene(
    occupancy: Occupancy,
    arm: SerpentineArm,
    paths: Sequence[ViewedPath],
    postures: ArrayLike | None,
    shift: float,
    goals: ArrayLike,
) -> _Scene:
    styled = []
    for k in range(len(paths)):
        style: dict[str, Any] = {
            "color": PATH_COLORS[k % len(PATH_COLORS)],
            "linewidth": 1.3 if paths[k].alternative else 2.0,
            "linestyle": "--" if paths[k].alternative else "-",
            "label": paths[k].label,
            # Those that were not taken lie below.
            "zorder": 4 if paths[k].alternative else 5,
        }
        styled.append((np.asarray(paths[k].points, dtype=np.float64), style))
    drawn = []
    if postures is not None and np.size(postures):
        joints = np.atleast_2d(np.asarray(postures, dtype=np.float64))
        corners, boxes = arm_corners(arm, joints, shift=shift)
        strength = np.linspace(FAINTEST, 0.95, len(joints)) if len(joints) > 1 else [0.95]
        drawn = [(corners[k][boxes], float(strength[k])) for k in range(len(joints))]
    return _Scene(
        occupancy=occupancy,
        shapes=drawn_shapes(occupancy.field, occupancy.grid),
        paths=styled,
        postures=drawn,
        goals=np.asarray(goals, dtype=np.float64).reshape(-1, 3),
    )


def _box(scene: _Scene) -> tuple[Array, Array]:
    """Corners of the workspace in the grid's frame, (3,) m."""
    grid = scene.occupancy.grid
    if not grid.unfolded:
        return grid.lower, grid.upper
    out = grid.upper[2]
    return np.array([-out, -out, grid.lower[0]]), np.array([out, out, grid.upper[0]])


def _draw_space(axes: Any, scene: _Scene) -> None:
    """In three dimensions; what stands around the workspace is drawn by its edges."""
    from matplotlib.ticker import MaxNLocator
    from mpl_toolkits.mplot3d.art3d import (  # type: ignore[import-untyped]
        Line3DCollection,
        Poly3DCollection,
    )

    axes.computed_zorder = False  # paths lie above the arm, and that above what can be seen through
    low, high = _box(scene)
    # The long way lies to the right if it is much longer than the others; else it goes up.
    lying = bool(high[2] - low[2] > 1.5 * max(high[:2] - low[:2]))
    turn = [2, 0, 1] if lying else [0, 1, 2]
    slack = 0.3

    def shown(points: Array) -> Array:
        return points[..., turn]

    for shape in scene.shapes:
        color = BODY_COLORS[shape.body % len(BODY_COLORS)]
        edges = _clipped(shape.edges, low - slack, high + slack)
        if len(edges):
            look = {"linewidths": 0.5, "alpha": 0.9} if shape.inside else _FAR
            axes.add_collection3d(Line3DCollection(shown(edges), colors=color, zorder=1, **look))
        middle = 0.5 * (shape.hull.vertices.min(axis=0) + shape.hull.vertices.max(axis=0))
        if shape.inside and ((middle >= low - 1.0) & (middle <= high + 1.0)).all():
            vertices = np.clip(shape.hull.vertices, low - slack, high + slack)
            faces = Poly3DCollection(
                shown(vertices[shape.hull.triangles]), facecolors=color, zorder=2
            )
            faces.set_alpha(0.16)
            axes.add_collection3d(faces)
    for corners, opacity in scene.postures:
        faces_of_arm = []
        for box in scene.local(corners):
            hull = convex_hull(box)
            if hull is not None and ((box >= low - 1.5) & (box <= high + 1.5)).all():
                faces_of_arm.append(shown(hull.corners))
        if faces_of_arm:
            arm = Poly3DCollection(np.concatenate(faces_of_arm), facecolors=ARM_COLOR, zorder=3)
            arm.set_alpha(opacity)
            axes.add_collection3d(arm)
    for points, style in scene.paths:
        p = shown(_kept(scene.local(points), low - slack, high + slack))
        axes.plot(*p.T, **style)
    for number, goal in enumerate(shown(scene.local(scene.goals)), 1):
        axes.plot(*goal[:, None], "*", color=GOAL_COLOR, markersize=11, zorder=6)
        if len(scene.goals) > 1:
            axes.text(*goal, f" {number}", fontsize=9, fontweight="bold", zorder=7)
    low, high = shown(low), shown(high)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(high - low, zoom=1.05)
    names = [f"{name}, m" for name in shown(np.array(["x0", "y0", "z0"]))]
    axes.set_xlabel(names[0], labelpad=8.0 if lying else 0.0)
    axes.set_ylabel(names[1])
    if lying:  # beside the axis there is no room
        axes.text2D(1.01, 0.71, names[2], transform=axes.transAxes, ha="center")
    else:
        axes.set_zlabel(names[2])
    axes.view_init(elev=22.0, azim=-62.0 if lying else -125.0)
    axes.tick_params(labelsize=7, pad=0)
    axes.set_title("In three dimensions", loc="left")
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MaxNLocator(nbins=5, integer=True))


def _draw_flat(axes: Axes, scene: _Scene, plane: tuple[int, int], title: str) -> None:
    """Seen along one axis of the grid's frame, through everything."""
    low, high = _box(scene)
    (depth,) = {0, 1, 2} - set(plane)
    across = list(plane)
    near = [
        shape
        for shape in scene.shapes
        if shape.hull.vertices[:, depth].min() < high[depth]
        and shape.hull.vertices[:, depth].max() > low[depth]
    ]
    for shape in sorted(near, key=lambda one: float(one.hull.vertices[:, depth].max())):
        outline = polygon(shape.hull.vertices[:, across])
        if not len(outline):
            continue
        color = BODY_COLORS[shape.body % len(BODY_COLORS)]
        size = np.ptp(shape.hull.vertices, axis=0)
        # What is thin hides little: decks, bulkheads.
        share = size[depth] / (high - low)[depth]
        opacity = float(np.interp(share, [0.01, 0.03, 0.06, 1.0], [0.12, 0.2, 0.45, 0.55]))
        axes.fill(*outline.T, facecolor=color, alpha=opacity, edgecolor="none", linewidth=0.0)
        axes.fill(*outline.T, fill=False, edgecolor="#5a6270", linewidth=0.5, alpha=0.7)
    for corners, opacity in scene.postures:
        for box in scene.local(corners):
            outline = polygon(box[:, across])
            axes.fill(*outline.T, facecolor=ARM_COLOR, alpha=opacity, linewidth=0.0, zorder=3)
    for points, style in scene.paths:
        axes.plot(*scene.local(points)[:, across].T, **style)
    _draw_goals(axes, scene.local(scene.goals)[:, across])
    slack = 0.08 if scene.occupancy.grid.unfolded else 0.0  # shows the walls' thickness
    low, high = low - slack, high + slack
    axes.set(xlim=(low[plane[0]], high[plane[0]]), ylim=(low[plane[1]], high[plane[1]]))
    axes.set_aspect("equal")
    words = ("x", "y", "z")
    where = "" if not scene.occupancy.grid.unfolded else " from the axis"
    axes.set_xlabel(f"{words[plane[0]]}0{where}, m")
    axes.set_ylabel(f"{words[plane[1]]}0{where}, m")
    axes.set_title(title)
    axes.grid(False)


def _draw_unfolded(axes: Axes, scene: _Scene, unfolded: Occupancy) -> None:
    """The gap flat: along it to the right, around it upwards."""
    grid = unfolded.grid
    degrees = np.degrees([grid.lower[1], grid.upper[1]])
    axes.imshow(
        unfolded_picture(unfolded),
        origin="lower",
        extent=(grid.lower[0], grid.upper[0], *degrees),
        aspect="auto",
        interpolation="nearest",
    )
    for corners, opacity in scene.postures:
        for box in corners:
            for outline in unfolded_polygons(grid, box):
                axes.fill(*outline.T, facecolor=ARM_COLOR, alpha=opacity, linewidth=0.0, zorder=3)
    for points, style in scene.paths:
        axes.plot(*unfolded_line(grid, points).T, **style)
    _draw_goals(axes, *unfolded_marks(grid, scene.goals))
    axes.set(xlim=(grid.lower[0], grid.upper[0]), ylim=tuple(degrees))
    axes.set_yticks(np.arange(60.0 * np.ceil(degrees[0] / 60.0 - 1e-9), degrees[1] + 1e-6, 60.0))
    axes.set_xlabel("along the axis (z0), m")
    axes.set_ylabel("around it from x0, deg")
    room = round(2e3 * unfolded.radius)
    axes.set_title(
        f"The gap unfolded: coloured where {room} mm of arm have no room, pale where they have less"
    )
    axes.grid(False)


def _draw_goals(axes: Axes, goals: Array, which: NDArray[np.int64] | None = None) -> None:
    numbers = np.arange(len(goals)) if which is None else which
    for number, goal in zip(numbers + 1, goals, strict=True):
        axes.plot(
            *goal[:, None],
            "*",
            color=GOAL_COLOR,
            markersize=12,
            markeredgecolor="black",
            markeredgewidth=0.5,
            zorder=6,
            clip_on=False,
        )
        if numbers.max() > 0:
            axes.annotate(
                str(number),
                goal,
                textcoords="offset points",
                xytext=(7, 3),
                fontweight="bold",
                zorder=7,
            )


def _legend(scene: _Scene) -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [Line2D([], [], **style) for _, style in scene.paths]
    if scene.postures:
        handles.append(Patch(facecolor=ARM_COLOR, label="arm"))
    if len(scene.goals):
        mark: dict[str, Any] = {
            "marker": "*",
            "color": GOAL_COLOR,
            "markersize": 10,
            "linestyle": "",
        }
        handles.append(Line2D([], [], label="goals" if len(scene.goals) > 1 else "goal", **mark))
    shown = sorted({shape.body for shape in scene.shapes})
    names = scene.occupancy.field.bodies
    handles += [
        Patch(facecolor=BODY_COLORS[k % len(BODY_COLORS)], label=names[k].split("::")[-1])
        for k in shown
    ]
    return handles


def _clipped(edges: Array, low: Array, high: Array) -> Array:
    """Edges (E, 2, 3) cut at a box; those outside are left out."""
    kept = []
    for a, b in edges:
        first, last = 0.0, 1.0
        for k in range(3):
            step = b[k] - a[k]
            if abs(step) < 1e-12:
                if not low[k] <= a[k] <= high[k]:
                    last = -1.0
                continue
            one, other = sorted(((low[k] - a[k]) / step, (high[k] - a[k]) / step))
            first, last = max(first, one), min(last, other)
        if last > first:
            kept.append((a + first * (b - a), a + last * (b - a)))
    return np.array(kept).reshape(-1, 2, 3)


def _kept(points: Array, low: Array, high: Array) -> Array:
    """A line's points, NaN where they are outside a box."""
    inside = ((points >= low) & (points <= high)).all(axis=1)
    return np.where(inside[:, None], points, np.nan)
