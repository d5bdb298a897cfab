"""OMPL's RRTConnect and BIT* as their users run them, with a judge that is given.

State space: the joints that move, within their limits; distances are Euclidean over metres and
radians. They are given the goal as a whole posture (the one that our planner ends in), which they
would otherwise have to find by inverse kinematics. RRTConnect's range, how far a tree grows at a
time, is the best of what was tried (0.1, 0.3, 1, and OMPL's default of 2.7, with which it did not
get behind the payload in 20 s); all else is OMPL's default.

Motions are validated at a resolution. Where the certificate then finds that a motion touches
something between, the resolution is made finer and the planner starts again, as a user would.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PLANNERS = ("RRTConnect", "BITstar")
#: Of states that are checked along a motion, at first, m and rad; then half of it, and so on.
RESOLUTION = 0.05
FINEST = RESOLUTION / 16
#: Of RRTConnect, m and rad.
RANGE = 0.1


class SamplingPlanner:
    """One of OMPL's planners, from one posture to another.

    Args:
        name: one of `PLANNERS`.
        free: whether a posture (D,) is free.
        lower, upper: limits of the joints, (D,).
    """

    def __init__(
        self,
        name: str,
        free: Callable[[Array], bool],
        lower: Array,
        upper: Array,
        start: Array,
        goal: Array,
        *,
        seed: int,
    ) -> None:
        from ompl import base, geometric, util

        util.setLogLevel(util.LOG_NONE)
        util.RNG.setSeed(seed + 1)  # 0 means "of the clock"
        self._base, self._geometric, self._name, self._free = base, geometric, name, free
        self._lower, self._upper, self._start, self._goal = lower, upper, start, goal

    def solve(self, resolution: float, seconds: float) -> Array | None:
        """The first motion found (K, D), or None after so much of the processor's time, s."""
        base, geometric = self._base, self._geometric
        dimension = len(self._start)
        space = base.RealVectorStateSpace(dimension)
        bounds = base.RealVectorBounds(dimension)
        for i in range(dimension):
            bounds.setLow(i, float(self._lower[i]))
            bounds.setHigh(i, float(self._upper[i]))
        space.setBounds(bounds)
        setup = geometric.SimpleSetup(space)
        information = setup.getSpaceInformation()
        setup.setStateValidityChecker(
            lambda state: bool(self._free(np.array([state[i] for i in range(dimension)])))
        )
        information.setStateValidityCheckingResolution(resolution / information.getMaximumExtent())
        ends = []
        for posture in (self._start, self._goal):
            state = space.allocState()
            for i in range(dimension):
                state[i] = float(posture[i])
            ends.append(state)
        setup.setStartAndGoalStates(*ends)
        objective = base.PathLengthOptimizationObjective(information)
        objective.setCostThreshold(objective.infiniteCost())  # the first motion will do
        setup.setOptimizationObjective(objective)
        planner = getattr(geometric, self._name)(information)
        if self._name == "RRTConnect":
            planner.setRange(RANGE)
        setup.setPlanner(planner)
        end = time.process_time() + seconds
        setup.solve(base.PlannerTerminationCondition(lambda: time.process_time() > end))
        if not setup.haveExactSolutionPath():
            return None
        states = setup.getSolutionPath().getStates()
        return np.array([[state[i] for i in range(dimension)] for state in states])


def plan_until_certified(
    planner: SamplingPlanner, verdict: Callable[[Array], dict[str, Any]], *, seconds: float
) -> dict[str, Any]:
    """Motions at finer and finer resolution until one is certified, or the time is over.

    Returns:
        the verdict on the last motion, if there was one; `resolution`, `motions` tried, and
        `planning_s` and `certifying_s` of the processor's time.
    """
    found: dict[str, Any] = {"certified": False}
    planning, certifying, motions, resolution = 0.0, 0.0, 0, RESOLUTION
    while planning + certifying < seconds and resolution >= FINEST:
        begin = time.process_time()
        motion = planner.solve(resolution, seconds - planning - certifying)
        planning += time.process_time() - begin
        if motion is None:
            break
        begin = time.process_time()
        found = verdict(motion)
        certifying += time.process_time() - begin
        motions += 1
        if found["certified"]:
            break
        resolution *= 0.5
    return found | {
        "motions": motions,
        "resolution": resolution,
        "planning_s": planning,
        "certifying_s": certifying,
    }
