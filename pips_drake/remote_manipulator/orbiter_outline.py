"""The orbiter's outline in {R}, of boxes and cylinders: what is told from afar as a Shuttle.

Only what the payload or the arm could touch is solid: the cabin, and the deck on the bay's four
sides. The rest has names that begin with `outline` and is seen alone. Proportions are the flight
orbiter's, assumed from its general look: RMS-71 shows a box with a nose. The bay is another model.
"""

from __future__ import annotations

import math
from dataclasses import replace

from pips_drake.remote_manipulator.configuration import RemoteManipulatorConfig
from pips_drake.remote_manipulator.geometry import (
    DARK,
    GREY,
    WHITE,
    Part,
    Triple,
    cabin_part,
)

#: Tiles of the underside, and the radiators' inner faces of the doors.
TILES: Triple = (0.13, 0.13, 0.15)
RADIATOR: Triple = (0.70, 0.76, 0.82)
#: Of the deck beyond the bay's walls, on either side, and of the fuselage's bottom, m.
DECK = 0.8
#: From the deck to the bottom, beyond the bay's depth, m.
BOTTOM = 0.6
#: Parts of the orbiter's length: fuselage behind the bay, fin's height.
AFT, FIN = 0.155, 0.215
#: Shortest nose ahead of the cabin, m; it is what the length leaves.
SHORTEST_NOSE = 2.0
#: Steps of what narrows: a wing from root to tip, the nose, the fin.
WING_STRIPS, NOSE_STEPS, FIN_STRIPS = 14, 20, 12


def orbiter_parts(config: RemoteManipulatorConfig) -> tuple[Part, ...]:
    """All of the outline: `cabin` and `deck_*` are solid."""
    return (
        cabin_part(config),
        *_windows(config),
        *_deck(config),
        *_nose(config),
        *_aft(config),
        *_wings(config),
        *_doors(config),
    )


class _Measures:
    """Where things are, in {R}: x forward to aft, half widths from the middle plane, m."""

    def __init__(self, config: RemoteManipulatorConfig) -> None:
        bay, orbiter = config.cargo_bay, config.orbiter
        self.forward, self.middle, self.top = bay.location_m
        self.aft = self.forward + bay.length_m
        self.wall = 0.5 * bay.width_m + bay.wall_m
        self.half = self.wall + DECK
        self.depth = bay.depth_m + bay.wall_m
        self.bottom = self.top + self.depth + BOTTOM
        self.length, self.span = orbiter.length_m, orbiter.span_m
        self.bulkhead = self.forward - bay.wall_m
        self.cabin = self.forward - 0.6 - orbiter.cabin_length_m
        self.roof = self.top - orbiter.cabin_height_m
        self.tail = self.aft + bay.wall_m + AFT * self.length
        self.wall_aft = self.aft + bay.wall_m


def _box(name: str, low: Triple, high: Triple, color: Triple, *, solid: bool = False) -> Part:
    size = (high[0] - low[0], high[1] - low[1], high[2] - low[2])
    middle = (0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), 0.5 * (low[2] + high[2]))
    return Part(name=name, kind="box", size=size, position=middle, color=color, solid=solid)


def _mirrored(part: Part, middle: float) -> Part:
    """The same on the other side of the plane y = middle; `port` becomes `starboard`."""
    x, y, z = part.position
    roll, pitch, yaw = part.rpy
    return replace(
        part,
        name=part.name.replace("port", "starboard"),
        position=(x, 2.0 * middle - y, z),
        rpy=(-roll, pitch, -yaw),
    )


def _deck(config: RemoteManipulatorConfig) -> list[Part]:
    """Round the bay, flush with its face c, as deep as the bay; and the tiles below."""
    m = _Measures(config)
    low, high = m.middle - m.half, m.middle + m.half
    inner = m.middle + m.wall
    port = _box(
        "deck_port",
        (m.bulkhead, inner, m.top),
        (m.wall_aft, high, m.top + m.depth),
        WHITE,
        solid=True,
    )
    forward = _box(
        "deck_forward",
        (m.cabin, low, m.top),
        (m.bulkhead, high, m.top + m.depth),
        WHITE,
        solid=True,
    )
    aft = _box(
        "deck_aft", (m.wall_aft, low, m.top), (m.tail, high, m.top + m.depth), WHITE, solid=True
    )
    tiles = _box(
        "outline_tiles", (m.cabin, low, m.top + m.depth + 0.002), (m.tail, high, m.bottom), TILES
    )
    return [port, _mirrored(port, m.middle), forward, aft, tiles]


