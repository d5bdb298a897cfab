"""Statics of a platform on cables: which tensions hold it, and which of them to choose.

CABLE-96, section 2.3, with every wrench on one side: A T + w = 0 with A = -L^T, T the tensions and
w what the weight and whatever else do to the platform, about its origin, in the world's axes. (The
report writes A F = W; its W is what the cables must do, -w.) All solutions are T = T0 + N z: T0 is
the shortest, and N's orthonormal columns span the null space of A, M - rank of them. Which z, see
`tension_methods`.

Forces and moments are compared, for ranks and residuals, after division of the moments by the
robot's characteristic length. Where A's rank is below the freedoms, some wrenches cannot be
balanced at all: then the residual is not small, and no tensions are feasible.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.cable_robot import tension_methods
from pips_drake.cable_robot.kinematics import Poses, jacobian
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.tension_kernels import decompose
from pips_drake.config import require
from pips_drake.errors import InputError, UnknownNameError

Array = NDArray[np.float64]

#: A column of L that stands out of the others' span by less than this share of the longest adds
#: nothing to the rank. Directions of cables have errors of some 1e-16.
RANK_TOLERANCE = 1e-9
#: A wrench is balanced if no more than this share of it is left over.
BALANCED = 1e-9
#: Bounds are kept if tensions, over the largest number among them and the bounds, miss them by no
#: more than this.
BOUNDS_KEPT = 1e-10


@dataclass(frozen=True, eq=False)
class GeneralSolution:
    """All tensions T0 + N z that hold N platforms.

    Attributes:
        shortest: T0, (N, M) N.
        bases: orthogonal matrices (N, M, M); the columns from `rank` on span the null space of A.
        rank: of A, (N,).
        residual: |A T0 + w| over |w| (over |T0| without w), (N,).
    """

    shortest: Array
    bases: Array
    rank: NDArray[np.int64]
    residual: Array

    def null_space(self, pose: int) -> Array:
        """N of one pose, (M, M - rank)."""
        return self.bases[pose][:, self.rank[pose] :]

    def by_rank(self) -> list[tuple[NDArray[np.int64], Array]]:
        """Poses of equal rank, and their null spaces (P, M, M - rank)."""
        groups = []
        for rank in np.unique(self.rank):
            poses = np.flatnonzero(self.rank == rank)
            groups.append((poses, np.ascontiguousarray(self.bases[poses][:, :, rank:])))
        return groups


@dataclass(frozen=True, eq=False)
class TensionDistribution:
    """Tensions chosen by a method, one row a pose.

    Attributes:
        tensions: (N, M) N. Where nothing is feasible: those that miss the bounds least.
        feasible: whether these tensions hold the platform within the bounds, (N,). All methods but
            `closed_form` find such tensions wherever there are some.
        slack: the largest s, N, such that low + s <= T <= high - s has a solution, (N,): negative
            where the bounds cannot be kept, and then by how much; inf without an upper bound, if
            all cables can be tightened as much as one likes; -inf where no tensions of any sign
            balance the wrench.
        residual: |A T + w| over |w| (over |T| without w), moments over the characteristic length.
        method: its name.
    """

    tensions: Array
    feasible: NDArray[np.bool_]
    slack: Array
    residual: Array
    method: str


def characteristic_length(robot: CableRobot) -> float:
    """The farthest attachment's distance from the platform's origin, m; 1 if all are there."""
    farthest = float(np.linalg.norm(robot.attachments, axis=1).max())
    return farthest if farthest > 0.0 else 1.0


def moment_scales(robot: CableRobot, length: float) -> Array:
    """What divides a wrench's components to make them all forces, (freedom,): 1 and `length`."""
    return np.array([1.0 if component < 3 else length for component in robot.freedoms])


def structure_matrix(robot: CableRobot, poses: Poses) -> Array:
    """A = -L^T, the wrench on the platform of unit tensions, (N, freedom, M)."""
    return np.asarray(-np.swapaxes(jacobian(robot, poses), 1, 2))


