"""The serpentine station: arm, scene, follow-the-leader, actuators and monitor as one diagram."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import BodyIndex, ModelInstanceIndex, RigidBody
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort
from pydrake.systems.primitives import AffineSystem, ZeroOrderHold

from pips_drake.errors import InputError, UnknownNameError
from pips_drake.scene.decomposition import AddConvexParts
from pips_drake.scene.loading import (
    AddMissingNormals,
    AddPlacedFrame,
    AddScene,
    check_anchored,
)
from pips_drake.scene.packages import find_arm_file, find_path_file, find_scene_file
from pips_drake.serpentine.anchoring import anchor_path
from pips_drake.serpentine.arm import SerpentineArm, load_arm
from pips_drake.serpentine.drives import joint_stiffness
from pips_drake.serpentine.follow_the_leader import FollowTheLeader
from pips_drake.serpentine.motion_profile import RestToRestProfile
from pips_drake.serpentine.mounting import mounting_rotation
from pips_drake.serpentine.path_file import load_path
from pips_drake.serpentine.pointing import make_mount
from pips_drake.serpentine.scenario import ActuationConfig, CameraConfig, SerpentineScenario
from pips_drake.serpentine.sdf import make_sdf
from pips_drake.serpentine.statics import holding_efforts
from pips_drake.serpentine.systems.actuator_angle_map import ActuatorAngleMap
from pips_drake.serpentine.systems.actuator_force_map import ActuatorForceMap
from pips_drake.serpentine.systems.actuator_length_map import ActuatorLengthMap
from pips_drake.serpentine.systems.actuator_servo import ActuatorServo
from pips_drake.serpentine.systems.actuator_visualizer import AddActuatorVisualizer
from pips_drake.serpentine.systems.camera_pointer import CameraPointer
from pips_drake.serpentine.systems.deflection_compensator import DeflectionCompensator
from pips_drake.serpentine.systems.follow_the_leader_controller import FollowTheLeaderController
from pips_drake.serpentine.systems.tip_path_source import TipPathSource
from pips_drake.serpentine.tip_path import TipPath
from pips_drake.twin.camera import PinholeCamera
from pips_drake.twin.systems.camera_station import CameraStation
from pips_drake.twin.systems.clearance_monitor import ClearanceMonitor
from pips_drake.units import INCH

Array = NDArray[np.float64]

#: Name of the frame in which scenes and paths are given: the arm's frame {0}, fixed in the world.
BASE_FRAME = "frame_0"
#: How often a run's drawn actuators move, s.
VISUAL_PERIOD = 1.0 / 32.0

#: Output ports that a station has for its camera.
CAMERA_PORTS = (
    "camera_pointer.joint_state",
    "camera_pointer.pan_tilt",
    "camera_station.camera_pose",
    "camera_station.color_image",
    "camera_station.depth_image",
)


@dataclass(frozen=True, kw_only=True)
class SerpentineSetup:
    """What a scenario names, loaded: the arm, its path, the solver and the scene's file.

    Attributes:
        path: in the arm's frame {0}.
        rail_shift: how far along z0 the arm's frame {0} stands from the scene's `frame_0`, m; not
            0 for an arm whose rail is placed for the path (`anchoring`).
    """

    arm: SerpentineArm
    path: TipPath
    solver: FollowTheLeader
    scene_file: Path | None
    rail_shift: float = 0.0


def load_setup(
    scenario: SerpentineScenario, *, folder: Path | None = None, scene_file: Path | None = None
) -> SerpentineSetup:
    """Loads the arm, path and scene of a scenario; relative files are looked for in `folder`.

    Args:
        scene_file: stands for the scenario's scene, wherever it lies.

    Raises:
        InputError: a name is unknown, or a file cannot be used.
    """
    arm = load_arm(find_arm_file(scenario.arm, inside=folder))
    drawn_path = load_path(
        find_path_file(scenario.path, inside=folder),
        smooth=scenario.corner_deviation_in > 0.0,
        corner_deviation=scenario.corner_deviation_in * INCH,
    )
    path, rail_shift = anchor_path(arm, drawn_path)
    solver = FollowTheLeader(
        arm,
        tolerance=scenario.solver.tolerance_in * INCH,
        max_iterations=scenario.solver.max_iterations,
    )
    if scene_file is None and scenario.scene:
        scene_file = find_scene_file(scenario.scene, inside=folder)
    return SerpentineSetup(
        arm=arm, path=path, rail_shift=rail_shift, solver=solver, scene_file=scene_file
    )


def mounting_pose(scenario: SerpentineScenario) -> RigidTransform:
    """Pose in the world of `frame_0`, in which scenes and paths are given."""
    rotation = RotationMatrix(mounting_rotation(scenario.mounting))
    return RigidTransform(rotation, scenario.mounting_position_m)


def arm_pose(scenario: SerpentineScenario, setup: SerpentineSetup) -> RigidTransform:
    """Pose X_W0 of the arm's frame {0} in the world."""
    return mounting_pose(scenario) @ RigidTransform([0.0, 0.0, setup.rail_shift])


