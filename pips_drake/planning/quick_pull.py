"""Pulls a path tight with few of the obstacles in view, and checks it against all.

What pulls (`string_pull`) asks for the distance to every shape at every trial, of which there are
many thousand where a path lies on something round; but a path touches few. So it is pulled among
those few that it already is near to, the result checked exactly against all, and pulled again, from
the beginning, with those in view as well that were in its way.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.planning.line_of_sight import TOLERANCE, first_blocked
from pips_drake.planning.string_pull import MOST_ROUNDS, pull
from pips_drake.scene.signed_distance import SignedDistanceField

Array = NDArray[np.float64]

#: Shapes in the way are looked for this often; then all are in view.
_MOST_VIEWS = 12
# Rounds of pulling after which a path touches what it will touch.
_ROUGHLY = 6


def pull_quickly(
    field: SignedDistanceField, points: ArrayLike, radius: float, *, in_view: Iterable[int] = ()
) -> Array:
    """As `string_pull.pull`: as clear as that, and as tight; but of several tight ways it may come
    to another one.

    Args:
        in_view: shapes that are in view from the first: the path is less likely to leap over them.

    Raises:
        InputError: as of `pull`.
    """
    p = np.ascontiguousarray(points, dtype=np.float64)
    if p.ndim != 2 or p.shape[1] != 3 or len(p) < 1 or not np.isfinite(p).all():
        return pull(field, points, radius)  # which says what is wrong
    segment, at, shape = first_blocked(field.arrays, p, radius - TOLERANCE)
    if segment >= 0:
        raise InputError(
            f"path is not clear: {at:.3g} m behind its point {segment} it is nearer than "
            f"{radius:.3g} m to {field.label(shape)}"
        )
    seen = set(in_view)
    for _ in range(_MOST_VIEWS):
        few = SignedDistanceField.of(field.shapes[m] for m in sorted(seen))
        # Roughly at first: what is in the way of a tight path is in that of a rough one too.
        pulled = p
        for rounds in (_ROUGHLY, MOST_ROUNDS):
            pulled = pull(few, pulled, radius, most_rounds=rounds)
            blocking = _in_the_way(field, pulled, radius)
            if blocking:
                break
        else:
            return pulled
        seen |= blocking
    return pull(field, p, radius)


def _in_the_way(field: SignedDistanceField, points: Array, radius: float) -> set[int]:
    """The first shape in the way on each segment of a path."""
    found = set()
    for k in range(len(points) - 1):
        segment, _, shape = first_blocked(field.arrays, points[k : k + 2], radius - TOLERANCE)
        if segment >= 0:
            found.add(int(shape))
    return found
