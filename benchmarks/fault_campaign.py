"""Runs trajectory 4 with random faults, and judges the runs otherwise than they judge themselves.

    python -m benchmarks.fault_campaign --runs 500 --processes 2 --file campaign.jsonl

Every run has one random fault (`benchmarks.random_faults`), from its seed. Afterwards every step of
the plant is put into a plant of its own, and Drake is asked whether anything collides; a sample of
the steps is put to another library too (`benchmarks.collision_judges`). `complaints` says what
must not be; any of it fails the campaign.

Each finished run is a line of the file. Started again, the campaign leaves out the seeds that the
file has.
"""

from __future__ import annotations

import argparse
import collections
import functools
import json
import multiprocessing
import signal
import sys
import time
import traceback
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.random_faults import KINDS, Draw, begin_at, draw, drawn_scenario

#: What becomes of a run. pass and failed: it went on to its end, and the verdict.
OUTCOMES = ("pass", "failed", "held", "retracted", "stopped", "hit")
#: What must not become of it: an exception, or a process that died or was ended as hanging.
BROKEN = ("error", "crash")
#: Longest time that a run may take of the clock, s.
LONGEST = 300.0
#: Steps that coal looks at: the nearest ones that the run logged, and random others.
NEAREST, RANDOM = 8, 24
#: A process makes about so many runs and is replaced: diagrams with Python systems are never freed.
RUNS_PER_PROCESS = 20


def judge(seed: int) -> dict[str, Any]:
    """One run, and what others say of it. A hanging run ends its process."""
    signal.alarm(int(LONGEST))
    begin, lot = time.perf_counter(), draw(seed)
    try:
        found = run_and_judge(lot)
    except Exception as error:  # whatever it is, it is the campaign's to tell
        found = {"outcome": "error", "error": repr(error), "trace": traceback.format_exc()}
    signal.alarm(0)
    return lot.record() | found | {"wall": round(time.perf_counter() - begin, 2)}


def run_and_judge(lot: Draw) -> dict[str, Any]:
    """What the run says of itself, and what the judges say."""
    from benchmarks.collision_judges import disagreements
    from pips_drake.serpentine.runs.judgement import judge_run
    from pips_drake.serpentine.runs.run import run_station
    from pips_drake.serpentine.supervision import Mode

    scenario, setup = drawn_scenario(lot)
    run = run_station(
        scenario,
        setup,
        every_step=True,
        prepare=functools.partial(begin_at, scenario=scenario, setup=setup, start=lot.start),
    )
    verdict = judge_run(scenario, setup, run, commanded=False)
    assert run.steps is not None
    times, postures = run.steps.times, run.steps.states[:, : setup.arm.joints]
    drake, coal = judges(scenario, setup)
    hits = drake.collisions(postures)
    sample = sample_of(lot.seed, times, hits, run.data.time, least_distances(run.data))
    quarrels = disagreements(drake, coal, postures, sample)
    supervised, words = run.supervised, ("pass", "held", "retracted", "stopped")
    modes = (Mode.PERMIT, Mode.HOLD, Mode.RETRACT, Mode.STOP)
    outcome = "pass" if supervised is None else words[modes.index(supervised.mode)]
    if len(hits):
        outcome = "hit"
    elif outcome == "pass" and verdict.failures:
        outcome = "failed"
    told = {key: value for key, value in verdict.summary.items() if key.startswith("hit_")}
    return {
        "outcome": outcome,
        "verdict": "fail" if verdict.failures else "pass",
        "failures": list(verdict.failures),
        "steps": len(times),
        "hit_steps": len(hits),
        "first_hit": float(times[hits[0]]) if len(hits) else None,
        "hits_at_end": bool(len(hits)) and int(hits[-1]) == len(times) - 1,
        "told": {
            key: value.tolist() if isinstance(value, np.ndarray) else value
            for key, value in told.items()
        },
        "sampled": len(sample),
        "disagreements": quarrels,
        "safe": supervised.safe if supervised is not None else None,
        "least": float(least_distances(run.data).min()),
        "finite": is_finite(run),
    }


def judges(scenario: Any, setup: Any) -> tuple[Any, Any]:
    """Two judges of the arm and the scene as they really stand, in a plant of their own."""
    from benchmarks.collision_judges import CoalJudge, DrakeJudge
    from pips_drake.serpentine.runs.placed_arm import place_arm

    placed = place_arm(scenario, setup)
    drake = DrakeJudge(placed)
    return drake, CoalJudge(drake, placed.scene_graph.model_inspector())


def least_distances(data: Any) -> np.ndarray:
    """To the scene or to itself, whichever is nearer, at the logged times, (N,) m."""
    least: np.ndarray = np.minimum(data.clearance, data.self_clearance)
    return least


def is_finite(run: Any) -> bool:
    """Whether states, commands, forces and distances are numbers."""
    data = run.data
    return all(
        bool(np.isfinite(part).all())
        for part in (
            run.steps.states,
            data.commanded_joints,
            data.joint_efforts[1:],  # nothing has acted before the first step
            data.clearance,
            data.self_clearance,
        )
    )


