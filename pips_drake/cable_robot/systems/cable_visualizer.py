"""Draws the cables between platform and anchors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.geometry import (
    Cylinder,
    FrameId,
    FramePoseVector,
    GeometryFrame,
    GeometryInstance,
    MakePhongIllustrationProperties,
    PerceptionProperties,
    Rgba,
    SceneGraph,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context, LeafSystem, State

from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.systems.pose_values import pose_of
from pips_drake.twin.systems.inputs import input_values

Array = NDArray[np.float64]

COLOR, RADIUS = (0.95, 0.75, 0.1, 1.0), 0.015
#: Of each cable. Shapes cannot stretch: equal pieces are laid along it, one over the other's end.
PIECES = 7


class CableVisualizer(LeafSystem):
    """Every cable as a straight line, for whatever shows the scene graph. Looks only.

    .. pydrake_system::

        name: CableVisualizer
        input_ports:
        - platform_state
        - broken
        output_ports:
        - geometry_pose

    Input ports:

    - `platform_state`, (13,): of a free body, from the plant: quaternion w x y z of R_WP, position
      m, angular velocity rad/s and velocity m/s in W.
    - `broken`, (M,): above 0.5 where a cable is: it hangs down from its anchor; optional.

    Output port, from state (no feedthrough):

    - `geometry_pose`: abstract `FramePoseVector` of the pieces in the world, to the scene graph's
      source pose port of this source.

    State: the output, abstract, updated every `period` s and at initialization.

    Sag is not drawn. A cable shorter than one piece, a sixth of the farthest anchors' distance,
    sticks out.

    Args:
        cable_robot: with M cables.
        scene_graph: where the shapes are registered.
        period: s.
    """

    def __init__(
        self, cable_robot: CableRobot, *, scene_graph: SceneGraph, period: float = 0.04
    ) -> None:
        super().__init__()
        self._robot = cable_robot
        anchors = cable_robot.anchors
        longest = float(np.linalg.norm(anchors[:, None] - anchors[None], axis=2).max())
        # A tenth more than that, so that pieces meet at any length that there is.
        self.piece = 1.1 * longest / PIECES
        self.source_id = scene_graph.RegisterSource("cable_visualizer")
        self._frames: list[FrameId] = []
        for cable in range(1, cable_robot.cables + 1):
            for number in range(1, PIECES + 1):
                self._frames.append(self._register(scene_graph, f"cable_{cable}_{number}"))
        self._state_index = int(self.DeclareVectorInputPort("platform_state", 13).get_index())
        port = self.DeclareVectorInputPort("broken", cable_robot.cables)
        self._broken_index = int(port.get_index())
        start = FramePoseVector()
        for frame in self._frames:
            start.set_value(frame, RigidTransform())
        self._poses = self.DeclareAbstractState(AbstractValue.Make(start))
        self.DeclareStateOutputPort("geometry_pose", self._poses)
        self.DeclareInitializationUnrestrictedUpdateEvent(self._update_poses)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update_poses)

    def frame(self, cable: int, piece: int) -> FrameId:
        """The frame of a piece of a cable, both from 0; it begins there and lies along z."""
        return self._frames[cable * PIECES + piece]

    def _register(self, scene_graph: SceneGraph, name: str) -> FrameId:
        frame = scene_graph.RegisterFrame(self.source_id, GeometryFrame(name))
        X_FG = RigidTransform([0.0, 0.0, 0.5 * self.piece])
        shape = GeometryInstance(X_FG, Cylinder(RADIUS, self.piece), name)
        shape.set_illustration_properties(MakePhongIllustrationProperties(COLOR))
        perception = PerceptionProperties()
        perception.AddProperty("phong", "diffuse", Rgba(*COLOR))
        shape.set_perception_properties(perception)
        scene_graph.RegisterGeometry(self.source_id, frame, shape)
        return frame

    def _update_poses(self, context: Context, state: State) -> None:
        pose = pose_of(input_values(self, context, self._state_index))
        broken = self.EvalVectorInput(context, self._broken_index)
        robot = self._robot
        ends = pose.position[0] + robot.attachments @ pose.rotation[0].T
        vector = FramePoseVector()
        for cable, (anchor, end) in enumerate(zip(robot.anchors, ends, strict=True)):
            if broken is not None and broken.value()[cable] > 0.5:
                end = anchor - [0.0, 0.0, 2.0 * self.piece]
            along = anchor - end
            length = float(np.linalg.norm(along))
            R = RotationMatrix.MakeFromOneVector(along, 2)
            step = along * (length - self.piece) / length / (PIECES - 1)
            for number in range(PIECES):
                vector.set_value(self.frame(cable, number), RigidTransform(R, end + number * step))
        state.get_mutable_abstract_state(int(self._poses)).set_value(vector)
