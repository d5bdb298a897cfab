"""The serpentine arm as data: lengths, limits, masses and actuators, in SI units.

Spine points, modules and joints are numbered as in FTL-95, section 3.3.1: module i (from 1) reaches
from spine point j = 2 (i + 1) to j + 2 with the joints theta_j (even) and theta_{j+1} (odd), the
offset Delta_i and the length S_{i+1}. Arrays count from 0, base to tip.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pips_drake.config import load_yaml, require
from pips_drake.errors import InputError
from pips_drake.scene.packages import find_arm_file
from pips_drake.serpentine.arm_file import ArmFile
from pips_drake.serpentine.linkage import Linkage
from pips_drake.serpentine.motion_base import (
    PRISMATIC,
    REVOLUTE,
    GimbalBase,
    MotionBase,
    RailCraneBase,
)
from pips_drake.units import INCH, JOINT_UNITS

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Body:
    """A rigid body of the arm, a uniform box in its own joint's frame.

    Attributes:
        name: also its link name in the SDF.
        mass: kg.
        size: box edges along the frame's axes, (3,) m.
        centre: the box's middle in the frame, (3,) m; also the centre of mass.
    """

    name: str
    mass: float
    size: Array
    centre: Array

    @property
    def moments(self) -> Array:
        """Moments of inertia about the centre and the frame's axes, (3,) kg m^2."""
        square = self.size**2
        moments: Array = self.mass * (square[[1, 0, 0]] + square[[2, 2, 1]]) / 12.0
        return moments


@dataclass(frozen=True, kw_only=True)
class SerpentineArm:
    """A serpentine arm on a motion base. Load one with `load_arm`.

    With S segments it has S - 1 modules, S spine points under control and 2 S + 2 joints.

    Attributes:
        name: of the arm file.
        mirrored: the as-built hand; geometry is reflected in the x0-z0 plane, joint values are not.
        rail_is_placed_for_the_path: paths are shifted along the rail to begin at this arm's home
            tip (`anchoring`); else a path must begin where the arm can start.
        base: the motion base; its last joint moves segment 1.
        segment_length: S_i, (S,) m.
        segment_offset: Delta_i, (S,) m; the last is not part of the chain.
        joint_home, joint_lower, joint_upper: (joints,) m and rad.
        bodies: a body a joint, in joint order.
        rail: the fixed part of the base, in frame 0.
        linkage: actuators of joints 3 on, L3 on.
        base_stiffness, base_effort_limit, base_speed_limit: of the joints before those, (2,) N/m
            and Nm/rad, N and Nm, m/s and rad/s.
        base_overtravel: how far those can go beyond their limits, (2,) m and rad.
        actuator_damping_time: damping over stiffness, s.
        drive_acceleration_time: in which a drive reaches its full speed, s.
    """

    name: str
    mirrored: bool
    rail_is_placed_for_the_path: bool
    base: MotionBase
    segment_length: Array
    segment_offset: Array
    joint_home: Array
    joint_lower: Array
    joint_upper: Array
    bodies: tuple[Body, ...]
    rail: Body
    linkage: Linkage
    base_stiffness: Array
    base_effort_limit: Array
    base_speed_limit: Array
    base_overtravel: Array
    actuator_damping_time: float
    drive_acceleration_time: float

    @property
    def modules(self) -> int:
        """Number of modules."""
        return len(self.segment_length) - 1

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.joint_home)

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """`d1`, `theta2`, ... in order."""
        first = len(self.base.joint_names) + 1
        rest = tuple(f"theta{j}" for j in range(first, self.joints + 1))
        return self.base.joint_names + rest

    @cached_property
    def joint_columns(self) -> tuple[str, ...]:
        """Joint names with their SI unit, as in a CSV header."""
        return tuple(
            f"{name}_m" if prismatic else f"{name}_rad"
            for name, prismatic in zip(self.joint_names, self.is_prismatic, strict=True)
        )

    @cached_property
    def is_prismatic(self) -> NDArray[np.bool_]:
        """Which joints slide, (joints,)."""
        return self.dh_table[:, 4] == PRISMATIC

    @cached_property
    def actuator_names(self) -> tuple[str, ...]:
        """`L3`, `L4`, ... one a hinge of the truss."""
        return tuple(f"L{j}" for j in range(3, self.joints + 1))

    @property
    def first_actuated_joint(self) -> int:
        """Index of the first joint that a linkage moves (joint 3)."""
        return 2

    @cached_property
    def spine_indices(self) -> tuple[int, ...]:
        """FTL-95's numbers of the controlled spine points: 4, 6, ... (joint frames)."""
        return tuple(range(4, self.joints + 1, 2))

    @cached_property
    def dh_table(self) -> Array:
        """Craig's table (joints, 5): alpha, a, d offset, theta offset, kind (FTL-95 Table A.1)."""
        rows = [self.base.dh_rows()]
        for i in range(self.modules):
            even = [-math.pi / 2, self.segment_length[i], 0.0, 0.0, REVOLUTE]
            odd = [math.pi / 2, self.segment_offset[i], 0.0, 0.0, REVOLUTE]
            rows.append(np.array([even, odd]))
        rows.append(np.array([[-math.pi / 2, self.segment_length[-1], 0.0, 0.0, REVOLUTE]]))
        return np.concatenate(rows)

    @cached_property
    def chain(self) -> Array:
        """Delta_i and S_{i+1} of each module, (M, 2) m."""
        return np.column_stack([self.segment_offset[:-1], self.segment_length[1:]])

    @cached_property
    def odd_angle_limit(self) -> Array:
        """Largest |theta_O| that each module's limits allow, (M,) rad."""
        odd = slice(len(self.base.joint_names) + 1, self.joints - 1, 2)
        return np.maximum(np.abs(self.joint_lower[odd]), np.abs(self.joint_upper[odd]))

    @cached_property
    def module_length_range(self) -> tuple[Array, Array]:
        """Q_MIN and Q_MAX, (M,) m: Eq 3.4 at the odd joint's limit and at zero."""
        offset, length = self.chain.T
        cosine = np.cos(self.odd_angle_limit)
        shortest = np.sqrt(offset**2 + 2.0 * offset * length * cosine + length**2)
        return shortest, offset + length

    @cached_property
    def average_module_length(self) -> Array:
        """Q_AVG (M,) m, where the iteration starts (FTL-95 Table A.2)."""
        shortest, longest = self.module_length_range
        return 0.5 * (shortest + longest)

    @property
    def mirror(self) -> Array:
        """Signs (3,) that turn a point of the drawn hand into this arm's, and back."""
        return np.array([1.0, -1.0 if self.mirrored else 1.0, 1.0])


