"""A camera on a body that pans, tilts and zooms."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from pydrake.common.value import AbstractValue, Value
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    FrameId,
    QueryObject,
    RenderCameraCore,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context, LeafSystem
from pydrake.systems.sensors import CameraInfo, ImageDepth32F, ImageRgba8U

from pips_drake.errors import InputError
from pips_drake.twin.camera import PinholeCamera, camera_rotation
from pips_drake.twin.rendering import RENDERER

#: What is nearer than this share of the camera's least distance is not drawn: that is its own lens.
_NEAREST = 0.8
#: Nothing is drawn farther away than this, m.
_FARTHEST = 100.0


class CameraStation(LeafSystem):
    """Renders what a camera on a body sees, from inputs alone; costs nothing while unasked.

    .. pydrake_system::

        name: CameraStation
        input_ports:
        - query_object
        - body_poses
        - pan_tilt
        - zoom
        output_ports:
        - color_image
        - depth_image
        - camera_pose

    Input ports:

    - `query_object`: abstract `QueryObject`, from a scene graph with our renderer
      (`rendering.add_renderer`); not needed for `camera_pose`.
    - `body_poses`: abstract list of `RigidTransform` X_WB, from the plant.
    - `pan_tilt`, (2,): pan about the mount's z and tilt towards it, rad; optional, zero when
      unconnected.
    - `zoom`, (1,): focal length over that of the configured field of view; optional, 1 when
      unconnected.

    Output ports, with feedthrough:

    - `color_image`: abstract `ImageRgba8U`.
    - `depth_image`: abstract `ImageDepth32F`, m along the view, infinite where nothing is.
    - `camera_pose`: abstract `RigidTransform` X_WC, x to the right, y down, z into the picture.

    State: none. Without a renderer in the scene graph the images raise `InputError`.

    X_WC = X_WB X_BM R_z(pan) R_y(-tilt) R_x(roll) R_MC: the mount {M} looks along its x
    (`camera.camera_rotation`). The picture is sharp everywhere; what counts as sharp is
    `camera.seen_distances`' matter.

    Args:
        body_index: the body that carries the camera.
        X_BM: pose of the mount in the body; the identity by default.
        roll: how the camera is turned in its mount, rad.
        camera: size of the picture and field of view.
    """

    def __init__(
        self,
        body_index: int,
        *,
        X_BM: RigidTransform | None = None,
        roll: float = 0.0,
        camera: PinholeCamera | None = None,
    ) -> None:
        super().__init__()
        self._body = int(body_index)
        self._X_BM = X_BM or RigidTransform()
        self._roll = roll
        self.camera = camera or PinholeCamera()
        self._query_port = self.DeclareAbstractInputPort(
            "query_object", AbstractValue.Make(QueryObject())
        )
        self._poses_port = self.DeclareAbstractInputPort(
            "body_poses", AbstractValue.Make([RigidTransform()])
        )
        self._pan_tilt_port = self.DeclareVectorInputPort("pan_tilt", 2)
        self._zoom_port = self.DeclareVectorInputPort("zoom", 1)
        size = (self.camera.width, self.camera.height)
        self.DeclareAbstractOutputPort(
            "color_image", lambda: AbstractValue.Make(ImageRgba8U(*size)), self._calc_color_image
        )
        self.DeclareAbstractOutputPort(
            "depth_image", lambda: AbstractValue.Make(ImageDepth32F(*size)), self._calc_depth_image
        )
        self.DeclareAbstractOutputPort(
            "camera_pose",
            lambda: AbstractValue.Make(RigidTransform()),
            self._calc_camera_pose,
            prerequisites_of_calc={
                self.input_port_ticket(port.get_index())
                for port in (self._poses_port, self._pan_tilt_port)
            },
        )

    def _pose(self, context: Context) -> RigidTransform:
        pan, tilt = 0.0, 0.0
        if self._pan_tilt_port.HasValue(context):
            pan, tilt = self._pan_tilt_port.Eval(context)
        X_WB = self._poses_port.Eval(context)[self._body]
        X_MC = RigidTransform(RotationMatrix(camera_rotation(pan, tilt, self._roll)))
        return X_WB.multiply(self._X_BM).multiply(X_MC)

    def _look(self, context: Context) -> tuple[QueryObject, RenderCameraCore, RigidTransform]:
        """Query object, camera and pose for an image."""
        camera = self.camera
        if self._zoom_port.HasValue(context):
            camera = camera.zoomed(float(self._zoom_port.Eval(context)[0]))
        query = self._query_port.Eval(context)
        core = RenderCameraCore(
            RENDERER,
            CameraInfo(camera.width, camera.height, camera.field_of_view),
            ClippingRange(_NEAREST * camera.near, _FARTHEST),
            RigidTransform(),
        )
        return query, core, self._pose(context)

    def _calc_color_image(self, context: Context, output: Value) -> None:
        query, core, X_WC = self._look(context)
        with _without_renderer():
            image = query.RenderColorImage(ColorRenderCamera(core, False), _world(query), X_WC)
        output.set_value(image)

    def _calc_depth_image(self, context: Context, output: Value) -> None:
        query, core, X_WC = self._look(context)
        span = DepthRange(core.clipping().near(), 0.9 * _FARTHEST)
        with _without_renderer():
            image = query.RenderDepthImage(DepthRenderCamera(core, span), _world(query), X_WC)
        output.set_value(image)

    def _calc_camera_pose(self, context: Context, output: Value) -> None:
        output.set_value(self._pose(context))


@contextlib.contextmanager
def _without_renderer() -> Iterator[None]:
    """Says what to do where the scene graph cannot render."""
    try:
        yield
    except RuntimeError as error:
        raise InputError(
            f"the camera cannot render; must have add_renderer called for its scene graph ({error})"
        ) from None


def _world(query: QueryObject) -> FrameId:
    return query.inspector().world_frame_id()
