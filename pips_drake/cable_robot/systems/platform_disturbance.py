"""A fault: something pushes the platform."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from pips_drake.config import require
from pips_drake.errors import InputError

#: Once is enough: events that come again after so long, s, do not come again.
_NEVER_AGAIN = 1e9


class PlatformDisturbance(LeafSystem):
    """A constant wrench on the platform from one time to another.

    .. pydrake_system::

        name: PlatformDisturbance
        output_ports:
        - disturbance

    Output port, from state (no feedthrough):

    - `disturbance`, (6,): about the platform's origin in W, force N and moment N m.

    State: the output, discrete, updated at the two times alone.

    Args:
        wrench: (6,) N and N m.
        start: s.
        end: s; inf: it stays.
    """

    def __init__(
        self, *, wrench: ArrayLike = (0.0,) * 6, start: float = 0.0, end: float = math.inf
    ) -> None:
        super().__init__()
        value = np.array(wrench, dtype=np.float64)
        if value.shape != (6,) or not np.all(np.isfinite(value)):
            raise InputError(f"disturbance of shape {value.shape}; must be (6,), finite, N and N m")
        good = 0.0 <= start < end
        require(good, "disturbance: times", f"{start:g} .. {end:g} s", "rising, from 0 or more")
        self._disturbance = self.DeclareDiscreteState(6)
        self.DeclareStateOutputPort("disturbance", self._disturbance)
        for time, wanted in ((start, value), (end, np.zeros(6))):
            if math.isfinite(time):
                self.DeclarePeriodicDiscreteUpdateEvent(_NEVER_AGAIN, time, self._setting(wanted))

    def _setting(self, wanted):  # type: ignore[no-untyped-def]
        def update(context: Context, values: DiscreteValues) -> None:
            values.set_value(self._disturbance, wanted)

        return update
