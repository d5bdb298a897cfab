"""Motion bases: what carries the arm's first spine point along the base line.

A base is a replaceable part. It gives its rows of the Denavit-Hartenberg table (so that forward
kinematics and Jacobians need to know nothing else) and an inverse: joint values that put the first
spine point on a given point. `RailCraneBase` is the report's; a second one, `GimbalBase`, carries
the arm on a carriage with two crossed hinges, as a straight feed does.

To add a base: a dataclass with the members of `MotionBase`, its compiled inverse here, and a branch
in `_base_root`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numba
import numpy as np
from numpy.typing import NDArray

RAIL_CRANE, GIMBAL = 0, 1

#: Joint kinds in a Denavit-Hartenberg table's last column.
REVOLUTE, PRISMATIC = 0.0, 1.0

Array = NDArray[np.float64]


class MotionBase(Protocol):
    """What the solvers ask of a base."""

    @property
    def kind(self) -> int:
        """Which branch of `_base_root` solves it."""

    @property
    def parameters(self) -> Array:
        """The numbers that the inverse needs, m and rad."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of its joints, from the ground."""

    @property
    def body_names(self) -> tuple[str, ...]:
        """Names of the bodies that its joints move, from the ground; the last is segment 1."""

    def dh_rows(self) -> Array:
        """Rows (joints, 5): alpha (rad), a (m), d offset (m), theta offset (rad), joint kind."""


@dataclass(frozen=True, kw_only=True)
class RailCraneBase:
    """The prototype's motion base: rail d1, crane theta2, and theta3 (FTL-95 Fig 2.1, Table A.1).

    Attributes:
        a0, a2, d2, d3: Denavit-Hartenberg lengths, m.
        first_length: S_1, from frame 3 to the first spine point (4), m.
    """

    a0: float
    a2: float
    d2: float
    d3: float
    first_length: float

    kind = RAIL_CRANE
    joint_names = ("d1", "theta2", "theta3")
    body_names = ("carriage", "crane", "segment_1")

    @property
    def parameters(self) -> Array:
        return np.array([self.a0, self.a2, self.d2, self.d3, self.first_length])

    def dh_rows(self) -> Array:
        return np.array(
            [
                [0.0, self.a0, 0.0, 0.0, PRISMATIC],
                [-math.pi / 2, 0.0, self.d2, 0.0, REVOLUTE],
                [-math.pi / 4, self.a2, self.d3, 0.0, REVOLUTE],
            ]
        )


@dataclass(frozen=True, kw_only=True)
class GimbalBase:
    """A carriage on a rail with two crossed hinges; the arm lies along the rail at zero.

    Frame 1 slides along Z0; hinge 2 turns about Y0 and hinge 3 about the then tilted X0. A straight
    feed, as CMU-92 assumes for its arm, is this base with both hinges near zero.

    Attributes:
        offset: distance of the base line from the rail along X0, m.
        first_length: from the hinges to the first spine point, m.
    """

    offset: float
    first_length: float

    kind = GIMBAL
    joint_names = ("d1", "theta2", "theta3")
    body_names = ("carriage", "gimbal", "segment_1")

    @property
    def parameters(self) -> Array:
        return np.array([self.offset, self.first_length])

    def dh_rows(self) -> Array:
        # Z2 = Y0 after the first twist; the offset of -90 deg turns X2 into Z0, the feed direction;
        # Z3 is then square to both.
        return np.array(
            [
                [0.0, self.offset, 0.0, 0.0, PRISMATIC],
                [-math.pi / 2, 0.0, 0.0, -math.pi / 2, REVOLUTE],
                [-math.pi / 2, 0.0, 0.0, 0.0, REVOLUTE],
            ]
        )


@numba.njit(cache=True)
def wrap_angle(angle):
    """The angle in (-pi, pi] rad."""
    return -((-angle + math.pi) % (2.0 * math.pi) - math.pi)


