"""The typed scenario of a cable robot: a question about a robot, and what the answer must be."""
# Annotations must be real types here: pydrake's YAML reader does not resolve strings.

from dataclasses import dataclass, field

from pips_drake.cable_robot.words import TASKS, TENSION_METHODS
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
class CheckConfig:
    """What must be found for the verdict to be `pass`."""

    # Task `statics`: of every pose.
    statically_stable: bool = True
    # none: whether or not it is. true or false: it must be so.
    kinematically_stable: str = "none"
    # Tensions within the rope's bounds exist.
    within_bounds: bool = True

    def validate(self) -> None:
        known = ("none", "true", "false")
        value = self.kinematically_stable
        require(value in known, "checks.kinematically_stable", value, " or ".join(known))


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
    checks: CheckConfig = field(default_factory=CheckConfig)

    def validate(self) -> None:
        good = self.machine == "cable_robot"
        require(good, "machine", self.machine, "cable_robot")
        require(self.task in TASKS, "task", self.task, " or ".join(TASKS))
        require(bool(self.robot), "robot", repr(self.robot), "a shipped robot or a file")
