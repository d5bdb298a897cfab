"""The arm file's schema: what stands in `models/arms/*.yaml`, with the units of its keys.

Only reading and refusing happen here; `arm.py` turns an `ArmFile` into a `SerpentineArm` in SI.
"""

import re
from dataclasses import dataclass, field
from typing import Literal, get_args

from pips_drake.config import require, require_positive
from pips_drake.units import JOINT_UNITS

BaseKind = Literal["rail_crane", "gimbal"]


@dataclass
class MotionBaseConfig:
    """`kind` says which of the lengths count: rail_crane a0, a2, d2, d3; gimbal a0 alone."""

    kind: str = "rail_crane"
    a0_in: float = 0.0
    a2_in: float = 0.0
    d2_in: float = 0.0
    d3_in: float = 0.0

    def validate(self) -> None:
        kinds = get_args(BaseKind)
        require(self.kind in kinds, "motion_base.kind", self.kind, "one of " + ", ".join(kinds))


@dataclass
class SegmentConfig:
    """One segment: its DH length S_i, the offset Delta_i at its outer end, and its box."""

    length_in: float = 0.0
    offset_in: float = 0.0
    box: str = ""

    def validate(self) -> None:
        require_positive(self, "length_in")
        require(self.offset_in >= 0.0, "segments.offset_in", self.offset_in, ">= 0")
        require(self.offset_in < self.length_in, "segments.offset_in", self.offset_in, "< length")


@dataclass
class JointConfig:
    """A joint's home and limits, in `unit` (in, m, deg or rad)."""

    name: str = ""
    unit: str = "deg"
    home: float = 0.0
    lower: float = 0.0
    upper: float = 0.0

    def validate(self) -> None:
        units = ", ".join(JOINT_UNITS)
        require(self.unit in JOINT_UNITS, f"joints.{self.name}.unit", self.unit, f"one of {units}")
        require(self.lower < self.upper, f"joints.{self.name}.lower", self.lower, "< upper")
        inside = self.lower <= self.home <= self.upper
        require(inside, f"joints.{self.name}.home", self.home, "between lower and upper")


@dataclass
class BoxConfig:
    """A truss box and the actuator across the hinges at its outer end."""

    width_in: float = 0.0
    mass_kg: float = 0.0
    anchor_inner_in: float = 0.0
    anchor_outer_in: float = 0.0
    pin_angle_deg: float = 90.0
    actuator_stiffness_N_per_m: float = 0.0
    actuator_force_limit_N: float = 0.0
    actuator_speed_limit_mm_per_s: float = 0.0

    def validate(self) -> None:
        require_positive(
            self,
            "width_in",
            "mass_kg",
            "anchor_inner_in",
            "anchor_outer_in",
            "actuator_stiffness_N_per_m",
            "actuator_force_limit_N",
            "actuator_speed_limit_mm_per_s",
        )
        require(
            0.0 < self.pin_angle_deg < 180.0, "pin_angle_deg", self.pin_angle_deg, "in (0, 180)"
        )


@dataclass
class LinearDriveConfig:
    """The rail's ball screw."""

    stiffness_N_per_m: float = 0.0
    force_limit_N: float = 0.0
    speed_limit_mm_per_s: float = 0.0
    overtravel_mm: float = 0.0

    def validate(self) -> None:
        require_positive(self, "stiffness_N_per_m", "force_limit_N", "speed_limit_mm_per_s")
        require(self.overtravel_mm >= 0.0, "d1.overtravel_mm", self.overtravel_mm, ">= 0")


@dataclass
class RotaryDriveConfig:
    """The crane's hinge."""

    stiffness_Nm_per_rad: float = 0.0
    torque_limit_Nm: float = 0.0
    speed_limit_deg_per_s: float = 0.0
    overtravel_deg: float = 0.0

    def validate(self) -> None:
        require_positive(self, "stiffness_Nm_per_rad", "torque_limit_Nm", "speed_limit_deg_per_s")
        require(self.overtravel_deg >= 0.0, "theta2.overtravel_deg", self.overtravel_deg, ">= 0")


