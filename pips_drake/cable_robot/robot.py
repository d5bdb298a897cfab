"""A platform on cables: where they are fixed outside and on board, and what they can bear.

CABLE-96 is R. G. Roberts, "A Feasibility Study on a Parallel Mechanism for Examining the Space
Shuttle Orbiter Payload Bay Radiators", NASA/ASEE Summer Faculty Fellowship Program, 1996.

Any number of cables. The report's planar robot is one whose platform moves in x and y and turns
about z alone: `freedoms` says which of the six components of a twist it has.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.config import require
from pips_drake.errors import InputError

Array = NDArray[np.float64]

#: Components of a twist: velocity along and angular velocity about x, y and z.
SPATIAL = (0, 1, 2, 3, 4, 5)
PLANAR = (0, 1, 5)
#: Points nearer to each other than this are the same, m.
SAME_POINT = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class CableRobot:
    """A platform on M cables.

    Attributes:
        name: of the robot.
        anchors: outer ends of the cables p_i, (M, 3) m in the world.
        attachments: inner ends v_i, (M, 3) m in the platform's frame.
        freedoms: components of the platform's twist, `SPATIAL` or `PLANAR`.
        mass: of the platform, kg.
        centre_of_mass: in its frame, (3,) m.
        gravity: in the world, (3,) m/s2.
        axial_stiffness: E A of each cable, (M,) N.
        tension_min, tension_max: bounds of every cable's tension, N.
        box: the platform's outline, full sizes (3,) m; zeros for none.

    Raises:
        InputError: fewer cables than freedoms, two cables between the same points, a stiffness or
            mass that is not positive, bounds that cross, or numbers that are not finite.
    """

    name: str
    anchors: Array
    attachments: Array
    freedoms: tuple[int, ...] = SPATIAL
    mass: float = 1.0
    centre_of_mass: Array = field(default_factory=lambda: np.zeros(3))
    gravity: Array = field(default_factory=lambda: np.array([0.0, 0.0, -9.81]))
    axial_stiffness: Array = field(default_factory=lambda: np.array([1e5]))
    tension_min: float = 0.0
    tension_max: float = np.inf
    box: Array = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        for name in ("anchors", "attachments", "centre_of_mass", "gravity", "box"):
            value = np.array(getattr(self, name), dtype=np.float64)
            good = bool(np.all(np.isfinite(value)))
            require(good, f"{self.name}: {name}", value.tolist(), "finite numbers")
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        count = len(self.anchors)
        shapes = self.anchors.shape, self.attachments.shape
        good = shapes == ((count, 3), (count, 3))
        require(good, f"{self.name}: anchors and attachments", shapes, "(M, 3) each")
        require(
            self.freedoms in (SPATIAL, PLANAR),
            f"{self.name}: freedoms",
            self.freedoms,
            f"{SPATIAL} or {PLANAR}",
        )
        least = len(self.freedoms)
        good = count >= least
        require(good, f"{self.name}: cables", count, f">= {least}, its freedoms")
        self._check_ends()
        stiffness = np.broadcast_to(np.asarray(self.axial_stiffness, dtype=float), (count,)).copy()
        good = bool(np.all(np.isfinite(stiffness) & (stiffness > 0.0)))
        shown = f"{stiffness.min():g} N"
        require(good, f"{self.name}: axial_stiffness", shown, "> 0 and finite")
        stiffness.flags.writeable = False
        object.__setattr__(self, "axial_stiffness", stiffness)
        good = np.isfinite(self.mass) and self.mass > 0.0
        require(good, f"{self.name}: mass", f"{self.mass:g} kg", "> 0")
        good = 0.0 <= self.tension_min < self.tension_max
        bounds = f"{self.tension_min:g} .. {self.tension_max:g} N"
        require(good, f"{self.name}: tension bounds", bounds, "rising, from 0 or more")

    def _check_ends(self) -> None:
        ends = np.hstack([self.anchors, self.attachments])
        gaps = np.abs(ends[:, None] - ends[None]).max(axis=2)
        pairs = np.argwhere(np.triu(gaps < SAME_POINT, k=1))
        if len(pairs):
            first, second = pairs[0] + 1
            raise InputError(
                f"{self.name}: cables {first} and {second} have the same ends; must differ at one"
            )
        distinct = len(np.unique(np.round(self.anchors / SAME_POINT), axis=0))
        least = 2 if self.freedoms == PLANAR else 3
        anchors = f"{self.name}: anchors"
        require(distinct >= least, anchors, f"{distinct} different points", f">= {least}")
        off_plane = self.freedoms == PLANAR and (
            np.ptp(self.anchors[:, 2]) > SAME_POINT or np.any(np.abs(self.attachments[:, 2]) > 0)
        )
        if off_plane:
            raise InputError(f"{self.name}: a planar robot's cables must lie in one plane z")

    @property
    def cables(self) -> int:
        """M, how many cables there are."""
        return len(self.anchors)

    @property
    def freedom(self) -> int:
        """How many components the platform's twist has: 6, or 3 in a plane."""
        return len(self.freedoms)

    def weight_wrench(self, R: ArrayLike) -> Array:
        """What gravity does to the platform, about its origin: (N, freedom) N and N m.

        Args:
            R: orientations Q, (N, 3, 3).
        """
        rotations = np.asarray(R, dtype=np.float64)
        force = np.broadcast_to(self.mass * self.gravity, (*rotations.shape[:-2], 3))
        moment = np.cross(rotations @ self.centre_of_mass, force)
        return np.concatenate([force, moment], axis=-1)[..., list(self.freedoms)]
