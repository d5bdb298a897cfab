"""Acquisition: when does the effector hold the payload's bar, and how far is it from that.

RMS-71, section IV.A.3 has six conditions, section VI.D the tolerances. The report asks them in {R},
as its payload lies along {R}; here they are asked in {2} and {P}, so that a docked or a flying
payload can be acquired too. For a stowed payload that is the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pips_drake.remote_manipulator.configuration import RemoteManipulatorConfig
from pips_drake.remote_manipulator.geometry import payload_parts
from pips_drake.remote_manipulator.polyhedra import HEXAHEDRON_SIGNS
from pips_drake.units import FOOT

Array = NDArray[np.float64]
#: Rotation (3, 3) and position (3,) m of one frame in another.
Pose = tuple[Array, Array]

#: The six conditions, in the report's order (section IV.A.3).
CONDITIONS = (
    "bar_below_palm",
    "bar_inside_finger",
    "bar_inside_prong",
    "prong_closed",
    "palm_near_bar",
    "palm_between_ends",
)


@dataclass(frozen=True)
class Acquisition:
    """How the effector is to the bar.

    Attributes:
        conditions: one truth for each of `CONDITIONS`.
        edge_touches: an end of the palm's bottom is below the bar's top (AQFTST).
        distance: how far the middle of the palm's bottom (face d) still is from where conditions 5
            and 6 hold and the bar is between the fingers, m; 0 there.
        angle: between the effector's axes and the nearer of the two ways to take the bar, rad.
        sign: of z2 along the payload's x: UZ2XR of a stowed payload.
    """

    conditions: tuple[bool, ...]
    edge_touches: bool
    distance: float
    angle: float
    sign: int

    @property
    def acquired(self) -> bool:
        """All six conditions hold, and no edge touches."""
        return all(self.conditions) and not self.edge_touches


class AcquisitionTest:
    """The test of one machine."""

    def __init__(self, config: RemoteManipulatorConfig) -> None:
        effector, limits = config.effector, config.acquisition
        _, _, bar = payload_parts(config)
        half = 0.5 * np.array(bar.size)
        middle = np.array(bar.position)
        self._bar = middle + HEXAHEDRON_SIGNS * half
        self._low, self._high = middle - half, middle + half
        self._bottom = config.arm.arm_2_m + effector.palm.length_m
        self._finger = -effector.finger_offset_m
        self._gap = limits.prong_gap_m
        self._near = limits.top_ft * FOOT
        self._ends = (
            float(self._low[0]) + limits.front_ft * FOOT,
            float(self._high[0]) - limits.rear_ft * FOOT,
        )
        # How far the bar's middle can be from the effector's axis inside the finger.
        self._play = effector.finger_offset_m - 0.5 * bar.size[1]
        # Face d's middle, and the middles of those of its edges that cross the bar, in {2}.
        # AQFTST numbers the edges 2-4 and 6-8; Figure 6 and one of its four vertices are spoilt.
        # These are the only two whose middles can be above the bar, as that test needs them.
        reach = 0.5 * effector.palm.height_m
        self._points = np.array([[self._bottom, 0.0, z] for z in (0.0, -reach, reach)])

    def __call__(self, X_R2: Pose, gap: float, X_RP: Pose) -> Acquisition:
        """How the effector is to the bar.

        Args:
            X_R2: pose of {2} in {R}.
            gap: between the inner faces of finger and prong, m.
            X_RP: pose of the payload in {R}.
        """
        R_PR = X_RP[0].T
        R_P2 = R_PR @ X_R2[0]
        offset = R_PR @ (X_R2[1] - X_RP[1])
        # A body's TRUE side is outside of the face (section IV.A.1).
        bar = (self._bar - offset) @ R_P2
        middle, *edges = (self._points @ R_P2.T + offset).tolist()
        x, y, z = middle
        height = float(self._low[2]) - z
        first, last = self._ends
        conditions = (
            bool(bar[:, 0].min() > self._bottom),
            bool(bar[:, 1].min() > self._finger),
            bool(bar[:, 1].max() < self._finger + gap),
            gap < self._gap,
            abs(height) < self._near,
            first <= x <= last,
        )
        sign = 1 if R_P2[0, 2] >= 0.0 else -1
        aside = abs(y - 0.5 * float(self._low[1] + self._high[1]))
        missing = (
            max(first - x, x - last, 0.0),
            max(aside - self._play, 0.0),
            max(-height, height - self._near, 0.0),
        )
        # x2 along the payload's z, z2 along its x or against it.
        trace = R_P2[2, 0] + sign * (R_P2[0, 2] - R_P2[1, 1])
        angle = math.acos(min(max(0.5 * (trace - 1.0), -1.0), 1.0))
        touches = any(self._in_bar(edge) for edge in edges)
        return Acquisition(conditions, touches, math.hypot(*missing), angle, sign)

    def _in_bar(self, point: list[float]) -> bool:
        """Whether a point of {P} is below the bar's top, in it."""
        inside = zip(self._low.tolist(), point, self._high.tolist(), strict=True)
        return all(low < value < high for low, value, high in inside)


def held_pose(X_R2: Pose, X_RP: Pose, sign: int, *, snap: bool) -> Pose:
    """Pose X_2P of the payload in the effector's frame from acquisition on.

    As it is, or (`snap`) at right angles to the effector as MO2SET of RMS-71 (section IV.C.1) puts
    it: the payload's x along `sign` z2, y along -`sign` y2, z along x2. The third row of that table
    prints UX2XR, UY2XR and UZ2XR for the components of UZP; only UX2's own three make a rotation.
    The vector from wrist to payload keeps its components along the payload's axes.

    Args:
        X_R2, X_RP: poses of {2} and {P} in {R} at acquisition.
        sign: of z2 along the payload's x, as then.
        snap: at right angles.
    """
    if snap:
        R_2P = np.array([[0.0, 0.0, 1.0], [0.0, -sign, 0.0], [sign, 0.0, 0.0]])
        return R_2P, R_2P @ (X_RP[0].T @ (X_RP[1] - X_R2[1]))
    R_2R = X_R2[0].T
    return R_2R @ X_RP[0], R_2R @ (X_RP[1] - X_R2[1])
