"""A goal with a direction to look in, as well as a point.

The camera looks along the last link. That link is a chord of the path: it lies in the wanted
direction at the goal if the path's last piece, of the link's length, is straight along it. So the
path goes to an approach point, that much before the goal, and straight on from there; the snake's
points on that piece are nailed down (`nail_tail`), and no force of obstacles, tension or stiffness
turns the tip. Where the path's corner at the approach point is rounded, the piece must be longer by
what that takes: with CMU-92's arm in the cargo bay the last link is half a degree off without, and
not at all with a decimetre more.

The piece must be clear for the arm. Where it is not, the nearest direction for which it is says how
far off the arm looks at best. In a gap of width w between parallel walls, a link of length l whose
tip is g from the far grown wall looks towards the near one at asin(g / l) to the walls at most: a
look straight at the payload from a gap that is hardly wider than a link is long is far off, and the
camera's own pan and tilt have to make up for it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError, NotFollowableError
from pips_drake.planning.grid_search import find_path
from pips_drake.planning.line_of_sight import first_blocked
from pips_drake.planning.occupancy import Occupancy
from pips_drake.planning.quick_pull import pull_quickly
from pips_drake.planning.snake import Snake
from pips_drake.scene.signed_distance import SignedDistanceField

Array = NDArray[np.float64]

#: Directions tried when the wanted one is blocked: 3 deg apart, so that clear ones are found whose
#: bundle is wider than that.
_DIRECTIONS = 4000
#: How finely the best one is then searched for, rad.
_FINEST = 1e-4
#: A goal that the snake does not end at, m.
_SAME_GOAL = 1e-6


@dataclass(frozen=True, eq=False)
class Viewing:
    """How an arm comes to look in a direction at a goal.

    Attributes:
        goal: (3,) m.
        wanted: unit vector (3,), which the camera shall look along.
        direction: unit vector (3,), which the last link can lie along: the wanted one, or the
            nearest to it whose approach is clear.
        off: angle between the two, rad.
        within: how much of it the camera's pan and tilt may make up, rad.
        approach: where the path becomes straight, (3,) m.
        blocked_by: what is in the way of an approach along the wanted direction; None: nothing.
    """

    goal: Array
    wanted: Array
    direction: Array
    off: float
    within: float
    approach: Array
    blocked_by: str | None

    @property
    def possible(self) -> bool:
        """Whether the camera can look in the wanted direction, with its pan and tilt."""
        return self.off <= self.within

    @property
    def length(self) -> float:
        """Of the straight piece, m."""
        return float(np.linalg.norm(self.goal - self.approach))

    @property
    def words(self) -> str:
        """What there is to say of it, for messages."""
        if self.blocked_by is None:
            return "the arm looks in the wanted direction"
        off, within = math.degrees(self.off), math.degrees(self.within)
        said = (
            f"viewing direction is off by {off:.1f} deg, because {self.blocked_by} is in the way "
            f"of the last {self.length:.3g} m before the goal"
        )
        if not self.within:
            return said
        verb = "make" if self.possible else "cannot make"
        return f"{said}; pan and tilt of {within:.3g} deg {verb} up for it"


def approach_along(
    field: SignedDistanceField,
    goal: ArrayLike,
    direction: ArrayLike,
    *,
    length: float,
    radius: float,
    within: float = 0.0,
) -> Viewing:
    """The approach to a goal whose straight end is nearest to a wanted direction.

    Args:
        field: the obstacles.
        goal: (3,) m in the world.
        direction: to look in, (3,), of any length but 0.
        length: of the straight piece: the last link's, and what the path's rounding takes of it, m.
        radius: of the arm, m.
        within: rad, what the camera's pan and tilt can make up. It is only compared with.

    Raises:
        InputError: a number that means nothing, or the goal is too near to an obstacle.
        NotFollowableError: no straight piece of that length ends at the goal, in any direction.
    """
    p, wanted = _checked(goal, direction, length, within)
    nearest = field.nearest(p[None])
    if float(nearest.distances[0]) < radius:
        label = field.label(int(nearest.indices[0]))
        raise InputError(
            f"goal {_place(p)} is {float(nearest.distances[0]):.3g} m from {label}; must be "
            f"{radius:.3g} m or more from it"
        )
    ends = _Ends(field, p, length, radius)
    shape = ends.blocked_by(wanted)
    if shape is None:
        found = wanted
    else:
        every = _directions()
        every = every[np.argsort(-(every @ wanted), kind="stable")]
        best = ends.first_clear(every)
        if best is None:
            raise NotFollowableError(
                f"no straight approach of {length:.3g} m to the goal {_place(p)} is clear for an "
                f"arm of {radius:.3g} m radius; {shape} is in the way of the wanted one"
            )
        found = ends.nearest_clear(best, wanted)
    return Viewing(
        goal=p,
        wanted=wanted,
        direction=found,
        off=_angle(found, wanted),
        within=within,
        approach=p - length * found,
        blocked_by=shape,
    )


def find_viewing_path(occupancy: Occupancy, start: ArrayLike, viewing: Viewing) -> Array:
    """The shortest path to the approach point, pulled tight, and straight on to the goal, (N, 3) m.

    Raises:
        InputError: start or approach point is outside the workspace.
        NoPathError: there is no way.
    """
    found = find_path(occupancy, start, viewing.approach)
    pulled = pull_quickly(occupancy.field, found.points, occupancy.radius)
    return np.vstack([pulled, viewing.goal])


def nail_tail(snake: Snake, viewing: Viewing) -> Snake:
    """The snake with its end laid straight from the approach point to the goal, and nailed there.

    Raises:
        InputError: the snake does not end at the goal.
    """
    if float(np.linalg.norm(snake.points[-1] - viewing.goal)) > _SAME_GOAL:
        raise InputError(
            f"snake ends at {_place(snake.points[-1])}; must end at the goal {_place(viewing.goal)}"
        )
    apart = np.linalg.norm(snake.points - viewing.approach, axis=1)
    # The last place where it is as near as anywhere: it may pass there on its way before.
    k = len(apart) - 1 - int(np.argmin(apart[:0:-1])) if len(apart) > 1 else 0
    count = max(math.ceil(viewing.length / snake.settings.spacing), 1)
    shares = np.linspace(0.0, 1.0, count + 1)[:, None]
    tail = viewing.approach + shares * (viewing.goal - viewing.approach)
    tail[-1] = snake.points[-1]

    def with_tail(values: Array, last: Array) -> Array:
        joined: Array = np.concatenate([values[:k], last])
        return joined

    return replace(
        snake,
        points=with_tail(snake.points, tail),
        nailed=np.concatenate([snake.nailed[:k], np.ones(count + 1, dtype=bool)]),
        tension=with_tail(snake.tension, np.full(count + 1, snake.tension[k])),
        bending_stiffness=with_tail(
            snake.bending_stiffness, np.full(count + 1, snake.bending_stiffness[k])
        ),
    )


def look_angle(points: ArrayLike, viewing: Viewing) -> float:
    """Between the wanted direction and a link of the straight piece's length on a path's end, rad.

    The link is the chord from where the path (N, 3) m last crosses the sphere of that radius about
    its end.
    """
    p = np.asarray(points, dtype=np.float64)
    apart = np.linalg.norm(p - p[-1], axis=1)
    # A place on the sphere up to rounding is on it.
    outside = np.flatnonzero(apart >= viewing.length * (1.0 - 1e-9))
    if not len(outside):
        raise InputError(f"path is shorter than its straight end of {viewing.length:.3g} m")
    k = int(outside[-1])
    way, offset = p[k + 1] - p[k], p[k] - p[-1]
    # |offset + s way| = length, the first root along the way.
    a, b, c = way @ way, offset @ way, offset @ offset - viewing.length**2
    share = (-b - math.sqrt(max(b * b - a * c, 0.0))) / a
    return _angle(p[-1] - (p[k] + share * way), viewing.wanted)


class _Ends:
    """Straight pieces that end at a goal."""

    def __init__(
        self, field: SignedDistanceField, goal: Array, length: float, radius: float
    ) -> None:
        self._field, self._goal, self._length, self._radius = field, goal, length, radius

    def blocked_by(self, direction: Array) -> str | None:
        """What is in the way of the piece along a direction."""
        piece = np.stack([self._goal, self._goal - self._length * direction])
        segment, _, shape = first_blocked(self._field.arrays, piece, self._radius)
        return None if segment < 0 else self._field.label(int(shape))

    def first_clear(self, directions: Array) -> Array | None:
        """The first of some directions (N, 3) whose piece is clear."""
        # What has its beginning too near to an obstacle need not be looked at.
        distances = self._field.distances(self._goal - self._length * directions)
        for direction in directions[distances >= self._radius]:
            if self.blocked_by(direction) is None:
                return np.array(direction)
        return None

    def nearest_clear(self, found: Array, wanted: Array) -> Array:
        """A clear direction, moved on the sphere towards the wanted one as far as it stays clear.

        In rounds: a ring of directions about the best, which shrinks when none of it is better.
        """
        best, step = found, math.sqrt(4.0 * math.pi / _DIRECTIONS)
        turns = np.linspace(0.0, 2.0 * math.pi, 16, endpoint=False)
        while step > _FINEST:
            # One of the ring leads straight towards the wanted direction.
            ahead = wanted - (wanted @ best) * best
            size = float(np.linalg.norm(ahead))
            if size == 0.0:
                break
            ahead /= size
            aside = np.cross(best, ahead)
            ring = math.cos(step) * best + math.sin(step) * (
                np.outer(np.cos(turns), ahead) + np.outer(np.sin(turns), aside)
            )
            ring = ring[ring @ wanted > best @ wanted + 1e-12]
            ring = ring[np.argsort(-(ring @ wanted), kind="stable")]
            better = self.first_clear(ring) if len(ring) else None
            if better is None:
                step *= 0.5
            else:
                best = better / np.linalg.norm(better)
        return best


def _directions() -> Array:
    """Unit vectors (N, 3), evenly spread: a spiral of golden angles."""
    k = np.arange(_DIRECTIONS) + 0.5
    z = 1.0 - 2.0 * k / _DIRECTIONS
    angle = math.pi * (1.0 + math.sqrt(5.0)) * k
    out = np.sqrt(1.0 - z * z)
    return np.column_stack([out * np.cos(angle), out * np.sin(angle), z])


def _angle(one: Array, other: Array) -> float:
    """Between vectors, rad."""
    return math.atan2(float(np.linalg.norm(np.cross(one, other))), float(one @ other))


def _checked(
    goal: ArrayLike, direction: ArrayLike, length: float, within: float
) -> tuple[Array, Array]:
    """The goal and the unit vector."""
    p, d = np.asarray(goal, dtype=np.float64), np.asarray(direction, dtype=np.float64)
    for name, vector, unit in (("goal", p, " m"), ("viewing direction", d, "")):
        if vector.shape != (3,) or not np.isfinite(vector).all():
            raise InputError(f"{name} = {vector.tolist()}{unit}; must be three finite numbers")
    size = float(np.linalg.norm(d))
    if not size > 0.0:
        raise InputError("viewing direction = [0, 0, 0]; must have a length")
    if not (math.isfinite(length) and length > 0.0):
        raise InputError(f"straight approach = {length} m; must be > 0")
    if not (math.isfinite(within) and within >= 0.0):
        raise InputError(f"viewing direction within = {within} rad; must be 0 or more")
    return p, d / size


def _place(point: Array) -> str:
    return "(" + ", ".join(f"{x + 0.0:.4g}" for x in np.round(point, 6)) + ") m"
