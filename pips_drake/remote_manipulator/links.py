"""The machine as links and joints: masses, inertias and shapes of what the SDF files state.

Link frames are the machine's own: {R} of stand and orbiter, {0}, {1}, {2} and {K} of the arm (see
`geometry`). The joints' positions are the arm vector: height of the shoulder (m), the six angles
(rad), gap between the fingers' inner faces (m). Every joint has its child's axes at zero along its
parent's, so that the rotations are those of `kinematics`.

Hard stops are `STOP` beyond the limits: what is commanded to a limit does not press on a stop.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from pips_drake.remote_manipulator.configuration import RemoteManipulatorConfig
from pips_drake.remote_manipulator.drives import ARM_JOINTS, Drives, make_drives, prism_unit_moments
from pips_drake.remote_manipulator.geometry import (
    DARK,
    GREY,
    WHITE,
    Part,
    Triple,
    bay_parts,
    cae_parts,
    effector_parts,
    payload_parts,
    prong_part,
)
from pips_drake.remote_manipulator.orbiter_outline import orbiter_parts

#: Hard stops stand so far beyond the limits, m or rad.
STOP = 0.005
#: From a joint's middle to where its housing ends and the tube begins, by the arm's diameter.
HOUSING = 0.55
#: Turns a cylinder, which stands along z, to lie along x and y.
ALONG_X: Triple = (0.0, 0.5 * math.pi, 0.0)
ALONG_Y: Triple = (0.5 * math.pi, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class Joint:
    """What holds a link to its parent, with its drive.

    Attributes:
        name: one of `ARM_JOINTS`.
        slides: prismatic rather than revolute.
        parent: the parent link's name.
        offset: the child's origin in the parent's frame at joint value zero, m.
        axis: in both frames.
        lower, upper: hard stops, m or rad.
        effort, rate: limits, N or N m, m/s or rad/s.
        stiffness, damping: of the drive, N/m or N m/rad, times s.
    """

    name: str
    slides: bool
    parent: str
    offset: Triple
    axis: Triple
    lower: float
    upper: float
    effort: float
    rate: float
    stiffness: float
    damping: float


@dataclass(frozen=True, kw_only=True)
class Link:
    """A rigid body.

    Attributes:
        name: letters and underscores.
        mass: kg.
        centre: of mass, m.
        moments: of inertia about the centre, kg m^2; the link's axes are principal.
        parts: its shapes.
        joint: to its parent; None for a model's first link.
    """

    name: str
    mass: float
    centre: Triple
    moments: Triple
    parts: tuple[Part, ...]
    joint: Joint | None = None


def arm_links(config: RemoteManipulatorConfig) -> tuple[Link, ...]:
    """Stand, arm and effector; the first link is fixed to the deck, at {R}."""
    arm, stand, effector = config.arm, config.stand, config.effector
    drives, thick = make_drives(config), arm.diameter_m
    inner, housing = 0.84 * thick, HOUSING * thick
    limits = [(stand.lower_m, stand.upper_m), *zip(arm.lower, arm.upper, strict=True)]
    limits.append((effector.prong_closed_gap_m, effector.prong_open_gap_m))

    def joint(index: int, parent: str, axis: Triple, offset: Triple = (0.0, 0.0, 0.0)) -> Joint:
        return _make_joint(drives, index, parent, axis, offset, limits[index])

    # The stand's fixed tube ends below the shoulder's housing when that is lowest. The inner tube
    # stays in it for a shoulder's height when it is highest; lowered, it reaches below the deck.
    top = stand.lower_m - 2.0 * thick
    travel = stand.upper_m - stand.lower_m
    tube = travel + 2.0 * thick
    stand_tube = _upright("tube", thick, -top, 0.0, WHITE)
    inner_tube = _upright("inner_tube", inner, thick, thick + tube, GREY)
    tube_0 = _lying("tube", thick, housing, arm.arm_0_m - housing, WHITE)
    tube_1 = _lying("tube", thick, housing, arm.arm_1_m - housing, WHITE)
    roll = _lying("roll_tube", 0.84 * thick, 0.45 * thick, arm.arm_2_m, WHITE)
    palm, finger = effector_parts(effector, arm.arm_2_m)
    prong = prong_part(effector, arm.arm_2_m)
    flange = _upright("flange", 1.55 * thick, -0.1, 0.0, DARK)
    # The heading drive turns round the inner tube's head.
    neck = _upright("neck", 1.1 * thick, 0.3 * thick, 1.2 * thick, GREY)
    turret = _across("turret", 1.3 * thick, 1.5 * thick, 0.0, DARK)
    elbow = _across("elbow", 1.3 * thick, 1.4 * thick, 0.0, DARK)
    wrist_0 = _upright("heading", 0.95 * thick, -0.62 * thick, 0.62 * thick, GREY)
    wrist_1 = _across("pitch", 0.9 * thick, 1.3 * thick, 0.0, DARK)
    z, y, x = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)
    half_wrist = 0.5 * arm.wrist_mass_kg
    half_stand = 0.5 * stand.mass_kg
    return (
        _tube_link("stand", half_stand, stand_tube, (flange,)),
        replace(
            _tube_link("telescope", half_stand, inner_tube),
            joint=joint(0, "stand", (0.0, 0.0, -1.0)),
        ),
        replace(
            _tube_link("shoulder", arm.shoulder_mass_kg, turret, (neck,)),
            joint=joint(1, "telescope", z),
        ),
        replace(
            _tube_link("arm_0", arm.arm_0_mass_kg, tube_0, _bands(config, "0", tube_0)),
            joint=joint(2, "shoulder", y),
        ),
        replace(
            _tube_link("arm_1", arm.arm_1_mass_kg, tube_1, (elbow, *_bands(config, "1", tube_1))),
            joint=joint(3, "arm_0", y, (arm.arm_0_m, 0.0, 0.0)),
        ),
        replace(
            _tube_link("wrist_heading", half_wrist, wrist_0),
            joint=joint(4, "arm_1", z, (arm.arm_1_m, 0.0, 0.0)),
        ),
        replace(
            _tube_link("wrist_pitch", half_wrist, wrist_1),
            joint=joint(5, "wrist_heading", y),
        ),
        replace(
            _tube_link("effector", arm.effector_mass_kg, roll, (palm, finger)),
            joint=joint(6, "wrist_pitch", x),
        ),
        replace(
            _box_link("prong", effector.prong_mass_kg, prong),
            # The joint's position is the gap, not where {K} is (`geometry.prong_position`).
            joint=joint(7, "effector", y, (0.0, -effector.finger_offset_m, 0.0)),
        ),
    )


def payload_link(config: RemoteManipulatorConfig) -> Link:
    """The payload, at {P}: a uniform prism; bar and probe have no mass of their own."""
    payload = config.payload
    along, across = prism_unit_moments(payload.across_flats_m, payload.length_m)
    mass = payload.mass_kg
    # Bands of paint, so that one sees it turn.
    bands = tuple(
        Part(
            name=f"band_{k}",
            kind="prism",
            size=(payload.across_flats_m + 0.01, 0.3),
            position=(at * payload.length_m, 0.0, 0.0),
            color=color,
            solid=False,
        )
        for k, (at, color) in enumerate(((-0.47, DARK), (-0.25, WHITE), (0.25, WHITE)))
    )
    return Link(
        name="payload",
        mass=mass,
        centre=(0.0, 0.0, 0.0),
        moments=(mass * along, mass * across, mass * across),
        parts=(*payload_parts(config), *bands),
    )


def bay_link(config: RemoteManipulatorConfig) -> Link:
    """The cargo bay, at {R}: walls and floor. Its mass is in the orbiter's."""
    return _fixed_link("cargo_bay", 1000.0, bay_parts(config))


