"""Paths written for one arm's home, followed by another: the rail is set up elsewhere."""

from __future__ import annotations

import numpy as np

from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.tip_path import TipPath


def anchor_path(arm: SerpentineArm, path: TipPath) -> tuple[TipPath, float]:
    """The path in the arm's frame {0}, and how far that frame stands from the path's along z0.

    For an arm whose rail is placed for the path, the path's home tip becomes the arm's: the rail
    moves along itself, the path stays where it is in the scene. Other arms take paths as they are.

    Returns:
        path, and the rail's shift along z0, m: 0 if nothing was moved.
    """
    if not arm.rail_is_placed_for_the_path:
        return path, 0.0
    tip = kinematics.spine_points(arm, arm.joint_home)[0, -1]
    shift = float(path.point(path.home_arc_length)[2] - tip[2])
    return path.translated(np.array([0.0, 0.0, -shift])), shift
