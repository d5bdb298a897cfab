"""Robots that several tests look at."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from pips_drake.cable_robot.robot import PLANAR, CableRobot


def planar_example(**changes: Any) -> CableRobot:
    """CABLE-96, Figure 1: four cables, weight 1 N, in the plane of x and y."""
    numbers: dict[str, Any] = {
        "name": "planar_example",
        "anchors": [[2, 2, 0], [2, -2, 0], [-2, -2, 0], [-2, 2, 0]],
        "attachments": [[1, 0, 0], [0, -1, 0], [-1, 0, 0], [0, 1, 0]],
        "freedoms": PLANAR,
        "mass": 1.0,
        "gravity": [0.0, -1.0, 0.0],
    }
    return CableRobot(**(numbers | changes))


def box_robot(*, crossed: bool = False, seed: int | None = None) -> CableRobot:
    """Eight cables from a room's corners to a box's, straight or crossed; a seed disturbs them."""
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    attachments = 0.3 * signs * ([1.0, 1.0, -1.0] if crossed else [1.0, 1.0, 1.0])
    anchors = signs * [4.0, 3.0, 2.0]
    if seed is not None:
        rng = np.random.default_rng(seed)
        anchors = anchors + rng.uniform(-0.3, 0.3, anchors.shape)
        attachments = attachments + rng.uniform(-0.05, 0.05, attachments.shape)
    return CableRobot(name="box", anchors=anchors, attachments=attachments, mass=20.0)
