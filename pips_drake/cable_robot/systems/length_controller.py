"""Control by length: how much cable puts the platform where it is to be."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from pips_drake.cable_robot.kinematics import Poses, cable_lengths
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.statics import distribute_tensions
from pips_drake.cable_robot.systems.pose_values import advanced, pose_of
from pips_drake.twin.systems.inputs import input_values

Array = NDArray[np.float64]


def unstretched_lengths(robot: CableRobot, poses: Poses, tensions: Array) -> Array:
    """What must be reeled out for tensions (N, M) N at N poses, (N, M) m: l E A / (E A + T)."""
    stiffness = robot.axial_stiffness
    return np.asarray(cable_lengths(robot, poses) * stiffness / (stiffness + tensions))


class LengthController(LeafSystem):
    """Unstretched lengths that hold the platform at the desired pose under its weight.

    .. pydrake_system::

        name: LengthController
        input_ports:
        - desired_pose
        - desired_twist
        output_ports:
        - command
        - wanted_tensions
        - feasible

    Input ports:

    - `desired_pose`, (7,): X_WP, quaternion w x y z and position m.
    - `desired_twist`, (6,): velocity m/s and angular velocity rad/s of P in W.

    Output ports, all from state (no feedthrough):

    - `command`, (M,): unstretched lengths, m.
    - `wanted_tensions`, (M,): with which the platform rests there, N.
    - `feasible`, (1,): 1 if they are within the robot's bounds; 0: they miss them by the least.

    State: the outputs, discrete, updated every `period` s and at initialization.

    T are the statics' tensions at the desired pose, and l0 = l E A / (E A + T) their springs'
    lengths: without errors of the machine the platform is where it should, stretch and weight
    included. Sag is neglected. The pose is that of a period later, as far as the present twist
    takes it: winches reach a command a period and one of their steps after it is made. Nothing is
    fed back.

    Args:
        cable_robot: with M cables, and bounds of their tensions.
        method: how tensions are chosen, a name of `tension_methods.METHODS`.
        period: s.
    """

    def __init__(
        self,
        cable_robot: CableRobot,
        *,
        method: str = "analytic_center",
        period: float = 0.04,
    ) -> None:
        super().__init__()
        self._robot, self._method, self._period = cable_robot, method, period
        count = cable_robot.cables
        ports = [
            self.DeclareVectorInputPort("desired_pose", 7),
            self.DeclareVectorInputPort("desired_twist", 6),
        ]
        self._pose, self._twist = (int(port.get_index()) for port in ports)
        self._states = [self.DeclareDiscreteState(size) for size in (count, count, 1)]
        names = ("command", "wanted_tensions", "feasible")
        for name, state in zip(names, self._states, strict=True):
            self.DeclareStateOutputPort(name, state)
        self.DeclareInitializationDiscreteUpdateEvent(self._update)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _update(self, context: Context, values: DiscreteValues) -> None:
        twist = input_values(self, context, self._twist)
        pose = pose_of(input_values(self, context, self._pose))
        ahead = advanced(pose, twist, self._period)
        found = distribute_tensions(self._robot, ahead, self._method)
        # The least-bad tensions may push; no length makes a cable do so.
        tensions = np.maximum(found.tensions, 0.0)
        lengths = unstretched_lengths(self._robot, ahead, tensions)
        for state, value in zip(
            self._states, (lengths[0], tensions[0], found.feasible[:1].astype(float)), strict=True
        ):
            values.set_value(state, value)
