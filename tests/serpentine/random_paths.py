"""Random paths that an arm can follow because of how they are made, not because others are thrown
away: bends wide enough for its joints, and no farther than its rail and its length reach."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.tip_path import PathBuilder, TipPath, blended_path, polyline_path

from .torus_oracle import Chain

#: Smooth lines and arcs; the polyline of points on them; that polyline with its corners blended.
KINDS = ("smooth", "table", "blended")


@dataclass(frozen=True)
class Bend:
    """Straight on, then a turn.

    Attributes:
        straight: length of the line, m.
        wideness: the arc's radius as a multiple of the narrowest that the arm follows, >= 1.
        angle: of the turn, rad.
        side: where to, rad about the path's direction.
    """

    straight: float
    wideness: float
    angle: float
    side: float


def random_bends(rng: np.random.Generator) -> list[Bend]:
    """One to four bends."""
    return [
        Bend(
            straight=float(rng.uniform(0.0, 0.4)),
            wideness=float(rng.uniform(1.0, 3.0)),
            angle=float(rng.uniform(0.1, 1.5)),
            side=float(rng.uniform(-math.pi, math.pi)),
        )
        for _ in range(rng.integers(1, 5))
    ]


def narrowest_radius(arm: SerpentineArm) -> float:
    """Radius (m) that every joint of the arm follows within its limits.

    A module of chord Q on a circle of radius R turns by Q / R at its inner end. Its offset lets the
    outer link overshoot the chord by Delta / (Delta + S) of the odd angle, which the next joint
    takes back, and so on: together at most 1 / (1 - Delta / S) of it. Where lines and arcs of other
    planes follow each other, chords turn no faster than on the arcs. A tenth is left over for the
    corners of tables.
    """
    longest = float(np.max(arm.segment_length[:-1] + arm.segment_offset[:-1], initial=0.0))
    longest = max(longest, float(np.max(arm.chain.sum(axis=1))))
    overshoot = 1.0 / (1.0 - float(np.max(arm.chain[:, 0] / arm.chain[:, 1])))
    limit = float(np.min(arm.joint_upper[3:] - arm.joint_home[3:]))
    return 1.1 * overshoot * longest / limit


def home_spine(arm: SerpentineArm) -> np.ndarray:
    """The spine points (M + 1, 3) m at home, by the oracle's own kinematics."""
    chain = Chain(arm.dh_table, arm.joint_home)
    return chain.spine_points(arm.joint_home) * [1.0, -1.0 if arm.mirrored else 1.0, 1.0]


def bent_path(
    arm: SerpentineArm, bends: Sequence[Bend], *, reach: float = 1.0, kind: str = "smooth"
) -> TipPath:
    """From home on, up to `reach` of the arm's own length and of what the rail allows.

    Beyond 1 the base must leave the base line: the arm still solves, its limits may not hold.
    """
    spine = home_spine(arm)
    # The base line reaches a little farther back than spine point 4 does at home.
    base = spine[0] - [0.0, 0.0, 0.3]
    straight = float(spine[-1, 2] - base[2])
    rail = float(arm.joint_upper[0] - arm.joint_home[0])
    travel = reach * min(float(spine[-1, 2] - spine[0, 2]), 0.97 * rail)
    direction = np.array([0.0, 0.0, 1.0])
    builder = PathBuilder(start=base, direction=direction).line(straight).home()
    left = travel
    for bend in bends:
        length = min(bend.straight, left)
        if length > 1e-6:
            builder.line(length)
            left -= length
        radius = bend.wideness * narrowest_radius(arm)
        angle = min(bend.angle, left / radius)
        if angle > 1e-6:
            toward = _aside(direction, bend.side)
            builder.arc(radius=radius, angle=angle, toward=toward)
            direction = math.cos(angle) * direction + math.sin(angle) * toward
            left -= radius * angle
    if left > 1e-6:
        builder.line(left)
    smooth = builder.build(kind)
    if kind == "smooth":
        return smooth
    # As far apart as the report's tables, 7 in, and half a module at most: sharper corners at wider
    # spacing would turn some chords faster than the arcs do.
    spacing = min(0.18, 0.5 * float(np.min(arm.chain[:, 1])))
    count = max(2, math.ceil(travel / spacing))
    s = np.linspace(smooth.home_arc_length, smooth.length, count + 1)
    points = np.vstack([base, smooth.point(s)])
    return polyline_path(points, kind) if kind == "table" else blended_path(points, kind)


def _aside(direction: np.ndarray, side: float) -> np.ndarray:
    """A unit vector square to a direction, at an angle (rad) about it."""
    least = np.eye(3)[int(np.argmin(np.abs(direction)))]
    first = np.cross(direction, least)
    first /= np.linalg.norm(first)
    return math.cos(side) * first + math.sin(side) * np.cross(direction, first)
