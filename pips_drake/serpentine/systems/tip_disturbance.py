"""Forces on the arm's last body that nobody planned."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from pydrake.common.value import AbstractValue, Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import Context, LeafSystem


class TipDisturbance(LeafSystem):
    """Forces at a body's origin, each for a time.

    .. pydrake_system::

        name: TipDisturbance
        output_ports:
        - spatial_force

    Output port:

    - `spatial_force`: abstract list of `ExternallyAppliedSpatialForce`: what a plant's
      `applied_spatial_force` port takes; empty while nothing acts.

    State: none; the output depends on time alone.

    Args:
        body_index: of the body, in the plant.
        forces: start and end, s, and force in the world, (3,) N, of each.
    """

    def __init__(
        self, body_index: int, *, forces: Sequence[tuple[float, float, ArrayLike]] = ()
    ) -> None:
        super().__init__()
        self._body_index = BodyIndex(body_index)
        self._forces = [(start, end, np.asarray(force)) for start, end, force in forces]
        self.DeclareAbstractOutputPort(
            "spatial_force",
            lambda: Value[list[ExternallyAppliedSpatialForce]](),
            self._calc_spatial_force,
            prerequisites_of_calc={self.time_ticket()},
        )

    def _calc_spatial_force(self, context: Context, output: AbstractValue) -> None:
        time = context.get_time()
        found = []
        for start, end, force in self._forces:
            if start <= time < end:
                one = ExternallyAppliedSpatialForce()
                one.body_index = self._body_index
                one.p_BoBq_B = np.zeros(3)
                one.F_Bq_W = SpatialForce(tau=np.zeros(3), f=force)
                found.append(one)
        output.set_value(found)
