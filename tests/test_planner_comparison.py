"""The comparison with OMPL: what it counts, what it leaves out, and that its parts run."""

from __future__ import annotations

import json
import sys
from itertools import pairwise

import numpy as np
import pytest

from benchmarks import planners, planners_report
from benchmarks.insertion import Judge, dense, plan, scenario_of, tip_path_length
from benchmarks.planners import COLUMNS, OURS, tasks_of
from benchmarks.sampling_planners import FINEST, PLANNERS, RESOLUTION, plan_until_certified
from benchmarks.sampling_planners import SamplingPlanner as Planner
from pips_drake.serpentine.arm import load_arm

GOOD = {"total_s": 1.0, "tip_path_m": 8.0, "clearance_mm": 90.0, "largest_angle_deg": 25.0}


class Scripted:
    """A planner that finds what it is told to find, and keeps at which resolutions it was asked."""

    def __init__(self, *motions):
        self.motions, self.asked = list(motions), []

    def solve(self, resolution, seconds):
        assert seconds > 0.0
        self.asked.append(resolution)
        return self.motions.pop(0)


def run(planner, seed, **other):
    return {"goal": "behind", "planner": planner, "seed": seed, "certified": False} | other


def test_resolution_is_halved_until_a_motion_is_certified():
    motions = np.zeros((2, 1)), np.ones((3, 1))
    planner = Scripted(*motions)
    found = plan_until_certified(
        planner, lambda motion: {"certified": len(motion) == 3, "rows": len(motion)}, seconds=9.0
    )
    assert planner.asked == [RESOLUTION, RESOLUTION / 2]
    assert found["certified"] and found["rows"] == 3
    assert found["motions"] == 2 and found["resolution"] == RESOLUTION / 2
    assert found["planning_s"] >= 0.0 and found["certifying_s"] >= 0.0


@pytest.mark.parametrize("motions", [[None], [np.zeros((2, 1)), None]])
def test_no_motion_in_the_time_is_no_success(motions):
    planner = Scripted(*motions)
    found = plan_until_certified(planner, lambda motion: {"certified": False}, seconds=9.0)
    assert not found["certified"]
    assert found["motions"] == len(motions) - 1 and not planner.motions


def test_resolutions_end_somewhere():
    planner = Scripted(*[np.zeros((2, 1))] * 9)
    plan_until_certified(planner, lambda motion: {"certified": False}, seconds=9.0)
    assert planner.asked[-1] == FINEST and len(planner.asked) == 5


def test_the_tips_way_is_that_of_its_feed_and_of_an_arc():
    arm = load_arm("cmu_92")
    fed = np.repeat(arm.joint_home[None], 2, axis=0)
    fed[1, 0] += 1.5
    assert tip_path_length(arm, fed) == pytest.approx(1.5, abs=1e-9)
    # The first hinge swings all that lies before it: 20 links of 18 in.
    swung = np.repeat(arm.joint_home[None], 2, axis=0)
    swung[1, 1] = 0.6
    # A chord of 0.01 rad is 4e-6 shorter than its arc.
    assert tip_path_length(arm, swung) == pytest.approx(0.6 * 20 * 0.4572, rel=1e-5)
    rows = dense(swung, 0.25)
    np.testing.assert_allclose(rows[:, 1], [0.0, 0.2, 0.4, 0.6], rtol=0, atol=1e-15)


def test_planners_take_turns_and_every_seed_has_all_of_them():
    tasks = tasks_of(["front", "behind"], 2, 30.0)
    assert [task["planner"] for task in tasks[:3]] == [OURS, *PLANNERS]
    assert len({(task["goal"], task["planner"], task["seed"]) for task in tasks}) == 12


