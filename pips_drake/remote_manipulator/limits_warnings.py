"""What the operator is warned of: hard and soft limits of the joints, and the end of the reach."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pips_drake.remote_manipulator.configuration import ArmConfig


@dataclass(frozen=True)
class LimitWarnings:
    """What to warn of in a frame.

    Attributes:
        hard: joints that are asked to go beyond their limits and stop there; bit k for the joint k
            of H0 P0 P1 H2 P2 R2, 6 for the stand, 7 for the prong.
        soft: joints that are within the soft margin of a limit; bits 0 to 5.
        reach: the arm is straight, but for the margin.
    """

    hard: int
    soft: int
    reach: bool


def limit_warnings(
    arm: ArmConfig, angles: ArrayLike, asked: ArrayLike, *, stand: bool, prong: bool
) -> LimitWarnings:
    """The warnings of a frame.

    Args:
        angles: where the joints are sent, (6,) rad.
        asked: where the master arm is, (6,) rad.
        stand, prong: the stand, the prong are driven against their stops.
    """
    q, wanted = np.asarray(angles, dtype=float), np.asarray(asked, dtype=float)
    margin = math.radians(arm.soft_margin_deg)
    hard = (wanted < arm.lower) | (wanted > arm.upper)
    soft = (q < arm.lower + margin) | (q > arm.upper - margin)
    bits = _bits([*hard, stand, prong])
    # From the shoulder to the wrist, by the angle at the elbow.
    a, b = arm.arm_0_m, arm.arm_1_m
    reach = math.sqrt(a * a + b * b + 2.0 * a * b * math.cos(q[2]))
    return LimitWarnings(bits, _bits(soft), reach > a + b - arm.reach_margin_m)


def _bits(flags: ArrayLike) -> int:
    return sum(1 << k for k, flag in enumerate(np.asarray(flags, dtype=bool)) if flag)
