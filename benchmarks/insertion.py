"""The insertion that planners are compared on, and the one judge of what they find.

CMU-92's arm, with 41 joints that move (the feed and 40 hinges; the camera's roll rests), begins
straight, before the bay's port, and ends where its tip is at a goal in the gap. The judge is the
same for all: Drake's collision engine with the same arm and scene for a posture, and the
certificate of `pips check` for a motion, whose joints go straight from row to row.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.planning import SceneGraphCollisionChecker

from benchmarks.collision_judges import DrakeJudge
from benchmarks.postures import make_checker
from pips_drake.planning.planner import GoalPlan
from pips_drake.planning.runs.motion import plan_motion
from pips_drake.planning.runs.workspace import load_workspace
from pips_drake.planning.scenario import GoalConfig, PlannerScenario, serpentine_scenario
from pips_drake.scenarios import load_scenario
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.runs.placed_arm import place_arm
from pips_drake.serpentine.station import load_setup
from pips_drake.twin.certificate.certify import certify_clearance

Array = NDArray[np.float64]

SCENARIO = "reach_behind_payload"
#: Where the tip goes: along the bay's axis (m), around it (deg), out from it (m). None: where the
#: scenario says.
GOALS = {"front": [7.4, 10.0, 2.034], "behind": None}
#: How far from the scene a posture must be for a planner that checks postures alone, m: without it
#: motions graze something between two of them, however near these are.
PADDING = 0.01
#: How near a certificate's bounds come to each other, m.
TOLERANCE = 1e-3
#: Between postures at which the tip is looked at for the length of its way, m and rad.
TIP_STEP = 0.01


def scenario_of(goal: str) -> PlannerScenario:
    """What `pips plan` would be given."""
    scenario: PlannerScenario = load_scenario(SCENARIO).config
    place = GOALS[goal]
    if place is None:
        return scenario
    return replace(scenario, goals=[GoalConfig(name=goal, unfolded=place)])


def plan(scenario: PlannerScenario) -> GoalPlan | None:
    """Our planner, reading the scene and its own proof included; None if it finds no motion."""
    planned = plan_motion(scenario, load_workspace(scenario))
    return planned.plans[0] if planned.plans and not planned.failures else None


class Judge:
    """Arm and scene in a plant of their own; it knows nothing of planners.

    Args:
        points: of the tip's path, (P, 3) m: the feed is set up where it begins.
    """

    def __init__(self, scenario: PlannerScenario, points: Array) -> None:
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary)
            file = folder / "path.csv"
            np.savetxt(file, points, delimiter=",", header="x_m,y_m,z_m", comments="")
            run = serpentine_scenario(scenario, path=file.name)
            setup = load_setup(run, folder=folder)
        self.arm: SerpentineArm = setup.arm
        self._run, self._setup = run, setup
        self._placed = place_arm(run, setup)
        self._drake = DrakeJudge(self._placed)
        self.queries = 0

    def collides(self, posture: Array) -> bool:
        """Whether anything touches at a posture (J,)."""
        return self._drake.collides(posture)

    @cached_property
    def _checker(self) -> SceneGraphCollisionChecker:
        checker = make_checker(self._run, self._setup)
        checker.SetPaddingAllRobotEnvironmentPairs(PADDING)
        return checker

    def free(self, posture: Array) -> bool:
        """Whether a posture (J,) is as clear of the scene as `PADDING` says, and of the arm."""
        self.queries += 1
        return bool(self._checker.CheckConfigCollisionFree(posture))

    def verdict(self, motion: Array) -> dict[str, Any]:
        """What a motion (K, J) is worth: certified at every instant, and how it goes.

        `certified` says that the arm touches neither the scene nor itself; `clearance_mm` and
        `self_clearance_mm` are lower bounds that hold at every instant.
        """
        inspector = self._placed.scene_graph.model_inspector()
        model = self._placed.model
        proof = certify_clearance(
            self._placed.plant, inspector, [model], motion, tolerance=TOLERANCE
        )
        assert proof.scene is not None and proof.own is not None
        hinges = np.abs(motion[:, ~self.arm.is_prismatic])
        return {
            "certified": min(proof.scene.lower, proof.own.lower) > 0.0,
            "clearance_mm": 1e3 * proof.scene.lower,
            "self_clearance_mm": 1e3 * proof.own.lower,
            "tip_path_m": tip_path_length(self.arm, motion),
            "largest_angle_deg": float(np.degrees(hinges.max())),
            "rows": len(motion),
        }


def tip_path_length(arm: SerpentineArm, motion: Array) -> float:
    """Of the tip's way over a motion (K, J), whose joints go straight from row to row, m."""
    tips = kinematics.spine_points(arm, dense(motion, TIP_STEP))[:, -1]
    return float(np.linalg.norm(np.diff(tips, axis=0), axis=1).sum())


def dense(motion: Array, step: float) -> Array:
    """The motion with rows between its own, none farther than a step from the last (m, rad)."""
    parts = [motion[:1]]
    for first, last in pairwise(motion):
        count = max(1, int(np.ceil(np.linalg.norm(last - first) / step)))
        parts.append(first + (np.arange(1, count + 1) / count)[:, None] * (last - first))
    return np.concatenate(parts)
