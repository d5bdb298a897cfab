"""A snake while an operator handles it: one small, bounded move at a time (CMU-92 section 3.7.1).

The operator moves its end (the goal), pulls at points, nails points down and takes nails out, and
tunes its tension and its stiffness. `propose` says where its points would go next; whoever has an
arm on it takes the move whole, in part, or not at all. A part of a move is a move: between where
points are and where they would go everything is straight.

What is repelled is the snake grown by a radius, that of the arm on it: the field that it feels is
the distance less that radius. What the operator asks for is not obeyed blindly: a goal or a nail in
an obstacle, or nearer than its clearance, is refused; on the way there the end and nailed points
slide along what is in between; and points that are told to be somewhere go no farther in a tick
than the tick's limit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.planning.potential_field import DistanceField, Repulsion
from pips_drake.planning.snake import Snake, SnakeSettings, keep_spacing, make_snake
from pips_drake.planning.snake_motion import settle
from pips_drake.scene.signed_distance import SignedDistanceField
from pips_drake.serpentine.motion_words import RUN, WORDS

Array = NDArray[np.float64]

#: While a move is worked out, no point is inserted or deleted: its parts need the same points.
_ANY_SPACING = (1e-9, 1e9)


@dataclass(frozen=True, kw_only=True)
class Wish:
    """What an operator wants, in the scene's frame.

    Attributes:
        goal: where the snake should end, (3,) m; None for where it ends.
        pulls: places (3,) m, whose nearest points are pulled, and forces (3,) N.
        nails: places (K, 3) m, to which the nearest points go, and where they stay; a place that is
            no longer there lets its point go.
        tension: alpha, N (elasticity); None for what it has.
        bending_stiffness: beta, N m^2 (rigidity); None for what it has.
        word: of `motion_words`: run, hold, retract, extend.
        reach: how far from home the tip may go, m.

    Raises:
        InputError: a number that is none, or has the wrong shape; a weight that means nothing.
    """

    goal: Array | None = None
    pulls: tuple[tuple[Array, Array], ...] = ()
    nails: Array = field(default_factory=lambda: np.zeros((0, 3)))
    tension: float | None = None
    bending_stiffness: float | None = None
    word: float = RUN
    reach: float = math.inf

    def __post_init__(self) -> None:
        if self.goal is not None:
            _require_vector("goal", self.goal, "m")
        for place, force in self.pulls:
            _require_vector("place of a pull", place, "m")
            _require_vector("pull", force, "N")
        if self.nails.ndim != 2 or self.nails.shape[1] != 3 or not np.isfinite(self.nails).all():
            raise InputError("operator's nails; must be (K, 3) finite numbers, m")
        for name, value, unit in (
            ("tension", self.tension, "N"),
            ("bending stiffness", self.bending_stiffness, "N m^2"),
        ):
            # Without tension nothing is stiff along the snake.
            if value is not None and not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"operator's {name} = {value} {unit}; must be 0 or more")
        if self.tension is not None and self.tension == 0.0:
            raise InputError("operator's tension = 0 N; must be > 0")
        if self.word not in WORDS:
            raise InputError(
                f"operator's word = {self.word}; must be 1 (run), 0 (hold), -1 (retract) or 2 "
                "(extend)"
            )
        if not self.reach >= 0.0:
            raise InputError(f"operator's reach = {self.reach} m; must be 0 or more")


@dataclass(frozen=True, kw_only=True)
class LiveSnakeSettings:
    """How a snake is moved.

    Attributes:
        snake: what it is made of.
        repulsion: of the obstacles from the snake grown by `radius`.
        radius: of the arm on it, m; that of cmu_92's root links by default. What is less than the
            arm's repels it less, and lets no posture nearer.
        goal_radius: of the arm at its tip, m.
        clearance: what must be between the arm and obstacles at goals and nails, m.
        blend: over which shapes of a body are blended, m.
        steps: of the snake in a tick, at most.
        at_rest: it is near rest when no point would move farther in these steps, m.

    Raises:
        InputError: a number that means nothing.
    """

    snake: SnakeSettings = field(
        default_factory=lambda: SnakeSettings(bending_stiffness=0.3, spacing=0.1)
    )
    repulsion: Repulsion = field(
        default_factory=lambda: Repulsion(strength=0.02, reach=0.2, clamp=0.02)
    )
    radius: float = 0.11
    goal_radius: float = 0.08
    clearance: float = 0.03
    blend: float = 0.02
    steps: int = 2
    at_rest: float = 1e-3

    def __post_init__(self) -> None:
        for name in ("radius", "goal_radius", "clearance"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"live snake's {name} = {value} m; must be 0 or more")
        for name in ("blend", "at_rest"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(f"live snake's {name} = {value} m; must be > 0")
        if self.steps < 1:
            raise InputError(f"live snake's steps = {self.steps}; must be 1 or more")


@dataclass(frozen=True, kw_only=True, eq=False)
class LiveSnake:
    """A snake in an operator's hand.

    Attributes:
        snake: its points in the scene's frame; both ends, the lead and the operator's nails are
            nailed.
        goal: the last good one, (3,) m.
        goal_refused: whether the one asked for last was not.
        nails: places that were accepted, (K, 3) m.
        held: where their points are on the way there, (K, 3) m.
        nails_refused: whether one that is asked for is not among them.
    """

    snake: Snake
    goal: Array
    goal_refused: bool
    nails: Array
    held: Array
    nails_refused: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class Move:
    """Where a snake would go.

    Attributes:
        points: (N, 3) m, as many as it has.
        held: where nailed points would be, (K, 3) m.
        farthest: how far a point would go in these steps if nothing held it back, m.
        near_rest: whether that is as good as rest, and its end is at the goal.
    """

    points: Array
    held: Array
    farthest: float
    near_rest: bool


def lay_snake(path: ArrayLike, settings: LiveSnakeSettings, *, lead: float) -> LiveSnake:
    """A snake along a path (P, 3) m whose first `lead` (m) is straight, and stays so.

    Raises:
        InputError: as of `make_snake`; or the path is no longer than its lead.
    """
    corners = np.asarray(path, dtype=np.float64)
    snake = make_snake(corners, settings.snake)
    arcs = snake.arc_lengths
    if arcs[-1] <= lead + 2.0 * settings.snake.spacing:
        raise InputError(
            f"snake of {arcs[-1]:.3f} m; must be longer than its lead of {lead:.3f} m and two "
            "spacings"
        )
    nailed = snake.nailed | (arcs <= lead + 1e-9)
    return LiveSnake(
        snake=replace(snake, nailed=nailed),
        goal=snake.points[-1].copy(),
        goal_refused=False,
        nails=np.zeros((0, 3)),
        held=np.zeros((0, 3)),
        nails_refused=False,
    )


def listen(
    live: LiveSnake, wish: Wish, obstacles: SignedDistanceField, settings: LiveSnakeSettings
) -> LiveSnake:
    """The snake with the operator's goal, nails and weights taken over, as far as they may be."""
    goal, refused = live.goal, False
    if wish.goal is not None and not np.array_equal(wish.goal, live.goal):
        refused = _too_near(obstacles, wish.goal, settings.goal_radius + settings.clearance)
        goal = live.goal if refused else wish.goal
    snake, nails, held, nails_refused = _with_nails(live, wish.nails, obstacles, settings)
    if wish.tension is not None:
        snake = replace(snake, tension=np.full(len(snake.points), wish.tension))
    if wish.bending_stiffness is not None:
        weights = np.full(len(snake.points), wish.bending_stiffness)
        snake = replace(snake, bending_stiffness=weights)
    return LiveSnake(
        snake=snake,
        goal=goal,
        goal_refused=refused,
        nails=nails,
        held=held,
        nails_refused=nails_refused,
    )


