"""Which way a path goes round what stands in a thin gap: its class, exactly.

In the unfolded coordinates of a thin gap, what matters is the surface (along, around). A cell of it
is free if any cell above it, along `out`, is; the rest are pieces, which obstacles that span the
gap and the ends of the workspace make. Two paths with the same ends are of one class (of one
homotopy) if they can be drawn over each other on the surface without passing over a piece.

Classes are words, as for the fundamental group of a surface with holes. From every piece but one a
cut runs along `along` to the surface's lower end: letter m is written where a path crosses cut m
towards higher angles, and its inverse where it crosses back; a letter next to its own inverse is
struck out. The one without a cut is the lower end itself, with all pieces that touch it. Of a
surface that closes around, the upper end is a piece too, and the letter of its cut counts turns.
The cuts do not meet, and cut open along all of them the surface has no hole left: so the free group
of the letters is the fundamental group, and equal words mean equal classes, and only then.
(Bhattacharya, Likhachev and Kumar's h-signature, 2012, counts the letters alone, which takes
a b a^-1 b^-1 for nothing.) The cut of a piece may run through another one on its way down: then it
multiplies that one's letter from both sides, which is a change of names.

Obstacles that can be passed over or under make no class, nor do those in a Cartesian grid: in space
every path slides around a box.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import label

from pips_drake.errors import InputError
from pips_drake.planning.grid import Grid
from pips_drake.planning.occupancy import Occupancy
from pips_drake.planning.sliding import unwrapped
from pips_drake.scene.signed_distance import SignedDistanceField

Array = NDArray[np.float64]
Cells = NDArray[np.int64]
#: Letters m + 1, or -(m + 1) for the inverse of letter m.
Word = tuple[int, ...]

# Points along `out` for each layer of cells, where it is looked whether the arm fits through.
_FINER = 4
# What is nearest to this share of a layer's cells, or more, and of its main body, bounds the gap.
_COMMON = 0.01


@dataclass(frozen=True, eq=False)
class Piece:
    """Something that paths pass on one side or the other.

    Attributes:
        name: the obstacles that it is made of, or the gap's end.
        centre: of it, in the grid's coordinates (along m, around rad).
        shape: of the obstacles, the one that fills most of the room where the cut begins; -1: none.
        column, row: the cut runs down in column `column` of cells, from below row `row`.
    """

    name: str
    centre: Array
    shape: int
    column: int
    row: int


@dataclass(frozen=True, eq=False)
class Surface:
    """The surface (along, around) of an unfolded workspace.

    Attributes:
        occupancy: what it was made of.
        pieces: those with a cut, the order of which in a column is that of their letters.
        turns: letter (from 0) of the cut that counts turns around the axis; None without one.
    """

    occupancy: Occupancy
    pieces: tuple[Piece, ...]
    turns: int | None

    @staticmethod
    def of(occupancy: Occupancy) -> Surface:
        """Finds the pieces.

        Raises:
            InputError: the grid is not unfolded.
        """
        grid = occupancy.grid
        if not grid.unfolded:
            raise InputError("classes of paths need a grid in unfolded coordinates")
        rows, columns = grid.shape[:2]
        blocked = ~occupancy.free.any(axis=2)
        # Ways lead over corners, so pieces hang together by edges alone.
        labels, count = label(blocked)
        joined = np.arange(count + 1)
        if grid.periodic:
            for i in np.flatnonzero(blocked[:, 0] & blocked[:, -1]):
                one, other = joined[labels[i, 0]], joined[labels[i, -1]]
                joined[joined == other] = one
        labels = joined[labels]
        lower, upper = set(labels[0]) - {0}, set(labels[-1]) - {0}
        if not grid.periodic:
            lower |= (upper | set(labels[:, 0]) | set(labels[:, -1])) - {0}
        # What touches both ends makes one piece of them: then nothing goes all the way around.
        closed = grid.periodic and not lower & upper
        taken = lower | upper | {0}
        found = [_piece(occupancy, labels, int(k)) for k in np.unique(labels) if k not in taken]
        pieces = [piece for piece in found if piece is not None]
        if closed:
            pieces.append(Piece(_inside(occupancy), np.full(2, np.nan), -1, columns - 1, rows))
        return Surface(
            occupancy=occupancy,
            pieces=tuple(pieces),
            turns=len(pieces) - 1 if closed else None,
        )

    @cached_property
    def known(self) -> frozenset[int]:
        """The shapes that words know of: those of pieces, and what bounds the gap."""
        shapes = {piece.shape for piece in self.pieces if piece.shape >= 0}
        for layer in (0, self.occupancy.grid.shape[2] - 1):
            nearest = _along_layer(self.occupancy, layer)
            bodies = [self.occupancy.field.shapes[m].body for m in nearest]
            main = max(sorted(set(bodies)), key=bodies.count, default="")
            for m in set(nearest):
                body = self.occupancy.field.shapes[m].body
                if body == main and nearest.count(m) >= _COMMON * len(nearest):
                    shapes.add(m)
        return frozenset(shapes)

    @cached_property
    def others(self) -> SignedDistanceField:
        """The field of the shapes that words do not know of."""
        shapes = self.occupancy.field.shapes
        return SignedDistanceField.of(
            placed for m, placed in enumerate(shapes) if m not in self.known
        )

    def word(self, path: ArrayLike) -> Word:
        """The class of a path (N, 3) m in the world, among those with the same ends."""
        grid = self.occupancy.grid
        p = np.asarray(path, dtype=np.float64)
        q = unwrapped(grid, finely(p, float(grid.least_lengths.min())))
        h = grid.spacing
        written: list[tuple[float, int]] = []
        for m, piece in enumerate(self.pieces):
            # Beside the middle of the column, where cells' centres are, in the letters' order.
            aside = 0.25 * (m + 1) / len(self.pieces)
            at = grid.lower[1] + (piece.column + 0.5 + aside) * h[1]
            top = grid.lower[0] + (piece.row + 0.5) * h[0]
            turns = (q[:, 1] - at) / (2.0 * np.pi)
            beyond = np.floor(turns)
            for k in np.flatnonzero(np.diff(beyond)):
                border = max(beyond[k], beyond[k + 1])
                share = (border - turns[k]) / (turns[k + 1] - turns[k])
                if q[k, 0] + share * (q[k + 1, 0] - q[k, 0]) < top:
                    up = beyond[k + 1] > beyond[k]
                    written.append((k + share, m + 1 if up else -(m + 1)))
        return reduced(letter for _, letter in sorted(written))

    def crossings(self) -> tuple[Cells, Cells]:
        """For compiled code: letters by column, in their order, (L, 2) of row and letter; starts.

        A step from column j to j + 1 crosses those of the cuts `starts[j]` to `starts[j + 1]` whose
        row is above that of the step's cell in column j.
        """
        columns = self.occupancy.grid.shape[1]
        order = sorted(range(len(self.pieces)), key=lambda m: (self.pieces[m].column, m))
        found = [(self.pieces[m].row, m) for m in order]
        at = np.array([self.pieces[m].column for m in order], dtype=np.int64)
        starts = np.searchsorted(at, np.arange(columns + 1)).astype(np.int64)
        return np.array(found, dtype=np.int64).reshape(-1, 2), starts


def reduced(letters: Iterable[int]) -> Word:
    """Letters, with those next to their own inverses struck out."""
    word: list[int] = []
    for letter in letters:
        if word and word[-1] == -letter:
            word.pop()
        else:
            word.append(letter)
    return tuple(word)


def finely(points: Array, spacing: float) -> Array:
    """A polyline's points, with more between them: at most a spacing (m) apart."""
    parts = [points[:1]]
    for one, other in pairwise(points):
        count = max(1, int(np.ceil(np.linalg.norm(other - one) / spacing)))
        parts.append(one + np.linspace(0.0, 1.0, count + 1)[1:, None] * (other - one))
    return np.concatenate(parts)


