"""A path drawn by hand becomes one that the arm can follow (FTL-95 section 1.2: human-assisted).

The user's path says which way to go; the snake laid on it keeps that way where nothing blocks it,
becomes short and smooth, and moves away from obstacles. Two things are told besides the verdict:
how far the path moved from the user's, and whether anything lies between the two. Both are compared
at equal shares of their lengths: where the straight line from the one to the other is free all
along, the new path passes everything on the side that the user chose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.planning.arm_clearance import least_clearance, too_near
from pips_drake.planning.attempts import Judge
from pips_drake.planning.feasible import MOST_ATTEMPTS, FeasiblePlan, make_feasible
from pips_drake.planning.planner import PlannerSettings
from pips_drake.scene.signed_distance import SignedDistanceField
from pips_drake.serpentine.anchoring import anchor_path
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.plan import make_plan
from pips_drake.serpentine.tip_path import TipPath, blended_path, polyline_path

Array = NDArray[np.float64]

#: Points of a path are looked at so far apart, m.
STEP = 0.01
# Between postures at which the arm's clearance is looked at first, m.
_CLEARANCE_STEP = 0.2
_NO_SIDE = "no side was found to leave it on"
# Between the user's path and the new one, so many points of each straight line.
_BETWEEN = 17


@dataclass(frozen=True, kw_only=True, eq=False)
class ImprovedPath:
    """What became of a user's path.

    Attributes:
        made: the path, the postures and the verdict.
        before: what was wrong with the user's own, in sentences; empty if the arm could follow it
            with the margin.
        crossed: where the user's own goes through obstacles, and whether the new one leaves them to
            one side, in sentences.
        moved: farthest that the new path is from the user's, m.
        moved_at: where on the new path that is, (3,) m.
        same_side: whether everything is passed on the side that the user chose; False where the
            user's path goes through something.
    """

    made: FeasiblePlan
    before: tuple[str, ...]
    crossed: tuple[str, ...]
    moved: float
    moved_at: Array
    same_side: bool

    @property
    def failures(self) -> tuple[str, ...]:
        """Why there is no good path, what blocks it first; empty if and only if there is one."""
        if self.made.feasible:
            return ()
        blocked = tuple(words for words in self.crossed if words.endswith(_NO_SIDE))
        return blocked + self.made.failures


def improve_path(
    arm: SerpentineArm,
    field: SignedDistanceField,
    path: TipPath | ArrayLike,
    *,
    nails: ArrayLike = (),
    settings: PlannerSettings | None = None,
    margin: float,
    judge: Judge | None = None,
    most_attempts: int = MOST_ATTEMPTS,
) -> ImprovedPath:
    """Makes of a user's path one that the arm can follow, on the same side of everything.

    Args:
        path: in frame_0; or points (P, 3) m, row 0 the base end and row 1 the home tip.
        nails: places that it must go through all the same, (K, 3) m.
        settings, margin, judge, most_attempts: as of `feasible.plan_feasibly`.

    Raises:
        InputError: no path, or not one that begins on the arm's base line; the arm collides before
            it begins.
    """
    rough, points = _taken(path)
    home, begin = points[1], rough.home_arc_length
    before = _verdict_before(arm, field, points, margin)
    crossings = _crossings(field, rough, begin)
    made = make_feasible(
        arm,
        field,
        points[2:],
        home_tip=home,
        nails=list(np.asarray(nails, dtype=np.float64).reshape(-1, 3)),
        settings=settings,
        margin=margin,
        judge=judge,
        most_attempts=most_attempts,
        rough=True,
    )
    new = made.best.path
    s = np.arange(new.home_arc_length, new.length, STEP)
    away, _ = rough.nearest(new.point(s), 0.0, rough.length)
    worst = int(np.argmax(away))
    return ImprovedPath(
        made=made,
        before=before,
        crossed=tuple(_left_aside(field, words, shape, new) for words, shape in crossings),
        moved=float(away[worst]),
        moved_at=new.point(s[worst]),
        same_side=not crossings and _nothing_between(field, rough, new),
    )


def _taken(path: TipPath | ArrayLike) -> tuple[TipPath, Array]:
    """The user's path, and its points."""
    if isinstance(path, TipPath):
        s = np.append(np.arange(path.home_arc_length, path.length, 0.1), path.length)
        return path, path.point(np.concatenate([[0.0], s]))
    points = np.asarray(path, dtype=np.float64)
    rough = polyline_path(points, "drawn")
    if len(points) < 3:
        raise InputError("path 'drawn' ends at the home tip; must have a point beyond row 2")
    return rough, points


def _verdict_before(
    arm: SerpentineArm, field: SignedDistanceField, points: Array, margin: float
) -> tuple[str, ...]:
    """What keeps the arm from following the user's own path with a margin."""
    try:
        path = blended_path(points, "drawn")
    except InputError as error:  # it turns straight back: no arc does
        return (str(error),)
    anchored, _ = anchor_path(arm, path)
    plan = make_plan(arm, anchored)
    if not plan.followable:
        return plan.failures
    found = least_clearance(
        arm,
        field,
        lambda s: plan.solver.solve(anchored, s).joints,
        anchored.samples(_CLEARANCE_STEP),
        shift=path.point(0.0) - anchored.point(0.0),
        within=2.0 * margin + 1e-3,
        enough=margin,
    )
    if found.lower >= margin:
        return ()
    ahead = found.tip_arc_length - anchored.home_arc_length
    return (too_near(field, found, margin, ahead),)


def _crossings(field: SignedDistanceField, path: TipPath, begin: float) -> list[tuple[str, int]]:
    """Where a path goes through obstacles: a sentence, and the shape, of each time."""
    s = np.append(np.arange(begin, path.length, STEP), path.length)
    found = field.nearest(path.point(s))
    inside = np.concatenate([[False], found.distances < 0.0, [False]])
    edges = np.flatnonzero(np.diff(inside.astype(int)))
    result = []
    for first, last in zip(edges[::2], edges[1::2] - 1, strict=True):
        deepest = first + int(np.argmin(found.distances[first : last + 1]))
        shape = int(found.indices[deepest])
        words = (
            f"the path drawn goes through {field.label(shape)} from {_place(path.point(s[first]))} "
            f"to {_place(path.point(s[last]))}"
        )
        result.append((words, shape))
    return result


def _left_aside(field: SignedDistanceField, words: str, shape: int, new: TipPath) -> str:
    """The sentence, and what the new path does about it."""
    alone = SignedDistanceField.of([field.shapes[shape]])
    s = np.append(np.arange(new.home_arc_length, new.length, STEP), new.length)
    found = alone.nearest(new.point(s))
    k = int(np.argmin(found.distances))
    if found.distances[k] < 0.0:
        return f"{words}; {_NO_SIDE}"
    side = ", ".join(f"{x + 0.0:.2f}" for x in np.round(found.gradients[k], 2))
    return f"{words}; the new one leaves it aside, passing on the side towards ({side})"


def _nothing_between(field: SignedDistanceField, old: TipPath, new: TipPath) -> bool:
    shares = np.linspace(0.0, 1.0, int(max(old.travel, new.travel) / STEP) + 2)
    first = old.point(old.home_arc_length + shares * old.travel)
    last = new.point(new.home_arc_length + shares * new.travel)
    parts = np.linspace(0.0, 1.0, _BETWEEN)[:, None, None]
    between = (first + parts * (last - first)).reshape(-1, 3)
    return bool((field.distances(between) > 0.0).all())


def _place(point: Array) -> str:
    return "(" + ", ".join(f"{x + 0.0:.4g}" for x in np.round(point, 4)) + ") m"
