"""What a scenario's goals became."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pips_drake.planning.alternatives import Alternative
from pips_drake.planning.planner import GoalPlan
from pips_drake.planning.scan_motion import ScanPlan
from pips_drake.serpentine.joint_motion import JointMotion

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Planned:
    """What was planned.

    Attributes:
        plans: for each of the scenario's goals that was planned for, in their order.
        alternatives: paths to the goal to choose from, if more than one was asked for.
        chosen: which of them, from 0.
        motion: the joints over time where no single path describes the motion; else None.
        scan: of a surface, if the scenario wants one.
        rough: the user's own path that was improved, (P, 3) m in frame 0; None if there was none.
        failures: why it is not what was asked for; empty if it is.
        notes: what else there is to say.
        numbers: for `summary.json`.
        wall_s: how long it took, s.
    """

    plans: tuple[GoalPlan, ...] = ()
    alternatives: tuple[Alternative, ...] = ()
    chosen: int = 0
    motion: JointMotion | None = None
    scan: ScanPlan | None = None
    rough: Array | None = None
    failures: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    numbers: dict[str, Any] = field(default_factory=dict)
    wall_s: float = 0.0
