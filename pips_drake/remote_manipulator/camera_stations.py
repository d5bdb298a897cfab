"""Where the thirteen camera stations are and look, and how the control word moves them.

RMS-71, Table III has nine stations A to I; F rides on arm 0 and G on arm 1. Section VII.5 adds two
on the payload (J, K), another one on the CAE (L) and one on the wing (M). Table III puts H in the
reference system; here it is fixed to the CAE, as the report means it, wherever the CAE is.

Each station keeps its own pan, tilt and field of view; those of the one that is chosen move at
constant rates while the control word says so, in steps of a frame (Figure 11). `initialize` puts
all of them back.

A station looks along x of its own frame {S}: R_FS = R_z(pan) R_y(tilt) in the frame {F} that it is
fixed to. As z is down there, a positive pan turns to the right and a positive tilt looks up. The
camera's frame {C} is Drake's: x to the right, y down, z into the picture.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import UnknownNameError
from pips_drake.remote_manipulator.configuration import (
    STATION_FRAMES,
    STATIONS,
    RemoteManipulatorConfig,
)
from pips_drake.remote_manipulator.control_word import ControlWord, decode
from pips_drake.remote_manipulator.kinematics import (
    forward_kinematics,
    heading_matrix,
    pitch_matrix,
)
from pips_drake.remote_manipulator.program_state import FRAME_PERIOD, pose_of

Array = NDArray[np.float64]

#: Pan, tilt and field of view of a station, in this order.
PAN, TILT, FIELD_OF_VIEW = range(3)
#: A camera tilts to straight up and straight down, no farther: assumed, RMS-71 gives no limit.
HIGHEST_TILT = 0.5 * math.pi
#: R_SC: columns are the camera's axes in {S}: right is y, down is z, ahead is x.
R_SC = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraState:
    """What the scene program remembers of its cameras.

    Attributes:
        station: the chosen one, an index of `STATIONS`.
        cameras: (13, 3), pan, tilt and vertical field of view of each station, rad.
    """

    station: int
    cameras: Array

    @property
    def camera(self) -> Array:
        """Pan, tilt and field of view of the chosen station, (3,) rad."""
        return self.cameras[self.station]

    def vector(self) -> Array:
        """The state as (40,): the station, then the rows of `cameras`."""
        return np.concatenate([[float(self.station)], self.cameras.ravel()])

    @classmethod
    def of_vector(cls, vector: ArrayLike) -> CameraState:
        """The state of a `vector`."""
        values = np.array(vector, dtype=np.float64)
        return cls(station=round(values[0]), cameras=values[1:].reshape(len(STATIONS), 3))


@dataclass(frozen=True, kw_only=True, eq=False)
class StationPoses:
    """Where all cameras are, in {R}.

    Attributes:
        R_RC: (..., 13, 3, 3); columns are the camera's right, down and ahead.
        p_RC: (..., 13, 3) m.
    """

    R_RC: Array
    p_RC: Array


def station_index(name: str) -> int:
    """The index of a station's letter in `STATIONS`.

    Raises:
        UnknownNameError: there is no such station.
    """
    if len(name) != 1 or name not in STATIONS:
        raise UnknownNameError("camera station", name, STATIONS)
    return STATIONS.index(name)


class CameraStations:
    """The stations of a machine.

    Args:
        config: the machine.
        frame_period: s between two control words.
    """

    def __init__(
        self, config: RemoteManipulatorConfig, *, frame_period: float = FRAME_PERIOD
    ) -> None:
        cameras = config.cameras
        self._arm = config.arm
        self._frames = [STATION_FRAMES.index(station.frame) for station in cameras.stations]
        self._positions = np.array([station.position_m for station in cameras.stations])
        angles = [
            (station.heading_deg, station.pitch_deg, station.field_of_view_deg)
            for station in cameras.stations
        ]
        self._initial = np.radians(np.array(angles, dtype=np.float64))
        self._turn = math.radians(cameras.pan_tilt_rate_deg_s) * frame_period
        self._zoom = math.radians(cameras.zoom_rate_deg_s) * frame_period
        self._narrowest = math.radians(cameras.narrowest_deg)
        self._widest = math.radians(cameras.widest_deg)

    def initial_state(self, station: str = STATIONS[0]) -> CameraState:
        """Every camera as the configuration has it.

        Raises:
            UnknownNameError: there is no such station.
        """
        return CameraState(station=station_index(station), cameras=self._initial.copy())

    def advance(self, state: CameraState, word: ControlWord) -> CameraState:
        """The state after a frame with a control word."""
        chosen = STATIONS.index(word.station)
        if word.initialize:
            return CameraState(station=chosen, cameras=self._initial.copy())
        if not (word.pan or word.tilt or word.zoom):
            return replace(state, station=chosen)
        cameras = state.cameras.copy()
        pan, tilt, angle = cameras[chosen]
        # Remainder to -pi .. pi: the camera may go round and round.
        pan = math.remainder(pan + word.pan * self._turn, 2.0 * math.pi)
        tilt = min(max(tilt + word.tilt * self._turn, -HIGHEST_TILT), HIGHEST_TILT)
        # Zooming in narrows the view.
        angle = min(max(angle - word.zoom * self._zoom, self._narrowest), self._widest)
        cameras[chosen] = pan, tilt, angle
        return CameraState(station=chosen, cameras=cameras)

    def follow(
        self, words: Iterable[int], first: CameraState | None = None
    ) -> tuple[NDArray[np.int64], Array]:
        """Stations (N,) and cameras (N, 13, 3) rad after each of N recorded control words.

        Raises:
            InputError: a word is illegal.
        """
        state = first or self.initial_state()
        stations, cameras = [], []
        decoded: dict[int, ControlWord] = {}
        for bits in words:
            number = int(bits)
            if number not in decoded:
                decoded[number] = decode(number)
            state = self.advance(state, decoded[number])
            stations.append(state.station)
            cameras.append(state.cameras)
        shape = (len(stations), len(STATIONS), 3)
        return np.array(stations, dtype=np.int64), np.array(cameras).reshape(shape)

    def poses(
        self,
        cameras: ArrayLike,
        *,
        arm_vector: ArrayLike,
        payload_pose: ArrayLike,
        cae_pose: ArrayLike,
    ) -> StationPoses:
        """Where all cameras are.

        Args:
            cameras: (..., 13, 3) rad, as in `CameraState`.
            arm_vector: (..., 8): the shoulder's height m, six angles rad, the prong's gap m.
            payload_pose, cae_pose: X_RP and X_RC, (7,): quaternion w x y z, position m.
        """
        angles = np.asarray(cameras, dtype=np.float64)
        vector = np.asarray(arm_vector, dtype=np.float64)
        arm = forward_kinematics(self._arm, vector[..., 1:7], vector[..., 0])
        R_RP, p_RP = pose_of(payload_pose)
        R_RE, p_RE = pose_of(cae_pose)
        eye, zero = np.eye(3), np.zeros(3)
        # In the order of STATION_FRAMES: R, 0, 1, P, C.
        rotations = (eye, arm.R_R0, arm.R_R1, R_RP, R_RE)
        origins = (zero, arm.shoulder, arm.elbow, p_RP, p_RE)
        leading = vector.shape[:-1]
        R_RF = np.stack([np.broadcast_to(R, (*leading, 3, 3)) for R in rotations], axis=-3)
        p_RF = np.stack([np.broadcast_to(p, (*leading, 3)) for p in origins], axis=-2)
        R_RF, p_RF = R_RF[..., self._frames, :, :], p_RF[..., self._frames, :]
        R_FS = heading_matrix(angles[..., PAN]) @ pitch_matrix(angles[..., TILT])
        return StationPoses(
            R_RC=R_RF @ R_FS @ R_SC,
            p_RC=p_RF + np.einsum("...ij,...j->...i", R_RF, self._positions),
        )
