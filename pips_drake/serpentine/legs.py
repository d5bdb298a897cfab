"""Actuators as two-part legs between their pins: where they stand, and what they weigh.

A leg is a tube on a universal joint at the inner pin and a rod that slides out of it to the outer
pin (`truss.actuator_pins`). Its coordinates are the universal joint's two angles and the length
from pin to pin. The legs' masses are part of the segments' (the arm file's are "with two
actuators"); `lightened` takes them out, so that arm and legs together weigh the same.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.kinematics import frames
from pips_drake.serpentine.truss import ROD_RADIUS, TUBE_RADIUS, actuator_pins

Array = NDArray[np.float64]

#: Mass of an actuator as a share of that of the segment on its inner side. Assumed.
MASS_SHARE = 0.05
#: Length of tube and of rod as a share of the actuator's longest: they overlap at full stroke, and
#: neither reaches past the other's pin when retracted.
PART_LENGTH = 0.52


@dataclass(frozen=True, kw_only=True)
class Legs:
    """The actuators L3 .. as bodies; arrays have a row an actuator.

    Attributes:
        inner_pin: in the inner body's frame, (A, 3) m.
        outer_pin: in the outer body's frame, (A, 3) m.
        rotation: R_BF (A, 3, 3) of the universal joint's frame in the inner body: x along the
            hinge, z along the leg where the hinge is straight.
        mass: of a leg, half of it the tube, (A,) kg.
        part_length: of tube and of rod, (A,) m.
        tube_radius, rod_radius: (A,) m.
    """

    inner_pin: Array
    outer_pin: Array
    rotation: Array
    mass: Array
    part_length: Array
    tube_radius: Array
    rod_radius: Array


def make_legs(arm: SerpentineArm) -> Legs:
    """The legs of an arm."""
    inner, outer = actuator_pins(arm)
    masses = [arm.bodies[owner].mass for owner, _ in _owners(arm)]
    relative = _frames_in_inner_bodies(arm, np.zeros(arm.joints))[0]
    along = _in_inner_bodies(relative, outer) - inner
    z = along / np.linalg.norm(along, axis=1, keepdims=True)
    x = relative[:, :3, 2]  # the hinge, square to the leg
    reach = arm.linkage.anchor_inner
    return Legs(
        inner_pin=inner,
        outer_pin=outer,
        rotation=np.stack([x, np.cross(z, x), z], axis=2),
        mass=MASS_SHARE * np.array(masses),
        part_length=PART_LENGTH * arm.linkage.length_upper,
        tube_radius=TUBE_RADIUS * reach,
        rod_radius=ROD_RADIUS * reach,
    )


def leg_coordinates(arm: SerpentineArm, joints: ArrayLike) -> Array:
    """Universal joint's angles (rad) and length (m) of every leg, (N, A, 3), at joints (N, J)."""
    legs = make_legs(arm)
    relative = _frames_in_inner_bodies(arm, joints)
    along = _in_inner_bodies(relative, legs.outer_pin) - legs.inner_pin
    x, y, z = np.moveaxis(np.einsum("aji,naj->nai", legs.rotation, along), -1, 0)
    # First about x, then about the new y: z turns into (sin b, -sin a cos b, cos a cos b).
    length = np.linalg.norm(along, axis=-1)
    return np.stack([np.arctan2(-y, z), np.arcsin(x / length), length], axis=-1)


def lightened(arm: SerpentineArm) -> SerpentineArm:
    """The arm without its legs' masses: a tube was part of the segment it hangs on, a rod of the
    one it moves, so that the weight stays where it was."""
    bodies, legs = list(arm.bodies), make_legs(arm)
    for owners, mass in zip(_owners(arm), legs.mass, strict=True):
        for owner in owners:
            bodies[owner] = replace(bodies[owner], mass=bodies[owner].mass - 0.5 * float(mass))
    return replace(arm, bodies=tuple(bodies))


def _owners(arm: SerpentineArm) -> list[tuple[int, int]]:
    """Indices of the bodies in whose masses each tube and each rod are counted.

    A crosshead weighs too little: its legs' parts are counted in the segments beyond.
    """
    first = arm.first_actuated_joint
    is_crosshead = [body.name.startswith("crosshead") for body in arm.bodies]
    return [
        (j - 2 if is_crosshead[j - 1] else j - 1, j + 1 if is_crosshead[j] else j)
        for j in range(first, arm.joints)
    ]


def _frames_in_inner_bodies(arm: SerpentineArm, joints: ArrayLike) -> Array:
    """Pose of each leg's outer body in its inner one, (N, A, 4, 4)."""
    poses, first = frames(arm, joints), arm.first_actuated_joint
    relative: Array = np.linalg.solve(poses[:, first - 1 : -1], poses[:, first:])
    return relative


def _in_inner_bodies(relative: Array, outer: Array) -> Array:
    """Outer pins in the inner bodies, (..., A, 3) m."""
    points: Array = np.einsum("...aij,aj->...ai", relative[..., :3, :3], outer)
    return points + relative[..., :3, 3]
