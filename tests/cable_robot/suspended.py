"""A platform hung over a quarter pipe, on eight cables from four posts, as the survey's."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.station import BoxObstacle

#: Half sizes of the platform's box, m.
HALF = np.array([0.3, 0.2, 0.2])


def suspended_robot(*, low: float = 1.5, top: float = 5.0, **changes: Any) -> CableRobot:
    """40 kg, four cables from the posts' tops to the box's upper vertices and four from `low`.

    Odd numbers (from 1) are the upper cables.
    """
    anchors, attachments = [], []
    for x in (-1.0, 1.0):
        for y in (-1.0, 1.0):
            for height, up in ((top, 1.0), (low, -1.0)):
                anchors.append([10.4 * x, 7.4 * y, height])
                attachments.append(HALF * [x, y, up])
    numbers: dict[str, Any] = {
        "name": "suspended",
        "anchors": anchors,
        "attachments": attachments,
        "mass": 40.0,
        "axial_stiffness": [1e6],
        "tension_min": 10.0,
        "tension_max": 2000.0,
        "box": 2.0 * HALF,
    }
    return CableRobot(**(numbers | changes))


def crossed_robot(**changes: Any) -> CableRobot:
    """The same platform on crossed cables, all from high above: it resists moments too."""
    signs = [[-1, -1, -1], [1, -1, -1], [-1, 1, -1], [1, 1, -1]]
    signs += [[-1, -1, 1], [1, -1, 1], [-1, 1, 1], [1, 1, 1]]
    ends = [[-1, 1, 6.0], [-1, -1, 6.5], [1, 1, 6.5], [1, -1, 6.0]]
    ends += [[1, -1, 6.5], [1, 1, 6.0], [-1, -1, 6.0], [-1, 1, 6.5]]
    anchors = np.array(ends) * [11.0, 7.0, 1.0]
    return suspended_robot(anchors=anchors, attachments=HALF * np.array(signs), **changes)


def quarter_pipe(pieces: int = 8) -> list[BoxObstacle]:
    """Staves of a quarter pipe of radius 2.286 m on starboard, from the sill down and outwards."""
    radius, thickness, boxes = 2.286, 0.05, []
    step = 0.5 * math.pi / pieces
    for k in range(pieces):
        angle = (k + 0.5) * step
        inward = np.array([0.0, math.cos(angle), math.sin(angle)])
        X_WB = np.eye(4)
        X_WB[:3, 1], X_WB[:3, 2] = np.cross(inward, [1.0, 0.0, 0.0]), inward
        X_WB[:3, 3] = [0.0, 2.0 * radius, 0.0] - (radius + 0.5 * thickness) * inward
        size = np.array([18.288, 2.0 * radius * math.tan(0.5 * step), thickness])
        boxes.append(BoxObstacle(name=f"stave_{k + 1}", size=size, X_WB=X_WB))
    return boxes
