"""From a goal to postures: the arm reaches it, follows its path, and touches nothing on the way."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.geometry import Cylinder
from pydrake.math import RigidTransform

from pips_drake.errors import InputError
from pips_drake.planning.grid import Grid
from pips_drake.planning.grid_search import NoPathError
from pips_drake.planning.occupancy import Occupancy
from pips_drake.planning.planner import PlannerSettings, plan_to_goal
from pips_drake.scene.packages import find_scene_file
from pips_drake.scene.signed_distance import PlacedShape, read_distance_field
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.runs.placed_arm import place_arm
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import load_setup

#: Halfway between payload and wall, and where the bay begins, in frame {0} (`cargo_bay.dmd.yaml`).
AXIS_X, MIDDLE, BULKHEAD = -1.621, 2.034, 4.695
HOME = [0.412877, 0.0, 4.4425]


@pytest.fixture(scope="module")
def occupancy():
    """The first half of the bay, unfolded; cells of about a decimetre."""
    grid = Grid(
        lower=np.array([4.4, -math.pi, 1.5]),
        upper=np.array([14.0, math.pi, 2.28]),
        shape=(96, 128, 8),
        unfolded=True,
        origin=np.array([AXIS_X, 0.0, 0.0]),
    )
    return Occupancy.of(read_distance_field(find_scene_file("cargo_bay")), grid, 0.12)


@pytest.fixture(scope="module")
def arm():
    return load_arm("cmu_92")


def in_the_gap(around_deg, along):
    angle = math.radians(around_deg)
    x, y = MIDDLE * math.cos(angle), MIDDLE * math.sin(angle)
    return np.array([AXIS_X + x, y, BULKHEAD + along])


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
