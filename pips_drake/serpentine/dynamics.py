"""What it takes to move the arm: joint efforts of a motion by recursive Newton-Euler equations."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.dh_chain import joint_frames
from pips_drake.serpentine.motion_base import PRISMATIC
from pips_drake.serpentine.statics import weighed_chain

Array = NDArray[np.float64]


def inverse_dynamics(
    arm: SerpentineArm,
    positions: ArrayLike,
    velocities: ArrayLike,
    accelerations: ArrayLike,
    gravity: ArrayLike,
) -> Array:
    """Joint efforts M(q) a + C(q, v) v + g(q) of motions, (N, joints), N and Nm.

    Bodies are the arm's; drives and pins have no inertia and no friction.

    Args:
        positions, velocities, accelerations: of the joints, (N, joints) each: m and rad, over s,
            over s^2.
        gravity: in frame {0}, (3,) m/s^2 (the mounting's rotation applied to the world's).

    Raises:
        InputError: an argument has another shape.
    """
    q, v, a = (
        np.ascontiguousarray(values, dtype=np.float64)
        for values in (positions, velocities, accelerations)
    )
    for name, values in (("positions", q), ("velocities", v), ("accelerations", a)):
        if values.ndim != 2 or values.shape != (len(q), arm.joints):
            raise InputError(
                f"{name} of shape {values.shape}; must be (N, {arm.joints}) for arm '{arm.name}', "
                "the same N for all"
            )
    dh, masses, centres, gravity_drawn = weighed_chain(arm, gravity)
    moments = np.array([body.moments for body in arm.bodies])
    return np.asarray(_chain_efforts(dh, q, v, a, masses, centres, moments, gravity_drawn))


@numba.njit(cache=True)
def _cross(a, b, out):
    """a x b, in place."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@numba.njit(cache=True)
def _rotate(rotation, vector, out):
    """R vector, in place."""
    for k in range(3):
        out[k] = (
            rotation[k, 0] * vector[0] + rotation[k, 1] * vector[1] + rotation[k, 2] * vector[2]
        )


@numba.njit(cache=True)
def _rotate_inertia(rotation, moments, vector, out):
    """R diag(moments) R^T vector, in place: the product of a body's inertia in frame {0}."""
    own = np.empty(3)
    for k in range(3):
        own[k] = moments[k] * (
            rotation[0, k] * vector[0] + rotation[1, k] * vector[1] + rotation[2, k] * vector[2]
        )
    _rotate(rotation, own, out)


@numba.njit(cache=True)
def _rigid_acceleration(spin, turn, arm, start, out):
    """Acceleration of a point of a body: start + turn x arm + spin x (spin x arm), in place.

    `start` (m/s^2) is that of the point which `arm` (m) begins at; `spin` (rad/s) and `turn`
    (rad/s^2) are the body's.
    """
    first, second = np.empty(3), np.empty(3)
    _cross(spin, arm, first)
    _cross(spin, first, second)
    _cross(turn, arm, first)
    for k in range(3):
        out[k] = start[k] + first[k] + second[k]


@numba.njit(cache=True)
def _chain_efforts(dh, q, v, a, masses, centres, moments, gravity):
    """Newton and Euler for each body, from base to tip; then their sums, from tip to base.

    Everything in frame {0}, whose origin is accelerated by -gravity: then weight needs no force of
    its own. The variable of a row in Craig's convention acts about (or along) the row's own z axis,
    through its own origin.

    Args:
        dh: table (J, 5).
        q, v, a: (N, J).
        masses, centres, moments: (J,) kg; (J, 3) m in the bodies' frames; (J, 3) kg m^2 about the
            centre and the frames' axes.
    """
    joints = dh.shape[0]
    efforts = np.empty((q.shape[0], joints))
    rotations, origins = np.empty((joints, 3, 3)), np.empty((joints, 3))
    forces, torques = np.empty((joints, 3)), np.empty((joints, 3))
    start, end, arm, cross = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    to_centre, momentum, change = np.empty((joints, 3)), np.empty(3), np.empty(3)
    for i in range(q.shape[0]):
        joint_frames(dh, q[i], rotations, origins)
        spin, turn = np.zeros(3), np.zeros(3)
        before = np.zeros(3)
        for k in range(3):
            start[k] = -gravity[k]
        for j in range(joints):
            rotation = rotations[j]
            axis = rotation[:, 2]
            for k in range(3):
                arm[k] = origins[j, k] - before[k]
                before[k] = origins[j, k]
            _rigid_acceleration(spin, turn, arm, start, end)
            _cross(spin, axis, cross)
            for k in range(3):
                if dh[j, 4] == PRISMATIC:
                    end[k] += a[i, j] * axis[k] + 2.0 * v[i, j] * cross[k]
                else:
                    turn[k] += a[i, j] * axis[k] + v[i, j] * cross[k]
            if dh[j, 4] != PRISMATIC:
                for k in range(3):
                    spin[k] += v[i, j] * axis[k]
            start[:] = end
            _rotate(rotation, centres[j], to_centre[j])
            _rigid_acceleration(spin, turn, to_centre[j], start, end)
            _rotate_inertia(rotation, moments[j], spin, momentum)
            _rotate_inertia(rotation, moments[j], turn, change)
            _cross(spin, momentum, cross)
            for k in range(3):
                forces[j, k] = masses[j] * end[k]
                torques[j, k] = change[k] + cross[k]
        force, torque = np.zeros(3), np.zeros(3)
        for j in range(joints - 1, -1, -1):
            # What acts at frame j + 1, moved to frame j's origin.
            if j + 1 < joints:
                for k in range(3):
                    arm[k] = origins[j + 1, k] - origins[j, k]
                _cross(arm, force, cross)
                torque += cross
            _cross(to_centre[j], forces[j], cross)
            for k in range(3):
                torque[k] += torques[j, k] + cross[k]
                force[k] += forces[j, k]
            wrench = force if dh[j, 4] == PRISMATIC else torque
            efforts[i, j] = 0.0
            for k in range(3):
                efforts[i, j] += wrench[k] * rotations[j, k, 2]
    return efforts
