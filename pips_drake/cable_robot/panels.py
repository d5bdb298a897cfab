"""The payload bay's radiator panels: where they are, what rays meet them, boxes round them.

World {W}: x aft along the bay, y starboard, z up, origin in the middle of the bay in the plane of
the doors' hinges. Eight panels line the inner faces of the two opened doors, four a door. A door
is a quarter of the bay's circle; a panel is a part of that cylinder, about an axis along x, and is
looked at from within: it is concave, and its normal points to the axis.

Panel coordinates (u, v), m: u from the forward edge aft, v along the arc from the hinge outwards.
Port is the mirror image of starboard: seen from the camera, with the normal towards the eye, (u, v)
is right-handed on the starboard side (u x v = n) and left-handed on the port side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.config import require
from pips_drake.errors import InputError, UnknownNameError

Array = NDArray[np.float64]

#: Half the bay's length and its radius, m: 60 ft x 15 ft (CABLE-96's orbiter).
BAY_HALF_LENGTH = 9.144
BAY_RADIUS = 2.286
#: A panel's length and the length of its arc, m: 15 ft x 10.6 ft, derived from the area that
#: NTRS 19850008616 gives. That panels have the bay's radius is assumed.
PANEL_LENGTH = 4.572
PANEL_WIDTH = 3.231
#: How far the doors are opened about their hinges, rad.
DOOR_ANGLE = math.radians(175.5)
PANELS_A_SIDE = 4
SIDES = {"starboard": 1, "port": -1}


@dataclass(frozen=True, kw_only=True)
class Panel:
    """A part of a cylinder about an axis along x, concave towards the axis.

    A point at v is at the angle a = start_angle + v / radius about the axis, in the direction
    (y, z) = (-side cos a, -sin a) from it.

    Attributes:
        name: for example ``"port_2"``.
        side: 1 for starboard, -1 for port.
        number: counted from forward, from 1.
        start: x of its forward edge, m.
        length, width: along x, and along the arc, m.
        radius: of the arc, m.
        axis: y and z of the arc's axis, m.
        start_angle: a at v = 0, rad.
    """

    name: str
    side: int
    number: int
    start: float
    length: float = PANEL_LENGTH
    width: float = PANEL_WIDTH
    radius: float = BAY_RADIUS
    axis: tuple[float, float] = (0.0, 0.0)
    start_angle: float = 0.0

    def __post_init__(self) -> None:
        require(self.side in (1, -1), f"{self.name}: side", self.side, "1 or -1")
        for name in ("length", "width", "radius"):
            require(getattr(self, name) > 0.0, f"{self.name}: {name}", getattr(self, name), "> 0 m")
        turn = self.width / self.radius
        require(turn < math.pi, f"{self.name}: arc", f"{turn:g} rad", "less than half a turn")

    @property
    def area(self) -> float:
        """m2."""
        return self.length * self.width


def radiator_panels(door_angle: float = DOOR_ANGLE) -> tuple[Panel, ...]:
    """The eight panels, starboard_1 .. starboard_4 and port_1 .. port_4.

    The forward panels are stowed in their doors, not deployed.

    Args:
        door_angle: by which the doors are opened about their hinges, rad; at pi a panel is vertical
            at the hinge and level at the other edge of the door.

    Raises:
        InputError: the doors are closed more than half.
    """
    shown = f"{math.degrees(door_angle):g} deg"
    require(math.pi / 2 <= door_angle <= math.pi, "door angle", shown, "90 .. 180 deg")
    short = math.pi - door_angle
    # The panel is in the middle of the door's quarter circle.
    margin = 0.5 * (0.5 * math.pi * BAY_RADIUS - PANEL_WIDTH)
    return tuple(
        Panel(
            name=f"{name}_{k}",
            side=side,
            number=k,
            start=-BAY_HALF_LENGTH + PANEL_LENGTH * (k - 1),
            axis=(side * BAY_RADIUS * (1.0 + math.cos(short)), BAY_RADIUS * math.sin(short)),
            start_angle=short + margin / BAY_RADIUS,
        )
        for name, side in SIDES.items()
        for k in range(1, PANELS_A_SIDE + 1)
    )


def find_panel(panels: tuple[Panel, ...], name: str) -> Panel:
    """The panel of this name.

    Raises:
        UnknownNameError: there is none.
    """
    for panel in panels:
        if panel.name == name:
            return panel
    raise UnknownNameError("panel", name, [panel.name for panel in panels])


def panel_normals(panel: Panel, uv: ArrayLike) -> Array:
    """Unit normals, towards the axis, at (u, v) (N, 2) m: (N, 3) in {W}."""
    angle = panel.start_angle + _pairs(uv)[:, 1] / panel.radius
    return np.column_stack([np.zeros(len(angle)), panel.side * np.cos(angle), np.sin(angle)])


def panel_points(panel: Panel, uv: ArrayLike, height: ArrayLike = 0.0) -> Array:
    """Points at (u, v) (N, 2) m, at a height (N,) m above the surface: (N, 3) m in {W}."""
    pairs = _pairs(uv)
    up = np.broadcast_to(np.asarray(height, dtype=np.float64), (len(pairs),))
    points = -(panel.radius - up)[:, None] * panel_normals(panel, pairs)
    points[:, 0] = panel.start + pairs[:, 0]
    points[:, 1:] += panel.axis
    return points


def panel_coordinates(panel: Panel, points: ArrayLike) -> Array:
    """(u, v, height above the surface) of points (N, 3) m in {W}: (N, 3) m.

    Points beyond the panel's edges have the coordinates of the cylinder gone on, v to half a turn
    either side of the panel's middle.
    """
    p = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    across, up = (p[:, 1] - panel.axis[0]) * -panel.side, -(p[:, 2] - panel.axis[1])
    middle = panel.start_angle + 0.5 * panel.width / panel.radius
    turn = (np.arctan2(up, across) - middle + math.pi) % (2.0 * math.pi) - math.pi
    v = 0.5 * panel.width + panel.radius * turn
    return np.column_stack([p[:, 0] - panel.start, v, panel.radius - np.hypot(across, up)])


def edge_distances(panel: Panel, uv: ArrayLike) -> Array:
    """How far inside the panel's nearest edge (u, v) (N, 2) m are, (N,) m; outside negative."""
    u, v = _pairs(uv).T
    inside: Array = np.minimum.reduce([u, panel.length - u, v, panel.width - v])
    return inside


