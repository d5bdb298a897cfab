"""What can be modified of the machine: its one configuration file (RMS-71, section VI).

Frames: {R} at the foot of the stand, x aft, y port, z down; {P} in the payload's middle, along {R}
while it is stowed; {C} in the middle of the central assembly element (CAE), along {R}; {0}, {1} and
{2} at shoulder, elbow and wrist, x along the arm.
"""
# Annotations must be real types here: pydrake's YAML reader does not resolve strings.

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pips_drake.config import load_yaml, require, require_positive
from pips_drake.scene.packages import find_file
from pips_drake.units import FOOT

Array = NDArray[np.float64]

#: The six angles, in the order of channels 3 to 8 (RMS-71, Table I).
JOINTS = ("H0", "P0", "P1", "H2", "P2", "R2")
#: Camera stations: Table III's, then section VII's.
STATIONS = "ABCDEFGHIJKLM"
#: Frames that a camera station may stand in.
STATION_FRAMES = ("R", "0", "1", "P", "C")
#: RMS-71: the payload is at most 60 ft long and 15 ft in diameter.
LONGEST_PAYLOAD = 60.0 * FOOT
WIDEST_PAYLOAD = 15.0 * FOOT
#: What the Shuttle takes up, and its arm could deploy: 65,000 lb, kg.
HEAVIEST_PAYLOAD = 29484.0


def _require_point(owner: object, name: str, length: int = 3) -> None:
    value = getattr(owner, name)
    require(len(value) == length, f"{type(owner).__name__}.{name}", value, f"{length} numbers")


@dataclass
class JointConfig:
    """One of the arm's six joints."""

    name: str = ""
    # Hard limits, and the largest rate and torque of its drive.
    lower_deg: float = 0.0
    upper_deg: float = 0.0
    rate_deg_s: float = 0.0
    torque_N_m: float = 0.0

    def validate(self) -> None:
        good = -720.0 <= self.lower_deg < self.upper_deg <= 720.0
        limits = f"{self.lower_deg} .. {self.upper_deg} deg"
        require(good, f"joint {self.name}: limits", limits, "rising, within +-720 deg")
        require_positive(self, "rate_deg_s", "torque_N_m")


@dataclass
class ArmConfig:
    """The arm between the stand's top and the effector's palm."""

    # Lengths: shoulder to elbow, elbow to wrist, wrist to the palm's top.
    arm_0_m: float = 0.0
    arm_1_m: float = 0.0
    arm_2_m: float = 0.0
    diameter_m: float = 0.0
    # In the order of `JOINTS`.
    joints: list[JointConfig] = field(default_factory=list)
    shoulder_mass_kg: float = 0.0
    arm_0_mass_kg: float = 0.0
    arm_1_mass_kg: float = 0.0
    wrist_mass_kg: float = 0.0
    effector_mass_kg: float = 0.0
    # The master arm's pose when the simulation is reset.
    home_deg: list[float] = field(default_factory=list)
    # A joint warns this far before its hard limit.
    soft_margin_deg: float = 0.0
    # The reach warns this far before the arm is straight.
    reach_margin_m: float = 0.0

    def validate(self) -> None:
        require_positive(
            self, "arm_0_m", "arm_1_m", "arm_2_m", "diameter_m", "soft_margin_deg", "reach_margin_m"
        )
        require_positive(self, "shoulder_mass_kg", "arm_0_mass_kg", "arm_1_mass_kg")
        require_positive(self, "wrist_mass_kg", "effector_mass_kg")
        names = [joint.name for joint in self.joints]
        require(names == list(JOINTS), "ArmConfig.joints", names, f"{', '.join(JOINTS)} in order")
        _require_point(self, "home_deg", len(JOINTS))
        for joint, angle in zip(self.joints, self.home_deg, strict=True):
            good = joint.lower_deg <= angle <= joint.upper_deg
            allowed = f"within {joint.lower_deg} .. {joint.upper_deg} deg"
            require(good, f"ArmConfig.home_deg: {joint.name}", f"{angle} deg", allowed)

    @property
    def lower(self) -> Array:
        """Lower hard limits of the angles, (6,) rad."""
        return np.radians([joint.lower_deg for joint in self.joints])

    @property
    def upper(self) -> Array:
        """Upper hard limits of the angles, (6,) rad."""
        return np.radians([joint.upper_deg for joint in self.joints])

    @property
    def rates(self) -> Array:
        """Largest rates, (6,) rad/s."""
        return np.radians([joint.rate_deg_s for joint in self.joints])

    @property
    def torques(self) -> Array:
        """Largest torques, (6,) N m."""
        return np.array([joint.torque_N_m for joint in self.joints])

    @property
    def home(self) -> Array:
        """The angles when the simulation is reset, (6,) rad."""
        return np.radians(self.home_deg)