def _piece(occupancy: Occupancy, labels: Cells, k: int) -> Piece | None:
    """The piece with a label; its cut begins where there is least room.

    None if the arm fits through there too, between the cells: it separates nothing.
    """
    grid, layers = occupancy.grid, occupancy.grid.shape[2]
    cells = np.argwhere(labels == k)
    every = np.column_stack(
        [np.repeat(cells, layers, axis=0), np.tile(np.arange(layers), len(cells))]
    )
    distances = occupancy.field.distances(grid.centres(every)).reshape(-1, layers)
    row, column = cells[np.argmin(distances.max(axis=1))]
    centre = grid.lower[:2] + (np.array([row, column]) + 0.5) * grid.spacing[:2]
    out = np.linspace(grid.lower[2], grid.upper[2], _FINER * layers + 1)
    line = np.column_stack([np.tile(centre, (len(out), 1)), out])
    nearest = occupancy.field.nearest(grid.to_world(line))
    if nearest.distances.max() >= occupancy.radius:
        return None
    known, counts = np.unique(nearest.indices, return_counts=True)
    shape = int(known[np.argmax(counts)])
    return Piece(short_name(occupancy.field, shape), centre, shape, int(column), int(row))


def short_name(field: SignedDistanceField, shape: int) -> str:
    """A shape's own name where its body has several, otherwise the body's without its model."""
    if shape < 0:
        return "an obstacle"
    placed = field.shapes[shape]
    alone = sum(other.body == placed.body for other in field.shapes) == 1
    return placed.body.split("::")[-1] if alone or not placed.name else placed.name


def _along_layer(occupancy: Occupancy, layer: int) -> list[int]:
    """The nearest shapes to some cells all over a layer."""
    grid = occupancy.grid
    rows, columns = (
        np.linspace(0, n - 1, min(n, most)).astype(np.int64)
        for n, most in zip(grid.shape[:2], (12, 144), strict=True)
    )
    cells = np.stack(np.meshgrid(rows, columns, [layer], indexing="ij"), axis=-1).reshape(-1, 3)
    shapes = occupancy.field.nearest(grid.centres(cells)).indices
    return [int(m) for m in shapes if m >= 0]


def _inside(occupancy: Occupancy) -> str:
    """What the gap goes around."""
    field = occupancy.field
    bodies = [field.shapes[m].body.split("::")[-1] for m in _along_layer(occupancy, 0)]
    return max(sorted(set(bodies)), key=bodies.count, default="axis")


def loops(grid: Grid, cells: Cells) -> bool:
    """Whether a shortest path of its class, of cells (N, 3), passes over itself on the surface.

    Where two of its cells touch that are not next but one to each other, the way between them would
    be left out, were it not a loop around something.
    """
    apart = np.abs(cells[:, None, :2] - cells[None, :, :2])
    if grid.periodic:
        apart[:, :, 1] = np.minimum(apart[:, :, 1], grid.shape[1] - apart[:, :, 1])
    return bool(np.triu(apart.max(axis=2) <= 1, 3).any())
