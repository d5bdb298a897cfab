"""Off-screen pictures of a scene graph, from any camera, with Drake's software renderer.

A picture is a query: nothing is added to the diagram but a renderer, and that can be added to a
context after the run. Cameras are Drake's: x to the right, y down, z into the picture.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.scene.rendering import can_render
from pips_drake.twin.output_folder import write_whole

if TYPE_CHECKING:
    from pydrake.geometry import QueryObject, RenderCameraCore, SceneGraph
    from pydrake.math import RigidTransform
    from pydrake.systems.framework import Context

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

#: Name of the renderer in the scene graph.
RENDERER = "vtk"
#: Default width and height of a picture, pixels.
SIZE = (1280, 720)
#: Default vertical field of view, rad.
FIELD_OF_VIEW = math.radians(35.0)

_BACKGROUND = (0.90, 0.93, 0.96)
# Direction (world) and intensity: the sun from above, a weaker light from three sides so that no
# face is black, and one from below for the undersides of what hangs. No shadows: with them Drake's
# VTK draws a cut-out of the picture (measured on drake 1.58, software EGL).
_LIGHTS = (
    ((0.3, 0.4, -1.0), 0.75),
    ((1.0, 0.6, -0.3), 0.35),
    ((-1.0, 0.5, -0.2), 0.35),
    ((0.2, -1.0, -0.3), 0.35),
    ((0.0, 0.2, 1.0), 0.20),
)


def render_available() -> str | None:
    """None if pictures can be rendered here, else one line that says what is missing."""
    if can_render():
        return None
    return "software EGL is missing (Debian, Ubuntu: apt install libegl1 libgl1-mesa-dri)"


def add_renderer(
    scene_graph: SceneGraph,
    *,
    context: Context | None = None,
    background: tuple[float, float, float] = _BACKGROUND,
    headlight: float = 0.0,
) -> None:
    """Adds our renderer to a scene graph, or to its context alone; once is enough.

    Args:
        context: the scene graph's own context; then the model stays as it is.
        background: red, green, blue, 0 to 1.
        headlight: intensity of a lamp on the camera, on top of the scene's light.

    Raises:
        InputError: pictures cannot be rendered here.
    """
    from pydrake.geometry import LightParameter, MakeRenderEngineVtk, RenderEngineVtkParams

    missing = render_available()
    if missing is not None:  # asking VTK itself would crash the process
        raise InputError(f"no rendered pictures: {missing}")
    if _has_renderer(scene_graph, context):
        return
    lights = [
        LightParameter(
            type="directional", frame="world", direction=list(direction), intensity=intensity
        )
        for direction, intensity in _LIGHTS
    ]
    if headlight > 0.0:
        lights.append(
            LightParameter(
                type="directional",
                frame="camera",
                direction=[0.0, 0.0, 1.0],
                intensity=headlight,
            )
        )
    parameters = RenderEngineVtkParams(default_clear_color=list(background), lights=lights)
    engine = MakeRenderEngineVtk(parameters)
    if context is None:
        scene_graph.AddRenderer(RENDERER, engine)
    else:
        scene_graph.AddRenderer(context, RENDERER, engine)


def render_view(
    query_object: QueryObject,
    X_WC: RigidTransform,
    *,
    size: tuple[int, int] = SIZE,
    field_of_view: float = FIELD_OF_VIEW,
    clipping: tuple[float, float] = (0.05, 200.0),
) -> Picture:
    """Renders what a camera in the world sees, (height, width, 3) of 0 to 255.

    Args:
        query_object: of a scene graph that `add_renderer` was called for.
        X_WC: the camera's pose, from `look_at` or `fit_view`.
        size: width and height, pixels.
        field_of_view: vertical, rad.
        clipping: least and largest depth that is drawn, m.
    """
    from pydrake.geometry import ColorRenderCamera

    world = query_object.inspector().world_frame_id()
    camera = ColorRenderCamera(_camera_core(size, field_of_view, clipping), False)
    image = query_object.RenderColorImage(camera, world, X_WC)
    pixels: Picture = np.array(image.data, dtype=np.uint8)  # a copy: the image dies here
    return pixels[:, :, :3]


def render_depth(
    query_object: QueryObject,
    X_WC: RigidTransform,
    *,
    size: tuple[int, int] = SIZE,
    field_of_view: float = FIELD_OF_VIEW,
    clipping: tuple[float, float] = (0.05, 200.0),
) -> Array:
    """Depth along the camera's z of what each pixel sees, (height, width) m; inf where nothing is.

    Arguments as of `render_view`.
    """
    from pydrake.geometry import DepthRange, DepthRenderCamera

    world = query_object.inspector().world_frame_id()
    core = _camera_core(size, field_of_view, clipping)
    image = query_object.RenderDepthImage(
        DepthRenderCamera(core, DepthRange(*clipping)), world, X_WC
    )
    depth: Array = np.array(image.data, dtype=np.float64)[:, :, 0]
    return depth


def _camera_core(
    size: tuple[int, int], field_of_view: float, clipping: tuple[float, float]
) -> RenderCameraCore:
    from pydrake.geometry import ClippingRange, RenderCameraCore
    from pydrake.math import RigidTransform
    from pydrake.systems.sensors import CameraInfo

    info = CameraInfo(*size, field_of_view)
    return RenderCameraCore(RENDERER, info, ClippingRange(*clipping), RigidTransform())


def look_at(eye: ArrayLike, target: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> RigidTransform:
    """Pose X_WC of a camera at `eye` (3,) m that looks at `target` (3,) m.

    Args:
        up: direction (3,) that is up in the picture; another one is chosen if the camera looks
            along it.
    """
    from pydrake.math import RigidTransform, RotationMatrix

    position = np.asarray(eye, dtype=np.float64)
    ahead = np.asarray(target, dtype=np.float64) - position
    if not np.linalg.norm(ahead) > 0.0:
        raise InputError(f"camera at {position} m looks at itself; target must be another point")
    return RigidTransform(RotationMatrix(_camera_axes(ahead, up)), position)


def fit_view(
    points: ArrayLike,
    direction: ArrayLike,
    *,
    up: ArrayLike = (0.0, 0.0, 1.0),
    size: tuple[int, int] = SIZE,
    field_of_view: float = FIELD_OF_VIEW,
    margin: float = 0.05,
) -> RigidTransform:
    """Pose X_WC of the nearest camera looking along `direction` that sees all points.

    The nearest eye touches the points with two opposite sides of the picture: with
    t = tan(field of view / 2), x - ex <= t (z - ez) and -(x - ex) <= t (z - ez) for every point,
    and the same for y.

    Args:
        points: (N, 3) m.
        direction: (3,), the way the camera looks.
        up: as in `look_at`.
        size: width and height, pixels.
        field_of_view: vertical, rad.
        margin: part of the picture that stays free at each side.
    """
    from pydrake.math import RigidTransform, RotationMatrix

    R_WC = _camera_axes(direction, up)
    p = np.atleast_2d(np.asarray(points, dtype=np.float64)) @ R_WC
    t_y = (1.0 - 2.0 * margin) * math.tan(0.5 * field_of_view)
    t = np.array([t_y * size[0] / size[1], t_y])
    low = np.max(p[:, :2] - t * p[:, 2:], axis=0)  # e - t ez must be at least this,
    high = np.min(p[:, :2] + t * p[:, 2:], axis=0)  # and e + t ez at most this
    depth = float(np.min(0.5 * (high - low) / t))
    # A point or a line has no extent to keep away from.
    depth = min(depth, float(p[:, 2].min()) - 0.1)
    centre = 0.5 * ((low + t * depth) + (high - t * depth))
    return RigidTransform(RotationMatrix(R_WC), R_WC @ np.append(centre, depth))


def corner_points(query_object: QueryObject, *, models: Iterable[str] | None = None) -> Array:
    """Corners of the boxes round all visible shapes, (8 N, 3) m in the world, for `fit_view`.

    Args:
        models: names of model instances; all by default.
    """
    from pydrake.geometry import Role

    wanted = None if models is None else set(models)
    inspector = query_object.inspector()
    corners = [np.empty((0, 3))]
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    for geometry in inspector.GetAllGeometryIds(Role.kPerception):
        model = inspector.GetName(inspector.GetFrameId(geometry)).split("::")[0]
        box = inspector.GetObbInGeometryFrame(geometry)
        if box is None or (wanted is not None and model not in wanted):
            continue
        X_WG = query_object.GetPoseInWorld(geometry)
        X_WB = X_WG.multiply(box.pose())
        corners.append(X_WB.multiply((signs * box.half_width()).T).T)
    return np.concatenate(corners)


def save_png(picture: Picture, file: Path) -> None:
    """Writes a picture (height, width, 3); the same picture gives the same bytes."""
    from matplotlib.image import imsave

    data = io.BytesIO()
    without_version: dict[str, Any] = {"Software": None}
    imsave(data, picture, format="png", metadata=without_version)
    write_whole(file, data.getvalue())


def _camera_axes(direction: ArrayLike, up: ArrayLike) -> Array:
    """R_WC of a camera that looks along `direction` with `up` upwards, columns x, y, z."""
    ahead = np.asarray(direction, dtype=np.float64)
    ahead = ahead / np.linalg.norm(ahead)
    for upward in (np.asarray(up, dtype=np.float64), *np.eye(3)[[1, 0]]):
        right = np.cross(ahead, upward)
        if np.linalg.norm(right) > 1e-6 * np.linalg.norm(upward):
            right = right / np.linalg.norm(right)
            return np.column_stack([right, np.cross(ahead, right), ahead])
    raise AssertionError("two of the axes are not along the direction")


def _has_renderer(scene_graph: SceneGraph, context: Context | None) -> bool:
    if context is None:
        return bool(scene_graph.HasRenderer(RENDERER))
    return bool(scene_graph.HasRenderer(context, RENDERER))
