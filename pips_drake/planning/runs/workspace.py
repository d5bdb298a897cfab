"""A scenario's workspace, loaded: the arm, the scene's distances, the cells it may visit."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pips_drake.errors import InputError
from pips_drake.planning.grid import Grid
from pips_drake.planning.obstacles import Obstacles
from pips_drake.planning.occupancy import Occupancy
from pips_drake.planning.planner import PlannerSettings
from pips_drake.planning.potential_field import Repulsion
from pips_drake.planning.scenario import PlannerScenario, WorkspaceConfig
from pips_drake.planning.snake import SnakeSettings
from pips_drake.scene.obstacles import load_obstacles
from pips_drake.scene.packages import find_arm_file, find_file, find_scene_file
from pips_drake.scene.signed_distance import SignedDistanceField, read_distance_field
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import SerpentineArm, load_arm

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Workspace:
    """Where an arm is to move. Everything is in frame 0 of the scene.

    Attributes:
        occupancy: the cells that its middle may visit; holds grid and distance field too.
        obstacles: placed in the scene.
        home_tip: where its tip is at the beginning, (3,) m.
        scene_file: None if there is no scene; without the obstacles.
    """

    arm: SerpentineArm
    occupancy: Occupancy
    obstacles: Obstacles
    home_tip: Array
    settings: PlannerSettings
    scene_file: Path | None


def load_workspace(
    scenario: PlannerScenario, *, folder: Path | None = None, scene_file: Path | None = None
) -> Workspace:
    """Loads what a scenario names; relative files are looked for in `folder`.

    Args:
        scene_file: stands for the scenario's scene, wherever it lies.

    Raises:
        InputError: a name is unknown, a file cannot be used, or the workspace has too many cells.
    """
    arm = load_arm(find_arm_file(scenario.arm, inside=folder))
    if scene_file is None and scenario.scene:
        scene_file = find_scene_file(scenario.scene, inside=folder)
    field = SignedDistanceField.of([])
    if scene_file is not None:
        field = read_distance_field(scene_file)
    placed = list(scenario.obstacles)
    if scenario.obstacles_file:
        placed += load_obstacles(_find_obstacles(scenario.obstacles_file, folder))
    obstacles = Obstacles.of(field, placed)
    radius = scenario.workspace.arm_radius_mm * 1e-3
    tip = np.array(scenario.home_tip_m) if scenario.home_tip_m else _home_tip(arm)
    return Workspace(
        arm=arm,
        occupancy=Occupancy.of(obstacles.field, make_grid(scenario.workspace), radius),
        obstacles=obstacles,
        home_tip=tip,
        settings=planner_settings(scenario),
        scene_file=scene_file,
    )


def make_grid(config: WorkspaceConfig) -> Grid:
    """The cells of a workspace: as large as wanted, or a little smaller so that they fill it.

    Raises:
        InputError: there would be too many of them.
    """
    cell = config.cell_mm * 1e-3
    origin = None
    if config.kind == "unfolded":
        ranges = [config.along_m, np.radians(config.around_deg).tolist(), config.out_m]
        middle = 0.5 * sum(config.out_m)
        sizes = [cell, cell / middle, cell]
        origin = np.array([*config.axis_m, 0.0])
    else:
        ranges = [list(pair) for pair in zip(config.lower_m, config.upper_m, strict=True)]
        sizes = [cell] * 3
    counts = [
        max(1, math.ceil((high - low) / size - 1e-9))
        for (low, high), size in zip(ranges, sizes, strict=True)
    ]
    try:
        return Grid(
            lower=np.array([low for low, _ in ranges]),
            upper=np.array([high for _, high in ranges]),
            shape=(counts[0], counts[1], counts[2]),
            unfolded=config.kind == "unfolded",
            origin=origin,
        )
    except InputError as error:
        raise InputError(f"workspace with cells of {config.cell_mm:g} mm: {error}") from None


def planner_settings(scenario: PlannerScenario) -> PlannerSettings:
    """What the planner's own functions want, in SI units."""
    snake = scenario.snake
    return PlannerSettings(
        lead=snake.lead_mm * 1e-3,
        snake=SnakeSettings(
            tension=snake.tension_N,
            bending_stiffness=snake.bending_stiffness_Nm2,
            spacing=snake.spacing_mm * 1e-3,
        ),
        repulsion=Repulsion(
            strength=snake.repulsion_Nm2,
            reach=snake.reach_mm * 1e-3,
            clamp=snake.clamp_mm * 1e-3,
        ),
    )


def _find_obstacles(name: str, folder: Path | None) -> Path:
    return find_file("obstacles", name, inside=folder)


def _home_tip(arm: SerpentineArm) -> Array:
    tip: Array = kinematics.spine_points(arm, arm.joint_home)[0, -1]
    return tip
