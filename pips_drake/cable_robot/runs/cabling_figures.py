"""Figures of what a cable robot is chosen by: its cabling, and what its cables are made of."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch, Rectangle

from pips_drake.cable_robot.cablings import CablingRow, best_cabling, survey_poses
from pips_drake.cable_robot.kinematics import Poses, cable_vectors, make_poses
from pips_drake.cable_robot.materials import MaterialRow, recommend_material
from pips_drake.cable_robot.runs.workspace_figures import AXES, draw_place
from pips_drake.twin.figures import COLORS, figure_style, new_figure, save_figure


def cablings_figure(file: Path, rows: Sequence[CablingRow]) -> None:
    """Measures of candidate cablings as small multiples; the best one in another colour."""
    best = best_cabling(rows)
    names = [
        f"{row.name.replace('_', ' ')}\n{row.frame.upper:g} / {row.frame.lower:g} m" for row in rows
    ]
    measures: list[tuple[str, list[float], bool, str]] = [
        ("Usable poses (%)", [100.0 * row.usable for row in rows], False, "{:.0f}"),
        ("Disturbances borne (%)", [100.0 * row.feasible for row in rows], False, "{:.0f}"),
        (
            "Least distance (mm)",
            [1e3 * min(row.cable_cable, row.cable_obstacle) for row in rows],
            False,
            "{:.0f}",
        ),
        ("Largest tension (N)", [row.tension for row in rows], False, "{:.0f}"),
        (
            "Position error (mm)",
            [1e3 * r.position_error for r in rows],
            True,
            "{:.1f}",
        ),
        ("Aim error (mm)", [1e3 * r.point_error for r in rows], True, "{:.1f}"),
        ("Softest stiffness (kN/m)", [1e-3 * row.softest for row in rows], True, "{:.2g}"),
        ("Moment borne (N m)", [max(row.moment, 0.0) for row in rows], False, "{:.1f}"),
    ]
    with figure_style():
        figure = new_figure(
            0.62 * len(rows) + 2.6,
            title="Cablings over the survey's poses (anchors' heights: upper / lower); errors: "
            "lengths wrong by 1 mm",
        )
        cells = figure.subplots(2, 4, sharey=True)
        places = np.arange(len(rows))
        for axes, (title, values, log, text) in zip(cells.ravel(), measures, strict=True):
            colors = [COLORS[2] if row is best else "#B0B8C0" for row in rows]
            axes.barh(places, values, color=colors, height=0.7)
            axes.set_title(title, fontsize=8.5)
            if log:
                axes.set_xscale("log")
                axes.set_xlim(left=0.3 * min(values))
            largest = max(values) if np.isfinite(max(values)) else 1.0
            axes.set_xlim(right=largest * (6.0 if log else 1.28))
            for place, value in zip(places, values, strict=True):
                axes.annotate(
                    text.format(value),
                    (value, place),
                    xytext=(3, 0),
                    textcoords="offset points",
                    verticalalignment="center",
                    fontsize=7.5,
                )
            axes.set_yticks(places, names, fontsize=7.5)
            axes.grid(False, axis="y")
        cells[0, 0].invert_yaxis()
        save_figure(figure, file)


def cabling_plans_figure(file: Path, rows: Sequence[CablingRow]) -> None:
    """Each cabling, in the best of its frames, with the platform low over the starboard panels.

    From above, across, and the platform from above.
    """
    names = list(dict.fromkeys(row.name for row in rows))
    chosen = [best_cabling([row for row in rows if row.name == name]) for name in names]
    poses, looking = survey_poses(3, 3)
    here = np.flatnonzero(looking & (poses.position[:, 1] > 0.0))
    lowest = here[np.argmin(poses.position[here, 2] + 1e-3 * np.abs(poses.position[here, 0]))]
    pose = make_poses(poses.position[lowest])
    with figure_style():
        figure = new_figure(
            7.4, title="Cablings: platform low over the starboard panels, amidships"
        )
        cells = figure.subplots(3, len(chosen), squeeze=False, height_ratios=[0.75, 0.75, 1.0])
        for (above, across, near), row in zip(cells.T, chosen, strict=True):
            for axes, right, up in ((above, 0, 1), (across, 1, 2), (near, 0, 1)):
                draw_place(axes, row.robot, right, up)
                _draw_cables(axes, row, pose, right, up)
                axes.set_aspect("equal")
                axes.set_xlabel(AXES[right])
                axes.grid(False)
            x, y, _ = pose.position[0]
            near.set_xlim(x - 0.8, x + 0.8)
            near.set_ylim(y - 0.8, y + 0.8)
            near.set_title("the platform from above")
            above.set_title(row.name.replace("_", " "))
            across.set_title(
                f"anchors {row.frame.upper:g} / {row.frame.lower:g} m:\n"
                f"usable at {100.0 * row.usable:.0f} %"
            )
        for axes, label in zip(cells[:, 0], (AXES[1], AXES[2], AXES[1]), strict=True):
            axes.set_ylabel(label)
        figure.legend(
            handles=[
                Patch(color=COLORS[0], label="cables to upper anchors"),
                Patch(color=COLORS[1], label="to lower anchors; dashed: from lower vertices"),
            ],
            loc="outside lower left",
            ncols=2,
        )
        save_figure(figure, file)


def materials_figure(file: Path, rows: Sequence[MaterialRow]) -> None:
    """What each material adds to the longest cable's length error, part by part."""
    best = recommend_material(rows)
    with figure_style():
        figure = new_figure(0.55 * len(rows) + 2.0)
        axes = figure.subplots()
        axes.set_title(
            f"Errors of the longest cable's length by material, ropes of E A >= "
            f"{min(row.axial_stiffness for row in rows) / 1e3:.0f} kN; recommended: "
            f"{best.material.name}"
        )
        places, start = np.arange(len(rows)), np.zeros(len(rows))
        for name, part, color in (
            ("sag, if neglected", "sag_error", COLORS[0]),
            ("stretch, unknown share", "stretch_error", COLORS[1]),
            ("heat", "thermal_error", COLORS[4]),
            ("creep of a day", "creep_error", COLORS[3]),
        ):
            values = np.array([1e3 * getattr(row, part) for row in rows])
            axes.barh(places, values, left=start, label=name, color=color, height=0.65)
            start += values
        for place, row, end in zip(places, rows, start, strict=True):
            bends = "" if row.material.bends else "; not for winches"
            axes.annotate(
                f"{end:.1f} mm ({1e3 * row.diameter:.1f} mm rope, "
                f"{1e3 * row.mass_per_length:.0f} g/m{bends})",
                (end, place),
                xytext=(4, 0),
                textcoords="offset points",
                verticalalignment="center",
                fontsize=8.0,
            )
        axes.set_yticks(places, [row.material.name for row in rows])
        axes.invert_yaxis()
        axes.set_xlabel("error of the longest cable's length (mm)")
        axes.set_xlim(right=1.45 * start.max())
        axes.grid(False, axis="y")
        axes.legend(loc="lower right")
        save_figure(figure, file)


def _draw_cables(axes: Axes, row: CablingRow, pose: Poses, right: int, up: int) -> None:
    """Cables and platform; lower things first, so that what is above covers them."""
    robot = row.robot
    vectors, arms = cable_vectors(robot, pose)
    inner = pose.position[:, None] + arms
    upper = robot.anchors[:, 2] > 0.5 * (row.frame.upper + row.frame.lower)
    corner = pose.position[0] - 0.5 * robot.box
    axes.add_patch(
        Rectangle(
            (float(corner[right]), float(corner[up])),
            float(robot.box[right]),
            float(robot.box[up]),
            facecolor="#BBBBBB",
            edgecolor="black",
        )
    )
    for cable in np.argsort(inner[0, :, 2]):
        ends = np.array([inner[0, cable], inner[0, cable] + vectors[0, cable]])
        style = "-" if inner[0, cable, 2] > pose.position[0, 2] else "--"
        color = COLORS[0] if upper[cable] else COLORS[1]
        axes.plot(ends[:, right], ends[:, up], style, color=color, linewidth=1.0)
