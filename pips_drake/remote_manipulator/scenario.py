"""The typed scenario of a run of the remote manipulator: everything that `pips simulate` needs."""
# Annotations must be real types here: pydrake's YAML reader does not resolve strings.

from dataclasses import dataclass, field

from pips_drake.config import require
from pips_drake.remote_manipulator.configuration import STATIONS
from pips_drake.remote_manipulator.phases import PHASES, SUPPORTS
from pips_drake.remote_manipulator.program_state import COLLISIONS, INHIBITS
from pips_drake.remote_manipulator.script import ScriptStep

#: Longest run, s.
DAY = 86400.0
#: What the fields of the same names may say.
OPERATORS = ("autopilot", "recording", "random", "meshcat")


@dataclass
class LimitCycleConfig:
    """How a free flyer keeps its attitude: jets that fire at the ends of a dead band."""

    enabled: bool = False
    # Half of the dead band, about each of the payload's axes.
    dead_band_deg: float = 0.5
    # Of a pair of jets, while it fires.
    torque_N_m: float = 200.0

    def validate(self) -> None:
        good = 0.0 < self.dead_band_deg <= 45.0
        require(good, "limit_cycle.dead_band_deg", self.dead_band_deg, "0 .. 45")
        good = 0.0 < self.torque_N_m <= 1e5
        require(good, "limit_cycle.torque_N_m", self.torque_N_m, "0 .. 1e5")


@dataclass
class PayloadStartConfig:
    """Where the payload is when the run begins."""

    # bay: stowed. port: docked. none: flying free.
    support: str = "bay"
    # none: of its middle in {R}, m (empty: the stowed place); roll, pitch and yaw about x, then y,
    # then z, which stay, deg; and its velocity, m/s, and spin, deg/s, in {R}.
    position_m: list[float] = field(default_factory=list)
    rpy_deg: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    velocity_m_s: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    spin_deg_s: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    limit_cycle: LimitCycleConfig = field(default_factory=LimitCycleConfig)

    def validate(self) -> None:
        known = " or ".join(SUPPORTS)
        require(self.support in SUPPORTS, "payload.support", self.support, known)
        for name in ("position_m", "rpy_deg", "velocity_m_s", "spin_deg_s"):
            value = getattr(self, name)
            good = len(value) == 3 or (name == "position_m" and not value)
            require(good, f"payload.{name}", value, "three numbers")
        if self.support != "none":
            still = not any(self.velocity_m_s) and not any(self.spin_deg_s)
            require(still, "payload: velocity and spin", "not zero", "zero unless support is none")
            placed = bool(self.position_m) or any(self.rpy_deg) or self.limit_cycle.enabled
            name, allowed = (
                "payload: position, rpy or limit cycle",
                "left out unless support is none",
            )
            require(not placed, name, "given", allowed)


@dataclass
class OperatorConfig:
    """Who moves the master arm."""

    # autopilot: `script`. recording: the CSV file `recording`, such as a run's `operator.csv`.
    # random: seeded by the scenario's `seed`. meshcat: you, with `pips simulate --meshcat`.
    kind: str = "autopilot"
    recording: str = ""
    script: list[ScriptStep] = field(default_factory=list)

    def validate(self) -> None:
        known = " or ".join(OPERATORS)
        require(self.kind in OPERATORS, "operator.kind", self.kind, known)
        good = (self.kind == "recording") == bool(self.recording)
        shown = repr(self.recording)
        require(good, "operator.recording", shown, "a file if, and only if, kind is recording")
        good = (self.kind == "autopilot") == bool(self.script)
        count = f"{len(self.script)} steps"
        require(good, "operator.script", count, "some if, and only if, kind is autopilot")


@dataclass
class ProgramConfig:
    """The dynamic collision program's choices."""

    # exact: whole convex bodies, both ways. report: RMS-71's own tests, with what they miss.
    collision: str = "exact"
    # direction_aware: while in collision, motion that relieves it is let through. literal: the
    # scene holds still until the master arm is back where it was free.
    inhibit: str = "direction_aware"
    # A payload in contact with a side wall of the bay slides along it (RMS-71, VII.4).
    slide_along_walls: bool = False
    # Hold the payload at right angles to the effector, as the report does, instead of as it is.
    snap_to_right_angles: bool = False
    # The master arm is followed no faster than the joints can go.
    limit_master_rates: bool = True

    def validate(self) -> None:
        for name, known in (("collision", COLLISIONS), ("inhibit", INHIBITS)):
            value = getattr(self, name)
            require(value in known, f"program.{name}", value, " or ".join(known))


@dataclass
class DynamicsConfig:
    """The modelled hardware."""

    # Steps of the plant a second: so many that a frame of the operator is a whole number of them.
    plant_hz: int = 100
    # Lets the orbiter translate against the CAE and free flyers (channels 14 to 16).
    orbiter_translates: bool = False

    def validate(self) -> None:
        good = self.plant_hz % 20 == 0 and 60 <= self.plant_hz <= 20000
        require(good, "dynamics.plant_hz", self.plant_hz, "a multiple of 20, 60 .. 20000")


