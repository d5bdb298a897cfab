"""Candidate cablings of a box over the payload bay, and which of them serves the survey.

Four posts stand at the corners of a rectangle, each with an upper and a lower anchor; the box's
eight vertices each have one cable. A cabling says which vertex goes to which anchor:

- `straight`: each vertex to its own corner's post, upper to upper and lower to lower;
- `crossed_in_height`: to its own post, upper to lower and lower to upper;
- `crossed_in_plan`: upper vertices to the post across y, lower ones to the post along x;
- `crossed_round`: every vertex to another post, along x to an upper anchor or across y to a lower
  one, alternately round the box. Of all 1088 assignments that half a turn or a mirror image leaves
  alike, eight (four and their mirror images) keep cables clear of each other and of the doors, and
  bear moments, at all places above the panels. This one bears the most.

Any of them is suspended if both anchors of a post are higher than what the cables must clear. Each
one is measured over the survey's working poses: see `compare_cablings`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pips_drake.cable_robot.accuracy import pose_errors
from pips_drake.cable_robot.capability import wrench_capability
from pips_drake.cable_robot.interference import ObstacleBox, box_from_bounds
from pips_drake.cable_robot.kinematics import Poses, cable_lengths, make_poses
from pips_drake.cable_robot.panels import (
    BAY_HALF_LENGTH,
    BAY_RADIUS,
    DOOR_ANGLE,
    SIDES,
    Panel,
    panel_slabs,
    radiator_panels,
)
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.statics import characteristic_length, distribute_tensions
from pips_drake.cable_robot.stiffness import full_stiffness, stiffness_directions
from pips_drake.cable_robot.survey_camera import STANDOFF, SurveyCamera, view_pose
from pips_drake.cable_robot.workspace import Study, WorkspaceResult, sweep
from pips_drake.config import require
from pips_drake.errors import UnknownNameError

Array = NDArray[np.float64]

#: Signs of the vertices and of the anchors, in the order of the cables: x fastest, then y, z.
_SIGNS = np.array([[2.0 * (i >> k & 1) - 1.0 for k in range(3)] for i in range(8)])
#: Index of each vertex's anchor in `_SIGNS`' order.
CABLINGS: dict[str, tuple[int, ...]] = {
    "straight": (0, 1, 2, 3, 4, 5, 6, 7),
    "crossed_in_height": (4, 5, 6, 7, 0, 1, 2, 3),
    "crossed_in_plan": (1, 0, 3, 2, 6, 7, 4, 5),
    "crossed_round": (2, 4, 7, 1, 5, 3, 0, 6),
}
#: What a cabling must bear in all directions besides the weight: a push at the platform and what
#: its camera's head may do, assumed, N and N m.
DISTURBANCE = (20.0, 2.0)
#: Of the cables' lengths, what calibration leaves, m.
LENGTH_ERROR = 1e-3


@dataclass(frozen=True, kw_only=True)
class Frame:
    """Where the anchors are.

    Attributes:
        half_length, half_width: of the posts' rectangle, m.
        upper, lower: heights of the anchors above the sill, m.
    """

    half_length: float = 11.0
    half_width: float = 7.0
    upper: float = 6.5
    lower: float = 6.0

    def __post_init__(self) -> None:
        for name in ("half_length", "half_width"):
            value = getattr(self, name)
            good = math.isfinite(value) and value > 0.0
            require(good, f"frame: {name}", f"{value:g} m", "> 0")
        good = -math.inf < self.lower < self.upper < math.inf
        require(good, "frame: lower, upper", f"{self.lower:g}, {self.upper:g} m", "rising")


def make_cabling(name: str, frame: Frame, like: CableRobot) -> CableRobot:
    """A robot with the box, mass, cables and bounds of another, cabled otherwise.

    Raises:
        UnknownNameError: no such cabling.
    """
    if name not in CABLINGS:
        raise UnknownNameError("cabling", name, list(CABLINGS))
    anchors = _SIGNS * [frame.half_length, frame.half_width, 1.0]
    anchors[:, 2] = np.where(_SIGNS[:, 2] > 0.0, frame.upper, frame.lower)
    return replace(
        like,
        name=name,
        anchors=anchors[list(CABLINGS[name])],
        attachments=0.5 * _SIGNS * like.box,
        axial_stiffness=np.array([like.axial_stiffness.min()]),
    )


def bay_obstacles(pieces: int = 8) -> list[ObstacleBox]:
    """The opened doors, each as so many boxes along its arc, and the bay below its sills."""
    short = math.pi - DOOR_ANGLE
    obstacles = []
    for name, side in SIDES.items():
        door = Panel(
            name=f"{name} door",
            side=side,
            number=0,
            start=-BAY_HALF_LENGTH,
            length=2.0 * BAY_HALF_LENGTH,
            width=0.5 * math.pi * BAY_RADIUS,
            axis=(side * BAY_RADIUS * (1.0 + math.cos(short)), BAY_RADIUS * math.sin(short)),
            start_angle=short,
        )
        slabs = panel_slabs(door, pieces)
        obstacles += [ObstacleBox(f"{door.name} {k + 1}", *one) for k, one in enumerate(slabs)]
    low = [-BAY_HALF_LENGTH, -BAY_RADIUS, -BAY_RADIUS]
    return [*obstacles, box_from_bounds("bay", low, [BAY_HALF_LENGTH, BAY_RADIUS, 0.0])]


def survey_poses(
    along: int = 13, around: int = 7, *, margin: float = 0.15, standoff: float = STANDOFF
) -> tuple[Poses, NDArray[np.bool_]]:
    """Level poses of the platform at work, and which of them look at a panel, (N,).

    Views of all panels, `along` places from end to end and `around` places across, no nearer than
    `margin` (m) to a panel's edge; and the way from side to side over the bay, at heights of 0.5 to
    1.25 m above the sills, for which the platform stays at the panels' ends and between.
    """
    camera, places = SurveyCamera(), []
    panels = radiator_panels()
    last = BAY_HALF_LENGTH - margin
    for side in SIDES.values():
        panel = next(one for one in panels if one.side == side and one.number == 1)
        v = np.linspace(margin, panel.width - margin, around)
        seen, _ = view_pose(camera, panel, np.full(around, 1.0), v, standoff)
        for x in np.linspace(-last, last, along):
            places.append(np.column_stack([np.full(around, x), seen.position[:, 1:]]))
    looking = sum(len(part) for part in places)
    inner = BAY_RADIUS + standoff
    for x in np.linspace(-last, last, max(2, along // 2)):
        for z in (0.5, 1.0, 1.25):
            y = np.linspace(-inner, inner, around)
            places.append(np.column_stack([np.full(around, x), y, np.full(around, z)]))
    positions = np.concatenate(places)
    return make_poses(positions), np.arange(len(positions)) < looking


@dataclass(frozen=True, eq=False)
class CablingRow:
    """What was measured of one cabling over N working poses.

    Attributes:
        name, frame: of the cabling.
        robot: the robot.
        held: share of the poses at which tensions within the bounds bear the weight.
        feasible: share at which they bear the weight and every disturbance.
        usable: share that is feasible and clear too.
        cable_cable, cable_obstacle, platform_obstacle: least distances, m.
        position_error: largest, for the length error, m; rotation_error likewise, rad; point_error
            of the point that the camera looks at, m.
        softest: least stiffness with tensions, rotations as arcs at the characteristic length, N/m;
            of the poses that are held.
        tension: largest least-norm tension, N; of the poses that are held.
        force, moment: least of what can be borne in every direction, N and N m.
        longest: cable, m.
        result: the sweep.
    """

    name: str
    frame: Frame
    robot: CableRobot
    held: float
    feasible: float
    usable: float
    cable_cable: float
    cable_obstacle: float
    platform_obstacle: float
    position_error: float
    rotation_error: float
    point_error: float
    softest: float
    tension: float
    force: float
    moment: float
    longest: float
    result: WorkspaceResult


def measure_cabling(
    name: str,
    frame: Frame,
    like: CableRobot,
    poses: Poses,
    obstacles: Sequence[ObstacleBox],
    *,
    disturbance: tuple[float, float] = DISTURBANCE,
    length_error: float = LENGTH_ERROR,
    look: float = STANDOFF + 0.28,
) -> CablingRow:
    """One row of `compare_cablings`.

    Args:
        disturbance: force and moment along and about every axis, N and N m.
        length_error: of every cable, m.
        look: how far from the platform's origin the camera looks, m; below it here, where a camera
            looks at the outer end of a panel.
    """
    robot = make_cabling(name, frame, like)
    study = Study(
        disturbance_force=disturbance[0], disturbance_moment=disturbance[1], obstacles=obstacles
    )
    result = sweep(robot, poses, study)
    near = result.clearances
    assert near is not None
    tensions = distribute_tensions(robot, poses, "least_norm")
    held = tensions.feasible
    softest = float("nan")
    if held.any():
        chosen = Poses(poses.position[held], poses.rotation[held])
        K = full_stiffness(robot, chosen, tensions.tensions[held])
        softest = float(stiffness_directions(robot, K, characteristic_length(robot)).values.min())
    errors = pose_errors(robot, poses, length_error, arm=[0.0, 0.0, -look])
    borne = wrench_capability(robot, poses)
    return CablingRow(
        name=name,
        frame=frame,
        robot=robot,
        held=float(held.mean()),
        feasible=float(result.feasible.mean()),
        usable=float(result.usable.mean()),
        cable_cable=float(near.cable_cable.min()),
        cable_obstacle=float(near.cable_obstacle.min()),
        platform_obstacle=float(near.platform_obstacle.min()),
        position_error=float(errors.position.max()),
        rotation_error=float(errors.rotation.max()),
        point_error=float(errors.point.max()),
        softest=softest,
        tension=float(np.nanmax(np.append(result.tension_most, -np.inf))),
        force=float(borne.force.min()),
        moment=float(borne.moment.min()),
        longest=float(cable_lengths(robot, poses).max()),
        result=result,
    )


#: Cablings that the study sets side by side: with low anchors and suspended, and other heights.
CANDIDATES: tuple[tuple[str, Frame], ...] = (
    ("straight", Frame(upper=6.5, lower=0.0)),
    ("straight", Frame()),
    ("crossed_in_height", Frame(upper=6.5, lower=0.0)),
    ("crossed_in_height", Frame()),
    ("crossed_in_plan", Frame()),
    ("crossed_round", Frame(upper=5.0, lower=4.5)),
    ("crossed_round", Frame(upper=6.5, lower=5.0)),
    ("crossed_round", Frame()),
    ("crossed_round", Frame(upper=8.0, lower=7.5)),
)


def compare_cablings(
    like: CableRobot,
    candidates: Sequence[tuple[str, Frame]] = CANDIDATES,
    *,
    poses: Poses | None = None,
    obstacles: Sequence[ObstacleBox] | None = None,
    disturbance: tuple[float, float] = DISTURBANCE,
    length_error: float = LENGTH_ERROR,
) -> list[CablingRow]:
    """Candidates measured over the survey's working poses.

    Args:
        like: the robot whose box, mass, cables and bounds all of them have.
        poses: other ones than `survey_poses`.
        obstacles: other ones than `bay_obstacles`.
    """
    chosen = survey_poses()[0] if poses is None else poses
    boxes = bay_obstacles() if obstacles is None else obstacles
    return [
        measure_cabling(
            name, frame, like, chosen, boxes, disturbance=disturbance, length_error=length_error
        )
        for name, frame in candidates
    ]


def best_cabling(rows: Sequence[CablingRow]) -> CablingRow:
    """The one usable at most poses; among equals that with the lowest posts, then the best aim.

    Usable is feasible with the disturbances and clear. Higher posts give a little accuracy for a
    larger structure. The aim is the error of the point that the camera looks at.
    """
    require(len(rows) > 0, "cablings to choose from", len(rows), ">= 1")
    return min(rows, key=lambda row: (-row.usable, row.frame.upper, row.point_error))


def cabling_table(rows: Sequence[CablingRow]) -> str:
    """The rows as text with units, in columns."""
    lines = [
        f"{'cabling':18}{'anchors m':>12}{'held %':>8}{'borne %':>9}{'usable %':>10}"
        f"{'cables mm':>11}"
        f"{'doors mm':>10}{'pos mm':>8}{'turn mrad':>11}{'aim mm':>8}{'kN/m':>8}{'N':>6}{'N m':>7}"
    ]
    for row in rows:
        heights = f"{row.frame.upper:g} / {row.frame.lower:g}"
        shares = 100.0 * row.held, 100.0 * row.feasible, 100.0 * row.usable
        lines.append(
            f"{row.name:18}{heights:>12}{shares[0]:8.1f}{shares[1]:9.1f}{shares[2]:10.1f}"
            f"{1e3 * row.cable_cable:11.0f}{1e3 * row.cable_obstacle:10.0f}"
            f"{1e3 * row.position_error:8.2f}{1e3 * row.rotation_error:11.2f}"
            f"{1e3 * row.point_error:8.2f}{1e-3 * row.softest:8.2f}{row.tension:6.0f}"
            f"{max(row.moment, 0.0):7.2f}"
        )
    return "\n".join(lines)
