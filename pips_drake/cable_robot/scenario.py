"""The typed scenario of a cable robot: a question about a robot, and what the answer must be."""
# Annotations must be real types here: pydrake's YAML reader does not resolve strings.

from dataclasses import dataclass, field

from pips_drake.cable_robot.words import CONTROLS, FLIGHTS, TASKS, TENSION_METHODS
from pips_drake.config import require


@dataclass
class PoseConfig:
    """Where the platform is."""

    position_m: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    # phi, theta and psi of Q = R_z(phi) R_x(theta) R_y(psi).
    angles_deg: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])

    def validate(self) -> None:
        for name in ("position_m", "angles_deg"):
            value = getattr(self, name)
            require(len(value) == 3, f"poses: {name}", value, "three numbers")


@dataclass
class StaticsConfig:
    """Task `statics`: are these poses stable, and which tensions hold them?"""

    poses: list[PoseConfig] = field(default_factory=lambda: [PoseConfig()])
    # How tensions are chosen.
    method: str = "least_norm"
    # Another wrench on the platform, about its origin in the world's axes; empty: none. Six
    # numbers, force and moment; of a planar robot three: two forces and the moment about z.
    wrench_N: list[float] = field(default_factory=list)
    # Rotations count as arcs of this radius where stiffnesses are compared; 0: the distance of the
    # farthest attachment.
    length_m: float = 0.0

    def validate(self) -> None:
        require(bool(self.poses), "statics.poses", "none", "one at least")
        require(
            self.method in TENSION_METHODS,
            "statics.method",
            self.method,
            " or ".join(TENSION_METHODS),
        )
        count = len(self.wrench_N)
        require(count in (0, 3, 6), "statics.wrench_N", f"{count} numbers", "none, 3 or 6 numbers")
        require(self.length_m >= 0.0, "statics.length_m", f"{self.length_m:g} m", ">= 0")


@dataclass
class WorkspaceConfig:
    """Task `workspace`: CABLE-96's design questions, for a robot over the payload bay."""

    # What must be borne along and about every axis besides the weight, either way: a push at the
    # platform, and what its camera's head may do (assumed).
    disturbance_force_N: float = 20.0
    disturbance_moment_N_m: float = 2.0
    # Size of the cells of the volume's slices; maps have cells of half of it.
    cell_m: float = 0.5
    # Set other cablings of the same box side by side.
    compare_cablings: bool = True

    def validate(self) -> None:
        for name in ("disturbance_force_N", "disturbance_moment_N_m"):
            value = getattr(self, name)
            require(0.0 <= value <= 1e5, f"workspace.{name}", f"{value:g}", "0 .. 1e5")
        require(0.1 <= self.cell_m <= 2.0, "workspace.cell_m", f"{self.cell_m:g} m", "0.1 .. 2 m")


@dataclass
class CameraConfig:
    """The survey's camera."""

    width: int = 1280
    height: int = 960
    # Vertical.
    field_of_view_deg: float = 30.0
    # Standard deviation of a pixel's noise, of 255.
    noise: float = 2.0

    def validate(self) -> None:
        for name, low, high in (("width", 160, 4096), ("height", 120, 4096)):
            value = getattr(self, name)
            require(low <= value <= high, f"survey.camera.{name}", value, f"{low} .. {high}")
        value = self.field_of_view_deg
        require(5.0 <= value <= 90.0, "survey.camera.field_of_view_deg", value, "5 .. 90")
        require(0.0 <= self.noise <= 50.0, "survey.camera.noise", self.noise, "0 .. 50")


@dataclass
class DefectsConfig:
    """What is painted on the panels, and found again."""

    count: int = 60
    smallest_mm: float = 3.0
    largest_mm: float = 40.0
    # After the mission: how many are new, have grown, and have been cleaned away.
    new: int = 6
    grown: int = 5
    cleaned: int = 3

    def validate(self) -> None:
        for name in ("count", "new", "grown", "cleaned"):
            value = getattr(self, name)
            require(0 <= value <= 1000, f"survey.defects.{name}", value, "0 .. 1000")
        good = 0.5 <= self.smallest_mm <= self.largest_mm <= 500.0
        sizes = f"{self.smallest_mm:g} .. {self.largest_mm:g} mm"
        require(
            good, "survey.defects.smallest_mm and largest_mm", sizes, "rising, within 0.5 .. 500 mm"
        )


@dataclass
class SurveyConfig:
    """Task `survey`: the camera flies over the radiators, finds their defects and reports them."""

    # Of defects, noise and the calibration's errors.
    seed: int = 0
    # Names such as port_2; empty: all eight.
    panels: list[str] = field(default_factory=list)
    # Of the camera from the panel.
    standoff_m: float = 1.0
    # Share of a picture that the next one shows again.
    overlap: float = 0.1
    camera: CameraConfig = field(default_factory=CameraConfig)
    defects: DefectsConfig = field(default_factory=DefectsConfig)
    # Once more after a mission, and compared.
    after_mission: bool = True
    # Of the moves from view to view, and the rest for a picture.
    speed_m_s: float = 0.3
    acceleration_m_s2: float = 0.3
    exposure_s: float = 0.8
    # station: the whole flight is simulated, winches and swinging included. rest: only the poses at
    # which the platform is at rest are computed, which takes no time.
    flight: str = "station"

    def validate(self) -> None:
        require(self.flight in FLIGHTS, "survey.flight", self.flight, " or ".join(FLIGHTS))
        require(0 <= self.seed < 2**31, "survey.seed", self.seed, "0 .. 2147483647")
        good = 0.3 <= self.standoff_m <= 2.0
        require(good, "survey.standoff_m", f"{self.standoff_m:g} m", "0.3 .. 2 m")
        require(0.0 <= self.overlap <= 0.8, "survey.overlap", f"{self.overlap:g}", "0 .. 0.8")
        for name in ("speed_m_s", "acceleration_m_s2"):
            value = getattr(self, name)
            require(0.0 < value <= 10.0, f"survey.{name}", f"{value:g}", "> 0 and <= 10")
        good = 0.0 <= self.exposure_s <= 60.0
        require(good, "survey.exposure_s", f"{self.exposure_s:g} s", "0 .. 60 s")


