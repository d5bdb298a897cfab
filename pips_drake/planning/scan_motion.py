"""The arm's motion while its tip scans a surface (CMU-92 section 3.7.3).

"We move the end point of the snake by fixing it to the next control point along the path. The rest
of the snake will then move accordingly to minimize its overall energy." After each control point
the arm is laid on the settled snake by follow-the-leader, so that it moves aside as a whole; what
comes out are joints over time, as no single path of the tip describes that.

Where the arm cannot go on, because it is too short, a joint is at its limit, or an obstacle holds
it, it changes over: it draws back along its own path as far as it must, and goes to the same place
along the way that is shortest from home. If that does not do either, the scan ends there.

A camera that looks aside from the last link sees what is ahead of the tip. So the tip may trail
behind the snake's end (`ScanSettings.lag`): then what is seen follows the pattern.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.config import require
from pips_drake.errors import NotFollowableError
from pips_drake.planning.arm_clearance import ClearanceBound, least_clearance
from pips_drake.planning.coverage import CameraPoses, ScanCoverage, camera_poses, cover
from pips_drake.planning.occupancy import Occupancy
from pips_drake.planning.planner import GoalPlan, PlannerSettings
from pips_drake.planning.scan_leader import (
    DETOUR,
    LEAP,
    SCAN,
    Leader,
    StuckError,
)
from pips_drake.planning.scan_route import Route, route_around
from pips_drake.planning.scan_target import ScanCamera, check_standoff
from pips_drake.planning.scanning import ScanPattern
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.drives import drive_limits, drives_from_joints
from pips_drake.serpentine.joint_motion import JointMotion
from pips_drake.serpentine.pointing import make_mount

Array = NDArray[np.float64]

#: Two rows are at least so far apart in time, s.
_SHORTEST_TIME = 1e-3
#: Clearances are looked for up to here, m.
CLEARANCE_WITHIN = 0.3
#: The least that the pattern keeps from obstacles beside the workspace's radius, m.
LEAST_ROOM = 0.02
#: Stages in which the camera's pictures count.
_FILMED = (SCAN, DETOUR, LEAP)


@dataclass(frozen=True, kw_only=True)
class ScanSettings:
    """How a scan goes about it.

    Attributes:
        planner: of the way to the pattern's beginning, and of the snake.
        tip_speed: m/s.
        drive_share: of the drives' speed limits that the motion may use.
        lag: how far the tip trails behind the snake's end, which follows the pattern, m; by default
            `camera_lag`, and 0 for the tip on the pattern itself, as in the report.
        leap: more than this no hinge turns from one row to the next, rad.
        changes: how often the arm may change over to another way around.

    Raises:
        InputError: a number that means nothing.
    """

    planner: PlannerSettings = field(default_factory=PlannerSettings)
    tip_speed: float = 0.025
    drive_share: float = 0.8
    lag: float | None = None
    leap: float = math.radians(6.0)
    changes: int = 50

    def __post_init__(self) -> None:
        good = math.isfinite(self.tip_speed) and self.tip_speed > 0.0
        require(good, "scan's tip speed", f"{self.tip_speed} m/s", "> 0")
        require(0.0 < self.drive_share <= 1.0, "scan's drive share", self.drive_share, "0 .. 1")
        good = self.lag is None or 0.0 <= self.lag < 2.0
        require(good, "scan's lag", f"{self.lag} m", "0 .. 2")
        degrees = math.degrees(self.leap)
        require(0.0 < degrees <= 90.0, "scan's leap", f"{degrees:g} deg", "0 .. 90")
        require(self.changes >= 0, "scan's changes", self.changes, "0 or more")


@dataclass(frozen=True, kw_only=True, eq=False)
class ScanPlan:
    """A scan that was planned.

    Attributes:
        motion: the joints over time, from home: the arm's own frame {0} stands at `shift`.
        stages: of the motion's rows, (K,): `scan_leader.APPROACH` and so on.
        rows: which of the pattern's points the motion's rows are at, (K,); -1 elsewhere.
        tips: (K, 3) m in frame_0.
        snakes: the settled snakes of the pattern's points that were reached, in frame_0.
        approach: the way to the pattern's beginning.
        route: what the pattern became among obstacles.
        reached: which of the pattern's points the snake's end was at, (N,).
        clearance: the least of the arm's bodies over the motion, by time, m and s.
        joint_share: the largest share of its range, from the middle, that a hinge uses.
        poses: of the camera, at rows that are filmed (neither approach nor change-over).
        coverage: what the camera saw; None without a target.
        failures: why the scan ended early; empty if it did not.
        notes: what else there is to say.
    """

    pattern: ScanPattern
    motion: JointMotion
    shift: Array
    stages: NDArray[np.int64]
    rows: NDArray[np.int64]
    tips: Array
    snakes: tuple[Array, ...]
    approach: GoalPlan
    route: Route
    reached: NDArray[np.bool_]
    clearance: ClearanceBound
    joint_share: float
    poses: CameraPoses | None
    coverage: ScanCoverage | None
    failures: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def reached_share(self) -> float:
        """Share of the pattern's points that were reached."""
        return float(self.reached.mean())


