"""The planner beside OMPL's RRTConnect and BIT*, on the 41-joint insertion with the same judge.

    python -m benchmarks.planners --seeds 20 [--goals behind ...] [--seconds 60] [--processes 2]
                                  [--file planners.jsonl] [--csv FILE] [--figure FILE]

Every run is a process of its own: planner, seed and goal (`benchmarks.insertion`). Its time is the
processor's, so that other programs do not lengthen it, and holds everything behind the imports:
reading the scene, planning, building the judge's plant, and certifying. Ours is certified twice, by
itself while it plans and by the judge, and both are counted. Nothing is compiled in a run; an
uncounted one of ours before the first does that, and its last posture is given to the others.

Each finished run is a line of the file. Started again, the benchmark leaves out those that it has.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.fault_campaign import read_results
from benchmarks.sampling_planners import PLANNERS

Array = NDArray[np.float64]

OURS = "ours"
COLUMNS = (
    "goal",
    "planner",
    "seed",
    "certified",
    "total_s",
    "wall_s",
    "planning_s",
    "certifying_s",
    "motions",
    "resolution",
    "queries",
    "tip_path_m",
    "clearance_mm",
    "self_clearance_mm",
    "largest_angle_deg",
    "rows",
)


def run_ours(goal: str) -> dict[str, Any]:
    """Our planner; it draws nothing at random, so that seeds only repeat it."""
    from benchmarks.insertion import Judge, plan, scenario_of

    begin, began = time.process_time(), time.perf_counter()
    scenario = scenario_of(goal)
    found = plan(scenario)
    planning = time.process_time() - begin
    if found is None:
        return {"certified": False, "planning_s": planning, "total_s": planning}
    judge = Judge(scenario, found.points)
    middle = time.process_time()
    result = judge.verdict(found.plan.joints)
    end = time.process_time()
    return result | {
        "motions": 1,
        "planning_s": planning,
        "certifying_s": end - middle,
        "total_s": end - begin,
        "wall_s": time.perf_counter() - began,
        "points": found.points.tolist(),
        "last": found.plan.joints[-1].tolist(),
    }


def run_theirs(
    goal: str, planner: str, seed: int, seconds: float, points: Array, last: Array
) -> dict[str, Any]:
    """One of OMPL's planners.

    Args:
        points: of a tip's path, which says where the feed is set up, (P, 3) m.
        last: the posture to end in, (J,).
    """
    from benchmarks.insertion import Judge, scenario_of
    from benchmarks.sampling_planners import SamplingPlanner, plan_until_certified

    begin, began = time.process_time(), time.perf_counter()
    judge = Judge(scenario_of(goal), points)
    arm = judge.arm
    # The last joint turns the camera, and rests.
    moving = slice(0, arm.joints - 1)

    def whole(rows: Array) -> Array:
        rest = np.full((*rows.shape[:-1], 1), arm.joint_home[-1])
        return np.concatenate([rows, rest], axis=-1)

    planner_ = SamplingPlanner(
        planner,
        lambda q: judge.free(whole(q)),
        arm.joint_lower[moving],
        arm.joint_upper[moving],
        arm.joint_home[moving],
        last[moving],
        seed=seed,
    )
    left = seconds - (time.process_time() - begin)
    result = plan_until_certified(planner_, lambda q: judge.verdict(whole(q)), seconds=left)
    return result | {
        "queries": judge.queries,
        "total_s": time.process_time() - begin,
        "wall_s": time.perf_counter() - began,
    }


def run_process(task: dict[str, Any]) -> dict[str, Any]:
    """One run in a process of its own."""
    begin = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.planners", "--one"],
        input=json.dumps(task),
        capture_output=True,
        text=True,
        cwd=Path(__file__).resolve().parents[1],
        check=False,
    )
    known = {key: task[key] for key in ("goal", "planner", "seed")}
    if done.returncode != 0:
        return known | {"certified": False, "error": done.stderr[-2000:]}
    process = {"process_wall_s": time.perf_counter() - begin}
    return known | json.loads(done.stdout.splitlines()[-1]) | process


def run_one(task: dict[str, Any]) -> dict[str, Any]:
    """What `--one` does."""
    if task["planner"] == OURS:
        return run_ours(task["goal"])
    return run_theirs(
        task["goal"],
        task["planner"],
        task["seed"],
        task["seconds"],
        np.array(task["points"]),
        np.array(task["last"]),
    )


def run_all(tasks: Sequence[dict[str, Any]], processes: int) -> Iterator[dict[str, Any]]:
    """Results in the tasks' order, as they come."""
    with ThreadPoolExecutor(processes) as pool:
        yield from pool.map(run_process, tasks)


def tasks_of(goals: Sequence[str], seeds: int, seconds: float) -> list[dict[str, Any]]:
    """All runs; planners take turns, so that what disturbs the machine disturbs all of them."""
    return [
        {"goal": goal, "planner": planner, "seed": seed, "seconds": seconds}
        for seed in range(seeds)
        for goal in goals
        for planner in (OURS, *PLANNERS)
    ]


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--goals", nargs="+", default=["front", "behind"])
    parser.add_argument("--seconds", type=float, default=60.0, help="most for a run of OMPL's")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--file", type=Path, default=Path("planners.jsonl"))
    parser.add_argument("--csv", type=Path, help="list every run there")
    parser.add_argument("--figure", type=Path, help="draw them there (PNG)")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        sys.stdout.write(json.dumps(run_one(json.load(sys.stdin))) + "\n")
        return 0
    from benchmarks import planners_report

    results = read_results(options.file)
    options.file.write_text("".join(json.dumps(one) + "\n" for one in results))
    have = {(one["goal"], one["planner"], one["seed"]) for one in results}
    tasks = tasks_of(options.goals, options.seeds, options.seconds)
    tasks = [one for one in tasks if (one["goal"], one["planner"], one["seed"]) not in have]
    given = {}
    for goal in sorted({task["goal"] for task in tasks}):
        first = run_process({"goal": goal, "planner": OURS, "seed": 0, "seconds": 0.0})
        if "last" not in first:
            sys.stdout.write(f"our planner does not reach {goal}: {first.get('error', '')}\n")
            return 1
        given[goal] = {key: first[key] for key in ("points", "last")}
    tasks = [task | given[task["goal"]] for task in tasks]
    with options.file.open("a") as file:
        for one in run_all(tasks, options.processes):
            results.append({k: v for k, v in one.items() if k not in ("points", "last")})
            file.write(json.dumps(results[-1]) + "\n")
            file.flush()
            sys.stdout.write(planners_report.sentence(results[-1]) + "\n")
            sys.stdout.flush()
    results.sort(key=lambda one: (one["goal"], one["planner"] != OURS, one["planner"], one["seed"]))
    sys.stdout.write(planners_report.table(results) + "\n")
    if options.csv:
        options.csv.write_text(planners_report.listing(results, COLUMNS))
    if options.figure:
        planners_report.draw(results, options.figure)
    return 0


if __name__ == "__main__":
    sys.exit(main())
