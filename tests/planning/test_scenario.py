"""Scenarios that state goals: what is refused, and what is run."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pips_drake.config import dump_yaml, load_yaml, validate
from pips_drake.errors import InputError
from pips_drake.planning.origins import OriginRule
from pips_drake.planning.scenario import (
    ORIGINS,
    GoalConfig,
    PlannerScenario,
    ScanConfig,
    WorkspaceConfig,
    goal_point,
    serpentine_scenario,
    with_goal,
)
from pips_drake.scenarios import load_scenario, plan, scenario_descriptions


def unfolded(**changes):
    fields = {"along_m": [0.0, 5.0], "out_m": [1.0, 2.0], "axis_m": [-1.0, 0.5]} | changes
    return WorkspaceConfig(kind="unfolded", **fields)


def make(**changes):
    fields = {"workspace": unfolded(), "goals": [GoalConfig(point_m=[1.0, 0.0, 2.0])]} | changes
    return PlannerScenario(**fields)


BAD = {
    "no goals": (dict(goals=[]), r"goals = \[\]; must be one goal or more, or"),
    "a goal that is nowhere": (dict(goals=[GoalConfig()]), r"goals\[0\].*neither"),
    "a goal in two places": (
        dict(goals=[GoalConfig(point_m=[0.0] * 3, unfolded=[1.0] * 3)]),
        r"goals\[0\].*both; must be one of",
    ),
    "a goal of two numbers": (dict(goals=[GoalConfig(point_m=[0.0] * 2)]), "three numbers"),
    "a goal that is not a number": (
        dict(goals=[GoalConfig(point_m=[np.nan, 0.0, 0.0])]),
        r"goals\[0\]\.point_m\[0\] = nan; must be a finite number",
    ),
    "a view along nothing": (
        dict(goals=[GoalConfig(point_m=[0.0] * 3, looks_along=[0.0] * 3)]),
        "looks_along",
    ),
    "goals of one name": (
        dict(goals=[GoalConfig(name="a", point_m=[0.0] * 3)] * 2),
        "of different names",
    ),
    "no workspace": (dict(workspace=WorkspaceConfig()), r"workspace\.along_m = \[\]"),
    "a box without corners": (dict(workspace=WorkspaceConfig(kind="box")), r"workspace\.lower_m"),
    "a box inside out": (
        dict(workspace=WorkspaceConfig(kind="box", lower_m=[1.0] * 3, upper_m=[0.0] * 3)),
        r"above workspace\.lower_m",
    ),
    "more than a turn": (dict(workspace=unfolded(around_deg=[0.0, 400.0])), "whole turn"),
    "an axis in the way": (dict(workspace=unfolded(out_m=[-1.0, 2.0])), r"workspace\.out_m"),
    "cells of nothing": (dict(workspace=unfolded(cell_mm=0.0)), r"workspace\.cell_mm = 0\.0"),
    "an unknown rule": (dict(origin="shortest"), "least_tip_travel or least_exposed_length"),
    "a path that there is not": (dict(alternatives=2, choose=3), r"choose = 3; must be 0 \.\."),
    "a goal unfolded in a box": (
        dict(
            workspace=WorkspaceConfig(kind="box", lower_m=[0.0] * 3, upper_m=[1.0] * 3),
            goals=[GoalConfig(unfolded=[1.0] * 3)],
        ),
        "box",
    ),
    "an unknown mounting": (dict(mounting="ceiling"), "mounting"),
}


@pytest.mark.parametrize(("changes", "words"), BAD.values(), ids=BAD)
def test_a_scenario_that_means_nothing_is_refused(changes, words):
    with pytest.raises(InputError, match=words):
        validate(make(**changes))


def test_a_scenario_is_read_as_it_was_written(tmp_path):
    scenario = make(
        goals=[GoalConfig(name="there", unfolded=[2.0, 90.0, 1.5], nails_m=[[0.0] * 3])]
    )
    validate(scenario)
    file = tmp_path / "goals.yaml"
    file.write_text(dump_yaml(scenario))
    assert load_yaml(PlannerScenario, file) == scenario


def test_a_goal_is_where_its_unfolded_coordinates_say():
    scenario = make()
    assert goal_point(scenario, GoalConfig(point_m=[1.0, 2.0, 3.0])) == [1.0, 2.0, 3.0]
    # A quarter turn from x0 about the axis at (-1, 0.5), 1.5 m out from it, 2 m along z0.
    point = goal_point(scenario, GoalConfig(unfolded=[2.0, 90.0, 1.5]))
    assert_allclose(point, [-1.0, 2.0, 2.0], rtol=0, atol=1e-15)


def test_what_is_planned_is_run_as_the_scenario_says():
    scenario = make(scene="cargo_bay", mounting="pad")
    scenario.motion.tip_speed_mm_per_s = 40.0
    scenario.checks.clearance_min_mm = 31.0
    run = serpentine_scenario(scenario, path="path.csv")
    validate(run)
    assert (run.arm, run.scene, run.path, run.mounting) == (
        "cmu_92",
        "cargo_bay",
        "path.csv",
        "pad",
    )
    assert run.motion.tip_speed_mm_per_s == 40.0 and run.checks.clearance_min_mm == 31.0


def test_another_goal_stands_for_all_that_a_scenario_wants():
    scenario = make(goals=[GoalConfig(name="a", point_m=[0.0] * 3)])
    changed = with_goal(scenario, (1.0, 2.0, 3.0))
    assert [goal.point_m for goal in changed.goals] == [[1.0, 2.0, 3.0]]
    assert scenario.goals[0].name == "a"
    scanned = make(goals=[], scan=ScanConfig(pattern="helix", radius_m=1.0, along_m=[0.0, 1.0]))
    validate(scanned)
    assert with_goal(scanned, (1.0, 2.0, 3.0)).scan.pattern == ""
    with pytest.raises(InputError, match="must be a finite number"):
        with_goal(scenario, (np.nan, 0.0, 0.0))


def test_the_rules_are_the_planner_s():
    assert list(ORIGINS) == [rule.value for rule in OriginRule]


def test_shipped_scenarios_with_goals_are_loaded_and_described():
    names = scenario_descriptions(goals=True)
    assert "reach_behind_payload" in names and "trajectory_4" not in names
    for name, description in names.items():
        assert description, name
        assert load_scenario(name).machine == "planner"


def test_a_scenario_that_states_its_motion_is_not_planned(tmp_path):
    with pytest.raises(InputError, match=r"trajectory_4: machine = serpentine.*must be planner"):
        plan(load_scenario("trajectory_4"), out=tmp_path / "out")
    assert not (tmp_path / "out").exists()
