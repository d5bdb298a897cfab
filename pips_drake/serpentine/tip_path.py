"""The path that the tip follows: lines and circular arcs, by arc length.

Two kinds. A *polyline* goes straight from point to point, as the report's tables are solved. A
*smooth* path has no corners: it is built from lines and tangent arcs (`PathBuilder`, the way the
report made its trajectories) or blended from points (`blended_path`). On a polyline the joints'
rates jump whenever a spine point crosses a vertex; on a smooth path they do not, so motion uses it.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.serpentine.path_geometry import (
    COLUMNS,
    LENGTH,
    ORIGIN,
    RADIUS,
    START,
    U,
    V,
    nearest_on_path,
    points_and_tangents,
)

Array = NDArray[np.float64]

#: Corners below this are rounding, rad.
STRAIGHT = 1e-9
#: Corners above this turn straight back, which no arc does, rad.
BACK = math.pi - 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class TipPath:
    """A path in frame {0}. The first part is the base line, which the arm lies on at home.

    Attributes:
        name: for messages and figures.
        pieces: the table of `path_geometry`, (K, COLUMNS).
        home_arc_length: where the tip stands at home, m from the path's start.
        marks: arc lengths of the points that the path was made of, from home on, (R,) m.
        deviation: largest distance between the path and the polyline of the points it was made of,
            m; 0 for a polyline, and for a path that was built from lines and arcs.
        source: the file it was read from; empty if none.
    """

    name: str
    pieces: Array
    home_arc_length: float
    marks: Array
    deviation: float = 0.0
    source: str = ""

    @property
    def label(self) -> str:
        """What a message about unusable input calls it: its file, or else its name."""
        return self.source or f"path '{self.name}'"

    @property
    def length(self) -> float:
        """Arc length of the whole path, m."""
        return float(self.pieces[-1, START] + self.pieces[-1, LENGTH])

    @property
    def travel(self) -> float:
        """Arc length from home to the end, m."""
        return self.length - self.home_arc_length

    @cached_property
    def version(self) -> str:
        """A fingerprint of the geometry: equal if and only if the path is the same."""
        return hashlib.sha256(np.ascontiguousarray(self.pieces).tobytes()).hexdigest()[:16]

    @cached_property
    def is_smooth(self) -> bool:
        """Whether the tangent has no jump above 1e-6 rad."""
        return bool(np.max(self.corner_angles(), initial=0.0) < 1e-6)

    def corner_angles(self) -> Array:
        """Angle (rad) between the tangents on both sides of each joint between pieces, (K - 1,)."""
        ends = self.pieces[:-1, START] + self.pieces[:-1, LENGTH]
        _, before = points_and_tangents(self.pieces, ends)
        after = np.where(self.pieces[1:, RADIUS, None] == 0.0, self.pieces[1:, U : U + 3], 0.0)
        after = after + self.pieces[1:, V : V + 3]
        # atan2 of sine and cosine: arccos alone cannot tell angles below 1e-8 from zero.
        sine = np.linalg.norm(np.cross(before, after), axis=1)
        return np.arctan2(sine, np.sum(before * after, axis=1))

    def point(self, arc_length: ArrayLike) -> Array:
        """Points (..., 3) m at arc lengths (...) m; outside the path the ends are extended."""
        return self._evaluate(arc_length)[0]

    def tangent(self, arc_length: ArrayLike) -> Array:
        """Unit tangents (..., 3) at arc lengths (...) m; at a corner the one before it."""
        return self._evaluate(arc_length)[1]

    def _evaluate(self, arc_length: ArrayLike) -> tuple[Array, Array]:
        s = np.asarray(arc_length, dtype=np.float64)
        points, tangents = points_and_tangents(self.pieces, s.ravel())
        return points.reshape(*s.shape, 3), tangents.reshape(*s.shape, 3)

    def nearest(self, points: ArrayLike, low: ArrayLike, high: ArrayLike) -> tuple[Array, Array]:
        """Distance and arc length (N,) m where [low, high] (N,) m is nearest to points (N, 3)."""
        points = np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 3)
        shape = points.shape[:1]
        return nearest_on_path(
            self.pieces,
            points,
            np.broadcast_to(np.asarray(low, dtype=np.float64), shape),
            np.broadcast_to(np.asarray(high, dtype=np.float64), shape),
        )

    def samples(self, step: float) -> Array:
        """Arc lengths (N,) m from home to the end, `step` (m) apart, the end included."""
        if not step > 0.0:
            raise InputError(f"step = {step} m; must be > 0")
        count = max(1, math.ceil(self.travel / step - 1e-9))
        s: Array = self.home_arc_length + step * np.arange(count + 1, dtype=np.float64)
        s[-1] = self.length
        return s

    def mirrored(self) -> TipPath:
        """The path reflected in the x0-z0 plane."""
        return replace(self, pieces=self.mirrored_pieces)

    @cached_property
    def mirrored_pieces(self) -> Array:
        """The table of the path's mirror image (`mirrored`)."""
        pieces = self.pieces.copy()
        pieces[:, [ORIGIN + 1, U + 1, V + 1]] *= -1.0
        return pieces

    def translated(self, by: ArrayLike) -> TipPath:
        """The path moved by a vector (3,) m."""
        pieces = self.pieces.copy()
        pieces[:, ORIGIN : ORIGIN + 3] += np.asarray(by)
        return replace(self, pieces=pieces)