@dataclass
class MotionBaseDrivesConfig:
    """Drives of the base's first two joints."""

    d1: LinearDriveConfig = field(default_factory=LinearDriveConfig)
    theta2: RotaryDriveConfig = field(default_factory=RotaryDriveConfig)


@dataclass
class CarriageConfig:
    """The carriage on the rail: a box (along x0, y0, z0) around frame 1."""

    mass_kg: float = 0.0
    size_in: list[float] = field(default_factory=list)

    def validate(self) -> None:
        require_positive(self, "mass_kg")
        good = len(self.size_in) == 3 and min(self.size_in) > 0.0
        require(good, "carriage.size_in", self.size_in, "three lengths > 0")


@dataclass
class CraneConfig:
    """The crane link between hinge 2 and the arm."""

    mass_kg: float = 0.0
    width_in: float = 0.0

    def validate(self) -> None:
        require_positive(self, "mass_kg", "width_in")


@dataclass
class RailConfig:
    """The rail: a square bar along z0, from start_in to end_in."""

    width_in: float = 0.0
    start_in: float = 0.0
    end_in: float = 0.0

    def validate(self) -> None:
        require_positive(self, "width_in")
        require(self.start_in < self.end_in, "rail.start_in", self.start_in, "< rail.end_in")


@dataclass
class CameraHeadConfig:
    """The head beyond the last joint's frame: a square bar along its X.

    anchor_in is how far both pins of the last joint's actuator are from its hinge.
    """

    mass_kg: float = 0.0
    length_in: float = 0.0
    width_in: float = 0.0
    anchor_in: float = 0.0

    def validate(self) -> None:
        require_positive(self, "mass_kg", "length_in", "width_in", "anchor_in")


@dataclass
class ArmFile:
    """An arm as `models/arms/NAME.yaml` states it; see `models/arms/prototype.yaml`."""

    name: str = ""
    mirrored: bool = False
    rail_is_placed_for_the_path: bool = False
    motion_base: MotionBaseConfig = field(default_factory=MotionBaseConfig)
    segments: list[SegmentConfig] = field(default_factory=list)
    joints: list[JointConfig] = field(default_factory=list)
    boxes: dict[str, BoxConfig] = field(default_factory=dict)
    spine_offset_fraction: float = 0.0
    actuator_overtravel_mm: float = 0.0
    actuator_damping_time_s: float = 0.0
    drive_acceleration_time_s: float = 0.0
    motion_base_drives: MotionBaseDrivesConfig = field(default_factory=MotionBaseDrivesConfig)
    short_link_mass_kg: float = 0.0
    carriage: CarriageConfig = field(default_factory=CarriageConfig)
    crane: CraneConfig = field(default_factory=CraneConfig)
    rail: RailConfig = field(default_factory=RailConfig)
    camera_head: CameraHeadConfig = field(default_factory=CameraHeadConfig)

    def validate(self) -> None:
        # It names the model in SDF, and the file that `pips export` writes.
        good = re.fullmatch(r"[A-Za-z0-9][\w.-]*", self.name, re.ASCII) is not None
        require(good, "name", repr(self.name), "a word of letters, digits, _, - and .")
        require(len(self.segments) >= 2, "segments", len(self.segments), "two or more")
        for segment in self.segments:
            known = ", ".join(sorted(self.boxes))
            require(segment.box in self.boxes, "segments.box", segment.box, f"one of {known}")
        joints = 2 * len(self.segments) + 2
        require(len(self.joints) == joints, "rows in joints", len(self.joints), f"{joints}")
        require_positive(
            self, "short_link_mass_kg", "actuator_damping_time_s", "drive_acceleration_time_s"
        )
        require(
            self.actuator_overtravel_mm >= 0.0,
            "actuator_overtravel_mm",
            self.actuator_overtravel_mm,
            ">= 0",
        )
        inside = 0.0 <= self.spine_offset_fraction < 0.5
        require(inside, "spine_offset_fraction", self.spine_offset_fraction, "in [0, 0.5)")
