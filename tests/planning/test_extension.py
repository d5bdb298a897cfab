"""The rules of CMU-92 section 3.5.1, one by one, and the ramps with which they are obeyed."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from pips_drake.errors import InputError
from pips_drake.planning.extension import Extending, Situation, approach, where_to
from pips_drake.serpentine.motion_words import EXTEND, HOLD, RETRACT, RUN, WORDS


def situation(**changes):
    """A tip half way out along a snake at rest."""
    usual = dict(word=RUN, near_rest=True, fits=True, tip=11.0, home=10.0, end=12.0)
    return Situation(**(usual | changes))


def test_not_near_rest_means_neither_out_nor_back():
    assert where_to(situation(near_rest=False)) == (Extending.WAITING, 11.0)


def test_near_rest_means_out_to_the_goal_and_there_it_stays():
    assert where_to(situation()) == (Extending.OUT, 12.0)
    assert where_to(situation(tip=12.0)) == (Extending.THERE, 12.0)


@pytest.mark.parametrize("near_rest", [True, False])
def test_beyond_the_end_means_back_to_the_end_moving_snake_or_not(near_rest):
    found = where_to(situation(end=10.7, near_rest=near_rest))
    assert found == (Extending.PROTRUDING, 10.7)


@pytest.mark.parametrize("word", [RUN, EXTEND])
def test_what_cannot_be_fitted_comes_back_before_all_else(word):
    found = where_to(situation(fits=False, word=word, end=10.5))
    assert found == (Extending.UNFITTED, 10.0)


def test_the_operator_stands_above_the_rules():
    for fits, end, near_rest in itertools.product((True, False), (10.5, 12.0), (True, False)):
        now = dict(fits=fits, end=end, near_rest=near_rest)
        assert where_to(situation(word=HOLD, **now)) == (Extending.HELD, 11.0)
        assert where_to(situation(word=RETRACT, **now)) == (Extending.BACK, 10.0)
    assert where_to(situation(word=EXTEND, near_rest=False)) == (Extending.OUT, 12.0)


def test_reach_ends_the_way_out_and_drawn_in_it_brings_the_tip_back():
    assert where_to(situation(reach=1.5)) == (Extending.OUT, 11.5)
    assert where_to(situation(reach=1.0)) == (Extending.THERE, 11.0)
    assert where_to(situation(reach=0.25)) == (Extending.BACK, 10.25)
    assert where_to(situation(reach=0.0, near_rest=False)) == (Extending.BACK, 10.0)


def test_a_snake_shorter_than_its_lead_brings_the_tip_home_and_no_farther():
    assert where_to(situation(end=9.0)) == (Extending.PROTRUDING, 10.0)


def test_a_word_that_is_none_is_refused():
    with pytest.raises(InputError, match=r"operator's word = 3; must be 1 \(run\), 0 \(hold\)"):
        where_to(situation(word=3))
    assert len(WORDS) == 4


MOTION = dict(speed=0.05, acceleration=0.1, period=1.0 / 32.0)


@pytest.mark.parametrize("way", [1.0, 0.31, 0.011, -0.7])
def test_an_approach_keeps_speed_and_acceleration_and_stops_on_its_target(way):
    place, rate, rates = 0.0, 0.0, [0.0]
    for _ in range(2000):
        place, rate = approach(place, rate, way, **MOTION)
        rates.append(rate)
    assert place == way
    # Ends at rest, and never beyond: the sum of the rates is the way, all of one sign.
    rates = np.array(rates)
    assert (rates * math.copysign(1.0, way) >= 0.0).all()
    assert np.abs(rates).max() <= 0.05 + 1e-15
    # But for the last step, which is cut to end on the target.
    moving = np.flatnonzero(rates)
    changes = np.abs(np.diff(rates))
    assert changes[: moving[-1] - 1].max() <= 0.1 / 32.0 + 1e-15
    assert changes.max() <= 0.2 / 32.0
    # Braking from full speed takes v^2 / 2a = 12.5 mm and the time v / a longer than without.
    if abs(way) > 0.1:
        ideal = abs(way) / 0.05 + 0.05 / 0.1
        assert len(moving) / 32.0 == pytest.approx(ideal, abs=0.2)


def test_a_target_that_is_given_up_lets_the_tip_come_to_rest():
    place, rate = 0.5, 0.05
    ways = []
    for _ in range(32):
        # Held, the target is where the tip is.
        after, rate = approach(place, rate, place, **MOTION)
        ways.append(after - place)
        place = after
    # v^2 / 2a, in steps: 0.0125 m less half a step's worth.
    assert sum(ways) == pytest.approx(0.0125, abs=0.05 / 32.0)
    assert ways[-1] == 0.0 and rate == 0.0
