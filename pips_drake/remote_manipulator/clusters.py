"""Clusters for the painter's priority: the machine's solids as convex bodies (RMS-71, section V.C).

"A cluster is a group of faces whose relative visual priority may be specified by a fixed list":
here a convex solid, whose faces turned to the eye never hide one another. RMS-71's own clusters are
lost with its Figure 20; ours are the parts of `geometry`, the deck, and arms and stand.

Arms and stand are eight-sided prisms round their cylinders, mitred at the joints by the planes that
bisect the angles between neighbours (planes 10, 11 and 12): without a mitre, neighbours would
stand in one another at a bent joint, and no order of them would be right.

Frames as in `geometry`.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.remote_manipulator import geometry
from pips_drake.remote_manipulator.configuration import RemoteManipulatorConfig
from pips_drake.remote_manipulator.geometry import Part
from pips_drake.remote_manipulator.kinematics import ArmPose, forward_kinematics
from pips_drake.remote_manipulator.orbiter_outline import orbiter_parts
from pips_drake.remote_manipulator.program_state import pose_of

Array = NDArray[np.float64]

_CORNERS = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
_JOINTED = ("stand", "arm_0", "arm_1", "arm_2")


@dataclass(frozen=True, kw_only=True, eq=False)
class MachinePose:
    """Where everything is, in {R}.

    Attributes:
        arm: the arm's points and rotations.
        gap: between the inner faces of finger and prong, m.
        R_RP, p_RP: the payload's rotation (3, 3) and middle (3,) m.
        R_RC, p_RC: the CAE's.
    """

    arm: ArmPose
    gap: float
    R_RP: Array
    p_RP: Array
    R_RC: Array
    p_RC: Array


def machine_pose(
    config: RemoteManipulatorConfig,
    arm_vector: ArrayLike,
    payload_pose: ArrayLike | None = None,
    cae_pose: ArrayLike | None = None,
) -> MachinePose:
    """The pose of all bodies.

    Args:
        arm_vector: (8,): height of the shoulder (m), six angles (rad), gap of the prong (m).
        payload_pose: X_RP, (7,): quaternion w x y z, position (m); by default stowed.
        cae_pose: X_RC likewise; by default where it is at first.

    Raises:
        InputError: a wrong shape, or a quaternion of no length.
    """
    arm_vector = np.asarray(arm_vector, dtype=np.float64)
    if arm_vector.shape != (8,):
        raise InputError(f"arm vector of shape {arm_vector.shape}; must be (8,)")
    R_RP, p_RP = _pose("payload", payload_pose, config.payload.location_m)
    R_RC, p_RC = _pose("CAE", cae_pose, config.central_assembly_element.location_m)
    return MachinePose(
        arm=forward_kinematics(config.arm, arm_vector[1:7], float(arm_vector[0])),
        gap=float(arm_vector[7]),
        R_RP=R_RP,
        p_RP=p_RP,
        R_RC=R_RC,
        p_RC=p_RC,
    )


def _pose(what: str, pose: ArrayLike | None, position: ArrayLike) -> tuple[Array, Array]:
    if pose is None:
        return np.eye(3), np.asarray(position, dtype=np.float64)
    pose = np.asarray(pose, dtype=np.float64)
    if pose.shape != (7,):
        raise InputError(f"pose of the {what} of shape {pose.shape}; must be (7,)")
    if not np.any(pose[:4]):
        raise InputError(f"quaternion of the {what}: {pose[:4]}; must not be zero")
    return pose_of(pose)


def orbiter_solids(config: RemoteManipulatorConfig) -> tuple[Part, ...]:
    """What stands still in {R}: the bay, the cabin, and the deck round the bay."""
    outline = (part for part in orbiter_parts(config) if part.solid)
    return (*geometry.bay_parts(config), *outline)


def corners(part: Part) -> Array:
    """The vertices of a box (8, 3) or prism (16, 3) in its body's frame, m."""
    if part.kind == "prism":
        points = geometry.prism_corners(*part.size)
    else:
        points = _CORNERS * np.array(part.size)
    return points @ part_rotation(part).T + np.array(part.position)