def plan_scan(
    arm: SerpentineArm,
    occupancy: Occupancy,
    pattern: ScanPattern,
    *,
    home_tip: ArrayLike | None = None,
    camera: ScanCamera | None = None,
    settings: ScanSettings | None = None,
) -> ScanPlan:
    """The motion of an arm whose tip scans a surface.

    Args:
        occupancy: of the workspace; its radius is the arm's.
        home_tip: where the tip begins, as of `plan_to_goal`.
        camera: for the coverage.

    Raises:
        InputError: the standoff does not fit the gap, the pattern has no room, or a number.
        NoPathError: there is no way to the pattern.
        NotFollowableError: the arm cannot get to the pattern's beginning.
    """
    settings, camera = settings or ScanSettings(), camera or ScanCamera()
    if pattern.target is not None and pattern.kind != "points":
        check_standoff(pattern.target, occupancy.field, pattern.standoff, occupancy.radius)
    home = home_tip if home_tip is not None else kinematics.spine_points(arm, arm.joint_home)[0, -1]
    lag = settings.lag
    if lag is None:
        lag = camera_lag(arm, camera, pattern.standoff)
    leader = Leader(
        arm,
        occupancy,
        home_tip=home_tip,
        settings=settings.planner,
        lag=lag,
        leap=settings.leap,
    )
    # What of the camera head goes on beyond the snake's end wants room ahead.
    ahead = leader.reach + leader.head_radius - occupancy.radius - lag
    room = max(LEAST_ROOM, ahead)
    route = route_around(pattern, occupancy, base=home, room=room)
    try:
        approach = leader.begin(route.points[0])
    except StuckError as reason:
        raise NotFollowableError(f"the arm cannot get to the scan's beginning: {reason}") from None
    failures, notes, changes = [], list(route.sentences()), 0
    snakes = [leader.snake_points]
    k = 1
    while k < len(route.points):
        place, row = route.points[k], int(route.rows[k])
        try:
            leader.advance(place, SCAN if row >= 0 else DETOUR, row)
        except StuckError as reason:
            # Along another way there is no need of the rest of a detour.
            k += int(np.argmax(route.rows[k:] >= 0))
            place, row = route.points[k], int(route.rows[k])
            try:
                if changes >= settings.changes:
                    raise StuckError(f"it may change over {changes} times at most") from None
                leader.change_over(place, row)
            except StuckError as other:
                failures.append(f"the scan ends at {_words(place)}: {reason}; {other}")
                break
            changes += 1
            notes.append(f"changed over at {_words(place)}: {reason}")
        if row >= 0:
            snakes.append(leader.snake_points)
        k += 1
    if leader.swings:
        largest, count = math.degrees(max(leader.swings)), len(leader.swings)
        often = "once" if count == 1 else f"{count} times"
        notes.append(
            f"{often} the snake goes from one rest to another: hinges swing by "
            f"up to {largest:.0f} deg, in small steps that are clear"
        )
    return _finished(
        arm, occupancy, pattern, camera, settings, leader, approach, route, snakes, failures, notes
    )