@dataclass
class StandConfig:
    """The telescoping vertical arm (RMS-71, VI.B.1 and VI.E.2)."""

    # Height of the shoulder above the deck.
    lower_m: float = 0.0
    upper_m: float = 0.0
    rate_m_s: float = 0.0
    mass_kg: float = 0.0
    force_N: float = 0.0

    def validate(self) -> None:
        require_positive(self, "lower_m", "rate_m_s", "mass_kg", "force_N")
        require(self.upper_m > self.lower_m, "StandConfig.upper_m", self.upper_m, "> lower_m")


@dataclass
class HexahedronConfig:
    """A hexahedron of the effector: length along x2, width along y2, height along z2."""

    length_m: float = 0.0
    width_m: float = 0.0
    height_m: float = 0.0

    def validate(self) -> None:
        require_positive(self, "length_m", "width_m", "height_m")


@dataclass
class EffectorConfig:
    """The end effector: palm (EFF HEX 1), fixed finger (2) and movable prong (3)."""

    palm: HexahedronConfig = field(default_factory=HexahedronConfig)
    finger: HexahedronConfig = field(default_factory=HexahedronConfig)
    # Between the inner faces of finger and prong.
    prong_closed_gap_m: float = 0.0
    prong_open_gap_m: float = 0.0
    # From the effector's axis to the fixed finger's inner face.
    finger_offset_m: float = 0.0
    prong_rate_m_s: float = 0.0
    prong_mass_kg: float = 0.0
    prong_force_N: float = 0.0

    def validate(self) -> None:
        require_positive(self, "prong_closed_gap_m", "finger_offset_m", "prong_rate_m_s")
        require_positive(self, "prong_mass_kg", "prong_force_N")
        good = self.prong_open_gap_m > self.prong_closed_gap_m
        name, value = "EffectorConfig.prong_open_gap_m", f"{self.prong_open_gap_m} m"
        require(good, name, value, "> prong_closed_gap_m")
        room = 0.5 * self.palm.width_m - self.finger_offset_m
        require(
            self.finger.width_m <= room + 1e-9,
            "EffectorConfig.finger.width_m",
            f"{self.finger.width_m} m",
            f"<= {room:g} m, what the palm has beyond finger_offset_m",
        )


@dataclass
class PayloadConfig:
    """The payload: an eight-sided prism along x with a docking probe on its forward (-x) end."""

    # In {R}, of its middle while it is stowed.
    location_m: list[float] = field(default_factory=list)
    length_m: float = 0.0
    across_flats_m: float = 0.0
    mass_kg: float = 0.0
    probe_length_m: float = 0.0
    probe_width_m: float = 0.0

    def validate(self) -> None:
        _require_point(self, "location_m")
        for name, largest, unit in (
            ("length_m", LONGEST_PAYLOAD, "m"),
            ("across_flats_m", WIDEST_PAYLOAD, "m"),
            ("mass_kg", HEAVIEST_PAYLOAD, "kg"),
        ):
            value = getattr(self, name)
            good = 0.0 < value <= largest
            require(good, f"PayloadConfig.{name}", f"{value} {unit}", f"0 .. {largest:g} {unit}")
        require_positive(self, "probe_length_m", "probe_width_m")


