"""Three fits of an arm to a path: points on it, springs at rest, the gain beyond which they fly."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import least_squares

from pips_drake.errors import InputError, NotFollowableError
from pips_drake.planning.fitting import (
    fit_by_following,
    fit_directly,
    fit_with_springs,
    largest_eigenvalue,
    spine_jacobian,
)
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.tip_path import PathBuilder, polyline_path

FITS = (fit_directly, fit_by_following, fit_with_springs)


@pytest.fixture(scope="module")
def arm():
    return load_arm("cmu_92")


def home_tip(arm):
    return kinematics.spine_points(arm, arm.joint_home)[0, -1]


@pytest.fixture(scope="module")
def straight(arm):
    tip = home_tip(arm)
    along = np.array([0.0, 0.0, 1.0])
    return polyline_path([tip - 9.144 * along, tip, tip + 5.0 * along], "straight")


@pytest.fixture(scope="module")
def bend(arm):
    """The base line, then an arc in the plane of x0 and z0 by 100 deg at 2.5 m, then a line."""
    start = home_tip(arm) - [0.0, 0.0, 9.144]
    builder = PathBuilder(start=start, direction=[0.0, 0.0, 1.0]).line(9.144)
    builder.arc(radius=2.5, angle=math.radians(100.0), toward=[-1.0, 0.0, 0.0])
    return builder.line(1.0).build("bend")


@pytest.mark.parametrize("fit", FITS)
def test_on_a_straight_path_the_feed_moves_and_nothing_bends(arm, straight, fit):
    found = fit(arm, straight, straight.home_arc_length + 2.0)
    assert_allclose(found.joints[0] - arm.joint_home[0], 2.0, rtol=0, atol=1e-9)
    assert_allclose(found.joints[1:], 0.0, rtol=0, atol=1e-9)
    assert found.tip_error < 1e-9
    assert found.deviation < 1e-9


@pytest.mark.parametrize("fit", FITS[:2])
def test_spine_points_stand_on_the_path_a_link_apart(arm, bend, fit):
    found = fit(arm, bend, bend.length - 0.3)
    points = kinematics.spine_points(arm, found.joints)[0]
    assert_allclose(points, bend.point(found.spine_arc_lengths), rtol=0, atol=1e-9)
    assert_allclose(np.linalg.norm(np.diff(points, axis=0), axis=-1), 0.4572, rtol=0, atol=1e-9)


@pytest.mark.parametrize("fit", FITS[:2])
def test_around_an_arc_every_joint_turns_by_what_chords_of_its_circle_turn(arm, bend, fit):
    found = fit(arm, bend, bend.length - 1.0)  # the tip at the arc's end
    ways = np.diff(kinematics.spine_points(arm, found.joints)[0], axis=0)
    turns = np.arccos(np.clip(np.sum(ways[1:] * ways[:-1], axis=1) / 0.4572**2, -1.0, 1.0))
    arcs = found.spine_arc_lengths  # the direct fit's tip stands beyond the arc
    inside = (arcs[:-2] > 9.144) & (arcs[2:] <= bend.length - 1.0)
    assert inside.sum() >= 7
    # Near 10 deg, arccos loses half of the digits it would lose at 0.
    assert_allclose(turns[inside], 2.0 * math.asin(0.4572 / 5.0), rtol=0, atol=1e-9)


def test_the_direct_fit_overshoots_by_what_chords_are_shorter_than_their_arcs(arm, bend):
    wanted = bend.length - 0.5
    direct, followed = fit_directly(arm, bend, wanted), fit_by_following(arm, bend, wanted)
    assert followed.tip_error < 1e-9
    # 100 deg at 2.5 m are 4.36 m: nearly ten chords, each 2 R asin(l / 2 R) - l short of its arc.
    shorter = 5.0 * math.asin(0.4572 / 5.0) - 0.4572
    assert direct.tip_error == pytest.approx(4.363 / 0.4578 * shorter, rel=0.1)


def test_the_jacobian_is_the_spine_points_numeric_derivative(arm, bend):
    q = fit_directly(arm, bend, bend.length).joints + 0.01
    jacobian = spine_jacobian(arm, q)
    step = 1e-6
    for j in range(arm.joints):
        shift = step * np.eye(arm.joints)[j]
        up, down = (kinematics.spine_points(arm, q + s)[0] for s in (shift, -shift))
        # Points of 10 m are rounded to 1e-15, over a step of 1e-6.
        assert_allclose(jacobian[:, j], ((up - down) / (2.0 * step)).ravel(), rtol=0, atol=1e-8)


def test_springs_come_to_rest_where_least_squares_has_its_minimum(arm, bend):
    s = bend.length - 0.5
    found = fit_with_springs(arm, bend, s, tolerance=1e-7)

    def pulls(q):
        points = kinematics.spine_points(arm, q)[0]
        arcs = found.spine_arc_lengths
        _, nearest = bend.nearest(points, np.maximum(arcs - 0.2, 0.0), arcs + 0.2)
        nearest[-1] = s
        return (bend.point(nearest) - points).ravel()

    best = least_squares(pulls, found.joints, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    # A vanishing minimum. Its slowest parts lose a ten-thousandth a step, so that what is left is
    # some ten thousand times the tolerance.
    assert np.abs(pulls(found.joints)).max() < 2e-3
    assert best.cost < 1e-9
    assert 0.5 * (pulls(found.joints) ** 2).sum() < 1e-5


def test_a_gain_above_two_over_lambda_diverges_and_one_below_does_not(arm, bend):
    """The bound of the derivation, on the arm itself; Eq 15's unit gain is far beyond it."""
    s = bend.length - 0.5
    rest = fit_by_following(arm, bend, s).joints
    eigenvalue = largest_eigenvalue(spine_jacobian(arm, rest))
    assert 10.0 < eigenvalue < arm.joints
    nudged = rest + 1e-5 * np.cos(np.arange(arm.joints))
    for share, rests in ((1.9, True), (2.2, False)):
        if rests:
            fit_with_springs(arm, bend, s, start=nudged, gain=share / eigenvalue)
        else:
            with pytest.raises(NotFollowableError, match=r"diverge|settled within"):
                fit_with_springs(
                    arm, bend, s, start=nudged, gain=share / eigenvalue, max_steps=3000
                )
    with pytest.raises(NotFollowableError, match=r"a gain of 1 is too large; must be below 0\.1"):
        fit_with_springs(arm, bend, s, gain=1.0)


def test_eq_13s_mass_of_one_hinge_is_the_sum_of_squared_levers(arm, straight):
    """Eq 13 at the last hinge that moves anything: the tip alone, a link's length away."""
    jacobian = spine_jacobian(arm, fit_directly(arm, straight, straight.home_arc_length).joints)
    masses = np.sum(jacobian**2, axis=0)
    assert_allclose(masses[-2:], [0.4572**2, 0.0], rtol=1e-12, atol=1e-24)
    # The feed moves all twenty points alike.
    assert masses[0] == pytest.approx(20.0, rel=1e-12)


def test_what_means_nothing_or_cannot_be_is_refused(arm, bend):
    for gain in (0.0, -1.0, math.nan):
        with pytest.raises(InputError, match=r"gain = .*; must be > 0"):
            fit_with_springs(arm, bend, bend.length, gain=gain)
    with pytest.raises(InputError, match="must be 42 finite numbers"):
        fit_with_springs(arm, bend, bend.length, start=np.zeros(3))
    with pytest.raises(NotFollowableError, match=r"sphere about spine point|base"):
        fit_by_following(arm, bend, 3.0)
