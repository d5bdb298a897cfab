"""What an arm on a live snake is at a tick, and how it may move (`live_arm`)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from pips_drake.errors import InputError
from pips_drake.planning.extension import Extending
from pips_drake.planning.live_snake import LiveSnake, LiveSnakeSettings
from pips_drake.serpentine.tip_path import TipPath

Array = NDArray[np.float64]


class Refusal(IntEnum):
    """Why a tick's first wish was not taken."""

    NONE = 0
    #: A body would come nearer to an obstacle than the clearance.
    TOO_NEAR = 1
    #: A joint would leave its limits.
    JOINT_LIMIT = 2
    #: Follow-the-leader has no solution.
    NOT_FITTED = 3
    #: A drive would have to go faster than it can, or a body farther than it may, even at a part
    #: of the move.
    TOO_FAST = 4


@dataclass(frozen=True, kw_only=True)
class LiveArmSettings:
    """How an arm goes along a live snake.

    Attributes:
        snake: how that moves.
        clearance: least distance of the arm's bodies to obstacles, m.
        lead: how far the snake goes straight on from the home tip, m.
        tip_speed: along the snake, m/s.
        tip_acceleration: m/s^2.
        shift_speed: of the snake's points, m/s.
        shift_acceleration: m/s^2.
        drive_share: of the drives' speed limits that is used.
        period: of a tick, s.

    Raises:
        InputError: a number that means nothing.
    """

    snake: LiveSnakeSettings = field(default_factory=LiveSnakeSettings)
    clearance: float = 0.03
    lead: float = 0.5
    tip_speed: float = 0.05
    tip_acceleration: float = 0.1
    shift_speed: float = 0.05
    shift_acceleration: float = 0.1
    drive_share: float = 0.9
    period: float = 1.0 / 32.0

    def __post_init__(self) -> None:
        for name, unit in (
            ("clearance", "m"),
            ("lead", "m"),
            ("tip_speed", "m/s"),
            ("tip_acceleration", "m/s^2"),
            ("shift_speed", "m/s"),
            ("shift_acceleration", "m/s^2"),
            ("drive_share", ""),
            ("period", "s"),
        ):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(f"live arm's {name} = {value} {unit}".rstrip() + "; must be > 0")
        if self.drive_share > 1.0:
            raise InputError(f"live arm's drive_share = {self.drive_share}; must be at most 1")
        between = 0.5 * (self.tip_speed + self.shift_speed) * self.period
        if self.clearance < between:
            raise InputError(
                f"live arm's clearance = {self.clearance} m; must be at least half of what it "
                f"moves in a tick, {between:.4f} m"
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class LiveState:
    """An arm on a snake, at a tick.

    Attributes:
        live: the snake, in the scene's frame.
        path: the same as the tip's path, with the base line, in the arm's frame {0}.
        tip, tip_rate: arc length on `path`, m, and its mean rate over the last tick, m/s.
        shift_rate: how fast the snake's fastest point went, m/s.
        joints, rates: (J,) m and rad, and mean rates over the last tick.
        clearance: lower bound of the arm's distance to obstacles, m; no better than need be.
        fits: whether the arm could be fitted onto the snake's last move.
        extending: what the rules of extension said.
        refusal: why the tick's first wish was not taken.
        near_rest: whether the snake is close to rest.
        bend: largest share of its way from home to a limit that a hinge would need on the way back
            along the snake, as it was when that moved last.
    """

    live: LiveSnake
    path: TipPath
    tip: float
    tip_rate: float
    shift_rate: float
    joints: Array
    rates: Array
    clearance: float
    fits: bool
    extending: Extending
    refusal: Refusal
    near_rest: bool
    bend: float

    @property
    def extended(self) -> float:
        """How far from home the tip is, m."""
        return self.tip - self.path.home_arc_length

    def __deepcopy__(self, memo: dict[int, object]) -> LiveState:
        """Itself: nothing in a state is ever changed, and contexts copy theirs at every event."""
        return self
