"""The typed scenario of a serpentine run: everything that `pips simulate` needs to know."""
# Annotations must be real types here: pydrake's YAML reader does not resolve strings.

from dataclasses import dataclass, field

from pips_drake.config import require
from pips_drake.serpentine.fault_config import FaultConfig
from pips_drake.serpentine.mounting import mounting_rotation
from pips_drake.serpentine.supervisor_config import SupervisorConfig

#: Slowest tip speed, mm/s, and longest time, s, that a scenario may ask for.
SLOWEST, DAY = 0.1, 86400.0

#: What `motion.profile` may say.
MOTION_PROFILES = ("constant", "fastest")
#: What `actuation.fidelity` may say.
FIDELITIES = ("joint", "leg", "truss")
#: What `integration.scheme` may say.
INTEGRATION_SCHEMES = ("discrete", "radau3")
#: Beyond the finest, roundings of the integrator's differences are larger than the error asked for;
#: beyond the coarsest, it is no reference.
ACCURACY_FINEST, ACCURACY_COARSEST = 1e-10, 1e-2


@dataclass
class MotionConfig:
    """How the tip moves along its path."""

    # constant: at one speed between two ramps, as in the report. fastest: as fast as the drives'
    # limits of speed, acceleration and force let it, place by place; the path must be smooth.
    profile: str = "constant"
    # constant: tip speed between the ramps, mm/s. FACTS: 25 by default.
    tip_speed_mm_per_s: float = 25.0
    # constant: duration of the smooth ramps at both ends, s. Two seconds stay below the arm's first
    # mode.
    ramp_s: float = 2.0
    # fastest: the tip is never faster, mm/s. 0 leaves that to the drives.
    tip_speed_max_mm_per_s: float = 0.0
    # fastest: share of each limit of the drives that it uses. The rest is left to what no plan
    # knows: the compensation of deflection, the camera's pointing, vibration.
    limit_share: float = 0.95
    # fastest: window over which travel is averaged, s, so that acceleration does not jump. Half a
    # second is more than a period of the arm's lowest mode (about 3 Hz). 0 does not average.
    smoothing_s: float = 0.5
    # Time at the end of the path, s.
    dwell_s: float = 5.0
    # Come back along the same path after the dwell.
    retract: bool = True
    # Time at rest before the recording ends, s.
    settle_s: float = 1.0

    def validate(self) -> None:
        known = " or ".join(MOTION_PROFILES)
        require(self.profile in MOTION_PROFILES, "motion.profile", self.profile, known)
        for name in ("tip_speed_mm_per_s", "ramp_s"):
            value = getattr(self, name)
            require(value > 0.0, f"motion.{name}", value, "> 0")
        most = self.tip_speed_max_mm_per_s
        good = most == 0.0 or SLOWEST <= most <= 1e4
        allowed = f"0 or {SLOWEST:g} .. 1e4"
        require(good, "motion.tip_speed_max_mm_per_s", most, allowed)
        share = self.limit_share
        require(0.01 <= share <= 1.0, "motion.limit_share", share, "0.01 .. 1")
        window = self.smoothing_s
        require(0.0 <= window <= 60.0, "motion.smoothing_s", window, "0 .. 60")
        for name in ("dwell_s", "settle_s"):
            value = getattr(self, name)
            require(value >= 0.0, f"motion.{name}", value, ">= 0")
        # Beyond these a run would not end in anybody's time.
        speed = self.tip_speed_mm_per_s
        require(SLOWEST <= speed <= 1e4, "motion.tip_speed_mm_per_s", speed, f"{SLOWEST:g} .. 1e4")
        for name in ("ramp_s", "dwell_s", "settle_s"):
            value = getattr(self, name)
            require(value <= DAY, f"motion.{name}", value, f"<= {DAY:g}")


@dataclass
class SolverConfig:
    """Follow-the-leader's iteration."""

    # Spine error at which it stops, in. 1e-9 or finer is converged, coarser the report's mode.
    tolerance_in: float = 1e-9
    max_iterations: int = 50

    def validate(self) -> None:
        check_solver(self.tolerance_in, self.max_iterations, prefix="solver.")


