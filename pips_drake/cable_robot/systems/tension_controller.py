"""Control by tension: the wrench that brings the platform where it is to be, shared by cables."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from pips_drake.cable_robot.kinematics import jacobian
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.statics import distribute_tensions
from pips_drake.cable_robot.systems.pose_values import pose_of, turn_vector
from pips_drake.config import require
from pips_drake.twin.systems.inputs import input_values

Array = NDArray[np.float64]


class TensionController(LeafSystem):
    """Tensions that hold the platform's weight and pull it to the desired pose.

    .. pydrake_system::

        name: TensionController
        input_ports:
        - desired_pose
        - desired_twist
        - platform_state
        output_ports:
        - command
        - command_rate
        - wanted_tensions
        - feasible

    Input ports:

    - `desired_pose`, (7,): X_WP, quaternion w x y z and position m.
    - `desired_twist`, (6,): velocity m/s and angular velocity rad/s of P in W.
    - `platform_state`, (13,): as it is or as it is estimated: quaternion w x y z of R_WP, position
      m, angular velocity rad/s and velocity m/s in W.

    Output ports, all from state (no feedthrough):

    - `command`, (M,): tensions, N, within the robot's bounds.
    - `command_rate`, (M,): of the lengths, m/s.
    - `wanted_tensions`, (M,): the same before they are cut to the bounds, N.
    - `feasible`, (1,): 1 if nothing had to be cut.

    State: the outputs, discrete, updated every `period` s and at initialization.

    The cables' wrench is -m g + m (w^2 e + 2 z w e') and, for the rotation vector of the error in
    the world's axes, J (w^2 r + 2 z w r'): every error dies away as the same oscillator. Tensions
    that do it are the statics' analytic centre, which moves smoothly. A winch that goes by its
    tension alone resists motion as a damper of E A / (l0 times its bandwidth), some 5 kN s/m: so
    it is told the rate too, that of L (desired twist + w / 2 error).

    Args:
        cable_robot: with M cables, and bounds of their tensions.
        inertia: of the platform about its origin, J, (3, 3) kg m2 in its axes; None: that of its
            box.
        bandwidth: w, rad/s.
        damping: z.
        period: s.
    """

    def __init__(
        self,
        cable_robot: CableRobot,
        *,
        inertia: Array | None = None,
        bandwidth: float = 3.0,
        damping: float = 0.7,
        period: float = 0.04,
    ) -> None:
        super().__init__()
        require(bandwidth > 0.0, "tension controller: bandwidth", f"{bandwidth:g} rad/s", "> 0")
        require(damping >= 0.0, "tension controller: damping", f"{damping:g}", ">= 0")
        self._robot = cable_robot
        self._inertia = box_inertia(cable_robot) if inertia is None else inertia
        self._bandwidth = bandwidth
        self._gains = bandwidth**2, 2.0 * damping * bandwidth
        count = cable_robot.cables
        ports = [
            self.DeclareVectorInputPort(name, size)
            for name, size in (("desired_pose", 7), ("desired_twist", 6), ("platform_state", 13))
        ]
        self._pose, self._twist, self._state = (int(port.get_index()) for port in ports)
        self._states = [self.DeclareDiscreteState(size) for size in (count, count, count, 1)]
        names = ("command", "command_rate", "wanted_tensions", "feasible")
        for name, state in zip(names, self._states, strict=True):
            self.DeclareStateOutputPort(name, state)
        self.DeclareInitializationDiscreteUpdateEvent(self._update)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _update(self, context: Context, values: DiscreteValues) -> None:
        desired = pose_of(input_values(self, context, self._pose))
        wanted_twist = input_values(self, context, self._twist)
        state = input_values(self, context, self._state)
        pose = pose_of(state)
        robot, R = self._robot, pose.rotation[0]
        error = np.empty(6)
        error[:3] = desired.position[0] - pose.position[0]
        error[3:] = turn_vector(desired.rotation[0] @ R.T)
        rate = wanted_twist - np.concatenate([state[10:], state[7:10]])
        acceleration = self._gains[0] * error + self._gains[1] * rate
        wrench = np.concatenate(
            [robot.mass * acceleration[:3], R @ self._inertia @ R.T @ acceleration[3:]]
        )
        # The cables balance the weight and the opposite of what they are to do besides.
        found = distribute_tensions(robot, pose, wrench=-wrench)
        tensions = found.tensions[0]
        values.set_value(self._states[0], np.clip(tensions, robot.tension_min, robot.tension_max))
        closing = wanted_twist + 0.5 * self._bandwidth * error
        values.set_value(self._states[1], jacobian(robot, pose)[0] @ closing)
        values.set_value(self._states[2], tensions)
        values.set_value(self._states[3], found.feasible[:1].astype(float))


def box_inertia(robot: CableRobot) -> Array:
    """Of the platform's solid box about its origin, (3, 3) kg m2, in its axes.

    Its middle is the centre of mass. A platform without a box is taken as a cube that reaches to
    its farthest attachment.
    """
    sizes = robot.box
    if not np.all(sizes > 0.0):
        sizes = np.full(3, 2.0 * max(float(np.abs(robot.attachments).max()), 0.05))
    squares = sizes**2
    own = robot.mass / 12.0 * np.diag(squares.sum() - squares)
    c = robot.centre_of_mass
    return np.asarray(own + robot.mass * (c @ c * np.eye(3) - np.outer(c, c)))