@numba.njit(cache=True, error_model="numpy")
def _rail_crane_root(parameters, x, y, z, side):
    """One inverse solution of the rail and crane for spine point 4 at (x, y, z) m.

    FTL-95 Eqs 3.10 to 3.15, with F = -K (S1 sin(theta3) + d3), whose line is missing in print.
    E cos + F sin + G = 0 is solved as atan2(F, E) +- acos(-G / hypot(E, F)): Eq 3.14's half-angle
    form divides by G - E, which vanishes inside the workspace. Sums of angles are products of
    sines, so that no angle is formed while follow-the-leader iterates.

    Args:
        side: +1 or -1, which of the two.

    Returns:
        d1 (m), cosine and sine of theta2, cosine and sine of theta3, and how far outside [-1, 1]
        the sine of theta3 and the cosine in theta2 are: positive means out of reach, and the rest
        is NaN.
    """
    a0, a2, d2, d3, s1 = parameters[0], parameters[1], parameters[2], parameters[3], parameters[4]
    k = math.sqrt(0.5)
    nan = math.nan
    sine3 = (d2 + k * d3 - y) / (k * s1)
    excess3 = abs(sine3) - 1.0
    if excess3 > 0.0:
        return nan, nan, nan, nan, nan, excess3, nan
    cosine3 = math.sqrt((1.0 - sine3) * (1.0 + sine3))
    e = s1 * cosine3 + a2
    f = -k * (s1 * sine3 + d3)
    amplitude = math.sqrt(e * e + f * f)
    near = (x - a0) / amplitude
    excess2 = abs(near) - 1.0
    if excess2 > 0.0:
        return nan, nan, nan, nan, nan, excess3, excess2
    across = side * math.sqrt((1.0 - near) * (1.0 + near))
    cosine2 = (e * near - f * across) / amplitude
    sine2 = (f * near + e * across) / amplitude
    return z + sine2 * e - cosine2 * f, cosine2, sine2, cosine3, sine3, excess3, excess2


@numba.njit(cache=True, error_model="numpy")
def _gimbal_root(parameters, x, y, z, side):
    """One inverse solution of the gimbal base: the carriage behind the point (+1) or beyond it.

    The first spine point is at (offset + l sin(b) cos(c), -l sin(c), d1 + l cos(b) cos(c)), with
    b = theta2 as a tilt about Y0 and c = theta3; same returns as `_rail_crane_root`.
    """
    offset, length = parameters[0], parameters[1]
    nan = math.nan
    sine3 = -y / length
    excess3 = abs(sine3) - 1.0
    if excess3 > 0.0:
        return nan, nan, nan, nan, nan, excess3, nan
    cosine3 = math.sqrt((1.0 - sine3) * (1.0 + sine3))
    reach = length * cosine3
    excess2 = abs(x - offset) - reach if reach == 0.0 else abs(x - offset) / reach - 1.0
    if excess2 > 0.0:
        return nan, nan, nan, nan, nan, excess3, excess2
    sine2 = (x - offset) / reach if reach > 0.0 else 0.0
    cosine2 = side * math.sqrt((1.0 - sine2) * (1.0 + sine2))
    return z - reach * cosine2, cosine2, sine2, cosine3, sine3, excess3, excess2


@numba.njit(cache=True)
def _base_root(kind, parameters, x, y, z, side):
    if kind == RAIL_CRANE:
        return _rail_crane_root(parameters, x, y, z, side)
    return _gimbal_root(parameters, x, y, z, side)


@numba.njit(cache=True)
def base_roots(kind, parameters, x, y, z):
    """Both inverse solutions for the first spine point at (x, y, z) m.

    Returns:
        roots (2, 3): d1 (m), theta2, theta3 (rad); theta2 in (-pi, pi].
        excess (2,): how far outside [-1, 1] the sine of theta3 and the cosine (or sine) for theta2
            are; positive means that the point cannot be reached, and the roots hold NaN.
    """
    roots = np.full((2, 3), np.nan)
    excess = np.empty(2)
    for i in range(2):
        d1, c2, s2, c3, s3, excess[0], excess[1] = _base_root(
            kind, parameters, x, y, z, 1.0 - 2.0 * i
        )
        if not math.isnan(d1):
            roots[i, 0] = d1
            roots[i, 1] = wrap_angle(math.atan2(s2, c2))
            roots[i, 2] = math.atan2(s3, c3)
    return roots, excess


@numba.njit(cache=True)
def base_roots_many(kind, parameters, targets):
    """Both inverse solutions for first spine points (N, 3) m: (N, 2, joints), NaN out of reach."""
    result = np.empty((targets.shape[0], 2, 3))
    for i in range(targets.shape[0]):
        result[i] = base_roots(kind, parameters, targets[i, 0], targets[i, 1], targets[i, 2])[0]
    return result


@numba.njit(cache=True)
def base_inverse(kind, parameters, x, y, z, nominal_cosine, nominal_sine):
    """The solution that puts the first spine point at (x, y, z) m, as sines.

    Of the two the one whose second joint points nearest the nominal direction is taken: no matter
    how many turns apart (at home the report's other root is +70.4 deg).

    Returns:
        d1 (m), cosine and sine of theta2, cosine and sine of theta3, and the two excesses of
        `base_roots`.
    """
    first = _base_root(kind, parameters, x, y, z, 1.0)
    second = _base_root(kind, parameters, x, y, z, -1.0)
    towards_first = first[1] * nominal_cosine + first[2] * nominal_sine
    towards_second = second[1] * nominal_cosine + second[2] * nominal_sine
    return second if towards_second > towards_first else first