@dataclass
class VideoConfig:
    """`camera.mp4`: the whole task, with other stations in its corners."""

    enabled: bool = True
    width: int = 960
    height: int = 540
    fps: int = 10
    # Simulated seconds a second of watching.
    speed: float = 16.0
    # Stations shown small, in the corners.
    insets: list[str] = field(default_factory=lambda: ["G", "H"])

    def validate(self) -> None:
        for name, low, high in (("width", 160, 3840), ("height", 120, 2160), ("fps", 1, 60)):
            value = getattr(self, name)
            require(low <= value <= high, f"video.{name}", value, f"{low} .. {high}")
        for name in ("width", "height"):
            value = getattr(self, name)
            require(value % 2 == 0, f"video.{name}", value, "even")
        require(0.1 <= self.speed <= 1000.0, "video.speed", self.speed, "0.1 .. 1000")
        require(len(self.insets) <= 3, "video.insets", self.insets, "three at most")
        for station in self.insets:
            known = len(station) == 1 and station in STATIONS
            require(known, "video.insets", station, f"of {', '.join(STATIONS)}")


@dataclass
class CheckConfig:
    """What a run must keep for its verdict to be `pass`."""

    # The phases that the run must go through, in order, the first one first.
    phases: list[str] = field(default_factory=list)
    # How often motion may and must be inhibited (each rise of a flag counts once).
    inhibits_min: int = 0
    inhibits_max: int = 0
    # Least distance of arm and payload to everything else, mm, while the payload is farther than
    # `docking_zone_m` from the port; 0: they may touch.
    clearance_min_mm: float = 0.0
    docking_zone_m: float = 0.5
    # Deepest that contact may press two bodies into each other, mm.
    penetration_max_mm: float = 10.0
    # Farthest that the palm may be from where the slave arm is sent, mm.
    tracking_error_max_mm: float = 100.0

    def validate(self) -> None:
        for name in self.phases:
            require(name in PHASES, "checks.phases", name, f"of {', '.join(PHASES)}")
        require(self.inhibits_min >= 0, "checks.inhibits_min", self.inhibits_min, ">= 0")
        good = self.inhibits_max >= self.inhibits_min
        require(good, "checks.inhibits_max", self.inhibits_max, ">= inhibits_min")
        for name in ("clearance_min_mm", "docking_zone_m"):
            require(getattr(self, name) >= 0.0, f"checks.{name}", getattr(self, name), ">= 0")
        for name in ("penetration_max_mm", "tracking_error_max_mm"):
            require(getattr(self, name) > 0.0, f"checks.{name}", getattr(self, name), "> 0")


@dataclass
class RemoteManipulatorScenario:
    """A run of the remote manipulator task simulator."""

    # Chooses this type among the machines' scenarios.
    machine: str = "remote_manipulator"
    # One line for `pips list`.
    description: str = ""
    # A shipped machine (`models/manipulators`), or a file beside the scenario.
    manipulator: str = "rms_71"
    payload: PayloadStartConfig = field(default_factory=PayloadStartConfig)
    # Kilograms; 0 takes the machine's.
    payload_mass_kg: float = 0.0
    # Of the shoulder above the deck at first; 0 takes the stand's lower limit.
    stand_height_m: float = 0.0
    # The arm's angles at first, deg, in the order H0 P0 P1 H2 P2 R2; empty: the machine's home.
    angles_deg: list[float] = field(default_factory=list)
    # The CAE's place at first from that in the machine's file, in {R}, m.
    cae_offset_m: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    operator: OperatorConfig = field(default_factory=OperatorConfig)
    program: ProgramConfig = field(default_factory=ProgramConfig)
    dynamics: DynamicsConfig = field(default_factory=DynamicsConfig)
    # Where the operator looks from at first.
    station: str = "C"
    video: VideoConfig = field(default_factory=VideoConfig)
    checks: CheckConfig = field(default_factory=CheckConfig)
    # Ends the run, s; with an autopilot or a recording, 0 ends it with them.
    duration_s: float = 0.0
    seed: int = 0

    def validate(self) -> None:
        name = "remote_manipulator"
        require(self.machine == name, "machine", self.machine, name)
        require(len(self.cae_offset_m) == 3, "cae_offset_m", self.cae_offset_m, "three numbers")
        good = len(self.angles_deg) in (0, 6)
        require(good, "angles_deg", self.angles_deg, "six numbers, or none")
        for name in ("payload_mass_kg", "stand_height_m", "duration_s"):
            require(getattr(self, name) >= 0.0, name, getattr(self, name), ">= 0")
        require(self.duration_s <= DAY, "duration_s", self.duration_s, f"<= {DAY:g}")
        ends = self.duration_s > 0.0 or self.operator.kind in ("autopilot", "recording")
        require(ends, "duration_s", self.duration_s, "> 0 with this operator")
        known = len(self.station) == 1 and self.station in STATIONS
        require(known, "station", self.station, f"of {', '.join(STATIONS)}")
        require(0 <= self.seed < 2**32, "seed", self.seed, "0 .. 2^32 - 1")
