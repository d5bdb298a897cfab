"""`pips plan`: what is written of a scenario, and what is said where there is no way."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pips_drake import scenarios
from pips_drake.errors import InputError
from pips_drake.planning.runs.goal import overload
from pips_drake.planning.runs.motion import plan_motion
from pips_drake.planning.runs.workspace import load_workspace
from pips_drake.planning.scenario import goal_point
from pips_drake.scenarios import load_scenario
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.joint_motion_file import read_joint_motion
from pips_drake.twin.certificate.verify import verify_proof


def prepared(name, **changes):
    """A shipped scenario without its proof, loaded, and its workspace."""
    loaded = load_scenario(name, {"certificate.enabled": "false"} | changes)
    return loaded.config, load_workspace(loaded.config, folder=loaded.folder)


def test_no_way_is_told_with_what_is_in_it_and_the_folder_shows_it(tmp_path):
    out = tmp_path / "blocked"
    verdict = scenarios.plan(load_scenario("blocked_goal"), out=out)
    assert not verdict.passed and len(verdict.failures) == 1
    assert "no way to the goal" in verdict.failures[0]
    assert "in the way: placed_obstacles::curtain" in verdict.failures[0]
    summary = json.loads((out / "summary.json").read_text())
    assert summary["verdict"] == "fail" and summary["failures"] == list(verdict.failures)
    # The picture shows the workspace; there is nothing to run.
    assert (out / "figures" / "views.png").is_file()
    assert not (out / "simulate.yaml").exists()
    # Simulating it says the same.
    again = scenarios.simulate(load_scenario("blocked_goal"), out=tmp_path / "simulated")
    assert again.failures == verdict.failures


@pytest.mark.parametrize(
    ("goal", "words"),
    [
        ([9.5, 180.0, 1.5], "must be 0.12 m or more from it|outside the workspace"),
        ([9.5, 180.0, 9.0], "outside the workspace"),
    ],
    ids=["inside the payload", "outside the bay"],
)
def test_goals_that_cannot_be_are_refused_and_nothing_is_written(tmp_path, goal, words):
    loaded = load_scenario("blocked_goal")
    loaded.config.goals[0].unfolded = goal
    with pytest.raises(InputError, match=words):
        scenarios.plan(loaded, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_goal_beyond_the_arm_s_reach_says_what_it_needs_and_what_there_is():
    config, workspace = prepared("reach_behind_payload", alternatives="1")
    config.goals[0].unfolded = [13.5, 180.0, 2.034]
    found = plan_motion(config, workspace)
    assert not found.plans
    assert "m of arm beyond home" in found.failures[0] and "cmu_92" in found.failures[0]


@pytest.fixture(scope="module")
def behind():
    config, workspace = prepared("reach_behind_payload")
    return config, workspace, plan_motion(config, workspace)


@pytest.mark.slow
def test_the_way_that_is_taken_is_the_shortest_that_drives_can_hold(behind):
    config, workspace, found = behind
    assert not found.failures and found.chosen == 0 and not found.notes
    lengths = [one.length for one in found.alternatives]
    assert len(lengths) == 3 and lengths == sorted(lengths)
    assert overload(config, workspace, found.plans[0]) == []
    # Whoever insists gets another, which is another.
    config, workspace = prepared("reach_behind_payload", choose="2")
    second = plan_motion(config, workspace)
    assert second.chosen == 1
    assert second.plans[0].path.travel > found.plans[0].path.travel
    # The arm is too short for the eighth.
    config, workspace = prepared("reach_behind_payload", alternatives="8", choose="8")
    assert "m of arm beyond home" in plan_motion(config, workspace).failures[0]


@pytest.mark.slow
def test_where_no_drive_is_strong_enough_the_shortest_way_comes_back_with_that():
    config, workspace = prepared("reach_behind_payload", alternatives="2")
    config.checks.force_fraction_max = 0.05
    found = plan_motion(config, workspace)
    assert found.chosen == 0 and len(found.alternatives) == 2
    assert "% of its effort limit" in found.failures[-1] and "must be <= 5 %" in found.failures[-1]


@pytest.mark.slow
def test_the_tip_stands_on_its_goal(behind):
    config, workspace, found = behind
    made = found.plans[0]
    tip = kinematics.spine_points(workspace.arm, made.plan.joints[-1])[0, -1] + made.shift
    assert_allclose(tip, goal_point(config, config.goals[0]), rtol=0, atol=1e-9)


@pytest.mark.slow
def test_the_last_link_looks_along_the_wanted_direction_or_how_far_off_it_is_is_said():
    config, workspace = prepared("reach_behind_payload", alternatives="1")
    config.goals[0].looks_along = [0.0, 1.0, 0.0]
    found = plan_motion(config, workspace)
    assert not found.failures
    made = found.plans[0]
    spine = kinematics.spine_points(workspace.arm, made.plan.joints[-1])[0]
    link = (spine[-1] - spine[-2]) / np.linalg.norm(spine[-1] - spine[-2])
    assert math.degrees(math.acos(min(link[1], 1.0))) < 1.0
    # Straight at the payload's axis: the gap is hardly wider than a link is long.
    config.goals[0].looks_along = [0.985, -0.174, 0.0]
    found = plan_motion(config, workspace)
    assert any("deg off; must be 10 deg or less" in said for said in found.failures)


@pytest.fixture(scope="module")
def tour_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tour") / "out"
    return scenarios.plan(load_scenario("two_goals_retract"), out=folder), folder


@pytest.mark.slow
def test_a_tour_s_folder_has_its_joints_its_paths_its_proof_and_its_pictures(tour_folder):
    verdict, folder = tour_folder
    assert verdict.passed, verdict.failures
    for name in (
        "summary.json",
        "scenario.yaml",
        "simulate.yaml",
        "joints.npz",
        "path_1.csv",
        "path_2.csv",
        "proof_commanded.npz",
        "replay.html",
        "figures/views.png",
        "figures/clearance.png",
    ):
        assert (folder / name).is_file(), name
    assert verify_proof(folder / "proof_commanded.npz").proved
    config, workspace = prepared("two_goals_retract")
    motion = read_joint_motion(folder / "joints.npz", workspace.arm)
    shift = (
        workspace.home_tip - kinematics.spine_points(workspace.arm, workspace.arm.joint_home)[0, -1]
    )
    tips = kinematics.spine_points(workspace.arm, motion.joints)[:, -1] + shift
    for goal in config.goals:
        apart = np.linalg.norm(tips - goal_point(config, goal), axis=1).min()
        assert apart < 1e-9, goal.name
    # Home again in the end, as the scenario's motion says.
    assert_allclose(tips[-1], workspace.home_tip, rtol=0, atol=1e-9)
    # It was drawn back between the goals.
    assert verdict.summary["legs"][1]["drawn_back_to_m"] < 1.0


@pytest.mark.slow
def test_what_was_planned_is_simulated(tour_folder, tmp_path):
    _, folder = tour_folder
    loaded = load_scenario(str(folder / "simulate.yaml"), {"duration_s": "4"})
    verdict = scenarios.simulate(loaded, out=tmp_path / "run")
    assert verdict.passed, verdict.failures


@pytest.mark.slow
def test_a_scenario_with_goals_is_planned_and_simulated_in_one(tmp_path):
    loaded = load_scenario("reach_behind_payload", {"duration_s": "4", "alternatives": "1"})
    loaded.config.goals[0].unfolded = [8.5, 120.0, 2.034]
    verdict = scenarios.simulate(loaded, out=tmp_path / "run")
    assert verdict.passed, verdict.failures
    assert (tmp_path / "run" / "replay.html").is_file()


@pytest.mark.slow
def test_an_obstacle_placed_in_a_scenario_is_in_the_plan_s_own_scene(tmp_path):
    loaded = load_scenario("blocked_goal", {"certificate.enabled": "false"})
    obstacle = loaded.config.obstacles[0]
    obstacle.size_m, obstacle.position_m = [0.3, 0.3], [0.3, 0.3, 8.0]
    loaded.config.goals[0].unfolded = [8.5, 120.0, 2.034]
    out = tmp_path / "out"
    verdict = scenarios.plan(loaded, out=out)
    assert verdict.passed, verdict.failures
    assert "curtain" in (out / "obstacles.sdf").read_text()
    # The plant that is run has it too: thus it is among the shapes that the check looked at.
    assert any("curtain" in str(shape) for shape in verdict.summary["scene_shapes"])
