"""Where a segment meets a sphere: the report's four cases."""

from __future__ import annotations

import numpy as np
import pytest

from pips_drake.errors import InputError
from pips_drake.serpentine.follow_the_leader import intersect_sphere_segment


def case(first, second, radius):
    return intersect_sphere_segment(first, second, [0.0, 0.0, 0.0], radius)


def test_a_segment_through_the_sphere_has_two_intersections():
    found = case([-2.0, 0.0, 0.0], [2.0, 0.0, 0.0], 1.0)
    assert found.t == pytest.approx((0.25, 0.75), abs=1e-15)
    assert found.on_segment == (True, True)
    assert not found.tangent


def test_a_segment_with_an_end_inside_has_one():
    found = case([-2.0, 0.0, 0.0], [0.0, 0.0, 0.0], 1.0)
    assert found.t == pytest.approx((0.5, 1.5), abs=1e-15)
    assert found.on_segment == (True, False)


def test_a_touching_segment_is_tangent():
    found = case([-1.0, 1.0, 0.0], [1.0, 1.0, 0.0], 1.0)
    assert found.t == (0.5, 0.5)
    assert found.tangent
    assert found.on_segment == (True, True)


def test_a_segment_that_misses_has_none():
    found = case([-1.0, 1.5, 0.0], [1.0, 1.5, 0.0], 1.0)
    assert np.all(np.isnan(found.t))
    assert found.on_segment == (False, False)
    assert not found.tangent
    inside = case([-0.5, 0.0, 0.0], [0.5, 0.0, 0.0], 1.0)
    assert inside.on_segment == (False, False)


def test_ends_on_the_sphere_count():
    rng = np.random.default_rng(5)
    for _ in range(200):
        first = rng.normal(size=3)
        radius = float(np.linalg.norm(first))
        found = case(first, -0.5 * first + 0.1 * rng.normal(size=3), radius)
        assert found.on_segment[0]
        found = case(0.3 * rng.normal(size=3) * radius / 3.0, first, radius)
        assert found.on_segment[1]


def test_a_segment_of_no_length_is_refused():
    with pytest.raises(InputError, match="same point"):
        case([1.0, 0.0, 0.0], [1.0, 0.0, 0.0], 1.0)