def test_runs_that_a_file_has_are_not_made_again(tmp_path, monkeypatch, capsys):
    made = []

    def run_process(task):
        made.append((task["planner"], task["seed"]))
        known = {key: task[key] for key in ("goal", "planner", "seed")}
        return known | {"certified": True, "points": [[0.0]], "last": [0.0]} | GOOD

    monkeypatch.setattr(planners, "run_process", run_process)
    file = tmp_path / "runs.jsonl"
    have = [run(OURS, 0, certified=True, **GOOD), run(PLANNERS[0], 0, total_s=60.0)]
    file.write_text("".join(json.dumps(one) + "\n" for one in have))
    listed = tmp_path / "runs.csv"
    arguments = ["--seeds", "1", "--goals", "behind", "--file", str(file), "--csv", str(listed)]
    monkeypatch.setattr(sys, "argv", ["planners", *arguments])
    assert planners.main() == 0
    # The first prepares, and does not count.
    assert made == [(OURS, 0), (PLANNERS[1], 0)]
    kept = [json.loads(line) for line in file.read_text().splitlines()]
    assert [one["planner"] for one in kept] == [OURS, *PLANNERS]
    assert all("points" not in one for one in kept)
    rows = listed.read_text().splitlines()
    assert rows[0] == ",".join(COLUMNS) and len(rows) == 4
    assert "| behind | RRTConnect | 0 of 1 |  |" in capsys.readouterr().out


def test_failures_and_errors_are_told():
    told = planners_report.sentence
    assert told(run("BITstar", 4, total_s=60.1, motions=0)) == (
        "behind, BITstar, seed 4: no certified motion in 60.1 s (0 tried)"
    )
    assert "seed 1: error: KeyError: 'x'" in told(run(OURS, 1, error="Traceback\nKeyError: 'x'"))
    table = planners_report.table([run(OURS, k, certified=k > 0, **GOOD) for k in range(3)])
    assert "| behind | ours | 2 of 3 | 1 (1 .. 1) |" in table


@pytest.mark.slow
def test_our_motion_is_certified_and_a_straight_one_is_not():
    scenario = scenario_of("behind")
    found = plan(scenario)
    judge = Judge(scenario, found.points)
    verdict = judge.verdict(found.plan.joints)
    assert verdict["certified"]
    assert 25.0 < verdict["clearance_mm"] < 203.0, "of a gap of 486 mm, less an arm 80 mm thick"
    # The path of the tip: from home on, the planner's own.
    length = np.linalg.norm(np.diff(found.points[1:], axis=0), axis=1).sum()
    assert verdict["tip_path_m"] == pytest.approx(length, rel=2e-3)
    assert not any(judge.collides(posture) for posture in found.plan.joints[::100])
    assert all(judge.free(posture) for posture in found.plan.joints[::100])
    straight = found.plan.joints[[0, -1]]
    assert not judge.verdict(straight)["certified"]
    hits = [judge.collides(posture) for posture in dense(straight, 0.1)]
    free = [judge.free(posture) for posture in dense(straight, 0.1)]
    assert any(hits) and any(free)
    assert not any(a and b for a, b in zip(hits, free, strict=True))
    assert judge.queries == len(free) + len(found.plan.joints[::100])


@pytest.mark.slow
@pytest.mark.parametrize("name", PLANNERS)
def test_ompl_finds_a_way_around_a_column(name):
    pytest.importorskip("ompl")

    def free(q):
        return bool(np.hypot(q[0], q[1]) > 0.4)

    ends = np.array([-0.8, 0.05, 0.0]), np.array([0.8, 0.0, 0.5])
    planner = Planner(name, free, np.full(3, -1.0), np.full(3, 1.0), *ends, seed=3)
    motion = planner.solve(0.02, 20.0)
    np.testing.assert_allclose(motion[[0, -1]], ends, rtol=0, atol=1e-12)
    for first, last in pairwise(motion):
        # Between two states that are free, 0.02 apart, a chord of the column is 0.1 mm deep.
        middle = first + np.linspace(0.0, 1.0, 200)[:, None] * (last - first)
        assert np.hypot(middle[:, 0], middle[:, 1]).min() > 0.4 - 2e-4
    walled = Planner(
        name, lambda q: abs(q[0]) > 0.2, *[np.full(3, x) for x in (-1, 1)], *ends, seed=3
    )
    assert walled.solve(0.02, 0.5) is None
