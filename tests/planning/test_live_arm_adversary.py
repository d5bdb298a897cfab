"""An operator who means harm: whatever is wished, no posture is taken that is not clear."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pips_drake.planning.live_arm import LiveArm
from pips_drake.planning.live_snake import LiveSnakeSettings, Wish
from pips_drake.planning.live_state import LiveArmSettings, Refusal
from pips_drake.planning.potential_field import Repulsion
from pips_drake.scene.packages import find_scene_file
from pips_drake.scene.signed_distance import read_distance_field
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.drives import drive_limits, drives_from_joints
from pips_drake.serpentine.follow_the_leader import FollowTheLeader
from pips_drake.serpentine.joint_motion import JointMotion
from pips_drake.serpentine.motion_words import EXTEND, HOLD, RETRACT, RUN
from pips_drake.serpentine.planned_motion import GivenJoints
from pips_drake.serpentine.runs.placed_arm import place_arm
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import SerpentineSetup
from pips_drake.twin.clearance import ClearanceQuery

from .corridor import along_the_corridor, distance_of_bodies, home_tip, live_arm

#: Faster than hardware would be let to go, so that tests need fewer ticks.
QUICK = LiveArmSettings(
    tip_speed=0.09, tip_acceleration=0.5, shift_speed=0.2, shift_acceleration=1.0
)


@pytest.fixture(scope="module")
def arm():
    return load_arm("cmu_92")


def vector(*numbers):
    return np.array(numbers)


class Adversary:
    """An operator who does whatever they like, mostly harm; everything from a seed."""

    def __init__(self, seed, middle, spread):
        self._rng = np.random.default_rng(seed)
        self._middle, self._spread = middle, np.asarray(spread)
        self._wish = Wish()

    def _place(self):
        return self._middle + self._rng.normal(0.0, 1.0, 3) * self._spread

    def __call__(self, state):
        rng, wish = self._rng, self._wish
        if rng.random() < 0.03:
            wish = replace(wish, goal=self._place())
        if rng.random() < 0.03:
            force = rng.normal(0.0, 1.0, 3) * 10.0 ** rng.uniform(0.0, 3.0)
            point = state.live.snake.points[rng.integers(len(state.live.snake.points))]
            wish = replace(wish, pulls=((point, force),) if rng.random() < 0.7 else ())
        if rng.random() < 0.02:
            kept = wish.nails[rng.random(len(wish.nails)) < 0.6]
            wish = replace(wish, nails=np.vstack([kept, self._place()])[-4:])
        if rng.random() < 0.01:
            wish = replace(
                wish,
                tension=10.0 ** rng.uniform(-1.0, 1.0),
                bending_stiffness=10.0 ** rng.uniform(-3.0, 1.0) if rng.random() < 0.9 else 0.0,
            )
        if rng.random() < 0.02:
            wish = replace(
                wish,
                word=rng.choice([RUN, EXTEND, EXTEND, EXTEND, EXTEND, HOLD, RETRACT]),
                reach=rng.choice([math.inf, rng.uniform(1.0, 8.0)]),
            )
        self._wish = wish
        return wish


def watch(live, state, operator, ticks):
    """Ticks, and every claim of a state checked at each.

    Returns all postures (ticks + 1, J), and why ticks were refused.
    """
    arm, period = live.arm, live.settings.period
    speed = drive_limits(arm)[2]
    postures, refusals = [state.joints], set()
    for _ in range(ticks):
        before, state = state, live.tick(state, operator(state))
        assert np.isfinite(state.joints).all()
        assert (state.joints >= arm.joint_lower).all()
        assert (state.joints <= arm.joint_upper).all()
        drives = drives_from_joints(arm, np.stack([before.joints, state.joints]))
        assert (np.abs(np.diff(drives, axis=0)[0]) <= speed * period).all()
        assert_allclose(state.rates * period, state.joints - before.joints, rtol=0, atol=1e-15)
        assert state.clearance >= live.settings.clearance
        assert np.isfinite(state.live.snake.points).all()
        postures.append(state.joints)
        refusals.add(state.refusal)
    return np.array(postures), refusals


def between(postures, every, parts):
    """Postures on the straight ways from some rows to their next, (.., J)."""
    rows = np.arange(0, len(postures) - 1, every)
    shares = np.arange(parts)[:, None, None] / parts
    ways = postures[rows] + shares * (postures[rows + 1] - postures[rows])
    return ways.reshape(-1, postures.shape[1])


def kept_between(live, postures):
    """Between ticks clearance is short of what is kept by half of a tick's motion at most, m."""
    joints = kinematics.frames(live.arm, postures)[..., :3, 3]
    farthest = np.linalg.norm(np.diff(joints, axis=0), axis=-1).max()
    assert 1e-3 < farthest <= live.settings.clearance
    return live.settings.clearance - 0.5 * farthest