def _windows(config: RemoteManipulatorConfig) -> list[Part]:
    """In the cabin's front and, of the aft flight deck, in its back and roof."""
    m = _Measures(config)
    half = 0.5 * config.orbiter.cabin_width_m
    height = m.top - m.roof
    low, high = m.roof + 0.15 * height, m.roof + 0.6 * height
    back = m.cabin + config.orbiter.cabin_length_m
    parts = []
    for k in range(6):
        y = m.middle + (k - 2.5) * 0.30 * half
        width = 0.12 * half
        parts.append(
            _box(
                f"outline_window_{k}",
                (m.cabin - 0.02, y - width, low),
                (m.cabin + 0.02, y + width, high),
                DARK,
            )
        )
    for k, side in enumerate((-1.0, 1.0)):
        y, width = m.middle + 0.3 * side * half, 0.18 * half
        parts.append(
            _box(
                f"outline_aft_window_{k}",
                (back - 0.02, y - width, low),
                (back + 0.02, y + width, high),
                DARK,
            )
        )
        parts.append(
            _box(
                f"outline_roof_window_{k}",
                (back - 1.2, y - width, m.roof - 0.02),
                (back - 0.5, y + width, m.roof + 0.02),
                DARK,
            )
        )
    return parts


def _nose(config: RemoteManipulatorConfig) -> list[Part]:
    """Slices ahead of the cabin that narrow and bend down like an ellipse, tiles below."""
    m = _Measures(config)
    long = max(SHORTEST_NOSE, m.length - (m.tail - m.cabin))
    step = long / NOSE_STEPS
    parts = []
    for k in range(NOSE_STEPS):
        # Parts of the nose's length, from its root; the slice is as wide as in its middle.
        share = (k + 0.5) / NOSE_STEPS
        round_off = math.sqrt(1.0 - share**2.2)
        half = m.half * round_off
        # The top comes down from the roof, the bottom stays low: the nose's tip is near the bottom.
        tip = m.top + 0.62 * (m.bottom - m.top)
        top = tip - (tip - m.top + 0.35) * round_off
        bottom = tip + (m.bottom - tip) * round_off
        x = m.cabin - k * step
        seam = bottom - 0.45 * (bottom - top)
        color = WHITE if share < 0.86 else DARK
        half_top = 0.78 * half
        parts += [
            _box(
                f"outline_nose_{k}",
                (x - step, m.middle - half_top, top),
                (x, m.middle + half_top, seam),
                color,
            ),
            _box(
                f"outline_nose_side_{k}",
                (x - step, m.middle - half, 0.5 * (top + seam)),
                (x, m.middle + half, bottom - 0.25 * (bottom - seam)),
                color,
            ),
            _box(
                f"outline_nose_tiles_{k}",
                (x - step, m.middle - 0.9 * half, seam),
                (x, m.middle + 0.9 * half, bottom),
                TILES,
            ),
        ]
    # From the nose up to the cabin's windows.
    rise, half = m.top - m.roof, 0.46 * config.orbiter.cabin_width_m
    for k in range(4):
        # As steep as a windscreen.
        top = m.roof + rise * (0.68 + 0.08 * k)
        parts.append(
            _box(
                f"outline_forehead_{k}",
                (m.cabin - 0.28 * (k + 1), m.middle - half, top),
                (m.cabin - 0.28 * k, m.middle + half, m.top + 0.4),
                WHITE,
            )
        )
    return parts


def _aft(config: RemoteManipulatorConfig) -> list[Part]:
    """Fin, pods, engines and body flap."""
    m = _Measures(config)
    radius = 0.30 * m.half
    pod = Part(
        name="outline_pod_port",
        kind="cylinder",
        size=(2.2 * radius, 0.8 * (m.tail - m.wall_aft)),
        position=(m.tail - 0.40 * (m.tail - m.wall_aft), m.middle + 0.62 * m.half, m.top),
        rpy=(0.0, 0.5 * math.pi, 0.0),
        color=WHITE,
        solid=False,
    )
    parts = [pod, _mirrored(pod, m.middle)]
    for k, (y, z) in enumerate(((0.0, 0.18), (0.42, 0.58), (-0.42, 0.58))):
        parts.append(
            Part(
                name=f"outline_engine_{k}",
                kind="cylinder",
                size=(1.9, 2.2),
                position=(m.tail + 0.9, m.middle + y * m.half, m.top + z * (m.bottom - m.top)),
                rpy=(0.0, 0.5 * math.pi - 0.12, 0.0),
                color=DARK,
                solid=False,
            )
        )
    flap = (m.tail, m.middle - 0.9 * m.half, m.bottom - 0.3)
    parts.append(
        _box("outline_flap", flap, (m.tail + 2.0, m.middle + 0.9 * m.half, m.bottom), TILES)
    )
    # Fin: the leading edge leans back by 45 deg, the trailing edge by 25.
    height = FIN * m.length
    root, step = m.tail - 6.2, height / FIN_STRIPS
    for k in range(FIN_STRIPS):
        up = (k + 0.5) * step
        z = m.top - k * step
        front, back = root + up + 0.4, m.tail + 0.3 + up * math.tan(math.radians(25.0))
        rudder = back - 0.35 * (back - front)
        spans = {"": (front, rudder, WHITE), "rudder_": (rudder + 0.05, back, GREY)}
        for word, (x0, x1, color) in spans.items():
            parts.append(
                _box(
                    f"outline_fin_{word}{k}",
                    (x0, m.middle - 0.22, z - step),
                    (x1, m.middle + 0.22, z),
                    color,
                )
            )
    parts.append(_leading_edge("outline_fin_edge", root, m.middle, m.top, height, 45.0))
    return parts