class PathBuilder:
    """Builds a smooth path from lines and tangent arcs; lengths in m, angles in rad.

    Example:
        >>> path = (
        ...     PathBuilder(start=[0.4, 0.0, 0.0], direction=[0.0, 0.0, 1.0])
        ...     .line(4.4)
        ...     .home()
        ...     .arc(radius=0.7, angle=1.57, toward=[1.0, 0.0, 0.0])
        ...     .build("around the corner")
        ... )
    """

    def __init__(self, *, start: ArrayLike, direction: ArrayLike) -> None:
        self._point = _vector(start, "start")
        self._direction = _unit(direction, "direction")
        self._rows: list[Array] = []
        self._length = 0.0
        self._home: float | None = None

    def line(self, length: float) -> Self:
        """Goes straight on for `length` m."""
        if not length > 0.0:
            raise InputError(f"PathBuilder.line: length = {length} m; must be > 0")
        self._append(_line_row(self._length, self._point, self._direction, length))
        self._point = self._point + length * self._direction
        return self

    def arc(self, *, radius: float, angle: float, toward: ArrayLike) -> Self:
        """Turns by `angle` rad on a circle of `radius` m, in the plane of the tangent and `toward`.

        `toward` (3,) is the side that the path turns to; its part square to the tangent counts.
        """
        if not radius > 0.0:
            raise InputError(f"PathBuilder.arc: radius = {radius} m; must be > 0")
        if not 0.0 < angle <= 2.0 * math.pi:
            raise InputError(f"PathBuilder.arc: angle = {angle} rad; must be in (0, 2 pi]")
        side = _vector(toward, "toward")
        if not np.linalg.norm(side - np.dot(side, self._direction) * self._direction) > 1e-9:
            raise InputError("PathBuilder.arc: toward lies along the path; must point aside")
        inward = _square_part(side, self._direction)
        centre = self._point + radius * inward
        self._append(_arc_row(self._length, centre, -inward, self._direction, radius, angle))
        cosine, sine = math.cos(angle), math.sin(angle)
        self._point = centre + radius * (sine * self._direction - cosine * inward)
        self._direction = cosine * self._direction + sine * inward
        return self

    def home(self) -> Self:
        """Says that the tip stands here at home; without it, that is the end of the first line."""
        self._home = self._length
        return self

    def build(self, name: str) -> TipPath:
        """The path."""
        if not self._rows:
            raise InputError("PathBuilder.build: no pieces; add a line or an arc")
        pieces = np.stack(self._rows)
        home = float(pieces[0, LENGTH]) if self._home is None else self._home
        joints = np.append(pieces[:, START], self._length)
        return TipPath(
            name=name, pieces=pieces, home_arc_length=home, marks=joints[joints >= home - 1e-12]
        )

    def _append(self, row: Array) -> None:
        self._rows.append(row)
        self._length += float(row[LENGTH])


