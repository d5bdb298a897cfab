"""An arm on a snake in an operator's hand: it does as told, as far as that is safe.

The corridor's numbers: `corridor`. A tick is 1/32 s.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pips_drake.errors import InputError, NotFollowableError
from pips_drake.planning.extension import Extending
from pips_drake.planning.live_arm import LiveArm
from pips_drake.planning.live_path import rounded_path
from pips_drake.planning.live_snake import Wish
from pips_drake.planning.live_state import LiveArmSettings, Refusal
from pips_drake.scene.signed_distance import SignedDistanceField
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.motion_words import EXTEND, HOLD, RETRACT
from pips_drake.serpentine.tip_path import blended_path

from .corridor import along_the_corridor, corridor, home_tip, live_arm

#: Faster than hardware would be let to go, so that tests need fewer ticks.
QUICK = LiveArmSettings(
    tip_speed=0.09, tip_acceleration=0.5, shift_speed=0.2, shift_acceleration=1.0
)


@pytest.fixture(scope="module")
def arm():
    return load_arm("cmu_92")


@pytest.fixture(scope="module")
def at_goal(arm):
    """A metre out in the corridor, at rest at the snake's end."""
    live = live_arm(arm, settings=QUICK)
    state = live.lay(along_the_corridor(arm, 1.5), extended=1.0)
    return live, until(live, state, Wish(), Extending.THERE)


def vector(*numbers):
    return np.array(numbers)


def until(live, state, wish, extending, most=1000):
    for _ in range(most):
        state = live.tick(state, wish)
        if state.extending == extending and state.tip_rate == 0.0:
            return state
    raise AssertionError(f"{state.extending.name}, not {extending.name}, after {most} ticks")


def run(live, state, wish, ticks):
    for _ in range(ticks):
        state = live.tick(state, wish)
    return state


def tip_of(live, state):
    return kinematics.spine_points(live.arm, state.joints)[0, -1] + live.shift


def test_the_arm_waits_for_the_snake_and_then_goes_out_to_its_end(arm):
    live = live_arm(arm, settings=QUICK)
    bent = home_tip(arm) + np.array([[0, 0, 0], [0, 0, 0.6], [0, 0.1, 0.7], [0, 0, 0.8]])
    state = live.lay(bent, extended=0.5)
    seen = []
    while Extending.THERE not in seen and len(seen) < 1000:
        state = live.tick(state, Wish())
        seen.append(state.extending)
        assert state.extended == 0.5 or state.extending != Extending.WAITING
    state = live.tick(state, Wish())
    order = [seen[0], *(b for a, b in pairwise(seen) if a != b)]
    assert order == [Extending.WAITING, Extending.OUT, Extending.THERE]
    assert_allclose(tip_of(live, state), home_tip(arm) + vector(0.0, 0.0, 0.8), rtol=0, atol=1e-6)
    # Every spine point on the snake: that is what follow-the-leader means.
    spine = kinematics.spine_points(arm, state.joints)[0]
    off, _ = state.path.nearest(spine, 0.0, state.path.length)
    assert off.max() < 1e-9


def test_a_goal_that_is_moved_is_reached_and_the_arm_stays_on_the_snake(at_goal):
    live, state = at_goal
    goal = state.live.goal + vector(0.03, 0.3, 0.1)
    after = until(live, state, Wish(goal=goal), Extending.THERE)
    assert_allclose(tip_of(live, after), goal, rtol=0, atol=1e-6)
    assert not after.live.goal_refused


@pytest.mark.parametrize("aside", [0.0, -0.06])
def test_a_goal_in_the_wall_or_too_near_is_refused_and_the_last_one_kept(at_goal, aside):
    live, state = at_goal
    good = state.live.goal
    bad = np.array([0.72 + aside, *good[1:]])
    after = run(live, state, Wish(goal=bad), 30)
    assert after.live.goal_refused
    assert_allclose(after.live.goal, good, rtol=0, atol=0)
    assert_allclose(tip_of(live, after), tip_of(live, state), rtol=0, atol=1e-3)
    # And forgotten as soon as a good one is asked for.
    assert not live.tick(after, Wish(goal=good + vector(0.0, 0.01, 0.0))).live.goal_refused


@pytest.mark.slow
def test_a_goal_behind_an_obstacle_is_approached_along_it(arm):
    live = live_arm(arm, (0.27, 0.42, 11.3, 0.15), settings=QUICK)
    state = live.lay(along_the_corridor(arm, 1.5), extended=1.0)
    state = until(live, state, Wish(), Extending.THERE)
    goal = state.live.goal + vector(0.0, 0.84, 0.02)
    ends = []
    for _ in range(400):
        state = live.tick(state, Wish(goal=goal))
        ends.append(state.live.snake.points[-1])
    off = live.obstacles.distances(np.array(ends))
    need = live.settings.snake.goal_radius + live.settings.snake.clearance
    assert off.min() >= need
    assert off.min() < need + 0.02
    assert np.linalg.norm(ends[-1] - goal) < 1e-6


