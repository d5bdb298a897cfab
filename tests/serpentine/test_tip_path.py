"""Paths have the geometry that they were built from, and say how far they are from a table."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import scipy.spatial

from pips_drake.errors import InputError
from pips_drake.serpentine.path_file import load_path
from pips_drake.serpentine.tip_path import PathBuilder, blended_path, polyline_path

INCH = 0.0254
TABLES = [f"trajectory_{i}" for i in (1, 2, 3, 4)]

# A path with corners of 90, 20, 135 and 0 degrees, the first at home.
CORNERS = np.array(
    [
        [0.0, 0.0, 0.0],
        [0.0, 0.0, 4.0],
        [0.5, 0.0, 4.0],
        [0.5 + 0.3 * math.cos(0.349), 0.3 * math.sin(0.349), 4.0],
        [0.5, 0.3, 4.0],
        [0.3, 0.35, 4.3],
        [0.2, 0.375, 4.45],
    ]
)


def distance_to_polyline(points: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """Distance (N,) from points (N, 3) to the polyline through vertices (P, 3)."""
    best = np.full(len(points), np.inf)
    for a, b in itertools.pairwise(vertices):
        t = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(points - a - t[:, None] * (b - a), axis=1))
    return best


def dense_deviation(path, vertices: np.ndarray) -> float:
    """Largest distance between path and polyline from home on, both ways, sampled densely."""
    on_path = path.point(np.linspace(path.home_arc_length, path.length, 20001))
    steps = np.linspace(vertices[1:-1], vertices[2:], 400, axis=1).reshape(-1, 3)
    there = distance_to_polyline(on_path, vertices).max()
    back = scipy.spatial.cKDTree(on_path).query(steps)[0].max()
    return max(there, back)


def test_a_polyline_goes_straight_from_point_to_point():
    path = polyline_path(CORNERS, "corners")
    lengths = np.linalg.norm(np.diff(CORNERS, axis=0), axis=1)
    np.testing.assert_allclose(path.pieces[:, 1], lengths, rtol=1e-15)
    assert path.length == pytest.approx(lengths.sum(), abs=1e-15)
    assert path.home_arc_length == 4.0
    assert path.travel == pytest.approx(lengths[1:].sum(), abs=1e-14)
    np.testing.assert_allclose(path.point(path.marks), CORNERS[1:], rtol=0, atol=1e-15)
    halfway = path.point(4.25)
    np.testing.assert_allclose(halfway, [0.25, 0.0, 4.0], atol=1e-15)
    np.testing.assert_allclose(path.tangent(4.25), [1.0, 0.0, 0.0], atol=1e-15)


def test_a_polylines_corner_angles_are_those_between_its_steps():
    path = polyline_path(CORNERS, "corners")
    steps = np.diff(CORNERS, axis=0)
    units = steps / np.linalg.norm(steps, axis=1)[:, None]
    cosine = np.sum(units[:-1] * units[1:], axis=1)
    # Compared by cosine: arccos would blunt the comparison near 0.
    np.testing.assert_allclose(np.cos(path.corner_angles()), cosine, rtol=0, atol=1e-15)
    assert path.corner_angles()[0] == pytest.approx(math.pi / 2, abs=1e-15)
    assert path.corner_angles()[-1] < 1e-14
    assert not path.is_smooth


def test_a_quarter_circle_ends_a_radius_ahead_and_a_radius_aside():
    path = (
        PathBuilder(start=[1.0, 2.0, 3.0], direction=[0.0, 0.0, 2.0])
        .line(0.5)
        .arc(radius=0.7, angle=math.pi / 2, toward=[5.0, 0.0, 9.0])
        .build("quarter")
    )
    assert path.length == pytest.approx(0.5 + 0.7 * math.pi / 2, abs=1e-15)
    np.testing.assert_allclose(path.point(path.length), [1.7, 2.0, 4.2], atol=1e-15)
    np.testing.assert_allclose(path.tangent(path.length), [1.0, 0.0, 0.0], atol=1e-15)
    # Every point of the arc is a radius from the centre, and the angle grows with arc length.
    s = np.linspace(0.5, path.length, 101)
    angle = (s - 0.5) / 0.7
    expected = [1.7, 2.0, 3.5] + 0.7 * np.column_stack(
        [-np.cos(angle), np.zeros(101), np.sin(angle)]
    )
    np.testing.assert_allclose(path.point(s), expected, atol=1e-15)
    assert path.is_smooth
    assert path.home_arc_length == 0.5


def test_home_is_where_the_builder_says():
    path = (
        PathBuilder(start=[0, 0, 0], direction=[0, 0, 1]).line(1.0).line(0.5).home().line(0.25)
    ).build("home")
    assert path.home_arc_length == 1.5
    assert path.marks.tolist() == [1.5, 1.75]


def test_a_full_circle_comes_back():
    path = (
        PathBuilder(start=[0, 0, 0], direction=[0, 0, 1])
        .line(1.0)
        .arc(radius=0.4, angle=2 * math.pi, toward=[0, 1, 0])
        .build("circle")
    )
    np.testing.assert_allclose(path.point(path.length), [0, 0, 1.0], atol=1e-15)


def test_trajectory_4s_arcs_end_where_its_description_says():
    path = load_path("trajectory_4_arcs")
    # Two quarter circles of 28 and 29 in: 28 ahead, 28 + 29 aside, 29 down; straight 174.902 in.
    end = np.array([16.255 + 28.0 + 29.0, -29.0, 174.902 + 28.0])
    np.testing.assert_allclose(path.point(path.length) / INCH, end, rtol=0, atol=1e-12)
    assert path.travel / INCH == pytest.approx((28.0 + 29.0) * math.pi / 2, abs=1e-11)
    assert path.is_smooth


@pytest.mark.parametrize("name", ["trajectory_1", "trajectory_4"])
def test_arcs_pass_through_the_tables_points_within_its_rounding(name):
    table, arcs = load_path(name), load_path(f"{name}_arcs")
    points = table.point(table.marks)
    gap, where = arcs.nearest(points, 0.0, arcs.length)
    # Three coordinates, each rounded to 0.001 in.
    assert gap.max() / INCH <= 0.0005 * math.sqrt(3.0)
    assert np.all(np.diff(where) > 0.0)
    assert arcs.home_arc_length == pytest.approx(table.home_arc_length, abs=1e-12)
    assert arcs.length == pytest.approx(where[-1], abs=0.001 * INCH)


def test_samples_go_from_home_to_the_end_in_equal_steps():
    path = PathBuilder(start=[0, 0, 0], direction=[0, 0, 1]).line(1.0).line(1.0).build("p")
    even = path.samples(0.25)
    np.testing.assert_allclose(even, [1.0, 1.25, 1.5, 1.75, 2.0], rtol=0, atol=1e-15)
    uneven = path.samples(0.3)
    np.testing.assert_allclose(uneven, [1.0, 1.3, 1.6, 1.9, 2.0], rtol=0, atol=1e-15)
    assert path.samples(10.0).tolist() == [1.0, 2.0]


@pytest.mark.parametrize("step", [0.0, -0.1, math.nan])
def test_samples_refuse_a_step_that_goes_nowhere(step):
    with pytest.raises(InputError, match=r"step = .*must be > 0"):
        polyline_path(CORNERS, "p").samples(step)


@pytest.mark.parametrize("name", ["trajectory_4", "trajectory_4_arcs"])
def test_the_mirrored_path_has_mirrored_points(name):
    path = load_path(name)
    s = np.linspace(0.0, path.length, 300)
    mirrored = path.mirrored()
    np.testing.assert_array_equal(mirrored.point(s), path.point(s) * [1.0, -1.0, 1.0])
    np.testing.assert_array_equal(mirrored.tangent(s), path.tangent(s) * [1.0, -1.0, 1.0])
    assert mirrored.version != path.version
    assert mirrored.mirrored().version == path.version


def test_equal_paths_have_equal_versions_and_others_do_not():
    path = polyline_path(CORNERS, "one name")
    assert polyline_path(CORNERS.copy(), "another name").version == path.version
    moved = CORNERS.copy()
    moved[3, 0] = np.nextafter(moved[3, 0], 9.0)
    assert polyline_path(moved, "one name").version != path.version


def test_shapes_of_queries_are_kept_and_ends_are_extended():
    path = polyline_path(CORNERS, "p")
    assert path.point(np.zeros((2, 5))).shape == (2, 5, 3)
    assert path.tangent(1.0).shape == (3,)
    np.testing.assert_allclose(path.point(-1.0), [0.0, 0.0, -1.0], atol=1e-15)


# Blending


def vertices_of(name: str) -> np.ndarray:
    path = load_path(name)
    return np.vstack([path.point(0.0), path.point(path.marks)])


def blended_cases() -> dict[str, np.ndarray]:
    return {name: vertices_of(name) for name in TABLES} | {"corners": CORNERS}


@pytest.mark.parametrize("name", [*TABLES, "corners"])
@pytest.mark.parametrize("corner_deviation", [math.inf, 2e-3, 1e-5])
def test_a_blended_path_is_smooth_and_keeps_home_and_end(name, corner_deviation):
    vertices = blended_cases()[name]
    path = blended_path(vertices, name, corner_deviation=corner_deviation)
    # Points of some metres round to 1e-15 m; over the shortest arcs (10 micrometres) 1e-10 rad.
    assert path.corner_angles().max() < 1e-9
    ends = path.pieces[:, 0] + path.pieces[:, 1]
    after = np.array([path.point(np.nextafter(s, 99.0)) for s in ends[:-1]])
    np.testing.assert_allclose(path.point(ends[:-1]), after, rtol=0, atol=1e-13)
    np.testing.assert_allclose(path.point(path.home_arc_length), vertices[1], atol=1e-14)
    np.testing.assert_allclose(path.point(path.length), vertices[-1], rtol=0, atol=1e-13)
    # Straight up to home.
    s = np.linspace(0.0, path.home_arc_length, 50)
    assert distance_to_polyline(path.point(s), vertices[:2]).max() < 1e-14


@pytest.mark.parametrize("name", [*TABLES, "corners"])
@pytest.mark.parametrize("corner_deviation", [math.inf, 2e-3])
def test_the_stated_deviation_is_the_one_that_dense_sampling_finds(name, corner_deviation):
    vertices = blended_cases()[name]
    path = blended_path(vertices, name, corner_deviation=corner_deviation)
    # Samples every 0.15 mm are off by half of that where the true distance is nil, and by its
    # square over eight distances elsewhere; 64 samples of an arc miss a maximum by 1e-3 of it.
    found = dense_deviation(path, vertices)
    assert found > 1e-4
    assert path.deviation == pytest.approx(found, rel=2e-3, abs=2e-6)


@pytest.mark.parametrize("name", [*TABLES, "corners"])
@pytest.mark.parametrize("corner_deviation", [5e-3, 1e-3, 1e-4])
def test_a_blended_path_keeps_within_the_corner_deviation(name, corner_deviation):
    vertices = blended_cases()[name]
    path = blended_path(vertices, name, corner_deviation=corner_deviation)
    # Rounding of points some metres away.
    assert path.deviation <= corner_deviation + 1e-13
    # Samples every 0.15 mm miss the nearest point by at most half of that.
    assert dense_deviation(path, vertices) <= np.hypot(corner_deviation, 8e-5)


def test_the_arc_of_a_right_angle_passes_its_corner_at_the_distance_of_the_square():
    """Tangents of t at a right angle: the arc's middle is (sqrt 2 - 1) t from the corner."""
    square = np.array([[0, 0, 0], [0, 0, 1.0], [0, 0, 3.0], [2.0, 0, 3.0]])
    path = blended_path(square, "square")
    assert path.deviation == pytest.approx((math.sqrt(2.0) - 1.0) * 1.0, rel=1e-12)
    narrow = blended_path(square, "square", corner_deviation=0.1)
    assert narrow.deviation == pytest.approx(0.1, rel=1e-12)
    # The shortcut: 2 t becomes an arc of radius t and a quarter turn.
    t = 0.1 / (math.sqrt(2.0) - 1.0)
    assert narrow.length == pytest.approx(5.0 - 2 * t + t * math.pi / 2, rel=1e-12)