def polyline_path(points: ArrayLike, name: str) -> TipPath:
    """The polyline through points (P, 3) m: row 0 the base end, row 1 the home tip (FTL-95 C)."""
    vertices = _checked_points(points, name)
    steps = np.diff(vertices, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    starts = np.concatenate([[0.0], np.cumsum(lengths)])
    rows = [
        _line_row(start, vertex, step / length, length)
        for start, vertex, step, length in zip(
            starts[:-1], vertices[:-1], steps, lengths, strict=True
        )
    ]
    return TipPath(
        name=name, pieces=np.stack(rows), home_arc_length=float(starts[1]), marks=starts[1:]
    )


def blended_path(points: ArrayLike, name: str, *, corner_deviation: float = math.inf) -> TipPath:
    """A smooth path near points (P, 3) m: every corner is replaced by a tangent arc.

    The tip's home (row 1) and the end stay exactly; the base line stays straight up to home, so the
    arc of a corner at home begins there and lies beyond it.

    Args:
        corner_deviation: how far the path may pass from a corner, m. By default arcs are as wide as
            the spacing of the points lets them be, which is gentlest for the joints.
    """
    if not corner_deviation > 0.0:
        raise InputError(f"corner_deviation = {corner_deviation} m; must be > 0")
    vertices = _checked_points(points, name).copy()
    marks = vertices[1:].copy()
    table = polyline_path(vertices, name)
    if len(vertices) > 2 and _turn(vertices[:3]) > STRAIGHT:
        first = vertices[1] - vertices[0]
        # Past home the path stays in the triangle home, moved corner, next point: nowhere farther
        # from the table's line than the moved corner is.
        aside = math.sin(min(_turn(vertices[:3]), 0.5 * math.pi))
        ahead = min(
            0.3 * float(np.linalg.norm(vertices[2] - vertices[1])), corner_deviation / aside
        )
        vertices[1] = vertices[1] + ahead * first / np.linalg.norm(first)
    else:
        ahead = 0.0
    steps = np.diff(vertices, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    directions = steps / lengths[:, None]
    rows: list[Array] = []
    corners: list[int] = []
    travelled, point = 0.0, vertices[0]
    for i in range(1, len(vertices)):
        tangent_length = 0.0
        if i + 1 < len(vertices):
            turn = _turn(vertices[i - 1 : i + 2])
            room = 0.5 * min(lengths[i - 1] if i > 1 else math.inf, lengths[i])
            if i == 1 and ahead > 0.0:
                room = min(ahead, room)
            if turn > BACK:
                raise InputError(
                    f"path '{name}': turns straight back at row {i + 1}, which no arc can blend; "
                    "must turn by less than 180 deg"
                )
            if turn > STRAIGHT:
                # Corner to arc is t tan(turn / 4), with t from the corner to where the arc begins.
                tangent_length = min(room, corner_deviation / math.tan(0.25 * turn))
        straight = float(np.linalg.norm(vertices[i] - point)) - tangent_length
        if straight > 1e-12:
            rows.append(_line_row(travelled, point, directions[i - 1], straight))
            travelled += straight
            point = point + straight * directions[i - 1]
        if tangent_length > 0.0:
            radius = tangent_length / math.tan(0.5 * turn)
            inward = _square_part(directions[i], directions[i - 1])
            centre = point + radius * inward
            rows.append(_arc_row(travelled, centre, -inward, directions[i - 1], radius, turn))
            travelled += radius * turn
            point = vertices[i] + tangent_length * directions[i]
        corners += [i] * (len(rows) - len(corners))
    path = TipPath(
        name=name,
        pieces=np.stack(rows),
        home_arc_length=table.home_arc_length,
        marks=np.empty(0),
    )
    return TipPath(
        name=name,
        pieces=path.pieces,
        home_arc_length=table.home_arc_length,
        marks=path.nearest(marks, 0.0, path.length)[1],
        deviation=_distance_between(path, table, marks, np.array(corners)),
    )


def _distance_between(
    path: TipPath, table: TipPath, marks: Array, corners: NDArray[np.int64]
) -> float:
    """Largest distance (m) from path to table (64 samples a piece) and from its points to it.

    A piece is compared with the lines on both sides of the corner (row of the table) that it
    leads to or rounds, not with all of them.
    """
    fractions = np.linspace(0.0, 1.0, 65)
    s = (path.pieces[:, START, None] + path.pieces[:, LENGTH, None] * fractions).ravel()
    ends = np.append(table.pieces[:, START], table.length)
    low = np.repeat(ends[corners - 1], fractions.size)
    high = np.repeat(ends[np.minimum(corners + 1, len(ends) - 1)], fractions.size)
    to_table, _ = table.nearest(path.point(s), low, high)
    to_path, _ = path.nearest(marks, 0.0, path.length)
    return float(max(to_table.max(), to_path.max()))


def _checked_points(points: ArrayLike, name: str) -> Array:
    vertices = np.asarray(points, dtype=np.float64)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or len(vertices) < 2:
        raise InputError(f"path '{name}': points of shape {vertices.shape}; must be (P >= 2, 3)")
    if not np.all(np.isfinite(vertices)):
        raise InputError(f"path '{name}': points must be finite numbers")
    gaps = np.linalg.norm(np.diff(vertices, axis=0), axis=1)
    if np.any(gaps < 1e-9):
        row = int(np.argmin(gaps)) + 1
        raise InputError(f"path '{name}': points {row} and {row + 1} are the same point")
    return vertices


def _turn(corner: Array) -> float:
    """Angle (rad) by which a path turns at the middle of three points (3, 3)."""
    before, after = corner[1] - corner[0], corner[2] - corner[1]
    return math.atan2(float(np.linalg.norm(np.cross(before, after))), float(before @ after))


def _vector(vector: ArrayLike, name: str) -> Array:
    array = np.asarray(vector, dtype=np.float64)
    if array.shape != (3,) or not np.all(np.isfinite(array)):
        raise InputError(f"{name} = {array}; must be three finite numbers")
    return array


def _unit(vector: ArrayLike, name: str) -> Array:
    array = _vector(vector, name)
    size = float(np.linalg.norm(array))
    if not size > 0.0:
        raise InputError(f"{name} = {array}; must not be zero")
    return array / size


def _square_part(vector: Array, direction: Array) -> Array:
    """Unit vector of the part of a vector that is square to a unit direction.

    Taken twice: where the vector all but points along the direction, the first difference is square
    to it only in the few digits that are left.
    """
    for _ in range(2):
        vector = _unit(vector - np.dot(vector, direction) * direction, "side")
    return vector


def _line_row(start: float, point: Array, direction: Array, length: float) -> Array:
    row = np.zeros(COLUMNS)
    row[START], row[LENGTH] = start, length
    row[ORIGIN : ORIGIN + 3] = point
    row[U : U + 3] = direction
    return row


def _arc_row(
    start: float, centre: Array, radial: Array, tangent: Array, radius: float, angle: float
) -> Array:
    row = np.zeros(COLUMNS)
    row[START], row[LENGTH], row[RADIUS] = start, radius * angle, radius
    row[ORIGIN : ORIGIN + 3] = centre
    row[U : U + 3] = radial
    row[V : V + 3] = tangent
    return row