def cae_link(config: RemoteManipulatorConfig) -> Link:
    """The central assembly element, at {C}: a uniform prism."""
    cae = config.central_assembly_element
    along, across = prism_unit_moments(cae.across_flats_m, cae.height_m)
    mass = cae.mass_kg
    return Link(
        name="cae",
        mass=mass,
        centre=(0.0, 0.0, 0.0),
        moments=(mass * across, mass * across, mass * along),
        parts=cae_parts(config),
    )


def orbiter_link(config: RemoteManipulatorConfig) -> Link:
    """The orbiter without its bay, at {R}. It never turns: its inertia is a sphere's of 10 m."""
    return _fixed_link("orbiter", config.orbiter.mass_kg, orbiter_parts(config))


def _make_joint(
    drives: Drives,
    index: int,
    parent: str,
    axis: Triple,
    offset: Triple,
    limits: tuple[float, float],
) -> Joint:
    name = ARM_JOINTS[index]
    return Joint(
        name=name,
        slides=name in ("height", "gap"),
        parent=parent,
        offset=offset,
        axis=axis,
        lower=float(limits[0]) - STOP,
        upper=float(limits[1]) + STOP,
        effort=float(drives.effort[index]),
        rate=float(drives.rate[index]),
        stiffness=float(drives.stiffness[index]),
        damping=float(drives.damping[index]),
    )


