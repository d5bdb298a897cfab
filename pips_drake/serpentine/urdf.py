"""The arm's URDF, for other libraries: what the SDF states (`links`), in the words that URDF has.

Rotations stand as roll, pitch and yaw, because URDF has nothing else. Drake's own tags carry the
drives' gains and the pairs that touch by design; others pass over them. As in the SDF, the rail is
the root link and fixed to nothing.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.links import COLOURS, Joint, Link, Shape, make_links, touching_groups
from pips_drake.serpentine.xml_text import (
    add_drive_gains,
    dimensions,
    document,
    drake_tag,
    number,
    numbers,
    seen_numbers,
    unit_axis,
)

Array = NDArray[np.float64]


def make_urdf(arm: SerpentineArm) -> str:
    """The URDF text of an arm."""
    root = ET.Element("robot", name=arm.name)
    links = make_links(arm)
    used = {shape.colour for link in links for shape in link.visuals}
    for name in sorted(colour for colour in used if colour is not None):
        material = ET.SubElement(root, "material", name=name)
        ET.SubElement(material, "color", rgba=COLOURS[name])
    for link in links:
        _add_link(root, link)
    joints = [(link.joint, link.name) for link in links if link.joint is not None]
    for joint, child in joints:
        _add_joint(root, joint, child)
    for joint, _ in joints:
        _add_transmission(root, joint)
    for name, members in touching_groups(arm).items():
        group = ET.SubElement(root, drake_tag("collision_filter_group"), name=name)
        for member in members:
            ET.SubElement(group, drake_tag("member"), link=member)
        ET.SubElement(group, drake_tag("ignored_collision_filter_group"), name=name)
    return document(root, arm)


def roll_pitch_yaw(rotation: Rotation) -> Array:
    """Angles (3,) rad about the fixed X, then Y, then Z, as URDF's `rpy`.

    Good to the last digits beside a pitch of 90 deg too, where an arcsine, or a roll that is found
    without the yaw, would lose half of them. At 90 deg the yaw is 0.
    """
    R = rotation.as_matrix()
    level = math.hypot(R[0, 0], R[1, 0])
    pitch = math.atan2(-R[2, 0], level)
    # A level of a few roundings says nothing of the yaw.
    yaw = math.atan2(R[1, 0], R[0, 0]) if level > 1e-15 else 0.0
    # What is left when the yaw is undone.
    sine, cosine = math.sin(yaw), math.cos(yaw)
    roll = math.atan2(sine * R[0, 2] - cosine * R[1, 2], cosine * R[1, 1] - sine * R[0, 1])
    return np.array([roll, pitch, yaw])


def _add_link(root: ET.Element, link: Link) -> None:
    element = ET.SubElement(root, "link", name=link.name)
    inertial = ET.SubElement(element, "inertial")
    ET.SubElement(inertial, "origin", xyz=numbers(link.centre), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=number(link.mass))
    xx, yy, zz = (number(value) for value in link.moments)
    ET.SubElement(inertial, "inertia", ixx=xx, ixy="0", ixz="0", iyy=yy, iyz="0", izz=zz)
    for role, shape in link.shapes():
        _add_shape(element, role, shape)


def _add_shape(link: ET.Element, role: str, shape: Shape) -> None:
    element = ET.SubElement(link, role, name=shape.name)
    if shape.rotation is None:
        ET.SubElement(element, "origin", xyz=numbers(shape.centre), rpy="0 0 0")
    else:
        turn = seen_numbers(roll_pitch_yaw(shape.rotation))
        ET.SubElement(element, "origin", xyz=seen_numbers(shape.centre), rpy=turn)
    ET.SubElement(ET.SubElement(element, "geometry"), shape.kind, dimensions(shape))
    if shape.colour is not None:
        ET.SubElement(element, "material", name=shape.colour)


def _add_joint(root: ET.Element, joint: Joint, child: str) -> None:
    element = ET.SubElement(root, "joint", name=joint.name, type=joint.kind)
    rpy = numbers(roll_pitch_yaw(joint.rotation))
    ET.SubElement(element, "origin", xyz=numbers(joint.translation), rpy=rpy)
    ET.SubElement(element, "parent", link=joint.parent)
    ET.SubElement(element, "child", link=child)
    ET.SubElement(element, "axis", xyz=unit_axis(joint))
    ET.SubElement(
        element,
        "limit",
        lower=number(joint.lower),
        upper=number(joint.upper),
        effort=number(joint.effort),
        velocity=number(joint.speed),
    )


def _add_transmission(root: ET.Element, joint: Joint) -> None:
    """The drive: without one, Drake makes no actuator."""
    element = ET.SubElement(root, "transmission", name=f"{joint.name}_transmission")
    ET.SubElement(element, "type").text = "transmission_interface/SimpleTransmission"
    kind = "hardware_interface/PositionJointInterface"
    driven = ET.SubElement(element, "joint", name=joint.name)
    ET.SubElement(driven, "hardwareInterface").text = kind
    actuator = ET.SubElement(element, "actuator", name=joint.name)
    ET.SubElement(actuator, "mechanicalReduction").text = "1"
    add_drive_gains(actuator, joint)
