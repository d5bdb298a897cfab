"""What moves the arm: servos, linkages and the plant's drives, connected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort
from pydrake.systems.primitives import AffineSystem, MatrixGain, ZeroOrderHold

from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.drives import (
    drive_efforts,
    drive_stiffness,
    drives_from_joints,
    joints_from_drives,
)
from pips_drake.serpentine.faults import Fault
from pips_drake.serpentine.legs import make_legs
from pips_drake.serpentine.scenario import ActuationConfig
from pips_drake.serpentine.statics import holding_efforts, sag
from pips_drake.serpentine.station.plant import gravity_in_frame_0
from pips_drake.serpentine.station.prismatic_legs import legs_name, set_default_leg_positions
from pips_drake.serpentine.station.setup import SerpentineSetup
from pips_drake.serpentine.systems.actuator_angle_map import ActuatorAngleMap
from pips_drake.serpentine.systems.actuator_force_map import ActuatorForceMap
from pips_drake.serpentine.systems.actuator_servo import ActuatorServo
from pips_drake.serpentine.systems.deflection_compensator import DeflectionCompensator
from pips_drake.serpentine.systems.leg_effort_map import LegEffortMap
from pips_drake.serpentine.systems.leg_springs import LegSprings
from pips_drake.serpentine.systems.loop_gap_meter import LoopGapMeter

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ActuationPorts:
    """Ports of an arm's drives: what goes in, and what comes back.

    Attributes:
        setpoint: of the servos, drive coordinates and rates, (2 J,).
        brake: of the servos, (1,), to be connected or left: 0 lets the drives go.
        joint_effort: what acts at the joints, (J,) N and Nm.
        drive_effort: what the drives make it with, (J,) N and Nm.
        free_length, stiffness_share: in the fidelity `leg`, what the plant's owner is asked for,
            (A,) m and (A,).
        loop_gap: in the fidelity `truss`, how far the loops stand open, (A,) m.
    """

    setpoint: OutputPort
    brake: InputPort
    joint_effort: OutputPort
    drive_effort: OutputPort
    free_length: OutputPort | None = None
    stiffness_share: OutputPort | None = None
    loop_gap: OutputPort | None = None


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
    faults: Sequence[Fault] = (),
    built: SerpentineArm | None = None,
) -> ActuationPorts:
    """Connects commanded drives to the plant, with the fidelity that `config` names.

    `joint`: servo, then the inverse linkage, then the plant's implicit PD, whose gains are in the
    arm's model. `leg`: servo, then the free lengths of the plant's springs between the pins, which
    whoever simulates must grant (`legs.LegServer`); the base's joints as before. `truss`: servo,
    then the implicit PD of the plant's prismatic legs. Between two
    updates of the servo the set-points move on straight lines: held still, a stiff drive would
    answer each update with a kick (of kilonewtons on the rail).
    Latency: one control period in the servo, and two plant steps; a continuous plant has none.

    Args:
        plant: made for the same fidelity.
        faults: of the drives.
        built: the arm as it stands, if it is not the setup's; what is sent is the setup's.
    """
    arm = built or setup.arm
    servo = builder.AddNamedSystem(
        "actuator_servo", ActuatorServo(arm, faults=faults, period=period)
    )
    force_map = builder.AddNamedSystem("actuator_force_map", ActuatorForceMap(arm))
    builder.Connect(drive_state, servo.GetInputPort("drive_state"))
    gravity, along_legs = gravity_in_frame_0(plant), config.fidelity != "joint"
    start = plant.GetDefaultPositions(model)
    if config.compensate_deflection:
        start = _sent_farther(setup.arm, start, gravity, along_legs)
        compensator = builder.AddNamedSystem(
            "deflection_compensator",
            DeflectionCompensator(setup.arm, gravity=gravity, along_legs=along_legs),
        )
        builder.Connect(joint_state, compensator.GetInputPort("joint_state"))
        builder.Connect(
            compensator.GetOutputPort("drive_offset"), servo.GetInputPort("drive_offset")
        )
    if arm is not setup.arm:
        # What is sent are the drives' coordinates, which hold other joints in the arm as it stands.
        start = joints_from_drives(arm, drives_from_joints(setup.arm, start))
    # The run begins at rest: where these first set-points and gravity leave the arm.
    standing = _standing_posture(arm, start, gravity, along_legs)
    plant.SetDefaultPositions(model, standing)
    free_length = stiffness_share = loop_gap = None
    if along_legs:
        moving = _add_interpolation(
            builder,
            servo.GetOutputPort("setpoint"),
            start=drives_from_joints(arm, start),
            period=period,
            time_step=plant.time_step(),
        )
        first = arm.first_actuated_joint
        base = _add_selection(builder, "base_setpoint", moving, slice(0, first))
        command = _add_selection(builder, "leg_setpoint", moving, slice(first, arm.joints))
        builder.Connect(base, plant.get_desired_state_input_port(model))
        if config.fidelity == "leg":
            leg_force, free_length, stiffness_share = _connect_springs(
                builder, plant, model, arm, command, faults
            )
        else:
            set_default_leg_positions(plant, arm, standing)
            leg_force, loop_gap = _connect_prismatic_legs(builder, plant, model, arm, command)
        joint_effort = _add_effort_map(builder, plant, model, arm, leg_force)
    else:
        joint_effort = _connect_joints(
            builder, plant, model, arm, servo.GetOutputPort("setpoint"), start, period
        )
    builder.Connect(plant.get_state_output_port(model), force_map.GetInputPort("joint_state"))
    builder.Connect(joint_effort, force_map.GetInputPort("joint_effort"))
    return ActuationPorts(
        setpoint=servo.GetOutputPort("setpoint"),
        brake=servo.GetInputPort("brake"),
        joint_effort=joint_effort,
        drive_effort=force_map.GetOutputPort("drive_effort"),
        free_length=free_length,
        stiffness_share=stiffness_share,
        loop_gap=loop_gap,
    )


def _connect_joints(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    model: ModelInstanceIndex,
    arm: SerpentineArm,
    setpoint: OutputPort,
    start: Array,
    period: float,
) -> OutputPort:
    """Servos to the plant's drives at the joints; returns what acts at the joints."""
    angle_map = builder.AddNamedSystem("actuator_angle_map", ActuatorAngleMap(arm, period=period))
    builder.Connect(setpoint, angle_map.GetInputPort("drive_state"))
    moving = _add_interpolation(
        builder,
        angle_map.GetOutputPort("joint_state"),
        start=start,
        period=period,
        time_step=plant.time_step(),
    )
    builder.Connect(moving, plant.get_desired_state_input_port(model))
    effort: OutputPort = plant.get_net_actuation_output_port(model)
    return effort


