"""Records a simulated motion whole: knots, and how far it ever is from straight lines between them.

A log at a sampling period says nothing of what lies between its samples. This one looks at every
step of the plant. Between two steps of a discrete plant the positions change linearly (the step is
x+ = x + h v+), so what is kept, knots and the largest distance of any step from the straight line
between its knots, bounds the motion at every instant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, DiagramBuilder, OutputPort, TriggerType
from pydrake.systems.primitives import LogVectorOutput

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedMotion:
    """A motion, linear between knots but for a deviation.

    Attributes:
        times: of the knots, (N,) s, increasing.
        positions: (N, nq).
        deviation: the largest distance of a step from the line between its knots, (nq,).
    """

    times: Array
    positions: Array
    deviation: Array


def thin_out(times: Array, positions: Array, knots: NDArray[np.int64]) -> RecordedMotion:
    """Keeps some rows of a motion as knots, and the deviation of the rows between them.

    Args:
        times: (N,) s, increasing.
        positions: (N, nq).
        knots: rows to keep, increasing; two or more. Rows outside them are left out.
    """
    inside = slice(knots[0], knots[-1] + 1)
    between = np.arange(knots[0], knots[-1] + 1)
    segment = np.minimum(np.searchsorted(knots, between, "right") - 1, len(knots) - 2)
    first, last = knots[segment], knots[segment + 1]
    share = ((times[inside] - times[first]) / (times[last] - times[first]))[:, None]
    straight = positions[first] + share * (positions[last] - positions[first])
    return RecordedMotion(
        times=times[knots],
        positions=positions[knots],
        deviation=np.abs(positions[inside] - straight).max(axis=0),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedSteps:
    """A plant's state at every one of its steps.

    Attributes:
        times: (N,) s, increasing.
        states: (N, nx).
    """

    times: Array
    states: Array


class MotionRecorder:
    """Collects the positions of a state port at every step, thinned out as it goes.

    `collect` is to be called now and then while the simulator runs (`simulation.advance` does):
    until then every step is kept, which in an hour's run would fill the memory.

    Args:
        builder: of the diagram that is simulated.
        state: output port whose first `positions` numbers are the positions.
        stride: steps from knot to knot.
        recent: for how long every step is kept with its whole state (`steps`), s; 0 keeps none,
            infinity all of them (for 18 joints 0.15 MB a second).
    """

    def __init__(
        self,
        builder: DiagramBuilder,
        state: OutputPort,
        *,
        positions: int,
        stride: int,
        recent: float = 0.0,
    ) -> None:
        self._log = LogVectorOutput(state, builder, {TriggerType.kPerStep}, 0.0)
        self._log.set_name("motion_record")
        self._positions, self._stride = positions, stride
        self._times: list[Array] = []
        self._knots: list[Array] = []
        self._deviation = np.zeros(positions)
        # What lies beyond the last knot; its first row is that knot.
        self._tail_times, self._tail = np.empty(0), np.empty((0, positions))
        self._recent, self._frozen = recent, False
        self._steps: list[RecordedSteps] = []

    def collect(self, context: Context) -> None:
        """Takes over what has been logged in the diagram's context since the last call."""
        log = self._log.FindMutableLog(context)
        times, states = log.sample_times().copy(), log.data().T.copy()
        log.Clear()
        if self._tail_times.size and times.size:
            later = times > self._tail_times[-1]
            times, states = times[later], states[later]
        self._keep(RecordedSteps(times=times, states=states))
        rows = states[:, : self._positions]
        self._tail_times = np.concatenate([self._tail_times, times])
        self._tail = np.concatenate([self._tail, rows])
        whole = (len(self._tail_times) - 1) // self._stride * self._stride
        if whole > 0:
            self._thin_out(np.arange(0, whole + 1, self._stride))
            self._tail_times, self._tail = self._tail_times[whole:], self._tail[whole:]

    def steps(self) -> RecordedSteps:
        """Every step of the last `recent` s, or more, up to the last call of `collect`."""
        return RecordedSteps(
            times=np.concatenate([part.times for part in self._steps]),
            states=np.concatenate([part.states for part in self._steps]),
        )

    def freeze(self) -> None:
        """Leaves `steps` at what it is now, unless all of them are kept."""
        self._frozen = np.isfinite(self._recent)

    def _keep(self, steps: RecordedSteps) -> None:
        if self._frozen or self._recent <= 0.0 or not steps.times.size:
            return
        self._steps.append(steps)
        oldest = steps.times[-1] - self._recent
        while self._steps[0].times[-1] < oldest:
            del self._steps[0]

    def motion(self) -> RecordedMotion:
        """The motion up to the last call of `collect`, its last step included."""
        last = len(self._tail_times) - 1
        if last > 0:
            self._thin_out(np.array([0, last]))
        return RecordedMotion(
            times=np.concatenate([*self._times, self._tail_times[-1:]]),
            positions=np.concatenate([*self._knots, self._tail[-1:]]),
            deviation=self._deviation.copy(),
        )

    def _thin_out(self, knots: NDArray[np.int64]) -> None:
        """Keeps the rows `knots` of the tail, all but the last, and the deviation from them."""
        motion = thin_out(self._tail_times, self._tail, knots)
        self._deviation = np.maximum(self._deviation, motion.deviation)
        self._times.append(motion.times[:-1])
        self._knots.append(motion.positions[:-1])
