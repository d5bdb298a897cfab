"""The serpentine station: arm, scene, follow-the-leader, actuators and monitor as one diagram."""

from __future__ import annotations

from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Diagram, DiagramBuilder

from pips_drake.serpentine.faults import make_drive_faults
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station.actuation import AddActuation
from pips_drake.serpentine.station.camera import CAMERA_PORTS, AddCameraPointer, AddCameraStation
from pips_drake.serpentine.station.faults import AddDisturbances, AddEncoders
from pips_drake.serpentine.station.legs import FREE_LENGTH, STIFFNESS_SHARE, LegServer
from pips_drake.serpentine.station.motion import AddPlannedMotion, motion_names
from pips_drake.serpentine.station.plant import make_plant
from pips_drake.serpentine.station.prismatic_legs import legs_name
from pips_drake.serpentine.station.setup import SerpentineSetup, built_arm, load_setup
from pips_drake.serpentine.station.supervision import (
    SUPERVISOR_PORTS,
    AddClearanceMonitor,
    AddMotionSupervisor,
)
from pips_drake.serpentine.systems.actuator_length_map import ActuatorLengthMap

#: How often a run's drawn actuators move, and those who watch it live are told, s. Twice as often
#: would take a twentieth more time (measured), and a run goes several times as fast as the clock.
VISUAL_PERIOD = 1.0 / 16.0


