"""Runs a diagram: progress, finite numbers, and the time it took."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from tqdm import tqdm

from pips_drake.errors import PipsError

if TYPE_CHECKING:
    from pydrake.systems.analysis import Simulator
    from pydrake.systems.framework import Context

#: Simulated time between two looks at progress and state, s.
STRIDE = 0.25


class DivergedError(PipsError):
    """The simulation has left the numbers that mean anything.

    Attributes:
        time: when it was noticed, s.
    """

    def __init__(self, time_s: float) -> None:
        self.time = time_s
        super().__init__(f"the simulated state is not finite at {time_s:.3f} s; take smaller steps")


@dataclass(frozen=True, kw_only=True)
class RunTime:
    """How long a run took."""

    simulated_s: float
    wall_s: float

    @property
    def real_time_rate(self) -> float:
        """Simulated seconds a second."""
        return self.simulated_s / self.wall_s


def advance(
    simulator: Simulator,
    duration: float,
    *,
    label: str = "simulating",
    watch: Callable[[Context], None] | None = None,
    finished: Callable[[Context], bool] | None = None,
    latest: float = 0.0,
) -> RunTime:
    """Initializes a simulator and advances it by `duration` s, or until it is `finished`.

    A progress bar appears when standard error is a terminal. Every `STRIDE` the state is looked at:
    Drake goes on with NaN without a word.

    Args:
        watch: called with the root context as often, and at the end.
        finished: asked with the root context as often, after `watch`: says when the run is over,
            before or after `duration`.
        latest: when a run that is not `finished` ends nevertheless, s; not before `duration`.

    Raises:
        DivergedError: the state is not finite.
    """
    simulator.Initialize()
    context = simulator.get_context()
    start, begin = context.get_time(), time.perf_counter()
    with tqdm(
        total=round(duration, 3),
        desc=label,
        unit="s",
        disable=not sys.stderr.isatty(),
        bar_format="{l_bar}{bar}| {n:.1f}/{total:.1f} s simulated [{elapsed}<{remaining}]",
    ) as bar:
        done, end = 0.0, duration
        while done < end:
            step = min(STRIDE, end - done)
            done = min(done + step, end)
            simulator.AdvanceTo(start + done)
            bar.update(step)
            if watch is not None:
                watch(simulator.get_mutable_context())
            _check_finite(simulator)
            if finished is not None:
                if finished(simulator.get_context()):
                    break
                if done >= end and end < latest:
                    end = bar.total = latest
    return RunTime(simulated_s=done, wall_s=time.perf_counter() - begin)


def _check_finite(simulator: Simulator) -> None:
    context = simulator.get_context()
    state = [context.get_continuous_state_vector().CopyToVector()]
    discrete = context.get_discrete_state()
    # Measurements may say "none" with NaN; positions and velocities may not. The plant's state is
    # the largest group.
    if discrete.num_groups():
        sizes = [discrete.get_vector(i).size() for i in range(discrete.num_groups())]
        state.append(discrete.get_vector(int(np.argmax(sizes))).CopyToVector())
    if not all(np.all(np.isfinite(part)) for part in state):
        raise DivergedError(context.get_time())
