"""The supervisor in the station: what it sees, and how late the plant answers it."""

from __future__ import annotations

from pydrake.systems.framework import DiagramBuilder, InputPort, LeafSystem, OutputPort

from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.scenario import ClockConfig, SerpentineScenario
from pips_drake.serpentine.systems.motion_supervisor import MotionSupervisor

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
) -> MotionSupervisor:
    """Adds a supervisor between the operator's command and the path source.

    Args:
        source: the `TipPathSource`; its command and its share of speed are the supervisor's.
        monitor: the `ClearanceMonitor`.
        commanded_joint_state, joint_state: where the drives are sent, and where the arm is.
        drive_effort: efforts of the drives.
        brake: of the drives' servos (`ActuationPorts.brake`), which a stop sets.
    """
    period, offset = supervision_period(scenario.clocks)
    supervisor = builder.AddNamedSystem(
        "motion_supervisor",
        MotionSupervisor(
            arm,
            config=scenario.supervisor,
            latency=supervision_latency(scenario.clocks),
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
