"""The cables as a system: what they do to the platform in the plant."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue, Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from pips_drake.cable_robot.cable_forces import cable_table, pull, up_direction
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.errors import NotFollowableError
from pips_drake.twin.systems.inputs import input_values

Array = NDArray[np.float64]


class CableForces(LeafSystem):
    """Cables that pull and never push, and what else acts on the platform.

    .. pydrake_system::

        name: CableForces
        input_ports:
        - platform_state
        - unstretched
        - rate
        - broken
        - disturbance
        output_ports:
        - spatial_force
        - tensions
        - lengths
        - wrench

    Input ports:

    - `platform_state`, (13,): of a free body, from the plant: quaternion w x y z of R_WP, position
      m, angular velocity rad/s and velocity m/s in W.
    - `unstretched`, (M,): lengths of the cables that are reeled out, m.
    - `rate`, (M,): at which they change, m/s.
    - `broken`, (M,): above 0.5 where a cable is; optional.
    - `disturbance`, (6,): another wrench about the platform's origin in W, N and N m; optional.

    Output ports, all with feedthrough:

    - `spatial_force`: abstract list of `ExternallyAppliedSpatialForce`: what a plant's
      `applied_spatial_force` port takes.
    - `tensions`, (M,): at the platform, N; exactly 0 of slack and broken cables.
    - `lengths`, (M,): straight from end to end, m.
    - `wrench`, (6,): of the cables, about the platform's origin in W, force N and moment N m.

    No state, no latency. Equations: `pips_drake.cable_robot.cable_forces`. The drag is -c v and
    -d w on the platform: what air, pulleys and bending of the cables take from a swing.

    Args:
        cable_robot: with M cables.
        body_index: of the platform, in the plant.
        damping_time: of the cables, s.
        weight: of the cables, N/m; 0 neglects the sag.
        drag: c, N s/m, and d, N m s.
    """

    def __init__(
        self,
        cable_robot: CableRobot,
        body_index: int,
        *,
        damping_time: float = 0.0,
        weight: float = 0.0,
        drag: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        super().__init__()
        count = self._cables = cable_robot.cables
        self._name, self._body_index = cable_robot.name, BodyIndex(body_index)
        self._table = cable_table(cable_robot, damping_time=damping_time, weight=weight)
        self._up, self._drag = up_direction(cable_robot), drag
        self._none_broken = np.zeros((1, count))
        sizes = {"platform_state": 13, "unstretched": count, "rate": count, "broken": count}
        ports = [self.DeclareVectorInputPort(name, size) for name, size in sizes.items()]
        ports.append(self.DeclareVectorInputPort("disturbance", 6))
        self._state, self._unstretched, self._rate, self._broken, self._disturbance = (
            int(port.get_index()) for port in ports
        )
        self.DeclareAbstractOutputPort(
            "spatial_force",
            lambda: Value[list[ExternallyAppliedSpatialForce]](),
            self._calc_spatial_force,
        )
        self.DeclareVectorOutputPort("tensions", count, self._calc_tensions)
        self.DeclareVectorOutputPort("lengths", count, self._calc_lengths)
        self.DeclareVectorOutputPort("wrench", 6, self._calc_wrench)

    def _pull(self, context: Context) -> tuple[Array, Array]:
        """Wrench, tensions and lengths in one row (6 + 2 M,), and the platform's state."""
        state = input_values(self, context, self._state)
        broken = self.EvalVectorInput(context, self._broken)
        out = np.empty((1, 6 + 2 * self._cables))
        good = pull(
            self._table,
            self._up,
            state[None],
            input_values(self, context, self._unstretched)[None],
            input_values(self, context, self._rate)[None],
            self._none_broken if broken is None else broken.value()[None],
            out,
        )
        if not good:
            time = context.get_time()
            raise NotFollowableError(f"{self._name}: a cable has no shape at {time:.4f} s")
        return out[0], state

    def _calc_spatial_force(self, context: Context, output: AbstractValue) -> None:
        pulled, state = self._pull(context)
        total = pulled[:6]
        linear, angular = self._drag
        if linear or angular:
            total[:3] -= linear * state[10:]
            total[3:] -= angular * state[7:10]
        other = self.EvalVectorInput(context, self._disturbance)
        if other is not None:
            total += other.value()
        force = ExternallyAppliedSpatialForce()
        force.body_index = self._body_index
        force.F_Bq_W = SpatialForce(tau=total[3:], f=total[:3])
        output.set_value([force])

    def _calc_tensions(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._pull(context)[0][6 : 6 + self._cables])

    def _calc_lengths(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._pull(context)[0][6 + self._cables :])

    def _calc_wrench(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._pull(context)[0][:6])