def test_hold_stops_everything_and_retract_brings_the_tip_home(at_goal):
    live, state = at_goal
    moving = run(live, state, Wish(goal=state.live.goal + vector(0.0, 0.5, 0.0)), 10)
    assert moving.shift_rate > 0.05
    held = run(live, moving, Wish(word=HOLD), 16)
    still = run(live, held, Wish(word=HOLD, goal=state.live.goal), 5)
    assert_allclose(still.joints, held.joints, rtol=0, atol=0)
    assert not still.rates.any()
    back = run(live, still, Wish(word=RETRACT), 600)
    assert back.extended == 0.0
    assert_allclose(back.joints, live.arm.joint_home, rtol=0, atol=1e-9)
    assert back.extending == Extending.BACK


def test_extend_goes_out_though_the_snake_moves_and_reach_limits_it(arm):
    live = live_arm(arm, settings=QUICK)
    start = live.lay(along_the_corridor(arm, 1.5))
    pulled = Wish(pulls=((home_tip(arm) + vector(0.0, 0.0, 1.0), np.array([0.0, 20.0, 0.0])),))
    waits = run(live, start, pulled, 12)
    assert waits.extended == 0.0 and not waits.near_rest
    goes = run(live, start, replace(pulled, word=EXTEND), 12)
    assert goes.extended > 0.0
    there = until(live, start, Wish(reach=0.4), Extending.THERE)
    assert there.extended == pytest.approx(0.4, abs=1e-6)
    back = until(live, there, Wish(reach=0.1), Extending.THERE)
    assert back.extended == pytest.approx(0.1, abs=1e-6)


def test_a_tip_beyond_the_snakes_end_comes_back_while_the_snake_still_moves(at_goal):
    live, state = at_goal
    goal = state.live.goal - vector(0.0, 0.0, 0.4)
    seen = set()
    for _ in range(40):
        state = live.tick(state, Wish(goal=goal))
        seen.add(state.extending)
    assert Extending.PROTRUDING in seen
    state = until(live, state, Wish(goal=goal), Extending.THERE)
    assert state.tip == pytest.approx(state.path.length, abs=1e-6)
    assert_allclose(tip_of(live, state), goal, rtol=0, atol=1e-5)


@pytest.mark.slow
def test_a_bend_that_the_joints_cannot_follow_brings_the_arm_back_until_it_fits(arm):
    """Nails fold the snake within one link's length: 20 links cannot go there."""
    free = LiveArm(arm, corridor(), settings=QUICK)
    state = free.lay(along_the_corridor(arm, 3.0), extended=2.5)
    state = until(free, state, Wish(), Extending.THERE)
    tip = home_tip(arm)
    fold = Wish(
        nails=np.array(
            [tip + vector(0.0, 0.0, 1.5), tip + vector(0.0, 0.6, 1.75), tip + vector(0.0, 0.0, 2.0)]
        )
    )
    seen, most = set(), 0.0
    for _ in range(400):
        state = free.tick(state, fold)
        seen.add(state.extending)
        most = max(most, float(np.abs(state.joints[3:]).max()))
    assert Extending.UNFITTED in seen
    assert state.refusal in (Refusal.JOINT_LIMIT, Refusal.NONE)
    # All the way it was within its limits, and came near to them.
    assert math.radians(40.0) < most <= math.radians(45.0)
    assert state.extended < 2.2
    # The fold taken out, it goes to the goal again.
    state = until(free, state, Wish(), Extending.THERE)
    assert state.extended == pytest.approx(3.0, abs=0.02)


def test_nails_hold_their_places_exactly_and_let_go(at_goal):
    live, state = at_goal
    place = home_tip(live.arm) + vector(0.04, 0.15, 0.9)
    nailed = run(live, state, Wish(nails=place[None]), 60)
    row = nailed.live.snake.nearest(place)
    for _ in range(100):
        pulls = ((place, np.array([0.0, -30.0, 10.0])),)
        nailed = live.tick(nailed, Wish(nails=place[None], pulls=pulls))
        assert np.abs(nailed.live.snake.points[row] - place).max() < 1e-12
    free = run(live, nailed, Wish(), 200)
    assert np.linalg.norm(free.live.snake.points[row] - place) > 0.1
    inside = live.tick(state, Wish(nails=np.array([[0.8, 0.0, 11.0]])))
    assert inside.live.nails_refused and not len(inside.live.nails)


