"""The arm as links, joints and shapes in the arm's own hand: what SDF, URDF and MJCF all state.

A link's frame is its joint's Craig frame (FTL-95 Table A.1), so positions in a simulator are the
joint values of `kinematics`; link `rail` is frame {0}. Every body is a uniform box, which is
what collides (crossheads also with their actuators' pins); segments are drawn as trusses.
Joints have the drives' stiffness and damping, and hard stops where the strokes end, a little beyond
the limits that a plan must keep.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pips_drake.serpentine.arm import Body, SerpentineArm
from pips_drake.serpentine.drives import drive_limits, joint_effort_limit, joint_stiffness, levers
from pips_drake.serpentine.truss import Strut, crosshead_struts, segment_struts

Array = NDArray[np.float64]

#: Colours (RGBA) by the kind of body, told by its name.
COLOURS = {
    "rail": "0.35 0.37 0.40 1",
    "carriage": "0.25 0.27 0.30 1",
    "crane": "0.85 0.55 0.15 1",
    "gimbal": "0.85 0.55 0.15 1",
    "segment": "0.78 0.80 0.84 1",
    "crosshead": "0.20 0.22 0.26 1",
    "camera_head": "0.10 0.35 0.70 1",
    "lens": "0.02 0.02 0.03 1",
}


@dataclass(frozen=True, kw_only=True)
class Shape:
    """A solid in a link's frame.

    Attributes:
        name: unique in its link.
        kind: of solid; a cylinder stands along its z axis.
        size: (3,) edges of a box, (1,) radius of a sphere, (2,) radius and length of a cylinder, m.
        centre: (3,) m.
        rotation: of the solid's axes in the link's; None where they are the same.
        colour: a key of `COLOURS`; None where it is not drawn.
    """

    name: str
    kind: Literal["box", "sphere", "cylinder"]
    size: Array
    centre: Array
    rotation: Rotation | None = None
    colour: str | None = None


@dataclass(frozen=True, kw_only=True)
class Joint:
    """What holds a link to its parent, with its drive.

    Attributes:
        name: `d1`, `theta2`, ...
        slides: prismatic rather than revolute.
        parent: the parent link's name.
        translation, rotation: the child's frame in the parent's at joint value zero, (3,) m.
        axis: (3,), in the child's frame.
        lower, upper: hard stops, m or rad.
        effort, speed: limits, N or Nm, m/s or rad/s.
        stiffness, damping: of the drive, N/m or Nm/rad, times s.
    """

    name: str
    slides: bool
    parent: str
    translation: Array
    rotation: Rotation
    axis: Array
    lower: float
    upper: float
    effort: float
    speed: float
    stiffness: float
    damping: float

    @property
    def kind(self) -> str:
        """What SDF and URDF call it."""
        return "prismatic" if self.slides else "revolute"


@dataclass(frozen=True, kw_only=True)
class Link:
    """A rigid body.

    Attributes:
        name: of the arm's body.
        joint: to its parent; None for the rail.
        mass: kg.
        centre: of mass, in the link's frame, (3,) m.
        moments: of inertia about the centre, (3,) kg m^2; the link's axes are principal.
        visuals, collisions: shapes.
    """

    name: str
    joint: Joint | None
    mass: float
    centre: Array
    moments: Array
    visuals: tuple[Shape, ...]
    collisions: tuple[Shape, ...]

    def shapes(self) -> Iterator[tuple[Literal["visual", "collision"], Shape]]:
        """All shapes with what they are for."""
        for shape in self.visuals:
            yield "visual", shape
        for shape in self.collisions:
            yield "collision", shape


def make_links(arm: SerpentineArm) -> tuple[Link, ...]:
    """The rail, then a link a joint, in joint order; each hangs on the one before it."""
    bodies = (arm.rail, *arm.bodies)
    joints = (None, *_make_joints(arm))
    return tuple(_make_link(arm, b, joint) for b, joint in zip(bodies, joints, strict=True))


def hard_stops(arm: SerpentineArm) -> tuple[Array, Array]:
    """Where the joints stop for good, (joints,) each, m and rad: the ends of their strokes."""
    first = arm.first_actuated_joint
    lower = np.concatenate(
        [arm.joint_lower[:first] - arm.base_overtravel, arm.linkage.angle(arm.linkage.length_lower)]
    )
    upper = np.concatenate(
        [arm.joint_upper[:first] + arm.base_overtravel, arm.linkage.angle(arm.linkage.length_upper)]
    )
    return lower, upper


def touching_groups(arm: SerpentineArm) -> dict[str, tuple[str, ...]]:
    """Bodies that touch by design, by the group's name.

    Drake leaves out pairs that share a joint. The two segments at a universal joint do not, because
    its crosshead is between them; nor do the carriage and the first segment across the crane.
    """
    names = [body.name for body in arm.bodies]
    groups: dict[str, tuple[str, ...]] = {"motion_base": (names[0], names[1], names[2])}
    for i in range(arm.modules):
        first = arm.first_actuated_joint + 2 * i
        groups[f"universal_joint_{i + 1}"] = (names[first], names[first + 1], names[first + 2])
    return groups


def collision_shapes(arm: SerpentineArm, body: Body) -> list[Shape]:
    """What of a body collides, in its joint's frame: the box first, then a crosshead's pins."""
    centre = body.centre * arm.mirror
    shapes = [Shape(name=f"{body.name}_collision", kind="box", size=body.size, centre=centre)]
    if _kind(body) == "crosshead":
        for count, strut in enumerate(crosshead_struts(arm, arm.bodies.index(body)), start=1):
            size = np.array([strut.radius])
            shapes.append(Shape(name=f"pin_{count}", kind="sphere", size=size, centre=strut.end))
    return shapes


def _kind(body: Body) -> str:
    """Of a body: its name without its number."""
    return body.name.rstrip("0123456789_")


def _make_joints(arm: SerpentineArm) -> list[Joint]:
    stiffness, effort = joint_stiffness(arm), joint_effort_limit(arm)
    lower, upper = hard_stops(arm)
    speed = drive_limits(arm)[2] / levers(arm, np.zeros(arm.joints))
    bodies = (arm.rail, *arm.bodies)
    result = []
    for j, name in enumerate(arm.joint_names):
        slides = bool(arm.is_prismatic[j])
        translation, rotation = _relative_pose(arm, j)
        joint = Joint(
            name=name,
            slides=slides,
            parent=bodies[j].name,
            translation=translation,
            rotation=rotation,
            # Reflected frames, unreflected joint values (`kinematics`).
            axis=np.array([0.0, 0.0, -1.0 if arm.mirrored and not slides else 1.0]),
            lower=float(lower[j]),
            upper=float(upper[j]),
            effort=float(effort[j]),
            speed=float(speed[j]),
            stiffness=float(stiffness[j]),
            damping=float(stiffness[j] * arm.actuator_damping_time),
        )
        result.append(joint)
    return result


def _relative_pose(arm: SerpentineArm, j: int) -> tuple[Array, Rotation]:
    """Frame j's pose in its parent's frame at joint value zero."""
    alpha, a, d, theta, _ = arm.dh_table[j]
    tilt, turn = Rotation.from_euler("x", alpha), Rotation.from_euler("z", theta)
    translation = np.array([a, 0.0, 0.0]) + tilt.apply([0.0, 0.0, d])
    rotation = (tilt * turn).as_matrix()
    mirror = arm.mirror
    return mirror * translation, Rotation.from_matrix(mirror[:, None] * rotation * mirror)


def _make_link(arm: SerpentineArm, body: Body, joint: Joint | None) -> Link:
    centre = body.centre * arm.mirror
    collisions, visuals = collision_shapes(arm, body), []
    box, kind = collisions[0], _kind(body)
    if kind == "segment":
        for count, strut in enumerate(segment_struts(body), start=1):
            visuals.append(_drawn(_mirrored(arm, strut), f"strut_{count}", kind))
    else:
        visuals.append(replace(box, name=f"{body.name}_visual", colour=kind))
    if kind == "crosshead":
        # Both ends stand in this arm's hand already.
        struts = crosshead_struts(arm, arm.bodies.index(body))
        for count, strut in enumerate(struts, start=1):
            visuals.append(_drawn(strut, f"bracket_{count}", kind))
    if kind == "camera_head":
        # A lens, so that one sees where the camera looks.
        ahead = np.array([1.0, 0.0, 0.0])
        front = body.centre + 0.5 * body.size[0] * ahead
        radius = 0.32 * float(body.size[1])
        lens = Strut(start=front - 0.010 * ahead, end=front + 0.006 * ahead, radius=radius)
        visuals.append(_drawn(_mirrored(arm, lens), "lens", "lens"))
    return Link(
        name=body.name,
        joint=joint,
        mass=body.mass,
        centre=centre,
        moments=body.moments,
        visuals=tuple(visuals),
        collisions=tuple(collisions),
    )


def _mirrored(arm: SerpentineArm, strut: Strut) -> Strut:
    return replace(strut, start=strut.start * arm.mirror, end=strut.end * arm.mirror)


def _drawn(strut: Strut, name: str, colour: str) -> Shape:
    along = strut.end - strut.start
    # The shortest rotation that turns z into the strut's direction.
    z = along / np.linalg.norm(along)
    aside = np.cross([0.0, 0.0, 1.0], z)
    sine = float(np.linalg.norm(aside))
    turn = np.arctan2(sine, z[2])
    axis = aside / sine if sine > 0.0 else np.array([1.0, 0.0, 0.0])
    return Shape(
        name=name,
        kind="cylinder",
        size=np.array([strut.radius, np.linalg.norm(along)]),
        centre=0.5 * (strut.start + strut.end),
        rotation=Rotation.from_rotvec(turn * axis),
        colour=colour,
    )
