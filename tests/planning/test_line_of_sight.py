"""Lines of sight: right up to tangency, and no obstacle is thin enough to be missed."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.geometry import Box, Sphere
from pydrake.math import RigidTransform

from pips_drake.planning.line_of_sight import TOLERANCE, is_clear
from pips_drake.scene.signed_distance import PlacedShape, SignedDistanceField


def field_of(*shapes):
    return SignedDistanceField.of(
        PlacedShape(f"body_{i}", "", shape, RigidTransform(np.array(p, dtype=float)))
        for i, (shape, p) in enumerate(shapes)
    )


def segment_to_point(a, b, p):
    """Distance of a point from a segment, m."""
    t = np.clip((p - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
    return np.linalg.norm(a + t * (b - a) - p)


def test_segments_beside_balls_are_clear_exactly_as_far_as_they_are():
    rng = np.random.default_rng(1)
    both = set()
    for _ in range(300):
        centres, radii = rng.uniform(-1.0, 1.0, (4, 3)), rng.uniform(0.05, 0.4, 4)
        field = field_of(*((Sphere(r), c) for r, c in zip(radii, centres, strict=True)))
        a, b = rng.uniform(-2.0, 2.0, (2, 3))
        least = min(segment_to_point(a, b, c) - r for c, r in zip(centres, radii, strict=True))
        if least < 0.01:
            continue
        # The tolerance is all that lies between yes and no.
        for radius, clear in ((least - 1e-12, True), (least + 1.001 * TOLERANCE, False)):
            assert is_clear(field, [a, b], radius) is clear
            both.add(clear)
    assert both == {True, False}


def test_a_segment_along_a_wall_at_just_the_radius_is_clear():
    field = field_of((Box(10.0, 10.0, 1.0), [0.0, 0.0, -0.5]))
    a, b = np.array([-4.0, -3.0, 0.1]), np.array([4.0, 3.0, 0.1])
    assert is_clear(field, [a, b], 0.1)
    assert not is_clear(field, [a, b], 0.1 + 1.001 * TOLERANCE)


def test_thin_things_are_not_stepped_over():
    """A plate of 0.1 mm across a way of 20 m, and a wire of the same beside it."""
    plate = field_of((Box(1e-4, 3.0, 3.0), [7.1234, 0.0, 0.0]))
    assert not is_clear(plate, [[-10.0, 0.3, 0.2], [10.0, -0.1, 0.4]], 1e-3)
    wire = field_of((Box(1e-4, 1e-4, 3.0), [7.1234, 0.02, 0.0]))
    way = [[-10.0, 0.0, 0.0], [10.0, 0.0, 0.0]]
    assert is_clear(wire, way, 0.0199)
    assert not is_clear(wire, way, 0.02)


@pytest.mark.parametrize("length", [0.0, 1e-9, 1.0])
def test_ends_count_and_so_do_points(length):
    field = field_of((Sphere(0.5), [0.0, 0.0, 0.0]))
    assert is_clear(field, [[1.0, 0.0, 0.0], [1.0 + length, 0.0, 0.0]], 0.5)
    assert not is_clear(field, [[0.9, 0.0, 0.0], [0.9 + length, 0.0, 0.0]], 0.5)


def test_inside_an_obstacle_nothing_is_clear_and_without_one_everything():
    field = field_of((Sphere(2.0), [0.0, 0.0, 0.0]))
    assert not is_clear(field, [[0.1, 0.0, 0.0], [0.2, 0.0, 0.0]], 0.1)
    assert is_clear(SignedDistanceField.of([]), [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], 0.1)