def test_rigidity_and_elasticity_are_tuned_while_it_runs(at_goal):
    """A pull bends what is stiff or taut less."""
    live, state = at_goal
    place = home_tip(live.arm) + vector(0.0, 0.0, 1.0)
    pulls = ((place, np.array([0.0, 3.0, 0.0])),)
    aside = {}
    for name, weights in {
        "usual": {},
        "taut": {"tension": 10.0},
        "stiff": {"bending_stiffness": 10.0},
    }.items():
        after = run(live, state, Wish(pulls=pulls, word=EXTEND, **weights), 100)
        aside[name] = after.live.snake.points[:, 1].max()
    assert aside["taut"] < 0.5 * aside["usual"]
    assert aside["stiff"] < 0.5 * aside["usual"]


def test_bad_wishes_and_settings_are_refused(arm):
    nan3 = np.array([math.nan, 0.0, 0.0])
    for wish, words in (
        (dict(goal=nan3), "operator's goal = "),
        (dict(pulls=((np.zeros(3), nan3),)), "operator's pull = "),
        (dict(nails=np.zeros(3)), r"operator's nails; must be \(K, 3\)"),
        (dict(tension=0.0), "operator's tension = 0 N; must be > 0"),
        (dict(bending_stiffness=-1.0), r"stiffness = -1\.0 N m\^2; must be 0 or more"),
        (dict(word=7.0), r"operator's word = 7\.0; must be 1"),
        (dict(reach=math.nan), "operator's reach = nan m"),
    ):
        with pytest.raises(InputError, match=words):
            Wish(**wish)
    with pytest.raises(InputError, match=r"clearance = 0\.001 m; must be at least half"):
        LiveArmSettings(clearance=0.001)
    with pytest.raises(InputError, match="period = 0 s; must be > 0"):
        LiveArmSettings(period=0)
    live = live_arm(arm)
    with pytest.raises(InputError, match="must be at the home tip"):
        live.lay(along_the_corridor(arm) + vector(0.1, 0.0, 0.0))
    with pytest.raises(InputError, match=r"must go beyond its lead of 0\.5 m"):
        live.lay(along_the_corridor(arm, 0.3))
    blocked = live_arm(arm, (0.41, 0.0, 10.2, 0.1))
    with pytest.raises(NotFollowableError, match="would be too near to an obstacle"):
        blocked.lay(along_the_corridor(arm), extended=1.0)


def test_the_rounded_path_is_the_blended_one(arm):
    rng = np.random.default_rng(3)
    points = np.cumsum(rng.normal([0.0, 0.0, 0.2], 0.05, size=(40, 3)), axis=0)
    points = np.vstack(
        [
            points[0] - vector(0.0, 0.0, 9.0),
            points[0],
            points[0] + vector(0.0, 0.0, 0.3),
            points[0] + vector(0.0, 0.0, 0.3) + points - points[0] + vector(0.0, 0.0, 0.1),
        ]
    )
    ours, theirs = rounded_path(points, "live"), blended_path(points, "live")
    assert ours.home_arc_length == pytest.approx(theirs.home_arc_length, abs=1e-12)
    assert ours.is_smooth
    s = np.linspace(0.0, theirs.length, 3000)
    assert ours.length == pytest.approx(theirs.length, abs=1e-9)
    assert_allclose(ours.point(s), theirs.point(s), rtol=0, atol=1e-9)


def test_a_tick_takes_a_bounded_number_of_looks_at_the_obstacles(at_goal, monkeypatch):
    """Two steps of the snake: a look before, one after each, and more where a step is repeated."""
    live, state = at_goal
    looks = []
    asked = SignedDistanceField.blended
    monkeypatch.setattr(
        SignedDistanceField,
        "blended",
        lambda *args, **kwargs: (looks.append(None), asked(*args, **kwargs))[1],
    )
    counts = []
    for k in range(40):
        looks.clear()
        goal = state.live.goal + vector(0.0, 0.02 * math.sin(0.2 * k), 0.0)
        state = live.tick(state, Wish(goal=goal, word=EXTEND))
        counts.append(len(looks))
    assert np.median(counts) <= 6
    assert max(counts) <= 16


def test_the_prototype_is_laid_on_a_snake_and_follows_it_too():
    """Its crane stands at an angle at home, and its joints have offsets."""
    arm = load_arm("prototype")
    tip = home_tip(arm)
    live = LiveArm(arm, SignedDistanceField.of([]), settings=QUICK)
    bent = tip + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.6], [0.1, 0.0, 1.0], [0.1, 0.0, 1.6]])
    state = live.lay(bent, extended=0.8)
    for _ in range(40):
        state = live.tick(state, Wish(word=EXTEND))
        assert state.refusal == Refusal.NONE
    # Slower than it may be: the linkages are what limits it here.
    assert 0.83 < state.extended < 0.8 + 40 * 0.09 / 32.0
    spine = kinematics.spine_points(arm, state.joints)[0]
    off, _ = state.path.nearest(spine, 0.0, state.path.length)
    assert off.max() < 1e-9