def _connect_springs(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    model: ModelInstanceIndex,
    arm: SerpentineArm,
    command: OutputPort,
    faults: Sequence[Fault],
) -> tuple[OutputPort, OutputPort, OutputPort]:
    """Commanded legs to the plant's springs; returns their forces, and lengths and shares asked."""
    springs = builder.AddNamedSystem(
        "leg_springs", LegSprings(arm, period=plant.time_step(), faults=faults)
    )
    builder.Connect(command, springs.GetInputPort("leg_command"))
    builder.Connect(plant.get_state_output_port(model), springs.GetInputPort("joint_state"))
    asked = springs.GetOutputPort("free_length"), springs.GetOutputPort("stiffness_share")
    return springs.GetOutputPort("leg_force"), *asked


def _connect_prismatic_legs(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    model: ModelInstanceIndex,
    arm: SerpentineArm,
    command: OutputPort,
) -> tuple[OutputPort, OutputPort]:
    """Commanded legs to the plant's prismatic ones; returns their forces, and the loops' gaps."""
    instance = plant.GetModelInstanceByName(legs_name(arm))
    builder.Connect(command, plant.get_desired_state_input_port(instance))
    bodies, pins, first = [], make_legs(arm).outer_pin, arm.first_actuated_joint
    for name, body in zip(arm.actuator_names, arm.bodies[first:], strict=True):
        ends = plant.GetBodyByName(f"{name}_rod", instance), plant.GetBodyByName(body.name, model)
        bodies.append([int(end.index()) for end in ends])
    meter = builder.AddNamedSystem(
        "loop_gap_meter", LoopGapMeter(bodies, np.stack([np.zeros_like(pins), pins], axis=1))
    )
    builder.Connect(plant.get_body_poses_output_port(), meter.GetInputPort("body_poses"))
    return plant.get_net_actuation_output_port(instance), meter.GetOutputPort("gap")


