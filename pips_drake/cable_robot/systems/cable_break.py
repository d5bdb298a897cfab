"""A fault: cables that break."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from pips_drake.cable_robot.robot import CableRobot
from pips_drake.config import require

#: Once is enough: events that come again after so long, s, do not come again.
_NEVER_AGAIN = 1e9


class CableBreak(LeafSystem):
    """Breaks cables at given times, and brakes the winches some time after the first.

    .. pydrake_system::

        name: CableBreak
        output_ports:
        - broken
        - brake

    Output ports, both from state (no feedthrough):

    - `broken`, (M,): 1 where a cable is broken.
    - `brake`, (1,): 1 from `reaction` s after the first break: what watches the force sensors has
      locked the winches.

    State: the outputs, discrete, updated at those times alone.

    Args:
        cable_robot: with M cables.
        breaks: number of the cable, from 0, and when it breaks, s.
        reaction: s; inf: the winches go on.
    """

    def __init__(
        self,
        cable_robot: CableRobot,
        *,
        breaks: Sequence[tuple[int, float]] = (),
        reaction: float = 0.1,
    ) -> None:
        super().__init__()
        count = cable_robot.cables
        for cable, time in breaks:
            good = 0 <= cable < count
            require(good, f"{cable_robot.name}: broken cable", cable + 1, f"1 .. {count}")
            good = math.isfinite(time) and time >= 0.0
            require(good, f"{cable_robot.name}: time of a break", f"{time:g} s", ">= 0")
        require(reaction >= 0.0, f"{cable_robot.name}: reaction", f"{reaction:g} s", ">= 0")
        self._broken = self.DeclareDiscreteState(count)
        self._brake = self.DeclareDiscreteState(1)
        self.DeclareStateOutputPort("broken", self._broken)
        self.DeclareStateOutputPort("brake", self._brake)
        for cable, time in breaks:
            # Offsets of what is periodic are Drake's way to name a time.
            self.DeclarePeriodicDiscreteUpdateEvent(_NEVER_AGAIN, time, self._breaking(cable))
        if breaks and math.isfinite(reaction):
            first = min(time for _, time in breaks)
            self.DeclarePeriodicDiscreteUpdateEvent(
                _NEVER_AGAIN, first + reaction, self._update_brake
            )

    def _breaking(self, cable: int):  # type: ignore[no-untyped-def]
        def update(context: Context, values: DiscreteValues) -> None:
            broken = values.get_mutable_vector(self._broken).get_mutable_value()
            broken[cable] = 1.0

        return update

    def _update_brake(self, context: Context, values: DiscreteValues) -> None:
        values.set_value(self._brake, np.ones(1))
