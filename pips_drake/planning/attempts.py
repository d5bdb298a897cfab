"""What is tried while a path is bent: the weights, what came of them, and what is short."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.planning.arm_clearance import ClearanceBound
from pips_drake.planning.planner import GoalPlan, Laid, PlannerSettings

Array = NDArray[np.float64]
#: Asked for a plan's clearance: a lower bound (m), and a sentence that is used where it is too low.
Judge = Callable[[GoalPlan], tuple[float, str]]

#: Of weights along a path, so many values.
SHARES = 81
# A bending stiffness of none is this before it is raised, N m^2.
_SOFTEST = 1e-3


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """What was tried, and what came of it.

    Attributes:
        change: what is different from the attempt before, in words; empty for the first.
        bending_stiffness: the snake's largest, N m^2.
        tension: N.
        repulsion: its strength, N m^2.
        hinge_margin: least distance of a hinge to its limit, rad; negative beyond it, and NaN where
            no posture was found.
        feed_margin: what of the feed is left, m; NaN as well.
        clearance: lower bound of the arm's distance to obstacles, m, as far as it is looked for;
            NaN where the arm could not follow.
        judged: what the caller's judge said, m; NaN where it was not asked.
    """

    change: str
    bending_stiffness: float
    tension: float
    repulsion: float
    hinge_margin: float = math.nan
    feed_margin: float = math.nan
    clearance: float = math.nan
    judged: float = math.nan


@dataclass(frozen=True)
class Short:
    """What is short in an attempt.

    Attributes:
        kind: posture, hinge, feed, clearance or judge.
        amount: how much, in a unit of its own: of two attempts the one with less is better.
        at: where on the path, m of arc length.
    """

    kind: str
    amount: float
    at: float
    sentence: str


#: Kinds of which a plan's own sentences say enough.
TOLD = ("posture", "hinge")
#: What is worse than any of the kinds behind it.
KINDS = ("posture", "hinge", "feed", "clearance", "judge")


@dataclass(frozen=True, kw_only=True, eq=False)
class Tried:
    """An attempt, and what is short in it."""

    attempt: Attempt
    laid: Laid
    plan: GoalPlan | None = None
    clearance: ClearanceBound | None = None
    short: Short | None = None

    @property
    def kind(self) -> str:
        """Of what is short; empty if nothing is."""
        return self.short.kind if self.short else ""

    @property
    def badness(self) -> tuple[int, float]:
        """To be compared."""
        if self.short is None:
            return 0, 0.0
        return len(KINDS) - KINDS.index(self.short.kind), self.short.amount


@dataclass(frozen=True, kw_only=True, eq=False)
class Weights:
    """What is raised from attempt to attempt; `shares` of the bending stiffness along the path."""

    settings: PlannerSettings
    end_direction: ArrayLike | None
    shares: Array
    nail_lead: bool = True
    change: str = ""

    @property
    def stiffness(self) -> Array:
        """N m^2, along the path."""
        return self.settings.snake.bending_stiffness * self.shares

    def stiffer(self, factor: float, change: str) -> Weights:
        """Everywhere."""
        snake = self.settings.snake
        beta = factor * max(snake.bending_stiffness, _SOFTEST)
        settings = replace(self.settings, snake=replace(snake, bending_stiffness=beta))
        return replace(self, settings=settings, change=change)

    def tenser(self, factor: float, change: str) -> Weights:
        """With more tension."""
        snake = replace(self.settings.snake, tension=factor * self.settings.snake.tension)
        return replace(self, settings=replace(self.settings, snake=snake), change=change)

    def more_repelled(self, factor: float, change: str) -> Weights:
        """By obstacles."""
        repulsion = self.settings.repulsion
        repulsion = replace(repulsion, strength=factor * repulsion.strength)
        settings = replace(self.settings, repulsion=repulsion)
        return replace(self, settings=settings, change=change)
