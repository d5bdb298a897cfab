"""The clock of a motion: it runs out and back, and is slowed, stopped and turned by words.

What moves is a function of the clock's time, so a hold or a way back changes when, never where.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from pips_drake.errors import InputError
from pips_drake.serpentine.motion_words import (
    DONE,
    DWELLING,
    EXTEND,
    EXTENDING,
    HOLD,
    RETRACT,
    RETRACTING,
    RUN,
    WORDS,
)

#: Time, s; its rate; phase; time left to dwell, s.
ClockState = tuple[float, float, float, float]


def check_word(where: str, word: float) -> float:
    """A word of `motion_words`.

    Raises:
        InputError: it is another number.
    """
    if word not in WORDS:
        raise InputError(f"{where} = {word}; must be 1 (run), 0 (hold), -1 (retract) or 2 (extend)")
    return word


@dataclass(frozen=True, kw_only=True)
class MotionClock:
    """Steps a clock from 0 to its end, where it dwells, and back.

    Attributes:
        end: s.
        dwell: time at the end before the way back, s; without that, the end is the end.
        retract: whether to come back after the dwell without being told.
        ramp: time in which the clock comes to rest or up to its rate, s.
        period: of the steps, s.
        rests_at_ends: whether what the clock drives is itself at rest at both ends: then the clock
            starts, stops and turns there at once. Otherwise it comes up and down over `ramp` there
            too.
    """

    end: float
    dwell: float
    retract: bool
    ramp: float
    period: float
    rests_at_ends: bool

    @property
    def start(self) -> ClockState:
        """At the beginning of the way out: as if it had always run, if it may start at once."""
        return 0.0, 1.0 if self.rests_at_ends else 0.0, EXTENDING, self.dwell

    @property
    def way_duration(self) -> float:
        """Of the way out, or back, without a hold, s; steps make it up to a period more."""
        if self.rests_at_ends:
            return self.end
        if self.end >= self.ramp:
            return self.end + self.ramp
        return 2.0 * math.sqrt(self.end * self.ramp)

    @property
    def duration(self) -> float:
        """To do it all without a hold, s; steps make it up to two periods more."""
        way = self.way_duration
        return way + (self.dwell + way if self.retract else 0.0)

    def step(self, state: ClockState, command: float, share: float) -> ClockState:
        """The state a period later.

        Args:
            command: a word.
            share: at which share of its full rate the clock runs, above 0 and at most 1.
        """
        # Python's own numbers: several times faster than numpy's.
        time, rate, phase, dwell = state
        if phase == DWELLING and command == RUN:
            dwell -= self.period
            if dwell <= 0.0:
                phase = RETRACTING
        if command == RETRACT and (phase < RETRACTING or time > 0.0):
            phase = RETRACTING
        if command == EXTEND and (phase == RETRACTING or (phase == DONE and time < self.end)):
            phase, dwell = EXTENDING, self.dwell
        wanted = 0.0 if command == HOLD else {EXTENDING: 1.0, RETRACTING: -1.0}.get(phase, 0.0)
        wanted *= share
        if self.rests_at_ends:
            if time <= 0.0 or time >= self.end:
                rate = wanted
        else:
            wanted = self._stoppable(time, rate, wanted)
        most = self.period / self.ramp
        new_rate = rate + min(max(wanted - rate, -most), most)
        time = min(max(time + 0.5 * (rate + new_rate) * self.period, 0.0), self.end)
        if phase == EXTENDING and time >= self.end:
            new_rate, phase = 0.0, DWELLING if self.retract else DONE
        elif phase == RETRACTING and time <= 0.0:
            new_rate, phase = 0.0, DONE
        return time, new_rate, phase, dwell

    def _stoppable(self, time: float, rate: float, wanted: float) -> float:
        """The wanted rate, as far as the clock can still come to rest at the end ahead.

        With slowing down by a = 1 / ramp, a step from rate r to n, then n to rest takes
        (r + n) period / 2 + n^2 / (2 a), which must be what is left.
        """
        if wanted == 0.0:
            return 0.0
        sign = 1.0 if wanted > 0.0 else -1.0
        left = (self.end - time if sign > 0.0 else time) - 0.5 * sign * rate * self.period
        half = 0.5 * self.period / self.ramp
        most = math.sqrt(half * half + 2.0 * max(left, 0.0) / self.ramp) - half
        return sign * min(abs(wanted), most)
