"""The question whether Drake can render is answered without crashing, and rightly."""

from __future__ import annotations

import subprocess
import sys

import pytest

from pips_drake.scene.rendering import can_render

RENDER = """
from pydrake.geometry import (
    ClippingRange, ColorRenderCamera, MakeRenderEngineVtk, RenderCameraCore, RenderEngineVtkParams,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.systems.sensors import CameraInfo

scene_graph = SceneGraph()
parameters = RenderEngineVtkParams(default_clear_color=[0.0, 1.0, 0.0])
scene_graph.AddRenderer("vtk", MakeRenderEngineVtk(parameters))
context = scene_graph.CreateDefaultContext()
query = scene_graph.get_query_output_port().Eval(context)
core = RenderCameraCore("vtk", CameraInfo(8, 6, 1.0), ClippingRange(0.1, 10.0), RigidTransform())
camera = ColorRenderCamera(core, False)
image = query.RenderColorImage(camera, scene_graph.world_frame_id(), RigidTransform())
assert image.data.shape == (6, 8, 4) and (image.data[:, :, :3] == [0, 255, 0]).all(), image.data
"""


@pytest.mark.timeout(60)
def test_the_answer_is_what_drake_does() -> None:
    """In a process of its own, which rendering without a driver would crash."""
    done = subprocess.run([sys.executable, "-c", RENDER], capture_output=True, text=True)
    assert (done.returncode == 0) == can_render(), done.stderr


@pytest.mark.skipif(sys.platform != "linux", reason="EGL is asked for on Linux alone")
def test_without_egl_the_answer_is_no(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_library(name: str) -> None:
        raise OSError(f"{name}: cannot open shared object file")

    monkeypatch.setattr("ctypes.CDLL", no_library)
    assert not can_render.__wrapped__()
