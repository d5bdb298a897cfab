"""Stiffness of a platform on cables: what the wrench does when the platform moves a little.

CABLE-96, section 2.4, has K = L^T diag(E A / l) L. It leaves out what the cables' tensions do as
the cables turn with the platform; a platform that hangs like a pendulum is held sideways by nothing
else. `full_stiffness` has both.

Convention. The platform moves by a twist of the world t = (d, r) at its origin: x becomes x + d and
Q becomes exp(r) Q (left-trivialised). The wrench w is in the world's axes, about the origin of the
platform as it moves. K = -dw/dt, with the winches locked, so unstretched lengths are fixed.

Derivation. With a = Q v and the unit vector u along the cable, its pull is T u at the arm a. The
twist moves the attachment by D t, D = [I, -a x], hence

    dT = -k u . D t,    k = dT/dl = E A / l0 = (E A + T) / l,    as T = E A (l - l0) / l0,
    du = -(I - u u^T) D t / l,
    da = r x a.

With w = (T u, a x T u) = D^T T u, the first two give -D^T (k u u^T + (T / l) (I - u u^T)) D t. The
arm gives moments (r x a) x T u = T u x (a x r). So

    K = sum D^T (k u u^T + (T / l) (I - u u^T)) D  +  [0, 0; 0, T ((u . a) I - a u^T)].

The weight m g at the arm c = Q c0 adds the last kind of term: [0, 0; 0, (m g . c) I - c (m g)^T].

Symmetry. The last terms' antisymmetric part is half of [M x], M the cables' moment about the
origin: twists of the world do not commute, and a second derivative of an energy along two of them
depends on their order by a first derivative, the moment. In equilibrium under the weight alone, K
with the weight's term is symmetric, because M and the weight's moment add up to zero. Otherwise the
symmetric part is the second derivative of the energy along one-parameter motions exp(s r), which is
what stability and directions ask for; it is what `stiffness_directions` uses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.cable_robot.kinematics import Poses, cable_vectors, jacobian
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.statics import moment_scales
from pips_drake.config import require
from pips_drake.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StiffnessDirections:
    """Directions in which the wrench answers along the motion, softest first.

    Attributes:
        values: stiffnesses (N, freedom) N/m, rising; negative where the pose is unstable.
        twists: (N, freedom, freedom), row k moves the platform in the k-th direction: m and rad,
            of length 1 once rotations are multiplied by `length`.
        length: what rotations are multiplied by, m.
    """

    values: Array
    twists: Array
    length: float

    @property
    def softest(self) -> Array:
        """Twists of the least stiffness, (N, freedom)."""
        return self.twists[:, 0]

    @property
    def stiffest(self) -> Array:
        """Twists of the largest stiffness, (N, freedom)."""
        return self.twists[:, -1]


def cable_stiffness(robot: CableRobot, poses: Poses, tensions: ArrayLike | None = None) -> Array:
    """dT/dl of each cable, (N, M) N/m: E A / l, or (E A + T) / l with its tensions (N, M) N."""
    vectors, _ = cable_vectors(robot, poses)
    more = 0.0 if tensions is None else _checked(robot, poses, tensions)
    return np.asarray((robot.axial_stiffness + more) / np.linalg.norm(vectors, axis=2))


def elastic_stiffness(robot: CableRobot, poses: Poses) -> Array:
    """K = L^T diag(E A / l) L of CABLE-96, (N, freedom, freedom) N/m, N, N m/rad."""
    L = jacobian(robot, poses)
    k = cable_stiffness(robot, poses)
    return np.asarray(np.swapaxes(L, 1, 2) @ (k[..., None] * L))


def full_stiffness(
    robot: CableRobot, poses: Poses, tensions: ArrayLike, *, weight: bool = True
) -> Array:
    """K with the cables' stretch and tensions, (N, freedom, freedom) N/m, N, N m/rad.

    Args:
        tensions: (N, M) N, from `statics.distribute_tensions` for example.
        weight: whether the weight, which turns about the origin with the platform, counts too.
    """
    T = _checked(robot, poses, tensions)
    vectors, arms = cable_vectors(robot, poses)
    lengths = np.linalg.norm(vectors, axis=2)
    across = T / lengths
    along = cable_stiffness(robot, poses, T) - across
    L = np.empty((*T.shape, 6))
    units = vectors / lengths[..., None]
    L[..., :3], L[..., 3:] = -units, np.cross(units, arms)
    K = np.swapaxes(L, 1, 2) @ (along[..., None] * L)
    # sum (T / l) D^T D with D = [I, -a x].
    crosses = _cross_matrix(np.einsum("nm,nmi->ni", across, arms))
    K[:, :3, :3] += across.sum(axis=1)[:, None, None] * np.eye(3)
    K[:, :3, 3:] -= crosses
    K[:, 3:, :3] += crosses
    K[:, 3:, 3:] += _dot_less_dyad(arms, arms, across) + _dot_less_dyad(arms, units, T)
    if weight:
        force = np.broadcast_to(robot.mass * robot.gravity, (len(poses), 1, 3))
        arm = (poses.rotation @ robot.centre_of_mass)[:, None]
        K[:, 3:, 3:] += _dot_less_dyad(arm, force, np.ones((len(poses), 1)))
    kept = list(robot.freedoms)
    return np.ascontiguousarray(K[:, kept][:, :, kept])


def stiffness_directions(robot: CableRobot, K: ArrayLike, length: float) -> StiffnessDirections:
    """Softest and stiffest directions of stiffness matrices.

    Eigenvectors of the symmetric part, with rotations as arcs of radius `length`: forces and
    moments over `length` in N, motions in m. Where K is symmetric and not negative, as CABLE-96's
    is, these are its singular vectors; unlike them, they tell a negative stiffness from a positive.

    Args:
        K: (N, freedom, freedom).
        length: m; `statics.characteristic_length`, say.
    """
    require(np.isfinite(length) and length > 0.0, "length of rotations", f"{length:g} m", "> 0")
    scales = moment_scales(robot, length)
    scaled = np.asarray(K, dtype=np.float64) / scales / scales[:, None]
    values, vectors = np.linalg.eigh(0.5 * (scaled + np.swapaxes(scaled, 1, 2)))
    return StiffnessDirections(values, np.swapaxes(vectors, 1, 2) / scales, length)


def _checked(robot: CableRobot, poses: Poses, tensions: ArrayLike) -> Array:
    T = np.asarray(tensions, dtype=np.float64)
    shape = (len(poses), robot.cables)
    if T.shape != shape or not np.all(np.isfinite(T)):
        raise InputError(
            f"{robot.name}: tensions of shape {T.shape}; must be {shape}, finite numbers, N"
        )
    return T


def _cross_matrix(vectors: Array) -> Array:
    """Matrices [v x], (N, 3, 3)."""
    return np.asarray(np.cross(vectors[:, None], np.eye(3))).swapaxes(1, 2)


def _dot_less_dyad(arms: Array, others: Array, factors: Array) -> Array:
    """sum f ((a . b) I - a b^T), (N, 3, 3), of (N, M, 3) each and factors (N, M)."""
    dyads = np.einsum("nm,nmi,nmj->nij", factors, arms, others)
    return np.trace(dyads, axis1=1, axis2=2)[:, None, None] * np.eye(3) - dyads
