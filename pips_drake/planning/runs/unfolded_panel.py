"""The gap unfolded, for a motion's page: the arm moves in it as it does in three dimensions."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.math import RigidTransform

from pips_drake.planning.grid import Grid
from pips_drake.planning.occupancy import Occupancy
from pips_drake.planning.runs.outlines import (
    unfolded_line,
    unfolded_marks,
    unfolded_picture,
    unfolding,
)
from pips_drake.planning.runs.views import ARM_COLOR, GOAL_COLOR, PATH_COLORS, ViewedPath
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.twin.rendering import FIELD_OF_VIEW
from pips_drake.twin.replay_panel import CameraView, PanelLine, ReplayPanel

Array = NDArray[np.float64]

#: Postures in a page, at most.
_MOST = 300


def unfolded_panel(
    occupancy: Occupancy,
    arm: SerpentineArm,
    *,
    times: ArrayLike,
    joints: ArrayLike,
    shift: float = 0.0,
    paths: Sequence[ViewedPath] = (),
    goals: ArrayLike = (),
    X_W0: RigidTransform | None = None,
) -> ReplayPanel | None:
    """The gap unfolded with paths, goals, and the middle of the arm over time.

    Args:
        occupancy: of the workspace; see `draw_views`.
        times, joints: of the motion, (T,) s, (T, joints) m and rad.
        shift: of the arm's frame {0} along z0, m.
        paths: of the tip.
        goals: (G, 3) m in frame 0.
        X_W0: frame 0 in the page's world, for its cameras; the world itself by default.

    Returns:
        None if there is nothing to unfold: a workspace without an upright cylinder.
    """
    first = np.asarray(paths[0].points, dtype=np.float64)[0] if paths else None
    unfolded = unfolding(occupancy, middle=first)
    if unfolded is None:
        return None
    grid = unfolded.grid
    recorded = np.asarray(times, dtype=np.float64)
    count = min(_MOST, len(recorded))
    rows = np.unique(np.linspace(0, len(recorded) - 1, count).round().astype(int))
    placed = np.array([0.0, 0.0, shift])
    spines = kinematics.spine_points(arm, np.asarray(joints, dtype=np.float64)[rows]) + placed
    moving = [unfolded_line(grid, spine, parts=3) for spine in spines]
    lines = [
        PanelLine(
            points=unfolded_line(grid, path.points, parts=2),
            color=PATH_COLORS[k % len(PATH_COLORS)],
            label=path.label,
            dashed=path.alternative,
            width=1.3 if path.alternative else 2.0,
        )
        for k, path in enumerate(paths)
    ]
    marks = np.asarray(goals, dtype=np.float64).reshape(-1, 3)
    if len(marks):
        lines.append(
            PanelLine(
                points=unfolded_marks(grid, marks)[0],
                color=GOAL_COLOR,
                label="goals" if len(marks) > 1 else "goal",
                marker=True,
            )
        )
    low, high = np.degrees([grid.lower[1], grid.upper[1]])
    return ReplayPanel(
        title="The gap unfolded: no room for the arm where coloured, less where pale",
        x_label="along the axis (z0), m",
        y_label="around it, deg",
        x_range=(float(grid.lower[0]), float(grid.upper[0])),
        y_range=(float(low), float(high)),
        picture=unfolded_picture(unfolded),
        lines=lines,
        times=recorded[rows],
        moving=moving,
        moving_color=ARM_COLOR,
        moving_label="arm",
        views=_views(occupancy.grid, X_W0 or RigidTransform()),
        see_through=occupancy.field.bodies,
    )


def _views(grid: Grid, X_W0: RigidTransform) -> list[CameraView]:
    """Cameras around a workspace: obliquely, along its axis, and from x0's side."""
    low, high = grid.lower, grid.upper
    if grid.unfolded:
        out = grid.upper[2]
        low, high = np.array([-out, -out, low[0]]), np.array([out, out, high[0]])
    middle, size = 0.5 * (low + high), high - low
    far = 0.6 / math.tan(0.5 * FIELD_OF_VIEW)
    # Not quite along z0: a camera that turns about the vertical cannot look along it.
    looks = (
        ("3-D", [0.6, -0.75, 0.3], 0.85 * float(np.linalg.norm(size))),
        ("along the axis", [-0.01, 0.0, 1.0], float(max(size[0], size[1])) + float(size[2])),
        ("from the side", [0.0, -1.0, 0.01], float(max(size))),
    )
    views = []
    for label, direction, extent in looks:
        away = np.array(direction) / np.linalg.norm(direction)
        ends = np.vstack([middle + far * extent * away, middle])
        world = (X_W0 @ (ends @ grid.arrays.rotation.T + grid.arrays.origin).T).T
        views.append(CameraView(label=label, eye=world[0], target=world[1]))
    return views