def _upright(name: str, diameter: float, low: float, high: float, color: Triple) -> Part:
    """A cylinder along z, between two values of z."""
    middle = (0.0, 0.0, 0.5 * (low + high))
    size = (diameter, high - low)
    return Part(name=name, kind="cylinder", size=size, position=middle, color=color)


def _lying(name: str, diameter: float, low: float, high: float, color: Triple) -> Part:
    """A cylinder along x, between two values of x."""
    middle = (0.5 * (low + high), 0.0, 0.0)
    size = (diameter, high - low)
    return Part(name=name, kind="cylinder", size=size, position=middle, rpy=ALONG_X, color=color)


def _across(name: str, diameter: float, length: float, x: float, color: Triple) -> Part:
    """A cylinder along y."""
    middle, size = (x, 0.0, 0.0), (diameter, length)
    return Part(name=name, kind="cylinder", size=size, position=middle, rpy=ALONG_Y, color=color)


def _bands(config: RemoteManipulatorConfig, frame: str, tube: Part) -> tuple[Part, ...]:
    """What is only seen on a tube: rings at its ends, cameras behind where they look from."""
    thick, length = tube.size
    middle = tube.position[0]
    ends = (middle - 0.5 * length + 0.15, middle + 0.5 * length - 0.15)
    rings = [
        replace(
            _lying(f"band_{k}", 1.06 * thick, x - 0.15, x + 0.15, GREY),
            solid=False,
        )
        for k, x in enumerate(ends)
    ]
    for station in config.cameras.stations:
        if station.frame == frame:
            x, y, z = station.position_m
            box = Part(
                name=f"band_camera_{station.name}",
                kind="box",
                size=(0.25, 0.16, 0.22),
                position=(x - 0.20, y, z - 0.07),
                color=DARK,
                solid=False,
            )
            rings.append(box)
    return tuple(rings)


def _tube_link(name: str, mass: float, tube: Part, others: tuple[Part, ...] = ()) -> Link:
    """A link with the mass of a thin-walled tube: m r^2 along, m (r^2 / 2 + l^2 / 12) across."""
    diameter, length = tube.size
    along = mass * (0.5 * diameter) ** 2
    across = 0.5 * along + mass * length**2 / 12.0
    moments = {
        ALONG_X: (along, across, across),
        ALONG_Y: (across, along, across),
    }.get(tube.rpy, (across, across, along))
    return Link(name=name, mass=mass, centre=tube.position, moments=moments, parts=(tube, *others))


def _box_link(name: str, mass: float, box: Part) -> Link:
    """A link with the mass of a uniform box."""
    x, y, z = (mass * side**2 / 12.0 for side in box.size)
    moments = (y + z, x + z, x + y)
    return Link(name=name, mass=mass, centre=box.position, moments=moments, parts=(box,))


def _fixed_link(name: str, mass: float, parts: tuple[Part, ...]) -> Link:
    moment = 0.4 * mass * 10.0**2
    return Link(name=name, mass=mass, centre=(0.0, 0.0, 0.0), moments=(moment,) * 3, parts=parts)
