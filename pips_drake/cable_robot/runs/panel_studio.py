"""Pictures of painted panels, taken off-screen by Drake's renderer with one lamp on the camera."""

from __future__ import annotations

from collections.abc import Sequence
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
from pips_drake.errors import InputError
from pips_drake.twin.rendering import RENDERER, render_available

#: Nearest and farthest that is drawn, m: narrow, so that patches 0.2 mm above a panel are in front.
CLIPPING = (0.2, 5.0)


class PanelStudio:
    """A scene of panels and what is painted on them; it takes pictures.

    Args:
        folder: where meshes and textures are written; they are read at once.

    Raises:
        InputError: pictures cannot be rendered here.
    """

    def __init__(self, folder: Path, panels: Sequence[Panel], defects: Sequence[Defect]) -> None:
        missing = render_available()
        if missing is not None:
            raise InputError(f"a survey needs pictures: {missing}")
        lamp = LightParameter(type="directional", frame="camera", direction=[0.0, 0.0, 1.0])
        self._scene_graph = SceneGraph()
        engine = MakeRenderEngineVtk(RenderEngineVtkParams(lights=[lamp]))
        self._scene_graph.AddRenderer(RENDERER, engine)
        source = self._scene_graph.RegisterSource("panels")
        for name, file in write_panels(folder, panels, defects).items():
            geometry = GeometryInstance(RigidTransform(), Mesh(str(file), 1.0), name)
            properties = PerceptionProperties()
            properties.AddProperty("label", "id", RenderLabel(1))
            geometry.set_perception_properties(properties)
            self._scene_graph.RegisterAnchoredGeometry(source, geometry)
        self._context = self._scene_graph.CreateDefaultContext()

    def shoot(self, camera: SurveyCamera, poses: Poses, index: int) -> NDArray[np.uint8]:
        """What the camera sees from one of its poses X_WC, (height, width, 3)."""
        X_WC = RigidTransform(RotationMatrix(poses.rotation[index]), poses.position[index])
        query_object = self._scene_graph.get_query_output_port().Eval(self._context)
        # The camera's own intrinsics, half a pixel from `CameraInfo`'s, put things where they are.
        info, clipping = camera.camera_info(), ClippingRange(*CLIPPING)
        core = RenderCameraCore(RENDERER, info, clipping, RigidTransform())
        world = query_object.inspector().world_frame_id()
        image = query_object.RenderColorImage(ColorRenderCamera(core, False), world, X_WC)
        pixels: NDArray[np.uint8] = np.array(image.data, dtype=np.uint8)
        return pixels[:, :, :3]
