"""Pictures of painted panels, with one lamp on the camera, for tests."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    GeometryInstance,
    LightParameter,
    MakeRenderEngineVtk,
    Mesh,
    PerceptionProperties,
    RenderCameraCore,
    RenderEngineVtkParams,
    RenderLabel,
    SceneGraph,
)
from pydrake.math import RigidTransform, RotationMatrix

from pips_drake.cable_robot.defects import Defect
from pips_drake.cable_robot.kinematics import Poses
from pips_drake.cable_robot.panel_paint import write_panels
from pips_drake.cable_robot.panels import Panel
from pips_drake.cable_robot.survey_camera import SurveyCamera

Shoot = Callable[[SurveyCamera, Poses, int], NDArray[np.uint8]]


def painted(folder: Path, panels: Sequence[Panel], defects: Sequence[Defect]) -> Shoot:
    """What takes pictures of these panels."""
    scene_graph = SceneGraph()
    source = scene_graph.RegisterSource("panels")
    lamp = LightParameter(type="directional", frame="camera", direction=[0.0, 0.0, 1.0])
    scene_graph.AddRenderer("vtk", MakeRenderEngineVtk(RenderEngineVtkParams(lights=[lamp])))
    for name, file in write_panels(folder, panels, defects).items():
        geometry = GeometryInstance(RigidTransform(), Mesh(str(file), 1.0), name)
        properties = PerceptionProperties()
        properties.AddProperty("label", "id", RenderLabel(1))
        geometry.set_perception_properties(properties)
        scene_graph.RegisterAnchoredGeometry(source, geometry)
    context = scene_graph.CreateDefaultContext()

    def shoot(camera: SurveyCamera, poses: Poses, index: int) -> NDArray[np.uint8]:
        query_object = scene_graph.get_query_output_port().Eval(context)
        core = RenderCameraCore(
            "vtk", camera.camera_info(), ClippingRange(0.05, 20.0), RigidTransform()
        )
        X_WC = RigidTransform(RotationMatrix(poses.rotation[index]), poses.position[index])
        world = query_object.inspector().world_frame_id()
        image = query_object.RenderColorImage(ColorRenderCamera(core, False), world, X_WC)
        return np.array(image.data, dtype=np.uint8)[:, :, :3]

    return shoot
