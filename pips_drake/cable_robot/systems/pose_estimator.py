"""Where the machine believes its platform to be: encoders and force sensors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from pips_drake.cable_robot.kinematics import Poses
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.systems.pose_values import pose_of, pose_vector, turn, turn_vector
from pips_drake.twin.systems.inputs import input_values

Array = NDArray[np.float64]


#: Corrections end below this, m and rad, or give up after so many.
_SMALL = 1e-9
_MOST_STEPS = 20


class PoseEstimator(LeafSystem):
    """The platform's pose from what is reeled out and how much that is stretched.

    .. pydrake_system::

        name: PoseEstimator
        input_ports:
        - encoder
        - force_reading
        output_ports:
        - estimated_state
        - valid

    Input ports:

    - `encoder`, (M,): what is reeled out, m.
    - `force_reading`, (M,): tensions, N.

    Output ports, both from state (no feedthrough):

    - `estimated_state`, (13,): quaternion w x y z of R_WP, position m, angular velocity rad/s and
      velocity m/s in W, as a free body's state in a plant.
    - `valid`, (1,): 0 while fewer cables are taut than the platform has freedoms, or their lengths
      give no pose near the last one: then the last estimate stays.

    State: the outputs, discrete, updated every `period` s and at initialization.

    Taut cables have the length l = l0 (1 + T / (E A)); the pose is the forward kinematics' of all
    cables that pull, in the sense of least squares. Velocities are differences of successive poses.
    What the encoders' calibration is off by is unknown here, and so it moves the estimate.

    Args:
        cable_robot: with M cables.
        guess: one pose, near where it begins.
        period: s.
        slack_below: a cable that reads less says nothing of the pose, N.
    """

    def __init__(
        self,
        cable_robot: CableRobot,
        guess: Poses,
        *,
        period: float = 0.04,
        slack_below: float = 2.0,
    ) -> None:
        super().__init__()
        self._robot, self._period, self._slack_below = cable_robot, period, slack_below
        count = cable_robot.cables
        ports = [self.DeclareVectorInputPort(n, count) for n in ("encoder", "force_reading")]
        self._encoder, self._force = (int(port.get_index()) for port in ports)
        first = np.zeros(13)
        first[:7] = pose_vector(guess.position[0], guess.rotation[0])
        self._state = self.DeclareDiscreteState(first)
        self._valid = self.DeclareDiscreteState([1.0])
        self.DeclareStateOutputPort("estimated_state", self._state)
        self.DeclareStateOutputPort("valid", self._valid)
        self.DeclareInitializationDiscreteUpdateEvent(self._initialize)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _initialize(self, context: Context, values: DiscreteValues) -> None:
        self._update(context, values)
        state = values.get_mutable_vector(self._state).get_mutable_value()
        state[7:] = 0.0

    def _update(self, context: Context, values: DiscreteValues) -> None:
        state = values.get_mutable_vector(self._state).get_mutable_value()
        forces = input_values(self, context, self._force)
        encoder = input_values(self, context, self._encoder)
        taut = forces >= self._slack_below
        last, found = pose_of(state), None
        if taut.sum() >= self._robot.freedom:
            lengths = encoder * (1.0 + forces / self._robot.axial_stiffness)
            found = nearest_pose(self._robot, lengths, taut, last)
        values.set_value(self._valid, [float(found is not None)])
        if found is None:
            state[7:] = 0.0
            return
        turned = found.rotation[0] @ last.rotation[0].T
        state[:7] = pose_vector(found.position[0], found.rotation[0])
        state[7:10] = turn_vector(turned) / self._period
        state[10:] = (found.position[0] - last.position[0]) / self._period


def nearest_pose(
    robot: CableRobot, lengths: Array, taut: NDArray[np.bool_], guess: Poses
) -> Poses | None:
    """The pose whose taut cables have these lengths, in the sense of least squares.

    `kinematics.forward_kinematics` for one pose and some of the cables, near enough for a sensor,
    in a tenth of its time.

    Args:
        lengths: (M,) m; those of slack cables count for nothing.
        taut: (M,).

    Returns:
        None where it does not converge from the guess.
    """
    anchors, attachments, wanted = robot.anchors[taut], robot.attachments[taut], lengths[taut]
    x, R = guess.position[0], guess.rotation[0]
    L = np.empty((len(wanted), 6))
    for _ in range(_MOST_STEPS):
        arms = attachments @ R.T
        cables = anchors - x - arms
        now = np.sqrt(np.einsum("ij,ij->i", cables, cables))
        units = cables / now[:, None]
        L[:, :3] = -units
        L[:, 3] = units[:, 1] * arms[:, 2] - units[:, 2] * arms[:, 1]
        L[:, 4] = units[:, 2] * arms[:, 0] - units[:, 0] * arms[:, 2]
        L[:, 5] = units[:, 0] * arms[:, 1] - units[:, 1] * arms[:, 0]
        try:
            step = np.linalg.solve(L.T @ L, L.T @ (wanted - now))
        except np.linalg.LinAlgError:
            return None
        x, R = x + step[:3], turn(step[3:]) @ R
        size = np.abs(step).max()
        if size < _SMALL:
            return Poses(x[None], R[None])
        if not size < 10.0:
            return None
    return None
