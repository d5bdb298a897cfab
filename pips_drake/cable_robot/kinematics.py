"""Kinematics of a platform on cables: lengths, their rates, and the pose that lengths give.

CABLE-96, section 2: l_i = p_i - x - Q v_i with Q = R_z(phi) R_x(theta) R_y(psi), and the rates of
the lengths L [xdot; w], whose rows are [-l_i^T, (l_i x Q v_i)^T] with unit vectors l_i. Everything
takes N poses at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from pips_drake.cable_robot.robot import SAME_POINT, CableRobot
from pips_drake.errors import InputError, NotFollowableError

Array = NDArray[np.float64]

#: Newton's method for the pose stops at lengths this near, m, or gives up after so many steps.
LENGTH_TOLERANCE = 1e-12
MOST_STEPS = 50


@dataclass(frozen=True, eq=False)
class Poses:
    """N poses of a platform.

    Attributes:
        position: x, (N, 3) m in the world.
        rotation: Q, (N, 3, 3).
    """

    position: Array
    rotation: Array

    def __len__(self) -> int:
        return len(self.position)


def make_poses(position: ArrayLike, angles: ArrayLike = (0.0, 0.0, 0.0)) -> Poses:
    """Poses of positions (N, 3) m and angles (phi, theta, psi), (N, 3) or (3,) rad.

    Raises:
        InputError: other shapes, or numbers that are not finite.
    """
    x = np.atleast_2d(np.asarray(position, dtype=np.float64))
    turned = np.asarray(angles, dtype=np.float64)
    if x.shape[-1] != 3 or turned.shape[-1] != 3 or x.ndim != 2:
        raise InputError(f"poses of shapes {x.shape} and {turned.shape}; must be (N, 3) each")
    if not (np.all(np.isfinite(x)) and np.all(np.isfinite(turned))):
        raise InputError("poses: positions and angles must be finite numbers")
    return Poses(x, np.broadcast_to(rotation_matrix(turned), (len(x), 3, 3)))


def rotation_matrix(angles: ArrayLike) -> Array:
    """Q = R_z(phi) R_x(theta) R_y(psi), (..., 3, 3), of angles (..., 3) rad (Eq. 1)."""
    phi, theta, psi = np.moveaxis(np.asarray(angles, dtype=np.float64), -1, 0)
    (c1, s1), (c2, s2), (c3, s3) = ((np.cos(a), np.sin(a)) for a in (phi, theta, psi))
    rows = [
        [c1 * c3 - s1 * s2 * s3, -s1 * c2, c1 * s3 + s1 * s2 * c3],
        [s1 * c3 + c1 * s2 * s3, c1 * c2, s1 * s3 - c1 * s2 * c3],
        [-c2 * s3, s2, c2 * c3],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def cable_vectors(robot: CableRobot, poses: Poses) -> tuple[Array, Array]:
    """Cables from the platform outwards, l_i, and their arms Q v_i: (N, M, 3) m each."""
    arms = robot.attachments @ np.swapaxes(poses.rotation, 1, 2)
    return robot.anchors - poses.position[:, None] - arms, arms


def cable_lengths(robot: CableRobot, poses: Poses) -> Array:
    """Lengths of the cables, (N, M) m: the inverse kinematics."""
    vectors, _ = cable_vectors(robot, poses)
    return np.asarray(np.linalg.norm(vectors, axis=2))


def jacobian(robot: CableRobot, poses: Poses) -> Array:
    """L, the rates of the lengths by the platform's twist, (N, M, freedom).

    Raises:
        InputError: a cable of no length has no direction.
    """
    vectors, arms = cable_vectors(robot, poses)
    lengths = np.linalg.norm(vectors, axis=2, keepdims=True)
    if not np.all(lengths > SAME_POINT):
        pose, cable = np.argwhere(lengths[..., 0] <= SAME_POINT)[0]
        raise InputError(f"{robot.name}: cable {cable + 1} has no length at pose {pose + 1}")
    units = vectors / lengths
    L = np.concatenate([-units, np.cross(units, arms)], axis=2)
    return L[..., list(robot.freedoms)]


def forward_kinematics(robot: CableRobot, lengths: ArrayLike, guess: Poses) -> Poses:
    """The poses near a guess at which the cables have these lengths, (N, M) m.

    Gauss and Newton's method on the lengths. More cables than freedoms: the pose that is nearest in
    the sense of least squares, so that lengths with errors give a pose too.

    Args:
        guess: where to begin, N poses.

    Raises:
        NotFollowableError: it does not converge from there.
    """
    wanted = np.atleast_2d(np.asarray(lengths, dtype=np.float64))
    if wanted.shape != (len(guess), robot.cables) or not np.all(np.isfinite(wanted)):
        shape = (len(guess), robot.cables)
        raise InputError(f"lengths of shape {wanted.shape}; must be {shape}, finite, m")
    position, rotation = guess.position.copy(), np.array(guess.rotation)
    for _ in range(MOST_STEPS):
        poses = Poses(position, rotation)
        error = wanted - cable_lengths(robot, poses)
        step = np.zeros((len(guess), 6))
        solved = np.linalg.pinv(jacobian(robot, poses)) @ error[..., None]
        step[:, list(robot.freedoms)] = solved[..., 0]
        position = position + step[:, :3]
        rotation = Rotation.from_rotvec(step[:, 3:]).as_matrix() @ rotation
        if np.all(np.abs(step) < LENGTH_TOLERANCE):
            return Poses(position, rotation)
    worst = int(np.argmax(np.abs(step).max(axis=1)))
    raise NotFollowableError(
        f"{robot.name}: the lengths of pose {worst} give no pose near the guess (still moving by "
        f"{np.abs(step[worst]).max():.2g} after {MOST_STEPS} steps)"
    )
