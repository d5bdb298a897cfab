"""From one goal to the next: the least way of the tip, or the least arm exposed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydrake.geometry import Box
from pydrake.math import RigidTransform

from pips_drake.errors import InputError, NotFollowableError
from pips_drake.planning.grid import Grid
from pips_drake.planning.grid_search import NoPathError
from pips_drake.planning.occupancy import Occupancy
from pips_drake.planning.origins import SAME_LENGTH, OriginRule, extend
from pips_drake.planning.retraction import retraction_point
from pips_drake.scene.signed_distance import PlacedShape, SignedDistanceField

from .gap import ARM, bare_gap, dense, taut_length, unfolded_grid

TIP, EXPOSED = OriginRule.LEAST_TIP_TRAVEL, OriginRule.LEAST_EXPOSED_LENGTH
RADIUS = 0.1


def length(points):
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


@pytest.fixture(scope="module")
def room():
    """4 x 3 x 0.6 m with a wall from y = 0 to 2 at x = 2, 0.2 m thick."""
    wall = PlacedShape("wall", "", Box(0.2, 2.0, 2.0), RigidTransform([2.0, 1.0, 0.3]))
    grid = Grid(lower=[0.0, 0.0, 0.0], upper=[4.0, 3.0, 0.6], shape=(80, 60, 12))
    return Occupancy.of(SignedDistanceField.of([wall]), grid, RADIUS)


#: Over the wall and down behind it.
LINE = np.array([[0.3, 0.3, 0.3], [1.5, 2.3, 0.3], [2.5, 2.3, 0.3], [3.2, 0.5, 0.3]])


def test_least_tip_travel_goes_on_from_the_tip(room):
    goal = [3.6, 1.5, 0.3]
    found = extend(room, LINE, goal, rule=TIP)
    assert found.origin == pytest.approx(length(LINE))
    assert found.tip_travel == pytest.approx(math.hypot(0.4, 1.0))  # nothing between
    assert found.exposed_length == pytest.approx(length(LINE) + math.hypot(0.4, 1.0))
    np.testing.assert_array_equal(found.line[[0, -1]], [LINE[0], goal])
    assert length(found.line) == pytest.approx(found.exposed_length)


def test_least_exposed_length_draws_the_arm_back_to_before_the_wall(room):
    """To a goal before the wall that the base sees: the straight line, but for the share."""
    goal = np.array([1.6, 0.4, 0.3])
    found = extend(room, LINE, goal, rule=EXPOSED)
    straight = np.linalg.norm(goal - LINE[0])
    assert straight <= found.exposed_length <= (1.0 + SAME_LENGTH) * straight
    assert 0.0 <= found.origin < 0.3
    assert length(found.line) == pytest.approx(found.exposed_length)
    assert room.field.distances(dense(found.line)).min() >= RADIUS - 1e-5


def test_arm_is_not_drawn_back_where_that_gains_nothing(room):
    """A goal straight ahead of the first part, beyond it: s + d(s) is constant along that part."""
    line = np.array([[0.3, 0.3, 0.3], [1.3, 0.3, 0.3], [1.3, 1.3, 0.3]])
    found = extend(room, line, [1.7, 0.3, 0.3], rule=EXPOSED)
    assert found.origin > 0.95
    assert found.exposed_length <= (1.0 + SAME_LENGTH) * 1.4


def test_each_rule_is_best_at_what_it_keeps_small(room):
    rng = np.random.default_rng(1)
    for _ in range(8):
        goal = rng.uniform([0.2, 0.2, 0.15], [3.8, 2.8, 0.45])
        if room.field.distances([goal])[0] < 1.5 * RADIUS:
            continue
        tip, exposed = (extend(room, LINE, goal, rule=rule) for rule in (TIP, EXPOSED))
        assert tip.tip_travel <= 1.01 * exposed.tip_travel  # pulled strings: 1 %
        assert exposed.exposed_length <= 1.01 * tip.exposed_length
        for found in (tip, exposed):
            assert found.tip_travel == pytest.approx(
                length(LINE) - found.origin + length(found.path)
            )


def test_short_arm_is_drawn_back_though_the_tips_way_was_asked_for(room):
    goal = [1.6, 0.4, 0.3]
    free = extend(room, LINE, goal, rule=TIP)
    assert free.rule is TIP
    short = extend(room, LINE, goal, rule=TIP, arm_length=0.9 * free.exposed_length)
    assert short.rule is EXPOSED
    assert short.exposed_length < 0.5 * free.exposed_length


def test_arm_that_is_too_short_at_all_is_told_what_it_needs(room):
    with pytest.raises(NotFollowableError, match=r"needs 1.304 m of arm .* must be 1.2 m or less"):
        extend(room, LINE, [1.6, 0.4, 0.3], rule=EXPOSED, arm_length=1.2)


def test_what_lies_before_the_workspace_is_kept(room):
    line = np.concatenate([[[-2.0, 0.3, 0.3]], LINE])
    found = extend(room, line, [1.6, 0.4, 0.3], rule=EXPOSED)
    assert 2.0 <= found.origin <= 2.6
    np.testing.assert_array_equal(found.line[0], line[0])


def test_line_may_pass_where_the_grid_lets_no_arm_begin():
    """Through a slot 2 m long and 0.22 m wide, with cells of 0.25 m and an arm of 0.2 m."""
    plates = [
        PlacedShape("slot", "", Box(2.0, 0.1, 2.0), RigidTransform([2.0, 1.5 + y, 0.3]))
        for y in (-0.16, 0.16)
    ]
    grid = Grid(lower=[0.0, 0.0, 0.0], upper=[4.0, 3.0, 0.6], shape=(16, 12, 3))
    occupancy = Occupancy.of(SignedDistanceField.of(plates), grid, RADIUS)
    line = np.array([[0.4, 1.5, 0.3], [3.6, 1.5, 0.3]])
    goal = np.array([0.9, 2.5, 0.3])
    found = extend(occupancy, line, goal, rule=EXPOSED)
    straight = np.linalg.norm(goal - line[0])
    assert straight <= found.exposed_length <= (1.0 + SAME_LENGTH) * straight
    with pytest.raises(InputError, match=r"start \(2, 1.5, 0.3\) m sees no free cell of the grid"):
        extend(occupancy, [line[0], [2.0, 1.5, 0.3]], goal, rule=TIP)


def test_string_around_the_payload_is_the_exposed_length():
    """In the gap: from the base around a third of the payload, as long as the taut string."""
    occupancy = Occupancy.of(bare_gap(), unfolded_grid((100, 100, 11)), ARM)
    around = np.array([0.0, 2.2])
    base, goal = np.column_stack([2.03 * np.cos(around), 2.03 * np.sin(around), [0.0, 1.5]])
    line = base + np.linspace(0.0, 1.0, 20)[:, None] * np.array([0.0, 0.0, 3.0])
    found = extend(occupancy, line, goal, rule=EXPOSED)
    assert found.exposed_length == pytest.approx(taut_length(base, goal), rel=0.05)
    assert found.exposed_length >= taut_length(base, goal) - 1e-4


def test_lines_and_goals_of_no_use_are_refused(room):
    with pytest.raises(InputError, match=r"arm's line of shape \(3,\); must be \(N, 3\)"):
        extend(room, LINE[0], [1.6, 0.4, 0.3], rule=TIP)
    with pytest.raises(InputError, match=r"goal \(2, 1, 0.3\) m is 0.1 m inside wall"):
        extend(room, LINE, [2.0, 1.0, 0.3], rule=TIP)
    with pytest.raises(InputError, match=r"start .* is outside the workspace"):
        extend(room, LINE + np.array([9.0, 0.0, 0.0]), [1.6, 0.4, 0.3], rule=EXPOSED)
    wall = PlacedShape("across", "", Box(0.1, 9.0, 9.0), RigidTransform([1.0, 1.0, 0.3]))
    blocked = Occupancy.of(room.field.with_shapes([wall]), room.grid, RADIUS)
    with pytest.raises(NoPathError, match="in the way: across"):
        extend(blocked, LINE[:1], [1.6, 0.4, 0.3], rule=EXPOSED)


def test_same_class_draws_back_to_where_the_base_s_own_way_would_begin_to_differ(room):
    """Around the payload to one side; the base itself would go around the other side."""
    gap = Occupancy.of(bare_gap(), unfolded_grid((120, 120, 8)), ARM)
    turn, out = np.linspace(0.0, 2.0, 60), 2.02
    line = np.column_stack([out * np.cos(turn), out * np.sin(turn), np.linspace(-1.0, 0.0, 60)])
    goal = [out * math.cos(-2.6), out * math.sin(-2.6), 0.0]
    found = extend(gap, line, goal, rule=OriginRule.SAME_CLASS)
    assert found.rule is OriginRule.SAME_CLASS
    assert found.origin == retraction_point(gap, line, goal).origin
    on, back = extend(gap, line, goal, rule=TIP), extend(gap, line, goal, rule=EXPOSED)
    assert back.origin < found.origin < on.origin
    assert back.exposed_length < found.exposed_length < on.exposed_length
    assert on.tip_travel < found.tip_travel < back.tip_travel
    # From there it goes the base's way, to negative y0; from the tip it would go on.
    assert found.path[len(found.path) // 2, 1] < 0.0 < on.path[1, 1]
    # Where that needs too much arm, it is drawn back farther.
    length_there = found.exposed_length - 0.01
    short = extend(gap, line, goal, rule=OriginRule.SAME_CLASS, arm_length=length_there)
    assert short.rule is EXPOSED
    # In a room in which ways cannot differ it goes on from where it is.
    beyond = extend(room, LINE, [3.6, 1.5, 0.3], rule=OriginRule.SAME_CLASS)
    assert beyond.origin == pytest.approx(length(LINE))
