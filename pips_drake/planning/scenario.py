"""The typed scenario of a planner's run: everything that `pips plan` needs to know."""
# Annotations must be real types here: pydrake's YAML reader does not resolve strings.

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace

from pips_drake.config import require, validate
from pips_drake.scene.obstacles import ObstacleConfig
from pips_drake.serpentine.mounting import mounting_rotation
from pips_drake.serpentine.scenario import (
    ActuationConfig,
    CameraConfig,
    CertificateConfig,
    CheckConfig,
    ClockConfig,
    IntegrationConfig,
    MotionConfig,
    SerpentineScenario,
    SolverConfig,
    ViewConfig,
)
from pips_drake.serpentine.supervisor_config import SupervisorConfig

#: What `workspace.kind` may say.
WORKSPACES = ("unfolded", "box")
#: What `origin` may say: `planning.origins.OriginRule`, which takes a compiler to load.
ORIGINS = ("least_tip_travel", "least_exposed_length", "same_class")
#: What `scan.pattern` may say.
PATTERNS = ("raster", "helix", "points")
#: Finest and coarsest cells, mm.
CELL_FINEST, CELL_COARSEST = 5.0, 1000.0
#: Paths of different homotopy that may be asked for.
MOST_ALTERNATIVES = 8


@dataclass
class WorkspaceConfig:
    """The part of the scene that is searched, cut into cells. In frame 0."""

    # unfolded: along, around and out from an axis that is parallel to z0, as a gap is. box: x0, y0,
    # z0.
    kind: str = "unfolded"
    # unfolded: where the axis stands, x0 and y0, m.
    axis_m: list[float] = field(default_factory=lambda: [0.0, 0.0])
    # unfolded: from, to.
    along_m: list[float] = field(default_factory=list)
    around_deg: list[float] = field(default_factory=lambda: [-180.0, 180.0])
    out_m: list[float] = field(default_factory=list)
    # box: its corners.
    lower_m: list[float] = field(default_factory=list)
    upper_m: list[float] = field(default_factory=list)
    # Size of a cell, mm.
    cell_mm: float = 100.0
    # Obstacles are grown by this, mm: half the arm's diagonal, and what margin is wanted beside it.
    arm_radius_mm: float = 120.0

    def validate(self) -> None:
        known = " or ".join(WORKSPACES)
        require(self.kind in WORKSPACES, "workspace.kind", self.kind, known)
        good = CELL_FINEST <= self.cell_mm <= CELL_COARSEST
        require(good, "workspace.cell_mm", self.cell_mm, f"{CELL_FINEST:g} .. {CELL_COARSEST:g}")
        radius = self.arm_radius_mm
        require(1.0 <= radius <= 1e4, "workspace.arm_radius_mm", radius, "1 .. 10000")
        if self.kind == "unfolded":
            require(
                len(self.axis_m) == 2, "workspace.axis_m", self.axis_m, "two numbers, x0 and y0"
            )
            for name in ("along_m", "around_deg", "out_m"):
                _check_range(f"workspace.{name}", getattr(self, name))
            require(self.out_m[0] > 0.0, "workspace.out_m", self.out_m, "> 0")
            turn = self.around_deg[1] - self.around_deg[0]
            good = turn <= 360.0
            require(good, "workspace.around_deg", self.around_deg, "a whole turn at most")
            return
        for name in ("lower_m", "upper_m"):
            value = getattr(self, name)
            require(len(value) == 3, f"workspace.{name}", value, "three numbers")
        good = all(low < high for low, high in zip(self.lower_m, self.upper_m, strict=True))
        require(good, "workspace.upper_m", self.upper_m, "above workspace.lower_m")


def _check_range(name: str, value: list[float]) -> None:
    good = len(value) == 2 and value[0] < value[1]
    require(good, name, value, "two numbers, from and to")


@dataclass
class GoalConfig:
    """Where the tip shall go. One of `point_m` and `unfolded` says where."""

    name: str = ""
    # In frame 0, m.
    point_m: list[float] = field(default_factory=list)
    # In a workspace that is unfolded: along (m), around (deg), out (m).
    unfolded: list[float] = field(default_factory=list)
    # Along which the tip shall look there, in frame 0; empty: it does not matter.
    looks_along: list[float] = field(default_factory=list)
    # How far off the camera may stand; its own pan and tilt make up for that, deg.
    looks_within_deg: float = 10.0
    # Points in frame 0 that the path must go through, such as the middle of an opening, m.
    nails_m: list[list[float]] = field(default_factory=list)

    def validate(self) -> None:
        given = [name for name in ("point_m", "unfolded") if getattr(self, name)]
        if len(given) != 1:
            require(False, "goal", "neither" if not given else "both", "one of point_m, unfolded")
        value = getattr(self, given[0])
        require(len(value) == 3, given[0], value, "three numbers")
        look = self.looks_along
        good = not look or (len(look) == 3 and any(look))
        require(good, "looks_along", look, "three numbers, not all zero, or empty")
        within = self.looks_within_deg
        require(0.0 < within <= 180.0, "looks_within_deg", within, "> 0 and <= 180")
        for nail in self.nails_m:
            require(len(nail) == 3, "nails_m", nail, "lists of three numbers")


