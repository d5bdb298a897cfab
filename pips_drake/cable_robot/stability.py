"""Stability of a platform on cables: is there tension in all of them, and does any motion slacken?

CABLE-96, section 3. A pose is kinematically unstable if some motion makes cables shorter and none
longer. Stiemke's lemma: for every matrix L exactly one of these exists,

- tensions T > 0 with L^T T = 0: the cables pull against each other without any load; or
- a twist t with L t <= 0 that is not zero: it lengthens no cable and shortens at least one.

So the report's theorem, a left null vector of L with positive components only, follows. Where the
rank of L is below the freedoms (the theorem says "nonsingular"), another twist has L t = 0: no
cable resists it to first order. Such poses are not counted as stable here either; where tensions
T > 0 of the first kind exist as well, they are returned, and the twist is one of those.

Three tests of one thing, each with its own certificate:

- `half_plane`, at most two cables more than freedoms: T = N z > 0 says that all rows of N, points
  of a plane, are on one side of a line. That is so if, among their sorted directions, there is a
  gap of more than half a turn.
- `tension`, any number of cables: the largest s with s <= T <= 1 - s and L^T T = 0.
- `motion`, any number of cables: the largest total shortening of a twist with 0 <= -L t <= 1.

A pose is statically stable if tensions T > 0 balance the weight (and another wrench). Kinematic
stability implies that: add enough of the null vector to any solution, of which there is one because
the rank is full. Not the other way: a platform below all its anchors can hang like a pendulum. (The
report says that it does; it does only where it balances: level and off to one side it would tilt.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.cable_robot.kinematics import Poses, jacobian
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.statics import (
    BALANCED,
    characteristic_length,
    general_solution,
    moment_scales,
)
from pips_drake.cable_robot.tension_methods import prepare, solve_linear
from pips_drake.errors import InputError, UnknownNameError

Array = NDArray[np.float64]

#: Least tensions over the largest, shortenings over the largest, parts of null vectors, and radians
#: beyond half a turn count as zero below this.
ZERO = 1e-9


@dataclass(frozen=True, eq=False)
class KinematicStability:
    """What a test found, one row a pose.

    Attributes:
        stable: no motion without a longer cable, (N,).
        rank: of L, (N,); stable poses have all the freedoms.
        tension: T > 0 with L^T T = 0 and 1 as its largest component, (N, M); nan where none exists.
        motion: a twist that lengthens no cable, in the world, (N, freedom) m and rad, at which the
            most shortened cable gets 1 m shorter; where `tension` exists too, one that changes no
            length, of length 1 with its rotation times the robot's characteristic length. nan where
            the pose is stable, and where no certificates were asked for.
    """

    stable: NDArray[np.bool_]
    rank: NDArray[np.int64]
    tension: Array
    motion: Array


@dataclass(frozen=True, eq=False)
class StaticStability:
    """Whether the cables hold the load, one row a pose.

    Attributes:
        stable: positive tensions balance the weight and the wrench, (N,).
        slack: the largest least tension, (N,) N: inf if the cables can be tightened at will, -inf
            where no tensions of any sign balance the wrench.
        tensions: positive ones where stable, otherwise those whose least one is largest, (N, M) N.
    """

    stable: NDArray[np.bool_]
    slack: Array
    tensions: Array


def kinematic_stability(
    robot: CableRobot, poses: Poses, method: str = "tension", *, certificates: bool = True
) -> KinematicStability:
    """Tests N poses.

    Args:
        method: `half_plane`, `tension` or `motion`.
        certificates: whether the motions are wanted; they take longer than the tests.

    Raises:
        InputError: an unknown method, or too many cables for the half planes.
    """
    if method not in METHODS:
        raise UnknownNameError("stability test", method, list(METHODS))
    if method == "half_plane" and robot.cables > robot.freedom + 2:
        raise InputError(
            f"{robot.name}: {robot.cables} cables and {robot.freedom} freedoms; half_plane takes "
            "at most 2 cables more than freedoms; use tension"
        )
    solution = general_solution(robot, poses)
    tension = np.full((len(poses), robot.cables), np.nan)
    shortening = np.full((len(poses), robot.cables), np.nan)
    for chosen, null_space in solution.by_rank():
        if method == "motion":
            rank = robot.cables - null_space.shape[2]
            found = _motion_program(np.ascontiguousarray(solution.bases[chosen][:, :, :rank]))
        elif method == "half_plane" and null_space.shape[2] <= 2:
            found = _half_planes(null_space)
        else:  # poses of lower rank have more than two dimensions of null vectors
            found = _tension_program(null_space)
        tension[chosen], shortening[chosen] = found
    positive = np.all(np.isfinite(tension), axis=1)
    stable = positive & (solution.rank == robot.freedom)
    motion = np.full((len(poses), robot.freedom), np.nan)
    if certificates:
        motion[~stable] = _twists(robot, poses, shortening, ~stable)
    return KinematicStability(stable, solution.rank, tension, motion)


def static_stability(
    robot: CableRobot, poses: Poses, wrench: ArrayLike | None = None
) -> StaticStability:
    """Whether positive tensions hold N platforms; see `statics.total_wrench` for the wrench."""
    solution = general_solution(robot, poses, wrench)
    slack, tensions = np.empty(len(poses)), np.empty((len(poses), robot.cables))
    stable = np.zeros(len(poses), dtype=bool)
    for chosen, null_space in solution.by_rank():
        program, unit = prepare(null_space, solution.shortest[chosen], 0.0, np.inf)
        slack[chosen] = program.slack * unit
        tensions[chosen] = program.tensions(program.roomiest) * unit[:, None]
        stable[chosen] = program.slack > ZERO
    balanced = solution.residual <= BALANCED
    slack[~balanced] = -np.inf
    return StaticStability(stable & balanced, slack, tensions)


def _tension_program(null_space: Array) -> tuple[Array, Array]:
    """Largest s <= T <= 1 - s. If s = 0, the multipliers y of T >= s are a shortening: N^T y = 0,
    so that y is in the range of L, and y >= 0 sums to 1.
    """
    poses, cables, _ = null_space.shape
    room, most = np.zeros((poses, cables)), np.ones(poses)
    x, multipliers = solve_linear([-null_space, null_space], [1.0, 1.0], [room, room + 1.0], most)
    tension = (null_space @ x[:, :-1, None])[..., 0]
    return _normed(tension, x[:, -1] > ZERO), _normed(multipliers[:, :cables], x[:, -1] <= ZERO)


def _motion_program(range_space: Array) -> tuple[Array, Array]:
    """Largest total of 0 <= u <= 1 with u = -L t in the range of L.

    If it is 0, the multipliers y of u >= 0 and that of the total, 1, are tensions: L^T (y + 1) = 0.
    """
    poses, cables, _ = range_space.shape
    room = np.zeros((poses, cables))
    total = -range_space.sum(axis=1, keepdims=True)
    x, multipliers = solve_linear(
        [-range_space, range_space, total],
        [0.0, 0.0, 1.0],
        [room, room + 1.0, np.zeros((poses, 1))],
        np.full(poses, 2.0 * cables),
    )
    shortening = (range_space @ x[:, :-1, None])[..., 0]
    shortens = x[:, -1] > ZERO
    return _normed(multipliers[:, :cables] + 1.0, ~shortens), _normed(shortening, shortens)


def _half_planes(null_space: Array) -> tuple[Array, Array]:
    """Gaps among the directions of N's rows; a row is 0 where a cable can bear no inner tension."""
    poses, cables, size = null_space.shape
    if size < 2:  # on a line: one direction more, in which no row points
        wider = np.zeros((poses, cables, 2))
        wider[..., :size] = null_space
        null_space = wider
    each = np.arange(poses)
    lengths = np.linalg.norm(null_space, axis=2)
    angles = np.arctan2(null_space[..., 1], null_space[..., 0])
    order = np.argsort(angles, axis=1)
    ordered = np.take_along_axis(angles, order, axis=1)
    gaps = np.roll(ordered, -1, axis=1) - ordered
    gaps[:, -1] += 2.0 * np.pi
    before = np.argmax(gaps, axis=1)
    gap = gaps[each, before]
    idle = lengths.min(axis=1) <= ZERO
    positive = (gap > np.pi + ZERO) & ~idle
    # Away from the middle of the gap.
    middle = ordered[each, before] + 0.5 * gap + np.pi
    tension = (null_space @ np.stack([np.cos(middle), np.sin(middle)], axis=1)[..., None])[..., 0]

    # The row before the gap and the two rows about its opposite add up to nothing: no gap is wider
    # than half a turn. Together with N^T y = 0 that says that y is a shortening.
    shortening = np.zeros((poses, cables))
    first = order[each, before]
    opposite = ordered[each, before] + np.pi
    turned = np.mod(opposite[:, None] - angles, 2.0 * np.pi)
    turned[turned > 2.0 * np.pi - ZERO] = 0.0
    low = np.argmin(turned, axis=1)
    high = np.argmax(turned, axis=1)
    behind, ahead = turned[each, low], 2.0 * np.pi - turned[each, high]
    shares = np.where(behind <= ZERO, [[1.0], [0.0]], [np.sin(ahead), np.sin(behind)])
    wide = np.where(behind <= ZERO, 1.0, np.sin(ahead + behind))
    with np.errstate(divide="ignore", invalid="ignore"):
        shortening[each, first] += 1.0 / lengths[each, first]
        shortening[each, low] += shares[0] / wide / lengths[each, low]
        shortening[each, high] += shares[1] / wide / lengths[each, high]
    shortening[idle] = 0.0
    shortening[idle, np.argmin(lengths, axis=1)[idle]] = 1.0
    return _normed(tension, positive), _normed(shortening, ~positive)


def _normed(vectors: Array, wanted: NDArray[np.bool_]) -> Array:
    """Vectors with 1 as their largest component, nan where they are not wanted."""
    result = np.full(vectors.shape, np.nan)
    result[wanted] = vectors[wanted] / vectors[wanted].max(axis=1, keepdims=True)
    return result


def _twists(robot: CableRobot, poses: Poses, shortening: Array, wanted: NDArray[np.bool_]) -> Array:
    """Twists t with -L t the shortening; without one, those that L makes smallest."""
    scales = moment_scales(robot, characteristic_length(robot))
    L = jacobian(robot, Poses(poses.position[wanted], poses.rotation[wanted])) / scales
    u = shortening[wanted]
    none = np.isnan(u[:, 0])
    twists = np.empty((len(L), robot.freedom))
    twists[~none] = -(np.linalg.pinv(L[~none]) @ u[~none][..., None])[..., 0]
    if none.any():
        twists[none] = np.linalg.svd(L[none])[2][:, -1]
    return twists / scales


METHODS = ("half_plane", "tension", "motion")