def intersect_rays(
    panel: Panel, origins: ArrayLike, directions: ArrayLike, *, margin: float = 0.0
) -> tuple[Array, Array]:
    """Where rays meet the panel's inner face: (u, v) (N, 2) m and distance (N,) m; NaN if nowhere.

    The back hides the face: a ray that meets the back first does not meet the face.

    Args:
        origins, directions: of the rays, (N, 3) m and of any length, in {W}; one origin (3,) will
            do for all.
        margin: by which the panel goes on beyond its edges, m.
    """
    d = np.asarray(directions, dtype=np.float64).reshape(-1, 3)
    d = d / np.linalg.norm(d, axis=1, keepdims=True)
    o = np.broadcast_to(np.asarray(origins, dtype=np.float64), d.shape)
    out = o[:, 1:] - panel.axis
    # |out + t d|^2 = radius^2 in the plane of y and z.
    a = np.einsum("ij,ij->i", d[:, 1:], d[:, 1:])
    b = np.einsum("ij,ij->i", out, d[:, 1:])
    c = np.einsum("ij,ij->i", out, out) - panel.radius**2
    uv, distance = np.full((len(d), 2), np.nan), np.full(len(d), np.inf)
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(b * b - a * c)
        # A point has both signs of the root; outwards, the ray meets the inner face.
        for sign in (-1.0, 1.0):
            t = (-b + sign * root) / a
            met = panel_coordinates(panel, np.nan_to_num(o + t[:, None] * d))[:, :2]
            on = np.isfinite(t) & (t > 0.0) & (edge_distances(panel, met) >= -margin)
            on &= t < distance
            uv[on] = met[on] if sign > 0.0 else np.nan
            distance[on] = t[on]
    distance[np.isnan(uv[:, 0])] = np.nan
    return uv, distance


def panel_slabs(
    panel: Panel, pieces: int = 16, *, thickness: float = 0.02
) -> list[tuple[Array, Array]]:
    """Thin boxes that together contain the panel, for collisions: sizes (3,) m, poses X_WB (4, 4).

    A box's axes: x aft, y along the chord outwards, z the normal. Its inner face is the chord of
    its part of the arc, so it stands out of the surface by at most radius (1 - cos(angle / 2)).

    Args:
        pieces: how many boxes share the arc.
        thickness: of the panel, m, behind its surface.
    """
    require(pieces >= 1, f"{panel.name}: boxes", pieces, ">= 1")
    if not thickness > 0.0:
        raise InputError(f"{panel.name}: thickness = {thickness:g} m; must be > 0")
    half = 0.5 * panel.width / panel.radius / pieces
    sagitta = panel.radius * (1.0 - math.cos(half))
    # Behind the surface by the thickness at least, at the corners too.
    depth = sagitta + thickness
    chord = 2.0 * (panel.radius * math.sin(half) + depth * math.tan(half))
    slabs = []
    for k in range(pieces):
        uv = [[0.5 * panel.length, panel.width * (k + 0.5) / pieces]]
        normal = panel_normals(panel, uv)[0]
        X_WB = np.eye(4)
        X_WB[:3, 1] = np.cross(normal, [1.0, 0.0, 0.0])
        X_WB[:3, 2] = normal
        X_WB[:3, 3] = panel_points(panel, uv, sagitta - 0.5 * depth)[0]
        slabs.append((np.array([panel.length, chord, depth]), X_WB))
    return slabs


def _pairs(uv: ArrayLike) -> Array:
    return np.asarray(uv, dtype=np.float64).reshape(-1, 2)
