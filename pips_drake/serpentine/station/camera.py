"""The arm's camera in the station: what points it, and what sees with it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, ModelInstanceIndex, RigidBody
from pydrake.systems.framework import DiagramBuilder, OutputPort

from pips_drake.errors import UnknownNameError
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.pointing import make_mount
from pips_drake.serpentine.scenario import CameraConfig, SerpentineScenario
from pips_drake.serpentine.station.plant import BASE_FRAME
from pips_drake.serpentine.station.setup import SerpentineSetup, arm_pose
from pips_drake.serpentine.systems.camera_pointer import CameraPointer
from pips_drake.twin.camera import PinholeCamera
from pips_drake.twin.systems.camera_station import CameraStation

Array = NDArray[np.float64]

#: Output ports that a station has for its camera.
CAMERA_PORTS = (
    "camera_pointer.joint_state",
    "camera_pointer.pan_tilt",
    "camera_station.camera_pose",
    "camera_station.color_image",
    "camera_station.depth_image",
)


def camera_target(
    plant: MultibodyPlant, scenario: SerpentineScenario
) -> tuple[RigidBody | None, Array]:
    """The body that the camera looks at, if it is one, and the target in the world, (3,) m.

    Raises:
        UnknownNameError: no such body; lists those of the scene.
    """
    X_WF = plant.GetFrameByName(BASE_FRAME).GetFixedPoseInBodyFrame()
    name, point = scenario.camera.target_body, X_WF @ np.array(scenario.camera.target_m)
    if not name:
        return None, point
    bodies = [plant.get_body(BodyIndex(i)) for i in range(1, plant.num_bodies())]
    fixed = {str(body.scoped_name()): body for body in bodies if plant.IsAnchored(body)}
    if name not in fixed:
        raise UnknownNameError("camera.target_body", name, sorted(fixed))
    # Anchored: where it stands depends on no joint.
    target = plant.CalcPointsPositions(
        plant.CreateDefaultContext(), fixed[name].body_frame(), [0.0, 0.0, 0.0], plant.world_frame()
    )
    return fixed[name], target[:, 0]


def make_camera(config: CameraConfig) -> PinholeCamera:
    """The camera of a scenario, in SI units."""
    return PinholeCamera(
        width=config.width,
        height=config.height,
        field_of_view=math.radians(config.field_of_view_deg),
        near=config.range_near_m,
        far=config.range_far_m,
        focus=config.focus_distance_m,
        aperture=config.aperture_m,
        blur=config.blur_max_px,
        incidence=math.radians(config.incidence_max_deg),
    )


def AddCameraPointer(
    builder: DiagramBuilder,
    *,
    plant: MultibodyPlant,
    setup: SerpentineSetup,
    scenario: SerpentineScenario,
    joint_state: OutputPort,
) -> CameraPointer:
    """Adds `camera_pointer` behind follow-the-leader's joints."""
    config = scenario.camera
    mount = make_mount(
        setup.arm,
        pan_limit=math.radians(config.pan_limit_deg),
        tilt_limit=math.radians(config.tilt_limit_deg),
        pan_tilt_speed=math.radians(config.pan_tilt_speed_deg_per_s),
        joint_margin=math.radians(config.joint_margin_deg),
        speed_share=config.joint_speed_share,
    )
    _, target = camera_target(plant, scenario)
    pointer = builder.AddNamedSystem(
        "camera_pointer",
        CameraPointer(
            setup.arm,
            mount=mount,
            target=target,
            X_W0=arm_pose(scenario, setup),
            period=1.0 / scenario.clocks.control_hz,
        ),
    )
    builder.Connect(joint_state, pointer.GetInputPort("joint_state"))
    return pointer


def AddCameraStation(
    builder: DiagramBuilder,
    *,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    model: ModelInstanceIndex,
    arm: SerpentineArm,
    config: CameraConfig,
) -> CameraStation:
    """Adds `camera_station` on the arm's last body; its input `pan_tilt` is left to the caller.

    The scene graph gets no renderer: it would be told of every shape's pose at each step of the
    plant, which makes a run five times as slow (measured). For pictures, pose a plant that is not
    simulated, or call `rendering.add_renderer` with the scene graph's context.
    """
    station = builder.AddNamedSystem(
        "camera_station",
        CameraStation(
            int(plant.GetBodyByName(arm.bodies[-1].name, model).index()),
            X_BM=RigidTransform([make_mount(arm, joint_margin=0.0).reach, 0.0, 0.0]),
            roll=math.radians(config.roll_deg),
            camera=make_camera(config),
        ),
    )
    builder.Connect(scene_graph.get_query_output_port(), station.GetInputPort("query_object"))
    builder.Connect(plant.get_body_poses_output_port(), station.GetInputPort("body_poses"))
    return station