def _leading_edge(name: str, x: float, y: float, z: float, height: float, sweep_deg: float) -> Part:
    """A thin bar along the fin's front edge, which hides the strips' steps."""
    sweep = math.radians(sweep_deg)
    long = height / math.cos(sweep)
    return Part(
        name=name,
        kind="box",
        size=(0.5, 0.44, long),
        position=(x + 0.5 * height * math.tan(sweep) + 0.1, y, z - 0.5 * height),
        # Turned about y: the bar's upper end (-z) goes aft (+x).
        rpy=(0.0, -sweep, 0.0),
        color=DARK,
        solid=False,
    )


def _wings(config: RemoteManipulatorConfig) -> list[Part]:
    """Double deltas at the bottom: 81 deg of sweep ahead of the kink, 45 deg outside it."""
    m = _Measures(config)
    reach = 0.5 * m.span
    root, kink = m.half, m.half + 0.25 * (reach - m.half)
    trailing = m.tail - 0.6
    step = (reach - root) / WING_STRIPS
    kink_x = trailing - 2.6 - (reach - kink)
    parts = []
    for k in range(WING_STRIPS):
        out = root + k * step
        middle = out + 0.5 * step
        # Behind the bar of the leading edge, which hides the steps.
        front = 0.45 + kink_x + (middle - kink) * (1.0 if middle > kink else 3.6)
        z = m.bottom - 0.55 - 0.03 * (middle - root)
        thick = 0.5 - 0.35 * (middle - root) / (reach - root)
        for word, low, high, color in (
            ("", z - thick, z, WHITE),
            ("tiles_", z, z + 0.5 * thick, TILES),
        ):
            part = _box(
                f"outline_wing_port_{word}{k}",
                (front, m.middle + out, low),
                (trailing, m.middle + out + step, high),
                color,
            )
            parts += [part, _mirrored(part, m.middle)]
    for word, (y0, y1, slope) in {
        "glove": (root, kink, 3.6),
        "edge": (kink, reach, 1.0),
    }.items():
        wide = y1 - y0
        long = wide * math.hypot(1.0, slope)
        centre = 0.5 * (y0 + y1)
        bar = Part(
            name=f"outline_wing_port_{word}",
            kind="box",
            size=(long, 0.45, 0.4),
            position=(
                kink_x + (centre - kink) * slope + 0.12,
                m.middle + centre,
                m.bottom - 0.7 - 0.03 * (centre - root),
            ),
            rpy=(0.0, 0.0, math.atan2(wide, wide * slope)),
            color=DARK,
            solid=False,
        )
        parts += [bar, _mirrored(bar, m.middle)]
    return parts


def _doors(config: RemoteManipulatorConfig) -> list[Part]:
    """Folded out: each hangs from the deck's edge as four slats of an arc, its radiators up."""
    m = _Measures(config)
    # A closed door is a quarter of a circle, from the edge to the middle plane.
    slats, radius = 4, m.half
    wide = 2.0 * radius * math.sin(0.25 * math.pi / slats)
    y, z = m.middle + m.half + 0.06, m.top + 0.05
    parts = []
    for k in range(slats):
        # Measured from straight down: open by 160 deg, so that the first slat leans out by 31 deg.
        lean = math.radians(20.0 + 90.0 / slats * (k + 0.5))
        dy, dz = math.sin(lean), math.cos(lean)
        for word, off, color in (("", 0.04, WHITE), ("radiator_", -0.04, RADIATOR)):
            # The radiators' side is towards -z and out.
            part = Part(
                name=f"outline_door_port_{word}{k}",
                kind="box",
                size=(m.aft - m.forward, 0.08, wide),
                position=(
                    0.5 * (m.forward + m.aft),
                    y + 0.5 * wide * dy - off * dz,
                    z + 0.5 * wide * dz + off * dy,
                ),
                rpy=(-lean, 0.0, 0.0),
                color=color,
                solid=False,
            )
            parts += [part, _mirrored(part, m.middle)]
        y, z = y + wide * dy, z + wide * dz
    return parts
