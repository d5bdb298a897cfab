"""The machine in any pose, and what its camera stations see of it: one by one, or all at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.geometry import QueryObject
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from pips_drake.remote_manipulator.camera_stations import (
    FIELD_OF_VIEW,
    CameraStations,
    StationPoses,
)
from pips_drake.remote_manipulator.configuration import STATIONS, RemoteManipulatorConfig
from pips_drake.remote_manipulator.runs.picture_text import framed, write_text
from pips_drake.remote_manipulator.station.plant import (
    PlantSettings,
    RemoteManipulatorPlant,
    make_plant,
)
from pips_drake.remote_manipulator.systems.visual_scene_program import CLIPPING
from pips_drake.twin.rendering import add_renderer, render_view

Picture = NDArray[np.uint8]

#: Behind the scene: space, not so dark that the tiles are lost in it.
SKY = (0.05, 0.07, 0.13)
#: Intensity of the lamp beside each camera.
HEADLIGHT = 0.35
#: Where the stations are.
PLACES = {
    "A": "bay, forward port",
    "B": "bay, aft starboard",
    "C": "cabin roof",
    "D": "bay, aft port",
    "E": "bay, forward starboard",
    "F": "upper arm",
    "G": "lower arm",
    "H": "CAE, above the port",
    "I": "nose",
    "J": "payload, at the probe",
    "K": "payload, at the bar",
    "L": "CAE, beside the port",
    "M": "wing",
}


@dataclass(kw_only=True)
class TaskScene:
    """The machine in any pose, and the pictures that its stations have of it.

    Attributes:
        diagram: with a renderer.
        machine: its plant.
        stations: of the machine.
    """

    diagram: Diagram
    machine: RemoteManipulatorPlant
    stations: CameraStations
    context: Context = field(init=False)

    def __post_init__(self) -> None:
        self.context = self.diagram.CreateDefaultContext()
        plant, scene_graph = self.machine.plant, self.machine.scene_graph
        self._plant_context = plant.GetMyMutableContextFromRoot(self.context)
        self._scene_context = scene_graph.GetMyContextFromRoot(self.context)

    @classmethod
    def make(
        cls, config: RemoteManipulatorConfig, settings: PlantSettings | None = None
    ) -> TaskScene:
        """The machine's scene.

        Args:
            settings: as of the run whose positions are shown.

        Raises:
            InputError: pictures cannot be rendered here.
        """
        builder = DiagramBuilder()
        machine = make_plant(builder, config, settings)
        add_renderer(machine.scene_graph, background=SKY, headlight=HEADLIGHT)
        return cls(diagram=builder.Build(), machine=machine, stations=CameraStations(config))

    def pose(self, positions: ArrayLike) -> None:
        """Puts the machine at the plant's positions (n,)."""
        plant = self.machine.plant
        plant.SetPositions(self._plant_context, np.asarray(positions, dtype=np.float64))

    def station_poses(self, cameras: ArrayLike) -> StationPoses:
        """Where the cameras (13, 3) rad are now, in {R}."""
        machine, context = self.machine, self._plant_context
        orbiter = machine.orbiter.body_frame()
        vectors = []
        for body in (machine.payload_body, machine.cae):
            X_RB = machine.plant.CalcRelativeTransform(context, orbiter, body.body_frame())
            vectors.append([*X_RB.rotation().ToQuaternion().wxyz(), *X_RB.translation()])
        return self.stations.poses(
            cameras,
            arm_vector=machine.arm_vector_from_state(
                machine.plant.GetPositions(context, machine.arm)
            ),
            payload_pose=vectors[0],
            cae_pose=vectors[1],
        )

    def query(self) -> QueryObject:
        """Of the scene as it stands."""
        return self.machine.scene_graph.get_query_output_port().Eval(self._scene_context)

    def pictures(
        self, cameras: ArrayLike, views: Sequence[tuple[int, tuple[int, int]]]
    ) -> list[Picture]:
        """What stations see, (height, width, 3) of 0 to 255 each.

        Args:
            cameras: (13, 3) rad.
            views: of each picture, the station's index, and its width and height in pixels.
        """
        angles = np.asarray(cameras, dtype=np.float64)
        poses, query = self.station_poses(angles), self.query()
        X_WR = self.machine.plant.EvalBodyPoseInWorld(self._plant_context, self.machine.orbiter)
        made = []
        for station, size in views:
            X_RC = RigidTransform(RotationMatrix(poses.R_RC[station]), poses.p_RC[station])
            picture = render_view(
                query,
                X_WR.multiply(X_RC),
                size=size,
                field_of_view=float(angles[station, FIELD_OF_VIEW]),
                clipping=CLIPPING,
            )
            made.append(picture)
        return made


def station_label(station: int, camera: ArrayLike) -> str:
    """Letter, place and field of view of a station."""
    name = STATIONS[station]
    angle = math.degrees(float(np.asarray(camera)[FIELD_OF_VIEW]))
    return f"{name}  {PLACES[name]}  {angle:.0f}°"


def station_sheet(
    scene: TaskScene,
    positions: ArrayLike,
    *,
    cameras: ArrayLike | None = None,
    size: tuple[int, int] = (400, 225),
    columns: int = 4,
) -> Picture:
    """What all thirteen stations see of one pose, side by side, (height, width, 3).

    Args:
        positions: the plant's, (n,).
        cameras: (13, 3) rad; as configured by default.
        size: width and height of a view, pixels.
        columns: views beside each other.
    """
    angles = scene.stations.initial_state().cameras if cameras is None else np.asarray(cameras)
    scene.pose(positions)
    views = scene.pictures(angles, [(station, size) for station in range(len(STATIONS))])
    width, height = size
    rows = -(-len(views) // columns)
    sheet = np.full((rows * height, columns * width, 3), 255, dtype=np.uint8)
    for station, view in enumerate(views):
        text = station_label(station, angles[station])
        write_text(view, text, (6, 4), size=max(8, height // 18))
        top, left = station // columns * height, station % columns * width
        sheet[top : top + height, left : left + width] = framed(view)
    return sheet
