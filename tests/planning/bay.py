"""The cargo bay's first half as a workspace, and places in its gap (`cargo_bay.dmd.yaml`)."""

from __future__ import annotations

import math

import numpy as np

from pips_drake.planning.grid import Grid
from pips_drake.planning.occupancy import Occupancy
from pips_drake.scene.packages import find_scene_file
from pips_drake.scene.signed_distance import read_distance_field

#: Where the bay's axis stands, halfway between payload and wall, and where it begins, in frame {0}.
AXIS_X, MIDDLE, BULKHEAD = -1.621, 2.034, 4.695
#: Before the port.
HOME = [0.412877, 0.0, 4.4425]


def bay_occupancy(radius=0.12):
    """Unfolded; cells of about a decimetre."""
    grid = Grid(
        lower=np.array([4.4, -math.pi, 1.5]),
        upper=np.array([14.0, math.pi, 2.28]),
        shape=(96, 128, 8),
        unfolded=True,
        origin=np.array([AXIS_X, 0.0, 0.0]),
    )
    return Occupancy.of(read_distance_field(find_scene_file("cargo_bay")), grid, radius)


def in_the_gap(around_deg, along):
    """A place (3,) m halfway between payload and wall, `along` m from the bulkhead."""
    angle = math.radians(around_deg)
    x, y = MIDDLE * math.cos(angle), MIDDLE * math.sin(angle)
    return np.array([AXIS_X + x, y, BULKHEAD + along])
