"""What it takes to hold the arm still against gravity."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.dh_chain import gravity_efforts

Array = NDArray[np.float64]


def holding_efforts(arm: SerpentineArm, q: ArrayLike, gravity: ArrayLike) -> Array:
    """Joint efforts that hold postures still, (N, joints), N and Nm, positive with the joint value.

    Args:
        q: joint values (N, joints) or (joints,), m and rad.
        gravity: in frame {0}, (3,) m/s^2 (the mounting's rotation applied to the world's).

    Raises:
        InputError: `q` or `gravity` has another shape.
    """
    postures = np.atleast_2d(np.asarray(q, dtype=np.float64))
    if postures.ndim != 2 or postures.shape[1] != arm.joints:  # compiled code would not look
        raise InputError(
            f"joint values of shape {np.shape(q)}; must be (N, {arm.joints}) for arm '{arm.name}'"
        )
    if np.shape(gravity) != (3,):
        raise InputError(f"gravity of shape {np.shape(gravity)}; must be (3,), m/s^2")
    # A mirrored arm under mirrored gravity has the same joint efforts.
    gravity_drawn = np.asarray(gravity, dtype=np.float64) * arm.mirror
    masses = np.array([body.mass for body in arm.bodies])
    centres = np.array([body.centre for body in arm.bodies])
    return -np.asarray(gravity_efforts(arm.dh_table, postures, masses, centres, gravity_drawn))
