"""Where the platform is to be: a source."""

from __future__ import annotations

from pydrake.systems.framework import BasicVector, Context, LeafSystem

from pips_drake.cable_robot.platform_motion import PlatformMotion
from pips_drake.cable_robot.systems.pose_values import pose_vector


class PoseCommand(LeafSystem):
    """Goes through a motion's way points.

    .. pydrake_system::

        name: PoseCommand
        output_ports:
        - desired_pose
        - desired_twist
        - tilt
        - way_point
        - finished

    Output ports, all of time alone:

    - `desired_pose`, (7,): X_WP, quaternion w x y z and position m.
    - `desired_twist`, (6,): velocity m/s and angular velocity rad/s of P in W.
    - `tilt`, (1,): of the camera's head, rad.
    - `way_point`, (2,): number of the last way point reached, from 0; 1 while it rests there.
    - `finished`, (1,): 1 when the last one's rest is over.

    No state, no latency.

    Args:
        platform_motion: through the way points.
    """

    def __init__(self, platform_motion: PlatformMotion) -> None:
        super().__init__()
        self._motion = platform_motion
        for name, size, calc in (
            ("desired_pose", 7, self._calc_desired_pose),
            ("desired_twist", 6, self._calc_desired_twist),
            ("tilt", 1, self._calc_tilt),
            ("way_point", 2, self._calc_way_point),
            ("finished", 1, self._calc_finished),
        ):
            self.DeclareVectorOutputPort(
                name, size, calc, prerequisites_of_calc={self.time_ticket()}
            )

    def _calc_desired_pose(self, context: Context, output: BasicVector) -> None:
        at = self._motion.at(context.get_time())
        output.SetFromVector(pose_vector(at.position, at.rotation))

    def _calc_desired_twist(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._motion.at(context.get_time()).twist)

    def _calc_tilt(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, self._motion.at(context.get_time()).tilt)

    def _calc_way_point(self, context: Context, output: BasicVector) -> None:
        at = self._motion.at(context.get_time())
        output.SetFromVector([float(at.way_point), float(at.standing)])

    def _calc_finished(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, float(context.get_time() >= self._motion.duration))
