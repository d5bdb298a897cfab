"""A path drawn by hand becomes one that the arm can follow, on the same side of everything."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.geometry import Box
from pydrake.math import RigidTransform

from pips_drake.errors import InputError
from pips_drake.planning.assisted import improve_path
from pips_drake.scene.signed_distance import PlacedShape, SignedDistanceField
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.tip_path import polyline_path

MARGIN = 0.025
TIP = np.array([0.412877, 0.0, 0.0])
BASE = TIP - [0.0, 0.0, 9.6012]
#: A box 0.5 m wide, 0.5 m deep, beside the way straight ahead.
BLOCK = PlacedShape("block", "", Box(0.5, 2.0, 0.5), RigidTransform([0.912877, 0.0, 2.0]))


@pytest.fixture(scope="module")
def arm():
    return load_arm("cmu_92")


@pytest.fixture(scope="module")
def room():
    return SignedDistanceField.of([BLOCK])


def drawn(*points):
    return np.vstack([BASE, TIP, TIP + np.array(points)])


def test_corners_too_sharp_for_the_joints_become_bends(arm, room):
    """Two right angles, and as they were drawn on the left of the block, which is kept."""
    path = drawn([0.0, 0.0, 1.0], [-0.6, 0.0, 1.0], [-0.6, 0.0, 3.0])
    found = improve_path(arm, room, path, margin=MARGIN)
    assert any("leaves its limits" in words or "folds" in words for words in found.before)
    assert found.made.feasible, found.made.failures
    assert found.failures == ()
    assert found.same_side and found.crossed == ()
    new = found.made.best.path
    assert_allclose(new.point(new.length), path[-1], rtol=0, atol=1e-12)
    # Farther than a rounded corner would be, and the farthest is where it says.
    away, _ = polyline_path(path, "drawn").nearest(found.moved_at[None], 0.0, 20.0)
    assert away[0] == pytest.approx(found.moved, abs=1e-9)
    assert 0.05 < found.moved < 0.6


def test_a_path_that_touches_moves_off_on_its_own_side(arm, room):
    """It grazes the block's left face, 20 mm deep; the arm's half width and the margin it gets."""
    path = drawn([0.0, 0.0, 0.6], [0.27, 0.0, 1.7], [0.27, 0.0, 2.3], [0.0, 0.0, 3.5])
    found = improve_path(arm, room, path, margin=MARGIN)
    assert any("inside block" in words for words in found.before)
    assert "must be 25 mm or more" in found.before[0]
    assert len(found.crossed) == 1
    assert "goes through block from" in found.crossed[0]
    assert "on the side towards (-1.00, 0.00, 0.00)" in found.crossed[0]
    assert found.made.feasible, found.made.failures
    assert not found.same_side  # through it, it had no side
    new = found.made.best.path
    s = np.linspace(new.home_arc_length, new.length, 400)
    assert room.distances(new.point(s)).min() > MARGIN


def test_a_path_through_a_wall_is_told_where(arm):
    wall = PlacedShape("wall", "", Box(20.0, 20.0, 0.3), RigidTransform([0.4, 0.0, 2.0]))
    field = SignedDistanceField.of([wall])
    path = drawn([0.0, 0.0, 0.6], [0.1, 0.0, 3.0])
    found = improve_path(arm, field, path, margin=MARGIN, most_attempts=2)
    assert not found.made.feasible
    assert found.failures[0] == found.crossed[0]
    assert "goes through wall from (0.4" in found.failures[0]
    assert found.failures[0].endswith("no side was found to leave it on")
    assert found.failures[1:] == found.made.failures != ()


def test_what_was_good_stays_about_where_it_was(arm, room):
    path = drawn([0.0, 0.0, 1.5], [0.0, 0.0, 3.0])
    found = improve_path(arm, room, polyline_path(path, "straight"), margin=MARGIN)
    assert found.before == ()
    assert found.made.feasible and found.same_side
    # Repelled by what it passes at 0.25 m, which is within the repulsion's reach.
    assert found.moved < 0.1


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (drawn([0.0, math.nan, 1.0]), "finite"),
        (np.vstack([BASE, TIP]), "must have a point beyond row 2"),
        (np.zeros((3, 2)), "shape"),
        (drawn([0.0, 0.0, 1.0]) + np.array([0.1, 0.0, 0.0]), "off the base line"),
    ],
)
def test_what_is_no_path_is_refused(arm, room, points, words):
    with pytest.raises(InputError, match=words):
        improve_path(arm, room, points, margin=MARGIN)