@pytest.mark.parametrize("name", [*TABLES, "corners"])
def test_the_marks_of_a_blended_path_are_the_tables_points_in_order(name):
    vertices = blended_cases()[name]
    path = blended_path(vertices, name)
    assert path.marks.shape == (len(vertices) - 1,)
    assert np.all(np.diff(path.marks) > 0.0)
    assert path.marks[0] == pytest.approx(path.home_arc_length, abs=1e-12)
    assert path.marks[-1] == pytest.approx(path.length, abs=1e-12)
    gaps = np.linalg.norm(path.point(path.marks) - vertices[1:], axis=1)
    assert gaps.max() <= path.deviation + 1e-12


@pytest.mark.parametrize("aside", [1e-6, 2.54e-5, 1e-3])
def test_arcs_that_are_all_but_straight_are_circles_all_the_same(aside):
    """Rows rounded to 0.001 in give radii of kilometres, where a direction that is square only to
    1e-12 would bend the circle by nanometres."""
    points = np.array([[0.4, 0.0, 0.0], [0.4, 0.0, 4.0], [0.5, aside, 4.3], [0.6, 0.0, 4.6]])
    blended = blended_path(points, "nearly straight").pieces
    built = PathBuilder(start=[0.0, 0.0, 0.0], direction=[1.0, 2.0, 3.0]).line(1.0)
    built.arc(radius=0.1 / aside, angle=aside, toward=[1.0, 2.0, 3.0 + aside])
    arcs = np.vstack([blended, built.build("built").pieces])
    arcs = arcs[arcs[:, 2] > 0.0]
    assert arcs[:, 2].max() > 0.05 / aside
    u, v = arcs[:, 6:9], arcs[:, 9:12]
    np.testing.assert_allclose(np.sum(u * v, axis=1), 0.0, atol=4e-16)
    np.testing.assert_allclose(np.linalg.norm(u, axis=1), 1.0, rtol=0, atol=4e-16)


