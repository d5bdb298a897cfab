"""The benchmarks run, and what they compare gives the same answers. No time is judged."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.measuring import Line, measure_in_turn
from benchmarks.report import BEGIN, END, markdown, put_into

ROOT = Path(__file__).resolve().parents[1]
#: Measurements that nothing stands beside.
ALONE = (
    "a_star_to_rest",
    "goal_moved",
    "goal_to_certified",
    "files_to_certified",
    "teleoperation_tick",
)


def _line(**other: object) -> Line:
    given = {"name": "n", "what": "w", "ours": np.array([2.0, 4.0, 3.0]), "unit": "s"}
    return Line(**(given | {"limits": "l", "peer": np.array([8.0, 8.0, 30.0])} | other))


def test_all_take_turns_and_the_warm_up_does_not_count():
    calls: list[str] = []

    def work(name: str) -> float:
        calls.append(name)
        return 1.0

    work_of = {name: (lambda name=name: work(name)) for name in "abc"}
    seconds = measure_in_turn(work_of, rounds=2, warm_up=1)
    assert "".join(calls) == "cba" + "abc" + "cba"
    assert {name: times.shape for name, times in seconds.items()} == dict.fromkeys("abc", (2,))


def test_seconds_are_those_of_one_item():
    clock = iter([0.0, 8.0])  # one call, from 0 to 8 s
    seconds = measure_in_turn({"a": lambda: 4.0}, rounds=1, warm_up=0, clock=lambda: next(clock))
    assert seconds["a"] == [2.0]


def test_a_ratio_is_the_median_of_the_rounds_own():
    assert _line().ratio == 4.0, "of 8/2, 8/4 and 30/3; that of the medians would be 8/3"
    assert _line(more_is_better=True).ratio == 0.25
    assert _line(peer=np.empty(0)).ratio is None


def test_each_aim_is_judged_by_the_medians():
    assert _line().aims == {}
    assert _line(ratio_aim=4.0).aims == {"4 times": True}
    assert _line(ratio_aim=4.1).aims == {"4.1 times": False}
    assert _line(value_aim=3.0).aims == {"3 s": True}
    assert _line(ratio_aim=4.0, value_aim=2.9).aims == {"2.9 s": False, "4 times": True}


def test_a_missed_aim_is_printed_as_missed():
    machine = dict.fromkeys(["date", "processor", "cores", "system", "python"], "x")
    assert "| **no** |" in markdown([_line(ratio_aim=5.0)], machine)
    assert "| yes |" in markdown([_line(ratio_aim=3.0)], machine)


def test_prose_around_the_marks_is_kept():
    document = f"before\n{BEGIN}\nold\n{END}\nafter\n"
    once = put_into(document, "new table\n")
    assert once.startswith("before\n") and once.endswith("\nafter\n")
    assert "new table" in once and "old" not in once
    assert put_into(once, "new table\n") == once
    with pytest.raises(ValueError, match="measured: end"):
        put_into(f"{END} before {BEGIN}", "table")


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    """One run of everything at its smallest: the JSON by name, table and figure."""
    folder = tmp_path_factory.mktemp("benchmarks")
    (folder / "page.md").write_text(f"# Page\n{BEGIN}\n{END}\nend\n")
    files = ["--json", "rounds.json", "--markdown", "page.md", "--figure", "ratios.png"]
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks", "--quick"]
        + [str(folder / word) if "." in word else word for word in files],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=500,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout, folder


@pytest.fixture(scope="module")
def measured(quick):
    content = json.loads((quick[1] / "rounds.json").read_text())
    return {line["name"]: line for line in content["lines"]}


@pytest.mark.slow
@pytest.mark.timeout(520)  # a full run of every benchmark, on a machine that does other things too
def test_everything_is_measured_and_printed(quick, measured):
    out, folder = quick
    assert list(measured) == [
        "ftl_drake",
        "ftl_pinocchio",
        "twin_clearance",
        "twin_without",
        "collision_one",
        "collision_all",
        "clearance",
        "search",
        "search_in_vain",
        "snake_dense",
        "snake_sparse",
        "a_star_to_rest",
        "goal_moved",
        "goal_to_certified",
        "files_to_certified",
        "teleoperation_tick",
        "collision_program_frame",
        "docking_task",
        "cable_tensions_clarabel",
        "cable_tensions_quadprog",
        "cable_workspace",
        "help_drake",
        "help_nothing",
    ]
    page = (folder / "page.md").read_text()
    assert page.startswith("# Page\n") and page.endswith("\nend\n")
    assert out.strip() in page
    for line in measured.values():
        rounds = np.array(line["ours"]), np.array(line["peer"])
        assert rounds[0].size >= 2 and np.all(rounds[0] > 0.0)
        assert f"| {line['what']} |" in out
        if not line["beside"]:
            assert line["ratio"] is None and line["name"] in ALONE
            continue
        assert rounds[1].size == rounds[0].size and np.all(rounds[1] > 0.0)
        assert math.isfinite(line["ratio"]) and f"| {line['beside']} |" in out
    picture = (folder / "ratios.png").read_bytes()
    assert picture[:8] == b"\x89PNG\r\n\x1a\n"
    assert int.from_bytes(picture[16:20], "big") == 1500, "10 in wide at 150 dots an inch"


@pytest.mark.slow
def test_machine_and_versions_are_named(quick):
    machine = json.loads((quick[1] / "rounds.json").read_text())["machine"]
    for name in ("date", "processor", "cores", "system"):
        assert machine[name]
    for name in ("python", "drake", "numpy", "numba", "pin", "mujoco", "scikit-image"):
        assert machine[name][0].isdigit(), name
        assert f"{name} {machine[name]}" in quick[0]


@pytest.mark.slow
def test_the_peers_solved_the_same_joints(measured):
    # Their spine errors of 1e-11 m and 2.5e-11 m are turned into angles by modules of 0.3 m and
    # more, and passed on from base to tip through seven of them.
    for name in ("ftl_drake", "ftl_pinocchio"):
        agreement = measured[name]["agreement"]
        assert agreement["points"] >= 10
        assert agreement["joints apart at most (m, rad)"] < 1e-8
        assert agreement["spine error at most (m)"] < 1e-9


@pytest.mark.slow
def test_twin_and_bare_plant_make_the_same_motion(measured):
    # Three control periods and two plant steps at 25 mm/s are 1.3 mm.
    assert measured["twin_clearance"]["agreement"]["tips apart at most (m)"] < 1.3e-3
    parts = measured["twin_clearance"]["parts"]
    assert {"plant", "ClearanceMonitor", "ActuatorServo"} <= set(parts)
    assert parts["ClearanceMonitor"] > 0.0
    python = sum(ms for name, ms in parts.items() if name[0].isupper())
    assert 0.0 < python < sum(parts.values()), "callbacks are a part of the run that they are in"


@pytest.mark.slow
def test_checkers_agree_on_every_posture(measured):
    agreement = measured["collision_one"]["agreement"]
    assert agreement["postures that differ"] == 0
    assert 0 < agreement["colliding"] < 200, "both verdicts occur"
    clearance = measured["clearance"]["agreement"]
    # The engine is the same; poses are computed in another order of the same bodies.
    assert clearance["least distances apart at most (m)"] < 1e-9
    assert clearance["nearest (m)"] < 0.1, "far less than the reach, so something was compared"


@pytest.mark.slow
def test_the_search_finds_what_scikit_image_finds(measured):
    assert measured["search"]["agreement"]["costs apart (m)"] < 1e-9


@pytest.mark.slow
def test_the_collision_program_and_drake_see_the_same(measured):
    found = measured["collision_program_frame"]["agreement"]
    assert found["pairs of another sign"] == 0
    # Ours is at most the distance; Drake's iteration ends at about 1e-6 m.
    assert found["more than Drake's distance by at most (m)"] < 1e-5


@pytest.mark.slow
def test_the_docking_task_and_its_bare_plant_make_the_same_motion(measured):
    # A control period at the fastest joint's 2.64 deg/s is 5e-4 rad; twice, for the servo.
    assert measured["docking_task"]["agreement"]["angles apart at most (rad)"] < 1e-3


@pytest.mark.slow
def test_what_is_planned_is_certified(measured):
    found = measured["goal_to_certified"]["agreement"]
    assert found["certified (1: yes)"] == 1.0
    assert found["clearance, proved (mm)"] > 25.0, "what the scenario asks for"
