"""What the machine is made of: one list of shapes for collision program, models and pictures.

Every solid is a box, a cylinder or an eight-sided prism. A prism is given to Drake as four boxes
turned by 45 deg, whose union it is exactly (the boxes are as wide as a side and as high as the
distance across flats), so that both see the same world without a mesh.

Frames as in `configuration`; besides, {K} is the prong's: along {2}, moving along y2, with its
origin on the effector's axis when the prong's inner face is there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pips_drake.remote_manipulator.configuration import EffectorConfig, RemoteManipulatorConfig

Array = NDArray[np.float64]
Triple = tuple[float, float, float]

#: Sides of payload and CAE (RMS-71, sections IV.A.3 and V).
SIDES = 8

WHITE: Triple = (0.86, 0.87, 0.88)
GREY: Triple = (0.55, 0.57, 0.60)
DARK: Triple = (0.24, 0.26, 0.30)
GOLD: Triple = (0.83, 0.66, 0.26)
BLUE: Triple = (0.20, 0.42, 0.66)
ORANGE: Triple = (0.84, 0.37, 0.0)
GREEN: Triple = (0.18, 0.55, 0.34)


@dataclass(frozen=True, kw_only=True)
class Part:
    """A solid, in its body's frame.

    Attributes:
        name: letters, digits, underscores; once a body.
        kind: box, cylinder (along its own z) or prism (along its own x, flats towards y and z).
        size: box: along x, y, z; cylinder: diameter, length; prism: across flats, length, m.
        position: of its middle, m.
        rpy: roll, pitch and yaw about the body's x, y and z, rad.
        color: red, green, blue, 0 to 1.
        solid: False for what is only seen.
    """

    name: str
    kind: str
    size: tuple[float, ...]
    position: Triple
    rpy: Triple = (0.0, 0.0, 0.0)
    color: Triple = WHITE
    solid: bool = True

    def boxes(self) -> tuple[Part, ...]:
        """The boxes whose union a prism is; the part itself if it is none."""
        if self.kind != "prism":
            return (self,)
        across, length = self.size
        side = across * math.tan(math.pi / SIDES)
        roll, pitch, yaw = self.rpy
        return tuple(
            replace(
                self,
                name=f"{self.name}_{k}",
                kind="box",
                size=(length, side, across),
                # Turned about the prism's own axis before it is turned into the body.
                rpy=(roll + k * 2.0 * math.pi / SIDES, pitch, yaw),
            )
            for k in range(SIDES // 2)
        )


def prism_corners(across_flats: float, length: float) -> Array:
    """The 16 vertices of an eight-sided prism along x, (16, 3) m: first those at -x."""
    angles = (np.arange(SIDES) + 0.5) * 2.0 * math.pi / SIDES
    radius = 0.5 * across_flats / math.cos(math.pi / SIDES)
    ring = radius * np.column_stack([np.cos(angles), np.sin(angles)])
    ends = [np.column_stack([np.full(SIDES, x), ring]) for x in (-0.5 * length, 0.5 * length)]
    return np.concatenate(ends)


def payload_parts(config: RemoteManipulatorConfig) -> tuple[Part, ...]:
    """The payload in {P}: `hull`, `probe` and `bar`."""
    payload, bar = config.payload, config.receptacle
    top = -0.5 * payload.across_flats_m
    probe = -0.5 * (payload.length_m + payload.probe_length_m)
    x, y = bar.location_m
    return (
        Part(
            name="hull",
            kind="prism",
            size=(payload.across_flats_m, payload.length_m),
            position=(0.0, 0.0, 0.0),
            color=GOLD,
        ),
        Part(
            name="probe",
            kind="box",
            size=(payload.probe_length_m, payload.probe_width_m, payload.probe_width_m),
            position=(probe, 0.0, 0.0),
            color=DARK,
        ),
        Part(
            name="bar",
            kind="box",
            size=(bar.length_m, bar.width_m, bar.height_m),
            position=(x, y, top - 0.5 * bar.height_m),
            color=ORANGE,
        ),
    )


def probe_tip(config: RemoteManipulatorConfig) -> Array:
    """The middle of the docking probe's end, (3,) m in {P}."""
    payload = config.payload
    return np.array([-0.5 * payload.length_m - payload.probe_length_m, 0.0, 0.0])


def docking_port(config: RemoteManipulatorConfig) -> Array:
    """The middle of the docking port, on face c, (3,) m in {C}."""
    cae = config.central_assembly_element
    return np.array([0.5 * cae.across_flats_m, 0.0, cae.port_offset_m])


