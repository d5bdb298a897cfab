"""The fault campaign's judges find what collides, and its check catches a run that lies."""

from __future__ import annotations

import json
import os
from typing import Any

import numpy as np
import pytest

from benchmarks.fault_campaign import (
    complaints,
    judge,
    judges,
    read_results,
    run_all,
    run_and_judge,
    sample_of,
    table,
)
from benchmarks.random_faults import DURATION, KINDS, LATEST_START, Draw, draw, drawn_scenario

#: Of the sorts that a campaign of a few hundred runs draws.
SEEDS = range(200)


def lot(fault: dict[str, Any], *, start: float, supervised: bool = False) -> Draw:
    kind = fault["kind"]
    return Draw(seed=1, kind=kind, hard=True, supervised=supervised, start=start, fault=fault)


def collision() -> Draw:
    """Nobody supervises, and the payload stands where the hand is going."""
    offset = [0.0, 300.0, 0.0]
    moved = {"kind": "payload_displaced", "body": "payload::payload", "offset_mm": offset}
    return lot(moved, start=45.0)


def sound() -> dict[str, Any]:
    """What is said of a run in order."""
    return draw(0).record() | {
        "outcome": "pass",
        "verdict": "pass",
        "failures": [],
        "steps": 4097,
        "hit_steps": 0,
        "first_hit": None,
        "hits_at_end": False,
        "told": {},
        "sampled": 32,
        "disagreements": [],
        "safe": True,
        "least": 0.08,
        "finite": True,
        "wall": 5.0,
    }


@pytest.fixture(scope="module")
def collided() -> dict[str, Any]:
    one = collision()
    return one.record() | run_and_judge(one) | {"wall": 1.0}


def test_the_same_seed_draws_the_same_and_another_seed_does_not():
    assert [draw(seed) for seed in SEEDS] == [draw(seed) for seed in SEEDS]
    assert len({json.dumps(draw(seed).fault) for seed in SEEDS}) == len(SEEDS)


def test_every_draw_is_a_scenario_that_the_twin_takes():
    for seed in SEEDS:
        one = draw(seed)
        scenario, _ = drawn_scenario(one)  # validates
        assert scenario.faults[0].kind == one.kind
        assert 0.0 <= one.start <= LATEST_START
        assert scenario.faults[0].start_s < DURATION


def test_all_kinds_are_drawn_mild_and_hard_with_and_without_a_supervisor():
    lots = [draw(seed) for seed in SEEDS]
    for kind in KINDS:
        mine = [one for one in lots if one.kind == kind]
        assert {one.hard for one in mine} == {one.supervised for one in mine} == {True, False}


def test_a_run_in_order_is_not_complained_of():
    assert complaints(sound()) == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"first_hit": 2.0, "told": {"hit_time_s": 2.0}}, "says that it passed"),
        ({"first_hit": 2.0, "verdict": "fail"}, "does not say what was hit"),
        (
            {"first_hit": 2.0, "verdict": "fail", "told": {"hit_time_s": 2.5}},
            "says that it hit at 2.5 s",
        ),
        ({"told": {"hit_time_s": 2.5}}, "which it did not"),
        ({"hits_at_end": True}, "ended safely"),
        ({"finite": False}, "not all numbers are finite"),
        ({"disagreements": ["step 7"]}, "disagree: step 7"),
        ({"wall": 1000.0}, "took 1000 s"),
        ({"outcome": "crash"}, "crash"),
        ({"outcome": "error", "error": "ValueError()"}, "ValueError"),
    ],
)
def test_what_must_not_be_is_complained_of(change, words):
    (found,) = complaints(sound() | change)
    assert words in found


def test_the_table_counts_what_became_of_the_runs():
    results = [sound(), sound() | {"outcome": "hit", "supervised": False, "first_hit": 0.0}]
    lines = table(results).splitlines()
    assert lines[2] == "| jam | 2 | 1 | 0 | 0 | 0 | 0 | 1 |"
    assert lines[-3].startswith("1 runs hit something: 1 without and 0 with a supervisor; 1 of")
    assert lines[-1] == "1 runs are complained of."


def test_a_line_that_was_cut_off_is_a_run_to_be_made_again(tmp_path):
    file = tmp_path / "runs.jsonl"
    assert read_results(file) == []
    whole = json.dumps(sound()) + "\n"
    file.write_text(whole + whole[:40])
    assert read_results(file) == [sound()]


def test_the_sample_has_the_nearest_steps_the_hits_and_others():
    times, logged = np.arange(4097) / 512.0, np.arange(257) / 32.0
    least = np.abs(logged - 3.0)
    sample = sample_of(1, times, np.array([700, 701, 702]), logged, least)
    assert {699, 700, 702} <= set(sample)
    assert 3 * 512 in sample, "the nearest logged instant"
    assert len(sample) > 24 and sample == sample_of(1, times, np.array([700, 702]), logged, least)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_both_judges_find_a_collision_which_is_no_pass(collided):
    assert collided["outcome"] == "hit" and collided["verdict"] == "fail"
    assert collided["hit_steps"] > 0 and collided["first_hit"] > 0.0
    assert complaints(collided) == []
    assert collided["told"]["hit_time_s"] == collided["first_hit"]
    assert collided["told"]["hit_pair"][1] == "payload::payload"
    assert collided["told"]["hit_energy_j"] > 0.0


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_doctored_pass_is_caught(collided):
    (found,) = complaints(collided | {"verdict": "pass"})
    assert found == "it collides and says that it passed"


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_judge_that_sees_the_payload_elsewhere_is_contradicted():
    """The second library is asked of a scene whose payload stands right: it must disagree."""
    from benchmarks.collision_judges import disagreements

    scenario, setup = drawn_scenario(collision())
    drake, _ = judges(scenario, setup)
    home = setup.solver.solve(setup.path, [setup.path.home_arc_length]).joints[0]
    end = setup.solver.solve(setup.path, [setup.path.length]).joints[0]
    postures = np.array([home, end])
    assert drake.collisions(postures).tolist() == [1]
    scenario.faults = []
    other_drake, other_coal = judges(scenario, setup)
    assert disagreements(other_drake, other_coal, postures, [0, 1]) == []
    (found,) = disagreements(drake, other_coal, postures, [0, 1])
    assert found.startswith("step 1: Drake says touching, coal ")


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_mild_fault_passes():
    mild = {"kind": "biased", "encoder": "theta5", "size": 0.01, "start_s": 1.0}
    one = lot(mild, start=20.0, supervised=True)
    found = one.record() | run_and_judge(one) | {"wall": 1.0}
    assert found["outcome"] == found["verdict"] == "pass", found["failures"]
    assert complaints(found) == []


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_an_exception_is_told_and_does_not_end_the_campaign(monkeypatch):
    monkeypatch.setattr("benchmarks.fault_campaign.run_and_judge", lambda lot: 1 / 0)
    one = judge(3)
    assert one["outcome"] == "error" and "ZeroDivisionError" in one["trace"]
    assert complaints(one)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_process_that_dies_is_told_as_a_crash(monkeypatch):
    monkeypatch.setattr("benchmarks.fault_campaign.judge", os._exit)
    (one,) = run_all([5], processes=1)
    assert one["outcome"] == "crash" and one["seed"] == 5
