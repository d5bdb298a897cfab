"""Docking and berthing: is the payload where port or bay can take it, and how far is it from that.

RMS-71, section IV.A.3: all vertices of the probe in the docking envelope, the middles of probe and
port no farther apart than 0.25 ft, and the angle between their y axes within 2 deg 32 min, which is
cos >= 1 - 2^-10. The z axes can be asked too, as the report's angle does not see the payload pitch.
Berthing is our own: RMS-71's section VII.1 asks for it without a number.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pips_drake.remote_manipulator.configuration import (
    BerthingConfig,
    DockingConfig,
    RemoteManipulatorConfig,
)
from pips_drake.remote_manipulator.geometry import (
    SIDES,
    docking_port,
    payload_parts,
    probe_tip,
)
from pips_drake.remote_manipulator.polyhedra import HEXAHEDRON_SIGNS
from pips_drake.units import FOOT

Array = NDArray[np.float64]
Pose = tuple[Array, Array]

#: Faces of the CAE's front half by their normals' angle about its z from x, in eighths of a turn
#: (RMS-71, Figure 9, which is lost: c has the port, b and d are next to it, a and e beyond).
FACES = {"a": -2, "b": -1, "c": 0, "d": 1, "e": 2}


@dataclass(frozen=True)
class Docking:
    """How the payload's probe is to the port.

    Attributes:
        distance: between the middles of the probe's end and of the port, m.
        cosine_y, cosine_z: between their y and their z axes.
        angle: of these axes, the larger of those that are asked, rad.
        in_envelope: all vertices of the probe are on the TRUE side of the CAE's face c and on the
            FALSE sides of faces a, b, d and e.
        docked: all that is asked holds.
    """

    distance: float
    cosine_y: float
    cosine_z: float
    angle: float
    in_envelope: bool
    docked: bool


def within_docking(
    config: DockingConfig, distance: float, cosine_y: float, cosine_z: float
) -> bool:
    """Whether distance (m) and angles are within the tolerances, limits included."""
    limit = 1.0 - 2.0**config.cosine_deficit_log2
    aligned = cosine_y >= limit and (cosine_z >= limit or not config.second_axis)
    return aligned and distance <= config.distance_ft * FOOT


def cae_front_planes(config: RemoteManipulatorConfig) -> Array:
    """Faces a to e of the CAE in {C}, (5, 4): n and D of n . x = D, n outward."""
    angles = np.array(list(FACES.values())) * 2.0 * math.pi / SIDES
    flat = 0.5 * config.central_assembly_element.across_flats_m
    zero = np.zeros(len(angles))
    planes = np.column_stack([np.cos(angles), np.sin(angles), zero, zero + flat])
    # The right angles' cosines are zeros, not roundings of pi.
    planes[np.abs(planes) < 1e-15] = 0.0
    return planes


class DockingTest:
    """The test of one machine."""

    def __init__(self, config: RemoteManipulatorConfig) -> None:
        self._config = config.docking
        self._tip = probe_tip(config)
        self._port = docking_port(config)
        _, probe, _ = payload_parts(config)
        self._probe = np.array(probe.position) + HEXAHEDRON_SIGNS * (0.5 * np.array(probe.size))
        self._planes = cae_front_planes(config)

    def __call__(self, X_RP: Pose, X_RC: Pose) -> Docking:
        """How the payload at X_RP is to the port of the CAE at X_RC."""
        R_CR = X_RC[0].T
        R_CP = R_CR @ X_RP[0]
        p_CP = R_CR @ (X_RP[1] - X_RC[1])
        distance = math.dist(R_CP @ self._tip + p_CP, self._port)
        cosines = float(R_CP[1, 1]), float(R_CP[2, 2])
        asked = cosines if self._config.second_axis else cosines[:1]
        inside = in_docking_envelope(self._planes, self._probe @ R_CP.T + p_CP)
        return Docking(
            distance,
            *cosines,
            math.acos(min(max(min(asked), -1.0), 1.0)),
            inside,
            inside and within_docking(self._config, distance, *cosines),
        )


def in_docking_envelope(planes: Array, points: Array) -> bool:
    """Whether points (N, 3) m are all outside of face c and inside of a, b, d and e.

    Args:
        planes: faces a to e, (5, 4), as of `cae_front_planes`.
    """
    above = points @ planes[:, :3].T > planes[:, 3]
    expected = [face == "c" for face in FACES]
    return bool((above == expected).all())


@dataclass(frozen=True)
class Berthing:
    """How the payload is to its stowed pose.

    Attributes:
        distance: between the middles, m.
        angle: of the whole rotation, rad.
        berthed: both are within the tolerances.
    """

    distance: float
    angle: float
    berthed: bool


def within_berthing(config: BerthingConfig, distance: float, angle: float) -> bool:
    """Whether distance (m) and angle (rad) are within the tolerances, limits included."""
    return distance <= config.distance_m and angle <= math.radians(config.angle_deg)


def berthing(config: RemoteManipulatorConfig, X_RP: Pose) -> Berthing:
    """How the payload at X_RP is to its stowed pose."""
    R, p = X_RP
    distance = math.dist(p, config.payload.location_m)
    # Of small angles, the sine is exact where the cosine is not.
    sine = 0.5 * math.hypot(R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1])
    angle = math.atan2(sine, 0.5 * (float(np.trace(R)) - 1.0))
    return Berthing(distance, angle, within_berthing(config.berthing, distance, angle))