def camera_lag(arm: SerpentineArm, camera: ScanCamera, standoff: float) -> float:
    """How far ahead of the tip the camera looks at a surface that the arm runs along, m.

    It sits a head's length before the tip, and pan leaves it short of a right angle: h / tan(pan)
    ahead of its foot. (Tilt reaches farther; how much of either it takes depends on how the last
    link is turned about itself.)
    """
    reach = make_mount(arm).reach
    if not math.isfinite(standoff):
        return reach
    return reach + standoff / math.tan(min(max(camera.pan_limit, 0.1), 0.5 * math.pi))


def timed(arm: SerpentineArm, joints: Array, tips: Array, settings: ScanSettings) -> JointMotion:
    """Joints (K, J) with times at which neither the tip (K, 3) nor a drive is too fast."""
    drives = drives_from_joints(arm, joints)
    _, _, speeds, _ = drive_limits(arm)
    by_drives = (np.abs(np.diff(drives, axis=0)) / (settings.drive_share * speeds)).max(axis=1)
    by_tip = np.linalg.norm(np.diff(tips, axis=0), axis=1) / settings.tip_speed
    steps = np.maximum(np.maximum(by_drives, by_tip), _SHORTEST_TIME)
    return JointMotion(times=np.concatenate([[0.0], np.cumsum(steps)]), joints=joints)


def _finished(
    arm: SerpentineArm,
    occupancy: Occupancy,
    pattern: ScanPattern,
    camera: ScanCamera,
    settings: ScanSettings,
    leader: Leader,
    approach: GoalPlan,
    route: Route,
    snakes: list[Array],
    failures: list[str],
    notes: list[str],
) -> ScanPlan:
    joints, stages, rows = leader.recorded()
    tips = kinematics.spine_points(arm, joints)[:, -1] + leader.shift
    motion = timed(arm, joints, tips, settings)
    reached = np.zeros(len(pattern.points), dtype=bool)
    reached[rows[rows >= 0]] = True
    bound = least_clearance(
        arm,
        occupancy.field,
        motion.at,
        motion.times,
        shift=leader.shift,
        within=CLEARANCE_WITHIN,
    )
    hinges = slice(1, arm.joints)
    middle = 0.5 * (arm.joint_upper + arm.joint_lower)[hinges]
    half = 0.5 * (arm.joint_upper - arm.joint_lower)[hinges]
    poses = coverage = None
    if pattern.target is not None:
        filmed = np.isin(stages, _FILMED)
        # A detour belongs to the pass before it.
        last = np.maximum.accumulate(np.where(rows >= 0, rows, 0))
        poses = camera_poses(arm, joints[filmed], pattern.target, camera, shift=leader.shift)
        coverage = cover(
            pattern.target,
            camera,
            poses,
            passes=pattern.passes[last[filmed]],
            field=occupancy.field,
        )
    return ScanPlan(
        pattern=pattern,
        motion=motion,
        shift=leader.shift,
        stages=stages,
        rows=rows,
        tips=tips,
        snakes=tuple(snakes),
        approach=approach,
        route=route,
        reached=reached,
        clearance=bound,
        joint_share=float((np.abs(joints[:, hinges] - middle) / half).max()),
        poses=poses,
        coverage=coverage,
        failures=tuple(failures),
        notes=tuple(notes),
    )


def _words(place: Array) -> str:
    return "(" + ", ".join(f"{x:.3f}" for x in np.round(place, 3) + 0.0) + ") m"