@dataclass
class ReceptacleConfig:
    """The bar on the payload's top (-z) face that the effector takes; along the payload's x."""

    # In {P}, along x and y, of its middle.
    location_m: list[float] = field(default_factory=list)
    length_m: float = 0.0
    width_m: float = 0.0
    height_m: float = 0.0

    def validate(self) -> None:
        _require_point(self, "location_m", 2)
        require_positive(self, "length_m", "width_m", "height_m")


@dataclass
class CargoBayConfig:
    """The cargo bay: a box open at the top, its face c, which is level with the deck."""

    # In {R}, of the middle of its forward top edge.
    location_m: list[float] = field(default_factory=list)
    length_m: float = 0.0
    width_m: float = 0.0
    depth_m: float = 0.0
    # Thickness of walls and floor.
    wall_m: float = 0.0

    def validate(self) -> None:
        _require_point(self, "location_m")
        require_positive(self, "length_m", "width_m", "depth_m", "wall_m")


@dataclass
class CentralAssemblyElementConfig:
    """The CAE: an eight-sided prism along z whose face c (towards +x) has the docking port."""

    # In {R}, of its middle, when nothing has been translated.
    location_m: list[float] = field(default_factory=list)
    across_flats_m: float = 0.0
    height_m: float = 0.0
    # Of the port's middle from the CAE's, along z (down).
    port_offset_m: float = 0.0
    mass_kg: float = 0.0

    def validate(self) -> None:
        _require_point(self, "location_m")
        require_positive(self, "across_flats_m", "height_m", "mass_kg")
        good = abs(self.port_offset_m) < 0.5 * self.height_m
        name, value = "CentralAssemblyElementConfig.port_offset_m", f"{self.port_offset_m} m"
        require(good, name, value, "on the CAE: within half of height_m")


@dataclass
class OrbiterConfig:
    """The orbiter's outline, and how it translates against the CAE (RMS-71, VII.2)."""

    cabin_length_m: float = 0.0
    cabin_height_m: float = 0.0
    cabin_width_m: float = 0.0
    length_m: float = 0.0
    span_m: float = 0.0
    mass_kg: float = 0.0
    rate_m_s: float = 0.0
    force_N: float = 0.0

    def validate(self) -> None:
        require_positive(self, "cabin_length_m", "cabin_height_m", "cabin_width_m", "length_m")
        require_positive(self, "span_m", "mass_kg", "rate_m_s", "force_N")


@dataclass
class AcquisitionConfig:
    """Tolerances of acquisition (RMS-71, VI.D): FRONT, REAR, TOPB, PRGSPC."""

    # The palm's middle must be this far inside the bar's forward and aft ends.
    front_ft: float = 0.0
    rear_ft: float = 0.0
    # Largest distance from the palm's bottom face (d) to the bar's top face (c).
    top_ft: float = 0.0
    # Largest gap between the inner faces of finger and prong.
    prong_gap_m: float = 0.0
    # Farther than this the report looks for no collision with the bar.
    far_ft: float = 0.0

    def validate(self) -> None:
        require_positive(self, "front_ft", "rear_ft", "top_ft", "prong_gap_m", "far_ft")


@dataclass
class DockingConfig:
    """Tolerances of docking (RMS-71, IV.A.3)."""

    # Largest distance of the probe's middle from the port's.
    distance_ft: float = 0.0
    # The cosine of the angle between the probe's and the port's y axes must be >= 1 - 2^this.
    cosine_deficit_log2: int = 0
    # Whether the z axes are asked too.
    second_axis: bool = False

    def validate(self) -> None:
        require_positive(self, "distance_ft")
        good = -40 <= self.cosine_deficit_log2 < 0
        require(good, "DockingConfig.cosine_deficit_log2", self.cosine_deficit_log2, "-40 .. -1")


@dataclass
class BerthingConfig:
    """How near to its stowed pose a payload must be for the bay's latches to hold it."""

    distance_m: float = 0.0
    angle_deg: float = 0.0

    def validate(self) -> None:
        require_positive(self, "distance_m", "angle_deg")


