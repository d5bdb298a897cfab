"""How the tip travels along a path over time: what such a profile is, and the simplest one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from pips_drake.errors import InputError


class MotionProfile(Protocol):
    """Travel as a function of time, from rest to rest.

    `RestToRestProfile` is the constant speed of the report; `time_optimal` has the fastest.
    """

    @property
    def travel(self) -> float:
        """m."""

    @property
    def duration(self) -> float:
        """s."""

    def __call__(self, time: float) -> tuple[float, float]:
        """Travel (m) and speed (m/s) at a time (s); at rest before and after."""


@dataclass(frozen=True, kw_only=True)
class RestToRestProfile:
    """Travel as a function of time: speed rises by a smooth step, holds, and falls the same way.

    The speed's ramps are 3 x^2 - 2 x^3, so the acceleration is continuous and zero at rest; its
    peak is 1.5 speed / ramp. A travel too short for full speed lowers the speed, not the ramps.

    Attributes:
        travel: m.
        speed: m/s, as reached.
        ramp: duration of each ramp, s.
    """

    travel: float
    speed: float
    ramp: float

    @classmethod
    def make(cls, *, travel: float, speed: float, ramp: float) -> RestToRestProfile:
        """The profile for a travel (m) at no more than `speed` (m/s) with ramps (s)."""
        for name, value in (("travel", travel), ("speed", speed), ("ramp", ramp)):
            if not value > 0.0:
                raise InputError(f"RestToRestProfile: {name} = {value}; must be > 0")
        return cls(travel=travel, speed=min(speed, travel / ramp), ramp=ramp)

    @property
    def duration(self) -> float:
        """s."""
        return self.travel / self.speed + self.ramp

    def __call__(self, time: float) -> tuple[float, float]:
        """Travel (m) and speed (m/s) at a time (s); at rest before and after."""
        if time <= 0.0:
            return 0.0, 0.0
        if time >= self.duration:
            return self.travel, 0.0
        if time < self.ramp:
            return self._ramp(time)
        if time > self.duration - self.ramp:
            left, speed = self._ramp(self.duration - time)
            return self.travel - left, speed
        return self.speed * (time - 0.5 * self.ramp), self.speed

    def _ramp(self, time: float) -> tuple[float, float]:
        x = time / self.ramp
        return self.speed * self.ramp * (x**3 - 0.5 * x**4), self.speed * (3.0 - 2.0 * x) * x**2
