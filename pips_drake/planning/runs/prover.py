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
from pips_drake.twin.certificate.certify import certify_clearance
from pips_drake.twin.motion_record import thin_out

Array = NDArray[np.float64]

#: How near a proved clearance must come to one that is reached while paths are compared, m.
TOLERANCE = 1e-3


class Prover:
    """Asked by the planner what clearance a plan has (`feasible.Judge`).

    The plant is made once, when it is asked first: the arm's rail stands where home is.
    """

    def __init__(self, scenario: PlannerScenario, workspace: Workspace) -> None:
        self._run = serpentine_scenario(scenario, path="planned")
        self._workspace = workspace
        self._placed: PlacedArm | None = None

    def __call__(self, plan: GoalPlan) -> tuple[float, str]:
        """Least proved clearance to the scene (m), and what comes so near."""
        placed = self._placed or self._place(plan)
        joints = plan.plan.joints
        times = np.arange(len(joints), dtype=np.float64)
        motion = thin_out(times, joints, np.arange(len(joints)))
        found = certify_clearance(
            placed.plant,
            placed.scene_graph.model_inspector(),
            [placed.model],
            motion.positions,
            motion.times,
            tolerance=TOLERANCE,
            deviation=motion.deviation,
        ).scene
        if found is None:
            return np.inf, ""
        first, second = found.witness.bodies
        tip = float(np.interp(found.witness.time, times, plan.plan.solution.tip_arc_lengths))
        point = plan.path.point(tip)
        where = ", ".join(f"{x:.3f}" for x in point)
        return found.lower, (
            f"{first} is proved to be no nearer than {found.lower * 1e3:.1f} mm to {second}, with "
            f"the tip at {tip:.3f} m of the path ({where}) m"
        )

    def _place(self, plan: GoalPlan) -> PlacedArm:
        solver = FollowTheLeader(self._workspace.arm)
        setup = SerpentineSetup(
            arm=self._workspace.arm,
            motion=FollowedPath(path=plan.plan.path, solver=solver),
            solver=solver,
            scene_file=self._workspace.scene_file,
            rail_shift=float(plan.shift[2]),
        )
        self._placed = place_arm(self._run, setup)
        return self._placed