def AddSerpentineArm(
    plant: MultibodyPlant, arm: SerpentineArm, X_WF: RigidTransform, rail_shift: float = 0.0
) -> ModelInstanceIndex:
    """Adds the arm, generated from its data, with its rail welded to the world.

    The plant gets the frame `frame_0` at `X_WF`, for scenes to be welded to; the arm's own frame
    {0} stands `rail_shift` (m) from it along z.
    """
    parser = Parser(plant)
    parser.SetStrictParsing()
    (model,) = parser.AddModelsFromString(make_sdf(arm), "sdf")
    AddPlacedFrame(plant, BASE_FRAME, X_WF)
    plant.WeldFrames(
        plant.GetFrameByName(BASE_FRAME),
        plant.GetFrameByName(arm.rail.name, model),
        RigidTransform([0.0, 0.0, rail_shift]),
    )
    return model


def plant_time_step(scenario: SerpentineScenario) -> float:
    """The plant's step, s; 0 for a continuous plant."""
    if scenario.integration.scheme == "discrete":
        return 1.0 / scenario.clocks.plant_hz
    return 0.0


def MakeSimulator(diagram: Diagram, scenario: SerpentineScenario) -> Simulator:
    """A simulator, not yet initialized, of a diagram that holds the scenario's station.

    A station of another `integration.scheme` than `discrete` needs it: the integrator and its
    accuracy are the simulator's, not the diagram's. Its steps end at the servos' updates anyway.
    """
    simulator = Simulator(diagram)
    if scenario.integration.scheme != "discrete":
        config = SimulatorConfig(
            integration_scheme=scenario.integration.scheme,
            max_step_size=1.0 / scenario.clocks.control_hz,
            accuracy=scenario.integration.accuracy,
            use_error_control=True,
        )
        ApplySimulatorConfig(config, simulator)
    return simulator


def make_plant(
    builder: DiagramBuilder,
    setup: SerpentineSetup,
    scenario: SerpentineScenario,
    *,
    visual_period: float | None = None,
) -> tuple[MultibodyPlant, SceneGraph, ModelInstanceIndex]:
    """Adds a finalized plant with arm and scene; the arm's default posture is home on its path.

    Args:
        visual_period: how often the drawn actuators move, s; None for a plant that is only posed.
    """
    plant, scene_graph = AddMultibodyPlant(
        MultibodyPlantConfig(
            time_step=plant_time_step(scenario),
            # Lagged is the fast one, and honours implicit PD gains (TAMSI ignores them silently).
            discrete_contact_approximation="lagged",
        ),
        builder,
    )
    model = AddSerpentineArm(plant, setup.arm, mounting_pose(scenario), setup.rail_shift)
    scene = []
    if setup.scene_file is not None:
        scene = AddScene(plant, setup.scene_file, base_frame=BASE_FRAME)
        AddMissingNormals(plant, scene_graph, scene)
    if scenario.decompose_meshes:
        AddConvexParts(plant, scene_graph, scene)
    plant.Finalize()
    if setup.scene_file is not None:
        check_anchored(plant, scene, setup.scene_file)
    home = setup.solver.solve(setup.path, [setup.path.home_arc_length])
    if not home.solved[0]:
        raise InputError(setup.solver.explain(setup.path, home, 0))
    plant.SetDefaultPositions(model, home.joints[0])
    AddActuatorVisualizer(
        builder,
        plant=plant,
        model=model,
        scene_graph=scene_graph,
        arm=setup.arm,
        period=visual_period,
    )
    return plant, scene_graph, model


def _standing_posture(arm: SerpentineArm, command: Array, gravity: Array) -> Array:
    """Where the arm stands still when its joints are commanded to `command`, (J,)."""
    stiffness, posture = joint_stiffness(arm), command
    # Each step changes the sag by the sag's own share of the levers: a thousandth.
    for _ in range(4):
        posture = command - holding_efforts(arm, posture, gravity)[0] / stiffness
    return posture


def gravity_in_frame_0(plant: MultibodyPlant) -> Array:
    """The plant's gravity as the arm's base frame sees it, (3,) m/s^2."""
    X_W0 = plant.GetFrameByName(BASE_FRAME).GetFixedPoseInBodyFrame()
    gravity: Array = X_W0.rotation().inverse() @ plant.gravity_field().gravity_vector()
    return gravity


@dataclass(frozen=True, kw_only=True)
class ActuationPorts:
    """Ports of an arm's drives: what goes in, and what comes back."""

    setpoint: OutputPort
    drive_effort: OutputPort