def cae_parts(config: RemoteManipulatorConfig) -> tuple[Part, ...]:
    """The CAE in {C}: `core`, and the rim of its docking port to be seen."""
    cae = config.central_assembly_element
    x, _, z = docking_port(config)
    rim, width = 1.3 * config.payload.probe_width_m, 0.12
    core = Part(
        name="core",
        kind="prism",
        size=(cae.across_flats_m, cae.height_m),
        position=(0.0, 0.0, 0.0),
        rpy=(0.0, 0.5 * math.pi, 0.0),
        color=WHITE,
    )
    rims = tuple(
        Part(
            name=f"port_rim_{k}",
            kind="box",
            size=(0.02, *size),
            position=(x + 0.01, y, z + dz),
            color=GREEN,
            solid=False,
        )
        for k, (size, y, dz) in enumerate(
            (
                ((2.0 * rim, width), 0.0, rim),
                ((2.0 * rim, width), 0.0, -rim),
                ((width, 2.0 * rim), rim, 0.0),
                ((width, 2.0 * rim), -rim, 0.0),
            )
        )
    )
    return (core, *rims)


def effector_parts(effector: EffectorConfig, arm_2: float) -> tuple[Part, ...]:
    """The effector's fixed hexahedra in {2}: `palm` (EFF HEX 1) and `finger` (EFF HEX 2).

    Args:
        arm_2: from the wrist to the palm's top, m.
    """
    palm, finger = effector.palm, effector.finger
    return (
        Part(
            name="palm",
            kind="box",
            size=(palm.length_m, palm.width_m, palm.height_m),
            position=(arm_2 + 0.5 * palm.length_m, 0.0, 0.0),
            color=GREY,
        ),
        Part(
            name="finger",
            kind="box",
            size=(finger.length_m, finger.width_m, finger.height_m),
            position=(
                arm_2 + palm.length_m + 0.5 * finger.length_m,
                -effector.finger_offset_m - 0.5 * finger.width_m,
                0.0,
            ),
            color=BLUE,
        ),
    )


def prong_part(effector: EffectorConfig, arm_2: float) -> Part:
    """The movable prong (EFF HEX 3) in {K}; its inner face, e, is at y = 0."""
    finger = effector.finger
    return Part(
        name="prong",
        kind="box",
        size=(finger.length_m, finger.width_m, finger.height_m),
        position=(
            arm_2 + effector.palm.length_m + 0.5 * finger.length_m,
            0.5 * finger.width_m,
            0.0,
        ),
        color=ORANGE,
    )


def prong_position(effector: EffectorConfig, gap: float) -> float:
    """Where {K} is along y2 when the fingers' inner faces are `gap` m apart, m."""
    return gap - effector.finger_offset_m


def bay_parts(config: RemoteManipulatorConfig) -> tuple[Part, ...]:
    """The cargo bay in {R}: four walls and the floor, whose inner faces bound the bay."""
    bay = config.cargo_bay
    x, y, z = bay.location_m
    length, width, depth, wall = bay.length_m, bay.width_m, bay.depth_m, bay.wall_m
    middle, deep = x + 0.5 * length, z + 0.5 * depth
    side = 0.5 * (width + wall)
    # The floor reaches under the walls.
    around = (length + 2.0 * wall, width + 2.0 * wall, wall)
    return (
        _wall("wall_forward", (wall, width, depth), (x - 0.5 * wall, y, deep)),
        _wall("wall_aft", (wall, width, depth), (x + length + 0.5 * wall, y, deep)),
        _wall("wall_port", (length + 2.0 * wall, wall, depth), (middle, y + side, deep)),
        _wall("wall_starboard", (length + 2.0 * wall, wall, depth), (middle, y - side, deep)),
        _wall("floor", around, (middle, y, z + depth + 0.5 * wall)),
    )


def _wall(name: str, size: Triple, position: Triple) -> Part:
    return Part(name=name, kind="box", size=size, position=position, color=GREY)


def cabin_part(config: RemoteManipulatorConfig) -> Part:
    """The crew cabin's roof above the deck, ahead of the bay, in {R}."""
    orbiter, bay = config.orbiter, config.cargo_bay
    x, y, z = bay.location_m
    return Part(
        name="cabin",
        kind="box",
        size=(orbiter.cabin_length_m, orbiter.cabin_width_m, orbiter.cabin_height_m),
        # Two feet of deck between cabin and bay.
        position=(x - 0.6 - 0.5 * orbiter.cabin_length_m, y, z - 0.5 * orbiter.cabin_height_m),
        color=WHITE,
    )
