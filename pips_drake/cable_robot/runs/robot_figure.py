"""A cable robot drawn: frame, platform, cables coloured by their tensions."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pips_drake.cable_robot.kinematics import Poses, cable_vectors
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.twin.figures import LIMIT_COLOR, MUTED_COLOR, figure_style, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

#: Views: title, and which of the world's axes go to the right and up.
_VIEWS = (("from above", 0, 1), ("from the side", 0, 2), ("along x", 1, 2))
_EDGES = [
    (a, b)
    for a, b in itertools.combinations(range(8), 2)
    if bin(a ^ b).count("1") == 1
]  # fmt: skip


def robot_figure(
    robot: CableRobot,
    poses: Poses,
    pose: int,
    *,
    tensions: Array,
    motion: Array | None = None,
    title: str = "",
) -> Figure:
    """One pose, in its plane or in three views; cables that would have to push are dashed and red.

    Args:
        tensions: (M,) N.
        motion: a twist (freedom,) that slackens cables, drawn in the plane if it is finite.
    """
    planar = robot.freedom == 3
    views = _VIEWS[:1] if planar else _VIEWS
    with figure_style():
        figure = new_figure(6.6 if planar else 7.6, title=title)
        if planar:
            grid = [figure.subplots(1, 1)]
        else:
            layout = figure.add_gridspec(2, 2)
            places = (layout[0, 0], layout[1, 0], layout[1, 1])
            grid = [figure.add_subplot(place) for place in places]
        largest = max(float(np.abs(tensions).max()), 1e-300)
        for axes, (words, right, up) in zip(grid, views, strict=True):
            draw_robot(axes, robot, poses, pose, right, up, tensions=tensions / largest)
            axes.set_title("in its plane" if planar else words)
            if planar and motion is not None and np.all(np.isfinite(motion)):
                _draw_motion(axes, poses.position[pose], motion)
        _add_list(figure, grid, robot, tensions, planar)
    return figure


def draw_robot(
    axes: Axes,
    robot: CableRobot,
    poses: Poses,
    pose: int,
    right: int,
    up: int,
    *,
    tensions: Array | None = None,
) -> None:
    """Draws one view into axes.

    Args:
        right, up: which of the world's axes these are.
        tensions: (M,), 1 the largest: thickness of the cables; below 0 they would push.
    """
    vectors, arms = cable_vectors(robot, poses)
    inner = poses.position[pose] + arms[pose]
    outer = inner + vectors[pose]
    shares = np.ones(robot.cables) if tensions is None else tensions
    for cable in range(robot.cables):
        pushes = shares[cable] < -1e-9
        ends = np.array([inner[cable], outer[cable]])
        axes.plot(
            ends[:, right],
            ends[:, up],
            color=LIMIT_COLOR if pushes else "#0072B2",
            linestyle="--" if pushes else "-",
            linewidth=0.8 + 2.2 * min(abs(float(shares[cable])), 1.0),
            zorder=3,
        )
        place = 0.7 * ends[0] + 0.3 * ends[1]
        axes.annotate(
            str(cable + 1),
            (place[right], place[up]),
            fontsize=7.5,
            horizontalalignment="center",
            verticalalignment="center",
            bbox={"boxstyle": "round,pad=0.12", "facecolor": "white", "edgecolor": "none"},
            zorder=5,
        )
    axes.plot(outer[:, right], outer[:, up], "s", color="black", markersize=5.0, zorder=4)
    corners = poses.position[pose] + _corners(robot) @ poses.rotation[pose].T
    for a, b in _EDGES:
        axes.plot(corners[[a, b], right], corners[[a, b], up], color=MUTED_COLOR, linewidth=1.2)
    axes.plot(inner[:, right], inner[:, up], "o", color=MUTED_COLOR, markersize=3.5, zorder=4)
    axes.set_aspect("equal")
    axes.margins(0.08)
    axes.set_xlabel(f"{'xyz'[right]} (m)")
    axes.set_ylabel(f"{'xyz'[up]} (m)")


def _corners(robot: CableRobot) -> Array:
    """Corners of the platform's box; of a planar one, the square through its attachments."""
    signs = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
    if robot.freedom == 3:
        # Figure 1's platform is a square that stands on a corner.
        points = robot.attachments
        around = np.argsort(np.arctan2(points[:, 1], points[:, 0]))
        if len(points) == 4:
            a, b, c, d = points[around]
            return np.array([a, a, b, b, d, d, c, c])
    return signs * robot.box


def _draw_motion(axes: Axes, centre: Array, motion: Array) -> None:
    turn = float(motion[2])
    angles = np.linspace(0.3, 0.3 + np.sign(turn) * 1.6, 30)
    arc = centre[:2] + 0.45 * np.column_stack([np.cos(angles), np.sin(angles)])
    axes.plot(arc[:, 0], arc[:, 1], color=LIMIT_COLOR, linewidth=1.8)
    axes.annotate(
        "",
        tuple(arc[-1]),
        tuple(arc[-4]),
        arrowprops={"arrowstyle": "-|>", "color": LIMIT_COLOR, "linewidth": 1.8},
    )
    way = "counter-clockwise" if turn > 0.0 else "clockwise"
    axes.annotate(
        f"turning {way} makes\nno cable longer",
        (centre[0], centre[1]),
        textcoords="offset points",
        xytext=(0.0, -16.0),
        horizontalalignment="center",
        color=LIMIT_COLOR,
        fontsize=8.0,
    )


def _add_list(
    figure: Figure, grid: list[Any], robot: CableRobot, tensions: Array, planar: bool
) -> None:
    lines = [f"cable {k + 1}: {value + 0.0:9.4g} N" for k, value in enumerate(tensions)]
    pushed = np.any(tensions < -1e-9)
    if pushed:
        lines += ["", "dashed: would have to push"]
    text = "\n".join(["tensions that miss least" if pushed else "tensions", *lines])
    if planar:
        grid[0].text(1.03, 0.98, text, transform=grid[0].transAxes, va="top", family="monospace")
    else:
        axes = figure.add_subplot(2, 2, 2)
        axes.set_axis_off()
        axes.text(0.05, 0.95, text, va="top", family="monospace", fontsize=9.0)
