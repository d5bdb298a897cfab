"""What moves the arm: servos, linkages and the plant's drives, connected."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import AffineSystem, ZeroOrderHold

from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.drives import joint_stiffness
from pips_drake.serpentine.scenario import ActuationConfig
from pips_drake.serpentine.statics import holding_efforts
from pips_drake.serpentine.station.plant import gravity_in_frame_0
from pips_drake.serpentine.station.setup import SerpentineSetup
from pips_drake.serpentine.systems.actuator_angle_map import ActuatorAngleMap
from pips_drake.serpentine.systems.actuator_force_map import ActuatorForceMap
from pips_drake.serpentine.systems.actuator_servo import ActuatorServo
from pips_drake.serpentine.systems.deflection_compensator import DeflectionCompensator

Array = NDArray[np.float64]


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


def _standing_posture(arm: SerpentineArm, command: Array, gravity: Array) -> Array:
    """Where the arm stands still when its joints are commanded to `command`, (J,)."""
    stiffness, posture = joint_stiffness(arm), command
    # Each step changes the sag by the sag's own share of the levers: a thousandth.
    for _ in range(4):
        posture = command - holding_efforts(arm, posture, gravity)[0] / stiffness
    return posture
