"""The machine's SDF models, generated from its configuration: one source for every length.

The files under models/sdf are those of the shipped machine; any other is parsed from the text.
Masses and shapes are those of `links`, a prism as the boxes whose union it is. Joints carry the
drives' gains as Drake's.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable

from pips_drake.remote_manipulator.configuration import RemoteManipulatorConfig
from pips_drake.remote_manipulator.geometry import Part
from pips_drake.remote_manipulator.links import (
    Joint,
    Link,
    arm_links,
    bay_link,
    cae_link,
    orbiter_link,
    payload_link,
)

_DRAKE = "http://drake.mit.edu"
#: Of each of two bodies in contact, N/m, assumed: 10 t at 0.06 m/s press 2 mm into each other.
#: Drake's default follows from gravity, which is next to nothing here.
CONTACT_STIFFNESS = 2e7
#: Hunt and Crossley's, s/m, assumed: a bounce at 0.06 m/s keeps about half of the speed.
CONTACT_DISSIPATION = 20.0
#: Assumed: painted metal and blankets.
CONTACT_FRICTION = 0.3
#: Links that would touch across another link, by the group's name; Drake leaves out neighbours.
ARM_NEIGHBOURS = {
    "shoulder_joints": ("stand", "telescope", "shoulder", "arm_0"),
    "wrist_joints": ("arm_1", "wrist_heading", "wrist_pitch", "effector"),
    "elbow_joint": ("arm_0", "arm_1", "wrist_heading"),
}


def make_arm_sdf(config: RemoteManipulatorConfig) -> str:
    """Stand, arm and effector: `rms_arm`."""
    return _document(config, "rms_arm", arm_links(config), ARM_NEIGHBOURS)


def make_payload_sdf(config: RemoteManipulatorConfig) -> str:
    """The payload: `rms_payload`."""
    return _document(config, "rms_payload", (payload_link(config),))


def make_cargo_bay_sdf(config: RemoteManipulatorConfig) -> str:
    """The cargo bay: `rms_cargo_bay`."""
    return _document(config, "rms_cargo_bay", (bay_link(config),))


def make_cae_sdf(config: RemoteManipulatorConfig) -> str:
    """The central assembly element: `rms_cae`."""
    return _document(config, "rms_cae", (cae_link(config),))


def make_orbiter_sdf(config: RemoteManipulatorConfig) -> str:
    """The orbiter's outline: `rms_orbiter`."""
    return _document(config, "rms_orbiter", (orbiter_link(config),))


#: What makes each model's text, by its name.
MODELS: dict[str, Callable[[RemoteManipulatorConfig], str]] = {
    "rms_arm": make_arm_sdf,
    "rms_cae": make_cae_sdf,
    "rms_cargo_bay": make_cargo_bay_sdf,
    "rms_orbiter": make_orbiter_sdf,
    "rms_payload": make_payload_sdf,
}


def _number(value: float) -> str:
    """Ten digits: far below what any of the lengths means, and without the sums' rounding."""
    return f"{value:.10g}" if abs(value) > 1e-12 else "0"


def _numbers(values: Iterable[float]) -> str:
    return " ".join(_number(value) for value in values)


def _drake(name: str) -> str:
    ET.register_namespace("drake", _DRAKE)
    return f"{{{_DRAKE}}}{name}"


def _document(
    config: RemoteManipulatorConfig,
    name: str,
    links: tuple[Link, ...],
    filters: dict[str, tuple[str, ...]] | None = None,
) -> str:
    root = ET.Element("sdf", version="1.9")
    said = f" Generated from models/manipulators/{config.name}.yaml: edit that. "
    root.append(ET.Comment(said))
    model = ET.SubElement(root, "model", name=name)
    for link in links:
        _add_link(model, link)
        if link.joint is not None:
            _add_joint(model, link.joint, link.name)
    for group_name, members in (filters or {}).items():
        group = ET.SubElement(model, _drake("collision_filter_group"), name=group_name)
        for member in members:
            ET.SubElement(group, _drake("member")).text = member
        ET.SubElement(group, _drake("ignored_collision_filter_group")).text = group_name
    ET.indent(root)
    return '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _add_link(model: ET.Element, link: Link) -> None:
    element = ET.SubElement(model, "link", name=link.name)
    if link.joint is not None:
        pose = ET.SubElement(element, "pose", relative_to=link.joint.parent)
        pose.text = _numbers(link.joint.offset) + "  0 0 0"
    inertial = ET.SubElement(element, "inertial")
    ET.SubElement(inertial, "pose").text = _numbers(link.centre) + "  0 0 0"
    ET.SubElement(inertial, "mass").text = _number(link.mass)
    inertia = ET.SubElement(inertial, "inertia")
    for axis, moment in zip(("ixx", "iyy", "izz"), link.moments, strict=True):
        ET.SubElement(inertia, axis).text = _number(moment)
    for axis in ("ixy", "ixz", "iyz"):
        ET.SubElement(inertia, axis).text = "0"
    for part in link.parts:
        for box in part.boxes():
            _add_shape(element, "visual", box)
            if box.solid:
                _add_shape(element, "collision", box)


def _add_joint(model: ET.Element, joint: Joint, child: str) -> None:
    kind = "prismatic" if joint.slides else "revolute"
    element = ET.SubElement(model, "joint", name=joint.name, type=kind)
    ET.SubElement(element, "parent").text = joint.parent
    ET.SubElement(element, "child").text = child
    axis = ET.SubElement(element, "axis")
    ET.SubElement(axis, "xyz").text = _numbers(joint.axis)
    limit = ET.SubElement(axis, "limit")
    for name, value in (
        ("lower", joint.lower),
        ("upper", joint.upper),
        ("effort", joint.effort),
        ("velocity", joint.rate),
    ):
        ET.SubElement(limit, name).text = _number(value)
    gains = {"p": _number(joint.stiffness), "d": _number(joint.damping)}
    ET.SubElement(element, _drake("controller_gains"), gains)


def _add_shape(link: ET.Element, role: str, part: Part) -> None:
    seen = role == "visual" and part.solid
    element = ET.SubElement(link, role, name=f"{part.name}_visual" if seen else part.name)
    ET.SubElement(element, "pose").text = _numbers(part.position) + "  " + _numbers(part.rpy)
    solid = ET.SubElement(ET.SubElement(element, "geometry"), part.kind)
    if part.kind == "box":
        ET.SubElement(solid, "size").text = _numbers(part.size)
    else:
        diameter, length = part.size
        ET.SubElement(solid, "radius").text = _number(0.5 * diameter)
        ET.SubElement(solid, "length").text = _number(length)
    if role == "visual":
        material = ET.SubElement(element, "material")
        ET.SubElement(material, "diffuse").text = _numbers(part.color) + " 1"
        return
    properties = ET.SubElement(element, _drake("proximity_properties"))
    for name, value in (
        ("point_contact_stiffness", CONTACT_STIFFNESS),
        ("hunt_crossley_dissipation", CONTACT_DISSIPATION),
        ("mu_dynamic", CONTACT_FRICTION),
        ("mu_static", CONTACT_FRICTION),
    ):
        ET.SubElement(properties, _drake(name)).text = _number(value)
