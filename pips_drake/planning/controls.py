"""An operator's desk in the browser: Meshcat's sliders and keys, read as a wish.

Sliders move the goal, pull at a point of the snake, and tune elasticity, rigidity and reach; keys
drive a nail in where the pull acts, take the last one out, and run, hold, retract or extend. What
was done is kept, as a recording that can be repeated.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.planning.live_snake import Wish
from pips_drake.planning.snake import Snake
from pips_drake.serpentine.motion_words import EXTEND, HOLD, RETRACT, RUN

if TYPE_CHECKING:
    from pydrake.geometry import Meshcat

Array = NDArray[np.float64]

#: Buttons, and the keys that press them.
BUTTONS = {
    "run": "Enter",
    "hold": "Space",
    "retract": "Backspace",
    "extend": "KeyE",
    "nail": "KeyN",
    "unnail": "KeyM",
}
_WORDS = {"run": RUN, "hold": HOLD, "retract": RETRACT, "extend": EXTEND}
#: Keys that move the goal back and forth along each slider.
_GOAL_KEYS = (("ArrowLeft", "ArrowRight"), ("ArrowDown", "ArrowUp"), ("PageDown", "PageUp"))


class OperatorDesk:
    """Sliders and buttons in a Meshcat's page.

    Args:
        meshcat: where they are added.
        goal: where the goal is to begin with, (3,) m in the scene's frame.
        reach: that the reach slider begins with and ends at, m.
        tension, bending_stiffness: that the snake has to begin with, N and N m^2.
        axis: of a cylindrical workspace along z0, (x, y) m: the goal is moved along it, around it
            (m of arc at the goal's distance) and out from it. None for x, y and z.
        span: how far the goal's sliders go to either side, m.
    """

    def __init__(
        self,
        meshcat: Meshcat,
        *,
        goal: ArrayLike,
        reach: float,
        tension: float,
        bending_stiffness: float,
        axis: tuple[float, float] | None = None,
        span: float = 2.0,
    ) -> None:
        self._meshcat = meshcat
        self._goal = np.array(goal, dtype=np.float64)
        self._axis = axis
        self._nails: list[Array] = []
        self._word = RUN
        names = ("x", "y", "z") if axis is None else ("along", "around", "out")
        self.goal_sliders = tuple(f"goal {name} (m)" for name in names)
        for name, (less, more) in zip(self.goal_sliders, _GOAL_KEYS, strict=True):
            meshcat.AddSlider(name, -span, span, 0.01, 0.0, less, more)
        meshcat.AddSlider("reach (m)", 0.0, reach, 0.05, reach)
        # Over decades: what an operator feels are ratios.
        meshcat.AddSlider("elasticity (log10 N)", -2.0, 2.0, 0.05, math.log10(tension))
        meshcat.AddSlider(
            "rigidity (log10 N m^2)", -4.0, 2.0, 0.05, math.log10(max(bending_stiffness, 1e-4))
        )
        meshcat.AddSlider("pull at (share of the snake)", 0.0, 1.0, 0.01, 0.5)
        for axis_name in "xyz":
            meshcat.AddSlider(f"pull {axis_name} (N)", -20.0, 20.0, 0.5, 0.0)
        for name, key in BUTTONS.items():
            meshcat.AddButton(name, key)
        self._clicks = {name: meshcat.GetButtonClicks(name) for name in BUTTONS}
        # Until they are moved, weights are the snake's own, to the last digit.
        self._untouched = {
            "elasticity (log10 N)": (self._value("elasticity (log10 N)"), tension),
            "rigidity (log10 N m^2)": (self._value("rigidity (log10 N m^2)"), bending_stiffness),
        }

    def read(self, snake: Snake) -> Wish:
        """What the operator wants now.

        Args:
            snake: as it lies, for pulls and nails.
        """
        for name in BUTTONS:
            clicks = self._meshcat.GetButtonClicks(name)
            for _ in range(clicks - self._clicks[name]):
                self._press(name, snake)
            self._clicks[name] = clicks
        pull = np.array([self._value(f"pull {name} (N)") for name in "xyz"])
        return Wish(
            goal=self._moved_goal(),
            pulls=((self._place(snake), pull),) if pull.any() else (),
            nails=np.array(self._nails).reshape(-1, 3),
            tension=self._weight("elasticity (log10 N)"),
            bending_stiffness=self._weight("rigidity (log10 N m^2)"),
            word=self._word,
            reach=self._value("reach (m)"),
        )

    def close(self) -> None:
        """Takes sliders and buttons out of the page."""
        self._meshcat.DeleteAddedControls()

    def _press(self, name: str, snake: Snake) -> None:
        if name == "nail":
            self._nails.append(self._place(snake))
        elif name == "unnail":
            self._nails = self._nails[:-1]
        else:
            self._word = _WORDS[name]

    def _value(self, name: str) -> float:
        return float(self._meshcat.GetSliderValue(name))

    def _weight(self, name: str) -> float:
        logarithm, (began, own) = self._value(name), self._untouched[name]
        return own if logarithm == began else 10.0**logarithm

    def _place(self, snake: Snake) -> Array:
        """The point that the share's slider means."""
        arcs = snake.arc_lengths
        share = self._value("pull at (share of the snake)")
        row = int(np.argmin(np.abs(arcs - share * arcs[-1])))
        return snake.points[row].copy()

    def _moved_goal(self) -> Array:
        moved = np.array([self._value(name) for name in self.goal_sliders])
        if self._axis is None:
            return self._goal + moved
        along, around, out = moved
        aside = self._goal[:2] - np.array(self._axis)
        far = float(np.hypot(*aside))
        angle = math.atan2(aside[1], aside[0]) + around / far
        radius = far + out
        return np.array(
            [
                self._axis[0] + radius * math.cos(angle),
                self._axis[1] + radius * math.sin(angle),
                self._goal[2] + along,
            ]
        )


class WishKeeper:
    """Keeps what was wished and when, for a recording; what did not change is left out."""

    def __init__(self) -> None:
        self.times: list[float] = []
        self.wishes: list[Wish] = []

    def keep(self, time: float, wish: Wish) -> None:
        """Notes a wish at a time, s."""
        if self.wishes and same_wish(wish, self.wishes[-1]):
            return
        self.times.append(time)
        self.wishes.append(wish)


def same_wish(one: Wish, other: Wish) -> bool:
    """Whether two wishes want the same."""
    if not _same_array(one.goal, other.goal) or not np.array_equal(one.nails, other.nails):
        return False
    if len(one.pulls) != len(other.pulls):
        return False
    for a, b in zip(one.pulls, other.pulls, strict=True):
        if not (np.array_equal(a[0], b[0]) and np.array_equal(a[1], b[1])):
            return False
    numbers = [(w.tension, w.bending_stiffness, w.word, w.reach) for w in (one, other)]
    return numbers[0] == numbers[1]


def _same_array(one: Array | None, other: Array | None) -> bool:
    if one is None or other is None:
        return one is other
    return np.array_equal(one, other)