def check_solver(tolerance_in: float, max_iterations: int, *, prefix: str = "") -> None:
    """Refuses a tolerance or an iteration limit that means nothing.

    Raises:
        InputError: names the value and what is allowed.
    """
    # At home the first guess of the module lengths is 0.54 in off (FACTS).
    good = 0.0 < tolerance_in <= 1.0
    require(good, f"{prefix}tolerance_in", tolerance_in, "> 0 and <= 1")
    good = 1 <= max_iterations <= 1000
    require(good, f"{prefix}max_iterations", max_iterations, ">= 1 and <= 1000")


@dataclass
class ActuationConfig:
    """How the drives are modelled."""

    # joint: each actuator is its equivalent stiffness at its hinge, k (dL/dtheta)^2, taken where
    # the hinge is straight and constant from there. leg: a spring of stiffness k between the pins,
    # whose free length is commanded; the hinge's stiffness follows the posture. truss: a tube and a
    # rod between those pins, bodies of their own, whose prismatic drive has stiffness k and the
    # actuator's force limit; their loops are closed by constraints.
    # models/sdf/prototype/README.md says when to use which.
    fidelity: str = "joint"
    # Send the drives farther by gravity's static deflection, so that the arm stands where wanted.
    compensate_deflection: bool = True
    # Also run the way out without compensation, so that the figure shows the sag.
    show_uncompensated: bool = False

    def validate(self) -> None:
        known = ", ".join(FIDELITIES)
        require(self.fidelity in FIDELITIES, "actuation.fidelity", self.fidelity, known)


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
        require(self.plant_hz <= 65536, "clocks.plant_hz", self.plant_hz, "<= 65536")


@dataclass
class IntegrationConfig:
    """How the plant's equations of motion are solved."""

    # discrete: steps of 1 / clocks.plant_hz, with drives, contact and hard stops implicit in each.
    # radau3: a continuous plant under Drake's implicit integrator of third order, whose steps
    # follow the accuracy asked for and end at the servos' updates. A reference to measure the
    # discrete steps against (docs/physics.md); it has no hard stops (Drake has none in continuous
    # plants).
    scheme: str = "discrete"
    # Relative error of a step of radau3. 1e-4 keeps trajectory 4's tip within 4 micrometres; 1e-5
    # takes twenty times as long (measured). The discrete plant has none to ask for.
    accuracy: float = 1e-4

    def validate(self) -> None:
        known = " or ".join(INTEGRATION_SCHEMES)
        require(self.scheme in INTEGRATION_SCHEMES, "integration.scheme", self.scheme, known)
        good = ACCURACY_FINEST <= self.accuracy <= ACCURACY_COARSEST
        allowed = f"{ACCURACY_FINEST:g} .. {ACCURACY_COARSEST:g}"
        require(good, "integration.accuracy", self.accuracy, allowed)


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
        # Below zero they would ask for nothing: an arm inside the scene would pass.
        for name in (
            "clearance_min_mm",
            "self_clearance_min_mm",
            "joint_overrun_max_deg",
            "rail_overrun_max_mm",
        ):
            value = getattr(self, name)
            require(value >= 0.0, f"checks.{name}", value, ">= 0")


@dataclass
class CertificateConfig:
    """Clearance proved at every instant, not only at samples (docs/certificate.md)."""

    # Without it clearance is sampled alone.
    enabled: bool = True
    # How near the proved bound must come to a distance that is reached, mm.
    tolerance_mm: float = 0.1
    # Also prove what clearance is left if every joint may be off by this much at any instant, deg,
    # and the rail, mm. For the commanded motion; it does not enter the verdict. 0 and 0 leave it
    # out. Assumed: FTL-95 states no accuracy.
    joint_error_deg: float = 0.05
    rail_error_mm: float = 1.0

    def validate(self) -> None:
        good = 1e-3 <= self.tolerance_mm <= 100.0
        require(good, "certificate.tolerance_mm", self.tolerance_mm, "0.001 .. 100")
        for name, most in (("joint_error_deg", 10.0), ("rail_error_mm", 1000.0)):
            value = getattr(self, name)
            require(0.0 <= value <= most, f"certificate.{name}", value, f"0 .. {most:g}")


