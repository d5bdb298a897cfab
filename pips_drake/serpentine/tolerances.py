"""An arm and a payload that are not quite what the plan believes: errors, and draws of them.

A tolerance is half a width: the error lies evenly within plus and minus that much, independently of
every other one. Names and units are those of a study's `tolerances`.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pips_drake.config import require
from pips_drake.errors import InputError, UnknownNameError
from pips_drake.serpentine.arm import SerpentineArm, make_arm
from pips_drake.serpentine.arm_file import ArmFile
from pips_drake.serpentine.fault_config import BUILD_FAULTS, FaultConfig
from pips_drake.units import DEGREE, INCH

Array = NDArray[np.float64]

#: What may be uncertain, and the largest tolerance that means anything.
TOLERANCES = {
    "payload_mm": 1000.0,  # where the payload stands, each coordinate in frame_0
    "link_mm": 10.0,  # each segment's length and each offset
    "joint_deg": 5.0,  # each hinge, the whole way: its encoder's zero
    "rail_mm": 100.0,  # the slide, the same
    "sag_share": 1.0,  # share of the static deflection that the compensation gets wrong
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Errors:
    """What differs from the plan, all the way along it.

    Attributes:
        payload: displacement, (3,) m in frame_0.
        lengths: of segments and then of offsets, (2 S,) m.
        joints: (J,) m and rad.
        sag_share: by which part of the static deflection the arm hangs lower than it should.
    """

    payload: Array
    lengths: Array
    joints: Array
    sag_share: float

    @classmethod
    def from_vector(cls, arm: SerpentineArm, values: Array) -> Errors:
        """The inverse of `vector`."""
        lengths = 2 * len(arm.segment_length)
        payload, link, joints, sag = np.split(values, [3, 3 + lengths, 3 + lengths + arm.joints])
        return cls(payload=payload, lengths=link, joints=joints, sag_share=float(sag[0]))

    @property
    def vector(self) -> Array:
        """All errors in one row: payload, lengths, joints, sag."""
        return np.concatenate([self.payload, self.lengths, self.joints, [self.sag_share]])


def half_widths(arm: SerpentineArm, tolerances: Mapping[str, float]) -> Array:
    """Tolerances of `Errors.vector`'s values, SI.

    An offset of zero is a joint without one, and has no error.

    Raises:
        InputError: an unknown name, or a value that means nothing.
    """
    for name, value in tolerances.items():
        if name not in TOLERANCES:
            raise UnknownNameError("tolerance", name, list(TOLERANCES))
        most = TOLERANCES[name]
        require(0.0 <= value <= most, f"tolerances.{name}", value, f"0 .. {most:g}")
    given = {name: tolerances.get(name, 0.0) for name in TOLERANCES}
    link = np.full(2 * len(arm.segment_length), given["link_mm"] * 1e-3)
    link[len(arm.segment_length) :][arm.segment_offset == 0.0] = 0.0
    joints = np.where(arm.is_prismatic, given["rail_mm"] * 1e-3, given["joint_deg"] * DEGREE)
    payload = np.full(3, given["payload_mm"] * 1e-3)
    return np.concatenate([payload, link, joints, [given["sag_share"]]])


def draw(widths: Array, seed: int, index: int) -> Array:
    """Draw number `index`, which does not depend on how many there are."""
    return widths * np.random.default_rng([seed, index]).uniform(-1.0, 1.0, widths.size)


def arm_with_errors(config: ArmFile, errors: Errors) -> SerpentineArm:
    """The arm as it is built: its segments and offsets longer or shorter."""
    varied = copy.deepcopy(config)
    length, offset = np.split(errors.lengths / INCH, 2)
    for i, segment in enumerate(varied.segments):
        segment.length_in += float(length[i])
        segment.offset_in = max(0.0, segment.offset_in + float(offset[i]))
    return make_arm(varied)


def arm_as_built(config: ArmFile, faults: Sequence[FaultConfig]) -> SerpentineArm:
    """The arm that an arm file states, but for what faults of its making change.

    A pin that stands elsewhere leaves the actuator itself and its stroke as they are, so that the
    same length holds another angle.

    Raises:
        UnknownNameError, InputError: the arm has no such actuator or segment, or cannot be built.
    """
    segments = len(config.segments)
    lengths = np.zeros(2 * segments)
    for fault in faults:
        if fault.kind == "segment_length":
            allowed = f"1 .. {segments}, the arm's segments"
            require(fault.segment <= segments, "faults.segment", fault.segment, allowed)
            lengths[fault.segment - 1] += fault.size * 1e-3
    for i, segment in enumerate(config.segments):
        length = segment.length_in * INCH + float(lengths[i])
        good = length > segment.offset_in * INCH
        require(good, f"length of segment {i + 1}, m", length, "longer than its offset")
    arm = arm_with_errors(
        config,
        Errors(
            payload=np.zeros(3), lengths=lengths, joints=np.zeros(len(config.joints)), sag_share=0.0
        ),
    )
    outer = arm.linkage.anchor_outer.copy()
    for fault in faults:
        if fault.kind == "anchor":
            if fault.drive not in arm.actuator_names:
                raise UnknownNameError("actuator", fault.drive, arm.actuator_names)
            outer[arm.actuator_names.index(fault.drive)] += fault.size * 1e-3
    linkage = replace(arm.linkage, anchor_outer=outer)
    ends = np.stack([linkage.angle(linkage.length_lower), linkage.angle(linkage.length_upper)])
    for k in np.flatnonzero(~np.all(np.isfinite(ends), axis=0) | (outer <= 0.0)):
        raise InputError(
            f"faults: the outer pin of {arm.actuator_names[k]}, {outer[k] * 1e3:.1f} mm from its "
            "hinge; must close a triangle at every length of the actuator's stroke"
        )
    return replace(arm, linkage=linkage)


def is_built_otherwise(faults: Sequence[FaultConfig]) -> bool:
    """Whether faults make the arm another one than is believed."""
    return any(fault.kind in BUILD_FAULTS for fault in faults)


def worst_of(widths: Array, gradient: Array) -> Array:
    """The corner of the tolerances that lowers a distance most, as far as its gradient says."""
    return -np.sign(gradient) * widths + 0.0  # no negative zeros