def test_blending_a_straight_line_changes_nothing():
    straight = np.array([[0, 0, 0], [0, 0, 4.0], [0, 0, 4.1], [0, 0, 4.3]])
    path = blended_path(straight, "straight")
    assert path.deviation < 1e-15
    assert path.length == pytest.approx(4.3, abs=1e-15)


@pytest.mark.parametrize("corner_deviation", [0.0, -1e-3, math.nan])
def test_blending_refuses_a_deviation_that_leaves_no_room(corner_deviation):
    with pytest.raises(InputError, match=r"corner_deviation = .*must be > 0"):
        blended_path(CORNERS, "corners", corner_deviation=corner_deviation)


# Refusals


@pytest.mark.parametrize(
    ("points", "words"),
    [
        ([[0, 0, 0]], r"shape \(1, 3\)"),
        ([[0, 0], [1, 1]], r"shape \(2, 2\)"),
        ([[0, 0, 0], [0, 0, math.nan]], "finite"),
        ([[0, 0, 0], [0, 0, math.inf]], "finite"),
        ([[0, 0, 0], [0, 0, 1], [0, 0, 1]], "points 2 and 3 are the same"),
    ],
)
def test_points_that_make_no_path_are_refused(points, words):
    with pytest.raises(InputError, match=f"path 'bad': .*{words}"):
        polyline_path(points, "bad")


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda b: b.line(0.0), r"line: length = 0\.0 m; must be > 0"),
        (lambda b: b.line(math.nan), "length = nan"),
        (lambda b: b.arc(radius=-1.0, angle=1.0, toward=[1, 0, 0]), "radius = -1.0 m"),
        (lambda b: b.arc(radius=1.0, angle=7.0, toward=[1, 0, 0]), r"in \(0, 2 pi\]"),
        (lambda b: b.arc(radius=1.0, angle=0.0, toward=[1, 0, 0]), "angle = 0.0 rad"),
        (lambda b: b.arc(radius=1.0, angle=1.0, toward=[0, 0, 3]), "must point aside"),
        (lambda b: b.arc(radius=1.0, angle=1.0, toward=[0, 1]), "toward = .*three finite numbers"),
        (lambda b: b.build("empty"), "no pieces"),
    ],
)
def test_the_builder_refuses_what_is_no_piece(build, words):
    with pytest.raises(InputError, match=words):
        build(PathBuilder(start=[0, 0, 0], direction=[0, 0, 1]))


def test_the_builder_refuses_a_start_or_direction_that_is_none():
    with pytest.raises(InputError, match="direction"):
        PathBuilder(start=[0, 0, 0], direction=[0, 0, 0])
    with pytest.raises(InputError, match="start"):
        PathBuilder(start=[0, 0], direction=[0, 0, 1])
