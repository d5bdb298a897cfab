"""The snake: a path that makes itself short, straight, and clear of obstacles (CMU-92 section 3.4).

Kass, Witkin and Terzopoulos' curve v(s) of least energy

    E = int alpha(s)/2 |v_s|^2 + beta(s)/2 |v_ss|^2 + U(v) - f(s) . v ds

with its tension alpha (N), its bending stiffness beta (N m^2), obstacles' energy U per length (N)
and what the operator pulls with, f (N/m). CMU-92 Eq 4 prints the norms without their squares; its
pentadiagonal matrix is that of the squares. With points at a spacing h the discrete energy is

    E = sum alpha_i / (2 h) |v_i+1 - v_i|^2 + sum beta_i / (2 h^3) |v_i+1 - 2 v_i + v_i-1|^2
      + sum h (U(v_i) - f_i . v_i)

What moves it is in `snake_motion`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

#: Ends and one point between them are never deleted.
_FEWEST = 3


@dataclass(frozen=True, kw_only=True)
class SnakeSettings:
    """What a snake is made of.

    Attributes:
        tension: alpha, N: how much it wants to be short (elasticity).
        bending_stiffness: beta, N m^2: how much it wants to be straight (rigidity).
        spacing: h, m, of its points.
        spacing_band: shares of `spacing` outside which points are deleted or inserted. The upper
            must be more than twice the lower, or what is inserted is deleted at once.

    Raises:
        InputError: a number that means nothing.
    """

    tension: float = 1.0
    bending_stiffness: float = 0.05
    spacing: float = 0.1
    spacing_band: tuple[float, float] = (0.5, 1.5)

    def __post_init__(self) -> None:
        for name, value, unit, least in (
            ("tension", self.tension, "N", 0.0),
            ("bending stiffness", self.bending_stiffness, "N m^2", -math.ulp(0.0)),
            ("spacing", self.spacing, "m", 0.0),
        ):
            if not (math.isfinite(value) and value > least):
                allowed = "> 0" if least == 0.0 else "0 or more"
                raise InputError(f"snake {name} = {value} {unit}; must be {allowed}")
        low, high = self.spacing_band
        if not (0.0 < 2.0 * low < high < math.inf):
            raise InputError(
                f"snake spacing band = {low} .. {high}; must be positive, the upper more than "
                "twice the lower"
            )


@dataclass(frozen=True, kw_only=True)
class Snake:
    """A path of points that are nailed down or free.

    Attributes:
        points: (N, 3) m, from the base to the goal.
        nailed: (N,); both ends always are.
        tension, bending_stiffness: alpha N and beta N m^2 at the points, (N,).
    """

    points: Array
    nailed: Flags
    tension: Array
    bending_stiffness: Array
    settings: SnakeSettings

    @property
    def spacings(self) -> Array:
        """Distances (N - 1,) m between neighbours."""
        lengths: Array = np.linalg.norm(np.diff(self.points, axis=0), axis=-1)
        return lengths

    @property
    def arc_lengths(self) -> Array:
        """Of the points along the path, (N,) m."""
        return np.concatenate([[0.0], np.cumsum(self.spacings)])

    def nearest(self, place: ArrayLike) -> int:
        """The point nearest to a place (3,) m."""
        return int(np.argmin(np.linalg.norm(self.points - np.asarray(place), axis=-1)))


def make_snake(
    path: ArrayLike,
    settings: SnakeSettings,
    *,
    tension: ArrayLike | None = None,
    bending_stiffness: ArrayLike | None = None,
) -> Snake:
    """Lays a snake down on a path, with points at most `settings.spacing` apart.

    Args:
        path: (P, 3) m, corners of a polyline.
        tension, bending_stiffness: weights along the path, at equal shares of its length, linear
            between them; the settings' own by default.

    Raises:
        InputError: the path is not (P, 3) with P >= 2, finite and of a length; or a weight is not
            finite or negative.
    """
    corners = np.asarray(path, dtype=np.float64)
    if corners.ndim != 2 or corners.shape[1] != 3 or len(corners) < 2:
        raise InputError(f"snake's path of shape {corners.shape}; must be (2 or more, 3)")
    if not np.isfinite(corners).all():
        raise InputError("snake's path; must be of finite numbers")
    marks = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=-1))])
    if marks[-1] <= 0.0:
        raise InputError("snake's path has no length; start and goal must differ")
    count = max(math.ceil(marks[-1] / settings.spacing) + 1, 3)
    s = np.linspace(0.0, marks[-1], count)
    points = np.stack([np.interp(s, marks, corners[:, axis]) for axis in range(3)], axis=-1)
    points[0], points[-1] = corners[0], corners[-1]
    nailed = np.zeros(count, dtype=bool)
    nailed[[0, -1]] = True
    return Snake(
        points=points,
        nailed=nailed,
        tension=_weights("tension", tension, settings.tension, count),
        bending_stiffness=_weights(
            "bending stiffness", bending_stiffness, settings.bending_stiffness, count
        ),
        settings=settings,
    )


def nail(snake: Snake, place: ArrayLike) -> Snake:
    """The snake with the point that is nearest to a place (3,) m moved there and nailed down.

    Raises:
        InputError: the place is not of three finite numbers, or only an end is near it.
    """
    where = np.asarray(place, dtype=np.float64)
    if where.shape != (3,) or not np.isfinite(where).all():
        raise InputError(f"nail at {place!r}; must be three finite numbers, m")
    k = snake.nearest(where)
    if k in (0, len(snake.points) - 1):
        raise InputError(f"nail at {where.tolist()} m is nearest to an end, which is nailed")
    points, nailed = snake.points.copy(), snake.nailed.copy()
    points[k], nailed[k] = where, True
    return replace(snake, points=points, nailed=nailed)


def move_goal(snake: Snake, goal: ArrayLike) -> Snake:
    """The snake with its last point moved to (3,) m; the rest follows when it is let go.

    Raises:
        InputError: the goal is not of three finite numbers.
    """
    where = np.asarray(goal, dtype=np.float64)
    if where.shape != (3,) or not np.isfinite(where).all():
        raise InputError(f"goal at {goal!r}; must be three finite numbers, m")
    points = snake.points.copy()
    points[-1] = where
    return replace(snake, points=points)


def keep_spacing(snake: Snake) -> Snake:
    """The snake with points inserted and deleted where their spacing has left its band.

    The same object comes back if it has not. Nailed points are never deleted.
    """
    low, high = (share * snake.settings.spacing for share in snake.settings.spacing_band)
    # At every step of a snake: squares, and no calls that are not needed.
    ways = snake.points[1:] - snake.points[:-1]
    squares = np.einsum("ij,ij->i", ways, ways)
    if squares.max() <= high * high and squares.min() >= low * low:
        return snake
    keep = np.ones(len(snake.points), dtype=bool)
    last, places = 0, snake.points.tolist()
    for k in range(1, len(places)):
        if (
            math.dist(places[k], places[last]) < low
            and not snake.nailed[k]
            and keep.sum() > _FEWEST
        ):
            keep[k] = False
            continue
        last = k
    rows = np.flatnonzero(keep)
    # As many as bring each interval back into the band, at equal shares of it.
    lengths = np.linalg.norm(np.diff(snake.points[rows], axis=0), axis=-1)
    parts = np.where(lengths > high, np.ceil(lengths / snake.settings.spacing), 1.0)
    if keep.all() and (parts == 1.0).all():  # nails nearer to each other than that stay so
        return snake
    # Old points stay at whole numbers.
    at = np.concatenate([k + np.arange(n) / n for k, n in enumerate(parts)] + [[len(rows) - 1.0]])
    old = np.arange(len(rows), dtype=np.float64)
    whole = at == np.floor(at)
    points = np.stack([np.interp(at, old, snake.points[rows, k]) for k in range(3)], axis=-1)
    points[whole] = snake.points[rows]
    nailed = np.zeros(len(at), dtype=bool)
    nailed[whole] = snake.nailed[rows]
    return replace(
        snake,
        points=points,
        nailed=nailed,
        tension=np.interp(at, old, snake.tension[rows]),
        bending_stiffness=np.interp(at, old, snake.bending_stiffness[rows]),
    )


def curvatures(points: Array) -> Array:
    """Of a path of points (N, 3) m at its inner ones, (N - 2,) 1/m: turn over mean spacing."""
    ways = np.diff(points, axis=0)
    lengths = np.linalg.norm(ways, axis=-1)
    across = np.linalg.norm(np.cross(ways[:-1], ways[1:]), axis=-1)
    along = np.einsum("ij,ij->i", ways[:-1], ways[1:])
    turns: Array = np.arctan2(across, along) / (0.5 * (lengths[:-1] + lengths[1:]))
    return turns


def link_curvature_limit(link_length: float, joint_limit: float) -> float:
    """The curvature of the circle that links of a length (m) follow at a joint angle (rad), 1/m.

    A chord l of a circle of radius R turns by theta where l = 2 R sin(theta / 2).
    """
    return 2.0 * math.sin(0.5 * joint_limit) / link_length


def _weights(name: str, given: ArrayLike | None, default: float, count: int) -> Array:
    values = np.atleast_1d(np.asarray(default if given is None else given, dtype=np.float64))
    if not (np.isfinite(values).all() and (values >= 0.0).all()):
        raise InputError(f"snake's {name}; must be finite and 0 or more")
    return np.interp(np.linspace(0.0, 1.0, count), np.linspace(0.0, 1.0, values.size), values)
