"""How near an arm's bodies come to obstacles while it follows a path: bounds within milliseconds.

A body is a box (or a ball: a box of no size with a radius). The signed distance d to a convex shape
is a convex function, inside the shape too, so that from one point x with the gradient g, for every
point y of the box,

    d(y) >= d(x) + g . (y - x),

and the least of the right side over the box is at a corner. Minimising d over the box by
conditional gradients (Frank and Wolfe: towards that corner, with a line search) closes the gap
between this bound and the least d that was seen; the bound holds wherever one stops.

Between two postures a point of a body is never farther from where it is in one of them than half
the way between: so from the distances a and b at the ends of an interval in which no corner goes
farther than w, the distance inside is (a + b - w) / 2 at the least. Intervals are halved where that
is too little. Ways are measured along straight lines between postures and taken `_BENT` longer,
because bodies turn; that is an allowance, no proof. A certificate (`twin`) is one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.scene.shape_distance import distance_to_shape
from pips_drake.scene.signed_distance import SignedDistanceField
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.links import collision_shapes

Array = NDArray[np.float64]

#: Between an arm's posture and another an interval is not looked at more finely than this, m.
FINEST = 1e-3
#: By how much a bound may be below what was seen, m.
TOLERANCE = 2e-3
# Ways of corners between two postures are so much longer than straight.
_BENT = 1.05
# A bound of this share of what was seen is good where it is enough.
_GOOD_SHARE = 0.8
# Of a box's distance to a shape: the bound's gap, m, and the most rounds with so many points each.
_GAP, _MOST_ROUNDS, _HALVINGS = 5e-4, 16, 6
_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)


@dataclass(frozen=True, kw_only=True, eq=False)
class ArmBodies:
    """What of an arm can collide with a scene: B boxes and balls; the rail, which stands, is not.

    Attributes:
        names: of the bodies that they belong to, (B,).
        frames: the joint frame that each is fixed in, (B,), from 0.
        centres: in that frame, (B, 3) m.
        rotations: of the boxes' axes in it, (B, 3, 3).
        halves: half lengths, (B, 3) m; zeros of balls.
        radii: by which they are rounded, (B,) m; 0 of boxes.
    """

    names: tuple[str, ...]
    frames: NDArray[np.int64]
    centres: Array
    rotations: Array
    halves: Array
    radii: Array

    def placed(self, arm: SerpentineArm, joints: ArrayLike, shift: Array) -> tuple[Array, Array]:
        """Rotations (N, B, 3, 3) and centres (N, B, 3) m of postures (N, joints).

        Args:
            shift: from frame {0} to the frame that is wanted, (3,) m.
        """
        poses = kinematics.frames(arm, joints)[:, self.frames]
        turns = poses[..., :3, :3]
        centres = np.einsum("nbij,bj->nbi", turns, self.centres) + poses[..., :3, 3] + shift
        return turns @ self.rotations, centres


@dataclass(frozen=True, kw_only=True, eq=False)
class ClearanceBound:
    """The least distance of an arm to obstacles along a path.

    Attributes:
        lower: it is this at least, m, and no more than is looked for.
        seen: the least that was seen, m; what follows says where.
        body: the arm's.
        obstacle: index of the field's shape; -1 where nothing is as near as is looked for.
        point: of the body, (3,) m in the field's frame.
        tip_arc_length: m.
    """

    lower: float
    seen: float
    body: str
    obstacle: int
    point: Array
    tip_arc_length: float


def arm_bodies(arm: SerpentineArm) -> ArmBodies:
    """An arm's bodies, as the plant has them."""
    names, frames, centres, rotations, halves, radii = [], [], [], [], [], []
    for j, body in enumerate(arm.bodies):
        for shape in collision_shapes(arm, body):
            names.append(body.name)
            frames.append(j)
            centres.append(shape.centre)
            rotations.append(np.eye(3) if shape.rotation is None else shape.rotation.as_matrix())
            half, radius = np.zeros(3), 0.0
            if shape.kind == "box":
                half = 0.5 * shape.size
            elif shape.kind == "sphere":
                radius = float(shape.size[0])
            else:  # a cylinder is no larger than the box around it
                half = np.array([shape.size[0], shape.size[0], 0.5 * shape.size[1]])
            halves.append(half)
            radii.append(radius)
    return ArmBodies(
        names=tuple(names),
        frames=np.array(frames),
        centres=np.array(centres),
        rotations=np.array(rotations),
        halves=np.array(halves),
        radii=np.array(radii),
    )


