"""A system that watches a robot's clearance while a diagram runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.geometry import QueryObject
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialVelocity
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from pips_drake.twin.clearance import ClearanceQuery, LeastDistance
from pips_drake.twin.systems.inputs import input_object

if TYPE_CHECKING:
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import BodyIndex, ModelInstanceIndex

Array = NDArray[np.float64]


class ClearanceMonitor(LeafSystem):
    """Samples the least distance of a robot to the scene and to itself, and how it changes.

    .. pydrake_system::

        name: ClearanceMonitor
        input_ports:
        - query_object
        - body_poses
        - body_spatial_velocities
        output_ports:
        - clearance
        - witness
        - urgent
        - own_urgent

    Input ports:

    - `query_object`: abstract `QueryObject`, from the scene graph.
    - `body_poses`: abstract list of `RigidTransform` X_WB, from the plant; optional, for the rate.
    - `body_spatial_velocities`: abstract list of `SpatialVelocity` V_WB, from the plant; optional.

    Output ports, all from state (no feedthrough):

    - `clearance`, (3,): distance to the scene, m; its rate along the motion, m/s, negative when
      closing in, NaN without the optional inputs or when nothing is near; distance of the robot to
      itself, m. Distances stop at `max_distance`.
    - `witness`, (7,): index of the nearest pair in `pair_name` (-1 when nothing is near), then the
      witness points on robot and scene in the world, 2 x 3 m, NaN when nothing is near.
    - `urgent`, (3,): distance to the scene, m, its rate, m/s, and index (as in `witness`) of the
      pair that comes nearest within `lookahead` if rates stay: least d + min(rate, 0) lookahead. It
      need not be the nearest one now. NaN without the optional inputs, without a lookahead, or when
      nothing is near.
    - `own_urgent`, (3,): the same of the robot to itself.

    State: the outputs, discrete, updated every `period` s (default 1/32 s) and at initialization.

    The rate of the distance is n . (v_A - v_B), with n the unit normal from scene to robot and v
    the velocities of the witness points as points of their bodies.

    Args:
        plant: finalized, registered with a scene graph.
        robot: the robot's model instances; everything else is the scene.
        max_distance: pairs farther apart than this are not looked at, m.
        lookahead: s; 0 leaves `urgent` and `own_urgent` out.
        lookahead_reach: pairs farther apart than this are not looked at for them, m.
        period: s.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        *,
        robot: Sequence[ModelInstanceIndex],
        max_distance: float = 0.5,
        lookahead: float = 0.0,
        lookahead_reach: float = 0.15,
        period: float = 1.0 / 32.0,
    ) -> None:
        super().__init__()
        self._query = ClearanceQuery(plant, robot, max_distance=max_distance)
        self._lookahead = lookahead
        self._reach = min(lookahead_reach, max_distance)
        bodies = plant.num_bodies()
        self._names = [str(plant.get_body(_body(plant, i)).scoped_name()) for i in range(bodies)]
        query_port = self.DeclareAbstractInputPort(
            "query_object", AbstractValue.Make(QueryObject())
        )
        poses_port = self.DeclareAbstractInputPort(
            "body_poses", AbstractValue.Make([RigidTransform()])
        )
        velocities_port = self.DeclareAbstractInputPort(
            "body_spatial_velocities", AbstractValue.Make([SpatialVelocity()])
        )
        self._query_index = int(query_port.get_index())
        self._motion_indices = int(poses_port.get_index()), int(velocities_port.get_index())
        self._clearance = self.DeclareDiscreteState([max_distance, np.nan, max_distance])
        self._witness = self.DeclareDiscreteState([-1.0] + [np.nan] * 6)
        self._urgent = self.DeclareDiscreteState([np.nan] * 3)
        self._own_urgent = self.DeclareDiscreteState([np.nan] * 3)
        self.DeclareStateOutputPort("clearance", self._clearance)
        self.DeclareStateOutputPort("witness", self._witness)
        self.DeclareStateOutputPort("urgent", self._urgent)
        self.DeclareStateOutputPort("own_urgent", self._own_urgent)
        self.DeclareInitializationDiscreteUpdateEvent(self._update_clearance)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update_clearance)

    def pair_name(self, index: float) -> tuple[str, str] | None:
        """The bodies' names of a pair index in the `witness` output, the robot's first."""
        if index < 0:
            return None
        first, second = divmod(int(index), len(self._names))
        return self._names[first], self._names[second]

    def _update_clearance(self, context: Context, values: DiscreteValues) -> None:
        query = input_object(self, context, self._query_index)
        scene, own = self._query.least(query)
        rate, index = np.nan, -1.0
        if scene.bodies is not None:
            rate = self._rate(context, scene)
            index = self._pair_index(scene)
        clearance = values.get_mutable_vector(self._clearance).get_mutable_value()
        clearance[:] = scene.distance, rate, own.distance
        witness = values.get_mutable_vector(self._witness).get_mutable_value()
        witness[0] = index
        witness[1:] = scene.points.ravel()
        urgent = values.get_mutable_vector(self._urgent).get_mutable_value()
        own_urgent = values.get_mutable_vector(self._own_urgent).get_mutable_value()
        urgent[:] = own_urgent[:] = np.nan
        # The pairs themselves are asked for only when there are any.
        if self._lookahead > 0.0 and min(scene.distance, own.distance) < self._reach:
            near, own_near = self._query.near_pairs(query, self._reach)
            urgent[:] = self._most_urgent(context, near)
            own_urgent[:] = self._most_urgent(context, own_near)

    def _pair_index(self, nearest: LeastDistance) -> float:
        if nearest.bodies is None:
            return -1.0
        return float(int(nearest.bodies[0]) * len(self._names) + int(nearest.bodies[1]))

    def _most_urgent(
        self, context: Context, pairs: Sequence[LeastDistance]
    ) -> tuple[float, float, float]:
        """Distance, rate and index of the pair that comes nearest within the lookahead."""
        best, least = (np.nan, np.nan, np.nan), np.inf
        for pair in pairs:
            rate = self._rate(context, pair)
            left = pair.distance + min(rate, 0.0) * self._lookahead
            if left < least:
                best, least = (pair.distance, rate, self._pair_index(pair)), left
        return best

    def _rate(self, context: Context, nearest: LeastDistance) -> float:
        values = [self.EvalAbstractInput(context, index) for index in self._motion_indices]
        if None in values or nearest.bodies is None:
            return np.nan
        poses, velocities = (value.get_value() for value in values)
        first, second = (
            # As a point of its body.
            velocities[body].Shift(point - poses[body].translation()).translational()
            for body, point in zip(map(int, nearest.bodies), nearest.points, strict=True)
        )
        return float(nearest.normal.dot(first - second))


def _body(plant: MultibodyPlant, i: int) -> BodyIndex:
    from pydrake.multibody.tree import BodyIndex

    return BodyIndex(i)
