"""A scan's way among obstacles: what of a pattern has no room is left out, and gone around.

Around an obstacle that stands in a gap from side to side there are two ways, and the arm trails
behind its tip: having gone around the far side, it would be hooked on the obstacle. So a detour
stays on the side that the arm comes from, if there is a way there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.planning.grid_search import NoPathError, find_path
from pips_drake.planning.occupancy import BLOCKED, Occupancy
from pips_drake.planning.scanning import ScanPattern
from pips_drake.planning.string_pull import pull

Array = NDArray[np.float64]

#: What a place is called that the workspace does not have.
OUTSIDE = "the workspace's edge"


@dataclass(frozen=True, kw_only=True, eq=False)
class Route:
    """The places that a scan's end point goes to.

    Attributes:
        points: (M, 3) m in the world.
        rows: which of the pattern's points each is, (M,); -1 on a detour.
        refused: which of the pattern's points have no room, (N,).
        cut: which have room, and no way leads there, (N,).
        blockers: what is in the way, and what share of the pattern's points it refuses.
    """

    points: Array
    rows: NDArray[np.int64]
    refused: NDArray[np.bool_]
    cut: NDArray[np.bool_]
    blockers: dict[str, float]

    def sentences(self) -> tuple[str, ...]:
        """What is left out, and why."""
        said = [
            f"{100 * share:.1f} % of the pattern is too near to {name}: left out, and gone around"
            for name, share in self.blockers.items()
        ]
        if self.cut.any():
            share = 100 * self.cut.mean()
            said.append(f"{share:.1f} % of the pattern has room, but no way leads there: left out")
        return tuple(said)


def route_around(
    pattern: ScanPattern,
    occupancy: Occupancy,
    *,
    base: ArrayLike,
    room: float = 0.0,
    step: float = 0.1,
) -> Route:
    """The pattern's points that have room, with detours in between.

    Args:
        base: where the arm comes from, (3,) m in the world.
        room: that is wanted beside the workspace's radius, m: for what goes on ahead of the tip.
        step: of a detour's points, m.

    Raises:
        InputError: none of the pattern's points has room.
    """
    near = occupancy.field.nearest(pattern.points)
    places = occupancy.grid.cells(pattern.points)
    outside = ((places < 0) | (places >= occupancy.grid.shape)).any(axis=1)
    refused = outside | (near.distances < occupancy.radius + room)
    names = [
        OUTSIDE if out else occupancy.field.label(int(k))
        for out, k in zip(outside[refused], near.indices[refused], strict=True)
    ]
    blockers = {name: names.count(name) / len(refused) for name in dict.fromkeys(names)}
    if refused.all():
        raise InputError(
            f"the pattern has no place for an arm of radius {occupancy.radius:g} m and its camera: "
            f"all of it is too near to {', '.join(blockers)}; must have one that fits the gap"
        )
    free = np.flatnonzero(~refused)
    parts = np.split(free, np.flatnonzero(np.diff(free) > 1) + 1)
    points, rows = [pattern.points[parts[0]]], [parts[0]]
    cut = np.zeros(len(refused), dtype=bool)
    among = [occupancy]
    if len(parts) > 1:
        wide = Occupancy.of(occupancy.field, occupancy.grid, occupancy.radius + room)
        among.insert(0, wide)
    for part in parts[1:]:
        ends = points[-1][-1], pattern.points[part[0]]
        found = (_detour(pattern, cells, *ends, np.asarray(base), step) for cells in among)
        detour = next((way for way in found if way is not None), None)
        if detour is None:
            cut[part] = True
            continue
        points += [detour, pattern.points[part]]
        rows += [np.full(len(detour), -1, dtype=np.int64), part]
    return Route(
        points=np.concatenate(points),
        rows=np.concatenate(rows),
        refused=refused,
        cut=cut,
        blockers=blockers,
    )


def _detour(
    pattern: ScanPattern,
    occupancy: Occupancy,
    start: Array,
    goal: Array,
    base: Array,
    step: float,
) -> Array | None:
    """The way from one place to another without its ends, (K, 3) m; None if there is none."""
    for among in (_on_the_side_of(occupancy, np.stack([start, goal]), base), occupancy):
        try:
            way = find_path(among, start, goal).points
        except (InputError, NoPathError):
            continue
        pulled = pull(occupancy.field, way, occupancy.radius)
        lengths = np.linalg.norm(np.diff(pulled, axis=0), axis=1)
        marks = np.concatenate([[0.0], np.cumsum(lengths)])
        at = np.linspace(0.0, marks[-1], max(2, int(np.ceil(marks[-1] / step)) + 1))[1:-1]
        dense = np.stack([np.interp(at, marks, pulled[:, k]) for k in range(3)], axis=-1)
        target = pattern.target
        if target is not None and len(dense):
            along, around, _ = target.from_world(dense)
            lifted = target.to_world(along, around, pattern.standoff)
            # Straight ways cut the corner that a round surface is; the standoff is nicer.
            if (occupancy.field.distances(lifted) >= occupancy.radius).all():
                return lifted
        return dense
    return None


def _on_the_side_of(occupancy: Occupancy, places: Array, base: Array) -> Occupancy:
    """The same cells, but those beyond both places as seen from the base, along, are blocked."""
    grid = occupancy.grid
    if not grid.unfolded:
        return occupancy
    cells, padded = grid.cells(places)[:, 0], occupancy.padded.copy()
    if grid.from_world(base[None])[0, 0] <= grid.from_world(places)[:, 0].min():
        padded[int(cells.max()) + 3 :] = BLOCKED  # one cell beyond, behind a border of one
    else:
        padded[: max(int(cells.min()), 0)] = BLOCKED
    return replace(occupancy, padded=padded)
