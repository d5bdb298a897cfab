"""Joints that keep every spine point on the tip's path."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

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
        self._tip_port = self.DeclareVectorInputPort("tip", 2)
        self._path_port = self.DeclareAbstractInputPort("path", AbstractValue.Make(object()))
        prerequisites = {self.input_port_ticket(self._tip_port.get_index())}
        prerequisites.add(self.input_port_ticket(self._path_port.get_index()))
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

    def _solve(self, context: Context) -> tuple[TipPath, float, float, Array, list[Any]]:
        path: TipPath = self._path_port.Eval(context)
        s, speed = self._tip_port.Eval(context)
        lengths = self._solver.initial_module_lengths
        if self._lengths is not None:
            lengths = context.get_discrete_state(self._lengths).CopyToVector()
        return path, s, speed, lengths, list(self._solver.solve_one(path, s, lengths))

    def _calc_posture(self, context: Context, value: AbstractValue) -> None:
        path, s, speed, _, (q, arcs, status, iterations, error) = self._solve(context)
        if status != codes.CONVERGED:
            solution = self._solver.solve(path, [s])
            raise NotFollowableError(self._solver.explain(path, solution, 0), s)
        rates = self._solver.rates(path, q, arcs)[0] * speed
        value.set_value([np.concatenate([q, rates]), np.array([error, float(iterations)])])

    def _update_lengths(self, context: Context, values: DiscreteValues) -> None:
        _, _, _, lengths, _ = self._solve(context)
        values.get_mutable_vector(self._lengths).SetFromVector(lengths)

    def _calc_joint_state(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._posture.Eval(context)[0])

    def _calc_solution(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._posture.Eval(context)[1])
