"""Defects of the radiators, as the survey must find them: seeded places, sizes and shapes.

What the Orbiter's technicians looked for: scratches (thin, bent), dings (a dark rim round a lighter
middle) and debris (of any shape). How large, how dark and where is drawn from a seed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import pdist

from pips_drake.cable_robot.panels import Panel
from pips_drake.config import require
from pips_drake.errors import InputError

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

KINDS = ("scratch", "ding", "debris")
#: Range of longest extents, m.
SIZES = (0.003, 0.04)
#: Range of contrasts: how much darker or lighter than the panel, as a share of its brightness.
CONTRASTS = (0.2, 0.5)
#: Least gap between defects, and between a defect and its panel's edge, m.
LEAST_GAP = 0.04
EDGE_GAP = 0.02
_MOST_TRIES = 20_000


@dataclass(frozen=True, kw_only=True)
class Defect:
    """One defect.

    Attributes:
        kind: one of `KINDS`.
        panel: the panel's name.
        u, v: the middle of its area, m.
        size_m: its longest extent along the surface, m.
        width_m: about its extent across that, m.
        angle: of its long direction from u towards v, rad.
        contrast: brightness more than the panel's, as a share of it; of a ding, of its rim.
        shape: seed of its outline.
    """

    kind: str
    panel: str
    u: float
    v: float
    size_m: float
    width_m: float
    angle: float = 0.0
    contrast: float = -0.3
    shape: int = 0

    def __post_init__(self) -> None:
        require(self.kind in KINDS, "defect kind", self.kind, f"one of {', '.join(KINDS)}")
        good = 0.0 < self.width_m <= self.size_m
        shown = f"{self.width_m:g} m of {self.size_m:g} m"
        require(good, f"width of a {self.kind}", shown, "> 0 and <= its size")
        good = -1.0 <= self.contrast <= 1.0 and self.contrast != 0.0
        require(good, f"contrast of a {self.kind}", self.contrast, "in [-1, 1] and not 0")


@dataclass(frozen=True, eq=False)
class Patch:
    """A piece of one brightness.

    Attributes:
        points: (K, 2) m, (u, v) on the panel.
        triangles: rows of `points`, counter-clockwise from u towards v, (T, 3).
        contrast: brightness more than the panel's, as a share of it.
    """

    points: Array
    triangles: Indices
    contrast: float


def seeded_defects(
    seed: int,
    panels: Sequence[Panel],
    count: int = 60,
    sizes: tuple[float, float] = SIZES,
) -> list[Defect]:
    """Defects on panels drawn at random, as many small ones as large ones (log-uniform sizes).

    Args:
        count: how many on all panels together.
        sizes: least and largest longest extent, m.

    Raises:
        InputError: bad numbers, or no room for so many `LEAST_GAP` apart.
    """
    low, high = sizes
    require(count >= 0, "defects", count, ">= 0")
    room = min(min(p.length, p.width) for p in panels) - 2.0 * EDGE_GAP
    good = 0.0 < low <= high < room
    require(good, "sizes of defects", f"{low:g} .. {high:g} m", f"rising, > 0 and < {room:g} m")
    return _added(np.random.default_rng(seed), [], panels, count, sizes)


def next_mission(
    defects: Sequence[Defect],
    seed: int,
    panels: Sequence[Panel],
    *,
    new: int = 5,
    grown: int = 5,
    cleaned: int = 2,
    sizes: tuple[float, float] = SIZES,
) -> list[Defect]:
    """The defects after one more mission: some new, some grown, some debris cleaned away.

    What grows is a scratch or a ding, to between 1.4 and 2 times its size and by 4 mm at least,
    where it has room.

    Raises:
        InputError: there are not so many that can grow or be cleaned away.
    """
    rng = np.random.default_rng(seed)
    after = list(defects)
    debris = [i for i, d in enumerate(after) if d.kind == "debris"]
    if cleaned > len(debris):
        raise InputError(
            f"debris to clean = {cleaned}; must be at most {len(debris)}, what there is"
        )
    gone = set(rng.permutation(debris)[:cleaned].tolist()) if cleaned else set()
    left = grown
    for i in rng.permutation(len(after)).tolist():
        factor = float(rng.uniform(1.4, 2.0))
        old = after[i]
        if left == 0 or old.kind == "debris":
            continue
        size = max(factor * old.size_m, old.size_m + 0.004)
        width = old.width_m if old.kind == "scratch" else old.width_m * size / old.size_m
        larger = replace(old, size_m=size, width_m=width)
        others = [d for k, d in enumerate(after) if k != i]
        panel = next(p for p in panels if p.name == old.panel)
        if _has_room(larger, others, panel):
            after[i] = larger
            left -= 1
    if left:
        raise InputError(f"defects to grow = {grown}; must be at most {grown - left}, what can")
    after = [d for i, d in enumerate(after) if i not in gone]
    # A new one where debris has just been cleaned away would be taken for it.
    kept_away = [*after, *(defects[i] for i in sorted(gone))]
    return after + _added(rng, kept_away, panels, new, sizes)


def defect_patches(defect: Defect) -> list[Patch]:
    """What is to be painted: its longest extent is `size_m`, the middle of its area (u, v)."""
    rng = np.random.default_rng(defect.shape)
    if defect.kind == "scratch":
        shape = _strip(defect.size_m, defect.width_m, bend=float(rng.uniform(-0.8, 0.8)))
        pieces = [(*shape, defect.contrast)]
    elif defect.kind == "ding":
        ring = _ellipse(24) * 0.5 * np.array([defect.size_m, defect.width_m])
        n = len(ring)
        k = np.arange(n)
        after = (k + 1) % n
        between = np.concatenate(
            [np.column_stack([k, after, after + n]), np.column_stack([k, after + n, k + n])]
        )
        fan = np.column_stack([np.zeros(n - 2, dtype=int), k[1:-1], k[2:]])
        pieces = [
            (np.concatenate([ring, 0.55 * ring]), between, defect.contrast),
            (0.55 * ring, fan, -0.5 * defect.contrast),
        ]
    else:
        corners = _ellipse(9, start=float(rng.uniform(0.0, 2.0 * math.pi)))
        corners = corners * rng.uniform(0.7, 1.0, len(corners))[:, None]
        corners = corners * [1.0, defect.width_m / defect.size_m]
        corners *= defect.size_m / pdist(corners).max()
        k = np.arange(len(corners))
        fan = np.column_stack([np.full(len(k), len(k)), k, (k + 1) % len(k)])
        pieces = [(np.concatenate([corners, np.zeros((1, 2))]), fan, defect.contrast)]
    middle = _centroid(pieces)
    c, s = math.cos(defect.angle), math.sin(defect.angle)
    turn, place = np.array([[c, s], [-s, c]]), np.array([defect.u, defect.v])
    return [Patch((points - middle) @ turn + place, t, grey) for points, t, grey in pieces]


def _added(
    rng: np.random.Generator,
    there: Sequence[Defect],
    panels: Sequence[Panel],
    count: int,
    sizes: tuple[float, float],
) -> list[Defect]:
    added: list[Defect] = []
    for _ in range(_MOST_TRIES):
        if len(added) == count:
            return added
        panel = panels[int(rng.integers(len(panels)))]
        kind = KINDS[int(rng.integers(len(KINDS)))]
        size = float(np.exp(rng.uniform(*np.log(sizes))))
        width = {
            "scratch": float(np.clip(rng.uniform(0.05, 0.15) * size, 0.0008, 0.002)),
            "ding": float(rng.uniform(0.75, 1.0)) * size,
            "debris": float(rng.uniform(0.4, 0.9)) * size,
        }[kind]
        contrast = float(rng.uniform(*CONTRASTS))
        # Dirt and a ding's rim are dark; a scratch may be bright metal.
        if kind != "scratch" or rng.uniform() < 0.5:
            contrast = -contrast
        defect = Defect(
            kind=kind,
            panel=panel.name,
            u=float(rng.uniform(0.0, panel.length)),
            v=float(rng.uniform(0.0, panel.width)),
            size_m=size,
            width_m=min(width, size),
            angle=float(rng.uniform(0.0, math.pi)),
            contrast=contrast,
            shape=int(rng.integers(2**31)),
        )
        if _has_room(defect, [*there, *added], panel):
            added.append(defect)
    if len(added) < count:
        raise InputError(f"defects = {count}; must be fewer: {len(added)} have room on the panels")
    return added


def _has_room(defect: Defect, others: Sequence[Defect], panel: Panel) -> bool:
    """Whether a defect keeps its distance from others and the edge, taken as discs of its size."""
    reach = defect.size_m  # about the middle of its area nothing is farther away than that
    edge = min(defect.u, panel.length - defect.u, defect.v, panel.width - defect.v)
    return edge >= EDGE_GAP + reach and all(
        math.hypot(defect.u - d.u, defect.v - d.v) >= LEAST_GAP + reach + d.size_m
        for d in others
        if d.panel == defect.panel
    )


def _strip(size: float, width: float, bend: float) -> tuple[Array, Indices]:
    """A strip bent into a piece of a circle that turns by `bend` rad."""
    along = np.linspace(-0.5, 0.5, 13)
    bend = bend if abs(bend) > 1e-3 else 1e-3
    angle = bend * along
    middle = np.column_stack([np.sin(angle), 1.0 - np.cos(angle)]) / bend
    across = np.column_stack([-np.sin(angle), np.cos(angle)])
    length = size
    for _ in range(20):  # corners are farther apart than the ends of the middle line
        edges = [length * middle - 0.5 * width * across, length * middle + 0.5 * width * across]
        points = np.concatenate(edges)
        length *= size / pdist(points).max()
    n = len(along)
    k = np.arange(n - 1)
    quads = [np.column_stack([k, k + 1, k + 1 + n]), np.column_stack([k, k + 1 + n, k + n])]
    return points, np.concatenate(quads)


def _ellipse(count: int, start: float = 0.0) -> Array:
    angle = start + 2.0 * math.pi * np.arange(count) / count
    return np.column_stack([np.cos(angle), np.sin(angle)])


def _centroid(pieces: Sequence[tuple[Array, Indices, float]]) -> Array:
    corners = np.concatenate([points[triangles] for points, triangles, _ in pieces])
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    middle: Array = areas @ corners.mean(axis=1) / areas.sum()
    return middle
