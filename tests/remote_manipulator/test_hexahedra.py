"""The report's hexahedra: notation, words, outlines, and every known way in which its test errs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pips_drake.remote_manipulator.convex_bodies import ConvexBody, exact_collision
from pips_drake.remote_manipulator.hexahedra import (
    EDGE,
    FACE_NAMES,
    VERTEX_OF_FIRST,
    VERTEX_OF_SECOND,
    box_vertices,
    face_planes,
    location_words,
    report_collision,
    separates,
    separating_planes,
)
from pips_drake.remote_manipulator.polyhedra import HEXAHEDRON_EDGES, HEXAHEDRON_FACES

UPRIGHT = np.eye(3)
CUBE = box_vertices([1.0, 1.0, 1.0], UPRIGHT, [0.0, 0.0, 0.0])


def box(half, place, yaw=0.0, pitch=0.0):
    R = Rotation.from_euler("zy", [yaw, pitch], degrees=True).as_matrix()
    return box_vertices(half, R, place)


def faces_of(word):
    """The letters of a location word."""
    return "".join(name for k, name in enumerate(FACE_NAMES) if word >> (5 - k) & 1)


def turns(rng, count):
    return Rotation.random(count, random_state=rng).as_matrix()


def boxes_of_like_size(rng, count):
    sizes = rng.uniform(0.5, 1.0, (2, count, 3))
    place = rng.uniform(-2.0, 2.0, (count, 3))
    one = box_vertices(sizes[0], turns(rng, count), np.zeros(3))
    return one, box_vertices(sizes[1], turns(rng, count), place)


def bars_near_boxes(rng, count):
    """Thin bars against boxes, brought to a gap or depth of 1e-6 to 0.1 m."""
    thin = np.column_stack([rng.uniform(1.0, 2.0, count), rng.uniform(0.02, 0.1, (count, 2))])
    one = box_vertices(thin, turns(rng, count), np.zeros(3))
    place = rng.uniform(-1.0, 1.0, (count, 3))
    two = box_vertices(rng.uniform(0.3, 0.8, (count, 3)), turns(rng, count), place)
    found = exact_collision(one, two)
    gap = 10.0 ** rng.uniform(-6.0, -1.0, count) * rng.choice([-1.0, 1.0], count)
    return one + (found.normal * (gap - found.separation)[:, None])[:, None], two


def test_faces_are_where_their_letters_say():
    planes = face_planes(CUBE)[0]
    normals = dict(zip(FACE_NAMES, planes[:, :3].tolist(), strict=True))
    # z is down: c is the top.
    assert normals["c"] == [0, 0, -1]
    assert normals["d"] == [0, 0, 1]
    assert normals["b"] == [0, 1, 0]
    assert normals["e"] == [0, -1, 0]
    assert normals["a"] == [-1, 0, 0]
    assert normals["f"] == [1, 0, 0]
    np.testing.assert_array_equal(planes[:, 3], 1.0)
    assert CUBE[0, 0].tolist() == [-1.0, -1.0, -1.0]  # vertex 1
    edges = {frozenset(edge) for edge in (HEXAHEDRON_EDGES + 1).tolist()}
    bottom = set((HEXAHEDRON_FACES[FACE_NAMES.index("d")] + 1).tolist())
    for edge in ({2, 4}, {6, 8}):  # those of face d that AQFTST looks at
        assert edge in edges
        assert edge <= bottom
    # The same planes for a body of the exact test.
    np.testing.assert_array_equal(ConvexBody.box([1.0, 1.0, 1.0]).planes, planes)


def test_a_location_word_names_the_faces_that_look_at_the_vertex():
    points = np.array(
        [[0, 0, 0], [-2, 0, 0], [0, 2, 0], [0, 0, -2], [0, 0, 2], [0, -2, 0], [2, 0, 0], [2, 2, -2]]
    )
    words = location_words(points[None], face_planes(CUBE))[0]
    assert [faces_of(word) for word in words] == ["", *FACE_NAMES, "bcf"]
    # A vertex on a face is on its FALSE side: it touches.
    assert location_words(CUBE, face_planes(CUBE)).tolist() == [[0] * 8]


def test_a_vertex_in_the_other_is_found_either_way_round():
    corner_in = box([1.0, 1.0, 1.0], [1.5, 1.5, 1.5])
    assert report_collision(corner_in, CUBE).collides[0]
    small = box([0.2, 0.2, 0.2], [0.0, 0.0, -1.1])
    for first, second, test in ((small, CUBE, VERTEX_OF_FIRST), (CUBE, small, VERTEX_OF_SECOND)):
        found = report_collision(first, second)
        assert found.collides[0]
        assert found.test[0] == test
        assert np.isnan(found.plane[0]).all()
        assert not found.verified[0]


def test_a_face_with_all_vertices_outside_is_the_plane_and_the_first_is_on_its_true_side():
    above = box([0.3, 0.3, 0.3], [0.0, 0.0, -1.5], yaw=20.0)
    found = report_collision(above, CUBE)
    assert found.test[0] == VERTEX_OF_FIRST
    np.testing.assert_allclose(found.plane[0], [0, 0, -1, 1], atol=1e-15)  # face c
    # Over a corner, turned by 45 deg: the small one's face is between.
    beside = box([0.3, 0.3, 2.0], [1.3, 1.3, 0.0], yaw=45.0)
    turned = report_collision(CUBE, beside)
    assert turned.test[0] == VERTEX_OF_FIRST
    found = report_collision(beside, CUBE)
    assert found.test[0] == VERTEX_OF_SECOND
    half = np.sqrt(0.5)
    np.testing.assert_allclose(found.plane[0], [half, half, 0.0, 1.3 * 2 * half - 0.3], atol=1e-15)
    np.testing.assert_allclose(turned.plane[0], -found.plane[0], atol=1e-15)
    assert found.verified[0]
    assert turned.verified[0]


def test_a_plate_with_a_bar_through_its_middle_is_missed_one_way_round():
    plate = box([1.0, 1.0, 0.05], [0.0, 0.0, 0.0])
    bar = box([0.1, 0.1, 1.0], [0.2, 0.1, 0.0], yaw=10.0)
    assert exact_collision(plate, bar).collides[0]
    assert exact_collision(plate, bar).separation[0] == pytest.approx(-0.9, abs=0.15)
    assert report_collision(bar, plate).collides[0]
    assert report_collision(bar, plate).test[0] == EDGE
    missed = report_collision(plate, bar)
    assert not missed.collides[0]
    # It even hands on a plane; that plane cuts both, and none is made up instead.
    assert not missed.verified[0]
    assert np.isnan(separating_planes(plate, bar)).all()


def test_an_edge_that_would_pierce_a_face_if_prolonged_is_called_a_hit():
    place, cube = [-1.3, -0.4, -1.3], box([0.5, 0.5, 0.5], [0.0, 0.0, 0.0])
    bar = box([1.0, 0.2, 0.2], place, yaw=30.0, pitch=-45.0)
    found = report_collision(bar, cube)
    assert found.collides[0]
    assert found.test[0] == EDGE
    apart = exact_collision(bar, cube)
    assert apart.separation[0] == pytest.approx(0.165, abs=1e-3)
    assert separates(apart.plane, bar, cube)[0]
    # The bar three times as long is a hit.
    longer = box([3.0, 0.2, 0.2], place, yaw=30.0, pitch=-45.0)
    assert exact_collision(longer, cube).collides[0]


def test_an_edge_that_only_touches_the_outline_is_no_hit():
    """All products must be below zero: at zero the edge lies in a plane through the outline."""
    touching = box([1.0, 0.1, 3.0], [2.0, 0.0, 0.0])
    found = report_collision(touching, CUBE)
    assert found.test[0] == EDGE
    assert not found.collides[0]
    np.testing.assert_allclose(found.plane[0], [1.0, 0.0, 0.0, 1.0], atol=1e-15)
    assert found.verified[0]
    deeper = report_collision(touching - [1e-9, 0.0, 0.0], CUBE)
    assert deeper.collides[0]
    assert deeper.test[0] == EDGE


def test_a_plane_that_does_not_separate_is_replaced():
    bar = box([1.0, 0.2, 0.2], [0.2, -0.9, 1.0], yaw=-45.0, pitch=45.0)
    cube = box([0.5, 0.5, 0.5], [0.0, 0.0, 0.0])
    found = report_collision(bar, cube)
    assert not found.collides[0]
    assert found.test[0] == EDGE
    assert not found.verified[0]
    # By the vertices of the first, as the plane touches an outline of the second.
    heights = bar[0] @ found.plane[0, :3] - found.plane[0, 3]
    assert heights.min() < -0.1
    handed = separating_planes(bar, cube)
    assert separates(handed, bar, cube)[0]
    np.testing.assert_array_equal(handed, exact_collision(bar, cube).plane)


@pytest.mark.parametrize("family", [boxes_of_like_size, bars_near_boxes])
def test_planes_that_are_handed_on_separate_all_that_is_apart(family):
    first, second = family(np.random.default_rng(1), 2000)
    exact = exact_collision(first, second)
    planes = separating_planes(first, second)
    clear = exact.separation > 1e-9
    assert separates(planes, first, second)[clear].all()
    assert np.isnan(planes[exact.separation < -1e-8]).all()
    np.testing.assert_allclose(np.linalg.norm(planes[clear, :3], axis=1), 1.0, atol=1e-14)
    # Where both vertex tests leave no doubt, the report is right.
    reported = report_collision(first, second)
    sure = reported.test != EDGE
    np.testing.assert_array_equal(reported.collides[sure], exact.collides[sure])
    assert 0.05 < sure.mean() < 0.95


def test_frusta_are_hexahedra_too():
    narrow = CUBE * np.where(CUBE[..., 2:] > 0.0, 1.0, [0.3, 0.3, 1.0])
    # Over where the planes of all four sides have crossed a vertex sees five faces.
    over = np.tile([0.0, 0.0, -3.0], (1, 8, 1))
    assert faces_of(location_words(over, face_planes(narrow))[0, 0]) == "abcef"
    through = report_collision(box([0.05, 0.05, 3.0], [0.0, 0.0, 0.0]), narrow)
    assert through.collides[0]
    assert through.test[0] == EDGE
    rng = np.random.default_rng(2)
    count = 500
    first = narrow @ np.swapaxes(turns(rng, count), 1, 2) + rng.uniform(-2.5, 2.5, (count, 1, 3))
    second = np.repeat(narrow, count, axis=0)
    exact = exact_collision(first, second)
    planes = separating_planes(first, second)
    np.testing.assert_array_equal(separates(planes, first, second), ~exact.collides)
    assert 0.2 < exact.collides.mean() < 0.8


def test_pairs_do_not_know_each_other():
    first, second = boxes_of_like_size(np.random.default_rng(3), 50)
    together = report_collision(first, second)
    for k in range(50):
        alone = report_collision(first[k : k + 1], second[k : k + 1])
        assert alone.collides[0] == together.collides[k]
        assert alone.test[0] == together.test[k]
        np.testing.assert_allclose(alone.plane[0], together.plane[k], atol=1e-14)
    none = report_collision(np.empty((0, 8, 3)), np.empty((0, 8, 3)))
    assert none.plane.shape == (0, 4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("family", "reverse", "missed", "alarms", "planes"),
    [
        # Pairs of 20,000 that are missed and falsely called hits; share of the edge test's planes
        # that separate.
        (boxes_of_like_size, False, 0, 140, 0.43),
        (boxes_of_like_size, True, 0, 140, 0.43),
        (bars_near_boxes, False, 0, 1, 0.25),
        (bars_near_boxes, True, 25, 40, 0.29),
    ],
)
def test_how_often_the_report_errs(family, reverse, missed, alarms, planes):
    first, second = family(np.random.default_rng(7), 20_000)
    if reverse:
        first, second = second, first
    found, exact = report_collision(first, second), exact_collision(first, second)
    misses = (exact.collides & ~found.collides).sum()
    false = (found.collides & ~exact.collides).sum()
    by_edges = ~found.collides & (found.test == EDGE) & ~exact.collides
    share = found.verified[by_edges].mean()
    print(
        f"{family.__name__}, {'second' if reverse else 'first'} first: of {exact.collides.sum()} "
        f"that meet {misses} missed, of {(~exact.collides).sum()} apart {false} called hits; "
        f"{100 * share:.0f} % of {by_edges.sum()} planes of edges separate"
    )
    # Counts of rare cases scatter by their root.
    assert abs(misses - missed) <= 4.0 * np.sqrt(missed + 1.0)
    assert abs(false - alarms) <= 4.0 * np.sqrt(alarms + 1.0)
    assert share == pytest.approx(planes, abs=0.05)