@dataclass
class StationConfig:
    """A camera station (RMS-71, Table III)."""

    # A letter.
    name: str = ""
    # Where it is fixed: R, 0, 1, P or C.
    frame: str = ""
    # In that frame.
    position_m: list[float] = field(default_factory=list)
    # Where it looks at first: turned from the frame's x towards its y, then raised.
    heading_deg: float = 0.0
    pitch_deg: float = 0.0
    # Vertical, at first.
    field_of_view_deg: float = 0.0

    def validate(self) -> None:
        good = self.frame in STATION_FRAMES
        require(good, f"station {self.name}: frame", self.frame, " or ".join(STATION_FRAMES))
        _require_point(self, "position_m")


@dataclass
class CamerasConfig:
    """The camera stations and how they move (RMS-71, Table III and Figure 11)."""

    pan_tilt_rate_deg_s: float = 0.0
    zoom_rate_deg_s: float = 0.0
    narrowest_deg: float = 0.0
    widest_deg: float = 0.0
    # In the order of `STATIONS`.
    stations: list[StationConfig] = field(default_factory=list)

    def validate(self) -> None:
        require_positive(self, "pan_tilt_rate_deg_s", "zoom_rate_deg_s", "narrowest_deg")
        good = self.narrowest_deg < self.widest_deg < 170.0
        require(good, "CamerasConfig.widest_deg", self.widest_deg, "narrowest_deg .. 170")
        names = "".join(station.name for station in self.stations)
        require(names == STATIONS, "CamerasConfig.stations", names, f"{STATIONS} in order")
        for station in self.stations:
            angle = station.field_of_view_deg
            good = self.narrowest_deg <= angle <= self.widest_deg
            allowed = f"{self.narrowest_deg:g} .. {self.widest_deg:g} deg"
            require(good, f"station {station.name}: field_of_view_deg", angle, allowed)


@dataclass
class RemoteManipulatorConfig:
    """The whole machine; RMS-71's section VI says what of it can be modified."""

    name: str = ""
    arm: ArmConfig = field(default_factory=ArmConfig)
    stand: StandConfig = field(default_factory=StandConfig)
    effector: EffectorConfig = field(default_factory=EffectorConfig)
    payload: PayloadConfig = field(default_factory=PayloadConfig)
    receptacle: ReceptacleConfig = field(default_factory=ReceptacleConfig)
    cargo_bay: CargoBayConfig = field(default_factory=CargoBayConfig)
    central_assembly_element: CentralAssemblyElementConfig = field(
        default_factory=CentralAssemblyElementConfig
    )
    orbiter: OrbiterConfig = field(default_factory=OrbiterConfig)
    acquisition: AcquisitionConfig = field(default_factory=AcquisitionConfig)
    docking: DockingConfig = field(default_factory=DockingConfig)
    berthing: BerthingConfig = field(default_factory=BerthingConfig)
    cameras: CamerasConfig = field(default_factory=CamerasConfig)

    def validate(self) -> None:
        bay, payload = self.cargo_bay, self.payload
        for what, size, room in (
            ("across_flats_m", payload.across_flats_m, bay.width_m),
            ("length_m", payload.length_m + payload.probe_length_m, bay.length_m),
        ):
            good = size < room
            require(good, f"payload.{what}", f"{size:g} m", f"< {room:g} m, the bay's room")
        reach = self.receptacle.length_m - FOOT * (
            self.acquisition.front_ft + self.acquisition.rear_ft
        )
        allowed = "longer than acquisition.front_ft + rear_ft"
        require(reach > 0.0, "receptacle.length_m", f"{self.receptacle.length_m} m", allowed)


def load_configuration(
    name: str = "rms_71", *, inside: Path | None = None
) -> RemoteManipulatorConfig:
    """The machine of a shipped name or of a file; see `find_file`.

    Raises:
        InputError: no such file, an unknown key, or a value that is not allowed.
    """
    return load_yaml(RemoteManipulatorConfig, find_file("manipulator", name, inside=inside))