def least_clearance(
    arm: SerpentineArm,
    field: SignedDistanceField,
    postures: Callable[[Array], Array],
    tip_arc_lengths: ArrayLike,
    *,
    shift: Array,
    within: float,
    enough: float = math.inf,
    tolerance: float = TOLERANCE,
    bodies: ArmBodies | None = None,
) -> ClearanceBound:
    """The least distance of an arm's bodies to obstacles, over all of a motion.

    Args:
        postures: joints (N, joints) at arc lengths of the tip (N,) m.
        tip_arc_lengths: where to begin with; their ends are the motion's, (K,) m, increasing.
        shift: from the arm's frame {0} to the field's, (3,) m.
        within: how far is looked, m: what is farther counts as that far.
        enough: a bound of this and of four fifths of what was seen is not improved, m.
        tolerance: nor is one that is less than this below what was seen, m.
        bodies: `arm_bodies(arm)`.
    """
    bodies = bodies or arm_bodies(arm)
    s = np.asarray(tip_arc_lengths, dtype=np.float64)
    look = _Look(arm, field, postures, bodies, np.asarray(shift), within)
    everything = np.arange(len(bodies.names))
    rows = np.repeat(np.arange(len(s)), everything.size)
    distances, corners = look.at(s, rows, np.tile(everything, len(s)))
    distances = distances.reshape(len(s), -1)
    corners = corners.reshape(*distances.shape, 8, 3)
    # Intervals: body, ends, distances at the ends, corners at the ends.
    body = np.tile(everything, len(s) - 1)
    ends = np.stack([np.repeat(s[:-1], everything.size), np.repeat(s[1:], everything.size)])
    at = np.stack([distances[:-1].ravel(), distances[1:].ravel()])
    places = np.stack([corners[:-1].reshape(-1, 8, 3), corners[1:].reshape(-1, 8, 3)])
    lower = look.lower
    while True:
        ways = _BENT * np.linalg.norm(places[1] - places[0], axis=-1).max(axis=-1)
        bounds = np.minimum(0.5 * (at[0] + at[1] - ways), within)
        good = min(look.lower - tolerance, max(enough, _GOOD_SHARE * look.lower))
        open_ = bounds < good
        open_ &= ends[1] - ends[0] > FINEST
        lower = min(lower, float(np.min(bounds[~open_], initial=math.inf)))
        if not open_.any():
            break
        body, ends, at, places = body[open_], ends[:, open_], at[:, open_], places[:, open_]
        middle, rows = np.unique(0.5 * (ends[0] + ends[1]), return_inverse=True)
        distance, corner = look.at(middle, rows, body)
        between = middle[rows]
        body = np.concatenate([body, body])
        ends = np.stack([np.append(ends[0], between), np.append(between, ends[1])])
        at = np.stack([np.append(at[0], distance), np.append(distance, at[1])])
        places = np.stack(
            [np.concatenate([places[0], corner]), np.concatenate([corner, places[1]])]
        )
    return ClearanceBound(
        lower=min(lower, look.lower),
        seen=look.seen,
        body=look.body,
        obstacle=look.obstacle,
        point=look.point,
        tip_arc_length=look.tip,
    )


def too_near(
    field: SignedDistanceField, found: ClearanceBound, margin: float, ahead: float | None = None
) -> str:
    """The sentence that says which body is too near to what.

    Args:
        margin: that it must keep, m.
        ahead: how far the tip is from home there, m.
    """
    where = ", ".join(f"{x + 0.0:.4g}" for x in np.round(found.point, 4))
    how = f"comes within {1e3 * found.lower:.1f} mm of"
    if found.seen < 0.0:
        how = f"is {-1e3 * found.seen:.1f} mm inside"
    tip = "" if ahead is None else f", with the tip {ahead:.4g} m from home"
    return (
        f"{found.body} {how} {field.label(found.obstacle)} at ({where}) m{tip}; must be "
        f"{1e3 * margin:.4g} mm or more from it"
    )


class _Look:
    """Distances of bodies in postures, and the least of all that were seen."""

    def __init__(
        self,
        arm: SerpentineArm,
        field: SignedDistanceField,
        postures: Callable[[Array], Array],
        bodies: ArmBodies,
        shift: Array,
        within: float,
    ) -> None:
        self._arm, self._field, self._postures = arm, field, postures
        self._bodies, self._shift, self._within = bodies, shift, within
        self.seen = self.lower = within
        self.body, self.obstacle, self.point, self.tip = "", -1, np.full(3, np.nan), math.nan

    def at(self, s: Array, rows: NDArray[np.int64], body: NDArray[np.int64]) -> tuple[Array, Array]:
        """Distances (K,) m and corners (K, 8, 3) m of bodies (K,) at rows (K,) of arc lengths."""
        bodies = self._bodies
        turns, centres = bodies.placed(self._arm, self._postures(s), self._shift)
        turns, centres = turns[rows, body], centres[rows, body]
        lower, seen, shapes, points = boxes_to_field(
            self._field.arrays,
            np.ascontiguousarray(turns),
            np.ascontiguousarray(centres),
            bodies.halves[body],
            bodies.radii[body],
            self._within,
        )
        k = int(np.argmin(seen))
        self.lower = min(self.lower, float(lower.min()))
        if seen[k] < self.seen:
            self.seen, self.body = float(seen[k]), bodies.names[body[k]]
            self.obstacle, self.point, self.tip = int(shapes[k]), points[k], float(s[rows[k]])
        offsets = np.einsum("kij,kcj->kci", turns, _CORNERS * bodies.halves[body][:, None])
        return lower, centres[:, None] + offsets


