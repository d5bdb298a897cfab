"""What elastic cables do to a platform that moves: they pull, and never push.

A cable of the unstretched length l0, with its ends l apart, pulls along the straight line with

    T = max(0, E A / l0 (l - l0 + tau (dl/dt - dl0/dt)))  where l > l0, else 0:

a spring with the damping of a Kelvin and Voigt material, whose strain relaxes with the time tau. A
slack cable pulls with exactly 0.

With its weight, a cable hangs in the elastic catenary (H. M. Irvine, "Cable Structures", 1981,
section 2.3). With the platform's end at s = 0, the upward component of the tension there V, the
horizontal one H, and the weight w a metre of unstretched cable, tensions along it are (H, V + w s),
and its ends are

    x = H l0 / (E A) + (H / w) (asinh((V + w l0) / H) - asinh(V / H)),
    z = (V l0 + w l0^2 / 2) / (E A) + (T_anchor - T_platform) / w

apart. The two equations are solved for H and V by Newton's method. The pull on the platform is
(H, V); a long cable's is below the chord. Damping is that of the chord.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from pips_drake.cable_robot.kinematics import Poses
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.config import require
from pips_drake.errors import InputError, NotFollowableError

Array = NDArray[np.float64]

#: Columns of `cable_table`: anchor, attachment, E A, weight a metre, time of damping.
COLUMNS = 9
#: Newton's method ends where the ends are this near, as a share of the length.
_ENDS_MET = 1e-13
_MOST_STEPS = 200


@dataclass(frozen=True, eq=False)
class CablePull:
    """What the cables do at N poses.

    Attributes:
        wrench: on the platform about its origin, in the world's axes, (N, 6) N and N m: force, then
            moment.
        tensions: at the platform, (N, M) N.
        lengths: straight from end to end, (N, M) m.
    """

    wrench: Array
    tensions: Array
    lengths: Array


def cable_pull(
    robot: CableRobot,
    poses: Poses,
    unstretched: ArrayLike,
    *,
    twist: ArrayLike | None = None,
    rates: ArrayLike | None = None,
    damping_time: float = 0.0,
    weight: float = 0.0,
    broken: ArrayLike | None = None,
) -> CablePull:
    """Tensions, and their wrench on the platform.

    Args:
        unstretched: lengths l0, (M,) or (N, M) m.
        twist: of the platform at its origin in the world's axes, (6,) or (N, 6) m/s and rad/s;
            None: it is at rest.
        rates: dl0/dt, (M,) or (N, M) m/s; None: winches are at rest.
        damping_time: tau, s.
        weight: of the cables, N/m of unstretched length; 0 neglects the sag.
        broken: cables that pull no more, (M,) or (N, M); None: none.

    Raises:
        InputError: other shapes, numbers that are not finite, lengths that are not positive.
    """
    count, cables = len(poses), robot.cables
    l0 = _rows(robot, "unstretched lengths", unstretched, (count, cables))
    if np.any(l0 <= 0.0):
        raise InputError(f"{robot.name}: unstretched length = {l0.min():g} m; must be > 0")
    still = np.zeros(6)
    moving = _rows(robot, "twist", still if twist is None else twist, (count, 6))
    reeling = _rows(robot, "rates", np.zeros(cables) if rates is None else rates, (count, cables))
    gone = np.zeros(cables) if broken is None else np.asarray(broken, dtype=np.float64)
    state = np.empty((count, 13))
    state[:, :4] = np.roll(Rotation.from_matrix(poses.rotation).as_quat(), 1, axis=-1)
    state[:, 4:7] = poses.position
    state[:, 7:10], state[:, 10:] = moving[:, 3:], moving[:, :3]
    table = cable_table(robot, damping_time=damping_time, weight=weight)
    out = np.empty((count, 6 + 2 * cables))
    broken_rows = _rows(robot, "broken", gone, (count, cables))
    met = pull(table, up_direction(robot), state, l0, reeling, broken_rows, out)
    if not met:
        raise NotFollowableError(f"{robot.name}: a hanging cable has no shape between its ends")
    return CablePull(out[:, :6], out[:, 6 : 6 + cables], out[:, 6 + cables :])


def cable_table(robot: CableRobot, *, damping_time: float, weight: float) -> Array:
    """The cables' constants as `pull` takes them, (M, 9); see `COLUMNS`."""
    for name, value, unit in (("damping_time", damping_time, "s"), ("weight", weight, "N/m")):
        good = math.isfinite(value) and value >= 0.0
        require(good, f"{robot.name}: {name} of cables", f"{value:g} {unit}", ">= 0")
    table = np.empty((robot.cables, COLUMNS))
    table[:, :3], table[:, 3:6] = robot.anchors, robot.attachments
    table[:, 6], table[:, 7], table[:, 8] = robot.axial_stiffness, weight, damping_time
    return table


