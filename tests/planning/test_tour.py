"""Goals in order: what is kept of a path stays as it is, and the joints never leap."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.geometry import Box
from pydrake.math import RigidTransform

from pips_drake.errors import InputError
from pips_drake.planning.kept_path import continued_path, cut_path
from pips_drake.planning.origins import OriginRule
from pips_drake.planning.planner import plan_along
from pips_drake.planning.tour import Goal, Tour, plan_tour
from pips_drake.scene.signed_distance import PlacedShape, SignedDistanceField
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.follow_the_leader import FollowTheLeader
from pips_drake.serpentine.runs.placed_arm import place_arm
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import load_setup
from pips_drake.serpentine.tip_path import PathBuilder, blended_path
from pips_drake.twin.clearance import ClearanceQuery

from .bay import AXIS_X, HOME, bay_occupancy, in_the_gap

MARGIN, SPEED, RAMP, RATE = 0.025, 0.05, 1.0, 32.0
GOALS = [
    Goal(point=in_the_gap(30.0, 3.0), name="near"),
    Goal(point=in_the_gap(0.0, 5.5), name="on", nails=[in_the_gap(18.0, 4.0)]),
    Goal(point=in_the_gap(-60.0, 4.0), name="round"),
]


@pytest.fixture(scope="module")
def arm():
    return load_arm("cmu_92")


@pytest.fixture(scope="module")
def occupancy():
    return bay_occupancy()


@pytest.fixture(scope="module")
def tour(arm, occupancy):
    return plan_tour(
        arm,
        occupancy,
        GOALS,
        OriginRule.LEAST_TIP_TRAVEL,
        home_tip=HOME,
        margin=MARGIN,
        back_home=True,
    )


@pytest.fixture(scope="module")
def motion(tour):
    return tour.joint_motion(speed=SPEED, ramp=RAMP, rate_hz=RATE, dwell=1.5)


ON, ASIDE = np.array([0.5, 0.3, 1.0]), np.array([0.0, 1e-3, 0.0])


def bent():
    return (
        PathBuilder(start=[0.0, 0.0, 0.0], direction=[0.0, 0.0, 1.0])
        .line(4.0)
        .home()
        .arc(radius=1.0, angle=1.0, toward=[1.0, 0.0, 0.0])
        .line(1.0)
        .build("bent")
    )


@pytest.mark.parametrize("beyond", [0.3, 1.0, 1.4, 2.0])
def test_a_cut_path_is_the_same_lines_and_arcs_up_to_there(beyond):
    path = bent()
    cut = cut_path(path, 4.0 + beyond)
    assert cut.length == pytest.approx(4.0 + beyond, abs=1e-12)
    s = np.linspace(0.0, cut.length, 101)
    assert_array_equal(cut.point(s), path.point(s))
    end, tangent = cut.point(cut.length), cut.tangent(cut.length)
    on = continued_path(cut, [end, end + 0.1 * tangent, end + ON])
    assert_array_equal(on.point(s), path.point(s))
    assert_allclose(on.point(on.length), end + ON, rtol=0, atol=1e-12)
    # No corner where it goes on, nor anywhere else: rounding alone.
    assert on.corner_angles().max() < 1e-7
    assert on.home_arc_length == path.home_arc_length


def test_paths_are_cut_and_continued_only_where_they_can_be():
    path = bent()
    for s in (3.9, 6.1, math.nan):
        with pytest.raises(InputError, match=r"must be 4 \(home\) \.\. 6 m \(end\)"):
            cut_path(path, s)
    end, tangent = path.point(path.length), path.tangent(path.length)
    for points in (
        [end + ASIDE, end + 0.1 * tangent],
        [end, end + 0.1 * tangent + ASIDE],
    ):
        with pytest.raises(InputError, match="does not go on from its end along its tangent"):
            continued_path(path, points)


def test_a_plan_that_keeps_a_part_leaves_it_as_it_is(arm):
    """In the open: sideways from the middle of a path's arc, and the joints at the switch."""
    tip = np.array(HOME)
    corners = np.array([[0.0, 0.0, -9.6012], [0.0, 0.0, 0.0], [0.0, 0.0, 2.0], [0.8, 0.0, 4.0]])
    first = blended_path(tip + corners, "first")
    keep = cut_path(first, first.home_arc_length + 1.7)
    nowhere = SignedDistanceField.of([])
    goal = keep.point(keep.length) + np.array([0.3, 0.6, 2.0])
    made = plan_along(arm, nowhere, [keep.point(keep.length), goal], keep=keep)
    s = np.linspace(0.0, keep.length, 200)
    assert_array_equal(made.path.point(s), first.point(s))
    assert made.path.is_smooth
    assert_allclose(made.path.point(made.path.length), goal, rtol=0, atol=1e-12)
    assert_allclose(made.points[1], HOME, rtol=0, atol=1e-12)
    assert_allclose(made.points[-1], goal, rtol=0, atol=1e-12)
    solver, shift = FollowTheLeader(arm), np.array([0.0, 0.0, -made.shift[2]])
    both = [solver.solve(p.translated(shift), [keep.length]).joints for p in (first, made.path)]
    assert_allclose(both[0], both[1], rtol=0, atol=1e-9)


