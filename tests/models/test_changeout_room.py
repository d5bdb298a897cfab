"""The payload changeout room: platforms around an upright payload, passable, but not straight."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pips_drake.planning.grid import Grid
from pips_drake.planning.occupancy import Occupancy
from pips_drake.planning.planner import plan_to_goal
from pips_drake.scene.packages import find_scene_file
from pips_drake.scene.signed_distance import read_distance_field
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.anchoring import anchor_path
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.runs.placed_arm import place_arm
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import load_setup
from pips_drake.serpentine.tip_path import blended_path
from pips_drake.twin.model_viewer import view_model

#: Of the payload's axis and the floor in frame {0}, m, and what the READMEs say.
AXIS = np.array([2.25, 0.0, 0.0])
FLOOR, RADIUS = -5.4, 5.0 * 0.3048
LEVELS = (2.7, 5.4, 8.1, 10.8, 13.5)
#: The prototype's home tip; CMU-92's arm is set up there too.
HOME = np.array([0.412877, 0.0, 4.4425])
#: Where pictures are taken from: angle around the payload (deg), height (m), all 0.43 m before it.
VIEWPOINTS = ((180.0, 7.0), (130.0, 9.6), (115.0, 9.8))
STANDOFF = 0.43


@pytest.fixture(scope="module")
def field():
    return read_distance_field(find_scene_file("changeout_room"))


@pytest.fixture(scope="module")
def occupancy(field):
    """Around levels 4 and 5; cells of 80 mm."""
    lower, upper = np.array([-1.0, -3.3, 4.2]), np.array([5.0, 3.3, 11.0])
    return Occupancy.of(field, Grid(lower=lower, upper=upper, shape=(75, 82, 85)), 0.12)


def around(degrees, out, height):
    degrees, out, height = np.broadcast_arrays(degrees, out, height)
    angle = np.radians(degrees)
    return AXIS + np.stack([out * np.cos(angle), out * np.sin(angle), height], axis=-1)


def test_payload_is_10_by_40_feet_and_upright(field):
    bare = field.without_body("room::room").without_body("platforms::platforms")
    shell = around(np.arange(0.0, 360.0, 7.0), RADIUS, FLOOR + 8.0)
    # SDF poses have 9 digits.
    np.testing.assert_allclose(bare.distances(shell), 0.0, atol=1e-8)
    for height in (10.6 - 20.0 * 0.3048, 10.6 + 20.0 * 0.3048):
        assert bare.distances(around([0.0], 0.5, FLOOR + height))[0] == pytest.approx(0.0, abs=1e-8)


@pytest.mark.parametrize("level", range(5))
def test_decks_are_at_their_levels_on_both_sides(field, level):
    """A point 0.2 m above a deck is 0.2 m from it, left and right, before the columns."""
    for side in (1.0, -1.0):
        above = AXIS + np.array([0.3, side * 3.5, FLOOR + LEVELS[level] + 0.2])
        nearest = field.nearest(above[None])
        assert nearest.distances[0] == pytest.approx(0.2, abs=1e-8)
        name = field.shapes[nearest.indices[0]].name
        assert name.startswith(f"level_{level + 1}_{'left' if side > 0.0 else 'right'}")


def test_level_4_is_open_before_the_payload_and_level_5_is_not(field):
    """Straight up before the payload there is room through level 4 alone; the left is open in 5."""
    middle = 0.5 * (RADIUS + 2.15)
    four, five = FLOOR + LEVELS[3] - 0.05, FLOOR + LEVELS[4] - 0.05
    out = np.linspace(RADIUS + 1e-3, 3.3, 400)
    assert field.distances(around(180.0, [middle], four))[0] > 0.3
    # Nowhere on its decks is as much as a decimetre wide.
    assert field.distances(around(180.0, out, five)).max() < 0.05
    assert field.distances(around(-90.0, out, five)).max() < 0.06
    assert field.distances(around(100.0, [middle], five))[0] > 0.25


@pytest.mark.parametrize(("name", "width"), [("prototype", 0.2286), ("cmu_92", 0.1524)])
def test_arms_at_home_stand_clear_of_everything(field, name, width):
    """Their spines, with the widest boxes, whose far corners stand three quarters of the width off
    them either way; the feed of CMU-92's arm stands above the floor."""
    arm = load_arm(name)
    spine = kinematics.spine_points(arm, arm.joint_home)[0]
    spine = spine + (HOME - spine[-1])
    dense = np.linspace(spine[0], spine[-1], 300)
    assert field.distances(dense).min() > 0.75 * math.sqrt(2.0) * width + 0.05
    # The rail begins in the arm's own origin.
    rail = -(kinematics.spine_points(arm, arm.joint_home)[0, -1] - HOME)[2]
    assert rail > FLOOR


@pytest.mark.parametrize(("degrees", "height"), VIEWPOINTS)
def test_arm_of_twenty_links_reaches_where_pictures_are_taken(occupancy, degrees, height):
    goal = around(degrees, RADIUS + STANDOFF, height)
    found = plan_to_goal(load_arm("cmu_92"), occupancy, goal, home_tip=HOME)
    assert found.settled.stable
    assert found.plan.followable, found.plan.failures
    assert occupancy.field.distances(found.points[1:]).min() > 0.17
    if height > FLOOR + LEVELS[4]:
        # Not straight up: past the side of level 5.
        crossing = found.points[np.argmin(np.abs(found.points[:, 2] - (FLOOR + LEVELS[4])))]
        bearing = math.degrees(math.atan2(crossing[1], crossing[0] - AXIS[0]))
        assert 60.0 < bearing < 145.0


def test_prototype_reaches_the_payload_above_level_4(field):
    lower, upper = np.array([-1.0, -3.3, 4.2]), np.array([5.0, 3.3, 8.0])
    occupancy = Occupancy.of(field, Grid(lower=lower, upper=upper, shape=(75, 82, 47)), 0.18)
    goal = around(160.0, RADIUS + STANDOFF, 6.2)
    found = plan_to_goal(load_arm("prototype"), occupancy, goal)
    assert found.plan.followable, found.plan.failures


@pytest.mark.slow
def test_drake_finds_no_collision_on_the_way_up(occupancy, tmp_path):
    goal = around(130.0, RADIUS + STANDOFF, 9.6)
    arm = load_arm("cmu_92")
    found = plan_to_goal(arm, occupancy, goal, home_tip=HOME)
    file = tmp_path / "planned.csv"
    np.savetxt(file, found.points, delimiter=",", header="x_m,y_m,z_m", comments="")
    scenario = SerpentineScenario(
        arm="cmu_92", path=str(file), scene="changeout_room", mounting="laboratory"
    )
    placed = place_arm(scenario, load_setup(scenario))
    postures = found.plan.joints[:: max(1, len(found.plan.joints) // 60)]
    assert len(postures) >= 60
    assert not any(query.HasCollisions() for query in placed.posed(postures))
    # The rail goes with the path.
    _, shift = anchor_path(arm, blended_path(found.points, "planned"))
    assert shift == pytest.approx(HOME[2] - (24.9 + 20 * 18.0) * 0.0254, abs=1e-9)


def test_scene_can_be_viewed():
    view_model("changeout_room", once=True)
