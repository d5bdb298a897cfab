"""Runs trajectory 4 with random faults, and judges the runs otherwise than they judge themselves.

    python -m benchmarks.fault_campaign --runs 33 --processes 2

Every run has one random fault (kind, drive, time, size), from a seed. Afterwards every knot of the
plant's recorded motion (each control period) is put into a plant of its own, and Drake is asked
whether anything collides (`HasCollisions`). Asserted: no run crashes, hangs or leaves the finite
numbers, and none that collides says that it passed.
"""

from __future__ import annotations

import argparse
import collections
import multiprocessing
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import Any

import numpy as np

#: Kinds, each with how its size is drawn.
KINDS = {
    "jam": None,
    "slow": (0.0, 0.3),
    "runaway": (0.1, 1.0),
    "limited": (2.0, 20.0),
    "dead": None,
    "stuck": None,
    "biased": (0.2, 4.0),
    "quantised": (0.05, 2.0),
    "payload_displaced": None,
    "disturbance": None,
    "late": None,
}
#: pass and failed: of runs that went on to their end, by the verdict.
OUTCOMES = ("pass", "failed", "held", "retracted", "stopped", "hit")
#: Simulated time of a run, and the longest that one may take of the clock, s.
DURATION, LONGEST = 60.0, 300.0


def random_fault(seed: int) -> dict[str, Any]:
    """One fault, the same for the same seed; kinds take turns."""
    rng = np.random.default_rng(seed)
    kind = list(KINDS)[seed % len(KINDS)]
    start = float(rng.uniform(2.0, 40.0))
    fault: dict[str, Any] = {"kind": kind, "start_s": start}
    joint = int(rng.integers(3, 19))
    if kind in ("jam", "slow", "runaway", "limited"):
        fault["drive"] = f"L{joint}"
    elif kind in ("dead", "stuck", "biased", "quantised"):
        fault["encoder"] = f"theta{joint}"
    elif kind == "payload_displaced":
        offset = rng.uniform([-100.0, 0.0, -100.0], [100.0, 450.0, 100.0])
        fault |= {"body": "payload::payload", "offset_mm": offset.tolist(), "start_s": 0.0}
    elif kind == "disturbance":
        force = rng.normal(size=3)
        fault["force_n"] = (rng.uniform(50.0, 800.0) * force / np.linalg.norm(force)).tolist()
        fault["duration_s"] = float(rng.uniform(0.1, 3.0))
    elif kind == "late":
        fault["size"] = float(rng.integers(2, 40))
    if KINDS[kind] is not None:
        fault["size"] = float(rng.uniform(*KINDS[kind]))
    return fault


def judge(seed: int) -> dict[str, Any]:
    """One run, and what another plant says of it."""
    from pydrake.systems.framework import DiagramBuilder

    from pips_drake.config import validate
    from pips_drake.scenarios import load_scenario
    from pips_drake.serpentine.fault_config import FaultConfig
    from pips_drake.serpentine.runs.assessment import Assessment
    from pips_drake.serpentine.runs.simulate import run_station
    from pips_drake.serpentine.station import VISUAL_PERIOD, load_setup, make_plant
    from pips_drake.serpentine.supervision import Mode

    begin, fault = time.perf_counter(), random_fault(seed)
    scenario = load_scenario("fault_jam").config
    scenario.faults = [FaultConfig(**fault)]
    scenario.duration_s, scenario.supervisor.patience_s = DURATION, 2.0
    validate(scenario)
    setup = load_setup(scenario)
    run = run_station(scenario, setup)
    builder = DiagramBuilder()
    plant, scene_graph, model = make_plant(builder, setup, scenario, visual_period=VISUAL_PERIOD)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    query_port, mine = scene_graph.get_query_output_port(), plant.GetMyContextFromRoot(context)
    hits = []
    for moment, positions in zip(run.motion.times, run.motion.positions, strict=True):
        plant.SetPositions(mine, model, positions)
        if query_port.Eval(scene_graph.GetMyContextFromRoot(context)).HasCollisions():
            hits.append(float(moment))
    supervised = run.supervised
    assert supervised is not None
    failures = supervised.failures()
    failures += Assessment(
        arm=setup.arm,
        path=setup.path,
        solver=setup.solver,
        checks=scenario.checks,
        data=run.data,
        clearance_range=scenario.clearance_range_m,
    ).failures()
    verdict = "failed" if failures else "pass"
    words = {Mode.HOLD: "held", Mode.RETRACT: "retracted", Mode.STOP: "stopped"}
    outcome = "hit" if hits else words.get(supervised.mode, verdict)
    least = min(run.data.clearance.min(), run.data.self_clearance.min())
    return {
        "seed": seed,
        "fault": fault,
        "outcome": outcome,
        "verdict": verdict,
        "failures": failures,
        "safe": supervised.safe,
        "first_hit": hits[0] if hits else None,
        "least": float(least),
        "finite": bool(np.isfinite(run.motion.positions).all()),
        "deviation": float(run.motion.deviation.max()),
        "wall": time.perf_counter() - begin,
    }


def hits_anything(one: dict[str, Any]) -> bool:
    """Whether the other plant found a collision."""
    return one["first_hit"] is not None


def table(results: list[dict[str, Any]]) -> str:
    """Outcomes by kind, Markdown."""
    counts = collections.Counter((one["fault"]["kind"], one["outcome"]) for one in results)
    lines = [f"| fault | {' | '.join(OUTCOMES)} |", "|---|" + "---|" * len(OUTCOMES)]
    for kind in KINDS:
        cells = " | ".join(str(counts[kind, outcome]) for outcome in OUTCOMES)
        lines.append(f"| {kind} | {cells} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=33)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    results = []
    context = multiprocessing.get_context("spawn")
    seeds = range(options.first_seed, options.first_seed + options.runs)
    # A process that crashes breaks the pool, and one that hangs runs into the time.
    with ProcessPoolExecutor(options.processes, mp_context=context) as pool:
        waiting = [pool.submit(judge, seed) for seed in seeds]
        for pending in as_completed(waiting, timeout=LONGEST * options.runs):
            one = pending.result()
            assert one["finite"] and one["wall"] < LONGEST, one
            # What collided must not be said to have passed.
            assert not (hits_anything(one) and one["verdict"] == "pass"), one
            results.append(one)
            sys.stdout.write(f"{one}\n")
            sys.stdout.flush()
    sys.stdout.write(table(results) + "\n")


if __name__ == "__main__":
    main()
