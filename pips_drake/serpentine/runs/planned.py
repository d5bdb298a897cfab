"""What is known of a scenario's motion before it is simulated, along a path or given by joints."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pips_drake.config import require
from pips_drake.serpentine.drives import drive_efforts, drive_limits
from pips_drake.serpentine.joint_motion_limits import limit_sentences, speed_sentences
from pips_drake.serpentine.motion_extremes import MotionExtremes, motion_extremes
from pips_drake.serpentine.plan import CHECK_STEP, MOST_TIP_POSITIONS, Plan, make_plan
from pips_drake.serpentine.planned_motion import GivenJoints
from pips_drake.serpentine.runs import certified, figures, path_figures
from pips_drake.serpentine.runs.follow import drive_numbers, plan_numbers, write_plan_figures
from pips_drake.serpentine.runs.motion_report import motion_report
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import (
    SerpentineSetup,
    given_joints_at_updates,
    make_profile,
)
from pips_drake.twin.motion_record import RecordedMotion, thin_out

Array = NDArray[np.float64]

#: Joints are drawn at so many instants.
_DRAWN = 2001
# Joints that bend by less from one update to the next go straight but for roundings, m and rad.
_STRAIGHT = 1e-10


@dataclass(frozen=True, kw_only=True, eq=False)
class Postures:
    """Postures on the way, close enough to judge it by, where there are any.

    Attributes:
        joints: (N, J) m and rad.
        ways: how far from home, (N,) m.
        index: what they are listed by in `summary.json`, with its unit.
        indices: that, (N,).
    """

    joints: Array
    ways: Array
    index: str
    indices: Array


class PlannedRun(Protocol):
    """A motion that is to be run: its numbers, what forbids it, its figures."""

    @property
    def scenario(self) -> SerpentineScenario:
        """Of which it is the motion."""

    @property
    def setup(self) -> SerpentineSetup:
        """What the scenario names."""

    @property
    def failures(self) -> tuple[str, ...]:
        """Sentences: why the arm cannot do it at all; none if it can."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences that fail the verdict of a run, which takes place nevertheless."""

    def numbers(self) -> dict[str, Any]:
        """What `summary.json` says of it, run or not."""

    def run_numbers(self, figure_folder: Path) -> dict[str, Any]:
        """What `summary.json` says besides of one that is run; may write a figure."""

    def write_figures(self, folder: Path) -> None:
        """Writes the figures of the plan."""

    @property
    def postures(self) -> Postures:
        """To sample clearances and efforts at."""

    def where(self, index: float) -> str:
        """Words for the place of one of the postures' indices."""

    def drive_numbers(self, efforts: Array) -> dict[str, Any]:
        """What the drives would need, given what holds the joints at the postures, (N, J)."""

    def motion_numbers(self, figure_folder: Path | None) -> tuple[dict[str, Any], list[str]]:
        """How long it takes, and sentences if it cannot be had as it is wanted."""


def planned_run(scenario: SerpentineScenario, setup: SerpentineSetup) -> PlannedRun:
    """What is known of a scenario's motion.

    Raises:
        InputError: its path does not begin on the arm's base line.
    """
    if isinstance(setup.motion, GivenJoints):
        return JointRun(scenario=scenario, setup=setup, given=setup.motion)
    return PathRun(scenario=scenario, setup=setup, plan=make_plan(setup.arm, setup.path))


