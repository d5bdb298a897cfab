"""The arm's SDF, generated from the arm file: one source for lengths, masses and limits.

What it states, `links` has; joints carry the drives' stiffness and damping as Drake controller
gains. The rail is fixed to nothing: whoever loads the file says where frame {0} stands.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET

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


def make_sdf(arm: SerpentineArm) -> str:
    """The SDF text of an arm."""
    root = ET.Element("sdf", version="1.9")
    model = ET.SubElement(root, "model", name=arm.name)
    for link in make_links(arm):
        _add_link(model, link)
        if link.joint is not None:
            _add_joint(model, link.joint, link.name)
    for name, members in touching_groups(arm).items():
        group = ET.SubElement(model, drake_tag("collision_filter_group"), name=name)
        for member in members:
            ET.SubElement(group, drake_tag("member")).text = member
        ET.SubElement(group, drake_tag("ignored_collision_filter_group")).text = name
    return document(root, arm)


def _add_joint(model: ET.Element, joint: Joint, child: str) -> None:
    element = ET.SubElement(model, "joint", name=joint.name, type=joint.kind)
    ET.SubElement(element, "parent").text = joint.parent
    ET.SubElement(element, "child").text = child
    axis = ET.SubElement(element, "axis")
    ET.SubElement(axis, "xyz").text = unit_axis(joint)
    limit = ET.SubElement(axis, "limit")
    ET.SubElement(limit, "lower").text = number(joint.lower)
    ET.SubElement(limit, "upper").text = number(joint.upper)
    ET.SubElement(limit, "effort").text = number(joint.effort)
    ET.SubElement(limit, "velocity").text = number(joint.speed)
    add_drive_gains(element, joint)


def _add_link(model: ET.Element, link: Link) -> None:
    element = ET.SubElement(model, "link", name=link.name)
    if link.joint is not None:
        joint = link.joint
        pose = ET.SubElement(element, "pose", relative_to=joint.parent, rotation_format="quat_xyzw")
        turn = joint.rotation.as_quat(canonical=True)
        pose.text = numbers(joint.translation) + "  " + numbers(turn)
    inertial = ET.SubElement(element, "inertial")
    ET.SubElement(inertial, "pose").text = numbers(link.centre) + "  0 0 0"
    ET.SubElement(inertial, "mass").text = number(link.mass)
    inertia = ET.SubElement(inertial, "inertia")
    xx, yy, zz = link.moments
    tensor = {"ixx": xx, "ixy": 0.0, "ixz": 0.0, "iyy": yy, "iyz": 0.0, "izz": zz}
    for name, value in tensor.items():
        ET.SubElement(inertia, name).text = number(value)
    for role, shape in link.shapes():
        _add_shape(element, role, shape)


def _add_shape(link: ET.Element, role: str, shape: Shape) -> None:
    element = ET.SubElement(link, role, name=shape.name)
    if shape.rotation is None:
        ET.SubElement(element, "pose").text = numbers(shape.centre) + "  0 0 0"
    else:
        pose = ET.SubElement(element, "pose", rotation_format="quat_xyzw")
        turn = shape.rotation.as_quat(canonical=True)
        pose.text = seen_numbers(shape.centre) + "  " + seen_numbers(turn)
    solid = ET.SubElement(ET.SubElement(element, "geometry"), shape.kind)
    for name, text in dimensions(shape).items():
        ET.SubElement(solid, name).text = text
    if shape.colour is not None:
        material = ET.SubElement(element, "material")
        ET.SubElement(material, "diffuse").text = COLOURS[shape.colour]