def sample_of(
    seed: int, times: np.ndarray, hits: np.ndarray, logged: np.ndarray, least: np.ndarray
) -> list[int]:
    """The steps that the second library looks at.

    Args:
        times: of the steps, (N,) s.
        hits: steps that Drake says collide.
        logged: times, (M,) s, with `least` distances, (M,) m.
    """
    rng = np.random.default_rng([seed, 1])
    nearest = np.searchsorted(times, logged[np.argsort(least)[:NEAREST]])
    some = rng.integers(len(times), size=RANDOM)
    edges = [hits[0] - 1, hits[0], hits[-1]] if len(hits) else []
    rows = np.unique(np.concatenate([nearest, some, edges]).astype(np.int64))
    return [int(row) for row in rows if 0 <= row < len(times)]


def complaints(one: dict[str, Any]) -> list[str]:
    """What must not be said of a run, as sentences; none for a run in order."""
    if one["outcome"] in BROKEN:
        return [f"{one['outcome']}: {one.get('error', '')}"]
    found = [f"the judges disagree: {words}" for words in one["disagreements"]]
    if not one["finite"]:
        found.append("not all numbers are finite")
    if one["wall"] > LONGEST:
        found.append(f"took {one['wall']:.0f} s")
    if one["first_hit"] is not None:
        if one["verdict"] == "pass":
            found.append("it collides and says that it passed")
        told = one["told"].get("hit_time_s")
        if told is None:
            found.append("it collides and does not say what was hit")
        elif told != one["first_hit"]:
            found.append(f"it says that it hit at {told} s; it did at {one['first_hit']} s")
    elif one["told"]:
        found.append("it says that it hit something, which it did not")
    if one["hits_at_end"] and one["safe"]:
        found.append("it ends in a collision and says that it ended safely")
    return found


def table(results: Sequence[dict[str, Any]]) -> str:
    """Outcomes by kind, Markdown."""
    lines = [f"| fault | runs | {' | '.join(OUTCOMES)} |", "|---|" + "---|" * (len(OUTCOMES) + 1)]
    counts = collections.Counter((one["kind"], one["outcome"]) for one in results)
    for kind in (*KINDS, "all"):
        these = [counts[kind, outcome] for outcome in OUTCOMES]
        if kind == "all":
            these = [sum(counts[one, outcome] for one in KINDS) for outcome in OUTCOMES]
        lines.append(f"| {kind} | {sum(these)} | {' | '.join(map(str, these))} |")
    hits = [one for one in results if one["outcome"] == "hit"]
    by_whom = collections.Counter(one["supervised"] for one in hits)
    from_start = sum(one["first_hit"] == 0.0 for one in hits)
    lines += [
        "",
        f"{len(hits)} runs hit something: {by_whom[False]} without and {by_whom[True]} with a "
        f"supervisor; {from_start} of them began in contact.",
        f"{sum(one.get('steps', 0) for one in results)} steps judged, "
        f"{sum(one.get('sampled', 0) for one in results)} of them by the second library.",
        f"{sum(bool(complaints(one)) for one in results)} runs are complained of.",
    ]
    return "\n".join(lines)


def run_all(seeds: Sequence[int], processes: int) -> Iterator[dict[str, Any]]:
    """Results as they come; a run that ends its process is told as a crash."""
    batch = RUNS_PER_PROCESS * processes
    for first in range(0, len(seeds), batch):
        # A pool a batch: `max_tasks_per_child` may leave a pool without a process (Python issue
        # 115634; seen here after twice 20 runs).
        yield from _run_batch(seeds[first : first + batch], processes)


def _run_batch(seeds: Sequence[int], processes: int) -> Iterator[dict[str, Any]]:
    context, left = multiprocessing.get_context("spawn"), set(seeds)
    try:
        with ProcessPoolExecutor(processes, mp_context=context) as pool:
            for pending in as_completed([pool.submit(judge, seed) for seed in seeds]):
                one = pending.result()
                left.discard(one["seed"])
                yield one
    except BrokenProcessPool:
        # One of them did it: each on its own, until that is known.
        for seed in sorted(left):
            with ProcessPoolExecutor(1, mp_context=context) as pool:
                try:
                    yield pool.submit(judge, seed).result()
                except BrokenProcessPool:
                    yield draw(seed).record() | {"outcome": "crash"}


def read_results(file: Path) -> list[dict[str, Any]]:
    """The runs that a file has; a last line that was cut off is none."""
    if not file.exists():
        return []
    whole = [line for line in file.read_text().splitlines(keepends=True) if line.endswith("\n")]
    return [json.loads(line) for line in whole]


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=28)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--file", type=Path, default=Path("fault_campaign.jsonl"))
    options = parser.parse_args()
    results = read_results(options.file)
    seeds = range(options.first_seed, options.first_seed + options.runs)
    results = [one for one in results if one["seed"] in seeds]
    missing = sorted(set(seeds) - {one["seed"] for one in results})
    options.file.write_text("".join(json.dumps(one) + "\n" for one in results))
    with options.file.open("a") as file:
        for one in run_all(missing, options.processes):
            results.append(one)
            file.write(json.dumps(one) + "\n")
            file.flush()
            words = "; ".join(complaints(one)) or "in order"
            sys.stdout.write(
                f"{len(results)}/{len(seeds)} seed {one['seed']} {one['kind']}: {one['outcome']} "
                f"({one.get('wall', 0.0):.1f} s); {words}\n"
            )
            sys.stdout.flush()
    results.sort(key=lambda one: one["seed"])
    sys.stdout.write(table(results) + "\n")
    wrong = [(one["seed"], words) for one in results for words in complaints(one)]
    for seed, words in wrong:
        sys.stdout.write(f"seed {seed}: {words}\n")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