def AddActuation(
    builder: DiagramBuilder,
    *,
    plant: MultibodyPlant,
    model: ModelInstanceIndex,
    setup: SerpentineSetup,
    drive_state: OutputPort,
    joint_state: OutputPort,
    config: ActuationConfig,
    period: float,
) -> ActuationPorts:
    """Connects commanded drives to the plant, with the fidelity that `config` names.

    `joint`: servo, then the inverse linkage, then the plant's implicit PD, whose gains are in the
    arm's model. Between two updates of the servo the joints' set-points move on straight lines:
    held still, a stiff drive would answer each update with a kick (of kilonewtons on the rail).
    Latency: one control period in the servo, and two plant steps; a continuous plant has none.
    """
    arm = setup.arm
    servo = builder.AddNamedSystem("actuator_servo", ActuatorServo(arm, period=period))
    angle_map = builder.AddNamedSystem("actuator_angle_map", ActuatorAngleMap(arm, period=period))
    force_map = builder.AddNamedSystem("actuator_force_map", ActuatorForceMap(arm))
    builder.Connect(drive_state, servo.GetInputPort("drive_state"))
    gravity = gravity_in_frame_0(plant)
    start = plant.GetDefaultPositions(model)
    if config.compensate_deflection:
        start = start + holding_efforts(arm, start, gravity)[0] / joint_stiffness(arm)
        compensator = builder.AddNamedSystem(
            "deflection_compensator", DeflectionCompensator(arm, gravity=gravity)
        )
        builder.Connect(joint_state, compensator.GetInputPort("joint_state"))
        builder.Connect(
            compensator.GetOutputPort("drive_offset"), servo.GetInputPort("drive_offset")
        )
    builder.Connect(servo.GetOutputPort("setpoint"), angle_map.GetInputPort("drive_state"))
    # The run begins at rest: where these first set-points and gravity leave the arm.
    plant.SetDefaultPositions(model, _standing_posture(arm, start, gravity))
    interpolator = builder.AddNamedSystem(
        "setpoint_interpolator", _make_interpolator(start, plant.time_step())
    )
    angles = angle_map.GetOutputPort("joint_state")
    if plant.time_step() > 0.0:
        # Drake forgets every cached output at every step of any discrete system. This hold keeps
        # the inverse linkage from being computed anew at each step of the plant.
        hold = builder.AddNamedSystem(
            "setpoint_hold", ZeroOrderHold(period, 2 * arm.joints, offset_sec=plant.time_step())
        )
        builder.Connect(angles, hold.get_input_port())
        angles = hold.get_output_port()
    builder.Connect(angles, interpolator.get_input_port())
    builder.Connect(interpolator.get_output_port(), plant.get_desired_state_input_port(model))
    builder.Connect(plant.get_state_output_port(model), force_map.GetInputPort("joint_state"))
    builder.Connect(
        plant.get_net_actuation_output_port(model), force_map.GetInputPort("joint_effort")
    )
    return ActuationPorts(
        setpoint=servo.GetOutputPort("setpoint"),
        drive_effort=force_map.GetOutputPort("drive_effort"),
    )


def _make_interpolator(start: Array, time_step: float) -> AffineSystem:
    """Joint set-points that move at the input's rates; output (x, v).

    x+ = x + time_step v, or x' = v if `time_step` is 0: limit of the former for small steps.
    """
    n = start.size
    one, zero = np.eye(n), np.zeros((n, n))
    interpolator = AffineSystem(
        A=one if time_step > 0.0 else zero,
        B=np.hstack([zero, (time_step if time_step > 0.0 else 1.0) * one]),
        f0=np.zeros(n),
        C=np.vstack([one, zero]),
        D=np.block([[zero, zero], [zero, one]]),
        y0=np.zeros(2 * n),
        time_period=time_step,
    )
    interpolator.configure_default_state(start)
    return interpolator


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


