"""A cable robot's file: what it is made of, where its cables are fixed, what they can bear."""
# Annotations must be real types here: pydrake's YAML reader does not resolve strings.

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pips_drake.cable_robot.kinematics import Poses
from pips_drake.cable_robot.robot import PLANAR, SPATIAL, CableRobot
from pips_drake.config import load_yaml, require, require_positive
from pips_drake.errors import InputError
from pips_drake.scene.packages import find_file

Array = NDArray[np.float64]


def _require_point(owner: object, *names: str) -> None:
    for name in names:
        value = getattr(owner, name)
        require(len(value) == 3, f"{type(owner).__name__}.{name}", value, "three numbers")


@dataclass
class CableConfig:
    """Where one cable is fixed."""

    # Its outer end, in the world.
    anchor_m: list[float] = field(default_factory=list)
    # Its inner end, in the platform's frame.
    attachment_m: list[float] = field(default_factory=list)

    def validate(self) -> None:
        _require_point(self, "anchor_m", "attachment_m")


@dataclass
class PlatformConfig:
    """What hangs on the cables. Its frame lies in the middle of its box."""

    size_m: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    mass_kg: float = 0.0
    centre_of_mass_m: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])

    def validate(self) -> None:
        _require_point(self, "size_m", "centre_of_mass_m")
        require(min(self.size_m) >= 0.0, "PlatformConfig.size_m", self.size_m, ">= 0")
        require_positive(self, "mass_kg")


@dataclass
class RopeConfig:
    """What all cables are made of."""

    material: str = ""
    diameter_mm: float = 0.0
    # E A: tension over strain.
    axial_stiffness_N: float = 0.0
    mass_per_length_kg_m: float = 0.0
    # Bounds of the tension: kept taut by the first, safe and within the winch's force by the other.
    tension_min_N: float = 0.0
    tension_max_N: float = 0.0

    def validate(self) -> None:
        require_positive(self, "diameter_mm", "axial_stiffness_N", "tension_max_N")
        value = f"{self.mass_per_length_kg_m:g} kg/m"
        require(self.mass_per_length_kg_m >= 0.0, "RopeConfig.mass_per_length_kg_m", value, ">= 0")
        good = 0.0 <= self.tension_min_N < self.tension_max_N
        shown = f"{self.tension_min_N:g} .. {self.tension_max_N:g} N"
        require(good, "RopeConfig: tension bounds", shown, "rising, from 0 or more")


@dataclass
class WinchConfig:
    """What reels the cables, and how well the lengths are known."""

    speed_m_s: float = 0.5
    # Steps of the encoder, as length of cable, and of the force sensor.
    encoder_step_mm: float = 0.1
    force_step_N: float = 1.0
    # What calibration leaves: a length is off by no more than this, always by the same.
    length_error_mm: float = 1.0

    def validate(self) -> None:
        require_positive(self, "speed_m_s")
        for name in ("encoder_step_mm", "force_step_N", "length_error_mm"):
            value = getattr(self, name)
            most = 1e4 if name == "force_step_N" else 100.0
            require(0.0 <= value <= most, f"WinchConfig.{name}", f"{value:g}", f"0 .. {most:g}")


@dataclass
class RegionConfig:
    """The box that the platform's origin must stay in, in the world."""

    lower_m: list[float] = field(default_factory=list)
    upper_m: list[float] = field(default_factory=list)

    def validate(self) -> None:
        _require_point(self, "lower_m", "upper_m")
        good = all(low <= high for low, high in zip(self.lower_m, self.upper_m, strict=True))
        require(good, "RegionConfig", f"{self.lower_m} .. {self.upper_m}", "rising")


@dataclass
class CableRobotConfig:
    """A robot's file (`models/cable_robots`)."""

    name: str = ""
    # Where the numbers come from, and which are assumed.
    source: str = ""
    # Moves in x and y and turns about z alone.
    planar: bool = False
    gravity_m_s2: list[float] = field(default_factory=lambda: [0.0, 0.0, -9.81])
    platform: PlatformConfig = field(default_factory=PlatformConfig)
    cables: list[CableConfig] = field(default_factory=list)
    rope: RopeConfig = field(default_factory=RopeConfig)
    winch: WinchConfig = field(default_factory=WinchConfig)
    region: RegionConfig = field(default_factory=RegionConfig)

    def validate(self) -> None:
        require(bool(self.name), "name", repr(self.name), "a name")
        _require_point(self, "gravity_m_s2")
        self.robot()

    def robot(self) -> CableRobot:
        """The robot as the mathematics takes it.

        Raises:
            InputError: too few cables, two between the same points, bounds that cross.
        """
        if not self.cables:
            raise InputError(f"{self.name}: cables = none; must be 3 at least in a plane, else 6")
        return CableRobot(
            name=self.name,
            anchors=np.array([cable.anchor_m for cable in self.cables]),
            attachments=np.array([cable.attachment_m for cable in self.cables]),
            freedoms=PLANAR if self.planar else SPATIAL,
            mass=self.platform.mass_kg,
            centre_of_mass=np.array(self.platform.centre_of_mass_m),
            gravity=np.array(self.gravity_m_s2),
            axial_stiffness=np.array([self.rope.axial_stiffness_N]),
            tension_min=self.rope.tension_min_N,
            tension_max=self.rope.tension_max_N,
            box=np.array(self.platform.size_m),
        )

    def require_box(self) -> None:
        """Refuses a platform without a box, whose clearance nobody can tell.

        Raises:
            InputError: a size is zero.
        """
        size = self.platform.size_m
        require(min(size) > 0.0, f"{self.name}: platform.size_m", size, "> 0 for clearances")

    def require_inside(self, poses: Poses) -> None:
        """Refuses poses whose position is outside the region.

        Raises:
            InputError: says which pose, where it is, and where it must be.
        """
        low, high = np.array(self.region.lower_m), np.array(self.region.upper_m)
        outside = np.any((poses.position < low - 1e-9) | (poses.position > high + 1e-9), axis=1)
        if outside.any():
            pose = int(np.argmax(outside))
            where = np.round(poses.position[pose], 6).tolist()
            raise InputError(
                f"{self.name}: pose {pose + 1} at {where} m lies outside the frame; must be within "
                f"{low.tolist()} .. {high.tolist()} m"
            )


def load_robot(name: str, *, inside: Path | None = None) -> CableRobotConfig:
    """The cable robot of a shipped name, or of a file; see `scene.packages.find_file`.

    Raises:
        InputError: no such file, or one that describes no robot.
    """
    return load_yaml(CableRobotConfig, find_file("cable robot", name, inside=inside))
