"""How the arm's frame {0} stands in the world: the mountings of FACTS, and FTL-95 section 3.2."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pips_drake.errors import UnknownNameError

Array = NDArray[np.float64]

#: Columns x0, y0, z0 in the world (z up), by name. `laboratory`: the rail is vertical, as the
#: hardware stood. `pad`: horizontal, overhead, feeding into a vertical bay (x0 down), as the report
#: recommends. `pad_below`: horizontal, underneath.
MOUNTINGS: dict[str, Array] = {
    "laboratory": np.eye(3),
    "pad": np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]).T,
    "pad_below": np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]).T,
}


#: Standard gravity as Drake's plants have it, m/s^2.
GRAVITY = 9.81


def mounting_rotation(name: str) -> Array:
    """Rotation R_W0 (3, 3) of frame {0} in the world.

    Raises:
        UnknownNameError: no such mounting.
    """
    if name not in MOUNTINGS:
        raise UnknownNameError("mounting", name, list(MOUNTINGS))
    return MOUNTINGS[name].copy()


def mounting_gravity(name: str) -> Array:
    """Gravity in frame {0}, (3,) m/s^2.

    Raises:
        UnknownNameError: no such mounting.
    """
    down = np.array([0.0, 0.0, -GRAVITY])
    gravity: Array = mounting_rotation(name).T @ down
    return gravity
