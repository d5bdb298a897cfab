"""The remote manipulator's station: the operator's channels in, the modelled hardware at work."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, System

from pips_drake.remote_manipulator.configuration import STATIONS, RemoteManipulatorConfig
from pips_drake.remote_manipulator.phases import Phase
from pips_drake.remote_manipulator.program import CollisionProgram as Program
from pips_drake.remote_manipulator.program_state import FRAME_PERIOD, ProgramSettings
from pips_drake.remote_manipulator.station.attachments import AttachmentMonitor
from pips_drake.remote_manipulator.station.plant import (
    PlantSettings,
    RemoteManipulatorPlant,
    home_arm_vector,
    make_plant,
)
from pips_drake.remote_manipulator.systems.attitude_limit_cycle import AttitudeLimitCycle
from pips_drake.remote_manipulator.systems.collision_program import CollisionProgram
from pips_drake.remote_manipulator.systems.relative_poses import RelativePoses
from pips_drake.remote_manipulator.systems.slave_arm import SlaveArm
from pips_drake.remote_manipulator.systems.visual_scene_program import VisualSceneProgram
from pips_drake.twin.systems.clearance_monitor import ClearanceMonitor

#: Clearances larger than this are not looked for, m.
CLEARANCE_RANGE = 1.0
#: What the payload's support means for the phase that a run begins in.
FIRST_PHASES = {"bay": Phase.STOWED, "port": Phase.DOCKED, "none": Phase.FREE_FLYING}
_OUTPUTS = {
    "collision_program": (
        "setpoint",
        "control_word",
        "output_block",
        "phase",
        "flags",
        "display",
        "attachment",
    ),
    "relative_poses": ("payload_pose", "cae_pose", "arm_measured"),
    "slave_arm": ("arm_desired_state",),
    "clearance_monitor": ("clearance", "witness"),
    "visual_scene_program": ("station", "camera", "camera_pose", "color_image"),
}


@dataclass(frozen=True, kw_only=True)
class JetConfig:
    """Jets that keep a free flyer's attitude: half of the dead band, rad, and torque, N m."""

    dead_band: float
    torque: float


@dataclass(frozen=True, kw_only=True)
class Station:
    """A station, and what its user needs besides its ports.

    Attributes:
        diagram: finished, not yet simulated.
        machine: its plant.
        attachments: switches the welds between steps: install `attachments.monitor` as the
            simulator's monitor, and call `attachments.initialize` with every new context.
        program: what the collision program is made of.
    """

    diagram: Diagram
    machine: RemoteManipulatorPlant
    attachments: AttachmentMonitor
    program: Program


