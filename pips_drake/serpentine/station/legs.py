"""Actuators between their pins, as the plant has them in the fidelity `leg`."""

from __future__ import annotations

import math

import numpy as np
from pydrake.multibody.plant import DistanceConstraintParams, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Context, Diagram, EventStatus

from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.truss import actuator_pins

#: The station's output ports that the server of the legs reads.
FREE_LENGTH = "leg_springs.free_length"
STIFFNESS_SHARE = "leg_springs.stiffness_share"


def AddLegSprings(plant: MultibodyPlant, model: ModelInstanceIndex, arm: SerpentineArm) -> None:
    """Adds a spring with damping between the pins of every actuator; the plant is not final yet.

    The drives of the hinges are taken out of the plant; those of the base stay.
    """
    remove_hinge_drives(plant, model, arm)
    inner_pins, outer_pins = actuator_pins(arm)
    linkage, first = arm.linkage, arm.first_actuated_joint
    lengths = linkage.length(arm.joint_home[first:])
    for k in range(len(arm.actuator_names)):
        inner, outer = arm.bodies[first + k - 1], arm.bodies[first + k]
        stiffness = float(linkage.stiffness[k])
        plant.AddDistanceConstraint(
            plant.GetBodyByName(inner.name, model),
            inner_pins[k],
            plant.GetBodyByName(outer.name, model),
            outer_pins[k],
            float(lengths[k]),
            stiffness=stiffness,
            damping=stiffness * arm.actuator_damping_time,
        )


def remove_hinge_drives(
    plant: MultibodyPlant, model: ModelInstanceIndex, arm: SerpentineArm
) -> None:
    """Takes the drives of all but the base's joints out of a plant that is not final yet."""
    for name in arm.joint_names[arm.first_actuated_joint :]:
        plant.RemoveJointActuator(plant.GetJointActuatorByName(name, model))


class LegServer:
    """Gives the plant's springs the free lengths, and shares of their stiffness, asked for.

    Only the plant's own context holds them, and no system may write there: a simulator calls
    `monitor` at the end of every step, when what the plant's next step will see is known. Latency:
    none beside that step.

    Args:
        station: with the fidelity `leg`; the simulated diagram itself or a part of it. One that
            asks for no shares of stiffness leaves them whole.
    """

    def __init__(self, station: Diagram) -> None:
        self._plant = station.GetSubsystemByName("plant")
        self._station = station
        self._port = station.GetOutputPort(FREE_LENGTH)
        self._share_port = None
        if station.HasOutputPort(STIFFNESS_SHARE):
            self._share_port = station.GetOutputPort(STIFFNESS_SHARE)
        default = self._plant.GetDefaultDistanceConstraintParams()
        # In the order of the actuators, in which they were added.
        self._ids = sorted(default, key=lambda number: number.get_value())
        self._fixed = [
            (p.bodyA(), p.p_AP(), p.bodyB(), p.p_BQ(), p.stiffness(), p.damping())
            for p in (default[number] for number in self._ids)
        ]
        if len(self._ids) != self._port.size():
            raise AssertionError(f"{len(self._ids)} springs for {self._port.size()} legs")

    def monitor(self, root_context: Context) -> EventStatus:
        """Grants the present request; what `Simulator.set_monitor` takes."""
        plant_context = self._plant.GetMyMutableContextFromRoot(root_context)
        mine = self._station.GetMyContextFromRoot(root_context)
        lengths = self._port.Eval(mine)
        shares = np.ones_like(lengths) if self._share_port is None else self._share_port.Eval(mine)
        for number, length, share, fixed in zip(
            self._ids, lengths.tolist(), shares.tolist(), self._fixed, strict=True
        ):
            if not (math.isfinite(length) and length > 0.0):
                continue  # `advance` gives a diverging run up; Drake would crash on this first
            body_a, pin_a, body_b, pin_b, stiffness, damping = fixed
            params = DistanceConstraintParams(
                body_a, pin_a, body_b, pin_b, length, share * stiffness, share * damping
            )
            self._plant.SetDistanceConstraintParams(plant_context, number, params)
        return EventStatus.DidNothing()
