"""Joints that keep every spine point on the tip's path."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    BasicVector,
    CacheEntry,
    Context,
    DiscreteValues,
    LeafSystem,
    ValueProducer,
)

from pips_drake.errors import NotFollowableError
from pips_drake.serpentine import solver as codes
from pips_drake.serpentine.follow_the_leader import FollowTheLeader
from pips_drake.serpentine.tip_path import TipPath
from pips_drake.twin.systems.inputs import input_object, input_values

if TYPE_CHECKING:
    Array = NDArray[np.float64]


class FollowTheLeaderController(LeafSystem):
    """Follow-the-leader (FTL-95 Fig 3.1) as a system: the solver of the offline plan, online.

    .. pydrake_system::

        name: FollowTheLeaderController
        input_ports:
        - tip
        - path
        output_ports:
        - joint_state
        - solution

    Input ports:

    - `tip`, (2,): arc length of the tip on the path, m, and its rate, m/s.
    - `path`: abstract `TipPath`.

    Output ports, with feedthrough from both inputs:

    - `joint_state`, (2 J,): joint values, m and rad, and their rates, m/s and rad/s.
    - `solution`, (2,): spine error, m, and iterations.

    State: none in converged mode. In the report's mode (tolerance above 1e-9 in) the module lengths
    (M,) m are discrete state, updated every `period` s.

    The rates are exact derivatives along the path (`joint_rates`), not differences.

    Args:
        solver: arm, tolerance and iteration limit.
        period: of the report's mode, s.

    A tip position without a solution raises `NotFollowableError` from the output.
    """

    def __init__(self, solver: FollowTheLeader, *, period: float = 1.0 / 64.0) -> None:
        super().__init__()
        self._solver = solver
        joints, modules = solver.arm.joints, solver.arm.modules
        tip_port = self.DeclareVectorInputPort("tip", 2)
        path_port = self.DeclareAbstractInputPort("path", AbstractValue.Make(object()))
        self._tip_index, self._path_index = int(tip_port.get_index()), int(path_port.get_index())
        prerequisites = {self.input_port_ticket(port.get_index()) for port in (tip_port, path_port)}
        self._lengths = None
        if solver.carries_over:
            self._lengths = self.DeclareDiscreteState(solver.initial_module_lengths)
            self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update_lengths)
            prerequisites.add(self.discrete_state_ticket(self._lengths))
        self._posture: CacheEntry = self.DeclareCacheEntry(
            description="posture",
            value_producer=ValueProducer(
                allocate=lambda: AbstractValue.Make([np.zeros(joints), np.zeros(modules + 1)]),
                calc=self._calc_posture,
            ),
            prerequisites_of_calc=prerequisites,
        )
        from_posture = {self._posture.ticket()}
        self.DeclareVectorOutputPort(
            "joint_state", 2 * joints, self._calc_joint_state, prerequisites_of_calc=from_posture
        )
        self.DeclareVectorOutputPort(
            "solution", 2, self._calc_solution, prerequisites_of_calc=from_posture
        )

    def _solve(self, context: Context) -> tuple[TipPath, float, list[Array], int, Array]:
        """Path, arc length, what the two outputs say, status, and the module lengths."""
        path: TipPath = input_object(self, context, self._path_index)
        s, speed = input_values(self, context, self._tip_index).tolist()
        lengths = self._solver.initial_module_lengths
        if self._lengths is not None:
            lengths = context.get_discrete_state(self._lengths).CopyToVector()
        outputs = [np.empty(2 * self._solver.arm.joints), np.empty(2)]
        status = self._solver.follow(path, (s, speed), lengths, *outputs)
        return path, s, outputs, status, lengths

    def _calc_posture(self, context: Context, value: AbstractValue) -> None:
        path, s, outputs, status, _ = self._solve(context)
        if status != codes.CONVERGED:
            solution = self._solver.solve(path, [s])
            raise NotFollowableError(self._solver.explain(path, solution, 0), s)
        value.set_value(outputs)

    def _update_lengths(self, context: Context, values: DiscreteValues) -> None:
        *_, lengths = self._solve(context)
        values.get_mutable_vector(self._lengths).SetFromVector(lengths)

    def _calc_joint_state(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._posture.Eval(context)[0])

    def _calc_solution(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._posture.Eval(context)[1])