def part_rotation(part: Part) -> Array:
    """From the part's own axes to its body's, (3, 3)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(part.rpy), np.sin(part.rpy)
    roll = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    pitch = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    yaw = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    result: Array = yaw @ pitch @ roll
    return result


class Clusters:
    """All clusters of a machine; `vertices` places them.

    Attributes:
        names: of the clusters, n of them; their numbers are their places here.
        starts: (n,), where the vertices of each begin in what `vertices` returns.
    """

    def __init__(self, config: RemoteManipulatorConfig) -> None:
        arm, effector = config.arm, config.effector
        fixed = {"R": orbiter_solids(config), "P": geometry.payload_parts(config)}
        fixed["C"] = tuple(part for part in geometry.cae_parts(config) if part.solid)
        fixed["2"] = geometry.effector_parts(effector, arm.arm_2_m)
        fixed["K"] = (geometry.prong_part(effector, arm.arm_2_m),)
        self._config = config
        self._points: dict[str, Array] = {}
        names, counts = list(_JOINTED), [2 * geometry.SIDES] * len(_JOINTED)
        for frame, parts in fixed.items():
            points = [corners(part) for part in parts]
            names += [part.name for part in parts]
            counts += [len(each) for each in points]
            self._points[frame] = np.concatenate(points)
        self.names = tuple(names)
        self.starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
        ring = geometry.prism_corners(arm.diameter_m, 1.0)[: geometry.SIDES]
        self._ring = ring - [ring[0, 0], 0.0, 0.0]

    def vertices(self, pose: MachinePose) -> Array:
        """All clusters' vertices in {R}, (V, 3) m, in the order of `names`."""
        arm, points = pose.arm, self._points
        reach = geometry.prong_position(self._config.effector, pose.gap)
        prong = points["K"] + [0.0, reach, 0.0]
        return np.concatenate(
            [
                *self._jointed(arm),
                points["R"],
                points["P"] @ pose.R_RP.T + pose.p_RP,
                points["C"] @ pose.R_RC.T + pose.p_RC,
                np.concatenate([points["2"], prong]) @ arm.R_R2.T + arm.wrist,
            ]
        )

    def _jointed(self, arm: ArmPose) -> list[Array]:
        """Stand and arms: prisms whose ends the bisecting planes cut."""
        ways = [np.array([0.0, 0.0, -1.0]), arm.R_R0[:, 0], arm.R_R1[:, 0], arm.R_R2[:, 0]]
        # A turn of the stand about itself shows only in where its eight edges are.
        upright = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
        turns = [upright, arm.R_R0, arm.R_R1, arm.R_R2]
        foot = arm.shoulder * [1.0, 1.0, 0.0]
        ends = [foot, arm.shoulder, arm.elbow, arm.wrist, arm.palm]
        result = []
        for k, (way, turn) in enumerate(zip(ways, turns, strict=True)):
            edges = self._ring @ turn.T
            length = float(way @ (ends[k + 1] - ends[k]))
            # No edge is cut beyond its middle: an arm that is folded flat has no mitre.
            first = np.zeros(len(edges))
            if k > 0:
                first = np.clip(_cut(edges, ways[k - 1] + way, way), 0.0, 0.5 * length)
            last = np.full(len(edges), length)
            if k + 1 < len(ways):
                last += np.clip(_cut(edges, way + ways[k + 1], way), -0.5 * length, 0.0)
            for along in (first, last):
                result.append(ends[k] + edges + along[:, None] * way)
        return result


def _cut(edges: Array, normal: Array, way: Array) -> Array:
    """How far along its edges a prism meets the plane through the joint, (8,) m."""
    cut: Array = -(edges @ normal) / max(float(normal @ way), 1e-12)
    return cut