@dataclass
class StationConfig:
    """How the simulated hardware works (tasks `survey` and `cable_break`)."""

    # length: winches reel out what the wanted pose asks for. tension: they hold the tensions that a
    # loop over the estimated pose asks for.
    control: str = "length"
    # Cables hang by their weight instead of being straight; slower.
    sag: bool = False
    # A push at the platform: force and moment about its origin in the world's axes, six numbers;
    # empty: none. And when it begins and ends.
    disturbance_N: list[float] = field(default_factory=list)
    disturbance_start_s: float = 0.0
    disturbance_end_s: float = 1.0

    def validate(self) -> None:
        count = len(self.disturbance_N)
        require(count in (0, 6), "station.disturbance_N", f"{count} numbers", "none or 6 numbers")
        good = 0.0 <= self.disturbance_start_s < self.disturbance_end_s
        shown = f"{self.disturbance_start_s:g} .. {self.disturbance_end_s:g} s"
        require(good, "station.disturbance", shown, "rising, from 0 or more")
        require(self.control in CONTROLS, "station.control", self.control, " or ".join(CONTROLS))


@dataclass
class BreakConfig:
    """Task `cable_break`: a cable breaks while the platform rests; what becomes of it?"""

    # Counted from 1, in the order of the robot's file.
    cable: int = 1
    pose: PoseConfig = field(default_factory=PoseConfig)
    # When it breaks, and how long is simulated.
    time_s: float = 0.5
    duration_s: float = 10.0
    # From the break until the winches lock.
    reaction_s: float = 0.1

    def validate(self) -> None:
        require(self.cable >= 1, "cable_break.cable", self.cable, ">= 1")
        good = 0.0 <= self.time_s < self.duration_s <= 600.0
        shown = f"{self.time_s:g} s of {self.duration_s:g} s"
        require(good, "cable_break.time_s and duration_s", shown, "rising, within 0 .. 600 s")
        good = 0.0 <= self.reaction_s <= 60.0
        require(good, "cable_break.reaction_s", f"{self.reaction_s:g} s", "0 .. 60 s")


@dataclass
class CheckConfig:
    """What must be found for the verdict to be `pass`."""

    # Task `statics`: of every pose.
    statically_stable: bool = True
    # none: whether or not it is. true or false: it must be so.
    kinematically_stable: str = "none"
    # Tensions within the rope's bounds exist.
    within_bounds: bool = True
    # Task `workspace`: share of a survey's poses that can be used: disturbances borne, and nothing
    # nearer than `clearance_min_mm`.
    usable_min_percent: float = 100.0
    # Task `survey`: share of the panels that is seen, in percent; every defect from this size on is
    # found; so many false alarms are allowed; and the least distance of platform and cables to
    # panels and sills (task `cable_break`: of the platform, in its swing and at its rest).
    coverage_min_percent: float = 99.9
    found_from_mm: float = 5.0
    false_alarms_max: int = 3
    clearance_min_mm: float = 50.0

    def validate(self) -> None:
        known = ("none", "true", "false")
        value = self.kinematically_stable
        require(value in known, "checks.kinematically_stable", value, " or ".join(known))
        for name in ("coverage_min_percent", "usable_min_percent"):
            share = getattr(self, name)
            require(0.0 <= share <= 100.0, f"checks.{name}", share, "0 .. 100")
        for name in ("found_from_mm", "false_alarms_max", "clearance_min_mm"):
            number = getattr(self, name)
            require(number >= 0, f"checks.{name}", f"{number:g}", ">= 0")


@dataclass
class CableRobotScenario:
    """A study or a run of a cable robot."""

    # Chooses this type among the machines' scenarios.
    machine: str = "cable_robot"
    # One line for `pips list`.
    description: str = ""
    # What is asked.
    task: str = "statics"
    # A shipped robot (`models/cable_robots`), or a file beside the scenario.
    robot: str = ""
    statics: StaticsConfig = field(default_factory=StaticsConfig)
    workspace: WorkspaceConfig = field(default_factory=WorkspaceConfig)
    survey: SurveyConfig = field(default_factory=SurveyConfig)
    cable_break: BreakConfig = field(default_factory=BreakConfig)
    station: StationConfig = field(default_factory=StationConfig)
    checks: CheckConfig = field(default_factory=CheckConfig)

    def validate(self) -> None:
        good = self.machine == "cable_robot"
        require(good, "machine", self.machine, "cable_robot")
        require(self.task in TASKS, "task", self.task, " or ".join(TASKS))
        require(bool(self.robot), "robot", repr(self.robot), "a shipped robot or a file")