@numba.njit(cache=True)
def boxes_to_field(field, rotations, centres, halves, radii, within):
    """Bounds of distances from rounded boxes to the nearest shapes.

    Args:
        field: M shapes (`scene.shape_distance`).
        rotations, centres: of K boxes in the world, (K, 3, 3), (K, 3) m.
        halves, radii: half lengths (K, 3) m, and how far they are rounded, (K,) m.
        within: distances are looked for up to here, m.

    Returns:
        Lower and upper bounds (K,) m, at most `within`; the shapes (K,), -1 where none is that
        near; points of the boxes' surfaces with those upper bounds, (K, 3) m.
    """
    count, shapes = centres.shape[0], field.kinds.shape[0]
    lower, upper = np.full(count, within), np.full(count, within)
    nearest, points = np.full(count, -1), np.full((count, 3), np.nan)
    room, point = np.empty((6, 3)), np.empty(3)
    for k in range(count):
        R, c, h = rotations[k], centres[k], halves[k]
        ball = radii[k] + math.sqrt(h[0] * h[0] + h[1] * h[1] + h[2] * h[2])
        for m in range(shapes):
            reach = upper[k] + ball + field.radii[m]
            dx, dy, dz = (
                c[0] - field.centres[m, 0],
                c[1] - field.centres[m, 1],
                c[2] - field.centres[m, 2],
            )
            if dx * dx + dy * dy + dz * dz > reach * reach:
                continue
            low, high = _box_to_shape(field, m, R, c, h, radii[k], upper[k], room, point)
            lower[k] = min(lower[k], low)
            if high < upper[k]:
                upper[k], nearest[k] = high, m
                points[k] = point
    return lower, upper, nearest, points


@numba.njit(cache=True)
def _box_to_shape(field, m, R, c, h, radius, enough, room, point):
    """Bounds of the distance from a rounded box to shape m; neither is sought above `enough`.

    Args:
        room: (6, 3), for numbers in between.
        point: out, the point of the box's surface that the upper bound is of, (3,) m.
    """
    x, start, corner, g = room[0], room[1], room[2], room[3]
    best, to_shape = room[4], room[5]
    lower, upper = -np.inf, np.inf
    x[:] = 0.0  # in the box's axes, from its middle
    for _ in range(_MOST_ROUNDS):
        d, bound = _look_from(field, m, R, c, h, x, g)
        lower = max(lower, bound - radius)
        if d - radius < upper:
            upper = d - radius
            _write_point(R, c, x, g, radius, point)
        if lower >= enough or upper - lower <= _GAP:
            break
        least = d
        for i in range(3):
            start[i], corner[i] = x[i], -math.copysign(h[i], g[i])
            best[i], to_shape[i] = x[i], d * g[i]
        # To the corner, or to where on the way to it the distance no longer falls.
        low, high, share = 0.0, 1.0, 1.0
        for _ in range(_HALVINGS):
            for i in range(3):
                x[i] = start[i] + share * (corner[i] - start[i])
            d, bound = _look_from(field, m, R, c, h, x, g)
            lower = max(lower, bound - radius)
            if d - radius < upper:
                upper = d - radius
                _write_point(R, c, x, g, radius, point)
            slope = 0.0
            for i in range(3):
                slope += g[i] * (corner[i] - start[i])
                if d < least:
                    best[i], to_shape[i] = x[i], d * g[i]
            least = min(least, d)
            if slope <= 0.0:
                low = share
            else:
                high = share
            if low == 1.0 or lower >= enough or upper - lower <= _GAP:
                break
            share = 0.5 * (low + high)
        if lower >= enough or upper - lower <= _GAP:
            break
        # From the best point to the shape's nearest one, and back to the box's: exact at once on
        # faces, where conditional gradients go to and fro.
        for i in range(3):
            x[i] = min(max(best[i] - to_shape[i], -h[i]), h[i])
    return lower, upper


@numba.njit(cache=True)
def _look_from(field, m, R, c, h, x, g):
    """Distance at a point x of a box, and its bound over the box; writes the gradient there, g."""
    wx = c[0] + R[0, 0] * x[0] + R[0, 1] * x[1] + R[0, 2] * x[2]
    wy = c[1] + R[1, 0] * x[0] + R[1, 1] * x[1] + R[1, 2] * x[2]
    wz = c[2] + R[2, 0] * x[0] + R[2, 1] * x[1] + R[2, 2] * x[2]
    d, gx, gy, gz = distance_to_shape(field, m, wx, wy, wz)
    bound = d
    for i in range(3):
        g[i] = R[0, i] * gx + R[1, i] * gy + R[2, i] * gz
        bound -= abs(g[i]) * h[i] + g[i] * x[i]
    return d, bound


@numba.njit(cache=True)
def _write_point(R, c, x, g, radius, point):
    """The rounded box's surface at x (in the box's axes), towards -g, in the world."""
    for axis in range(3):
        point[axis] = c[axis]
        for i in range(3):
            point[axis] += R[axis, i] * (x[i] - radius * g[i])
