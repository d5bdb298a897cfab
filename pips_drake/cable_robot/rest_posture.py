"""Where a platform comes to rest with its winches locked, cables slack or broken among them.

The rest posture is a minimum of the elastic and the potential energy

    U = sum over unbroken cables of E A / (2 l0) max(0, l - l0)^2  -  m g . (x + Q c),

which is once differentiable, and twice where no cable is just taut. It is sought by Newton's method
on the poses themselves: at each a twist t of the world with (K + s D) t = w, w the wrench of cables
and weight, K the symmetric part of the full stiffness of the taut cables, D the masses of forces
and moments, and s so large that the matrix is positive and the energy falls. One minimum is found,
that below the start; a swing may end in another.

It holds the platform if it is a minimum in every direction: K is positive. A platform on one cable
hangs, but may turn about the vertical: K has a zero, and nothing holds it there. Sag is neglected.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from pips_drake.cable_robot.cable_forces import cable_pull
from pips_drake.cable_robot.kinematics import Poses
from pips_drake.cable_robot.robot import SPATIAL, CableRobot
from pips_drake.cable_robot.statics import characteristic_length, moment_scales
from pips_drake.cable_robot.stiffness import full_stiffness
from pips_drake.errors import InputError

Array = NDArray[np.float64]

#: At rest: no more than this share of the weight (or of a newton) is left over.
AT_REST = 1e-9
#: A stiffness below this share of the largest holds nothing.
HOLDS = 1e-9
_MOST_STEPS = 500
#: The longest step, m, and radians times the characteristic length.
_LONGEST = 0.5


@dataclass(frozen=True, eq=False)
class RestPosture:
    """Where N platforms come to rest.

    Attributes:
        poses: N; where nothing was found, the last looked at.
        found: whether it is at rest there, (N,).
        stable: whether it is held in every direction, (N,). Where it is not, something may still
            keep it from falling, but not from turning or swinging.
        least_stiffness: the smallest eigenvalue of the full stiffness, rotations as arcs of the
            characteristic length, (N,) N/m.
        tensions: (N, M) N; of slack and broken cables exactly 0.
        slack: which cables do not pull, broken ones too, (N, M).
        within_bounds: no tension is above the robot's largest, (N,).
        energy: U, (N,) J.
    """

    poses: Poses
    found: NDArray[np.bool_]
    stable: NDArray[np.bool_]
    least_stiffness: Array
    tensions: Array
    slack: NDArray[np.bool_]
    within_bounds: NDArray[np.bool_]
    energy: Array

    @property
    def held(self) -> NDArray[np.bool_]:
        """At rest, stable, and no cable overloaded, (N,)."""
        return self.found & self.stable & self.within_bounds


def rest_posture(
    robot: CableRobot,
    start: Poses,
    unstretched: ArrayLike,
    *,
    broken: ArrayLike | None = None,
) -> RestPosture:
    """The rest postures below N starts.

    Args:
        start: where the platforms are let go.
        unstretched: lengths of the cables, (M,) or (N, M) m.
        broken: cables that pull no more, (M,) or (N, M); None: none.

    Raises:
        InputError: a planar robot, other shapes, lengths that are not positive.
    """
    if robot.freedoms != SPATIAL:
        raise InputError(f"{robot.name}: a planar robot; rest postures are of robots in space")
    shape = (len(start), robot.cables)
    l0 = np.broadcast_to(np.asarray(unstretched, dtype=np.float64), shape)
    gone = np.broadcast_to(np.asarray(0 if broken is None else broken, dtype=np.float64), shape)
    rows = [_settle(robot, start, n, l0[n], gone[n]) for n in range(len(start))]
    if not rows:
        raise InputError(f"{robot.name}: no start; must be one at least")
    position, rotation, found, least, tensions, energy = map(np.array, zip(*rows, strict=True))
    stable = least > HOLDS * np.max(robot.axial_stiffness / l0, axis=1)
    within = tensions.max(axis=1) <= robot.tension_max
    poses = Poses(position, rotation)
    return RestPosture(
        poses, found, stable & found, least, tensions, tensions <= 0.0, within, energy
    )


def _settle(
    robot: CableRobot, start: Poses, n: int, l0: Array, broken: Array
) -> tuple[Array, Array, bool, float, Array, float]:
    pose = Poses(start.position[n : n + 1].copy(), np.array(start.rotation[n : n + 1]))
    length = characteristic_length(robot)
    scales = moment_scales(robot, length)
    enough = AT_REST * max(robot.mass * float(np.linalg.norm(robot.gravity)), 1.0)
    energy, wrench, tensions = _state(robot, pose, l0, broken)
    found = False
    for _ in range(_MOST_STEPS):
        values, vectors = _modes(robot, pose, tensions, scales)
        if np.linalg.norm(wrench / scales) <= enough:
            if values[0] >= -HOLDS * max(values[-1], 0.0):
                found = True
                break
            # A saddle: down along the steepest fall of the gradient, either way.
            step = 1e-3 * vectors[:, 0]
            pose = _moved(pose, step / scales)
            energy, wrench, tensions = _state(robot, pose, l0, broken)
            continue
        forces = vectors.T @ (wrench / scales)
        shift = max(0.0, 1e-6 * np.abs(values).max() - values[0], 1e-9)
        for _ in range(60):
            step = vectors @ (forces / (values + shift))
            longest = float(np.abs(step).max())
            tried = _moved(pose, step * min(1.0, _LONGEST / longest) / scales)
            now, pulls, tension = _state(robot, tried, l0, broken)
            # Energies of 1e3 J round to 1e-13 J: near the minimum the wrench must fall instead.
            nearly = abs(now - energy) <= 1e-10 * max(abs(energy), 1.0)
            falls = np.linalg.norm(pulls / scales) < np.linalg.norm(wrench / scales)
            if (now < energy and not nearly) or (nearly and falls):
                break
            shift = max(4.0 * shift, 1e-6 * np.abs(values).max(), 1e-9)
        else:
            break
        pose, energy, wrench, tensions = tried, now, pulls, tension
    values, _ = _modes(robot, pose, tensions, scales)
    return pose.position[0], pose.rotation[0], found, float(values[0]), tensions, energy


def _state(robot: CableRobot, pose: Poses, l0: Array, broken: Array) -> tuple[float, Array, Array]:
    """Energy, wrench of cables and weight, tensions."""
    pulled = cable_pull(robot, pose, l0, broken=broken)
    tensions = pulled.tensions[0]
    centre = pose.position[0] + pose.rotation[0] @ robot.centre_of_mass
    elastic = 0.5 * float(np.sum(tensions**2 * l0 / robot.axial_stiffness))
    energy = elastic - robot.mass * float(robot.gravity @ centre)
    return energy, pulled.wrench[0] + robot.weight_wrench(pose.rotation)[0], tensions


def _modes(robot: CableRobot, pose: Poses, tensions: Array, scales: Array) -> tuple[Array, Array]:
    """Eigenvalues and vectors of the symmetric stiffness of the taut cables, in scaled twists."""
    taut = tensions > 0.0
    # As `full_stiffness` has it, less the springs of cables that are slack.
    K = full_stiffness(robot, pose, tensions[None])[0]
    if not taut.all():
        vectors = robot.anchors - pose.position[0] - robot.attachments @ pose.rotation[0].T
        lengths = np.linalg.norm(vectors, axis=1)
        units = vectors / lengths[:, None]
        arms = robot.attachments @ pose.rotation[0].T
        L = np.hstack([-units, np.cross(units, arms)])[~taut]
        K = K - L.T @ ((robot.axial_stiffness / lengths)[~taut, None] * L)
    scaled = K / scales / scales[:, None]
    values, vectors = eigh(0.5 * (scaled + scaled.T))
    return values, vectors


def _moved(pose: Poses, twist: Array) -> Poses:
    turned = Rotation.from_rotvec(twist[3:]).as_matrix() @ pose.rotation[0]
    return Poses(pose.position + twist[:3], turned[None])
