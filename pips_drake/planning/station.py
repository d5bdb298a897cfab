"""The teleoperation station: an operator's snake, the arm on it, its drives and its supervisor."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder

from pips_drake.planning.live_arm import LiveArm
from pips_drake.planning.live_state import LiveState
from pips_drake.planning.systems.snake_teleoperator import SnakeTeleoperator
from pips_drake.serpentine.follow_the_leader import FollowTheLeader
from pips_drake.serpentine.joint_motion import JointMotion
from pips_drake.serpentine.planned_motion import GivenJoints
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import (
    VISUAL_PERIOD,
    AddActuation,
    SerpentineSetup,
    make_plant,
)
from pips_drake.serpentine.station.supervision import (
    SUPERVISOR_PORTS,
    AddClearanceMonitor,
    AddMotionSupervisor,
    supervision_latency,
)
from pips_drake.serpentine.systems.actuator_length_map import ActuatorLengthMap

#: What an operator may do, as inputs of the station.
OPERATOR_PORTS = ("goal", "pull", "nails", "obstacles", "tension", "bending_stiffness", "reach")
_OUTPUTS = (
    "snake_teleoperator.joint_state",
    "snake_teleoperator.tip",
    "snake_teleoperator.phase",
    "snake_teleoperator.tip_path",
    "snake_teleoperator.snake",
    "snake_teleoperator.status",
    "actuator_length_map.drive_state",
    "actuator_servo.setpoint",
    "actuator_servo.saturation",
    "actuator_force_map.drive_effort",
    "clearance_monitor.clearance",
    "clearance_monitor.witness",
    *SUPERVISOR_PORTS,
)


def MakeTeleoperationStation(
    scenario: SerpentineScenario,
    live_arm: LiveArm,
    start: LiveState,
    *,
    scene_file: Path | None = None,
) -> Diagram:
    """The station in which an operator moves the arm: a finished diagram, not yet simulated.

    Systems, by name: `snake_teleoperator`, `actuator_length_map`, what `AddActuation` adds,
    `plant`, `scene_graph`, `actuator_visualizer`, `clearance_monitor` and `motion_supervisor`.

    Input ports, all optional: `snake_teleoperator.goal`, `.pull`, `.nails`, `.obstacles`,
    `.tension`, `.bending_stiffness` and `.reach`, which reach the teleoperator as they are, and
    `snake_teleoperator.command`, which does as far as the supervisor lets it: what holds the
    supervisor's word stops snake and tip alike, and where it goes back, it goes back along the
    snake as it lies.

    Output ports: those of `snake_teleoperator`, `clearance_monitor` and `motion_supervisor` that
    are described there, as `<system>.<port>`; `actuator_length_map.drive_state`,
    `actuator_servo.setpoint`, `actuator_servo.saturation`, `actuator_force_map.drive_effort`;
    `plant.state` (2 J,) of the arm and `scene_graph.query`.

    Latencies are those of `MakeSerpentineStation`, and two periods of the teleoperator: a wish acts
    at its next update, and is reached a period later.

    Args:
        scenario: mounting, clocks, actuation and supervisor are taken from it; its arm, path and
            scene are those of the other arguments. The fidelity must be `joint` or `truss`.
        start: where it begins (`LiveArm.lay`).
        scene_file: the scene that the live arm's obstacles were read from.
    """
    arm = live_arm.arm
    standing = JointMotion(times=np.array([0.0, 1.0]), joints=np.tile(start.joints, (2, 1)))
    setup = SerpentineSetup(
        arm=arm,
        motion=GivenJoints(arm=arm, motion=standing, name="live"),
        solver=FollowTheLeader(arm),
        scene_file=scene_file,
        rail_shift=float(live_arm.shift[2]),
    )
    control = 1.0 / scenario.clocks.control_hz
    builder = DiagramBuilder()
    plant, scene_graph, model = make_plant(
        builder,
        setup,
        scenario,
        visual_period=VISUAL_PERIOD,
        fidelity=scenario.actuation.fidelity,
    )
    operator = builder.AddNamedSystem("snake_teleoperator", SnakeTeleoperator(live_arm, start))
    joint_state = operator.GetOutputPort("joint_state")
    length_map = builder.AddNamedSystem("actuator_length_map", ActuatorLengthMap(arm))
    builder.Connect(joint_state, length_map.GetInputPort("joint_state"))
    actuation = AddActuation(
        builder,
        plant=plant,
        model=model,
        setup=setup,
        drive_state=length_map.GetOutputPort("drive_state"),
        joint_state=joint_state,
        config=scenario.actuation,
        period=control,
    )
    latency = supervision_latency(scenario.clocks) + 2.0 * live_arm.settings.period
    monitor = AddClearanceMonitor(
        builder,
        plant=plant,
        scene_graph=scene_graph,
        model=model,
        scenario=scenario,
        latency=latency,
    )
    supervisor = AddMotionSupervisor(
        builder,
        arm=arm,
        scenario=scenario,
        source=operator,
        monitor=monitor,
        commanded_joint_state=joint_state,
        joint_state=plant.get_state_output_port(model),
        drive_effort=actuation.drive_effort,
        brake=actuation.brake,
        latency=latency,
    )
    builder.ExportInput(supervisor.GetInputPort("operator_command"), "snake_teleoperator.command")
    for name in OPERATOR_PORTS:
        builder.ExportInput(operator.GetInputPort(name), f"snake_teleoperator.{name}")
    for name in _OUTPUTS:
        system, port = name.split(".")
        builder.ExportOutput(builder.GetSubsystemByName(system).GetOutputPort(port), name)
    builder.ExportOutput(plant.get_state_output_port(model), "plant.state")
    builder.ExportOutput(scene_graph.get_query_output_port(), "scene_graph.query")
    diagram = builder.Build()
    diagram.set_name("teleoperation_station")
    return diagram
