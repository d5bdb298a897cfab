"""From a goal to postures: the arm reaches it, follows its path, and touches nothing on the way."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.geometry import Cylinder
from pydrake.math import RigidTransform

from pips_drake.errors import InputError
from pips_drake.planning.grid_search import NoPathError
from pips_drake.planning.planner import PlannerSettings, choose_route, plan_along, plan_to_goal
from pips_drake.scene.signed_distance import PlacedShape
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.runs.placed_arm import place_arm
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import load_setup

from .bay import AXIS_X, HOME, bay_occupancy, in_the_gap


@pytest.fixture(scope="module")
def occupancy():
    return bay_occupancy()


@pytest.fixture(scope="module")
def arm():
    return load_arm("cmu_92")


@pytest.fixture(scope="module")
def beside(arm, occupancy):
    return plan_to_goal(arm, occupancy, in_the_gap(90.0, 7.5), home_tip=HOME)


def test_the_tip_reaches_its_goal_from_home_and_every_link_follows(beside, arm):
    assert beside.settled.stable
    assert beside.plan.followable, beside.plan.failures
    assert_allclose(beside.points[1], HOME, rtol=0, atol=1e-12)
    assert_allclose(beside.points[-1], in_the_gap(90.0, 7.5), rtol=0, atol=1e-12)
    shift = kinematics.spine_points(arm, arm.joint_home)[0, -1] - HOME
    tip = kinematics.spine_points(arm, beside.plan.joints)[-1, -1]
    assert_allclose(tip - shift, beside.points[-1], rtol=0, atol=1e-9)
    # The sharpest bend of the snake, over that of links at 45 deg a joint (FTL's own limit).
    turns = np.linalg.norm(np.diff(beside.settled.snake.points, n=2, axis=0), axis=-1)
    spacing = beside.settled.snake.spacings.mean()
    sharpest = turns.max() / spacing**2
    allowed = 2.0 * math.sin(math.radians(22.5)) / 0.4572
    # Second differences also hold what spacing changes: a tenth.
    assert beside.curvature_excess == pytest.approx(sharpest / allowed, rel=0.1)
    assert beside.curvature_excess < 1.0


def test_the_snake_is_clearer_than_the_string_it_was_laid_on(beside, occupancy):
    inside = beside.pulled[1:-1]
    string = occupancy.field.distances(inside).min()
    snake = beside.settled.snake.points
    # Those at the port and at the goal are where they are told to be.
    clear = occupancy.field.distances(snake[8:-3]).min()
    assert string < 0.13 < 0.16 < clear


def test_drake_finds_no_collision_along_the_plan(beside, tmp_path):
    file = tmp_path / "planned.csv"
    np.savetxt(file, beside.points, delimiter=",", header="x_m,y_m,z_m", comments="")
    scenario = SerpentineScenario(
        arm="cmu_92", path=str(file), scene="cargo_bay", mounting="laboratory"
    )
    placed = place_arm(scenario, load_setup(scenario))
    postures = beside.plan.joints[:: max(1, len(beside.plan.joints) // 60)]
    assert len(postures) >= 60
    assert not any(query.HasCollisions() for query in placed.posed(postures))


def test_an_arm_that_is_too_short_is_told_where(occupancy):
    found = plan_to_goal(load_arm("prototype"), occupancy, in_the_gap(90.0, 7.5))
    assert not found.plan.followable
    assert "joint d1 leaves its limits" in found.plan.failures[0]


@pytest.mark.parametrize(
    ("goal", "words"),
    [
        (in_the_gap(0.0, 0.9) - [0.9, 0.0, 0.0], "outside the workspace|must be 0.12 m or more"),
        ([math.nan, 0.0, 0.0], "must be three finite numbers"),
        ([50.0, 0.0, 0.0], "outside the workspace"),
    ],
)
def test_goals_that_cannot_be_are_refused(arm, occupancy, goal, words):
    with pytest.raises(InputError, match=words):
        plan_to_goal(arm, occupancy, goal, home_tip=HOME)


def test_a_goal_that_is_walled_off_names_the_wall(arm, occupancy):
    disc = PlacedShape("wall", "", Cylinder(2.4, 0.04), RigidTransform([AXIS_X, 0.0, 9.7]))
    walled = occupancy.updated(occupancy.field.with_shapes([disc]))
    with pytest.raises(NoPathError, match="in the way: wall"):
        plan_to_goal(arm, walled, in_the_gap(180.0, 7.0), home_tip=HOME)


def test_leads_and_homes_that_mean_nothing_are_refused(arm, occupancy):
    with pytest.raises(InputError, match=r"planner lead = 0\.0 m; must be > 0"):
        PlannerSettings(lead=0.0)
    with pytest.raises(InputError, match="must be three finite numbers"):
        plan_to_goal(arm, occupancy, in_the_gap(90.0, 7.5), home_tip=[math.nan, 0.0, 0.0])
    # Neither arm can begin beside its base line.
    for name in ("cmu_92", "prototype"):
        with pytest.raises(InputError, match=r"base line|home tip"):
            plan_to_goal(
                load_arm(name), occupancy, in_the_gap(90.0, 7.5), home_tip=[0.5, 0.0, 4.4425]
            )


def test_a_given_route_is_laid_and_goes_through_its_nails(arm, occupancy):
    goal, nail = in_the_gap(25.0, 3.5), in_the_gap(12.0, 1.8)
    tip = np.array(HOME)
    route = np.stack([tip + np.array([0.0, 0.0, 0.5]), goal])
    made = plan_along(arm, occupancy.field, route, home_tip=HOME, nails=[nail])
    assert made.found is None
    assert made.plan.followable, made.plan.failures
    # Nails are points of it; corners are rounded to within millimetres of their points.
    assert np.abs(made.settled.snake.points - nail).max(axis=1).min() == 0.0
    gap, _ = made.path.nearest(nail[None], 0.0, made.path.length)
    assert gap[0] < 5e-3
    assert_allclose(made.path.point(made.path.length), goal, rtol=0, atol=1e-12)
    # The postures' own frame stands where the rail was placed.
    assert_allclose(made.plan.path.point(0.0) + made.shift, made.path.point(0.0), atol=1e-12)


def test_the_path_leaves_home_straight_and_arrives_along_a_wanted_direction(arm, occupancy):
    goal = in_the_gap(25.0, 3.5)
    route = np.stack([np.array(HOME) + np.array([0.0, 0.0, 0.5]), goal])
    wanted = np.array([0.0, 0.0, 1.0])
    angles = []
    for direction in (None, wanted):
        made = plan_along(arm, occupancy.field, route, home_tip=HOME, end_direction=direction)
        begin = made.path.tangent(made.path.home_arc_length + 0.05)
        assert begin @ wanted > math.cos(math.radians(5.0))
        angles.append(math.acos(made.path.tangent(made.path.length) @ wanted))
    assert angles[1] < 0.5 * angles[0]


def test_routes_are_chosen_through_what_is_to_be_passed(arm, occupancy):
    goal, nail = in_the_gap(25.0, 3.5), in_the_gap(-20.0, 2.0)
    found, pulled = choose_route(arm, occupancy, goal, home_tip=HOME, nails=[nail])
    straight, _ = choose_route(arm, occupancy, goal, home_tip=HOME)
    assert found.length > straight.length + 0.3
    for points in (found.points, pulled):
        assert np.abs(points - nail).max(axis=1).min() == 0.0
        assert_allclose(points[-1], goal, rtol=0, atol=0)
    with pytest.raises(InputError, match=r"nail \(.*outside the workspace"):
        choose_route(arm, occupancy, goal, home_tip=HOME, nails=[[9.0, 9.0, 9.0]])
    with pytest.raises(InputError, match="route of shape"):
        plan_along(arm, occupancy.field, [[0.0, 1.0]], home_tip=HOME)