#: Obstacles that hardly repel: the snake goes where it is pulled, and only the arm is held back.
UNREPELLED = replace(
    QUICK,
    snake=LiveSnakeSettings(repulsion=Repulsion(strength=1e-6, reach=0.2, clamp=0.001), radius=0.0),
)


def test_an_operator_who_means_harm_does_none(arm):
    live = live_arm(arm, (0.6, 0.3, 11.5, 0.12), (0.2, -0.3, 12.5, 0.1), settings=UNREPELLED)
    state = live.lay(along_the_corridor(arm, 4.0), extended=2.0)
    adversary = Adversary(7, home_tip(arm) + vector(0.0, 0.0, 2.5), [0.2, 0.6, 1.2])
    postures, refusals = watch(live, state, adversary, 150)
    # It was no easy time: the arm moved, sideways too, and was held back.
    assert np.ptp(postures[:, 0]) > 0.01
    assert np.ptp(postures[:, 3:], axis=0).max() > 0.05
    assert Refusal.TOO_NEAR in refusals
    allowed = kept_between(live, postures)
    seen = min(distance_of_bodies(arm, live.obstacles, q) for q in between(postures, 10, 2))
    assert allowed <= seen < 0.12


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "settings"), [(1, QUICK), (2, UNREPELLED)])
def test_thousands_of_ticks_of_harm_in_the_bay_by_drakes_own_distances(arm, seed, settings):
    file = find_scene_file("cargo_bay")
    field = read_distance_field(file)
    tip = np.array([0.412877, 0.0, 4.4425])
    shift = float(tip[2] - home_tip(arm)[2])
    live = LiveArm(arm, field, rail_shift=shift, settings=settings)
    state = live.lay(tip + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 6.0]]), extended=3.0)
    adversary = Adversary(seed, tip + vector(0.0, 0.0, 4.0), [0.25, 0.8, 1.5])
    postures, refusals = watch(live, state, adversary, 2000)
    assert np.ptp(postures[:, 0]) > 1.0
    assert (Refusal.TOO_NEAR in refusals) == (settings is UNREPELLED)
    motion = JointMotion(times=np.array([0.0, 1.0]), joints=postures[:2])
    setup = SerpentineSetup(
        arm=arm,
        motion=GivenJoints(arm=arm, motion=motion, name="live"),
        solver=FollowTheLeader(arm),
        scene_file=file,
        rail_shift=shift,
    )
    scenario = SerpentineScenario(arm="cmu_92", path="live", mounting="laboratory")
    placed = place_arm(scenario, setup)
    query = ClearanceQuery(placed.plant, [placed.model], max_distance=0.3)
    allowed = kept_between(live, postures)
    # Drake's distances of boxes may be too large by 0.05 mm, and bodies may touch each other.
    least = [query.least(found)[0].distance for found in placed.posed(between(postures, 6, 3))]
    assert allowed - 1e-4 <= min(least) < (0.1 if settings is UNREPELLED else 0.2)