def load_arm(name: str | Path) -> SerpentineArm:
    """The arm of a shipped name (`prototype`) or of an arm file.

    Raises:
        InputError: unknown name, or a file that cannot be used; the message says what and where.
    """
    file = find_arm_file(str(name))
    config = load_yaml(ArmFile, file)
    try:
        return make_arm(config)
    except InputError as error:
        raise InputError(f"{file}: {error}") from None


def make_arm(config: ArmFile) -> SerpentineArm:
    """The arm that a (validated) arm file states, in SI units."""
    length = np.array([segment.length_in for segment in config.segments]) * INCH
    offset = np.array([segment.offset_in for segment in config.segments]) * INCH
    base = _make_base(config, float(length[0]))
    scale = np.array([JOINT_UNITS[joint.unit] for joint in config.joints])
    values = np.array([[j.home, j.lower, j.upper] for j in config.joints]) * scale[:, None]
    drives = config.motion_base_drives
    arm = SerpentineArm(
        name=config.name,
        mirrored=config.mirrored,
        rail_is_placed_for_the_path=config.rail_is_placed_for_the_path,
        base=base,
        segment_length=length,
        segment_offset=offset,
        joint_home=values[:, 0],
        joint_lower=values[:, 1],
        joint_upper=values[:, 2],
        bodies=_make_bodies(config, base),
        rail=_make_rail(config),
        linkage=_make_linkage(config, lower=values[2:, 1], upper=values[2:, 2]),
        base_stiffness=np.array([drives.d1.stiffness_N_per_m, drives.theta2.stiffness_Nm_per_rad]),
        base_effort_limit=np.array([drives.d1.force_limit_N, drives.theta2.torque_limit_Nm]),
        base_speed_limit=np.array(
            [
                drives.d1.speed_limit_mm_per_s * 1e-3,
                math.radians(drives.theta2.speed_limit_deg_per_s),
            ]
        ),
        base_overtravel=np.array(
            [drives.d1.overtravel_mm * 1e-3, math.radians(drives.theta2.overtravel_deg)]
        ),
        actuator_damping_time=config.actuator_damping_time_s,
        drive_acceleration_time=config.drive_acceleration_time_s,
    )
    for joint, name, prismatic in zip(
        config.joints, arm.joint_names, arm.is_prismatic, strict=True
    ):
        require(joint.name == name, "joints.name", joint.name, f"{name}, in order")
        units = ("in", "m") if prismatic else ("deg", "rad")
        require(joint.unit in units, f"joints.{name}.unit", joint.unit, " or ".join(units))
    return arm


