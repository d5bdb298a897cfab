"""How far the loops that the legs close stand open."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from pips_drake.twin.systems.inputs import input_object

Array = NDArray[np.float64]


class LoopGapMeter(LeafSystem):
    """Distances of pairs of points that constraints hold together.

    .. pydrake_system::

        name: LoopGapMeter
        input_ports:
        - body_poses
        output_ports:
        - gap

    Input port:

    - `body_poses`: abstract list of `RigidTransform` X_WB, from the plant.

    Output port, with feedthrough:

    - `gap`, (A,): of each pair, m; a pair an actuator. Drake softens constraints by as much as a
      step of the plant needs to stay solvable: the gap is what is left, in proportion to the force
      across it and to the square of the step.

    State: none.

    Args:
        bodies: of each pair, (A, 2) indices of plant bodies.
        points: in those bodies' frames, (A, 2, 3) m.
    """

    def __init__(self, bodies: ArrayLike, points: ArrayLike) -> None:
        super().__init__()
        self._pairs = [
            [(int(body), RigidTransform(point)) for body, point in zip(two, places, strict=True)]
            for two, places in zip(np.asarray(bodies), np.asarray(points), strict=True)
        ]
        poses_port = self.DeclareAbstractInputPort(
            "body_poses", AbstractValue.Make([RigidTransform()])
        )
        self._poses_index = int(poses_port.get_index())
        self.DeclareVectorOutputPort("gap", len(self._pairs), self._calc_gap)

    def _calc_gap(self, context: Context, output: BasicVector) -> None:
        poses = input_object(self, context, self._poses_index)
        gaps = output.get_mutable_value()
        for k, ((body_a, X_AP), (body_b, X_BQ)) in enumerate(self._pairs):
            p_WP = poses[body_a].multiply(X_AP).translation()
            gaps[k] = np.linalg.norm(poses[body_b].multiply(X_BQ).translation() - p_WP)
