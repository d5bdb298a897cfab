"""The painter's priority: which cluster is painted over which (RMS-71, section V.C).

A plane that has two clusters on its two sides decides their order: the one on the eye's side may
hide the other, and never the reverse. `priority_order` traces the permanent list of the station, or
the tree of the phase, testing the eye against the planes that it meets, as MAINPRIOR does.

A moving cluster need not keep to one side of the plane that parts it from others in the tree (the
effector dips below the deck to take the bar; the payload leaves the bay). The report leaves that to
restrictions of motion. Here every plane is tested against the vertices, so that an order is claimed
only where a plane decides it; and, unless that is switched off, clusters that the tree has in the
wrong order by any of the planes are sorted, as the report sorts the bar into the effector's list.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError, UnknownNameError
from pips_drake.remote_manipulator.clusters import Clusters, MachinePose, machine_pose
from pips_drake.remote_manipulator.configuration import STATIONS, RemoteManipulatorConfig
from pips_drake.remote_manipulator.kinematics import roll_matrix
from pips_drake.remote_manipulator.phases import PHASES
from pips_drake.remote_manipulator.priority_stations import known_sides
from pips_drake.remote_manipulator.priority_trees import (
    BAR_PLANES,
    IN_BAY,
    MOVING_PLANES,
    OUT_OF_BAY,
    SORTED_AGAINST,
    Chain,
    EffectorList,
    Node,
    Tree,
    bisecting_planes,
    deciding_planes,
    fixed_planes,
    permanent_list,
    plane_table,
    scene_tree,
)

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

#: A vertex is on a plane, and an eye on no side of it, within this: rounding of lengths of 10 m.
TOUCH = 1e-9
#: R_PQ.
_ROLLED = roll_matrix(0.25 * math.pi)


@dataclass(frozen=True, kw_only=True, eq=False)
class Priority:
    """The order in which clusters may hide one another.

    Attributes:
        order: the clusters' names, highest priority (nearest) first.
        claims: (n, n), in that order: [i, j] where a plane decides that i is before j.
    """

    order: tuple[str, ...]
    claims: Flags


class PriorityModel:
    """Clusters, planes, trees and permanent lists of a machine, made once.

    Attributes:
        clusters: the clusters.
        planes: the numbers of all planes, as `planes_in_reference` has them.
    """

    def __init__(self, config: RemoteManipulatorConfig) -> None:
        self.config = config
        self.clusters = Clusters(config)
        fixed = fixed_planes(config)
        self._fixed = plane_table(fixed)
        frames = [plane.frame for plane in fixed.values()]
        self._rows = {frame: np.flatnonzero([f == frame for f in frames]) for frame in "RPQC2"}
        self.planes = (*fixed, *MOVING_PLANES, *BAR_PLANES)
        self._plane_number = {name: k for k, name in enumerate(self.planes)}
        self._number = {name: k for k, name in enumerate(self.clusters.names)}
        self._deciding = {id(tree): self._pairs(tree) for tree in (IN_BAY, OUT_OF_BAY)}
        self._lists = {
            (station.name, id(tree)): Chain(permanent_list(tree, known_sides(fixed, station)))
            for station in config.cameras.stations
            for tree in (IN_BAY, OUT_OF_BAY)
        }

    def _pairs(self, tree: Tree) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        pairs = deciding_planes(tree)
        one, two = (np.array([self._number[pair[k]] for pair in pairs]) for k in (0, 1))
        return one, two, np.array([self._plane_number[plane] for plane in pairs.values()])

    def planes_in_reference(
        self, pose: MachinePose, vertices: Array, bar_planes: ArrayLike | None = None
    ) -> Array:
        """All planes in {R}, (K, 4): unit normal and distance, n . x = d."""
        table = self._fixed.copy()
        poses = {
            "P": (pose.R_RP, pose.p_RP),
            "Q": (pose.R_RP @ _ROLLED, pose.p_RP),
            "C": (pose.R_RC, pose.p_RC),
            "2": (pose.arm.R_R2, pose.arm.wrist),
        }
        for frame, (rotation, position) in poses.items():
            rows = self._rows[frame]
            table[rows, :3] = self._fixed[rows, :3] @ rotation.T
            table[rows, 3] += table[rows, :3] @ position
        across = pose.arm.R_R2[:, 1]
        middle = 0.5 * pose.gap - self.config.effector.finger_offset_m
        between = np.array([*across, float(across @ pose.arm.wrist) + middle])
        if bar_planes is None:
            bar = self._bar_planes(pose, vertices)
        else:
            bar = np.asarray(bar_planes, dtype=np.float64)
            if bar.shape != (len(BAR_PLANES), 4):
                raise InputError(f"bar planes of shape {bar.shape}; must be (3, 4)")
        return np.concatenate([table, bisecting_planes(pose), between[None], bar])

    def vertices_of(self, vertices: Array, name: str) -> Array:
        """The vertices of one cluster, (v, 3) m in {R}."""
        k = self._number[name]
        ends = [*self.clusters.starts, len(vertices)]
        return vertices[ends[k] : ends[k + 1]]

    def _bar_planes(self, pose: MachinePose, vertices: Array) -> Array:
        """D1 to D3: of the axes that can part two boxes, the one with the widest gap, midway.

        Boxes that stand in one another get a plane that parts nothing, which then claims nothing.
        """
        bar = self.vertices_of(vertices, "bar")
        boxes = np.stack([self.vertices_of(vertices, name) for name in SORTED_AGAINST])
        ours, theirs = pose.arm.R_R2.T, pose.R_RP.T
        crosses = np.cross(ours[:, None], theirs[None]).reshape(9, 3)
        lengths = np.linalg.norm(crosses, axis=1)
        crosses = crosses[lengths > 1e-6] / lengths[lengths > 1e-6, None]
        axes = np.concatenate([ours, theirs, crosses])
        axes = np.concatenate([axes, -axes])
        below = np.max(bar @ axes.T, axis=0)
        above = np.min(boxes @ axes.T, axis=1)
        best = np.argmax(above - below, axis=1)
        distance = 0.5 * (above[np.arange(len(best)), best] + below[best])
        return np.column_stack([axes[best], distance])

    # -- the order --------------------------------------------------------------------------

    def order(
        self,
        pose: MachinePose,
        eye: ArrayLike,
        *,
        phase: str,
        station: str | None = None,
        bar_planes: ArrayLike | None = None,
        sort: bool = True,
    ) -> Priority:
        """See `priority_order`."""
        if phase not in PHASES:
            raise UnknownNameError("phase", phase, PHASES)
        if station is not None and station not in STATIONS:
            raise UnknownNameError("camera station", station, list(STATIONS))
        tree = scene_tree(phase)
        vertices = self.clusters.vertices(pose)
        planes = self.planes_in_reference(pose, vertices, bar_planes)
        heights = planes[:, :3] @ vertices.T - planes[:, 3:]
        lowest = np.minimum.reduceat(heights, self.clusters.starts, axis=1)
        highest = np.maximum.reduceat(heights, self.clusters.starts, axis=1)
        above, below = lowest >= -TOUCH, highest <= TOUCH
        of_eye = planes[:, :3] @ np.asarray(eye, dtype=np.float64) - planes[:, 3]

        traced = tree if station is None else self._lists[station, id(tree)]
        tested = dict(zip(self.planes, (of_eye > 0.0).tolist(), strict=True))
        bar_above = dict(zip(self.planes, above[:, self._number["bar"]].tolist(), strict=True))
        names = trace(traced, tested, bar_above)
        order = np.array([self._number[name] for name in names])

        # Rows: clusters on the eye's side of each plane; columns: on the other side.
        near = np.where((of_eye > TOUCH)[:, None], above, below & (of_eye < -TOUCH)[:, None])
        far = np.where((of_eye > TOUCH)[:, None], below, above & (of_eye < -TOUCH)[:, None])
        if sort:
            decided = near.T.astype(np.float32) @ far.astype(np.float32) > 0.0
            order = _sorted(order, decided)
        else:
            one, two, plane = self._deciding[id(tree)]
            decided = np.zeros((len(order), len(order)), dtype=bool)
            decided[one, two] |= near[plane, one] & far[plane, two]
            decided[two, one] |= near[plane, two] & far[plane, one]
        claims = np.triu(decided[np.ix_(order, order)], 1)
        return Priority(order=tuple(self.clusters.names[k] for k in order), claims=claims)


def priority_order(
    model: PriorityModel,
    *,
    phase: str,
    eye: ArrayLike,
    arm_vector: ArrayLike,
    payload_pose: ArrayLike | None = None,
    cae_pose: ArrayLike | None = None,
    station: str | None = None,
    bar_planes: ArrayLike | None = None,
    sort: bool = True,
) -> Priority:
    """The clusters from the highest priority to the lowest, and which pairs planes decide.

    Args:
        phase: of the task; says whether the payload is in its bay.
        eye: (3,) m in {R}.
        arm_vector: (8,): height of the shoulder (m), six angles (rad), gap of the prong (m).
        payload_pose, cae_pose: X_RP and X_RC, (7,): quaternion w x y z, position (m); by default
            stowed, and where the CAE is at first.
        station: whose permanent list is traced; None traces the whole tree.
        bar_planes: D1 to D3 in {R} from the collision program, (3, 4): unit normal and distance;
            by default computed here.
        sort: False leaves the order as the tree has it, and claims only what its own planes decide.

    Raises:
        InputError: an unknown phase or station, or a wrong shape.
    """
    pose = machine_pose(model.config, arm_vector, payload_pose, cae_pose)
    return model.order(pose, eye, phase=phase, station=station, bar_planes=bar_planes, sort=sort)


def trace(tree: Tree, tested: Mapping[str, bool], bar_above: Mapping[str, bool]) -> list[str]:
    """The clusters of a tree, highest priority first.

    Args:
        tested: for each plane, whether the eye is on its true side.
        bar_above: for the planes D1 to D3, whether the bar is on their true sides.
    """
    if isinstance(tree, Node):
        near, far = (tree.true, tree.false) if tested[tree.plane] else (tree.false, tree.true)
        return [*trace(near, tested, bar_above), *trace(far, tested, bar_above)]
    if isinstance(tree, Chain):
        return [name for entry in tree.entries for name in trace(entry, tested, bar_above)]
    if isinstance(tree, EffectorList):
        names = trace(tree.tree, tested, bar_above)
        # From the bottom of the list to just ahead of the first that it may hide.
        place = len(names)
        for name, plane in zip(SORTED_AGAINST, BAR_PLANES, strict=True):
            if tested[plane] == bar_above[plane]:
                place = min(place, names.index(name))
        return [*names[:place], "bar", *names[place:]]
    return list(tree)


def _sorted(order: NDArray[np.int64], decided: Flags) -> NDArray[np.int64]:
    """The order changed as little as needed so that it agrees with what planes decide.

    Pairs that are decided both ways cannot hide one another. Clusters that hide one another in a
    ring keep the order that they have.
    """
    before = decided & ~decided.T
    if not np.any(np.tril(before[np.ix_(order, order)])):
        return order
    waiting = before.sum(axis=0)
    left: list[int] = order.tolist()
    result = []
    while left:
        chosen = next((k for k in left if waiting[k] == 0), None)
        if chosen is None:
            chosen = _first_of_ring(left, before)
        left.remove(chosen)
        result.append(chosen)
        waiting -= before[chosen]
    return np.array(result)


def _first_of_ring(left: list[int], before: Flags) -> int:
    """The first cluster that only those of its own ring hide, where all are hidden by some."""
    reach = before[np.ix_(left, left)]
    for _ in range(len(left).bit_length()):
        reach = reach | (reach.astype(np.float32) @ reach.astype(np.float32) > 0.0)
    free = np.all(reach | ~reach.T, axis=1)
    return left[int(np.argmax(free))]
