"""Whether an arm goes out along its snake, comes back, or waits (CMU-92 section 3.5.1).

The report's four rules, in the order in which they are asked here:

- cannot be fitted onto the snake: back until it can;
- beyond the snake's end: back until it is not;
- the snake is not near rest: wait;
- it is: out to its end.

The operator's word stands above them: hold, come back, or go out without waiting. How fast is the
motion's matter: `approach` takes the tip to where the rules want it, within a speed and an
acceleration, and so that it stops there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

from pips_drake.errors import InputError
from pips_drake.serpentine.motion_words import EXTEND, HOLD, RETRACT, WORDS

#: Nearer to where it should be the tip is there, m.
ARRIVED = 1e-6


class Extending(IntEnum):
    """What the rules say."""

    #: The operator holds.
    HELD = 0
    #: The snake moves: neither out nor back.
    WAITING = 1
    #: Out, towards the snake's end.
    OUT = 2
    #: At the snake's end, or as far as it may reach.
    THERE = 3
    #: The operator takes it back.
    BACK = 4
    #: Back, because it stands out beyond the snake's end.
    PROTRUDING = 5
    #: Back, because it cannot be fitted onto the snake.
    UNFITTED = 6


@dataclass(frozen=True, kw_only=True)
class Situation:
    """What the rules look at.

    Attributes:
        word: the operator's, one of `motion_words.WORDS`.
        near_rest: whether the snake is close to its least energy.
        fits: whether the arm can be fitted onto the snake where the tip stands.
        tip, home, end: arc lengths of the tip, of its home and of the snake's end, m.
        reach: how far from home the operator lets the tip go, m.
    """

    word: float
    near_rest: bool
    fits: bool
    tip: float
    home: float
    end: float
    reach: float = math.inf


def where_to(now: Situation) -> tuple[Extending, float]:
    """What to do, and the arc length that the tip should go to, m.

    Raises:
        InputError: the word is none.
    """
    if now.word not in WORDS:
        raise InputError(
            f"operator's word = {now.word}; must be 1 (run), 0 (hold), -1 (retract) or 2 (extend)"
        )
    end = max(min(now.end, now.home + now.reach), now.home)
    if now.word == HOLD:
        return Extending.HELD, now.tip
    if now.word == RETRACT:
        return Extending.BACK, now.home
    if not now.fits:
        return Extending.UNFITTED, now.home
    if now.tip > end + ARRIVED:
        # A reach that was drawn in is the operator's will, the snake's end is the snake's.
        return (Extending.PROTRUDING if now.tip > now.end + ARRIVED else Extending.BACK), end
    if not now.near_rest and now.word != EXTEND:
        return Extending.WAITING, now.tip
    if now.tip >= end - ARRIVED:
        return Extending.THERE, end
    return Extending.OUT, end


def approach(
    place: float,
    rate: float,
    target: float,
    *,
    speed: float,
    acceleration: float,
    period: float,
) -> tuple[float, float]:
    """One period of the way to a target: no faster than `speed`, and slow enough to stop there.

    Args:
        place, target: m.
        rate: before, m/s.
        speed: m/s.
        acceleration: m/s^2.
        period: s.

    Returns:
        place after it, m, and the mean rate over it, m/s. Rates change by acceleration * period at
        most, but where that would lead beyond the target.
    """
    way = target - place
    # From v the way to rest in steps of a T is v^2 / (2 a) + v T / 2: v is what leaves that.
    step = acceleration * period
    slow = -0.5 * step + math.sqrt(0.25 * step * step + 2.0 * acceleration * abs(way))
    wanted = math.copysign(min(speed, slow), way)
    after = rate + min(max(wanted - rate, -step), step)
    if after * way > 0.0 and abs(after) * period >= abs(way):
        return target, way / period
    return place + after * period, after