def test_the_tip_comes_to_each_goal_in_order_and_home_again(tour, motion, arm):
    assert isinstance(tour, Tour)
    assert tour.feasible and tour.failures == ()
    tips = kinematics.spine_points(arm, motion.joints)[:, -1] + tour.shift
    reached = [int(np.argmin(np.linalg.norm(tips - goal.point, axis=1))) for goal in GOALS]
    assert reached == sorted(reached)
    for row, goal in zip(reached, GOALS, strict=True):
        assert_allclose(tips[row], goal.point, rtol=0, atol=1e-9)
        assert_allclose(motion.joints[row], motion.joints[row + 1], rtol=0, atol=1e-12)  # rests
        assert motion.times[row + 1] - motion.times[row] == pytest.approx(1.5)
    assert_allclose(tips[-1], HOME, rtol=0, atol=1e-9)
    assert_allclose(tips[0], HOME, rtol=0, atol=1e-9)


def test_the_joints_are_the_same_on_both_paths_at_each_switch(tour, arm):
    solver = FollowTheLeader(arm)
    for before, after in zip(tour.legs[:-1], tour.legs[1:], strict=True):
        shift = np.array([0.0, 0.0, -before.made.best.shift[2]])
        both = [
            solver.solve(leg.path.translated(shift), [after.origin]).joints
            for leg in (before, after)
        ]
        assert_allclose(both[0], both[1], rtol=0, atol=1e-6)
    # The second goes on from the tip, and through its nail.
    assert tour.legs[1].origin == tour.legs[0].path.length
    assert tour.legs[1].rule is OriginRule.LEAST_TIP_TRAVEL
    gap, _ = tour.legs[1].path.nearest(np.atleast_2d(GOALS[1].nails[0]), 0.0, 99.0)
    assert gap[0] < 5e-3  # corners are rounded
    # The third is elsewhere: the arm draws back, and not to its base alone.
    assert tour.legs[2].origin < tour.legs[1].path.length - 1.0


def test_no_joint_leaps_within_the_motion(motion, tour):
    """At 1/32 s: faster than any path of theirs asks for they would have leapt."""
    steps = np.abs(np.diff(motion.joints, axis=0)) / np.diff(motion.times)[:, None]
    # Links that turn into a bend pull the slide up to a third faster; a hinge turns by its range
    # within a link's length.
    assert steps[:, 0].max() < 1.5 * SPEED
    assert steps[:, 1:].max() < SPEED * math.radians(180.0) / 0.4572
    # Rest at the end of every stroke: speeds there are those of a ramp's first row.
    assert motion.times[0] == 0.0
    moved = tour.tip_travel / SPEED
    strokes = len(list(tour.strokes()))
    assert motion.duration == pytest.approx(moved + strokes * RAMP + len(GOALS) * 1.5, rel=1e-9)


def test_a_goal_that_is_walled_off_ends_the_tour_and_is_named(arm, occupancy):
    wall = PlacedShape("wall", "", Box(5.0, 5.0, 0.04), RigidTransform([AXIS_X, 0.0, 9.0]))
    walled = occupancy.updated(occupancy.field.with_shapes([wall]))
    found = plan_tour(
        arm,
        walled,
        [GOALS[0], Goal(point=in_the_gap(20.0, 6.0), name="behind"), GOALS[1]],
        OriginRule.LEAST_EXPOSED_LENGTH,
        home_tip=HOME,
        margin=MARGIN,
    )
    assert len(found.legs) == 1
    assert found.failures[0].startswith("goal 2 (behind): no way to the goal")
    assert "in the way: wall" in found.failures[0]


def test_what_means_nothing_is_refused(arm, occupancy, tour):
    rule = OriginRule.LEAST_TIP_TRAVEL
    with pytest.raises(InputError, match="tour without a goal"):
        plan_tour(arm, occupancy, [], rule, margin=MARGIN)
    bad = [Goal(point=[math.nan, 0.0, 0.0])]
    with pytest.raises(InputError, match=r"goal 1: goal = .* three finite numbers"):
        plan_tour(arm, occupancy, bad, rule, home_tip=HOME, margin=MARGIN)
    good = {"speed": SPEED, "ramp": RAMP, "rate_hz": RATE}
    for given, words in (
        ({"rate_hz": 0.0}, r"rate = 0\.0 1/s"),
        ({"speed": -1.0}, "speed = -1.0"),
        ({"dwell": math.nan}, "dwell = nan s"),
    ):
        with pytest.raises(InputError, match=words):
            tour.joint_motion(**(good | given))
    with pytest.raises(InputError, match="tour without a leg"):
        Tour(arm=arm, legs=(), failures=()).joint_motion(**good)


@pytest.mark.slow
def test_the_engine_finds_no_collision_anywhere_on_the_tour(tour, motion, tmp_path):
    file = tmp_path / "planned.csv"
    points = tour.legs[0].made.best.points
    np.savetxt(file, points, delimiter=",", header="x_m,y_m,z_m", comments="")
    scenario = SerpentineScenario(
        arm="cmu_92", path=str(file), scene="cargo_bay", mounting="laboratory"
    )
    placed = place_arm(scenario, load_setup(scenario))
    query = ClearanceQuery(placed.plant, [placed.model], max_distance=0.1)
    postures = motion.at(np.linspace(0.0, motion.duration, 120))
    scene, own = np.transpose(
        [[pair.distance for pair in query.least(posed)] for posed in placed.posed(postures)]
    )
    # The engine's distances are good to a millimetre; the planner's bound is a lower one.
    assert scene.min() > min(leg.made.clearance.lower for leg in tour.legs) - 1e-3
    assert own.min() > 0.0