def propose(
    live: LiveSnake,
    wish: Wish,
    obstacles: SignedDistanceField,
    settings: LiveSnakeSettings,
    *,
    limit: float,
) -> Move:
    """Where a snake would go next: no point farther than `limit` (m, > 0)."""
    snake = live.snake
    points = snake.points.copy()
    points[-1] = _towards(points[-1], live.goal, obstacles, settings.goal_radius, settings, limit)
    held = live.held.copy()
    for k, place in enumerate(live.nails):
        row = snake.nearest(held[k])
        held[k] = _towards(held[k], place, obstacles, settings.radius, settings, limit)
        points[row] = held[k]

    loose = replace(snake.settings, spacing_band=_ANY_SPACING)
    wanted = settle(
        replace(snake, points=points, settings=loose),
        _felt(obstacles, settings),
        settings.repulsion,
        pulls=_bounded(wish.pulls, settings),
        max_steps=settings.steps,
    ).snake.points
    ways = wanted - snake.points
    farthest = float(np.linalg.norm(ways, axis=1).max())
    share = 1.0 if farthest <= limit else limit / farthest
    settled = farthest <= settings.at_rest
    return Move(
        points=wanted if share == 1.0 else snake.points + share * ways,
        held=held if share == 1.0 else live.held + share * (held - live.held),
        farthest=farthest,
        near_rest=settled
        and bool(np.linalg.norm(live.goal - points[-1]) <= settings.at_rest)
        and bool(np.all(np.linalg.norm(live.nails - held, axis=1) <= settings.at_rest)),
    )