def total_wrench(robot: CableRobot, poses: Poses, wrench: ArrayLike | None = None) -> Array:
    """w: the weight's and another wrench on the platform, about its origin, (N, freedom).

    Args:
        wrench: the other one, (freedom,) or (N, freedom) N and N m in the world's axes.
    """
    weight = robot.weight_wrench(poses.rotation)
    if wrench is None:
        return weight
    other = np.asarray(wrench, dtype=np.float64)
    shapes = ((robot.freedom,), (len(poses), robot.freedom))
    if other.shape not in shapes or not np.all(np.isfinite(other)):
        raise InputError(
            f"{robot.name}: wrench of shape {other.shape}; must be {shapes[0]} or {shapes[1]}, "
            "finite, N and N m"
        )
    return weight + other


def general_solution(
    robot: CableRobot, poses: Poses, wrench: ArrayLike | None = None
) -> GeneralSolution:
    """T0 and N of every pose; see `total_wrench` for `wrench`."""
    L, w = jacobian(robot, poses), total_wrench(robot, poses, wrench)
    scales = moment_scales(robot, characteristic_length(robot))
    # A T + w = 0 is L^T T = w.
    bases, rank, shortest = decompose(
        np.ascontiguousarray(L / scales), np.ascontiguousarray(w / scales), RANK_TOLERANCE
    )
    return GeneralSolution(shortest, bases, rank, _residual(L, w, shortest, scales))


def _residual(L: Array, w: Array, tensions: Array, scales: Array) -> Array:
    left = w - (np.swapaxes(L, 1, 2) @ tensions[..., None])[..., 0]
    size = np.linalg.norm(w / scales, axis=1)
    size = np.where(size > 0.0, size, np.linalg.norm(tensions, axis=1))
    left_over = np.linalg.norm(left / scales, axis=1)
    return np.divide(left_over, size, out=np.zeros(len(w)), where=size > 0.0)


def distribute_tensions(
    robot: CableRobot,
    poses: Poses,
    method: str = "analytic_center",
    *,
    wrench: ArrayLike | None = None,
    tension_min: float | None = None,
    tension_max: float | None = None,
) -> TensionDistribution:
    """Tensions within bounds that hold the platform at N poses.

    Args:
        method: a name of `tension_methods.METHODS`; `closed_form` and `analytic_center` need an
            upper bound.
        wrench: see `total_wrench`.
        tension_min, tension_max: other bounds than the robot's, N.

    Raises:
        InputError: an unknown method, bounds that cross or are missing, a wrench of no use.
    """
    if method not in tension_methods.METHODS:
        raise UnknownNameError("tension method", method, list(tension_methods.METHODS))
    low = robot.tension_min if tension_min is None else tension_min
    high = robot.tension_max if tension_max is None else tension_max
    shown = f"{low:g} .. {high:g} N"
    require(0.0 <= low < high, f"{robot.name}: tension bounds", shown, "rising, from 0 or more")
    bounded = bool(np.isfinite(high)) or method not in tension_methods.NEED_BOTH_BOUNDS
    require(bounded, f"{robot.name}: tension_max", f"{high:g} N", f"finite for {method}")

    solution = general_solution(robot, poses, wrench)
    tensions, slack = np.empty_like(solution.shortest), np.empty(len(poses))
    feasible = np.zeros(len(poses), dtype=bool)
    for chosen, null_spaces in solution.by_rank():
        found = tension_methods.choose(
            method, null_spaces, solution.shortest[chosen], low, high, BOUNDS_KEPT
        )
        tensions[chosen], slack[chosen], feasible[chosen] = found
    balanced = solution.residual <= BALANCED
    slack[~balanced] = -np.inf
    scales = moment_scales(robot, characteristic_length(robot))
    L, w = jacobian(robot, poses), total_wrench(robot, poses, wrench)
    residual = _residual(L, w, tensions, scales)
    return TensionDistribution(tensions, feasible & balanced, slack, residual, method)
