"""A free flyer's attitude control: jets that fire at the ends of a dead band."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.common.eigen_geometry import Quaternion
from pydrake.common.value import AbstractValue, Value
from pydrake.math import RotationMatrix
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem
from scipy.spatial.transform import Rotation

from pips_drake.twin.systems.inputs import input_values

Array = NDArray[np.float64]


class AttitudeLimitCycle(LeafSystem):
    """Keeps each attitude angle of a free body within a dead band, which makes it limit cycle.

    .. pydrake_system::

        name: AttitudeLimitCycle
        input_ports:
        - payload_state
        - attachment
        output_ports:
        - spatial_force
        - torque

    Input ports:

    - `payload_state`, (13,): of a free body, from the plant: quaternion w x y z of R_WP, position,
      m, angular velocity in W, rad/s, velocity, m/s.
    - `attachment`, (3,): grasped 0 or 1, support, resets; optional. The jets are off once something
      has held the body, until a reset.

    Output ports, both from state (no feedthrough):

    - `spatial_force`: abstract list of `ExternallyAppliedSpatialForce`: what a plant's
      `applied_spatial_force` port takes.
    - `torque`, (3,): of the jets about the body's axes, N m.

    State, discrete, updated every `period` s: the torque about the body's axes, (3,) N m, and in W,
    (3,) N m; one more than the resets there had been when the body was held last, (1,).

    The angles are the components, in the body, of the rotation vector from the attitude that is
    kept. Beyond the dead band a jet pushes back until the angle comes in at `return_rate`. For one
    axis, J theta'' = -T sign(theta) then gives, from any rate w at the band's end b,

    - the largest angle b + w^2 J / (2 T);
    - after the first pulse, coasting at the return rate r, with pulses of 2 r J / T: a cycle of
      period 4 b / r + 4 r J / T and amplitude b + r^2 J / (2 T).

    Args:
        body_index: of the body, in the plant.
        attitude: that is kept, R_WP, (3, 3).
        dead_band: half of it, rad.
        torque: of a pair of jets, N m.
        return_rate: rad/s; default 0.05 deg/s, assumed: a cycle takes tens of seconds.
        period: s.
    """

    def __init__(
        self,
        body_index: int,
        *,
        attitude: ArrayLike = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        dead_band: float = np.radians(0.5),
        torque: float = 200.0,
        return_rate: float = np.radians(0.05),
        period: float = 0.02,
    ) -> None:
        super().__init__()
        self._body_index = BodyIndex(body_index)
        self._kept = np.array(attitude, dtype=np.float64)
        self._dead_band, self._torque, self._return_rate = dead_band, torque, return_rate
        state_port = self.DeclareVectorInputPort("payload_state", 13)
        held_port = self.DeclareVectorInputPort("attachment", 3)
        self._state_index = int(state_port.get_index())
        self._held_index = int(held_port.get_index())
        self._jets = self.DeclareDiscreteState(3)
        self._in_world = self.DeclareDiscreteState(3)
        self._was_held = self.DeclareDiscreteState(1)
        self.DeclareAbstractOutputPort(
            "spatial_force",
            lambda: Value[list[ExternallyAppliedSpatialForce]](),
            self._calc_spatial_force,
            prerequisites_of_calc={self.xd_ticket()},
        )
        self.DeclareStateOutputPort("torque", self._jets)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _update(self, context: Context, values: DiscreteValues) -> None:
        jets = values.get_mutable_vector(self._jets).get_mutable_value()
        in_world = values.get_mutable_vector(self._in_world).get_mutable_value()
        was_held = values.get_mutable_vector(self._was_held).get_mutable_value()
        held = self.EvalVectorInput(context, self._held_index)
        if held is not None:
            grasped, support, resets = held.value()
            if grasped or support:
                was_held[0] = resets + 1.0
            if was_held[0] == resets + 1.0:
                jets[:] = in_world[:] = 0.0
                return
        state = input_values(self, context, self._state_index)
        R_WP = RotationMatrix(Quaternion(wxyz=state[:4] / np.linalg.norm(state[:4]))).matrix()
        angles = Rotation.from_matrix(self._kept.T @ R_WP).as_rotvec()
        rates = R_WP.T @ state[7:10]
        side = np.sign(angles)
        firing = (np.abs(angles) > self._dead_band) & (side * rates > -self._return_rate)
        jets[:] = np.where(firing, -side * self._torque, 0.0)
        in_world[:] = R_WP @ jets

    def _calc_spatial_force(self, context: Context, output: AbstractValue) -> None:
        torque = context.get_discrete_state(self._in_world).value()
        if not torque.any():
            output.set_value([])
            return
        force = ExternallyAppliedSpatialForce()
        force.body_index = self._body_index
        force.p_BoBq_B = np.zeros(3)
        force.F_Bq_W = SpatialForce(tau=torque.copy(), f=np.zeros(3))
        output.set_value([force])
