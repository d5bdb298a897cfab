"""From a goal to a motion that the arm can follow: grid search, string, snake, follow-the-leader.

A path of cells around the obstacles (`grid_search`) is pulled tight (`string_pull`) and laid down
as a snake, which moves away from obstacles and becomes smooth; the snake is the path of the tip,
and follow-the-leader says whether every link can follow. The path begins with the base line, on
which the arm stands while it is drawn back, and goes straight on for a lead beyond the home tip.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.planning.grid_search import GridPath, find_path
from pips_drake.planning.kept_path import continued_path
from pips_drake.planning.occupancy import Occupancy
from pips_drake.planning.potential_field import Repulsion
from pips_drake.planning.snake import (
    Snake,
    SnakeSettings,
    curvatures,
    link_curvature_limit,
    make_snake,
    nail,
)
from pips_drake.planning.snake_motion import MAX_STEPS, Settled, settle
from pips_drake.planning.string_pull import MOST_ROUNDS, pull
from pips_drake.scene.signed_distance import SignedDistanceField
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.anchoring import anchor_path
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.plan import Plan, make_plan
from pips_drake.serpentine.tip_path import TipPath, blended_path

Array = NDArray[np.float64]

#: Rounds after which a path is nearly tight.
ROUGHLY = 10


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
        found: the path of cells, from the lead's end; None where the route was given.
        pulled: the route that the snake was laid on: the same pulled tight, (N, 3) m.
        settled: the snake, from the home tip, or from where the path that is kept ends.
        points: the path of the tip, (P, 3) m: row 0 the base end of the base line, row 1 the home
            tip, as a path file has them. Of a path that is kept there are points a snake's spacing
            apart: rounded again, they are that path but for millimetres.
        path: the path of the tip itself, in frame_0.
        plan: the arm's postures along it, in its own frame {0}, and why it cannot follow if it
            cannot.
        shift: where the arm's frame {0} stands in frame_0, (3,) m.
        curvature_excess: largest curvature over what links of the arm's mean length can follow.
    """

    found: GridPath | None = None
    pulled: Array
    settled: Settled
    points: Array
    path: TipPath
    plan: Plan
    shift: Array
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

    Nothing is bent for the joints' or the clearance's sake: `feasible.plan_feasibly` does that.

    Args:
        occupancy: of the workspace, which the lead's end is in; its radius is the arm's.
        goal: (3,) m in frame_0, the occupancy's world.
        home_tip: where the path begins, (3,) m; the arm's own by default. Only an arm whose rail is
            placed for the path can begin elsewhere, and only along z0.

    Raises:
        InputError: goal or lead outside the workspace or too near to an obstacle; no number.
        NoPathError: there is no way, and what is in it.
    """
    found, pulled = choose_route(arm, occupancy, goal, home_tip=home_tip, settings=settings)
    made = plan_along(arm, occupancy.field, pulled, home_tip=home_tip, settings=settings)
    return replace(made, found=found)


def choose_route(
    arm: SerpentineArm,
    occupancy: Occupancy,
    goal: ArrayLike,
    *,
    home_tip: ArrayLike | None = None,
    nails: Sequence[ArrayLike] = (),
    settings: PlannerSettings | None = None,
    most_rounds: int = MOST_ROUNDS,
) -> tuple[GridPath, Array]:
    """The shortest way from the lead's end to a goal: over cells, and pulled tight, (N, 3) m.

    Args and raises as of `plan_to_goal` and `route_through`; `nails` are passed on the way, in
    order.
    """
    settings = settings or PlannerSettings()
    tip, along, _ = home_of(arm, home_tip)
    places = [tip + settings.lead * along, *nails, goal]
    return route_through(occupancy, places, most_rounds=most_rounds)


def route_through(
    occupancy: Occupancy, places: Sequence[ArrayLike], *, most_rounds: int = MOST_ROUNDS
) -> tuple[GridPath, Array]:
    """The shortest ways from each place to the next: over cells, and pulled tight, (N, 3) m.

    Args:
        places: two or more, (3,) m each: start, what is to be passed, goal.
        most_rounds: of pulling. `ROUGHLY` is enough where a snake is laid on it, which is tense by
            itself: it takes a tenth of the time, and is some thousandths longer.

    Raises:
        InputError, NoPathError: as of `grid_search.find_path`.
    """
    found = []
    for k, (first, last) in enumerate(pairwise(places), start=1):
        try:
            found.append(find_path(occupancy, first, last))
        except InputError as error:
            if k == len(places) - 1 or not str(error).startswith("goal"):
                raise
            raise InputError(f"nail{str(error).removeprefix('goal')}") from None
    pulled = [
        pull(occupancy.field, way.points, occupancy.radius, most_rounds=most_rounds)
        for way in found
    ]
    if len(found) == 1:
        return found[0], pulled[0]
    whole = GridPath(
        points=np.vstack([found[0].points, *(way.points[1:] for way in found[1:])]),
        cost=sum(way.cost for way in found),
        source=0,
        visited=sum(way.visited for way in found),
    )
    return whole, np.vstack([pulled[0], *(way[1:] for way in pulled[1:])])


def plan_along(
    arm: SerpentineArm,
    field: SignedDistanceField,
    route: ArrayLike,
    *,
    home_tip: ArrayLike | None = None,
    nails: Sequence[ArrayLike] = (),
    keep: TipPath | None = None,
    end_direction: ArrayLike | None = None,
    settings: PlannerSettings | None = None,
) -> GoalPlan:
    """Lays a snake on a route, lets it settle, and follows.

    Args:
        route: (N, 3) m in frame_0, from the lead's end, or from the end of `keep`, to the goal.
        home_tip: as of `plan_to_goal`; where `keep` is given, that has it.
        nails: places that the path goes through, (3,) m each; with `keep`, those beyond it.
        keep: in frame_0, the part of an earlier path on which the arm still lies, having drawn back
            to its end (`kept_path.cut_path`). It stays exactly what it is, and the new path leaves
            it along its tangent: at its end the joints are the same on both.
        end_direction: (3,) along which the path shall arrive; by default it does not matter. The
            stiffer the snake, the nearer it comes to that.

    Raises:
        InputError: a route, a nail or a tip that is not finite or not of its shape.
    """
    laid = lay(
        arm,
        field,
        route,
        home_tip=home_tip,
        nails=nails,
        keep=keep,
        end_direction=end_direction,
        settings=settings or PlannerSettings(),
    )
    return judged(arm, laid, make_plan(arm, anchor_path(arm, laid.path)[0]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Laid:
    """A path that was laid and not yet followed: what `GoalPlan` says of these."""

    route: Array
    settled: Settled
    points: Array
    path: TipPath


def lay(
    arm: SerpentineArm,
    field: SignedDistanceField,
    route: ArrayLike,
    *,
    home_tip: ArrayLike | None = None,
    nails: Sequence[ArrayLike] = (),
    keep: TipPath | None = None,
    end_direction: ArrayLike | None = None,
    settings: PlannerSettings,
    nail_lead: bool = True,
    stiffness: ArrayLike | None = None,
    max_steps: int = MAX_STEPS,
) -> Laid:
    """The path of `plan_along`, without the arm's postures.

    Args:
        nail_lead: whether the route's first point is nailed down, where nothing is kept.
        stiffness: the snake's, N m^2, at equal shares of its length; by default the settings'.
        max_steps: of the snake.
    """
    way = np.asarray(route, dtype=np.float64)
    if way.ndim != 2 or way.shape[1] != 3 or len(way) < 1 or not np.isfinite(way).all():
        raise InputError(f"route of shape {way.shape}; must be (N, 3) finite numbers, m")
    h = settings.snake.spacing
    if keep is None:
        tip, along, base = home_of(arm, home_tip)
        begin, nails = np.stack([tip - h * along, tip]), list(nails)
        if nail_lead and len(way) > 1:
            nails.append(way[0])
        way = np.vstack([tip, way])
    else:
        end, along = keep.point(keep.length), keep.tangent(keep.length)
        begin = np.stack([end, end + h * along])
        # What of the route is nearer than the first point ahead is passed already.
        far = np.linalg.norm(way - end, axis=1) > h
        way = np.vstack([begin[1], way[int(np.argmax(far)) if far.any() else len(way) - 1 :]])
    snake = make_snake(way, settings.snake, bending_stiffness=stiffness)
    after = None
    if end_direction is not None:
        after = snake.points[-1] + h * _unit(end_direction, "end direction")
    snake = _with_ends(snake, begin[0], after)
    for place in nails:
        snake = nail(snake, place)
    reach, blend = settings.repulsion.reach, settings.blend
    settled = settle(
        snake,
        lambda points: field.blended(points, blend=blend, within=reach),
        settings.repulsion,
        max_steps=max_steps,
    )
    points = settled.snake.points[: None if after is None else -1]
    settled = replace(settled, snake=_inner(settled.snake, keep is None, after is not None))
    if keep is None:
        points = np.vstack([base, points[1:]])
        return Laid(route=way, settled=settled, points=points, path=blended_path(points, "planned"))
    path = continued_path(keep, points)
    # As a file has it: the base end, the home tip, and points of what is kept.
    home, length = keep.home_arc_length, keep.length
    count = max(1, math.ceil((length - home) / h))
    kept = keep.point(np.concatenate([[0.0], np.linspace(home, length, count + 1)]))
    if length - home < 1e-9:
        kept = kept[:2]
    return Laid(route=way, settled=settled, points=np.vstack([kept, points[1:]]), path=path)


def judged(arm: SerpentineArm, laid: Laid, plan: Plan) -> GoalPlan:
    """What a path and the postures along it are together."""
    # The base's joints bend another way, and the last turns the camera.
    hinges = slice(arm.first_actuated_joint, arm.joints - 1)
    bend = min(arm.joint_upper[hinges].min(), -arm.joint_lower[hinges].max())
    limit = link_curvature_limit(float(arm.average_module_length.mean()), float(bend))
    return GoalPlan(
        pulled=laid.route,
        settled=laid.settled,
        points=laid.points,
        path=laid.path,
        plan=plan,
        shift=laid.path.point(0.0) - plan.path.point(0.0),
        curvature_excess=float(curvatures(laid.settled.snake.points).max() / limit),
    )


def home_of(arm: SerpentineArm, home_tip: ArrayLike | None) -> tuple[Array, Array, Array]:
    """Home tip (3,) m, the base line's direction (3,), and its base end (3,) m, in frame_0.

    Raises:
        InputError: the home tip is not three finite numbers.
    """
    at_home = kinematics.spine_points(arm, arm.joint_home)[0]
    length = float(np.linalg.norm(at_home[-1] - at_home[0]))
    along = (at_home[-1] - at_home[0]) / length
    tip = at_home[-1] if home_tip is None else np.asarray(home_tip, dtype=np.float64)
    if tip.shape != (3,) or not np.isfinite(tip).all():
        raise InputError(f"home tip = {home_tip!r}; must be three finite numbers, m")
    # As far back as the spine reaches at home.
    return tip, along, tip - (length + arm.average_module_length[0]) * along


def _with_ends(snake: Snake, before: Array, after: Array | None) -> Snake:
    """The snake with a nailed point before it, and one after it: they say where its ends head."""
    points, nailed = np.vstack([before, snake.points]), np.append(True, snake.nailed)
    tension = np.append(snake.tension[0], snake.tension)
    stiffness = np.append(snake.bending_stiffness[0], snake.bending_stiffness)
    if after is not None:
        points, nailed = np.vstack([points, after]), np.append(nailed, True)
        tension = np.append(tension, tension[-1])
        stiffness = np.append(stiffness, stiffness[-1])
    return replace(
        snake, points=points, nailed=nailed, tension=tension, bending_stiffness=stiffness
    )


def _inner(snake: Snake, first: bool, last: bool) -> Snake:
    """The snake without its first point, its last one, or both."""
    rows = slice(1 if first else 0, len(snake.points) - (1 if last else 0))
    return replace(
        snake,
        points=snake.points[rows],
        nailed=snake.nailed[rows],
        tension=snake.tension[rows],
        bending_stiffness=snake.bending_stiffness[rows],
    )


def _unit(direction: ArrayLike, name: str) -> Array:
    way = np.asarray(direction, dtype=np.float64)
    size = float(np.linalg.norm(way)) if way.shape == (3,) else 0.0
    if not (math.isfinite(size) and size > 0.0):
        raise InputError(f"{name} = {direction!r}; must be three finite numbers, not all 0")
    unit: Array = way / size
    return unit
