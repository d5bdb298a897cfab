"""Least distances between a robot and what stands around it, from the scene graph's queries.

The engine's distances are samples, and can be too large by a millimetre near cylinders (measured):
good for watching a run, no proof.
"""

from __future__ import annotations

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

    Raises:
        InputError: the robot has no collision geometry (it would always look clear), or
            `max_distance` is not positive.
    """

    def __init__(
        self, plant: MultibodyPlant, robot: Sequence[ModelInstanceIndex], *, max_distance: float
    ) -> None:
        self.max_distance = max_distance
        self._bodies: dict[GeometryId, BodyIndex] = {}
        self._robot: set[GeometryId] = set()
        self._names: dict[BodyIndex, str] = {}
        for i in range(plant.num_bodies()):
            body = plant.get_body(_body_index(i))
            self._names[body.index()] = str(body.scoped_name())
            for geometry in plant.GetCollisionGeometriesForBody(body):
                self._bodies[geometry] = body.index()
                if body.model_instance() in robot:
                    self._robot.add(geometry)
        require(max_distance > 0.0, "max_distance", f"{max_distance} m", "> 0")
        if not self._robot:
            models = ", ".join(plant.GetModelInstanceName(model) for model in robot) or "none"
            raise InputError(
                f"robot (models: {models}) has no collision geometry in the scene graph; must have "
                "some, or it would always look clear"
            )

    def least(self, query: QueryObject) -> tuple[LeastDistance, LeastDistance]:
        """The robot's least distance to the scene, and to itself."""
        pairs = query.ComputeSignedDistancePairwiseClosestPoints(self.max_distance)
        scene = own = None
        for pair in pairs:
            count = (pair.id_A in self._robot) + (pair.id_B in self._robot)
            if count == 1 and (scene is None or pair.distance < scene.distance):
                scene = pair
            elif count == 2 and (own is None or pair.distance < own.distance):
                own = pair
        return self._describe(query, scene), self._describe(query, own)

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
        X_WA, X_WB = query.GetPoseInWorld(pair.id_A), query.GetPoseInWorld(pair.id_B)
        points = np.stack([X_WA @ pair.p_ACa, X_WB @ pair.p_BCb])
        normal, bodies = pair.nhat_BA_W, (self._bodies[pair.id_A], self._bodies[pair.id_B])
        if pair.id_A not in self._robot:
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
