"""What errors of the cables' lengths do to the pose: accuracy, resolution, a camera's aim.

CABLE-96, section 4: L relates changes of lengths and motions, so it says how accurate the lengths
must be. A pose is found from lengths by least squares here, as in `kinematics.forward_kinematics`:
errors d of the lengths make the error L^+ d of the pose. That is to first order; it is what elastic
cables of equal stiffness do too, if they stay taut.

Each length may be wrong by e in either direction, all at once: |d_i| <= e. Then

- a component of the pose errs by e times the 1-norm of its row of L^+, and by no more: exact;
- the length of the position's error is convex in d, so that it is largest at a corner of that box
  of errors: exact by trying all 2^M (half of them: -d does what d does). For many cables there are
  too many corners: then only the bound e sqrt(M) s with the largest singular value s of these rows
  of L^+ is known, as sqrt(M) e is the longest d. The bound is given beside the exact value.

Rotations are small turns about the world's axes, rad.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.cable_robot.capability import pseudoinverse
from pips_drake.cable_robot.kinematics import Poses, jacobian
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.statics import general_solution
from pips_drake.config import require
from pips_drake.errors import InputError

Array = NDArray[np.float64]

#: With more cables the corners of the box of errors are too many; the bound is used.
MOST_CABLES = 12
#: Poses whose corners are looked at at once.
_CHUNK = 4096


@dataclass(frozen=True, eq=False)
class PoseErrors:
    """Largest errors of N poses; inf where L has not all the freedoms.

    Attributes:
        components: of each component of the pose, (N, freedom) m and rad: exact.
        position: length of the position's error, (N,) m: exact up to `MOST_CABLES` cables.
        position_bound: at most this, (N,) m.
        rotation, rotation_bound: of the small turn likewise, (N,) rad.
        point: length of the error of a point that moves with the platform, (N,) m, as `position`.
    """

    components: Array
    position: Array
    position_bound: Array
    rotation: Array
    rotation_bound: Array
    point: Array


def length_inverse(robot: CableRobot, poses: Poses) -> Array:
    """L^+ with all six rows, (N, 6, M): the twist of a change of the lengths by 1 m each.

    Rows of components that the platform has not are 0; all are inf where L lacks freedoms.
    """
    solution = general_solution(robot, poses)
    inverse = np.zeros((len(poses), 6, robot.cables))
    inverse[:, list(robot.freedoms)] = pseudoinverse(jacobian(robot, poses), solution)
    inverse[solution.rank < robot.freedom] = np.inf
    return inverse


def point_rows(inverse: ArrayLike, poses: Poses, arm: ArrayLike) -> Array:
    """Rows of L^+ for a point of the platform: x + w x (Q r), (N, 3, M).

    Args:
        inverse: from `length_inverse`.
        arm: r, the point in the platform's frame, (3,) or (N, 3) m: what its camera looks at, say.
    """
    P = np.asarray(inverse, dtype=np.float64)
    r = np.broadcast_to(np.asarray(arm, dtype=np.float64), (len(poses), 3))
    turned = (poses.rotation @ r[..., None])[..., 0]
    with np.errstate(invalid="ignore"):
        rows = P[:, :3] + np.cross(P[:, 3:], turned[:, :, None], axis=1)
    rows[~np.isfinite(P).all(axis=(1, 2))] = np.inf
    return np.asarray(rows)


def pose_errors(
    robot: CableRobot, poses: Poses, length_error: float, *, arm: ArrayLike = (0.0, 0.0, 0.0)
) -> PoseErrors:
    """The worst errors of N poses if every length may be wrong by `length_error`, m.

    Half an encoder's step for what rounding does; the calibration's error for accuracy.

    Args:
        arm: the point whose error is asked for, see `point_rows`.
    """
    good = np.isfinite(length_error) and length_error >= 0.0
    require(good, "length_error", f"{length_error:g} m", ">= 0")
    point = np.asarray(arm, dtype=np.float64)
    if point.shape not in ((3,), (len(poses), 3)) or not np.all(np.isfinite(point)):
        raise InputError(
            f"arm of shape {point.shape}; must be (3,) or ({len(poses)}, 3), finite, m"
        )
    inverse = length_inverse(robot, poses)
    parts = [inverse[:, :3], inverse[:, 3:], point_rows(inverse, poses, point)]
    bounds = [_bound(part) for part in parts]
    exact = robot.cables <= MOST_CABLES
    worst = [_worst(part) if exact else bound for part, bound in zip(parts, bounds, strict=True)]
    components = np.abs(inverse[:, list(robot.freedoms)]).sum(axis=2)
    return PoseErrors(
        *(
            length_error * part
            for part in (components, worst[0], bounds[0], worst[1], bounds[1], worst[2])
        )
    )


def step_motions(robot: CableRobot, poses: Poses, step: float) -> tuple[Array, Array]:
    """How far one encoder step of one cable moves the platform: (N, M) m and (N, M) rad.

    No smaller motion can be commanded by that cable alone.

    Args:
        step: of the cable's length, m.
    """
    require(np.isfinite(step) and step > 0.0, "encoder step", f"{step:g} m", "> 0")
    inverse = length_inverse(robot, poses)
    return (
        step * np.linalg.norm(inverse[:, :3], axis=1),
        step * np.linalg.norm(inverse[:, 3:], axis=1),
    )


def _worst(rows: Array) -> Array:
    """The largest |rows d| over the corners |d_i| = 1, (N,); rows (N, 3, M)."""
    cables = rows.shape[2]
    bits = np.arange(2 ** (cables - 1))[:, None] >> np.arange(cables) & 1
    corners = np.ascontiguousarray((2.0 * bits - 1.0).T)  # the last sign is always the same
    result = np.full(len(rows), np.inf)
    finite = np.flatnonzero(np.isfinite(rows[:, 0, 0]))
    for start in range(0, len(finite), _CHUNK):
        chosen = finite[start : start + _CHUNK]
        errors = rows[chosen] @ corners
        result[chosen] = np.sqrt(np.einsum("nkc,nkc->nc", errors, errors).max(axis=1))
    return result


def _bound(rows: Array) -> Array:
    """sqrt(M) times the largest singular value, (N,)."""
    result = np.full(len(rows), np.inf)
    finite = np.isfinite(rows[:, 0, 0])
    square = rows[finite] @ np.swapaxes(rows[finite], 1, 2)
    largest = np.linalg.eigvalsh(square)[:, -1]
    result[finite] = np.sqrt(rows.shape[2] * np.maximum(largest, 0.0))
    return result
