"""What obstacles do to a path that comes near them: Khatib's repulsion (FIRAS), as CMU-92 has it.

CMU-92 Eq 16: U(r) = A/2 (1/r - 1/r0)^2 for 0 < r < r0, with r the distance to the nearest surface.
U has no bound at r = 0 and nothing behind it. Here it goes on as a straight line below a clamp
distance: the force stops growing there, and still leads out of an obstacle. Along a path U is an
energy per length, N (J/m), so that A is in N m^2 and the force is per length, N/m.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pips_drake.errors import InputError

Array = NDArray[np.float64]
#: Signed distances (N, M) m to M obstacles at points (N, 3) m, negative inside, and their gradients
#: (N, M, 3). Each obstacle repels by itself: between two, the nearest one's gradient alone would
#: leap from one side to the other, and a path would never rest there.
DistanceField = Callable[[Array], tuple[Array, Array]]


@dataclass(frozen=True, kw_only=True)
class Repulsion:
    """The FIRAS function of a distance.

    Attributes:
        strength: A, N m^2.
        reach: r0, m; nothing is felt beyond it.
        clamp: below this distance the force is that at it, m.

    Raises:
        InputError: a number is not finite, or not 0 < clamp < reach and strength > 0.
    """

    strength: float
    reach: float
    clamp: float

    def __post_init__(self) -> None:
        for name, value, unit in (
            ("strength", self.strength, "N m^2"),
            ("reach", self.reach, "m"),
            ("clamp", self.clamp, "m"),
        ):
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(f"repulsion {name} = {value} {unit}; must be > 0")
        if self.clamp >= self.reach:
            raise InputError(
                f"repulsion clamp = {self.clamp} m; must be below the reach, {self.reach} m"
            )

    def energy(self, distance: Array) -> Array:
        """U, N, at distances of any shape, m."""
        r = np.maximum(distance, self.clamp)
        gap = np.maximum(1.0 / r - 1.0 / self.reach, 0.0)
        below = np.maximum(self.clamp - distance, 0.0)
        energy: Array = 0.5 * self.strength * gap * gap + below * self.push(distance)
        return energy

    def push(self, distance: Array) -> Array:
        """-dU/dr, N/m, away from the surface, at distances of any shape, m."""
        r = np.maximum(distance, self.clamp)
        push: Array = self.strength * np.maximum(1.0 / r - 1.0 / self.reach, 0.0) / (r * r)
        return push

    def stiffness(self, distance: Array) -> Array:
        """d2U/dr2, N/m^2, at distances of any shape, m; below the clamp, that at the clamp.

        With u = 1/r: U'' = A (3 u^4 - 2 u^3 / r0), which grows as the surface comes nearer.
        """
        u = 1.0 / np.maximum(distance, self.clamp)
        stiffness: Array = self.strength * u**3 * np.maximum(3.0 * u - 2.0 / self.reach, 0.0)
        return np.where(u * self.reach > 1.0, stiffness, 0.0)