@dataclass
class ViewConfig:
    """From where renderings and the replay look at the arm and its scene."""

    # Direction in which the camera looks, in frame 0; it stands where everything is in view.
    direction: list[float] = field(default_factory=lambda: [0.6, 0.45, 0.8])

    def validate(self) -> None:
        good = len(self.direction) == 3 and any(self.direction)
        require(good, "direction", self.direction, "three numbers, not all zero")


@dataclass
class CameraConfig:
    """The camera at the arm's tip, its target, and what of the target's surface counts as seen."""

    # Without a camera, the last joint stays at zero and nothing is filmed.
    enabled: bool = False
    # A body of the scene, such as payload::payload: its origin is the target, and which part of its
    # surface has been seen is recorded. Empty for the point target_m.
    target_body: str = ""
    # In frame 0, m.
    target_m: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    # Vertical, deg.
    field_of_view_deg: float = 50.0
    # Of the picture, pixels.
    width: int = 640
    height: int = 480
    # How the camera is turned in its mount, deg. -45 stands upright at the end of trajectory
    # 4: the segments stand turned by that about their axis (FTL-95 Table A.1, row 3).
    roll_deg: float = -45.0
    # Simulated time between two pictures, and pictures a second of the film: 6 times as fast.
    picture_period_s: float = 0.5
    fps: int = 12
    # What counts as seen. All assumed: FTL-95 names no camera.
    # Least and largest distance, m.
    range_near_m: float = 0.1
    range_far_m: float = 3.0
    # Plane of sharpness, m; 0 focuses on the surface in the middle of each picture.
    focus_distance_m: float = 0.0
    # Diameter of the lens's opening, m; 0 is sharp everywhere.
    aperture_m: float = 0.002
    # Largest blur of a point, pixels.
    blur_max_px: float = 2.0
    # Largest angle between view and normal, deg.
    incidence_max_deg: float = 75.0
    # How far pan and tilt go, either way, and how fast, deg and deg/s. Assumed.
    pan_limit_deg: float = 60.0
    tilt_limit_deg: float = 80.0
    pan_tilt_speed_deg_per_s: float = 30.0
    # How far inside its limits the last joint stays, deg, and the share of its actuator's speed
    # that it may use.
    joint_margin_deg: float = 2.0
    joint_speed_share: float = 0.5

    def validate(self) -> None:
        require(len(self.target_m) == 3, "camera.target_m", self.target_m, "3 numbers")
        for name in ("width", "height"):
            value = getattr(self, name)
            require(value > 0 and value % 2 == 0, f"camera.{name}", value, "even and > 0")
        for name in (
            "fps",
            "picture_period_s",
            "range_near_m",
            "blur_max_px",
            "pan_tilt_speed_deg_per_s",
        ):
            value = getattr(self, name)
            require(value > 0, f"camera.{name}", value, "> 0")
        require(
            self.range_near_m < self.range_far_m,
            "camera.range_far_m",
            self.range_far_m,
            "> range_near_m",
        )
        for name in ("focus_distance_m", "aperture_m", "joint_margin_deg"):
            value = getattr(self, name)
            require(value >= 0.0, f"camera.{name}", value, ">= 0")
        for name, most in (
            ("field_of_view_deg", 150.0),
            ("incidence_max_deg", 89.0),
            ("pan_limit_deg", 180.0),
            ("tilt_limit_deg", 90.0),
            ("joint_speed_share", 1.0),
        ):
            value = getattr(self, name)
            require(0.0 < value <= most, f"camera.{name}", value, f"> 0 and <= {most:g}")