def up_direction(robot: CableRobot) -> Array:
    """Against gravity, (3,); z where there is none."""
    size = float(np.linalg.norm(robot.gravity))
    return -robot.gravity / size if size > 0.0 else np.array([0.0, 0.0, 1.0])


def _rows(robot: CableRobot, name: str, value: ArrayLike, shape: tuple[int, int]) -> Array:
    given = np.asarray(value, dtype=np.float64)
    if given.shape not in (shape, shape[1:]) or not np.all(np.isfinite(given)):
        raise InputError(
            f"{robot.name}: {name} of shape {given.shape}; must be {shape[1:]} or {shape}, finite"
        )
    return np.ascontiguousarray(np.broadcast_to(given, shape))


@numba.njit(cache=True)
def catenary(x, z, l0, EA, w):
    """H and V, N, of a hanging cable whose anchor is x m beside and z m above its other end.

    The ends' distances are the gradient of the cable's complementary energy, which is convex: a
    step that does not go far beyond the least along its direction is a good one. (The ends' miss
    need not fall at once: a cable that is nearly straight is stiff along and soft across.)
    Differences of nearly equal numbers are written without them, so that w may be tiny.

    Returns:
        H, V, and whether the ends were met.
    """
    chord = math.sqrt(x * x + z * z)
    # A cable that hangs straight down has H = 0: some is left to take the logarithm of.
    x = max(x, 1e-6 * max(chord, l0))
    W = w * l0
    if chord > l0:
        T = EA * (chord - l0) / l0
        H, V = max(T * x / chord, 0.1 * W * x / chord), T * z / chord - 0.5 * W
    else:
        # Jayaraman and Knudson's start for a slack one.
        bow = math.sqrt(max(3.0 * ((l0 * l0 - z * z) / (x * x) - 1.0), 1e-4))
        bow = min(bow, 300.0)
        H = 0.5 * W * x / (bow * l0)
        V = 0.5 * w * (z / math.tanh(bow) - l0)
    H = max(H, 1e-12 * (W + EA))
    size = chord + l0
    for _ in range(_MOST_STEPS):
        at_x, at_z, xH, xV, zV = _catenary_ends(H, V, l0, EA, w)
        miss_x, miss_z = x - at_x, z - at_z
        worst = max(abs(miss_x), abs(miss_z))
        determinant = xH * zV - xV * xV
        if worst <= _ENDS_MET * size or not determinant > 0.0:
            break
        step_H = (zV * miss_x - xV * miss_z) / determinant
        step_V = (xH * miss_z - xV * miss_x) / determinant
        share = min(1.0, -0.9 * H / step_H) if step_H < 0.0 else 1.0
        falls = step_H * miss_x + step_V * miss_z
        while share > 1e-9:
            at_x, at_z, _, _, _ = _catenary_ends(H + share * step_H, V + share * step_V, l0, EA, w)
            if step_H * (x - at_x) + step_V * (z - at_z) >= -0.5 * falls:
                break
            share *= 0.5
        H, V = H + share * step_H, V + share * step_V
        if max(abs(step_H), abs(step_V)) <= 1e-15 * (H + abs(V)):
            break
    return H, V, worst <= 1e-9 * size


