"""Actuators as bodies of the plant, in the fidelity `truss`: two-part legs that close loops."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from pydrake.geometry import Cylinder
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    ModelInstanceIndex,
    PdControllerGains,
    PrismaticJoint,
    RigidBody,
    SpatialInertia,
    UniversalJoint,
)
from pydrake.systems.framework import Context

from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.legs import leg_coordinates, make_legs
from pips_drake.serpentine.station.legs import remove_hinge_drives
from pips_drake.serpentine.systems.actuator_visualizer import ROD_COLOUR, TUBE_COLOUR


def legs_name(arm: SerpentineArm) -> str:
    """Name of the model that holds an arm's legs."""
    return f"{arm.name}_legs"


def AddPrismaticLegs(
    plant: MultibodyPlant, model: ModelInstanceIndex, arm: SerpentineArm
) -> ModelInstanceIndex:
    """Adds a tube and a rod for every actuator; the plant is not final yet.

    Each tube hangs on its inner body by a universal joint, its rod slides out of it, driven by an
    implicit PD of the actuator's stiffness within its force limit and stroke, and ends in a ball
    joint on the outer body, which closes the loop: a constraint. The drives of the hinges are taken
    out of the plant. The legs are drawn and weigh; they do not collide (nor do the drawn ones).

    Args:
        model: the arm, without the legs' masses (`legs.lightened`).
        arm: with them.

    Returns:
        the legs' own model, whose actuators are L3 .., in order.
    """
    remove_hinge_drives(plant, model, arm)
    instance = plant.AddModelInstance(legs_name(arm))
    legs, linkage, first = make_legs(arm), arm.linkage, arm.first_actuated_joint
    for k, name in enumerate(arm.actuator_names):
        inner, outer = (
            plant.GetBodyByName(arm.bodies[first + k - back].name, model) for back in (1, 0)
        )
        length, mass = float(legs.part_length[k]), 0.5 * float(legs.mass[k])
        radius = float(legs.tube_radius[k])
        # The tube lies ahead of its pin, the rod behind its own, both along z.
        tube = _add_part(plant, instance, f"{name}_tube", mass, radius, length, +1.0, TUBE_COLOUR)
        radius = float(legs.rod_radius[k])
        rod = _add_part(plant, instance, f"{name}_rod", mass, radius, length, -1.0, ROD_COLOUR)
        X_BF = RigidTransform(RotationMatrix(legs.rotation[k]), legs.inner_pin[k])
        pin = plant.AddFrame(FixedOffsetFrame(f"{name}_pin_frame", inner.body_frame(), X_BF))
        plant.AddJoint(UniversalJoint(f"{name}_pin", pin, tube.body_frame()))
        slide = plant.AddJoint(
            PrismaticJoint(
                name,
                tube.body_frame(),
                rod.body_frame(),
                [0.0, 0.0, 1.0],
                float(linkage.length_lower[k]),
                float(linkage.length_upper[k]),
            )
        )
        drive = plant.AddJointActuator(name, slide, float(linkage.force_limit[k]))
        stiffness = float(linkage.stiffness[k])
        gains = PdControllerGains(p=stiffness, d=stiffness * arm.actuator_damping_time)
        drive.set_controller_gains(gains)
        plant.AddBallConstraint(rod, np.zeros(3), outer, legs.outer_pin[k])
    return instance


def set_default_leg_positions(plant: MultibodyPlant, arm: SerpentineArm, joints: ArrayLike) -> None:
    """Lets the legs of a plant's default posture meet their pins at joint values (J,)."""
    positions = plant.GetDefaultPositions()
    _write_leg_positions(plant, arm, joints, positions)
    plant.SetDefaultPositions(positions)


def set_leg_positions(
    plant: MultibodyPlant, context: Context, arm: SerpentineArm, joints: ArrayLike
) -> None:
    """Lets the legs meet their pins in a plant's context, at joint values (J,)."""
    positions = plant.GetPositions(context)
    _write_leg_positions(plant, arm, joints, positions)
    plant.SetPositions(context, positions)


def _write_leg_positions(
    plant: MultibodyPlant, arm: SerpentineArm, joints: ArrayLike, positions: np.ndarray
) -> None:
    instance = plant.GetModelInstanceByName(legs_name(arm))
    for name, leg in zip(arm.actuator_names, leg_coordinates(arm, joints)[0], strict=True):
        start = plant.GetJointByName(f"{name}_pin", instance).position_start()
        positions[start : start + 2] = leg[:2]
        positions[plant.GetJointByName(name, instance).position_start()] = leg[2]


def _add_part(
    plant: MultibodyPlant,
    instance: ModelInstanceIndex,
    name: str,
    mass: float,
    radius: float,
    length: float,
    direction: float,
    colour: tuple[float, float, float, float],
) -> RigidBody:
    """A round bar from its frame's origin along z, or against it."""
    middle = RigidTransform([0.0, 0.0, 0.5 * direction * length])
    density = mass / (math.pi * radius**2 * length)
    about_middle = SpatialInertia.SolidCylinderWithDensity(density, radius, length, [0.0, 0.0, 1.0])
    body = plant.AddRigidBody(name, instance, about_middle.Shift(-middle.translation()))
    plant.RegisterVisualGeometry(body, middle, Cylinder(radius, length), name, np.array(colour))
    return body