@dataclass
class ScanConfig:
    """A surface that the tip is led along: part of a cylinder about the workspace's axis."""

    # raster: lines to and fro. helix: around and around. points: the points of a file. Empty: no
    # scan, the goals are gone to.
    pattern: str = ""
    # Of the cylinder, m.
    radius_m: float = 0.0
    # The part of it: from, to.
    along_m: list[float] = field(default_factory=list)
    around_deg: list[float] = field(default_factory=lambda: [-180.0, 180.0])
    # Of the tip from the surface, mm.
    standoff_mm: float = 250.0
    # Share of what the camera sees in one pass that it sees again in the next.
    overlap: float = 0.2
    # raster: lines around the axis, or along it.
    lines: str = "around"
    # points: a CSV of the scenario's own folder, x_m,y_m,z_m or x_in,y_in,z_in.
    points_file: str = ""
    # Of the tip's places, mm.
    step_mm: float = 100.0
    # How far the tip trails behind the pattern, because the camera looks ahead, mm; negative: as
    # far as its pan leaves it short of a right angle.
    lag_mm: float = -1.0
    # Least share of the surface that must have been seen.
    coverage_min: float = 0.0

    def validate(self) -> None:
        known = ", ".join(PATTERNS)
        require(self.pattern in ("", *PATTERNS), "scan.pattern", self.pattern, f"{known} or empty")
        if not self.pattern:
            return
        given = bool(self.points_file)
        allowed = "given with points, and only then"
        require(given == (self.pattern == "points"), "scan.points_file", self.points_file, allowed)
        if self.pattern != "points" or self.along_m:
            require(self.radius_m > 0.0, "scan.radius_m", self.radius_m, "> 0")
            _check_range("scan.along_m", self.along_m)
            _check_range("scan.around_deg", self.around_deg)
        require(self.lines in ("around", "along"), "scan.lines", self.lines, "around or along")
        for name, least, most in (
            ("standoff_mm", 1.0, 1e5),
            ("overlap", 0.0, 0.95),
            ("step_mm", 1.0, 1e4),
            ("lag_mm", -1.0, 2e3),
            ("coverage_min", 0.0, 1.0),
        ):
            value = getattr(self, name)
            require(least <= value <= most, f"scan.{name}", value, f"{least:g} .. {most:g}")


@dataclass
class SnakeConfig:
    """What paths are made of, and how obstacles repel them (docs/planning.md)."""

    # alpha: how much a path wants to be short, N.
    tension_N: float = 1.0
    # beta: how much it wants to be straight, N m^2. Raised where links could not follow.
    bending_stiffness_Nm2: float = 0.3
    # Of its points, mm.
    spacing_mm: float = 100.0
    # A of FIRAS, N m^2; within `reach_mm` of an obstacle; constant below `clamp_mm`.
    repulsion_Nm2: float = 0.1
    reach_mm: float = 300.0
    clamp_mm: float = 30.0
    # How far a path goes straight on from the home tip, mm.
    lead_mm: float = 500.0

    def validate(self) -> None:
        for name, least, most in (
            ("tension_N", 1e-6, 1e6),
            ("bending_stiffness_Nm2", 0.0, 1e6),
            ("spacing_mm", 5.0, 1000.0),
            ("repulsion_Nm2", 1e-9, 1e6),
            ("reach_mm", 1.0, 1e4),
            ("clamp_mm", 0.1, 1e4),
            ("lead_mm", 1.0, 1e4),
        ):
            value = getattr(self, name)
            require(least <= value <= most, f"snake.{name}", value, f"{least:g} .. {most:g}")
        require(self.clamp_mm < self.reach_mm, "snake.clamp_mm", self.clamp_mm, "< snake.reach_mm")


