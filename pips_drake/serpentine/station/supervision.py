"""Supervisor and clearance monitor: what they see, and how late the plant answers them."""

from __future__ import annotations

from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder, InputPort, LeafSystem, OutputPort

from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.scenario import ClockConfig, SerpentineScenario
from pips_drake.serpentine.systems.motion_supervisor import MotionSupervisor
from pips_drake.twin.systems.clearance_monitor import ClearanceMonitor

#: The station's output ports that come with a supervisor.
SUPERVISOR_PORTS = tuple(
    f"motion_supervisor.{name}" for name in ("command", "speed_share", "mode", "cause", "measured")
)


def supervision_period(clocks: ClockConfig) -> tuple[float, float]:
    """How often the supervisor decides, and when first, s: with each clearance, once it is known.

    A monitor's finding is seen by updates after its own; a control period after it is the first
    instant at which the path source could act on it.
    """
    rate = min(clocks.clearance_hz, clocks.control_hz)
    offset = 1.0 / clocks.control_hz if clocks.clearance_hz < clocks.control_hz else 0.0
    return 1.0 / rate, offset


def supervision_latency(clocks: ClockConfig) -> float:
    """At most from a change of clearance to the plant's answer, s.

    Until the monitor samples it, one clearance period; until the supervisor sees that, a control
    period; and what the station's latency from command to plant is, 3 / control_hz + 2 / plant_hz.
    """
    return 1.0 / clocks.clearance_hz + 4.0 / clocks.control_hz + 2.0 / clocks.plant_hz


def AddMotionSupervisor(
    builder: DiagramBuilder,
    *,
    arm: SerpentineArm,
    scenario: SerpentineScenario,
    source: LeafSystem,
    monitor: LeafSystem,
    commanded_joint_state: OutputPort,
    joint_state: OutputPort,
    drive_effort: OutputPort,
    brake: InputPort,
    latency: float | None = None,
) -> MotionSupervisor:
    """Adds a supervisor between the operator's command and what moves the tip.

    Args:
        source: a `TipPathSource` or what has its ports; its command and its share of speed are the
            supervisor's.
        monitor: the `ClearanceMonitor`.
        commanded_joint_state, joint_state: where the drives are sent, and where the arm is.
        drive_effort: efforts of the drives.
        brake: of the drives' servos (`ActuationPorts.brake`), which a stop sets.
        latency: until the plant answers, s; `supervision_latency` by default.
    """
    period, offset = supervision_period(scenario.clocks)
    supervisor = builder.AddNamedSystem(
        "motion_supervisor",
        MotionSupervisor(
            arm,
            config=scenario.supervisor,
            latency=supervision_latency(scenario.clocks) if latency is None else latency,
            period=period,
            offset=offset,
        ),
    )
    for output, name in (
        (monitor.GetOutputPort("clearance"), "clearance"),
        (monitor.GetOutputPort("urgent"), "urgent"),
        (monitor.GetOutputPort("own_urgent"), "own_urgent"),
        (commanded_joint_state, "commanded_joint_state"),
        (joint_state, "joint_state"),
        (drive_effort, "drive_effort"),
        (source.GetOutputPort("tip"), "tip"),
        (source.GetOutputPort("phase"), "phase"),
    ):
        builder.Connect(output, supervisor.GetInputPort(name))
    for name in ("command", "speed_share"):
        builder.Connect(supervisor.GetOutputPort(name), source.GetInputPort(name))
    builder.Connect(supervisor.GetOutputPort("brake"), brake)
    return supervisor


def AddClearanceMonitor(
    builder: DiagramBuilder,
    *,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    model: ModelInstanceIndex,
    scenario: SerpentineScenario,
    latency: float | None = None,
) -> ClearanceMonitor:
    """Adds a monitor of the arm's clearance to the scene and to itself.

    Args:
        model: the arm.
        latency: as of `AddMotionSupervisor`, which looks ahead until the arm has come to rest.
    """
    lookahead = 0.0
    if scenario.supervisor.enabled:
        late = supervision_latency(scenario.clocks) if latency is None else latency
        lookahead = scenario.supervisor.thresholds(late).stopping_time
    monitor = builder.AddNamedSystem(
        "clearance_monitor",
        ClearanceMonitor(
            plant,
            robot=[model],
            max_distance=scenario.clearance_range_m,
            lookahead=lookahead,
            period=1.0 / scenario.clocks.clearance_hz,
        ),
    )
    for output, name in (
        (scene_graph.get_query_output_port(), "query_object"),
        (plant.get_body_poses_output_port(), "body_poses"),
        (plant.get_body_spatial_velocities_output_port(), "body_spatial_velocities"),
    ):
        builder.Connect(output, monitor.GetInputPort(name))
    return monitor
