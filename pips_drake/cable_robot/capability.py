"""Forces and moments that a platform on cables can bear or apply, and its matrices' directions.

CABLE-96, section 4. Within bounds low <= T <= high the cables can balance the wrenches of a convex
set, a zonotope (the available wrench set). The largest force in a direction is where a ray leaves
it; the largest force in every direction is the radius of the largest ball of forces in it.

Method: the set's faces, by hyperplane shifting (S. Bouchard, C. Gosselin and B. Moore, "On the
Ability of a Cable-Driven Robot to Generate a Prescribed Set of Wrenches", 2010). Each face's normal
n is square to freedom - 1 columns of A that are independent. It is cheaper to seek y = A^T n, whose
components for those cables are zero: y is in the range of A^T, so N^T y = 0 with A's null space N,
and it has M - freedom + 1 components left; for CABLE-96's box these are cross products of two rows
of N each, for 56 triples of cables. On that face

    y . T <= sum max(y_i low, y_i high) = h(y).

With T0 a solution for the load and P = (L^T)^+, the tensions for another wrench d on the platform
are T0 + P d + N z, and y . N z = 0. So all d with y . (T0 + P d) <= h(y), for every y and -y, can
be balanced, and no others: it is exact. A pose where the rank of L is below the freedoms balances
no ball of wrenches: its capability is 0 (also along directions that happen to be possible).

The same y answer both questions of `stability`, because they are the vectors of least support in
the range of L, so that some of them span every cone y >= 0 there. A pose is kinematically stable if
none of them has components of one sign only, and statically stable if y . T0 > 0 for those that
have: Stiemke's and Farkas's lemmas.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.cable_robot.kinematics import Poses, jacobian
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.statics import (
    GeneralSolution,
    characteristic_length,
    general_solution,
    moment_scales,
)
from pips_drake.config import require
from pips_drake.errors import InputError

Array = NDArray[np.float64]

#: Components of y over its largest, and y . T0 over the largest tension, that count as zero.
_ZERO = 1e-10


@dataclass(frozen=True, eq=False)
class Capability:
    """What N poses can bear beyond their weight, within the tensions' bounds.

    Attributes:
        margin: how much more of the disturbance box fits, (N,): the largest k such that the weight
            with every wrench of k times the box can be balanced; negative where not even the weight
            can: then by which share of the box's size; inf for a box without size.
        force: the largest force in every direction at once, without moment, (N,) N; negative where
            the weight is not balanced.
        moment: the largest moment in every direction, without force, (N,) N m.
        along: how far along given wrenches one can go, (N, K), in units of them; negative where the
            weight is not balanced.
        full_rank: whether L has all the freedoms; the numbers above are 0 otherwise, (N,).
        kinematic, static: stability as in `stability`, (N,); False without full rank.
    """

    margin: Array
    force: Array
    moment: Array
    along: Array
    full_rank: NDArray[np.bool_]
    kinematic: NDArray[np.bool_]
    static: NDArray[np.bool_]


def pseudoinverse(L: ArrayLike, solution: GeneralSolution) -> Array:
    """L^+, (N, freedom, M), by the decomposition at hand; 0 where the rank is not full.

    With the range's orthonormal basis Q1, L = Q1 (Q1^T L), so L^+ = (Q1^T L)^-1 Q1^T.
    """
    matrices = np.asarray(L, dtype=np.float64)
    freedom = matrices.shape[2]
    full = solution.rank == freedom
    result = np.zeros((len(matrices), freedom, matrices.shape[1]))
    first = np.swapaxes(solution.bases[full][:, :, :freedom], 1, 2)
    result[full] = np.linalg.solve(first @ matrices[full], first)
    return result


def wrench_capability(
    robot: CableRobot,
    poses: Poses,
    *,
    disturbance: ArrayLike | None = None,
    directions: ArrayLike = (),
    wrench: ArrayLike | None = None,
    tension_min: float | None = None,
    tension_max: float | None = None,
) -> Capability:
    """What N poses can bear.

    Args:
        disturbance: half sizes of a box of wrenches, (freedom,) N and N m.
        directions: wrenches on the platform, (K, freedom) N and N m in the world's axes: how far
            one can go along each of them.
        wrench: besides the weight; see `statics.total_wrench`.
        tension_min, tension_max: other bounds than the robot's, N.
    """
    low = robot.tension_min if tension_min is None else tension_min
    high = robot.tension_max if tension_max is None else tension_max
    shown = f"{low:g} .. {high:g} N"
    require(0.0 <= low < high, f"{robot.name}: tension bounds", shown, "rising, from 0 or more")
    L, solution = jacobian(robot, poses), general_solution(robot, poses, wrench)
    return capability_of(
        robot, L, solution, pseudoinverse(L, solution), (low, high), disturbance, directions
    )


def capability_of(
    robot: CableRobot,
    L: Array,
    solution: GeneralSolution,
    inverse: Array,
    bounds: tuple[float, float],
    disturbance: ArrayLike | None = None,
    directions: ArrayLike = (),
) -> Capability:
    """`wrench_capability` where Jacobian, solution and L^+ are known already."""
    freedom = robot.freedom
    box = np.array(np.zeros(freedom) if disturbance is None else disturbance, dtype=np.float64)
    if box.shape != (freedom,) or not np.all(np.isfinite(box) & (box >= 0.0)):
        raise InputError(f"disturbance {box.tolist()}; must be ({freedom},), >= 0, N and N m")
    ways = np.array(directions, dtype=np.float64).reshape(-1, freedom)
    if not np.all(np.isfinite(ways)):
        raise InputError("directions: must be finite wrenches, N and N m")
    full = solution.rank == freedom
    result = np.zeros((len(L), 3 + len(ways)))
    size = robot.cables - freedom
    faces = np.array(list(itertools.combinations(range(robot.cables), size + 1)), dtype=np.int64)
    forces = np.array([component < 3 for component in robot.freedoms])
    stable = np.zeros((len(L), 2), dtype=bool)
    result[full], stable[full] = _distances_of_faces(
        np.ascontiguousarray(solution.bases[full][:, :, freedom:]),
        np.ascontiguousarray(solution.shortest[full]),
        np.ascontiguousarray(np.swapaxes(inverse[full], 1, 2)),
        float(bounds[0]),
        float(bounds[1]),
        faces,
        box,
        forces,
        ways,
    )
    margin, force, moment = result[:, :3].T
    return Capability(margin, force, moment, result[:, 3:], full, stable[:, 0], stable[:, 1])


@numba.njit(cache=True)
def _distances_of_faces(null_spaces, shortest, inverses, low, high, faces, box, forces, ways):
    """Columns of `Capability`, (P, 3 + K), and kinematic and static stability, (P, 2)."""
    count, _, size = null_spaces.shape
    freedom = inverses.shape[2]
    result = np.full((count, 3 + len(ways)), np.inf)
    stable = np.ones((count, 2), np.bool_)
    rows = np.empty((size + 1, size))
    y = np.empty(size + 1)
    normal = np.empty(freedom)
    order = np.empty(size + 1, np.int64)
    for p in range(count):
        N, P, T = null_spaces[p], inverses[p], shortest[p]
        largest_tension = np.abs(T).max()
        for face in faces:
            # y with y . rows = 0, by elimination of columns; the last row left over is free.
            for i in range(size + 1):
                order[i] = i
                for j in range(size):
                    rows[i, j] = N[face[i], j]
            largest, singular = 0.0, False
            for k in range(size):
                best, row, column = 0.0, k, k
                for i in range(k, size + 1):
                    for j in range(k, size):
                        if abs(rows[i, j]) > best:
                            best, row, column = abs(rows[i, j]), i, j
                largest = max(largest, best)
                if best <= 1e-10 * largest:
                    singular = True
                    break
                order[k], order[row] = order[row], order[k]
                for j in range(size):
                    rows[k, j], rows[row, j] = rows[row, j], rows[k, j]
                for i in range(size + 1):
                    rows[i, k], rows[i, column] = rows[i, column], rows[i, k]
                for j in range(size):
                    if j != k:
                        factor = rows[k, j] / rows[k, k]
                        for i in range(k, size + 1):
                            rows[i, j] -= factor * rows[i, k]
            if singular:
                continue
            y[size] = 1.0
            peak = 1.0
            for k in range(size):
                y[k] = -rows[size, k] / rows[k, k]
                peak = max(peak, abs(y[k]))
            across, value = 0.0, 0.0
            up, down = 0.0, 0.0  # h(y) and h(-y)
            ups, downs = 0, 0
            for j in range(freedom):
                normal[j] = 0.0
            for k in range(size + 1):
                component = y[k] / peak
                cable = face[order[k]]
                if component > _ZERO:
                    ups += 1
                    up += component * high
                    down -= component * low
                elif component < -_ZERO:
                    downs += 1
                    up += component * low
                    down -= component * high
                else:
                    continue
                value += component * T[cable]
                for j in range(freedom):
                    normal[j] += component * P[cable, j]
            if downs == 0 or ups == 0:
                stable[p, 0] = False
                if (value if downs == 0 else -value) <= _ZERO * largest_tension:
                    stable[p, 1] = False
            force, moment = 0.0, 0.0
            for j in range(freedom):
                across += abs(normal[j]) * box[j]
                if forces[j]:
                    force += normal[j] * normal[j]
                else:
                    moment += normal[j] * normal[j]
            room = min(up - value, down + value)
            found = result[p]
            if across > 0.0:
                found[0] = min(found[0], room / across)
            elif room < 0.0:
                found[0] = -np.inf
            if force > 0.0:
                found[1] = min(found[1], room / np.sqrt(force))
            if moment > 0.0:
                found[2] = min(found[2], room / np.sqrt(moment))
            for k in range(len(ways)):
                speed = 0.0
                for j in range(freedom):
                    speed += normal[j] * ways[k, j]
                if room < 0.0:
                    found[3 + k] = min(found[3 + k], room / max(abs(speed), 1e-300))
                elif speed > 0.0:
                    found[3 + k] = min(found[3 + k], (up - value) / speed)
                elif speed < 0.0:
                    found[3 + k] = min(found[3 + k], (down + value) / -speed)
    return result, stable


@dataclass(frozen=True, eq=False)
class MatrixDirections:
    """Singular values of N matrices and what belongs to them, largest value first.

    Attributes:
        values: (N, freedom).
        twists: (N, freedom, freedom), row k moves the platform in the k-th direction: m and rad, of
            length 1 once rotations are multiplied by `length`.
        length: m.
    """

    values: Array
    twists: Array
    length: float

    @property
    def flimsiest(self) -> Array:
        """The twist that changes lengths least, or meets the least stiffness, (N, freedom)."""
        return self.twists[:, -1]

    @property
    def condition(self) -> Array:
        """Largest over least value, (N,); inf where the least is 0."""
        with np.errstate(divide="ignore"):
            return np.asarray(self.values[:, 0] / self.values[:, -1])


def jacobian_directions(
    robot: CableRobot, poses: Poses, length: float | None = None
) -> MatrixDirections:
    """SVD of L, with rotations as arcs of radius `length` (the characteristic one): m per m.

    CABLE-96, section 4: the motion that changes the lengths least is the one in which the robot is
    most flimsy.
    """
    radius = characteristic_length(robot) if length is None else length
    require(np.isfinite(radius) and radius > 0.0, "length of rotations", f"{radius:g} m", "> 0")
    scales = moment_scales(robot, radius)
    _, values, rows = np.linalg.svd(jacobian(robot, poses) / scales, full_matrices=False)
    return MatrixDirections(values, rows / scales, radius)


def stiffness_svd(robot: CableRobot, K: ArrayLike, length: float | None = None) -> MatrixDirections:
    """SVD of stiffness matrices (N, freedom, freedom), scaled likewise: N/m.

    The values of a matrix that is not positive definite lose their signs; see
    `stiffness.stiffness_directions`, which keeps them.
    """
    radius = characteristic_length(robot) if length is None else length
    require(np.isfinite(radius) and radius > 0.0, "length of rotations", f"{radius:g} m", "> 0")
    scales = moment_scales(robot, radius)
    scaled = np.asarray(K, dtype=np.float64) / scales / scales[:, None]
    _, values, rows = np.linalg.svd(scaled)
    return MatrixDirections(values, rows / scales, radius)
