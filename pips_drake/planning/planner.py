"""From a goal to a motion that the arm can follow: grid search, string, snake, follow-the-leader.

A path of cells around the obstacles (`grid_search`) is pulled tight (`string_pull`) and laid down
as a snake, which moves away from obstacles and becomes smooth; the snake is the path of the tip,
and follow-the-leader says whether every link can follow. The path begins with the base line, on
which the arm stands while it is drawn back, and goes straight on for a lead beyond the home tip.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.planning.grid_search import GridPath, find_path
from pips_drake.planning.occupancy import Occupancy
from pips_drake.planning.potential_field import Repulsion
from pips_drake.planning.snake import (
    SnakeSettings,
    curvatures,
    link_curvature_limit,
    make_snake,
    nail,
)
from pips_drake.planning.snake_motion import Settled, settle
from pips_drake.planning.string_pull import pull
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.anchoring import anchor_path
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.plan import Plan, make_plan
from pips_drake.serpentine.tip_path import blended_path

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class PlannerSettings:
    """How a planner goes about it.

    Attributes:
        lead: how far the path goes straight on from the home tip, m.
        snake: what the snake is made of.
        repulsion: of the obstacles. Its strength over the snake's tension says how much length is
            given for how much distance.
        blend: over which shapes of a body are blended for the snake, m.
    """

    lead: float = 0.5
    snake: SnakeSettings = field(default_factory=lambda: SnakeSettings(bending_stiffness=0.3))
    repulsion: Repulsion = field(
        default_factory=lambda: Repulsion(strength=0.1, reach=0.3, clamp=0.03)
    )
    blend: float = 0.02

    def __post_init__(self) -> None:
        if not (math.isfinite(self.lead) and self.lead > 0.0):
            raise InputError(f"planner lead = {self.lead} m; must be > 0")


@dataclass(frozen=True, kw_only=True, eq=False)
class GoalPlan:
    """What a planner made of a goal.

    Attributes:
        found: the path of cells, from the lead's end.
        pulled: the same pulled tight, (N, 3) m.
        settled: the snake, from the home tip.
        points: the path of the tip, (P, 3) m: row 0 the base end of the base line, row 1 the home
            tip, as a path file has them.
        plan: the arm's postures along it, and why it cannot follow if it cannot.
        curvature_excess: largest curvature over what links of the arm's mean length can follow.
    """

    found: GridPath
    pulled: Array
    settled: Settled
    points: Array
    plan: Plan
    curvature_excess: float


def plan_to_goal(
    arm: SerpentineArm,
    occupancy: Occupancy,
    goal: ArrayLike,
    *,
    home_tip: ArrayLike | None = None,
    settings: PlannerSettings | None = None,
) -> GoalPlan:
    """A path of the tip from home to a goal, and the arm's postures along it.

    Args:
        occupancy: of the workspace, which the lead's end is in; its radius is the arm's.
        goal: (3,) m in frame {0}, the occupancy's world.
        home_tip: where the path begins, (3,) m; the arm's own by default. Only an arm whose rail is
            placed for the path can begin elsewhere, and only along z0.

    Raises:
        InputError: goal or lead outside the workspace or too near to an obstacle; no number.
        NoPathError: there is no way, and what is in it.
    """
    settings = settings or PlannerSettings()
    at_home = kinematics.spine_points(arm, arm.joint_home)[0]
    along = (at_home[-1] - at_home[0]) / np.linalg.norm(at_home[-1] - at_home[0])
    tip = at_home[-1] if home_tip is None else np.asarray(home_tip, dtype=np.float64)
    if tip.shape != (3,) or not np.isfinite(tip).all():
        raise InputError(f"home tip = {home_tip!r}; must be three finite numbers, m")
    lead = tip + settings.lead * along
    found = find_path(occupancy, lead, goal)
    pulled = pull(occupancy.field, found.points, occupancy.radius)
    snake = nail(make_snake(np.vstack([tip, pulled]), settings.snake), lead)

    def distances(points: Array) -> tuple[Array, Array]:
        return occupancy.field.blended(
            points, blend=settings.blend, within=settings.repulsion.reach
        )

    settled = settle(snake, distances, settings.repulsion)
    # The base end of the base line: as far back as the spine reaches at home.
    base = tip - (np.linalg.norm(at_home[-1] - at_home[0]) + arm.average_module_length[0]) * along
    points = np.vstack([base, settled.snake.points])
    path, _ = anchor_path(arm, blended_path(points, "planned"))
    # The base's joints bend another way, and the last turns the camera.
    hinges = slice(arm.first_actuated_joint, arm.joints - 1)
    bend = min(arm.joint_upper[hinges].min(), -arm.joint_lower[hinges].max())
    limit = link_curvature_limit(float(arm.average_module_length.mean()), float(bend))
    return GoalPlan(
        found=found,
        pulled=pulled,
        settled=settled,
        points=points,
        plan=make_plan(arm, path),
        curvature_excess=float(curvatures(settled.snake.points).max() / limit),
    )
