"""What an arm cannot do of a motion given by joints: a sentence for each limit that it breaks.

Between rows joints move on straight lines, so the extremes are exact (`motion_extremes`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.drives import drive_names
from pips_drake.serpentine.joint_motion import JointMotion
from pips_drake.serpentine.motion_extremes import MotionExtremes
from pips_drake.serpentine.plan import HOME_SLACK, LIMIT_TOLERANCE
from pips_drake.units import DEGREE

Array = NDArray[np.float64]


def limit_sentences(
    arm: SerpentineArm, motion: JointMotion, extremes: MotionExtremes
) -> tuple[str, ...]:
    """A sentence for each joint that leaves its limits, and each actuator that leaves its stroke.

    Args:
        extremes: of the motion.
    """
    found = []
    # Tables of paths are printed to 0.001 in, and home stands at the rail's end.
    slack = np.where(arm.is_prismatic, HOME_SLACK, LIMIT_TOLERANCE)
    for j in np.flatnonzero(extremes.joint_margin < -slack):
        sliding = arm.is_prismatic[j]
        unit, word = (1e-3, "mm") if sliding else (DEGREE, "deg")
        beyond = np.maximum(
            arm.joint_lower[j] - motion.joints[:, j], motion.joints[:, j] - arm.joint_upper[j]
        )
        worst = int(np.argmax(beyond))
        found.append(
            f"joint {arm.joint_names[j]} leaves its limits {arm.joint_lower[j] / unit:.3f} .. "
            f"{arm.joint_upper[j] / unit:.3f} {word}: {motion.joints[worst, j] / unit:.3f} {word} "
            f"at {motion.times[worst]:.2f} s"
        )
    for k in np.flatnonzero(extremes.stroke_margin < -LIMIT_TOLERANCE):
        found.append(
            f"actuator {arm.actuator_names[k]} would be {-extremes.stroke_margin[k] * 1e3:.2f} mm "
            f"beyond its stroke near {extremes.stroke_time[k]:.2f} s"
        )
    return tuple(found)


def speed_sentences(
    arm: SerpentineArm, extremes: MotionExtremes, most: float = 1.0
) -> tuple[str, ...]:
    """A sentence for the drive that would have to be fastest, if that is too fast.

    Args:
        most: the share of its speed limit that a drive may need.
    """
    worst = int(np.argmax(extremes.speed_fraction))
    share = float(extremes.speed_fraction[worst])
    if share <= most:
        return ()
    return (
        f"drive {drive_names(arm)[worst]} would need {100.0 * share:.0f} % of its speed limit "
        f"from {extremes.speed_time[worst]:.2f} s on; must be <= "
        f"{100.0 * most:g} %",
    )
