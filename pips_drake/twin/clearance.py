"""Least distances between a robot and what stands around it, from the scene graph's queries.

The engine's distances are samples, and can be too large by a millimetre near cylinders (measured):
good for watching a run, no proof.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pips_drake.config import require
from pips_drake.errors import InputError

if TYPE_CHECKING:
    from pydrake.geometry import GeometryId, QueryObject, SignedDistancePair
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import BodyIndex, ModelInstanceIndex

Array = NDArray[np.float64]

#: The share of the range that is looked at first. Trajectory 4's least distances lie below 0.35 of
#: theirs (0.5 m), for the scene and for the arm itself; 8 pairs of 100 are that near.
_FIRST_SHARE = 0.4


@dataclass(frozen=True, kw_only=True)
class LeastDistance:
    """The nearest pair of a robot's body and another body.

    Attributes:
        distance: m; negative in penetration; the query's `max_distance` when nothing is nearer.
        pair: the bodies' scoped names, the robot's first; empty when nothing is nearer.
        points: witness points on robot and other in the world, (2, 3) m.
        normal: unit vector from the other towards the robot in the world, (3,).
        bodies: the bodies' indices; None when nothing is nearer.
    """

    distance: float
    pair: tuple[str, str] | tuple[()]
    points: Array
    normal: Array
    bodies: tuple[BodyIndex, BodyIndex] | None


class ClearanceQuery:
    """Asks a scene graph for a robot's clearance.

    Args:
        plant: finalized, registered with a scene graph.
        robot: the robot's model instances. Everything else with collision geometry is the scene.
        max_distance: pairs farther apart than this (m) are not looked at, which makes the query
            several times faster.
        scene_body: scoped name of a body; if given, it is all of the scene that counts.

    Raises:
        InputError: the robot has no collision geometry (it would always look clear), or
            `max_distance` is not positive.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        robot: Sequence[ModelInstanceIndex],
        *,
        max_distance: float,
        scene_body: str = "",
    ) -> None:
        self.max_distance = max_distance
        self._bodies: dict[GeometryId, BodyIndex] = {}
        self._robot: set[GeometryId] = set()
        self._ignored: set[GeometryId] = set()
        self._names: dict[BodyIndex, str] = {}
        for i in range(plant.num_bodies()):
            body = plant.get_body(_body_index(i))
            self._names[body.index()] = str(body.scoped_name())
            for geometry in plant.GetCollisionGeometriesForBody(body):
                self._bodies[geometry] = body.index()
                if body.model_instance() in robot:
                    self._robot.add(geometry)
                elif scene_body and self._names[body.index()] != scene_body:
                    self._ignored.add(geometry)
        require(max_distance > 0.0, "max_distance", f"{max_distance} m", "> 0")
        if not self._robot:
            models = ", ".join(plant.GetModelInstanceName(model) for model in robot) or "none"
            raise InputError(
                f"robot (models: {models}) has no collision geometry in the scene graph; must have "
                "some, or it would always look clear"
            )

    def least(self, query: QueryObject) -> tuple[LeastDistance, LeastDistance]:
        """The robot's least distance to the scene, and to itself."""
        scene = own = None
        # Whatever is found within a shorter range is the least; finding nothing there says only
        # that there is nothing. Most of the time goes by with pairs far apart.
        for share in (_FIRST_SHARE, 1.0):
            pairs = query.ComputeSignedDistancePairwiseClosestPoints(share * self.max_distance)
            scene, own = self._nearest(pairs)
            if scene is not None and own is not None:
                break
        return self._describe(query, scene), self._describe(query, own)

    def near_pairs(
        self, query: QueryObject, reach: float
    ) -> tuple[list[LeastDistance], list[LeastDistance]]:
        """Every pair nearer than `reach` (m), in no order: of robot and scene, and of the robot."""
        robot, ignored = self._robot, self._ignored
        scene: list[LeastDistance] = []
        own: list[LeastDistance] = []
        for pair in query.ComputeSignedDistancePairwiseClosestPoints(reach):
            first, second = pair.id_A in robot, pair.id_B in robot
            if first and second:
                own.append(self._describe(query, pair))
            elif (first or second) and (pair.id_B if first else pair.id_A) not in ignored:
                scene.append(self._describe(query, pair))
        return scene, own

    def _nearest(
        self, pairs: Sequence[SignedDistancePair]
    ) -> tuple[SignedDistancePair | None, SignedDistancePair | None]:
        """Nearest of robot and scene, and of the robot with itself."""
        robot = self._robot
        scene = own = None
        scene_distance = own_distance = math.inf
        for pair in pairs:
            first, second = pair.id_A in robot, pair.id_B in robot
            if first and second:
                if pair.distance < own_distance:
                    own, own_distance = pair, pair.distance
            elif (
                (first or second)
                and pair.distance < scene_distance
                and (pair.id_B if first else pair.id_A) not in self._ignored
            ):
                scene, scene_distance = pair, pair.distance
        return scene, own

    def _describe(self, query: QueryObject, pair: SignedDistancePair | None) -> LeastDistance:
        if pair is None:
            nothing = np.full((2, 3), np.nan)
            return LeastDistance(
                distance=self.max_distance,
                pair=(),
                points=nothing,
                normal=nothing[0],
                bodies=None,
            )
        first, second = pair.id_A, pair.id_B
        X_WA, X_WB = query.GetPoseInWorld(first), query.GetPoseInWorld(second)
        points = np.array([X_WA.multiply(pair.p_ACa), X_WB.multiply(pair.p_BCb)])
        normal, bodies = pair.nhat_BA_W, (self._bodies[first], self._bodies[second])
        if first not in self._robot:
            points, normal, bodies = points[::-1], -normal, bodies[::-1]
        return LeastDistance(
            distance=float(pair.distance),
            pair=(self._names[bodies[0]], self._names[bodies[1]]),
            points=points,
            normal=normal,
            bodies=bodies,
        )


def _body_index(i: int) -> BodyIndex:
    from pydrake.multibody.tree import BodyIndex

    return BodyIndex(i)
