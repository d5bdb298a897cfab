"""The best few paths of different homotopy, for the operator to pick from (CMU-92 section 3.3).

In unfolded coordinates the classes are those of `path_classes`, exactly: which side of each
obstacle that spans the gap, and how often around what the gap goes around. One search over cells
and classes (`class_search`) finds the shortest path of each, in the order of their lengths.

In Cartesian coordinates all paths around a box are of one homotopy: what counts there is whether
one slides into the other straight through space (`sliding`). Paths are found by repeated searches,
each with the ways cut off that those found before took: where a pulled path lies against an
obstacle, half a plane across it is forbidden, from the obstacle outwards. A path that lies against
nothing has no alternative there.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass, replace
from itertools import count as counter
from itertools import groupby

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.planning.class_search import search_classes
from pips_drake.planning.grid import STEPS, Cells
from pips_drake.planning.grid_search import NoPathError, find_path, nearest_free_cells
from pips_drake.planning.occupancy import BLOCKED, FREE, INNER, Occupancy
from pips_drake.planning.path_classes import Surface, Word, finely, loops, reduced
from pips_drake.planning.quick_pull import pull_quickly
from pips_drake.planning.sliding import can_slide, path_length, unwrapped, what_they_meet

Array = NDArray[np.float64]

#: No alternative is longer than this share of the shortest path.
LONGEST = 3.0
#: Classes that are looked at, of all that obstacles make together.
_MOST_CLASSES = 64
#: A path of cells is longer than one pulled tight by up to this factor: of two that differ by less,
#: the longer one may be the shorter when pulled.
_OFF = 1.1
#: Searches in Cartesian coordinates, at most.
_MOST_SEARCHES = 12
#: A pulled path lies against what is nearer than this beyond the arm's radius, m.
_TOUCHING = 0.02
_ROUNDS = 6


@dataclass(frozen=True, eq=False)
class Alternative:
    """One of several paths to choose from.

    Attributes:
        path: start, the centres of the cells passed, goal; (N, 3) m in the world.
        pulled: the same pulled tight, of the same class, (M, 3) m.
        length: of `pulled`, m.
        words: what tells it from the first, which is "the shortest way".
        word: its class in unfolded coordinates (`Surface.word`); none in Cartesian ones.
    """

    path: Array
    pulled: Array
    length: float
    words: str
    word: Word | None = None


def find_alternatives(
    occupancy: Occupancy,
    start: ArrayLike,
    goal: ArrayLike,
    count: int = 3,
    longest: float = LONGEST,
) -> list[Alternative]:
    """The shortest paths of different classes between two points (3,) m in the world.

    Args:
        occupancy: where the arm may go.
        count: how many are wanted, the shortest among them; fewer come if there are fewer.
        longest: as a share of the shortest one's length, 1 or more.

    Returns:
        The shortest first. No two are of one class.

    Raises:
        InputError: start or goal is not in the grid or too near to an obstacle; a number.
        NoPathError: there is no way.
    """
    if count < 1:
        raise InputError(f"number of alternatives = {count}; must be 1 or more")
    if not (math.isfinite(longest) and longest >= 1.0):
        raise InputError(f"longest alternative = {longest} of the shortest; must be 1 or more")
    first = find_path(occupancy, start, goal).points
    if occupancy.grid.unfolded:
        return _by_classes(occupancy, first, count, longest)
    return _by_cuts(occupancy, first, count, longest)


def _by_classes(
    occupancy: Occupancy, first: Array, count: int, longest: float
) -> list[Alternative]:
    surface = Surface.of(occupancy)
    # Loops around obstacles are left out, so that more than wanted are looked for.
    search = _ClassSearch(surface, first[0], first[-1])
    for more in (count + 1, 2 * count + 2, 6 * count + 6):
        paths = search.shortest(more, _OFF * longest)
        simple = [path for path, cells in paths if not loops(occupancy.grid, cells)]
        if len(simple) > count or len(paths) < more:
            break
    found: list[Alternative] = []
    for n, path in enumerate(simple):
        if n >= count and path_length(path) > _OFF * path_length(simple[count - 1]):
            break
        word = surface.word(path)
        pulled = _pulled_in_class(surface, path, word)
        found.append(Alternative(path, pulled, path_length(pulled), "", word))
    found.sort(key=lambda one: one.length)
    found = [one for one in found[:count] if one.length <= longest * found[0].length]
    return [replace(one, words=_in_words(surface, found, n)) for n, one in enumerate(found)]


class _ClassSearch:
    """The search for the shortest path of each class between two points (3,) m."""

    def __init__(self, surface: Surface, start: Array, goal: Array) -> None:
        occupancy = surface.occupancy
        self._grid, self._padded = occupancy.grid, occupancy.padded
        self._ends = start, goal
        self._first, self._last = nearest_free_cells(occupancy, np.stack([start, goal])) + 1
        self._rules = STEPS, self._grid.step_costs, self._grid.periodic
        self._cuts = surface.crossings()
        # What is left to the goal from everywhere: a search from there to nowhere, without cuts.
        columns = self._grid.shape[1]
        no_cuts = np.zeros((0, 2), dtype=np.int64), np.zeros(columns + 1, dtype=np.int64)
        nowhere, unknown = np.zeros(3, dtype=np.int64), np.zeros(self._padded.size)
        *_, costs, _, _ = search_classes(
            self._padded, self._last, nowhere, *self._rules, *no_cuts, unknown, 1, math.inf, 1
        )
        self._left = costs[0]

    def shortest(self, count: int, longest: float) -> list[tuple[Array, Cells]]:
        """The first few, each as start, centres of cells, goal, (N, 3) m, and as its cells."""
        found, _, step_to, class_from, _, _, _ = search_classes(
            self._padded,
            self._first,
            self._last,
            *self._rules,
            *self._cuts,
            self._left,
            count,
            longest,
            _MOST_CLASSES,
        )
        return [self._walked_back(int(k), step_to, class_from) for k in found]

    def _walked_back(
        self, k: int, step_to: NDArray[np.int8], class_from: NDArray[np.int16]
    ) -> tuple[Array, Cells]:
        cell, cells = self._last.copy(), [self._last]
        at = np.ravel_multi_index(tuple(cell), self._padded.shape)
        while (step := step_to[k, at]) < 26:
            k = class_from[k, at]
            cell = cell - STEPS[step]
            if self._grid.periodic:
                cell[1] = 1 + (cell[1] - 1) % self._grid.shape[1]
            cells.append(cell)
            at = np.ravel_multi_index(tuple(cell), self._padded.shape)
        passed = np.array(cells[::-1]) - 1
        start, goal = self._ends
        points = np.concatenate([start[None], self._grid.centres(passed), goal[None]])
        moved = np.linalg.norm(np.diff(points, axis=0), axis=1) > 0.0
        return points[np.concatenate([[True], moved])], passed


def _pulled_in_class(surface: Surface, path: Array, word: Word) -> Array:
    """The path pulled tight, without being lifted over an obstacle.

    What pulls looks at where a corner may go, not at what is on the way: it may leap over a narrow
    obstacle. Then the path is pulled in parts, and these again in others.
    """
    occupancy = surface.occupancy
    field, radius = occupancy.field, occupancy.radius
    posts = [piece.shape for piece in surface.pieces if piece.shape >= 0]

    def in_parts(points: Array) -> Array:
        pulled: Array = pull_quickly(field, points, radius, in_view=posts)
        if len(points) < 3 or surface.word(pulled) == surface.word(points):
            return pulled
        middle = len(points) // 2
        return np.concatenate([in_parts(points[: middle + 1])[:-1], in_parts(points[middle:])])

    pulled: Array = pull_quickly(field, path, radius)
    if surface.word(pulled) == word:
        return pulled
    pulled = in_parts(path)
    for _ in range(_ROUNDS):
        length = path_length(pulled)
        if len(pulled) < 4:
            break
        # Each corner that the parts left is in the middle of a part now.
        third = max(len(pulled) // 3, 1)
        parts = [pulled[: third + 1], pulled[third : 2 * third + 1], pulled[2 * third :]]
        tight = [in_parts(part) for part in parts]
        pulled = np.concatenate([tight[0][:-1], tight[1][:-1], tight[2]])
        if path_length(pulled) > (1.0 - 1e-3) * length:
            break
    return pulled


def _in_words(surface: Surface, found: list[Alternative], n: int) -> str:
    """What tells an alternative from those before it."""
    if n == 0:
        return "the shortest way"
    turned = [_turned(surface, one.pulled) for one in found]
    more = round((turned[n] - turned[0]) / (2.0 * math.pi))
    said, reference = [], 0
    if more:
        around = surface.pieces[surface.turns].name if surface.turns is not None else "the axis"
        said.append(_turns_in_words(around, turned[0], turned[n], more))
        same = [m for m in range(n) if round((turned[m] - turned[n]) / (2.0 * math.pi)) == 0]
        reference = same[0] if same else n
    word, other = found[n].word or (), found[reference].word or ()
    loop = reduced([*word, *(-letter for letter in reversed(other))])
    letters = {abs(letter) for letter in loop}
    if surface.turns is not None:
        letters.discard(surface.turns + 1)
    around_once = {m for m in letters if sum((x > 0) - (x < 0) for x in loop if abs(x) == m)}
    names = sorted({surface.pieces[m - 1].name for m in around_once or letters})
    if names:
        said.append("on the other side of " + " and of ".join(names))
    return ", ".join(said)


def _turned(surface: Surface, path: Array) -> float:
    """The angle that a path goes around the axis, rad."""
    grid = surface.occupancy.grid
    around = unwrapped(grid, finely(path, float(grid.least_lengths.min())))[:, 1]
    return float(around[-1] - around[0])


def _turns_in_words(name: str, first: float, other: float, more: int) -> str:
    if abs(more) == 1 and first * other <= 0.0:
        return f"around the {name} the other way"
    way = "the same way" if first * other > 0.0 else "the other way"
    turns = abs(round((abs(other) - abs(first)) / (2.0 * math.pi)))
    if not turns:
        return f"around the {name} the other way"
    return f"around the {name} {way}, {turns} turn{'s' if turns > 1 else ''} more"


@dataclass(frozen=True, eq=False)
class _Contact:
    """Where a pulled path lies against an obstacle."""

    point: Array
    along: Array
    outward: Array
    depth: float
    name: str


def _by_cuts(occupancy: Occupancy, first: Array, count: int, longest: float) -> list[Alternative]:
    """Best first over what is cut off."""
    # No cell is INNER where cells are blocked that the obstacles do not block.
    padded = np.where(occupancy.padded == INNER, FREE, occupancy.padded)
    bare = replace(occupancy, padded=padded)
    ticket = counter()  # between equals, the one that was found first

    def entry(path: Array, cut: tuple[_Contact, ...]) -> tuple[float, int, Alternative, tuple]:
        pulled: Array = pull_quickly(occupancy.field, path, occupancy.radius)
        one = Alternative(path, pulled, path_length(pulled), "the shortest way")
        return one.length, next(ticket), one, cut

    queue, searches = [entry(first, ())], 0
    found: list[Alternative] = []
    while queue and len(found) < count:
        length, _, one, cut = heapq.heappop(queue)
        if found and length > longest * found[0].length:
            break
        known = any(can_slide(occupancy, other.pulled, one.pulled) for other in found)
        if not known:
            if found:
                one = replace(one, words=_met_in_words(occupancy, found[0], one))
            found.append(one)
        for contact in _contacts(occupancy, one.pulled):
            if searches == _MOST_SEARCHES:
                break
            searches += 1
            more = (*cut, contact)
            try:
                path = find_path(_cut(bare, more), first[0], first[-1]).points
            except (InputError, NoPathError):  # the cut leaves no way, or reaches an end
                continue
            heapq.heappush(queue, entry(path, more))
    return found


def _met_in_words(occupancy: Occupancy, first: Alternative, other: Alternative) -> str:
    met = what_they_meet(occupancy, first.pulled, other.pulled)
    label = "an obstacle" if met is None else met.label.split(" (")[0].split("::")[-1]
    return f"on the other side of {label}"


def _contacts(occupancy: Occupancy, pulled: Array) -> list[_Contact]:
    """Where a pulled path lies against a body: the middle of each row of such corners."""
    if len(pulled) < 3:
        return []
    nearest = occupancy.field.nearest(pulled[1:-1])
    touching = nearest.distances < occupancy.radius + _TOUCHING
    names = [
        occupancy.field.shapes[int(m)].body if near else ""
        for m, near in zip(nearest.indices, touching, strict=True)
    ]
    contacts = []
    for name, rows in groupby(range(len(names)), key=lambda n: names[n]):
        group = list(rows)
        k = group[len(group) // 2]
        if not name:
            continue
        along = pulled[k + 2] - pulled[k]
        outward = nearest.gradients[k]
        along = along - (along @ outward) * outward
        size = float(np.linalg.norm(along))
        if size > 0.0:
            depth = float(nearest.distances[k])
            contacts.append(_Contact(pulled[k + 1], along / size, outward, depth, name))
    return contacts


def _cut(occupancy: Occupancy, contacts: tuple[_Contact, ...]) -> Occupancy:
    """Forbids half a plane at each contact, from the obstacle's surface outwards."""
    grid = occupancy.grid
    free = occupancy.padded[1:-1, 1:-1, 1:-1]
    cells = np.argwhere(free != BLOCKED)
    centres = grid.centres(cells)
    padded = occupancy.padded.copy()
    for contact in contacts:
        # So thick that no step leads through: one end of it is within half of it.
        thick = 0.5 * float(np.abs(contact.along @ grid.arrays.rotation) @ grid.spacing)
        way = centres - contact.point
        in_plane = np.abs(way @ contact.along) <= thick * (1.0 + 1e-9)
        row, column, layer = (cells[in_plane & (way @ contact.outward >= -contact.depth)] + 1).T
        padded[row, column, layer] = BLOCKED
    return replace(occupancy, padded=padded)