@dataclass
class SerpentineScenario:
    """A serpentine arm that moves in a scene. File: `scenarios/*.yaml`."""

    # Chooses this type among the machines' scenarios.
    machine: str = "serpentine"
    # One line that `pips list` shows.
    description: str = ""
    # A shipped name, or a file inside the scenario's own folder.
    arm: str = "prototype"
    # What it does; one of the two. A path of the tip, which the arm follows.
    path: str = ""
    # Joints over time, for what no single path describes: a file inside the scenario's own folder,
    # .csv or .npz (`joint_motion_file`). Of `motion`, only dwell_s, retract and settle_s act then.
    joints: str = ""
    # joints: where along z0 the rail is set up, for an arm whose rail is placed for the path, m.
    rail_shift_m: float = 0.0
    # A shipped name or file; empty for no scene.
    scene: str = ""
    # Split the scene's meshes into convex parts (extra `meshes`); otherwise each collides as its
    # convex hull.
    decompose_meshes: bool = False
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
    integration: IntegrationConfig = field(default_factory=IntegrationConfig)
    checks: CheckConfig = field(default_factory=CheckConfig)
    supervisor: SupervisorConfig = field(default_factory=SupervisorConfig)
    # What goes wrong, and when; the plan and `pips check` know nothing of it.
    faults: list[FaultConfig] = field(default_factory=list)
    certificate: CertificateConfig = field(default_factory=CertificateConfig)
    view: ViewConfig = field(default_factory=ViewConfig)
    camera: CameraConfig = field(default_factory=CameraConfig)
    # Distances beyond this are not looked at, m.
    clearance_range_m: float = 0.5
    # Shorten the run to this much simulated time, s; 0 for all of it.
    duration_s: float = 0.0
    # Reserved for random choices; a serpentine run has none so far.
    seed: int = 0

    def validate(self) -> None:
        require(self.machine == "serpentine", "machine", self.machine, "serpentine")
        both = self.path != "" and self.joints != ""
        require(not both, "joints", f"'{self.joints}'", "empty with a path")
        given = self.path != "" or self.joints != ""
        require(given, "path", "''", "a shipped path or a file, or joints given")
        shift = self.rail_shift_m
        require(abs(shift) <= 1000.0, "rail_shift_m", shift, "within +-1000")
        good = shift == 0.0 or self.joints != ""
        require(good, "rail_shift_m", shift, "0 with a path, which places the rail itself")
        mounting_rotation(self.mounting)
        position = self.mounting_position_m
        good = len(position) == 3 and max(map(abs, position)) <= 1000.0
        require(good, "mounting_position_m", position, "3 numbers within +-1000")
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
        most = self.supervisor.resume_clearance_mm * 1e-3
        good = not self.supervisor.enabled or most < self.clearance_range_m
        allowed = "> supervisor.resume_clearance_mm"
        require(good, "clearance_range_m", self.clearance_range_m, allowed)
        good = 0.0 <= self.duration_s <= DAY
        require(good, "duration_s", self.duration_s, f">= 0 and <= {DAY:g}")
        moved = any(fault.kind == "payload_displaced" for fault in self.faults)
        require(self.scene != "" or not moved, "scene", "''", "given with a payload_displaced")
        scheme, fidelity = self.integration.scheme, self.actuation.fidelity
        # Drake's continuous plants know no distance or ball constraints.
        good = fidelity == "joint" or scheme == "discrete"
        require(good, "actuation.fidelity", fidelity, f"joint with integration.scheme {scheme}")
        # In `joint` an actuator has no stiffness of its own; Drake fixes those of `truss`'s drives.
        weak = any(fault.kind == "weak" for fault in self.faults)
        require(fidelity == "leg" or not weak, "actuation.fidelity", fidelity, "leg with a weak")
        # What acted is known from the first recorded step on.
        good = self.duration_s == 0.0 or self.duration_s * self.clocks.record_hz >= 1.0
        require(good, "duration_s", self.duration_s, "0, or at least 1 / clocks.record_hz")