def _add_effort_map(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    model: ModelInstanceIndex,
    arm: SerpentineArm,
    leg_force: OutputPort,
) -> OutputPort:
    """What the base's drives and the legs' forces make at the joints."""
    effort_map = builder.AddNamedSystem("leg_effort_map", LegEffortMap(arm))
    builder.Connect(plant.get_state_output_port(model), effort_map.GetInputPort("joint_state"))
    builder.Connect(
        plant.get_net_actuation_output_port(model), effort_map.GetInputPort("base_effort")
    )
    builder.Connect(leg_force, effort_map.GetInputPort("leg_force"))
    effort: OutputPort = effort_map.GetOutputPort("joint_effort")
    return effort


def _add_interpolation(
    builder: DiagramBuilder, sampled: OutputPort, *, start: Array, period: float, time_step: float
) -> OutputPort:
    """Set-points (x, v) that move on straight lines from `start` at the sampled port's rates."""
    if time_step > 0.0:
        # Drake forgets every cached output at every step of any discrete system. This hold keeps
        # the inverse linkage from being computed anew at each step of the plant.
        hold = builder.AddNamedSystem(
            "setpoint_hold", ZeroOrderHold(period, 2 * start.size, offset_sec=time_step)
        )
        builder.Connect(sampled, hold.get_input_port())
        sampled = hold.get_output_port()
    interpolator = builder.AddNamedSystem(
        "setpoint_interpolator", _make_interpolator(start, time_step)
    )
    builder.Connect(sampled, interpolator.get_input_port())
    moving: OutputPort = interpolator.get_output_port()
    return moving


def _add_selection(
    builder: DiagramBuilder, name: str, state: OutputPort, rows: slice
) -> OutputPort:
    """Some coordinates of a state (x, v) with their rates."""
    some = np.eye(state.size() // 2)[rows]
    selection = builder.AddNamedSystem(name, MatrixGain(np.kron(np.eye(2), some)))
    builder.Connect(state, selection.get_input_port())
    selected: OutputPort = selection.get_output_port()
    return selected


def _make_interpolator(start: Array, time_step: float) -> AffineSystem:
    """Set-points that move at the input's rates; output (x, v).

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


def _sent_farther(arm: SerpentineArm, posture: Array, gravity: Array, along_legs: bool) -> Array:
    """Joints to command, (J,), so that the arm stands at a posture under gravity."""
    if not along_legs:
        aim: Array = posture + sag(arm, posture, gravity)[0]
        return aim
    efforts = holding_efforts(arm, posture, gravity)[0]
    give = drive_efforts(arm, posture, efforts) / drive_stiffness(arm)
    return joints_from_drives(arm, drives_from_joints(arm, posture) + give)


def _standing_posture(
    arm: SerpentineArm, command: Array, gravity: Array, along_legs: bool
) -> Array:
    """Where the arm stands still when its joints are commanded to `command`, (J,)."""
    posture, drives = command, drives_from_joints(arm, command)
    # Each step changes the sag by the sag's own share of the levers: a thousandth.
    for _ in range(4):
        if along_legs:
            efforts = holding_efforts(arm, posture, gravity)[0]
            give = drive_efforts(arm, posture, efforts) / drive_stiffness(arm)
            posture = joints_from_drives(arm, drives - give)
        else:
            posture = command - sag(arm, posture, gravity)[0]
    return posture
