"""How the arm's bodies look: struts of a truss, from the arm's data.

FTL-95 section 2.1: a tetrahedral truss whose spine follows the corners opposite the linear
actuators. A segment is drawn as a square truss that narrows to a point on the spine at both ends,
where the hinges are. What collides is the body's box, and on a
crosshead the pins of its actuators, which leave the neighbours' boxes when a joint bends.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pips_drake.serpentine.arm import Body, SerpentineArm
from pips_drake.serpentine.kinematics import frames

Array = NDArray[np.float64]

#: Radius of a strut, and length of the points at both ends, as shares of the truss's width.
STRUT_RADIUS, POINT_LENGTH = 0.028, 0.45
#: Bays of a segment are about as long as this share of its width.
BAY_LENGTH = 0.8
#: More bays than this are not drawn: a segment of kilometres would take minutes, and shows nothing.
MOST_BAYS = 200
#: Radius of an actuator as a share of its pins' distance from the hinge: the pins stand 0.707 of a
#: box's width beside the spine, and its faces 0.75.
TUBE_RADIUS, ROD_RADIUS = 0.042, 0.024


@dataclass(frozen=True, kw_only=True)
class Strut:
    """A round bar between two points (3,) m of a body's frame."""

    start: Array
    end: Array
    radius: float


def segment_struts(body: Body) -> list[Strut]:
    """The struts of a segment: four longerons with frames and diagonals, and a point at each end.

    Args:
        body: its box gives length (along x) and width, and how it lies beside the spine (x axis).
    """
    length, width = float(body.size[0]), float(body.size[1])
    point = min(POINT_LENGTH * width, 0.3 * length)
    radius = STRUT_RADIUS * width
    inset = 0.5 * width - radius
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * inset + body.centre[1:]
    bays = min(max(1, round((length - 2.0 * point) / (BAY_LENGTH * width))), MOST_BAYS)
    stations = [
        np.column_stack([np.full(4, x), corners])
        for x in np.linspace(point, length - point, bays + 1)
    ]
    struts = []
    for frame in stations:
        struts += [(frame[k], frame[(k + 1) % 4]) for k in range(4)]
    for number, (inner, outer) in enumerate(pairwise(stations)):
        struts += [(inner[k], outer[k]) for k in range(4)]
        # Diagonals that alternate from bay to bay, as in a warren truss.
        for k in range(4):
            left, right = (k, (k + 1) % 4) if (k + number) % 2 == 0 else ((k + 1) % 4, k)
            struts.append((inner[left], outer[right]))
    struts += [(np.zeros(3), corner) for corner in stations[0]]
    struts += [(corner, np.array([length, 0.0, 0.0])) for corner in stations[-1]]
    return [Strut(start=start, end=end, radius=radius) for start, end in struts]


def actuator_pins(arm: SerpentineArm) -> tuple[Array, Array]:
    """Where the actuators L3 .. are pinned, (A, 3) m each: in the inner and in the outer body.

    The pins lie in the plane square to the hinge, on its -Y side, and the hinge is straight with
    phi0 between them; turning it by +theta then opens the angle between them (`linkage`).
    """
    linkage, first = arm.linkage, arm.first_actuated_joint
    beta = 0.5 * (np.pi - linkage.pin_angle)
    cosine, sine, zero = np.cos(beta), -np.sin(beta), np.zeros_like(beta)
    outer = np.column_stack([cosine, sine, zero]) * linkage.anchor_outer[:, None] * arm.mirror
    inner = np.column_stack([-cosine, sine, zero]) * linkage.anchor_inner[:, None] * arm.mirror
    # The inner pins belong to the body before the hinge: through the hinge at joint value zero.
    straight = frames(arm, np.zeros(arm.joints))[0]
    inner = np.column_stack([inner, np.ones(len(inner))])
    in_body = [
        np.linalg.solve(straight[j - 1], straight[j] @ pin)[:3]
        for j, pin in enumerate(inner, start=first)
    ]
    return np.array(in_body), outer


def crosshead_struts(arm: SerpentineArm, joint: int) -> list[Strut]:
    """Brackets from a crosshead to the pins it carries, in the frame of its joint (index)."""
    inner, outer = actuator_pins(arm)
    first, linkage, body = arm.first_actuated_joint, arm.linkage, arm.bodies[joint]
    radius = TUBE_RADIUS * float(linkage.anchor_outer[joint - first])
    ends = (outer[joint - first], inner[joint + 1 - first])
    middle = body.centre * arm.mirror
    return [Strut(start=middle, end=end, radius=radius) for end in ends]