def MakeSerpentineStation(
    scenario: SerpentineScenario, *, setup: SerpentineSetup | None = None
) -> Diagram:
    """The station of a scenario: a finished diagram, not yet simulated.

    Systems, by name: `plant`, `scene_graph`, `tip_path_source`, `follow_the_leader`,
    `actuator_length_map`, `actuator_servo`, `actuator_angle_map`, `actuator_force_map`,
    `setpoint_hold` (if the plant is discrete), `setpoint_interpolator`, `deflection_compensator`
    (if compensated), `clearance_monitor`, `actuator_visualizer`; and with a camera `camera_pointer`
    and `camera_station`.

    Input port: `tip_path_source.command` (1,), optional.

    Output ports, as `<system>.<port>` (each is described at its system): `tip_path_source.tip`,
    `tip_path_source.phase`, `follow_the_leader.joint_state`, `follow_the_leader.solution`,
    `actuator_length_map.drive_state`, `actuator_servo.setpoint`, `actuator_servo.saturation`,
    `actuator_force_map.drive_effort`, `clearance_monitor.clearance`, `clearance_monitor.witness`;
    and of the plant and scene graph `plant.state` (2 J,) of the arm, `plant.net_actuation` (J,),
    `scene_graph.query`. With a camera also `camera_pointer.joint_state` (2 J,), which the drives
    then follow, `camera_pointer.pan_tilt` (2,), `camera_station.camera_pose`,
    `camera_station.color_image` and `camera_station.depth_image`; for the images the scene graph
    needs a renderer (`AddCameraStation`).

    Latencies: a source's update is seen by the controller at once, by the servo at its next update
    (one control period, 1/64 s by default), and reached one period after that, plus two plant
    steps; the monitor sees the plant's last step. From command to plant at most 3 / control_hz +
    2 / plant_hz. The plant's state at an instant, before that instant's updates (what `AdvanceTo`
    leaves and logs hold), is one step later still: 3 steps behind the continuous plant's, which is
    late by none (`integration.scheme`; simulate it with `MakeSimulator`, which knows integrator and
    accuracy).

    Args:
        setup: what the scenario names, if it is loaded already.

    Raises:
        InputError: something the scenario names cannot be used.
    """
    setup = setup or load_setup(scenario)
    arm, path = setup.arm, setup.path
    period = 1.0 / scenario.clocks.control_hz
    motion = scenario.motion
    builder = DiagramBuilder()
    plant, scene_graph, model = make_plant(builder, setup, scenario, visual_period=VISUAL_PERIOD)
    source = builder.AddNamedSystem(
        "tip_path_source",
        TipPathSource(
            path,
            RestToRestProfile.make(
                travel=path.travel, speed=motion.tip_speed_mm_per_s * 1e-3, ramp=motion.ramp_s
            ),
            dwell=motion.dwell_s,
            retract=motion.retract,
            period=period,
        ),
    )
    leader = builder.AddNamedSystem(
        "follow_the_leader", FollowTheLeaderController(setup.solver, period=period)
    )
    length_map = builder.AddNamedSystem("actuator_length_map", ActuatorLengthMap(arm))
    builder.Connect(source.GetOutputPort("tip"), leader.GetInputPort("tip"))
    builder.Connect(source.GetOutputPort("path"), leader.GetInputPort("path"))
    joint_state = leader.GetOutputPort("joint_state")
    if scenario.camera.enabled:
        pointer = AddCameraPointer(
            builder, plant=plant, setup=setup, scenario=scenario, joint_state=joint_state
        )
        joint_state = pointer.GetOutputPort("joint_state")
        camera = AddCameraStation(
            builder,
            plant=plant,
            scene_graph=scene_graph,
            model=model,
            arm=arm,
            config=scenario.camera,
        )
        builder.Connect(pointer.GetOutputPort("pan_tilt"), camera.GetInputPort("pan_tilt"))
    builder.Connect(joint_state, length_map.GetInputPort("joint_state"))
    AddActuation(
        builder,
        plant=plant,
        model=model,
        setup=setup,
        drive_state=length_map.GetOutputPort("drive_state"),
        joint_state=joint_state,
        config=scenario.actuation,
        period=period,
    )
    monitor = builder.AddNamedSystem(
        "clearance_monitor",
        ClearanceMonitor(
            plant,
            robot=[model],
            max_distance=scenario.clearance_range_m,
            period=1.0 / scenario.clocks.clearance_hz,
        ),
    )
    builder.Connect(scene_graph.get_query_output_port(), monitor.GetInputPort("query_object"))
    builder.Connect(plant.get_body_poses_output_port(), monitor.GetInputPort("body_poses"))
    builder.Connect(
        plant.get_body_spatial_velocities_output_port(),
        monitor.GetInputPort("body_spatial_velocities"),
    )
    builder.ExportInput(source.GetInputPort("command"), "tip_path_source.command")
    for name in (
        *(CAMERA_PORTS if scenario.camera.enabled else ()),
        "tip_path_source.tip",
        "tip_path_source.phase",
        "follow_the_leader.joint_state",
        "follow_the_leader.solution",
        "actuator_length_map.drive_state",
        "actuator_servo.setpoint",
        "actuator_servo.saturation",
        "actuator_force_map.drive_effort",
        "clearance_monitor.clearance",
        "clearance_monitor.witness",
    ):
        system, port = name.split(".")
        builder.ExportOutput(builder.GetSubsystemByName(system).GetOutputPort(port), name)
    builder.ExportOutput(plant.get_state_output_port(model), "plant.state")
    builder.ExportOutput(plant.get_net_actuation_output_port(model), "plant.net_actuation")
    builder.ExportOutput(scene_graph.get_query_output_port(), "scene_graph.query")
    diagram = builder.Build()
    diagram.set_name("serpentine_station")
    return diagram
