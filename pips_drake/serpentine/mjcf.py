"""The arm's MJCF, for MuJoCo: what the SDF states (`links`), as MuJoCo says it.

Link `rail` is frame {0}, and stands in the world as a mounting says, because MJCF has a gravity and
no way to weld a model later. Joint values are the report's. The drives are position actuators
whose gains are the drives' stiffness and damping; MuJoCo knows no speed limits, so they are left
out. `implicitfast` takes the damping implicitly, which at steps below twice the damping time keeps
the stiff joints stable. Drake can read the file too, but not the damping: it has the SDF for that.

Key frame `home` has the arm at home, its drives holding it there. Site `tip` is the tip (the
last joint's frame).
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from itertools import combinations, pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.links import COLOURS, Joint, Link, Shape, make_links, touching_groups
from pips_drake.serpentine.mounting import GRAVITY, mounting_rotation
from pips_drake.serpentine.xml_text import document, number, numbers, seen_numbers, unit_axis

#: The step of the twin's plant, s.
TIME_STEP = 1.0 / 512.0


def make_mjcf(arm: SerpentineArm, mounting: str = "laboratory") -> str:
    """The MJCF text of an arm.

    Args:
        mounting: how frame {0} stands in the world (`mounting`); `laboratory` is the world's frame.

    Raises:
        UnknownNameError: no such mounting.
    """
    links = make_links(arm)
    root = ET.Element("mujoco", model=arm.name)
    ET.SubElement(
        root,
        "compiler",
        angle="radian",
        autolimits="true",
        inertiafromgeom="false",  # masses and inertias are stated
    )
    ET.SubElement(
        root,
        "option",
        timestep=number(TIME_STEP),
        gravity=numbers([0.0, 0.0, -GRAVITY]),
        integrator="implicitfast",
    )
    default = ET.SubElement(root, "default")
    seen = ET.SubElement(default, "default", {"class": "visual"})
    ET.SubElement(seen, "geom", contype="0", conaffinity="0", group="2")
    collides = ET.SubElement(default, "default", {"class": "collision"})
    ET.SubElement(collides, "geom", group="3")
    # Commands end where the joints do. Drake would take a `ctrlrange` for limits of the efforts.
    ET.SubElement(default, "position", inheritrange="1")
    parent = ET.SubElement(root, "worldbody")
    for link in links:
        parent = _add_body(parent, link, mounting)
    ET.SubElement(parent, "site", name="tip", pos="0 0 0")
    contact = ET.SubElement(root, "contact")
    for one, other in _touching_pairs(arm):
        ET.SubElement(contact, "exclude", body1=one, body2=other)
    actuators = ET.SubElement(root, "actuator")
    for link in links:
        if link.joint is not None:
            _add_actuator(actuators, link.joint)
    keyframe = ET.SubElement(root, "keyframe")
    home = numbers(arm.joint_home)
    ET.SubElement(keyframe, "key", name="home", qpos=home, ctrl=home)
    return document(root, arm)


def _touching_pairs(arm: SerpentineArm) -> list[tuple[str, str]]:
    """Pairs that touch by design, in order.

    Neighbours are among them: MuJoCo leaves those out by itself, but not beside a body that is
    fixed to the world, as the rail is.
    """
    names = [arm.rail.name, *(body.name for body in arm.bodies)]
    pairs = set(pairwise(names))
    for members in touching_groups(arm).values():
        pairs |= set(combinations(members, 2))
    return sorted(pairs, key=lambda pair: (names.index(pair[0]), names.index(pair[1])))


def _quaternion(rotation: Rotation) -> np.ndarray:
    """Its unit quaternion (4,), the scalar first as in MJCF."""
    return np.roll(rotation.as_quat(canonical=True), 1)


def _add_body(parent: ET.Element, link: Link, mounting: str) -> ET.Element:
    joint = link.joint
    if joint is None:
        translation, rotation = np.zeros(3), Rotation.from_matrix(mounting_rotation(mounting))
    else:
        translation, rotation = joint.translation, joint.rotation
    body = ET.SubElement(
        parent,
        "body",
        name=link.name,
        pos=numbers(translation),
        quat=numbers(_quaternion(rotation)),
    )
    ET.SubElement(
        body,
        "inertial",
        pos=numbers(link.centre),
        mass=number(link.mass),
        diaginertia=numbers(link.moments),
    )
    if joint is not None:
        ET.SubElement(
            body,
            "joint",
            name=joint.name,
            type="slide" if joint.slides else "hinge",
            axis=unit_axis(joint),
            range=numbers([joint.lower, joint.upper]),
        )
    for role, shape in link.shapes():
        # Names are the whole model's in MJCF.
        own = shape.name if shape.name.startswith(link.name) else f"{link.name}_{shape.name}"
        _add_geom(body, shape, role, {"name": own} if role == "collision" else {})
    return body


def _add_geom(body: ET.Element, shape: Shape, role: str, name: dict[str, str]) -> None:
    geom = ET.SubElement(body, "geom", name | {"class": role, "type": shape.kind})
    match shape.kind:
        case "box":
            geom.set("size", numbers(0.5 * shape.size))
        case "sphere":
            geom.set("size", numbers(shape.size))
        case "cylinder":
            radius, length = shape.size
            geom.set("size", seen_numbers([radius, 0.5 * length], 6))
    if shape.rotation is None:
        geom.set("pos", numbers(shape.centre))
    else:
        geom.set("pos", seen_numbers(shape.centre))
        geom.set("quat", seen_numbers(_quaternion(shape.rotation)))
    if shape.colour is not None:
        geom.set("rgba", COLOURS[shape.colour])


def _add_actuator(actuators: ET.Element, joint: Joint) -> None:
    ET.SubElement(
        actuators,
        "position",
        name=joint.name,
        joint=joint.name,
        kp=number(joint.stiffness),
        kv=number(joint.damping),
        forcerange=numbers([-joint.effort, joint.effort]),
    )
