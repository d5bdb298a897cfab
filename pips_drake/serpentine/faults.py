"""What faults do to set-points and readings, as plain functions of time.

Faults act on what they are faults of, nothing else: a drive's on its set-point, after the servo has
computed it, so that it stays within what the drive can do; an encoder's on its reading alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pips_drake.errors import UnknownNameError
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.drives import drive_names, drives_from_joints
from pips_drake.serpentine.fault_config import DRIVE_FAULTS, ENCODER_FAULTS, FaultConfig
from pips_drake.units import DEGREE

Array = NDArray[np.float64]

#: Times that are multiples of a period are this much off by rounding at most, s.
_ROUNDING = 1e-9


@dataclass(frozen=True, kw_only=True)
class Fault:
    """A fault of one drive or encoder, or of the servos' clock (`late`, index -1). SI.

    Attributes:
        index: of the joint that it belongs to.
        start, end: when it is there, s.
        size: see `FaultConfig`; a share, m or rad.
        lower, upper: of `limited`, ends of the drive's coordinate, m or rad.
    """

    kind: str
    index: int
    start: float
    end: float
    size: float
    lower: float = -math.inf
    upper: float = math.inf

    def is_active(self, time: float) -> bool:
        """Whether it is there at a time, s."""
        return self.start - _ROUNDING <= time < self.end - _ROUNDING


def end_of(config: FaultConfig) -> float:
    """When a fault ends, s; infinite for one that stays."""
    return config.start_s + config.duration_s if config.duration_s > 0.0 else math.inf


def make_drive_faults(arm: SerpentineArm, configs: Sequence[FaultConfig]) -> tuple[Fault, ...]:
    """The faults of drives, and of their servos' clock.

    Raises:
        UnknownNameError: the arm has no such drive.
    """
    found = []
    for config in configs:
        if config.kind not in (*DRIVE_FAULTS, "late"):
            continue
        index, lower, upper = -1, -math.inf, math.inf
        if config.kind == "weak":
            first = arm.first_actuated_joint
            index = first + _find("actuator", config.drive, arm.actuator_names)
        elif config.kind != "late":
            index = _find("drive", config.drive, drive_names(arm))
        if config.kind == "limited":
            lower, upper = _limited_stroke(arm, index, config.size)
        found.append(_make_fault(config, index, config.size, (lower, upper)))
    return tuple(found)


def make_encoder_faults(arm: SerpentineArm, configs: Sequence[FaultConfig]) -> tuple[Fault, ...]:
    """The faults of encoders, one a joint.

    Raises:
        UnknownNameError: the arm has no such joint.
    """
    found = []
    for config in configs:
        if config.kind in ENCODER_FAULTS:
            index = _find("encoder", config.encoder, arm.joint_names)
            unit = 1e-3 if arm.is_prismatic[index] else DEGREE
            found.append(_make_fault(config, index, config.size * unit))
    return tuple(found)


def limits_with_faults(
    faults: Sequence[Fault], time: float, lower: Array, upper: Array, speed: Array
) -> tuple[Array, Array, Array]:
    """The drives' strokes (J,) and speed limits (J,) as faults leave them at a time, s."""
    lower, upper, speed = lower.copy(), upper.copy(), speed.copy()
    for fault in faults:
        if fault.is_active(time):
            j = fault.index
            if fault.kind == "slow":
                speed[j] *= fault.size
            elif fault.kind == "limited":
                lower[j], upper[j] = max(lower[j], fault.lower), min(upper[j], fault.upper)
    return lower, upper, speed


def misses_update(faults: Sequence[Fault], time: float, period: float) -> bool:
    """Whether the servos' update at a time (s) does not take place."""
    tick = round(time / period)
    return any(
        fault.kind == "late"
        and fault.is_active(time)
        and not (fault.size > 0.0 and tick % int(fault.size) == 0)
        for fault in faults
    )


def override_setpoints(
    faults: Sequence[Fault],
    time: float,
    period: float,
    limits: tuple[Array, Array, Array],
    before: Array,
    setpoint: Array,
) -> None:
    """Lets jammed drives stand and runaway ones run, whatever a servo made of its command.

    Args:
        limits: ends of the strokes and speed limits, (J,) each, of the sound drives.
        before: drive coordinates a period ago, (J,).
        setpoint: in and out, drive coordinates and their rates over the period, (2 J,).
    """
    lower, upper, speed = limits
    for fault in faults:
        if not fault.is_active(time) or fault.kind not in ("jam", "runaway"):
            continue
        j = fault.index
        way = fault.size * speed[j] * period if fault.kind == "runaway" else 0.0
        setpoint[j] = min(max(before[j] + way, lower[j]), upper[j]) if way else before[j]
        setpoint[lower.size + j] = (setpoint[j] - before[j]) / period


def stiffness_shares(faults: Sequence[Fault], time: float, first: int, shares: Array) -> None:
    """What faults leave of the actuators' stiffness at a time, s.

    Args:
        first: index of the joint that the first actuator moves.
        shares: out, (A,).
    """
    shares[:] = 1.0
    for fault in faults:
        if fault.kind == "weak" and fault.is_active(time):
            shares[fault.index - first] *= fault.size


def read_encoders(
    faults: Sequence[Fault], time: float, before: Array, state: Array
) -> tuple[Array, Array]:
    """Readings (2 J,) of a joint state (2 J,), and which encoders say that they are healthy, (J,).

    Args:
        before: the readings of the update before, (2 J,).
    """
    reading = state.copy()
    joints = state.size // 2
    health = np.ones(joints)
    for fault in faults:
        if not fault.is_active(time):
            continue
        j = fault.index
        if fault.kind == "dead":
            reading[j], reading[joints + j], health[j] = 0.0, 0.0, 0.0
        elif fault.kind == "stuck":
            reading[j], reading[joints + j] = before[j], 0.0
        elif fault.kind == "biased":
            reading[j] += fault.size
        elif fault.kind == "quantised":
            reading[j] = round(reading[j] / fault.size) * fault.size
    return reading, health


def _make_fault(
    config: FaultConfig,
    index: int,
    size: float,
    ends: tuple[float, float] = (-math.inf, math.inf),
) -> Fault:
    return Fault(
        kind=config.kind,
        index=index,
        start=config.start_s,
        end=end_of(config),
        size=size,
        lower=ends[0],
        upper=ends[1],
    )


def _find(kind: str, name: str, known: Sequence[str]) -> int:
    if name not in known:
        raise UnknownNameError(kind, name, known)
    return list(known).index(name)


def _limited_stroke(arm: SerpentineArm, j: int, size: float) -> tuple[float, float]:
    """Ends of a drive's coordinate whose joint goes `size` (deg or mm) either way of its home."""
    reach = size * (1e-3 if arm.is_prismatic[j] else DEGREE)
    ends = []
    for way in (-1.0, 1.0):
        posture = arm.joint_home.copy()
        posture[j] += way * reach
        ends.append(float(drives_from_joints(arm, posture)[j]))
    return min(ends), max(ends)
