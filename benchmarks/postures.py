"""10,000 postures checked for collision, and for clearance."""

from __future__ import annotations

import time
from functools import partial

import numpy as np
from pydrake.common import Parallelism
from pydrake.planning import (
    RobotCollisionType,
    RobotDiagramBuilder,
    SceneGraphCollisionChecker,
)

from benchmarks.measuring import Array, Line, measure_in_turn
from pips_drake.scenarios import load_scenario
from pips_drake.scene.loading import AddScene
from pips_drake.serpentine.runs.placed_arm import place_arm
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import (
    BASE_FRAME,
    AddSerpentineArm,
    SerpentineSetup,
    load_setup,
    mounting_pose,
)
from pips_drake.twin.clearance import ClearanceQuery

SEED = 1995


def measure(*, quick: bool) -> list[Line]:
    """Microseconds a posture: half of them along trajectory 4, half at random."""
    count, rounds = (200, 2) if quick else (10_000, 5)
    loaded = load_scenario("trajectory_4")
    scenario: SerpentineScenario = loaded.config
    setup = load_setup(scenario, folder=loaded.folder)
    postures = make_postures(setup, count)
    twin = _Twin(scenario, setup)
    checker = make_checker(scenario, setup)
    reach = scenario.clearance_range_m

    one, all_cores = Parallelism(False), Parallelism.Max()
    ours = twin.collides(postures)
    theirs = ~np.array(checker.CheckConfigsCollisionFree(list(postures), one), dtype=bool)
    least = twin.clearances(postures)
    # The checker gives up on a posture's distances at the first collision: the free ones compare.
    some = np.flatnonzero(~ours)[:: 1 if quick else 10]
    their_least = np.array([_least(checker, q, reach) for q in postures[some]])

    def by_ours() -> float:
        twin.collides(postures)
        return count

    def by_ours_clearance() -> float:
        twin.clearances(postures)
        return count

    def by_checker(cores: Parallelism) -> float:
        checker.CheckConfigsCollisionFree(list(postures), cores)
        return count

    def by_checker_clearance() -> float:
        for q in postures[some]:
            checker.CalcRobotClearance(q, reach)
        return len(some)

    seconds = measure_in_turn(
        {
            "ours": by_ours,
            "clearance": by_ours_clearance,
            "one": lambda: by_checker(one),
            "their clearance": by_checker_clearance,
        },
        rounds=rounds,
    )
    wall = measure_in_turn(
        {"ours, wall": by_ours, "all": lambda: by_checker(all_cores)},
        rounds=rounds,
        clock=time.perf_counter,
    )
    us = {name: 1e6 * values for name, values in (seconds | wall).items()}
    same = {"postures that differ": float(np.sum(ours != theirs)), "colliding": float(ours.sum())}
    what = f"{count:,} postures"
    threads = all_cores.num_threads()
    line = partial(Line, unit="us a posture")
    collision = partial(line, what=f"{what}: do they collide?", agreement=same)
    return [
        collision(
            name="collision_one",
            ours=us["ours"],
            beside="Drake SceneGraphCollisionChecker, one thread",
            peer=us["one"],
            limits="Drake's narrow phase; posing and the call from Python are a tenth",
        ),
        collision(
            name="collision_all",
            ours=us["ours, wall"],
            beside=f"Drake SceneGraphCollisionChecker, {threads} threads",
            peer=us["all"],
            limits="We use one thread: from Python, threads gain nothing",
        ),
        line(
            name="clearance",
            what=f"{what}: least distance and its pair, to scene and itself, within {reach:g} m",
            ours=us["clearance"],
            beside="Drake CalcRobotClearance (every tenth free posture)",
            peer=us["their clearance"],
            limits="Reading the pairs that Drake found from Python, then Drake's narrow phase",
            agreement={
                "least distances apart at most (m)": float(np.abs(least[some] - their_least).max()),
                "nearest (m)": float(least[some].min()),
            },
        ),
    ]


def make_postures(setup: SerpentineSetup, count: int) -> Array:
    """Postures (N, J): the first half on the way out, the second uniform within the limits."""
    path, arm = setup.path, setup.arm
    tips = np.linspace(path.home_arc_length, path.length, count // 2)
    planned = setup.solver.solve(path, tips).joints
    generator = np.random.default_rng(SEED)
    anywhere = generator.uniform(
        arm.joint_lower, arm.joint_upper, size=(count - len(planned), arm.joints)
    )
    return np.concatenate([planned, anywhere])


class _Twin:
    """The scenario's plant, posed, and what the twin asks its scene graph."""

    def __init__(self, scenario: SerpentineScenario, setup: SerpentineSetup) -> None:
        self._placed = place_arm(scenario, setup)
        self._query = ClearanceQuery(
            self._placed.plant, [self._placed.model], max_distance=scenario.clearance_range_m
        )

    def collides(self, postures: Array) -> np.ndarray:
        """Whether anything collides, (N,)."""
        return np.array([query.HasCollisions() for query in self._placed.posed(postures)])

    def clearances(self, postures: Array) -> Array:
        """Least distances to the scene and to the arm itself, (N, 2) m."""
        found = [self._query.least(query) for query in self._placed.posed(postures)]
        return np.array([[scene.distance, own.distance] for scene, own in found])


def make_checker(
    scenario: SerpentineScenario, setup: SerpentineSetup
) -> SceneGraphCollisionChecker:
    """The same arm and scene as a user of Drake's planning library would have them."""
    builder = RobotDiagramBuilder(time_step=0.0)
    plant = builder.plant()
    model = AddSerpentineArm(plant, setup.arm, mounting_pose(scenario), setup.rail_shift)
    if setup.scene_file is not None:
        AddScene(plant, setup.scene_file, base_frame=BASE_FRAME)
    plant.Finalize()
    return SceneGraphCollisionChecker(
        model=builder.Build(),
        robot_model_instances=[model],
        edge_step_size=0.05,
        # Asked for, and used for edges alone.
        configuration_distance_function=lambda p, q: float(np.linalg.norm(p - q)),
    )


def _least(checker: SceneGraphCollisionChecker, q: Array, reach: float) -> Array:
    """Least distances to the scene and to the arm itself that the checker finds, (2,) m."""
    found = checker.CalcRobotClearance(q, reach)
    pairs = list(zip(found.collision_types(), found.distances(), strict=True))
    return np.array(
        [
            min([reach, *(distance for kind, distance in pairs if kind == wanted)])
            for wanted in (
                RobotCollisionType.kEnvironmentCollision,
                RobotCollisionType.kSelfCollision,
            )
        ]
    )