@numba.njit(cache=True)
def _catenary_ends(H, V, l0, EA, w):
    """x and z of the far end, and dx/dH, dx/dV = dz/dH, dz/dV."""
    W = w * l0
    V_far = V + W
    T, T_far = math.sqrt(H * H + V * V), math.sqrt(H * H + V_far * V_far)
    # (T_far - T) / w, and (asinh(V_far / H) - asinh(V / H)) / w.
    rise = l0 * (V + V_far) / (T + T_far)
    if V + V_far >= 0.0:
        ratio = (w * rise + W) / (T + V)
    else:
        ratio = (W - w * rise) / (T_far - V_far)
    # log(1 + r) / r tends to 1.
    turn = (ratio if ratio < 1e-12 else math.log1p(ratio)) / w
    x = H * l0 / EA + H * turn
    z = l0 * (V + 0.5 * W) / EA + rise
    # d turn / dH = (V / T - V_far / T_far) / (H w), d turn / dV = (1 / T_far - 1 / T) / w.
    sines = (
        H * H * l0 * (V + V_far) / (T * T_far * (V_far * T + V * T_far))
        if (V * V_far > 0.0)
        else (V_far / T_far - V / T) / w
    )
    xH = l0 / EA + turn - sines
    xV = -H * rise / (T * T_far)
    zV = l0 / EA + sines
    return x, z, xH, xV, zV


@numba.njit(cache=True)
def pull(table, up, state, unstretched, rates, broken, out):
    """Wrenches, tensions and lengths, (N, 6 + 2 M) into `out`.

    Args:
        table: see `cable_table`.
        up: (3,).
        state: of a free body as Drake has it, (N, 13): quaternion w x y z, position m, angular
            velocity rad/s and velocity m/s in the world.
        unstretched, rates: (N, M) m and m/s.
        broken: above 0.5 where it is, (N, M).

    Returns:
        Whether all hanging cables have found their shape.
    """
    cables = table.shape[0]
    good = True
    for n in range(state.shape[0]):
        qw, qx, qy, qz = state[n, 0], state[n, 1], state[n, 2], state[n, 3]
        two = 2.0 / (qw * qw + qx * qx + qy * qy + qz * qz)
        wx, wy, wz = state[n, 7], state[n, 8], state[n, 9]
        for k in range(6):
            out[n, k] = 0.0
        for i in range(cables):
            vx, vy, vz = table[i, 3], table[i, 4], table[i, 5]
            ax = vx + two * (
                -(qy * qy + qz * qz) * vx + (qx * qy - qw * qz) * vy + (qx * qz + qw * qy) * vz
            )
            ay = vy + two * (
                (qx * qy + qw * qz) * vx - (qx * qx + qz * qz) * vy + (qy * qz - qw * qx) * vz
            )
            az = vz + two * (
                (qx * qz - qw * qy) * vx + (qy * qz + qw * qx) * vy - (qx * qx + qy * qy) * vz
            )
            lx = table[i, 0] - state[n, 4] - ax
            ly = table[i, 1] - state[n, 5] - ay
            lz = table[i, 2] - state[n, 6] - az
            length = math.sqrt(lx * lx + ly * ly + lz * lz)
            out[n, 6 + i], out[n, 6 + cables + i] = 0.0, length
            if broken[n, i] > 0.5 or length == 0.0:
                continue
            l0, EA, w = unstretched[n, i], table[i, 6], table[i, 7]
            damping = 0.0
            if length > l0:
                # The attachment's velocity; the cable shortens as it moves towards the anchor.
                px = state[n, 10] + wy * az - wz * ay
                py = state[n, 11] + wz * ax - wx * az
                pz = state[n, 12] + wx * ay - wy * ax
                rate = -(lx * px + ly * py + lz * pz) / length
                damping = EA / l0 * table[i, 8] * (rate - rates[n, i])
            if w == 0.0:
                if length <= l0:
                    continue
                T = max(0.0, EA * (length - l0) / l0 + damping)
                fx, fy, fz = T * lx / length, T * ly / length, T * lz / length
            else:
                z = lx * up[0] + ly * up[1] + lz * up[2]
                hx, hy, hz = lx - z * up[0], ly - z * up[1], lz - z * up[2]
                x = math.sqrt(hx * hx + hy * hy + hz * hz)
                H, V, met = catenary(x, z, l0, EA, w)
                good = good and met
                T = math.sqrt(H * H + V * V)
                share = max(0.0, 1.0 + damping / T)
                side = share * H / x if x > 0.0 else 0.0
                fx = side * hx + share * V * up[0]
                fy = side * hy + share * V * up[1]
                fz = side * hz + share * V * up[2]
                T *= share
            out[n, 6 + i] = T
            out[n, 0] += fx
            out[n, 1] += fy
            out[n, 2] += fz
            out[n, 3] += ay * fz - az * fy
            out[n, 4] += az * fx - ax * fz
            out[n, 5] += ax * fy - ay * fx
    return good