def MakeRemoteManipulatorStation(
    config: RemoteManipulatorConfig,
    *,
    settings: PlantSettings | None = None,
    program_settings: ProgramSettings | None = None,
    operator: System | None = None,
    jets: JetConfig | None = None,
    camera: str = STATIONS[0],
) -> Station:
    """The station in which an operator works with the arm: a finished diagram.

    Systems, by name: `operator` (if one is given), `collision_program`, `slave_arm`, `plant`,
    `scene_graph`, `relative_poses`, `clearance_monitor`, `visual_scene_program` and, with jets,
    `attitude_limit_cycle`.

    Input port: `operator.channels` (17,) V, where no operator is given.

    Output ports, as `<system>.<port>`: those of `collision_program`, `relative_poses`,
    `clearance_monitor` (but for `urgent` and `own_urgent`) and `visual_scene_program` that are
    described there; `slave_arm.arm_desired_state`; `operator.channels` and the operator's other
    outputs; `plant.state`, `plant.arm_state` (16,), `plant.arm_effort` (8,) N and N m,
    `plant.contact_results`, `scene_graph.query`.

    Latencies: what the operator does in a frame is decided on at its end, 0.05 s; the slave arm is
    there a frame and a control period later.

    Args:
        config: the machine.
        settings: of the plant and where everything is at first.
        program_settings: the collision program's choices.
        operator: a system with the output `channels`, and inputs that have names of outputs of
            `collision_program` or `relative_poses`, which are connected.
        jets: of a payload that flies free at first.
        camera: station that is chosen at first.
    """
    settings = settings or PlantSettings()
    builder = DiagramBuilder()
    machine = make_plant(builder, config, settings)
    plant, scene_graph = machine.plant, machine.scene_graph
    arm_state = plant.get_state_output_port(machine.arm)
    poses = builder.AddNamedSystem(
        "relative_poses",
        RelativePoses(
            orbiter_index=machine.orbiter.index(),
            payload_index=machine.payload_body.index(),
            cae_index=machine.cae.index(),
        ),
    )
    builder.Connect(plant.get_body_poses_output_port(), poses.GetInputPort("body_poses"))
    builder.Connect(arm_state, poses.GetInputPort("arm_state"))
    start = home_arm_vector(config) if settings.arm_vector is None else settings.arm_vector
    program = Program(
        config, program_settings, phase=FIRST_PHASES[settings.support], arm=np.asarray(start)
    )
    system = builder.AddNamedSystem("collision_program", CollisionProgram(program))
    for name in ("payload_pose", "cae_pose", "arm_measured"):
        builder.Connect(poses.GetOutputPort(name), system.GetInputPort(name))
    slave = builder.AddNamedSystem(
        "slave_arm",
        SlaveArm(
            config,
            frame=FRAME_PERIOD,
            period=_control_period(settings),
            start=program.first_command,
        ),
    )
    builder.Connect(system.GetOutputPort("setpoint"), slave.GetInputPort("setpoint"))
    builder.Connect(
        slave.GetOutputPort("arm_desired_state"), plant.get_desired_state_input_port(machine.arm)
    )
    if machine.orbiter_motion is not None:
        builder.Connect(
            slave.GetOutputPort("orbiter_desired_state"),
            plant.get_desired_state_input_port(machine.orbiter_motion),
        )
    monitor = builder.AddNamedSystem(
        "clearance_monitor",
        ClearanceMonitor(
            plant,
            robot=[machine.arm, machine.payload],
            max_distance=CLEARANCE_RANGE,
            period=FRAME_PERIOD,
        ),
    )
    builder.Connect(scene_graph.get_query_output_port(), monitor.GetInputPort("query_object"))
    scene = builder.AddNamedSystem(
        "visual_scene_program",
        VisualSceneProgram(config, station=camera, orbiter_index=machine.orbiter.index()),
    )
    builder.Connect(system.GetOutputPort("control_word"), scene.GetInputPort("control_word"))
    for name in ("payload_pose", "cae_pose", "arm_measured"):
        builder.Connect(poses.GetOutputPort(name), scene.GetInputPort(name))
    builder.Connect(plant.get_body_poses_output_port(), scene.GetInputPort("body_poses"))
    builder.Connect(scene_graph.get_query_output_port(), scene.GetInputPort("query_object"))
    if jets is not None:
        _add_jets(builder, machine, system, jets)
    if operator is None:
        builder.ExportInput(system.GetInputPort("channels"), "operator.channels")
    else:
        _add_operator(builder, operator, system, poses)
    for name, ports in _OUTPUTS.items():
        for port in ports:
            output = builder.GetSubsystemByName(name).GetOutputPort(port)
            builder.ExportOutput(output, f"{name}.{port}")
    for name, output in (
        ("plant.state", plant.get_state_output_port()),
        ("plant.arm_state", arm_state),
        ("plant.arm_effort", plant.get_net_actuation_output_port(machine.arm)),
        ("plant.contact_results", plant.get_contact_results_output_port()),
        ("scene_graph.query", scene_graph.get_query_output_port()),
    ):
        builder.ExportOutput(output, name)
    diagram = builder.Build()
    diagram.set_name("remote_manipulator_station")
    attachments = AttachmentMonitor(
        machine,
        system,
        grasped_pose=_snapped_pose(system) if program.settings.snap_to_right_angles else None,
        on_reset=lambda root: slave.place(
            slave.GetMyMutableContextFromRoot(root), program.first_command
        ),
    )
    return Station(diagram=diagram, machine=machine, attachments=attachments, program=program)


def _control_period(settings: PlantSettings) -> float:
    """The slave arm's: a whole number of steps, and a whole part of a frame, near 10 ms."""
    steps = round(FRAME_PERIOD / settings.time_step)
    parts = [part for part in range(1, steps + 1) if steps % part == 0]
    nearest = min(parts, key=lambda part: abs(math.log(part * settings.time_step / 0.01)))
    return nearest * settings.time_step


def _snapped_pose(system: CollisionProgram):  # type: ignore[no-untyped-def]
    def pose(root: Context):  # type: ignore[no-untyped-def]
        return system.held_pose(system.GetMyContextFromRoot(root))

    return pose


def _add_jets(
    builder: DiagramBuilder,
    machine: RemoteManipulatorPlant,
    program: CollisionProgram,
    jets: JetConfig,
) -> None:
    plant = machine.plant
    R_WP = plant.GetDefaultFloatingBaseBodyPose(machine.payload_body).rotation().matrix()
    system = builder.AddNamedSystem(
        "attitude_limit_cycle",
        AttitudeLimitCycle(
            machine.payload_body.index(),
            attitude=R_WP,
            dead_band=jets.dead_band,
            torque=jets.torque,
        ),
    )
    builder.Connect(
        plant.get_state_output_port(machine.payload), system.GetInputPort("payload_state")
    )
    builder.Connect(program.GetOutputPort("attachment"), system.GetInputPort("attachment"))
    builder.Connect(
        system.GetOutputPort("spatial_force"), plant.get_applied_spatial_force_input_port()
    )


def _add_operator(
    builder: DiagramBuilder, operator: System, program: System, poses: System
) -> None:
    builder.AddNamedSystem("operator", operator)
    builder.Connect(operator.GetOutputPort("channels"), program.GetInputPort("channels"))
    for index in range(operator.num_input_ports()):
        port = operator.get_input_port(index)
        source = _source_of(port.get_name(), (program, poses))
        builder.Connect(source, port)
    for index in range(operator.num_output_ports()):
        port = operator.get_output_port(index)
        builder.ExportOutput(port, f"operator.{port.get_name()}")


def _source_of(name: str, systems: Sequence[System]):  # type: ignore[no-untyped-def]
    for system in systems:
        if system.HasOutputPort(name):
            return system.GetOutputPort(name)
    raise ValueError(f"the operator's input {name} is no output of program or poses")