def planned_knots(scenario: SerpentineScenario, setup: SerpentineSetup) -> RecordedMotion:
    """The joints that are commanded on the way out, at each update of the drives or thinned out.

    As `certified.commanded_motion`, for either kind of motion.
    """
    if not isinstance(setup.motion, GivenJoints):
        return certified.commanded_motion(scenario, setup, make_profile(scenario, setup))
    times, joints = given_joints_at_updates(scenario, setup.motion)
    # Between rows the joints move on straight lines: only where these bend, knots are needed.
    bends = np.abs(np.diff(joints, n=2, axis=0)).max(axis=1, initial=0.0) > _STRAIGHT
    knots = np.flatnonzero(np.concatenate([[True], bends, [True]]))
    stride = -(-len(knots) // certified.MOST_KNOTS)
    knots = np.unique(np.append(knots[::stride], len(times) - 1))
    return thin_out(times, joints, knots)


@dataclass(frozen=True, kw_only=True, eq=False)
class PathRun:
    """A path that is followed."""

    scenario: SerpentineScenario
    setup: SerpentineSetup
    plan: Plan

    @property
    def failures(self) -> tuple[str, ...]:
        return self.plan.failures

    @property
    def warnings(self) -> tuple[str, ...]:
        return ()

    def numbers(self) -> dict[str, Any]:
        return plan_numbers(self.plan) | {
            "path_version": self.setup.path.version,
            "path_corner_deviation_m": self.setup.path.deviation,
        }

    def run_numbers(self, figure_folder: Path) -> dict[str, Any]:
        is_fastest = self.scenario.motion.profile == "fastest"
        picture = figure_folder / "fastest_motion.png" if is_fastest else None
        motion, _ = motion_report(self.scenario, self.setup, figure=picture)
        return motion | {"plan_path_deviation_max_m": self.plan.centre_line_deviation.max()}

    def write_figures(self, folder: Path) -> None:
        write_plan_figures(folder, self.plan)

    @cached_property
    def postures(self) -> Postures:
        solution = self.plan.solution
        tips = solution.tip_arc_lengths[solution.solved]
        return Postures(
            joints=self.plan.joints[solution.solved],
            ways=tips - self.plan.path.home_arc_length,
            index="tip_arc_length_m",
            indices=tips,
        )

    def where(self, index: float) -> str:
        return f"with the tip at {index:.4f} m of path '{self.plan.path.name}'"

    def drive_numbers(self, efforts: Array) -> dict[str, Any]:
        speed = self.scenario.motion.tip_speed_mm_per_s * 1e-3
        return drive_numbers(self.plan, efforts, speed)

    def motion_numbers(self, figure_folder: Path | None) -> tuple[dict[str, Any], list[str]]:
        figure = figure_folder and figure_folder / "fastest_motion.png"
        return motion_report(self.scenario, self.setup, figure=figure)


@dataclass(frozen=True, kw_only=True, eq=False)
class JointRun:
    """Joints that are given."""

    scenario: SerpentineScenario
    setup: SerpentineSetup
    given: GivenJoints

    @cached_property
    def extremes(self) -> MotionExtremes:
        """How near the motion comes to the limits of joints and drives."""
        motion = self.given.motion
        return motion_extremes(self.setup.arm, motion.times, motion.joints)

    @property
    def failures(self) -> tuple[str, ...]:
        return limit_sentences(self.setup.arm, self.given.motion, self.extremes)

    @property
    def warnings(self) -> tuple[str, ...]:
        most = self.scenario.checks.speed_fraction_max
        return speed_sentences(self.setup.arm, self.extremes, most)

    def numbers(self) -> dict[str, Any]:
        arm, extremes = self.setup.arm, self.extremes
        hinges = ~arm.is_prismatic
        return {
            "arm": arm.name,
            "joint_motion": self.given.name,
            "joint_motion_version": self.given.version,
            "joint_motion_rows": len(self.given.motion.times),
            "tip_travel_m": self.given.tip_travel,
            "motion_profile": "joints",
            "motion_duration_s": self.given.motion.duration,
            "joint_margin_min_rad": extremes.joint_margin[hinges].min(),
            "rail_margin_min_m": extremes.joint_margin[~hinges].min(),
            "actuator_stroke_margin_min_m": extremes.stroke_margin.min(),
            "drive_speed_max_fraction": extremes.speed_fraction.max(),
        }

    def run_numbers(self, figure_folder: Path) -> dict[str, Any]:
        return {}

    @cached_property
    def postures(self) -> Postures:
        count = max(2, math.ceil(self.given.end / CHECK_STEP) + 1)
        require(
            count <= MOST_TIP_POSITIONS,
            f"joint motion '{self.given.name}': way",
            f"{self.given.end:.6g} m",
            f"<= {MOST_TIP_POSITIONS * CHECK_STEP:.0f} m to be checked",
        )
        ways = np.linspace(0.0, self.given.end, count)
        times = self.given.times_at(ways)
        return Postures(
            joints=self.given.motion.at(times), ways=ways, index="time_s", indices=times
        )

    def where(self, index: float) -> str:
        return f"at {index:.2f} s of joint motion '{self.given.name}'"

    def drive_numbers(self, efforts: Array) -> dict[str, Any]:
        arm = self.setup.arm
        shares = np.abs(drive_efforts(arm, self.postures.joints, efforts)) / drive_limits(arm)[3]
        return {
            "actuator_force_max_fraction": shares[:, arm.first_actuated_joint :].max(),
            "drive_effort_max_fraction": shares.max(),
        }

    def motion_numbers(self, figure_folder: Path | None) -> tuple[dict[str, Any], list[str]]:
        return {}, []

    def write_figures(self, folder: Path) -> None:
        arm, motion = self.setup.arm, self.given.motion
        times = np.linspace(0.0, motion.duration, _DRAWN)
        figures.joint_values_figure(
            folder / "joints.png", arm, figures.time_axis(times), motion.at(times)
        )
        stages = self.given.times_at(np.linspace(0.0, self.given.end, 4))
        names = ("beginning", "one third", "two thirds", "end")
        path_figures.path_figure(
            folder / "path.png",
            arm,
            self.given.line,
            dict(zip(names, motion.at(stages), strict=True)),
            title="Way of the tip and postures",
        )
