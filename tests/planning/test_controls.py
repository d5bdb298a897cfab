"""The operator's desk: Meshcat's own sliders and buttons, set as the page would set them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pips_drake.planning.controls import BUTTONS, OperatorDesk, WishKeeper
from pips_drake.planning.snake import SnakeSettings, make_snake
from pips_drake.serpentine.motion_words import EXTEND, HOLD, RETRACT, RUN
from pips_drake.twin.replay import make_meshcat

GOAL = np.array([0.0, 2.0, 7.0])


class Pressed:
    """A Meshcat whose buttons can be pressed without a page."""

    def __init__(self, meshcat):
        self.meshcat = meshcat
        self.more = dict.fromkeys(BUTTONS, 0)

    def __getattr__(self, name):
        return getattr(self.meshcat, name)

    def GetButtonClicks(self, name):  # noqa: N802 (Meshcat's own name)
        return self.meshcat.GetButtonClicks(name) + self.more[name]


@pytest.fixture(scope="module")
def meshcat():
    return make_meshcat()


@pytest.fixture
def page(meshcat):
    yield Pressed(meshcat)
    meshcat.DeleteAddedControls()


@pytest.fixture(scope="module")
def snake():
    return make_snake([[0.0, 0.0, 0.0], [0.0, 0.0, 4.0]], SnakeSettings(spacing=0.1))


def make_desk(page, **kwargs):
    usual = dict(goal=GOAL, reach=8.0, tension=1.0, bending_stiffness=0.3)
    return OperatorDesk(page, **(usual | kwargs))


def test_untouched_it_wants_what_there_is(page, snake):
    wish = make_desk(page).read(snake)
    assert_allclose(wish.goal, GOAL, rtol=0, atol=0)
    # To the last digit, though sliders have steps.
    assert (wish.tension, wish.bending_stiffness, wish.reach) == (1.0, 0.3, 8.0)
    assert (wish.word, wish.pulls, len(wish.nails)) == (RUN, (), 0)


def test_sliders_move_the_goal_in_both_kinds_of_coordinates(page, snake):
    desk = make_desk(page)
    assert desk.goal_sliders == ("goal x (m)", "goal y (m)", "goal z (m)")
    for name, value in zip(desk.goal_sliders, (0.1, -0.2, 0.3), strict=True):
        page.SetSliderValue(name, value)
    assert_allclose(desk.read(snake).goal, GOAL + np.array([0.1, -0.2, 0.3]), rtol=0, atol=1e-12)
    desk.close()
    assert not page.GetSliderNames()
    # A quarter of a circle of 2 m is an arc of pi m; then out by half a metre.
    desk = make_desk(page, axis=(0.0, 0.0), span=4.0)
    page.SetSliderValue("goal around (m)", 3.14)
    page.SetSliderValue("goal out (m)", 0.5)
    page.SetSliderValue("goal along (m)", -1.0)
    assert_allclose(desk.read(snake).goal, [-2.5, 0.0, 6.0], rtol=0, atol=3e-3)


def test_sliders_tune_weights_and_reach_and_pull(page, snake):
    desk = make_desk(page)
    page.SetSliderValue("elasticity (log10 N)", 1.0)
    page.SetSliderValue("rigidity (log10 N m^2)", -2.0)
    page.SetSliderValue("reach (m)", 2.5)
    page.SetSliderValue("pull at (share of the snake)", 0.25)
    page.SetSliderValue("pull y (N)", 4.0)
    wish = desk.read(snake)
    assert wish.tension == pytest.approx(10.0)
    assert wish.bending_stiffness == pytest.approx(0.01)
    assert wish.reach == 2.5
    place, force = wish.pulls[0]
    assert_allclose(place, [0.0, 0.0, 1.0], rtol=0, atol=1e-12)
    assert_allclose(force, [0.0, 4.0, 0.0], rtol=0, atol=0)


def test_keys_say_words_and_drive_nails_in_and_out(page, snake):
    desk = make_desk(page)
    for name, word in (("hold", HOLD), ("extend", EXTEND), ("retract", RETRACT), ("run", RUN)):
        page.more[name] += 1
        assert desk.read(snake).word == word
        assert desk.read(snake).word == word
    page.more["nail"] += 1
    assert_allclose(desk.read(snake).nails, [[0.0, 0.0, 2.0]], rtol=0, atol=1e-12)
    page.SetSliderValue("pull at (share of the snake)", 0.75)
    page.more["nail"] += 1
    assert_allclose(desk.read(snake).nails[1], [0.0, 0.0, 3.0], rtol=0, atol=1e-12)
    page.more["unnail"] += 1
    assert len(desk.read(snake).nails) == 1
    # More often than there are nails.
    page.more["unnail"] += 3
    assert len(desk.read(snake).nails) == 0


def test_what_is_kept_are_changes(page, snake):
    desk, keeper = make_desk(page), WishKeeper()
    for k in range(4):
        keeper.keep(0.1 * k, desk.read(snake))
    page.SetSliderValue("goal x (m)", 0.5)
    keeper.keep(0.4, desk.read(snake))
    page.SetSliderValue("pull x (N)", 2.0)
    keeper.keep(0.5, desk.read(snake))
    keeper.keep(0.6, desk.read(snake))
    assert keeper.times == [0.0, 0.4, 0.5]
    assert len(keeper.wishes) == 3
