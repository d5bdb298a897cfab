"""Arms and paths that differ from a given one in a single respect, for design studies.

Each function takes an arm file and returns another; nothing is changed in place. What a variation
means is stated here, because "without offsets" leaves open where their length goes.
"""

from __future__ import annotations

import copy
from collections.abc import Callable

from pips_drake.config import require
from pips_drake.errors import UnknownNameError
from pips_drake.serpentine.arm_file import ArmFile
from pips_drake.serpentine.path_file import PathFile, PieceConfig
from pips_drake.units import DEGREE, INCH, JOINT_UNITS, LENGTH_UNITS


def scale_offsets(arm: ArmFile, factor: float) -> ArmFile:
    """Offsets Delta_i times a factor, at the same module lengths when straight.

    What an offset loses the next segment gains, S_{i+1} + Delta_i being kept: home stays where it
    was, so the same paths and scenes fit. The last offset is in no module and is only scaled.
    """
    require(0.0 <= factor <= 2.0, "arm.offset_scale", factor, "0 .. 2")
    varied = copy.deepcopy(arm)
    for inner, outer in zip(varied.segments[:-1], varied.segments[1:], strict=True):
        outer.length_in += (1.0 - factor) * inner.offset_in
    for segment in varied.segments:
        segment.offset_in *= factor
    return varied


def equalise_links(arm: ArmFile, share: float) -> ArmFile:
    """Segment lengths and offsets moved to their means by a share: 0 as they are, 1 all equal.

    The arm keeps its length and its boxes; the last offset is in no module and stays.
    """
    require(0.0 <= share <= 1.0, "arm.equal_links", share, "0 .. 1")
    varied = copy.deepcopy(arm)
    count = len(varied.segments)
    length = sum(segment.length_in for segment in varied.segments) / count
    offset = sum(segment.offset_in for segment in varied.segments[:-1]) / (count - 1)
    for segment in varied.segments:
        segment.length_in += share * (length - segment.length_in)
    for segment in varied.segments[:-1]:
        segment.offset_in += share * (offset - segment.offset_in)
    return varied


def set_travel(arm: ArmFile, travel_in: float) -> ArmFile:
    """The slide goes this far from its lower limit (in); the rail ends as much later or sooner."""
    require(0.0 < travel_in <= 1000.0, "arm.travel_in", travel_in, "> 0 and <= 1000")
    varied = copy.deepcopy(arm)
    slide = varied.joints[0]
    inch = INCH / JOINT_UNITS[slide.unit]  # in the slide's unit
    upper = slide.lower + travel_in * inch
    varied.rail.end_in += (upper - slide.upper) / inch
    slide.upper = upper
    return varied


def set_joint_limits(arm: ArmFile, limit_deg: float) -> ArmFile:
    """Every hinge of the truss (theta3 on) goes this far either way, deg."""
    require(0.0 < limit_deg < 90.0, "arm.joint_limit_deg", limit_deg, "> 0 and < 90")
    varied = copy.deepcopy(arm)
    for joint in varied.joints[2:]:
        limit = limit_deg * DEGREE / JOINT_UNITS[joint.unit]
        joint.lower, joint.upper = joint.home - limit, joint.home + limit
    return varied


def scale_boxes(arm: ArmFile, factor: float) -> ArmFile:
    """Widths of the truss boxes times a factor, masses as the square.

    So do the prototype's own boxes, nearly: from small to large, 1.5 times as wide, 2.06 times as
    heavy a length. The actuators' pins keep their places: forces change by the masses alone.
    """
    require(0.1 <= factor <= 10.0, "arm.box_width_scale", factor, "0.1 .. 10")
    varied = copy.deepcopy(arm)
    for box in varied.boxes.values():
        box.width_in *= factor
        box.mass_kg *= factor**2
    return varied


def scale_stiffness(arm: ArmFile, factor: float) -> ArmFile:
    """Stiffness of all actuators and of the base's drives times a factor."""
    require(1e-3 <= factor <= 1e3, "arm.stiffness_scale", factor, "0.001 .. 1000")
    varied = copy.deepcopy(arm)
    for box in varied.boxes.values():
        box.actuator_stiffness_N_per_m *= factor
    varied.motion_base_drives.d1.stiffness_N_per_m *= factor
    varied.motion_base_drives.theta2.stiffness_Nm_per_rad *= factor
    return varied


#: By the field of a study that asks for it.
ARM_VARIATIONS: dict[str, Callable[[ArmFile, float], ArmFile]] = {
    "arm.offset_scale": scale_offsets,
    "arm.equal_links": equalise_links,
    "arm.travel_in": set_travel,
    "arm.joint_limit_deg": set_joint_limits,
    "arm.box_width_scale": scale_boxes,
    "arm.stiffness_scale": scale_stiffness,
}


def vary_arm(arm: ArmFile, field: str, value: float) -> ArmFile:
    """An arm with one variation.

    Raises:
        UnknownNameError: no such variation.
        InputError: a value that it cannot have.
    """
    if field not in ARM_VARIATIONS:
        raise UnknownNameError("variation", field, list(ARM_VARIATIONS))
    return ARM_VARIATIONS[field](arm, value)


def set_path_travel(path: PathFile, travel_in: float) -> PathFile:
    """A path of lines and arcs whose tip travels this far (in): cut short, or led straight on."""
    require(0.0 < travel_in <= 1000.0, "path.travel_in", travel_in, "> 0 and <= 1000")
    varied = copy.deepcopy(path)
    left = travel_in * INCH / LENGTH_UNITS[varied.unit]
    pieces = [varied.pieces[0]]
    for piece in varied.pieces[1:]:
        length = _length(piece)
        if left <= length:
            pieces.append(_cut(piece, left / length))
            left = 0.0
            break
        pieces.append(piece)
        left -= length
    if left > 0.0:
        pieces.append(PieceConfig(line=left))
    varied.pieces = pieces
    return varied


def _length(piece: PieceConfig) -> float:
    if piece.line is not None:
        return piece.line
    assert piece.arc is not None and piece.angle_deg is not None  # its `validate`
    return piece.arc * piece.angle_deg * DEGREE


def _cut(piece: PieceConfig, share: float) -> PieceConfig:
    if piece.line is not None:
        return PieceConfig(line=piece.line * share)
    assert piece.angle_deg is not None  # its `validate`
    return PieceConfig(arc=piece.arc, angle_deg=piece.angle_deg * share, toward=piece.toward)
