"""Draws docs/images/planning.png: a plan in the cargo bay's gap, unfolded and end on.

python docs/make_planning.py
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.colors import ListedColormap

from pips_drake.planning.grid import Grid
from pips_drake.planning.occupancy import Occupancy
from pips_drake.planning.planner import GoalPlan, plan_to_goal
from pips_drake.scene.packages import find_scene_file
from pips_drake.scene.signed_distance import read_distance_field
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import load_arm

FILE = Path(__file__).resolve().parent / "images" / "planning.png"
#: Of `cargo_bay`, in frame {0}: the bay's axis, the bulkhead with the port, and the gap's radii.
AXIS = np.array([-1.621, 0.0, 0.0])
BULKHEAD, PAYLOAD, WALL = 4.695, 1.79, 2.277
#: Where the arm's tip is at home, before the port, and where it is to go.
HOME = np.array([0.412877, 0.0, 4.4425])
GOAL = (140.0, 6.5)
#: Of the arm, with a margin, m.
RADIUS = 0.12


def main() -> None:
    """Plans, and draws."""
    field = read_distance_field(find_scene_file("cargo_bay"))
    grid = Grid(
        lower=np.array([4.4, -math.pi, 1.5]),
        upper=np.array([14.0, math.pi, 2.28]),
        shape=(192, 256, 8),
        unfolded=True,
        origin=AXIS,
    )
    occupancy = Occupancy.of(field, grid, RADIUS)
    middle, (around, along) = 0.5 * (PAYLOAD + WALL), (math.radians(GOAL[0]), GOAL[1])
    out = np.array([middle * math.cos(around), middle * math.sin(around), BULKHEAD + along])
    goal = AXIS + out
    arm = load_arm("cmu_92")
    found = plan_to_goal(arm, occupancy, goal, home_tip=HOME)
    shift = HOME - kinematics.spine_points(arm, arm.joint_home)[0, -1]
    spine = kinematics.spine_points(arm, found.plan.joints[-1])[0] + shift
    figure, axes = plt.subplots(
        1, 2, figsize=(12.0, 5.2), width_ratios=(1.75, 1.0), layout="constrained"
    )
    draw_unfolded(axes[0], occupancy, found, spine)
    draw_end_on(axes[1], found, spine)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    figure.savefig(FILE, dpi=110)


def draw_unfolded(axes: plt.Axes, occupancy: Occupancy, found: GoalPlan, spine: np.ndarray) -> None:
    """The gap flat: along the bay, and around it."""
    grid = occupancy.grid
    free = occupancy.free.any(axis=2)
    degrees = np.degrees([grid.lower[1], grid.upper[1]])
    extent = (grid.lower[0] - BULKHEAD, grid.upper[0] - BULKHEAD, *degrees)
    axes.imshow(
        free.T,
        origin="lower",
        extent=extent,
        aspect="auto",
        cmap=ListedColormap(["#c9ccd1", "#ffffff"]),
        interpolation="nearest",
    )
    for points, style, label in lines(found, spine):
        along, around, _ = grid.from_world(points).T
        axes.plot(along - BULKHEAD, np.degrees(around), label=label, **style)
    axes.set_xlabel("along the bay from the port's bulkhead, m")
    axes.set_ylabel("around the payload, deg")
    axes.set_yticks(np.arange(-180, 181, 60))
    axes.set_title("The gap unfolded; grey: no room for the arm", fontsize=11)


def draw_end_on(axes: plt.Axes, found: GoalPlan, spine: np.ndarray) -> None:
    """Seen along the bay's axis."""
    turn = np.linspace(0.0, 2.0 * math.pi, 400)
    for radius in (PAYLOAD, WALL):
        axes.plot(radius * np.cos(turn), radius * np.sin(turn), color="#5a6270", linewidth=1.2)
    for points, style, label in lines(found, spine):
        local = points - AXIS
        axes.plot(local[:, 0], local[:, 1], label=label, **style)
    axes.text(0.0, 0.0, "payload", ha="center", va="center", color="#5a6270")
    axes.set_aspect("equal")
    axes.set_xlabel("x from the bay's axis, m")
    axes.set_ylabel("y, m")
    axes.set_title("Seen along the bay", fontsize=11)


def lines(found: GoalPlan, spine: np.ndarray) -> list[tuple[np.ndarray, dict, str]]:
    """What both views draw."""
    return [
        (found.found.points, {"color": "#8d5fd3", "linewidth": 1.0}, "shortest on the grid"),
        (found.pulled, {"color": "#1a7f64", "linewidth": 1.6}, "pulled tight"),
        (found.settled.snake.points, {"color": "#d1495b", "linewidth": 2.0}, "snake"),
        (
            spine[spine[:, 2] > BULKHEAD - 0.3],
            {"color": "#16324f", "linewidth": 0.0, "marker": "o", "markersize": 4.5},
            "the arm's joints",
        ),
        (found.points[-1:], {"color": "#f2a900", "marker": "*", "markersize": 14}, "goal"),
    ]


if __name__ == "__main__":
    main()
