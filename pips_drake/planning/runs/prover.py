"""Proves how near a planned motion comes to anything, in one plant for many plans."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pips_drake.planning.planner import GoalPlan
from pips_drake.planning.runs.workspace import Workspace
from pips_drake.planning.scenario import PlannerScenario, serpentine_scenario
from pips_drake.serpentine.follow_the_leader import FollowTheLeader
from pips_drake.serpentine.planned_motion import FollowedPath
from pips_drake.serpentine.runs.placed_arm import PlacedArm, place_arm
from pips_drake.serpentine.station import SerpentineSetup
from pips_drake.twin.certificate.certify import Certifier

Array = NDArray[np.float64]

#: How near a proved clearance must come to one that is reached, while it is less than enough, m.
TOLERANCE = 1e-3


class Prover:
    """Asked by the planner what clearance a plan has (`attempts.Judge`).

    The plant is made once, when it is asked first: the arm's rail stands where home is. What is
    proved is enough when it is the clearance that the scenario's checks ask for; the verdict's own
    certificate says how much there is.
    """

    def __init__(self, scenario: PlannerScenario, workspace: Workspace) -> None:
        self._run = serpentine_scenario(scenario, path="planned")
        self._workspace = workspace
        self._placed: PlacedArm | None = None
        self._certifier: Certifier | None = None

    def __call__(self, plan: GoalPlan) -> tuple[float, str]:
        """A clearance to the scene that is proved (m), and what to say of too little."""
        certifier = self._certifier or self._place(plan)
        joints = plan.plan.joints
        times = np.arange(len(joints), dtype=np.float64)
        found = certifier.certify(
            joints,
            times,
            tolerance=TOLERANCE,
            enough=self._run.checks.clearance_min_mm * 1e-3,
            own=False,
        ).scene
        if found is None:
            return np.inf, ""
        first, second = found.witness.bodies
        tip = float(np.interp(found.witness.time, times, plan.plan.solution.tip_arc_lengths))
        where = ", ".join(f"{x:.3f}" for x in plan.path.point(tip))
        return found.lower, (
            f"{first} may come within {found.lower * 1e3:.1f} mm of {second} with the tip at "
            f"{tip:.3f} m of the path ({where}) m; must be >= "
            f"{self._run.checks.clearance_min_mm:g} mm"
        )

    def _place(self, plan: GoalPlan) -> Certifier:
        solver = FollowTheLeader(self._workspace.arm)
        setup = SerpentineSetup(
            arm=self._workspace.arm,
            motion=FollowedPath(path=plan.plan.path, solver=solver),
            solver=solver,
            scene_file=self._workspace.scene_file,
            rail_shift=float(plan.shift[2]),
        )
        placed = self._placed = place_arm(self._run, setup)  # held: the certifier looks into it
        self._certifier = Certifier(
            placed.plant, placed.scene_graph.model_inspector(), [placed.model]
        )
        return self._certifier
