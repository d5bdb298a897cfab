"""The visual scene program as a system: where the operator looks from, and the picture there."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue, Value
from pydrake.geometry import ClippingRange, ColorRenderCamera, QueryObject, RenderCameraCore
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem
from pydrake.systems.sensors import CameraInfo, ImageRgba8U

from pips_drake.errors import InputError
from pips_drake.remote_manipulator.camera_stations import CameraState, CameraStations
from pips_drake.remote_manipulator.configuration import STATIONS, RemoteManipulatorConfig
from pips_drake.remote_manipulator.control_word import decode
from pips_drake.remote_manipulator.drives import ARM_JOINTS
from pips_drake.remote_manipulator.program_state import FRAME_PERIOD
from pips_drake.twin.rendering import RENDERER
from pips_drake.twin.systems.inputs import input_object, input_values

Array = NDArray[np.float64]

#: Least and largest depth that is drawn, m: from before a lens to beyond the orbiter.
CLIPPING = (0.05, 200.0)
#: X_WR while nothing has been translated: z of {R} is down.
_INITIAL_X_WR = RigidTransform(RotationMatrix.MakeXRotation(math.pi), np.zeros(3))


class VisualSceneProgram(LeafSystem):
    """Chooses, pans, tilts and zooms the cameras as the control word says; renders when asked.

    .. pydrake_system::

        name: VisualSceneProgram
        input_ports:
        - control_word
        - arm_measured
        - payload_pose
        - cae_pose
        - body_poses
        - query_object
        output_ports:
        - station
        - camera
        - camera_pose
        - color_image

    Input ports:

    - `control_word`, (1,): the 24 bits of RMS-71's Table II, a whole number.
    - `arm_measured`, (8,): height of the shoulder m, six angles rad, gap of the prong m.
    - `payload_pose`, (7,): X_RP, quaternion w x y z and position m.
    - `cae_pose`, (7,): X_RC, the same.
    - `body_poses`: abstract list of `RigidTransform` X_WB, from the plant; optional, unless
      `orbiter_index` is given.
    - `query_object`: abstract `QueryObject`, from a scene graph with our renderer
      (`rendering.add_renderer`); needed for `color_image` alone.

    Output ports:

    - `station`, (1,): the chosen station, an index of `configuration.STATIONS` (from state).
    - `camera`, (3,): its pan, tilt and vertical field of view, rad (from state).
    - `camera_pose`: abstract `RigidTransform` X_WC, x to the right, y down, z into the picture.
    - `color_image`: abstract `ImageRgba8U`.

    The last two have feedthrough from where things are, not from `control_word`, and cost nothing
    while nobody asks.

    State: discrete (40,), `camera_stations.CameraState`: updated every 0.05 s from 0 s on. Latency:
    the control word of a frame moves the camera in the next one. Without a renderer in the scene
    graph the image raises `InputError`.

    Args:
        config: the machine.
        station: the one that is chosen at first.
        orbiter_index: of the body {R} in the plant; None: {R} stays where it is at first.
        size: width and height of the picture, pixels.
    """

    def __init__(
        self,
        config: RemoteManipulatorConfig,
        *,
        station: str = STATIONS[0],
        orbiter_index: int | None = None,
        size: tuple[int, int] = (960, 540),
    ) -> None:
        super().__init__()
        self._stations = CameraStations(config)
        self._orbiter = None if orbiter_index is None else int(orbiter_index)
        self._size = size
        self._word, self._arm, self._payload, self._cae = (
            int(self.DeclareVectorInputPort(name, length).get_index())
            for name, length in (
                ("control_word", 1),
                ("arm_measured", len(ARM_JOINTS)),
                ("payload_pose", 7),
                ("cae_pose", 7),
            )
        )
        self._bodies = int(
            self.DeclareAbstractInputPort(
                "body_poses", AbstractValue.Make([RigidTransform()])
            ).get_index()
        )
        self._query = int(
            self.DeclareAbstractInputPort(
                "query_object", AbstractValue.Make(QueryObject())
            ).get_index()
        )
        first = self._stations.initial_state(station)
        self._state = self.DeclareDiscreteState(first.vector())
        self.DeclarePeriodicDiscreteUpdateEvent(FRAME_PERIOD, 0.0, self._update_cameras)
        from_state = {self.discrete_state_ticket(self._state)}
        for name, length, calc in (
            ("station", 1, self._calc_station),
            ("camera", 3, self._calc_camera),
        ):
            self.DeclareVectorOutputPort(name, length, calc, prerequisites_of_calc=from_state)
        seen = from_state | {
            self.input_port_ticket(self.get_input_port(index).get_index())
            for index in (self._arm, self._payload, self._cae, self._bodies)
        }
        self.DeclareAbstractOutputPort(
            "camera_pose",
            lambda: AbstractValue.Make(RigidTransform()),
            self._calc_camera_pose,
            prerequisites_of_calc=seen,
        )
        query = self.input_port_ticket(self.get_input_port(self._query).get_index())
        self.DeclareAbstractOutputPort(
            "color_image",
            lambda: AbstractValue.Make(ImageRgba8U(*size)),
            self._calc_color_image,
            prerequisites_of_calc=seen | {query},
        )

    def _cameras(self, context: Context) -> CameraState:
        return CameraState.of_vector(context.get_discrete_state(self._state).value())

    def _update_cameras(self, context: Context, values: DiscreteValues) -> None:
        word = decode(int(input_values(self, context, self._word)[0]))
        state = self._stations.advance(self._cameras(context), word)
        values.set_value(self._state, state.vector())

    def _calc_station(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, float(self._cameras(context).station))

    def _calc_camera(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._cameras(context).camera)

    def _pose(self, context: Context, state: CameraState) -> RigidTransform:
        poses = self._stations.poses(
            state.cameras,
            arm_vector=input_values(self, context, self._arm),
            payload_pose=input_values(self, context, self._payload),
            cae_pose=input_values(self, context, self._cae),
        )
        X_WR = _INITIAL_X_WR
        if self._orbiter is not None:
            X_WR = input_object(self, context, self._bodies)[self._orbiter]
        R_RC = RotationMatrix(poses.R_RC[state.station])
        return X_WR.multiply(RigidTransform(R_RC, poses.p_RC[state.station]))

    def _calc_camera_pose(self, context: Context, output: Value) -> None:
        output.set_value(self._pose(context, self._cameras(context)))

    def _calc_color_image(self, context: Context, output: Value) -> None:
        state = self._cameras(context)
        query = input_object(self, context, self._query)
        core = RenderCameraCore(
            RENDERER,
            CameraInfo(*self._size, float(state.camera[2])),
            ClippingRange(*CLIPPING),
            RigidTransform(),
        )
        world = query.inspector().world_frame_id()
        X_WC = self._pose(context, state)
        try:
            image = query.RenderColorImage(ColorRenderCamera(core, False), world, X_WC)
        except RuntimeError as error:
            raise InputError(
                "the camera cannot render; must have add_renderer called for its scene graph "
                f"({error})"
            ) from None
        output.set_value(image)