@dataclass
class PlannerScenario:
    """Goals for an arm in a scene, and how its motion is run. File: `scenarios/*.yaml`."""

    # Chooses this type among the machines' scenarios.
    machine: str = "planner"
    # One line that `pips list` shows.
    description: str = ""
    # A shipped name, or a file inside the scenario's own folder.
    arm: str = "cmu_92"
    # A shipped name or file.
    scene: str = ""
    # Split the scene's meshes into convex parts (extra `meshes`).
    decompose_meshes: bool = False
    # Placed in the scene besides what it has, for the planner and for the run.
    obstacles: list[ObstacleConfig] = field(default_factory=list)
    # More of them, from a file inside the scenario's own folder: a list `obstacles`.
    obstacles_file: str = ""
    # Where the path begins, in frame 0, m; empty for the arm's own home. Only an arm whose rail is
    # placed for the path can begin elsewhere.
    home_tip_m: list[float] = field(default_factory=list)
    workspace: WorkspaceConfig = field(default_factory=WorkspaceConfig)
    # In this order.
    goals: list[GoalConfig] = field(default_factory=list)
    scan: ScanConfig = field(default_factory=ScanConfig)
    # What is kept small from one goal to the next: least_tip_travel or least_exposed_length
    # (CMU-92 section 3.3). same_class: the arm draws back no farther than to where the way from its
    # base would take it (Figure 3.3).
    origin: str = "least_tip_travel"
    # How many paths of different homotopy are looked for to a single goal, and which one is taken;
    # 0: the shortest that the arm can follow and its drives can hold.
    alternatives: int = 1
    choose: int = 0
    # A path of your own, a shipped name or a file, that is improved instead of searched for one.
    improve: str = ""
    snake: SnakeConfig = field(default_factory=SnakeConfig)
    # How the planned motion is run, judged and shown: a serpentine scenario gets every field that
    # has a name of its own.
    mounting: str = "laboratory"
    mounting_position_m: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    motion: MotionConfig = field(default_factory=MotionConfig)
    solver: SolverConfig = field(default_factory=SolverConfig)
    actuation: ActuationConfig = field(default_factory=ActuationConfig)
    clocks: ClockConfig = field(default_factory=ClockConfig)
    integration: IntegrationConfig = field(default_factory=IntegrationConfig)
    checks: CheckConfig = field(default_factory=CheckConfig)
    supervisor: SupervisorConfig = field(default_factory=SupervisorConfig)
    certificate: CertificateConfig = field(default_factory=CertificateConfig)
    view: ViewConfig = field(default_factory=ViewConfig)
    camera: CameraConfig = field(default_factory=CameraConfig)
    clearance_range_m: float = 0.5
    duration_s: float = 0.0
    # Reserved for random choices; the planner makes none.
    seed: int = 0

    def validate(self) -> None:
        require(self.machine == "planner", "machine", self.machine, "planner")
        mounting_rotation(self.mounting)
        tip = self.home_tip_m
        require(len(tip) in (0, 3), "home_tip_m", tip, "three numbers, or empty")
        tasks = {"goals": self.goals, "scan": self.scan.pattern, "improve": self.improve}
        given = [name for name, value in tasks.items() if value]
        require(len(given) > 0, "goals", "[]", "one goal or more, or a scan, or a path to improve")
        require(len(given) == 1, " and ".join(given), "all given", "one of them")
        names = [goal.name for goal in self.goals if goal.name]
        require(len(set(names)) == len(names), "goals", names, "of different names")
        if self.workspace.kind != "unfolded":
            good = not any(goal.unfolded for goal in self.goals)
            require(good, "goals.unfolded", "given", "left out in a workspace that is a box")
            good = not self.scan.along_m
            require(good, "scan.along_m", "given", "left out in a workspace that is a box")
        require(self.origin in ORIGINS, "origin", self.origin, " or ".join(ORIGINS))
        count = self.alternatives
        good = 1 <= count <= MOST_ALTERNATIVES
        require(good, "alternatives", count, f"1 .. {MOST_ALTERNATIVES}")
        require(0 <= self.choose <= count, "choose", self.choose, "0 .. alternatives")
        good = count == 1 or len(self.goals) == 1
        require(good, "alternatives", count, "1 with several goals, or none")
        # What it shares with a serpentine scenario is checked as there.
        serpentine_scenario(self, path="planned").validate()


def serpentine_scenario(
    scenario: PlannerScenario, *, path: str = "", joints: str = "", rail_shift: float = 0.0
) -> SerpentineScenario:
    """The scenario that runs what was planned, along a path or given by joints.

    Args:
        path: the planned path's file.
        joints: the planned joints' file.
        rail_shift: where the rail stands then, m along z0.
    """
    here, there = (
        {item.name for item in fields(schema)} for schema in (PlannerScenario, SerpentineScenario)
    )
    return SerpentineScenario(
        **{name: getattr(scenario, name) for name in here & there - {"machine"}},
        path=path,
        joints=joints,
        rail_shift_m=rail_shift,
        # The planner's paths are dense; their arcs are as wide as their points let them be.
        corner_deviation_in=100.0,
    )


def goal_point(scenario: PlannerScenario, goal: GoalConfig) -> list[float]:
    """A goal's point in frame 0, m."""
    if goal.point_m:
        return list(goal.point_m)
    along, around, out = goal.unfolded
    x, y = scenario.workspace.axis_m
    angle = math.radians(around)
    return [x + out * math.cos(angle), y + out * math.sin(angle), along]


def with_goal(scenario: PlannerScenario, point: Sequence[float]) -> PlannerScenario:
    """The scenario with a single goal instead of what it wants.

    Args:
        point: in frame 0, (3,) m.

    Raises:
        InputError: not three finite numbers.
    """
    goal = GoalConfig(point_m=[float(value) for value in point])
    changed = replace(scenario, goals=[goal], scan=ScanConfig(), improve="")
    validate(changed)
    return changed