def take(live: LiveSnake, move: Move, share: float) -> LiveSnake:
    """The snake after a share (0 .. 1) of a move, its points' spacing kept."""
    if share == 1.0:
        points, held = move.points, move.held
    else:
        points = live.snake.points + share * (move.points - live.snake.points)
        held = live.held + share * (move.held - live.held)
    return replace(live, snake=keep_spacing(replace(live.snake, points=points)), held=held)


def let_go(
    live: LiveSnake, obstacles: SignedDistanceField, settings: LiveSnakeSettings
) -> LiveSnake:
    """The snake at rest, as far as it comes to rest: with no arm on it that may be."""
    settled = settle(live.snake, _felt(obstacles, settings), settings.repulsion)
    return replace(live, snake=settled.snake)


def _bounded(
    pulls: tuple[tuple[Array, Array], ...], settings: LiveSnakeSettings
) -> list[tuple[Array, Array]]:
    """Pulls that obstacles can hold: at most half of what they push with where they push most."""
    clamp = np.array(settings.repulsion.clamp)
    most = 0.5 * float(settings.repulsion.push(clamp)) * settings.snake.spacing
    return [
        (place, force * min(1.0, most / max(float(np.linalg.norm(force)), 1e-300)))
        for place, force in pulls
    ]


def _felt(obstacles: SignedDistanceField, settings: LiveSnakeSettings) -> DistanceField:
    """What repels the snake: each body's distance from the arm on it."""

    def distances(at: Array) -> tuple[Array, Array]:
        if not obstacles.shapes:
            return np.full((len(at), 1), np.inf), np.zeros((len(at), 1, 3))
        reach = settings.repulsion.reach + settings.radius
        found, gradients = obstacles.blended(at, blend=settings.blend, within=reach)
        return found - settings.radius, gradients

    return distances


def _with_nails(
    live: LiveSnake, wanted: Array, obstacles: SignedDistanceField, settings: LiveSnakeSettings
) -> tuple[Snake, Array, Array, bool]:
    """Takes out what is not wanted any more, and drives in what is new."""
    if np.array_equal(wanted, live.nails):
        return live.snake, live.nails, live.held, False
    snake, refused = live.snake, False
    nailed = snake.nailed.copy()
    nails, held = [], []
    for place, at in zip(live.nails, live.held, strict=True):
        if (wanted == place).all(axis=1).any():
            nails.append(place)
            held.append(at)
        else:
            nailed[snake.nearest(at)] = False
    for place in wanted:
        if any(np.array_equal(place, known) for known in nails):
            continue
        row = snake.nearest(place)
        # What is nailed already is an end, the lead, or another nail's.
        if nailed[row] or _too_near(obstacles, place, settings.radius + settings.clearance):
            refused = True
            continue
        nailed[row] = True
        nails.append(place)
        held.append(snake.points[row])
    shape = (len(nails), 3)
    return (
        replace(snake, nailed=nailed),
        np.array(nails).reshape(shape),
        np.array(held).reshape(shape),
        refused,
    )


def _towards(
    place: Array,
    target: Array,
    obstacles: SignedDistanceField,
    radius: float,
    settings: LiveSnakeSettings,
    limit: float,
) -> Array:
    """A step of `limit` (m) at most from a place to a target, along obstacles where they bar it."""
    way = target - place
    length = float(np.linalg.norm(way))
    if length == 0.0:
        return place
    step = way * min(1.0, limit / length)
    there = target if length <= limit else place + step
    need = radius + settings.clearance
    if not _too_near(obstacles, there, need):
        return there
    nearest = obstacles.nearest(place[None])
    # Nearer than it should be already, it may still go where it is farther.
    if float(obstacles.distances(there[None])[0]) >= float(nearest.distances[0]):
        return there
    normal = nearest.gradients[0]
    aside: Array = place + step - min(float(step @ normal), 0.0) * normal
    return place if _too_near(obstacles, aside, need) else aside


def _too_near(obstacles: SignedDistanceField, place: Array, need: float) -> bool:
    return bool(obstacles.distances(place[None])[0] < need)


def _require_vector(name: str, value: Array, unit: str) -> None:
    if np.shape(value) != (3,) or not np.isfinite(value).all():
        raise InputError(f"operator's {name} = {value}; must be three finite numbers, {unit}")