def _make_base(config: ArmFile, first_length: float) -> MotionBase:
    base = config.motion_base
    if base.kind == "gimbal":
        return GimbalBase(offset=base.a0_in * INCH, first_length=first_length)
    return RailCraneBase(
        a0=base.a0_in * INCH,
        a2=base.a2_in * INCH,
        d2=base.d2_in * INCH,
        d3=base.d3_in * INCH,
        first_length=first_length,
    )


def _make_linkage(config: ArmFile, *, lower: Array, upper: Array) -> Linkage:
    """An actuator across each hinge from joint 3 on, of the inner segment's size."""
    inner = [max(0, (joint - 4) // 2) for joint in range(3, 3 + len(lower))]
    boxes = [config.boxes[config.segments[i].box] for i in inner]
    # The pins, the hinge and the actuator are a triangle at every angle of the stroke.
    pins = np.radians([box.pin_angle_deg for box in boxes])
    for j in np.flatnonzero((pins + lower <= 0.0) | (pins + upper >= np.pi)):
        name, straight = config.joints[2 + j].name, boxes[j].pin_angle_deg
        raise InputError(
            f"joints.{name}: limits {math.degrees(lower[j]):g} .. {math.degrees(upper[j]):g} deg; "
            f"must be inside {-straight:g} .. {180.0 - straight:g} deg, where its actuator's pins "
            "and the hinge are in line"
        )
    anchors = np.array([[box.anchor_inner_in, box.anchor_outer_in] for box in boxes]) * INCH
    # The last one's pins must fit into the camera head.
    anchors[-1] = config.camera_head.anchor_in * INCH
    return Linkage.make(
        anchor_inner=anchors[:, 0],
        anchor_outer=anchors[:, 1],
        pin_angle=np.radians([box.pin_angle_deg for box in boxes]),
        stiffness=np.array([box.actuator_stiffness_N_per_m for box in boxes]),
        force_limit=np.array([box.actuator_force_limit_N for box in boxes]),
        speed_limit=np.array([box.actuator_speed_limit_mm_per_s for box in boxes]) * 1e-3,
        angle_lower=lower,
        angle_upper=upper,
        overtravel=config.actuator_overtravel_mm * 1e-3,
    )


def _make_bodies(config: ArmFile, base: MotionBase) -> tuple[Body, ...]:
    """A uniform box for each joint's body, in the joint's frame."""
    carriage = Body(
        name=base.body_names[0],
        mass=config.carriage.mass_kg,
        size=np.array(config.carriage.size_in) * INCH,
        # From the rail (x0 = 0) to the hinge: frame 1 stands a0 away from the rail.
        centre=np.array([-0.5 * config.motion_base.a0_in * INCH, 0.0, 0.0]),
    )
    # From hinge 2 to where the arm begins: frame 3 in frame 2.
    alpha, reach, lift = base.dh_rows()[2, :3]
    arm_begin = np.array([reach, -math.sin(alpha) * lift, math.cos(alpha) * lift])
    crane = Body(
        name=base.body_names[1],
        mass=config.crane.mass_kg,
        size=np.maximum(np.abs(arm_begin), config.crane.width_in * INCH),
        centre=0.5 * arm_begin,
    )
    bodies = [carriage, crane]
    for i, segment in enumerate(config.segments):
        box = config.boxes[segment.box]
        width, length = box.width_in * INCH, segment.length_in * INCH
        aside = config.spine_offset_fraction * width
        bodies.append(
            Body(
                name=f"segment_{i + 1}",
                mass=box.mass_kg,
                size=np.array([length, width, width]),
                centre=np.array([0.5 * length, -aside, aside]),
            )
        )
        if i + 1 < len(config.segments):
            offset = segment.offset_in * INCH
            # A crosshead as wide as half the box; never thinner than an inch, so that an arm
            # without offsets has a body with inertia there too.
            bodies.append(
                Body(
                    name=f"crosshead_{i + 1}",
                    mass=config.short_link_mass_kg,
                    size=np.array([max(offset, INCH), 0.5 * width, 0.5 * width]),
                    centre=np.array([0.5 * offset, 0.0, 0.0]),
                )
            )
    head = config.camera_head
    bodies.append(
        Body(
            name="camera_head",
            mass=head.mass_kg,
            size=np.array([head.length_in, head.width_in, head.width_in]) * INCH,
            centre=np.array([0.5 * head.length_in * INCH, 0.0, 0.0]),
        )
    )
    return tuple(bodies)


def _make_rail(config: ArmFile) -> Body:
    rail = config.rail
    length, middle = rail.end_in - rail.start_in, 0.5 * (rail.end_in + rail.start_in)
    return Body(
        name="rail",
        mass=1.0,  # welded to the world: its mass moves nothing
        size=np.array([rail.width_in, rail.width_in, length]) * INCH,
        centre=np.array([0.0, 0.0, middle]) * INCH,
    )
