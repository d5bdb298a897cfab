"""The typed scenario of a serpentine run: everything that `pips simulate` needs to know."""
# Annotations must be real types here: pydrake's YAML reader does not resolve strings.

from dataclasses import dataclass, field

from pips_drake.config import require
from pips_drake.serpentine.mounting import mounting_rotation


@dataclass
class MotionConfig:
    """How the tip moves along its path."""

    # Tip speed between the ramps, mm/s. FACTS: 25 by default.
    tip_speed_mm_per_s: float = 25.0
    # Duration of the smooth ramps at both ends, s. Two seconds stay below the arm's first mode.
    ramp_s: float = 2.0
    # Time at the end of the path, s.
    dwell_s: float = 5.0
    # Come back along the same path after the dwell.
    retract: bool = True
    # Time at rest before the recording ends, s.
    settle_s: float = 1.0

    def validate(self) -> None:
        for name in ("tip_speed_mm_per_s", "ramp_s"):
            value = getattr(self, name)
            require(value > 0.0, f"motion.{name}", value, "> 0")
        for name in ("dwell_s", "settle_s"):
            value = getattr(self, name)
            require(value >= 0.0, f"motion.{name}", value, ">= 0")


@dataclass
class SolverConfig:
    """Follow-the-leader's iteration."""

    # Spine error at which it stops, in. 1e-9 or finer is converged, coarser the report's mode.
    tolerance_in: float = 1e-9
    max_iterations: int = 50

    def validate(self) -> None:
        require(self.tolerance_in > 0.0, "solver.tolerance_in", self.tolerance_in, "> 0")
        require(self.max_iterations >= 1, "solver.max_iterations", self.max_iterations, ">= 1")


@dataclass
class ActuationConfig:
    """How the drives are modelled."""

    # joint: each drive is the equivalent stiffness at its joint.
    fidelity: str = "joint"
    # Send the drives farther by gravity's static deflection, so that the arm stands where wanted.
    compensate_deflection: bool = True
    # Also run the way out without compensation, so that the figure shows the sag.
    show_uncompensated: bool = False

    def validate(self) -> None:
        require(self.fidelity == "joint", "actuation.fidelity", self.fidelity, "joint")


@dataclass
class ClockConfig:
    """Rates, Hz. Powers of two, so that no period makes tiny extra steps beside another."""

    plant_hz: int = 512
    control_hz: int = 64
    clearance_hz: int = 32
    record_hz: int = 32

    def validate(self) -> None:
        for name in ("plant_hz", "control_hz", "clearance_hz", "record_hz"):
            value = getattr(self, name)
            power = value >= 1 and value & (value - 1) == 0
            require(power, f"clocks.{name}", value, "a power of two, 1 or more")
            require(value <= self.plant_hz, f"clocks.{name}", value, "<= plant_hz")


@dataclass
class CheckConfig:
    """What a run must keep for its verdict to be `pass`."""

    # Least distance of the arm to the scene, mm.
    clearance_min_mm: float = 25.0
    # Least distance of the arm to itself and its rail, mm.
    self_clearance_min_mm: float = 10.0
    # Farthest that a spine point or the tip may be from where the plan has it, mm.
    tracking_error_max_mm: float = 10.0
    # Largest share of its force or torque limit that a drive may need.
    force_fraction_max: float = 1.0
    # Largest share of its speed limit that a drive may need.
    speed_fraction_max: float = 1.0
    # How far the simulated joints may overrun limits that the plan keeps, deg and mm: the drives
    # have that much room beyond.
    joint_overrun_max_deg: float = 0.1
    rail_overrun_max_mm: float = 1.0

    def validate(self) -> None:
        for name in ("tracking_error_max_mm", "force_fraction_max", "speed_fraction_max"):
            value = getattr(self, name)
            require(value > 0.0, f"checks.{name}", value, "> 0")


@dataclass
class ViewConfig:
    """From where renderings and the replay look at the arm and its scene."""

    # Direction in which the camera looks, in frame 0; it stands where everything is in view.
    direction: list[float] = field(default_factory=lambda: [0.6, 0.45, 0.8])

    def validate(self) -> None:
        good = len(self.direction) == 3 and any(self.direction)
        require(good, "direction", self.direction, "three numbers, not all zero")


@dataclass
class SerpentineScenario:
    """A serpentine arm that follows a path in a scene. File: `scenarios/*.yaml`."""

    # Chooses this type among the machines' scenarios.
    machine: str = "serpentine"
    # One line that `pips list` shows.
    description: str = ""
    # A shipped name, or a file inside the scenario's own folder.
    arm: str = "prototype"
    path: str = ""
    # A shipped name or file; empty for no scene.
    scene: str = ""
    # A table's corners are blended by arcs that pass them within this, in. 0 moves along the
    # polyline as it stands, and the joints' rates jump at its vertices.
    corner_deviation_in: float = 0.25
    # How frame 0 stands: laboratory, pad or pad_below, and where, in the world, m.
    mounting: str = "pad"
    mounting_position_m: list[float] = field(default_factory=lambda: [0.0, 0.0, 3.0])
    motion: MotionConfig = field(default_factory=MotionConfig)
    solver: SolverConfig = field(default_factory=SolverConfig)
    actuation: ActuationConfig = field(default_factory=ActuationConfig)
    clocks: ClockConfig = field(default_factory=ClockConfig)
    checks: CheckConfig = field(default_factory=CheckConfig)
    view: ViewConfig = field(default_factory=ViewConfig)
    # Distances beyond this are not looked at, m.
    clearance_range_m: float = 0.5
    # Shorten the run to this much simulated time, s; 0 for all of it.
    duration_s: float = 0.0
    # Reserved for random choices; a serpentine run has none so far.
    seed: int = 0

    def validate(self) -> None:
        require(self.machine == "serpentine", "machine", self.machine, "serpentine")
        require(self.path != "", "path", "''", "a shipped path or a file")
        mounting_rotation(self.mounting)
        position = self.mounting_position_m
        require(len(position) == 3, "mounting_position_m", position, "3 numbers")
        require(
            self.corner_deviation_in >= 0.0, "corner_deviation_in", self.corner_deviation_in, ">= 0"
        )
        require(self.clearance_range_m > 0.0, "clearance_range_m", self.clearance_range_m, "> 0")
        need = max(self.checks.clearance_min_mm, self.checks.self_clearance_min_mm) * 1e-3
        require(
            need < self.clearance_range_m,
            "clearance_range_m",
            self.clearance_range_m,
            "> the clearances that checks ask for",
        )
        require(self.duration_s >= 0.0, "duration_s", self.duration_s, ">= 0")