def MakeSerpentineStation(
    scenario: SerpentineScenario, *, setup: SerpentineSetup | None = None
) -> Diagram:
    """The station of a scenario: a finished diagram, not yet simulated.

    Systems, by name: `plant`, `scene_graph`, `tip_path_source`, `follow_the_leader`,
    `actuator_length_map`, `actuator_servo`, `actuator_angle_map`, `actuator_force_map`,
    `setpoint_hold` (if the plant is discrete), `setpoint_interpolator`, `deflection_compensator`
    (if compensated), `clearance_monitor`, `actuator_visualizer`, `motion_supervisor` (if enabled);
    and with a camera `camera_pointer` and `camera_station`.

    Input port: `tip_path_source.command` (1,), optional. With a supervisor it is the operator's,
    and reaches the source as far as the supervisor lets it; and there is
    `motion_supervisor.encoder_health` (J,), optional.

    With a motion that is given by joints, `joint_motion_source` stands for `tip_path_source` and
    `follow_the_leader`, and its ports `command`, `tip`, `phase` and `joint_state` for theirs
    (`motion_names`); everything behind it is the same.

    Faults (`faults` in the scenario) act in `actuator_servo`; in `encoder_bank`, which is there if
    an encoder fails, and which the supervisor then reads in place of the plant and of
    `motion_supervisor.encoder_health`; in `tip_disturbance`; in `leg_springs`; and in the plant,
    with what is between its drives and the servos, if the arm is built otherwise than path, plan
    and controllers have it.

    Output ports, as `<system>.<port>` (each is described at its system): `tip_path_source.tip`,
    `tip_path_source.phase`, `follow_the_leader.joint_state`, `follow_the_leader.solution`,
    `actuator_length_map.drive_state`, `actuator_servo.setpoint`, `actuator_servo.saturation`,
    `actuator_force_map.drive_effort`, `clearance_monitor.clearance`, `clearance_monitor.witness`;
    and of the plant and scene graph `plant.state` (2 J,) of the arm, `plant.net_actuation` (J,),
    `scene_graph.query`. With a supervisor also `motion_supervisor.command`,
    `motion_supervisor.speed_share`, `motion_supervisor.mode`, `motion_supervisor.cause` and
    `motion_supervisor.measured`. With a camera also `camera_pointer.joint_state` (2 J,), which the
    drives then follow, `camera_pointer.pan_tilt` (2,), `camera_station.camera_pose`,
    `camera_station.color_image` and `camera_station.depth_image`; for the images the scene graph
    needs a renderer (`AddCameraStation`).

    Latencies: a source's update is seen by the controller at once, by the servo at its next update
    (one control period, 1/64 s by default), and reached one period after that, plus two plant
    steps; the monitor sees the plant's last step. From command to plant at most 3 / control_hz +
    2 / plant_hz. The plant's state at an instant, before that instant's updates (what `AdvanceTo`
    leaves and logs hold), is one step later still: 3 steps behind the continuous plant's, which is
    late by none (`integration.scheme`; simulate it with `MakeSimulator`, which knows integrator and
    accuracy).

    From a change of clearance to the plant's answer: at most 1 / clearance_hz until the monitor
    samples it, 1 / control_hz until the supervisor has decided, and the 3 / control_hz + 2 /
    plant_hz above (`supervision_latency`; 98 ms by default). At a tip speed v with hold ramp r the
    arm needs v latency + v^2 / (2 a), a = v / r, to come to rest: v (latency + r / 2), 8.7 mm at 25
    mm/s by default. The supervisor holds while that much more than its threshold is left.
    At a stop it sets the brakes: from what it sees to drives that stand, 1 / control_hz until it
    has decided, at most 2 / control_hz in the servo, and 2 plant steps.

    Fidelities (`actuation.fidelity`): the above is `joint`. With `leg`, `plant.net_actuation` is
    what the springs between the pins make at the joints; `base_setpoint`, `leg_setpoint`,
    `leg_springs` and `leg_effort_map` stand for `actuator_angle_map`; and `leg_springs.free_length`
    and `leg_springs.stiffness_share` (A,) are requests, which a `LegServer` grants at every step:
    `MakeSimulator` installs it. With
    `truss` the legs are bodies of their own model `<arm>_legs`, which stands for
    `actuator_visualizer` and `leg_springs`; `plant.legs_state` (6 A,) is theirs, and
    `loop_gap_meter.gap` (A,) is how far their loops stand open. The latencies are the same.

    Args:
        setup: what the scenario names, if it is loaded already.

    Raises:
        InputError: something the scenario names cannot be used.
        NotFollowableError: there is no fastest motion, if that is wanted (`make_profile`).
    """
    setup = setup or load_setup(scenario)
    arm, names = setup.arm, motion_names(setup.motion)
    period = 1.0 / scenario.clocks.control_hz
    builder = DiagramBuilder()
    plant, scene_graph, model = make_plant(
        builder,
        setup,
        scenario,
        visual_period=VISUAL_PERIOD,
        fidelity=scenario.actuation.fidelity,
    )
    source, joint_state = AddPlannedMotion(builder, scenario, setup)
    length_map = builder.AddNamedSystem("actuator_length_map", ActuatorLengthMap(arm))
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
    actuation = AddActuation(
        builder,
        plant=plant,
        model=model,
        setup=setup,
        drive_state=length_map.GetOutputPort("drive_state"),
        joint_state=joint_state,
        config=scenario.actuation,
        period=period,
        faults=make_drive_faults(arm, scenario.faults),
        built=built_arm(setup, scenario.faults),
    )
    AddDisturbances(builder, plant=plant, model=model, arm=arm, faults=scenario.faults)
    monitor = AddClearanceMonitor(
        builder, plant=plant, scene_graph=scene_graph, model=model, scenario=scenario
    )
    operator = source.GetInputPort("command")
    if scenario.supervisor.enabled:
        true_state = plant.get_state_output_port(model)
        encoders = AddEncoders(
            builder, arm=arm, joint_state=true_state, faults=scenario.faults, period=period
        )
        supervisor = AddMotionSupervisor(
            builder,
            arm=arm,
            scenario=scenario,
            source=source,
            monitor=monitor,
            commanded_joint_state=joint_state,
            joint_state=true_state if encoders is None else encoders.GetOutputPort("reading"),
            drive_effort=actuation.drive_effort,
            brake=actuation.brake,
        )
        operator = supervisor.GetInputPort("operator_command")
        health = supervisor.GetInputPort("encoder_health")
        if encoders is None:
            builder.ExportInput(health, "motion_supervisor.encoder_health")
        else:
            builder.Connect(encoders.GetOutputPort("health"), health)
    builder.ExportInput(operator, names.command)
    for name in (
        *(CAMERA_PORTS if scenario.camera.enabled else ()),
        *(SUPERVISOR_PORTS if scenario.supervisor.enabled else ()),
        *names.ports,
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
    builder.ExportOutput(actuation.joint_effort, "plant.net_actuation")
    if actuation.free_length is not None:
        builder.ExportOutput(actuation.free_length, FREE_LENGTH)
    if actuation.stiffness_share is not None:
        builder.ExportOutput(actuation.stiffness_share, STIFFNESS_SHARE)
    if actuation.loop_gap is not None:
        legs = plant.GetModelInstanceByName(legs_name(arm))
        builder.ExportOutput(plant.get_state_output_port(legs), "plant.legs_state")
        builder.ExportOutput(actuation.loop_gap, "loop_gap_meter.gap")
    builder.ExportOutput(scene_graph.get_query_output_port(), "scene_graph.query")
    diagram = builder.Build()
    diagram.set_name("serpentine_station")
    return diagram


def MakeSimulator(diagram: Diagram, scenario: SerpentineScenario) -> Simulator:
    """A simulator, not yet initialized, of a diagram that holds the scenario's station.

    A station of another `integration.scheme` than `discrete` needs it: the integrator and its
    accuracy are the simulator's, not the diagram's. Its steps end at the servos' updates anyway.
    So does the fidelity `leg`: the lengths of the plant's springs are set by the simulator's
    monitor (`LegServer`). The station is the diagram itself, or one of its subsystems.
    """
    simulator = Simulator(diagram)
    if scenario.actuation.fidelity == "leg":
        parts = [diagram, *diagram.GetSystems()]
        station = next(part for part in parts if part.HasOutputPort(FREE_LENGTH))
        simulator.set_monitor(LegServer(station).monitor)
    if scenario.integration.scheme != "discrete":
        config = SimulatorConfig(
            integration_scheme=scenario.integration.scheme,
            max_step_size=1.0 / scenario.clocks.control_hz,
            accuracy=scenario.integration.accuracy,
            use_error_control=True,
        )
        ApplySimulatorConfig(config, simulator)
    return simulator
