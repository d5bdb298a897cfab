"""Pulled paths: as short as strings are known to be, clear at every point, never longer."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydrake.geometry import Box, Sphere
from pydrake.math import RigidTransform

from pips_drake.errors import InputError
from pips_drake.planning.grid_search import find_path
from pips_drake.planning.line_of_sight import TOLERANCE
from pips_drake.planning.occupancy import Occupancy
from pips_drake.planning.string_pull import SHARP, pull
from pips_drake.scene.signed_distance import PlacedShape, SignedDistanceField

from .gap import ARM, bare_gap, cartesian_grid, dense, random_pairs, taut_length, unfolded_grid


def length(path):
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def excess_over_the_string(grid, pairs):
    """Of pulled paths in the bare gap over the exact length, as a share."""
    occupancy = Occupancy.of(bare_gap(), grid, ARM)
    shares = []
    for p, q in pairs:
        path = find_path(occupancy, p, q)
        pulled = pull(occupancy.field, path.points, ARM)
        np.testing.assert_array_equal(pulled[[0, -1]], [p, q])
        assert length(pulled) <= path.length
        assert occupancy.field.distances(dense(pulled, 5e-3)).min() >= ARM - TOLERANCE
        shares.append(length(pulled) / taut_length(p, q) - 1.0)
    return np.array(shares)


@pytest.mark.parametrize(
    "grid", [cartesian_grid((60, 60, 200)), unfolded_grid((200, 100, 11))], ids=["xyz", "unfolded"]
)
def test_path_in_a_bare_gap_is_hardly_longer_than_a_string(grid):
    shares = excess_over_the_string(grid, random_pairs(np.random.default_rng(1), 12))
    # A path that is clear but for the tolerance cannot be shorter by more than it allows.
    assert shares.min() >= -1e-4
    assert np.median(shares) <= 0.01
    assert shares.max() <= 0.05


@pytest.mark.slow
@pytest.mark.parametrize("grid", [cartesian_grid(), unfolded_grid()], ids=["xyz", "unfolded"])
def test_hundred_paths_in_a_bare_gap_are_hardly_longer_than_strings(grid):
    shares = excess_over_the_string(grid, random_pairs(np.random.default_rng(2), 100))
    assert shares.min() >= -1e-4
    assert np.median(shares) <= 0.01
    assert shares.max() <= 0.05


def test_string_lies_on_a_rounded_edge():
    """Around the edge of a wall, grown by the radius: two tangents and an arc, in closed form."""
    wall = PlacedShape("wall", "", Box(2.0, 2.0, 20.0), RigidTransform([0.0, -1.0, 0.0]))
    corner = PlacedShape("other", "", Box(2.0, 2.0, 20.0), RigidTransform([-5.0, 9.0, 0.0]))
    field = SignedDistanceField.of([wall, corner])
    radius, edge = 0.3, np.array([1.0, 0.0])
    p, q = np.array([0.2, 0.35, -0.6]), np.array([1.4, -1.5, 0.9])
    clumsy = np.array([p, [0.2, 1.5, -0.6], [2.5, 1.5, 0.3], [2.5, -1.5, 0.9], q])
    pulled = pull(field, clumsy, radius)
    a, b = p[:2] - edge, q[:2] - edge
    la, lb = math.hypot(*a), math.hypot(*b)
    outside = 2.0 * math.pi - math.acos(a @ b / (la * lb))
    turn = outside - math.acos(radius / la) - math.acos(radius / lb)
    assert turn > 0.5
    flat = math.sqrt(la**2 - radius**2) + math.sqrt(lb**2 - radius**2) + radius * turn
    string = math.hypot(flat, q[2] - p[2])
    assert string - 1e-4 <= length(pulled) <= (1.0 + SHARP**2 / 12.0 + 1e-3) * string


def test_free_paths_become_straight():
    ball = PlacedShape("ball", "", Sphere(0.5), RigidTransform([9.0, 9.0, 9.0]))
    field = SignedDistanceField.of([ball])
    wandering = np.random.default_rng(3).uniform(-1.0, 1.0, (40, 3))
    np.testing.assert_array_equal(pull(field, wandering, 0.1), wandering[[0, -1]])


def test_short_and_repeated_points_are_no_trouble():
    field = SignedDistanceField.of([])
    point = np.array([[1.0, 2.0, 3.0]])
    np.testing.assert_array_equal(pull(field, point, 0.1), point)
    np.testing.assert_array_equal(
        pull(field, np.repeat(point, 4, axis=0), 0.1)[[0, -1]], [*point] * 2
    )


def test_pulling_again_changes_little():
    occupancy = Occupancy.of(bare_gap(), unfolded_grid((200, 100, 11)), ARM)
    for p, q in random_pairs(np.random.default_rng(4), 4):
        once = pull(occupancy.field, find_path(occupancy, p, q).points, ARM)
        twice = pull(occupancy.field, once, ARM)
        assert length(once) * (1.0 - 5e-3) <= length(twice) <= length(once)


def test_paths_that_touch_are_refused():
    ball = PlacedShape("ball", "b", Sphere(0.5), RigidTransform())
    field = SignedDistanceField.of([ball])
    with pytest.raises(
        InputError, match=r"path is not clear: .* behind its point 1 .* to ball \(b\)"
    ):
        pull(field, [[-2.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]], 0.1)
    with pytest.raises(InputError, match=r"path of shape \(2,\)"):
        pull(field, [1.0, 2.0], 0.1)
