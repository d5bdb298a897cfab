"""Draws the actuators between their pins."""

from __future__ import annotations

from pydrake.common.value import AbstractValue, Value
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
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem, State

from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.legs import make_legs
from pips_drake.twin.systems.inputs import input_object

#: Tube and rod: red, green, blue, opacity.
TUBE_COLOUR, ROD_COLOUR = (0.80, 0.36, 0.12, 1.0), (0.92, 0.92, 0.95, 1.0)


class ActuatorVisualizer(LeafSystem):
    """Tube and rod of every actuator, for whatever shows the scene graph. Looks only.

    .. pydrake_system::

        name: ActuatorVisualizer
        input_ports:
        - body_poses
        output_ports:
        - geometry_pose

    Input port:

    - `body_poses`: abstract list of `RigidTransform` X_WB, from the plant.

    Output port, from state; with feedthrough if `period` is None:

    - `geometry_pose`: abstract `FramePoseVector` of tubes and rods in the world, to the scene
      graph's source pose port of this source (`AddActuatorVisualizer` connects it).

    State: the output, abstract, updated every `period` s and at initialization; none if `period` is
    None.

    An actuator's tube stands at its inner pin and points at the outer one, its rod at the outer pin
    and points back; both lie on the line between the pins, so the rod slides. A plant asks its
    scene graph for contacts at every step, and that for all poses: sampled, they cost a run little.

    Args:
        arm: the arm.
        plant: finalized; holds the arm.
        model: the arm's model instance.
        scene_graph: where the shapes are registered.
        period: s; None for a picture of whatever posture is set.
    """

    def __init__(
        self,
        arm: SerpentineArm,
        *,
        plant: MultibodyPlant,
        model: ModelInstanceIndex,
        scene_graph: SceneGraph,
        period: float | None = None,
    ) -> None:
        super().__init__()
        legs = make_legs(arm)
        bodies = [int(plant.GetBodyByName(body.name, model).index()) for body in arm.bodies]
        first = arm.first_actuated_joint
        self.source_id = scene_graph.RegisterSource("actuator_visualizer")
        # Inner body and the pin in it, outer body and the pin in it, tube and rod.
        self._actuators: list[
            tuple[int, RigidTransform, int, RigidTransform, FrameId, FrameId]
        ] = []
        for k, name in enumerate(arm.actuator_names):
            length = float(legs.part_length[k])
            radii = float(legs.tube_radius[k]), float(legs.rod_radius[k])
            tube = self._register(scene_graph, f"{name}_tube", radii[0], length, TUBE_COLOUR)
            rod = self._register(scene_graph, f"{name}_rod", radii[1], length, ROD_COLOUR)
            inner, outer = RigidTransform(legs.inner_pin[k]), RigidTransform(legs.outer_pin[k])
            j = first + k
            self._actuators.append((bodies[j - 1], inner, bodies[j], outer, tube, rod))
        poses_port = self.DeclareAbstractInputPort(
            "body_poses", AbstractValue.Make([RigidTransform()])
        )
        self._poses_index = int(poses_port.get_index())
        if period is None:
            self.DeclareAbstractOutputPort(
                "geometry_pose",
                lambda: AbstractValue.Make(FramePoseVector()),
                self._calc_geometry_pose,
            )
            return
        start = FramePoseVector()
        for *_, tube, rod in self._actuators:
            start.set_value(tube, RigidTransform())
            start.set_value(rod, RigidTransform())
        self._state = self.DeclareAbstractState(AbstractValue.Make(start))
        self.DeclareStateOutputPort("geometry_pose", self._state)
        self.DeclareInitializationUnrestrictedUpdateEvent(self._update_poses)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update_poses)

    def _register(
        self,
        scene_graph: SceneGraph,
        name: str,
        radius: float,
        length: float,
        colour: tuple[float, float, float, float],
    ) -> FrameId:
        frame = scene_graph.RegisterFrame(self.source_id, GeometryFrame(name))
        # Along z from the frame's origin.
        shape = GeometryInstance(
            RigidTransform([0.0, 0.0, 0.5 * length]), Cylinder(radius, length), name
        )
        shape.set_illustration_properties(MakePhongIllustrationProperties(colour))
        perception = PerceptionProperties()
        perception.AddProperty("phong", "diffuse", Rgba(*colour))
        shape.set_perception_properties(perception)
        scene_graph.RegisterGeometry(self.source_id, frame, shape)
        return frame

    def _update_poses(self, context: Context, state: State) -> None:
        state.get_mutable_abstract_state(int(self._state)).set_value(self._poses(context))

    def _calc_geometry_pose(self, context: Context, output: Value) -> None:
        output.set_value(self._poses(context))

    def _poses(self, context: Context) -> FramePoseVector:
        poses = input_object(self, context, self._poses_index)
        vector = FramePoseVector()
        make_rotation = RotationMatrix.MakeFromOneVector
        for inner_body, X_BI, outer_body, X_BO, tube, rod in self._actuators:
            # Poses of the pins, of which only the places matter: faster than moving points.
            inner = poses[inner_body].multiply(X_BI).translation()
            outer = poses[outer_body].multiply(X_BO).translation()
            along = outer - inner
            vector.set_value(tube, RigidTransform(make_rotation(along, 2), inner))
            vector.set_value(rod, RigidTransform(make_rotation(-along, 2), outer))
        return vector


def AddActuatorVisualizer(
    builder: DiagramBuilder,
    *,
    plant: MultibodyPlant,
    model: ModelInstanceIndex,
    scene_graph: SceneGraph,
    arm: SerpentineArm,
    period: float | None = None,
) -> ActuatorVisualizer:
    """Adds and connects an `ActuatorVisualizer`."""
    system = builder.AddNamedSystem(
        "actuator_visualizer",
        ActuatorVisualizer(arm, plant=plant, model=model, scene_graph=scene_graph, period=period),
    )
    builder.Connect(plant.get_body_poses_output_port(), system.GetInputPort("body_poses"))
    builder.Connect(
        system.GetOutputPort("geometry_pose"), scene_graph.get_source_pose_port(system.source_id)
    )
    return system
