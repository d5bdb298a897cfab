"""The cable robot's station: a motion in, the modelled hardware at work."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, System
from pydrake.systems.primitives import VectorLogSink

from pips_drake.cable_robot.kinematics import Poses
from pips_drake.cable_robot.platform_motion import PlatformMotion
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.statics import distribute_tensions
from pips_drake.cable_robot.station.plant import (
    BoxObstacle,
    CableRobotPlant,
    add_plant,
    check_time_step,
)
from pips_drake.cable_robot.systems.cable_break import CableBreak
from pips_drake.cable_robot.systems.cable_forces import CableForces
from pips_drake.cable_robot.systems.cable_visualizer import CableVisualizer
from pips_drake.cable_robot.systems.length_controller import (
    LengthController,
    unstretched_lengths,
)
from pips_drake.cable_robot.systems.platform_disturbance import PlatformDisturbance
from pips_drake.cable_robot.systems.pose_command import PoseCommand
from pips_drake.cable_robot.systems.pose_estimator import PoseEstimator
from pips_drake.cable_robot.systems.tension_controller import TensionController
from pips_drake.cable_robot.systems.winches import CONTROLS, Winches
from pips_drake.config import require
from pips_drake.errors import InputError
from pips_drake.twin.clearance import ClearanceQuery
from pips_drake.twin.systems.clearance_monitor import ClearanceMonitor

Array = NDArray[np.float64]

FEEDBACKS = ("true", "estimated")


@dataclass(kw_only=True)
class DisturbanceSettings:
    """A constant wrench on the platform, (6,) N and N m in W, from `start` to `end`, s."""

    wrench: ArrayLike
    start: float
    end: float = math.inf


@dataclass(kw_only=True)
class StationSettings:
    """What of the station is not in the robot.

    Attributes:
        time_step: of plant and winches, s.
        control: `length` or `tension`.
        control_period: of controller and estimator, s; a multiple of `time_step`.
        method: how tensions are chosen under control by length.
        bandwidth, damping_ratio: of the platform under control by tension, rad/s and 1.
        feedback: what control by tension goes by: `true` or `estimated`.
        speed, force_limit, overload: of the winches, m/s, N, `hold` or `slip`.
        encoder_step, force_step: m and N; 0: none.
        calibration_error: of what is reeled out, (M,) m or one for all.
        damping_time: of the cables' material, s. Assumed: some percent of critical at 100 rad/s.
        cable_weight: N/m; 0 neglects the sag.
        drag: on the platform, N s/m and N m s. Assumed: bending cables and pulleys still a swing
            within some seconds.
        breaks: cables, from 0, and when they break, s.
        reaction: until the winches lock after a break, s; inf: never.
        disturbance: None: none.
        clearance_range: distances beyond are not looked for, m.
        clearance_period: s.
        log_period: s; 0: nothing is logged.
        floor: where the posts stand, z, m.
        cable_picture_period: how often the cables' pictures move, s; 0: they are not drawn.
    """

    time_step: float = 1.0 / 400.0
    control: str = "length"
    control_period: float = 0.04
    method: str = "analytic_center"
    bandwidth: float = 3.0
    damping_ratio: float = 0.7
    feedback: str = "true"
    speed: float = 0.5
    force_limit: float = math.inf
    overload: str = "hold"
    encoder_step: float = 0.0
    force_step: float = 0.0
    calibration_error: ArrayLike = 0.0
    damping_time: float = 1e-3
    cable_weight: float = 0.0
    drag: tuple[float, float] = (10.0, 2.0)
    breaks: Sequence[tuple[int, float]] = ()
    reaction: float = 0.1
    disturbance: DisturbanceSettings | None = None
    clearance_range: float = 5.0
    clearance_period: float = 0.04
    log_period: float = 0.0
    floor: float = -3.0
    cable_picture_period: float = 0.0


@dataclass(frozen=True, kw_only=True)
class CableRobotSystems:
    """The station's systems.

    Attributes:
        machine: the plant, and what one needs to find in it.
        command, controller, winches, cable_forces, estimator: as their modules describe them.
        clearance_monitor: None: the platform has no box.
        cable_break, disturbance: None: nothing of the kind happens.
        logs: sinks by the port they log, `<system>.<port>`.
        fastest: the highest frequency at the way points, rad/s.
    """

    machine: CableRobotPlant
    command: PoseCommand
    controller: System
    winches: Winches
    cable_forces: CableForces
    estimator: PoseEstimator
    clearance_monitor: ClearanceMonitor | None
    cable_break: CableBreak | None
    disturbance: PlatformDisturbance | None
    logs: dict[str, VectorLogSink] = field(default_factory=dict)
    fastest: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Station:
    """A station: its finished diagram, not yet simulated, and its systems."""

    diagram: Diagram
    systems: CableRobotSystems


def AddCableRobot(
    builder: DiagramBuilder,
    robot: CableRobot,
    motion: PlatformMotion,
    settings: StationSettings | None = None,
    *,
    obstacles: Sequence[BoxObstacle] = (),
) -> CableRobotSystems:
    """Adds the plant and all that moves its platform, wired.

    Systems, by name: `plant`, `scene_graph`, `pose_command`, `controller`, `winches`,
    `cable_forces`, `pose_estimator`; with a box `clearance_monitor`; with faults `cable_break` and
    `disturbance`; with pictures of the cables `cable_visualizer`.

    Latencies: the command of a control period is made of the pose that is wanted a period later,
    and reached then and one step. By tension, what is measured in a period is acted on in the next.

    The platform begins at rest at the motion's first pose, in equilibrium if it has one and the
    lengths no errors.

    Raises:
        InputError: a setting is not allowed, or the step is too long for the cables' stiffness at
            a way point.
    """
    settings = settings or StationSettings()
    for name, value, known in (
        ("control", settings.control, CONTROLS),
        ("feedback", settings.feedback, FEEDBACKS),
    ):
        require(value in known, f"station: {name}", value, " or ".join(known))
    step, period = settings.time_step, settings.control_period
    fastest = check_time_step(robot, motion.poses, step, settings.damping_time)
    machine = add_plant(builder, robot, time_step=step, obstacles=obstacles, floor=settings.floor)
    plant, scene_graph = machine.plant, machine.scene_graph
    first = Poses(motion.poses.position[:1], motion.poses.rotation[:1])
    X_WP = np.eye(4)
    X_WP[:3, :3], X_WP[:3, 3] = first.rotation[0], first.position[0]
    plant.SetDefaultFloatingBaseBodyPose(machine.platform, RigidTransform(X_WP))
    state_port = plant.get_state_output_port(machine.model)

    command = builder.AddNamedSystem("pose_command", PoseCommand(motion))
    forces = builder.AddNamedSystem(
        "cable_forces",
        CableForces(
            robot,
            int(machine.platform.index()),
            damping_time=settings.damping_time,
            weight=settings.cable_weight,
            drag=settings.drag,
        ),
    )
    by_length = settings.control == "length"
    method = settings.method if by_length else "analytic_center"
    tensions = np.maximum(distribute_tensions(robot, first, method).tensions, 0.0)
    winches = builder.AddNamedSystem(
        "winches",
        Winches(
            robot,
            first_lengths=unstretched_lengths(robot, first, tensions)[0],
            control=settings.control,
            speed=settings.speed,
            force_limit=settings.force_limit,
            overload=settings.overload,
            encoder_step=settings.encoder_step,
            force_step=settings.force_step,
            calibration_error=settings.calibration_error,
            period=step,
            control_period=period,
        ),
    )
    estimator = builder.AddNamedSystem("pose_estimator", PoseEstimator(robot, first, period=period))
    controller: System = (
        LengthController(robot, method=method, period=period)
        if by_length
        else TensionController(
            robot,
            bandwidth=settings.bandwidth,
            damping=settings.damping_ratio,
            period=period,
        )
    )
    builder.AddNamedSystem("controller", controller)
    _connect(builder, command, controller, "desired_pose", "desired_twist")
    if not by_length:
        estimated = settings.feedback == "estimated"
        fed_back = estimator.GetOutputPort("estimated_state") if estimated else state_port
        builder.Connect(fed_back, controller.GetInputPort("platform_state"))
        _connect(builder, controller, winches, "command_rate")
    _connect(builder, controller, winches, "command")
    _connect(builder, forces, winches, "tensions")
    _connect(builder, winches, forces, "unstretched", "rate")
    _connect(builder, winches, estimator, "encoder", "force_reading")
    builder.Connect(state_port, forces.GetInputPort("platform_state"))
    builder.Connect(
        forces.GetOutputPort("spatial_force"), plant.get_applied_spatial_force_input_port()
    )
    faults = _add_faults(builder, robot, settings, forces, winches)
    if settings.cable_picture_period > 0.0:
        drawn = builder.AddNamedSystem(
            "cable_visualizer",
            CableVisualizer(robot, scene_graph=scene_graph, period=settings.cable_picture_period),
        )
        builder.Connect(state_port, drawn.GetInputPort("platform_state"))
        if faults[0] is not None:
            _connect(builder, faults[0], drawn, "broken")
        builder.Connect(
            drawn.GetOutputPort("geometry_pose"), scene_graph.get_source_pose_port(drawn.source_id)
        )
    monitor = None
    if plant.GetCollisionGeometriesForBody(machine.platform):
        monitor = builder.AddNamedSystem(
            "clearance_monitor",
            ClearanceMonitor(
                plant,
                robot=[machine.model],
                max_distance=settings.clearance_range,
                period=settings.clearance_period,
            ),
        )
        builder.Connect(scene_graph.get_query_output_port(), monitor.GetInputPort("query_object"))
    logs = {}
    if settings.log_period > 0.0:
        logged = [
            ("pose_command.desired_pose", command.GetOutputPort("desired_pose")),
            ("plant.platform_state", state_port),
            ("cable_forces.tensions", forces.GetOutputPort("tensions")),
            ("cable_forces.lengths", forces.GetOutputPort("lengths")),
            ("winches.unstretched", winches.GetOutputPort("unstretched")),
            ("controller.wanted_tensions", controller.GetOutputPort("wanted_tensions")),
            ("controller.feasible", controller.GetOutputPort("feasible")),
            ("pose_estimator.estimated_state", estimator.GetOutputPort("estimated_state")),
        ]
        if monitor is not None:
            logged.append(("clearance_monitor.clearance", monitor.GetOutputPort("clearance")))
        for name, port in logged:
            sink = VectorLogSink(port.size(), settings.log_period)
            logs[name] = builder.AddNamedSystem(f"log_{name}", sink)
            builder.Connect(port, sink.get_input_port())
    return CableRobotSystems(
        machine=machine,
        command=command,
        controller=controller,
        winches=winches,
        cable_forces=forces,
        estimator=estimator,
        clearance_monitor=monitor,
        cable_break=faults[0],
        disturbance=faults[1],
        logs=logs,
        fastest=fastest,
    )


def MakeCableRobotStation(
    robot: CableRobot,
    motion: PlatformMotion,
    settings: StationSettings | None = None,
    *,
    obstacles: Sequence[BoxObstacle] = (),
) -> Station:
    """The station alone, as a finished diagram; see `AddCableRobot`.

    Output ports, as `<system>.<port>`: those of `pose_command`, `controller`, `winches`,
    `cable_forces` (but for `spatial_force`), `pose_estimator`; `clearance_monitor.clearance` and
    `clearance_monitor.witness` where there is one; `plant.platform_state` (13,), and
    `scene_graph.query`.
    """
    builder = DiagramBuilder()
    systems = AddCableRobot(builder, robot, motion, settings, obstacles=obstacles)
    exported: list[System] = [
        systems.command,
        systems.controller,
        systems.winches,
        systems.cable_forces,
        systems.estimator,
    ]
    for system in exported:
        for index in range(system.num_output_ports()):
            port = system.get_output_port(index)
            if port.get_name() != "spatial_force":
                builder.ExportOutput(port, f"{system.get_name()}.{port.get_name()}")
    if systems.clearance_monitor is not None:
        for name in ("clearance", "witness"):
            port = systems.clearance_monitor.GetOutputPort(name)
            builder.ExportOutput(port, f"clearance_monitor.{name}")
    machine = systems.machine
    state_port = machine.plant.get_state_output_port(machine.model)
    builder.ExportOutput(state_port, "plant.platform_state")
    builder.ExportOutput(machine.scene_graph.get_query_output_port(), "scene_graph.query")
    diagram = builder.Build()
    diagram.set_name("cable_robot_station")
    return Station(diagram=diagram, systems=systems)


def least_distances(station: Station, poses: Poses, *, reach: float = 5.0) -> Array:
    """The platform's least distance to what stands around, were it at N poses, (N,) m.

    Negative where it would be inside; `reach` where nothing is nearer.

    Raises:
        InputError: the platform has no box.
    """
    machine = station.systems.machine
    query = ClearanceQuery(machine.plant, [machine.model], max_distance=reach)
    root: Context = station.diagram.CreateDefaultContext()
    context = machine.plant.GetMyMutableContextFromRoot(root)
    port = station.diagram.GetOutputPort("scene_graph.query")
    found = np.empty(len(poses))
    for n in range(len(poses)):
        X_WP = np.eye(4)
        X_WP[:3, :3], X_WP[:3, 3] = poses.rotation[n], poses.position[n]
        machine.plant.SetFreeBodyPose(context, machine.platform, RigidTransform(X_WP))
        found[n] = query.least(port.Eval(root))[0].distance
    return found


def _connect(builder: DiagramBuilder, source: System, target: System, *names: str) -> None:
    for name in names:
        builder.Connect(source.GetOutputPort(name), target.GetInputPort(name))


def _add_faults(
    builder: DiagramBuilder,
    robot: CableRobot,
    settings: StationSettings,
    forces: System,
    winches: System,
) -> tuple[CableBreak | None, PlatformDisturbance | None]:
    cable_break = disturbance = None
    if settings.breaks:
        cable_break = builder.AddNamedSystem(
            "cable_break",
            CableBreak(robot, breaks=settings.breaks, reaction=settings.reaction),
        )
        _connect(builder, cable_break, forces, "broken")
        _connect(builder, cable_break, winches, "brake")
    if settings.disturbance is not None:
        given = settings.disturbance
        if given.end <= given.start:
            raise InputError(f"disturbance ends at {given.end:g} s; must be after {given.start:g}")
        disturbance = builder.AddNamedSystem(
            "disturbance",
            PlatformDisturbance(wrench=given.wrench, start=given.start, end=given.end),
        )
        _connect(builder, disturbance, forces, "disturbance")
    return cable_break, disturbance
