"""Sphere and path meet where constructions and brute force say, ends and rounding included."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from pips_drake.serpentine.path_geometry import (
    LENGTH,
    START,
    find_piece,
    nearest_on_path,
    points_and_tangents,
    sphere_line_roots,
    walk_back,
)
from pips_drake.serpentine.tip_path import PathBuilder, TipPath, polyline_path

coordinate = st.floats(-5.0, 5.0)
vector = st.tuples(coordinate, coordinate, coordinate).map(np.array)


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.diag(r))


def winding_path(seed: int) -> TipPath:
    """Lines and arcs of all sizes, turning every way; about 10 m."""
    rng = np.random.default_rng(seed)
    builder = PathBuilder(start=rng.normal(size=3), direction=rng.normal(size=3)).line(2.0)
    for _ in range(6):
        builder.arc(
            radius=rng.uniform(0.2, 1.0), angle=rng.uniform(0.2, 3.0), toward=rng.normal(size=3)
        )
        builder.line(rng.uniform(0.05, 0.8))
    return builder.build(f"winding {seed}")


@given(vector, vector, vector)
def test_line_and_sphere_meet_in_the_points_that_made_them(centre, aside, other):
    """Two points of a sphere span a chord: the roots are the chord's ends."""
    radius = float(np.linalg.norm(aside))
    assume(radius > 0.1 and np.linalg.norm(other) > 0.1)
    first = centre + aside
    second = centre + other / np.linalg.norm(other) * radius
    chord = second - first
    length = float(np.linalg.norm(chord))
    assume(length > 1e-2 * radius)
    real, t1, t2 = sphere_line_roots(*first, *(chord / length), *centre, radius)
    assert real
    # Rounding of 10 m, magnified by radius over half the chord (200 at most).
    assert t1 == pytest.approx(0.0, abs=1e-12)
    assert t2 == pytest.approx(length, abs=1e-12)


def test_a_tangent_line_has_one_root_and_a_passing_line_none():
    assert sphere_line_roots(1.0, -3.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0) == (True, 3.0, 3.0)
    real, t1, t2 = sphere_line_roots(1.01, -3.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    assert not real
    assert math.isnan(t1)
    assert math.isnan(t2)


def test_a_joint_between_pieces_belongs_to_the_earlier_one():
    corners = [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 4.0]]
    table = polyline_path(corners, "p").pieces
    end = table[0, LENGTH]
    assert find_piece(table, end) == 0
    assert find_piece(table, np.nextafter(end, 9.0)) == 1
    assert find_piece(table, -1.0) == 0
    assert find_piece(table, 1e3) == len(table) - 1


@pytest.mark.parametrize("seed", range(5))
def test_points_advance_by_the_arc_length_along_unit_tangents(seed):
    path = winding_path(seed)
    s = np.linspace(0.0, path.length, 4001)[1:-1]
    h = 1e-6
    ahead, _ = points_and_tangents(path.pieces, s + h)
    behind, _ = points_and_tangents(path.pieces, s - h)
    _, tangents = points_and_tangents(path.pieces, s)
    np.testing.assert_allclose(np.linalg.norm(tangents, axis=1), 1.0, atol=1e-14)
    # Curvature jumps by at most 1 / 0.2 m at a joint: h / 2 times that; rounding 1e-15 / h.
    np.testing.assert_allclose((ahead - behind) / (2 * h), tangents, rtol=0, atol=5e-6)


def first_exit(path: TipPath, s: float, radius: float) -> float:
    """Where, going back from `s`, the distance first reaches `radius`: scanning and bisection."""
    centre = path.point(s)
    grid = np.linspace(s, 0.0, 20001)
    outside = np.flatnonzero(np.linalg.norm(path.point(grid) - centre, axis=1) >= radius)
    if outside.size == 0:
        return math.nan
    low, high = grid[outside[0]], grid[outside[0] - 1]
    for _ in range(60):
        middle = 0.5 * (low + high)
        if np.linalg.norm(path.point(middle) - centre) >= radius:
            low = middle
        else:
            high = middle
    return low


@pytest.mark.parametrize("seed", range(8))
def test_the_walk_finds_the_first_point_that_scanning_finds(seed):
    path = winding_path(seed)
    rng = np.random.default_rng(100 + seed)
    for s, radius in zip(rng.uniform(1.0, path.length, 25), rng.uniform(0.1, 0.9, 25), strict=True):
        piece = find_piece(path.pieces, s)
        found, local = walk_back(
            path.pieces, piece, s - path.pieces[piece, START], *path.point(s), radius
        )
        expected = first_exit(path, s, radius)
        # Bisection ends at rounding; where the path leaves the sphere at a grazing angle of down
        # to 1e-3 rad that is magnified a thousandfold.
        assert path.pieces[found, START] + local == pytest.approx(expected, abs=1e-11)


def test_a_path_that_stays_inside_the_sphere_has_no_exit():
    path = winding_path(1)
    piece = len(path.pieces) - 1
    found, local = walk_back(path.pieces, piece, 0.01, *path.point(path.length), 100.0)
    assert found == -1
    assert math.isnan(local)


def test_a_circle_smaller_than_the_sphere_is_passed_over():
    """A loop of 0.3 m inside a sphere of 0.7 m: the exit lies on the line before it."""
    path = (
        PathBuilder(start=[0.0, 0.0, 0.0], direction=[0.0, 0.0, 1.0])
        .line(2.0)
        .arc(radius=0.3, angle=2.0 * math.pi, toward=[1.0, 0.0, 0.0])
        .build("loop")
    )
    found, local = walk_back(path.pieces, 1, path.pieces[1, LENGTH], *path.point(path.length), 0.7)
    assert found == 0
    assert local == pytest.approx(1.3, abs=1e-14)


# A vertex exactly one module length away, seen from a point on the piece after it. The strict
# inequalities of FTL-95 section 3.3.2.2 lose it; here both pieces that meet there may find it.


@pytest.mark.parametrize("radius", [0.3, 1.0 / 3.0, 0.34055, 0.5386338, 0.7])
@pytest.mark.parametrize("bend_deg", [0.0, 1e-6, 0.1, 5.0, 30.0, 89.0])
def test_a_vertex_exactly_one_module_length_away_is_found(radius, bend_deg):
    rng = np.random.default_rng(18)
    bend = math.radians(bend_deg)
    for _ in range(100):
        turn, shift = random_rotation(rng), rng.normal(size=3)
        corners = np.array(
            [
                [-2.0 * math.cos(bend), 2.0 * math.sin(bend), 0.0],
                [0.0, 0.0, 0.0],
                [radius, 0.0, 0.0],
                [radius + 0.4, 0.1, 0.0],
            ]
        )
        vertices = corners @ turn.T + shift
        path = polyline_path(vertices, "corner")
        joints = path.pieces[:, START]
        # The sphere stands on vertex 2, which ends one piece and begins the next: try both; and
        # the radius is the drawn one, the distance as rounded, and one rounding either way.
        rounded = float(np.linalg.norm(vertices[2] - vertices[1]))
        for reach in (radius, rounded, np.nextafter(rounded, 0), np.nextafter(rounded, 9)):
            for piece, local in ((1, path.pieces[1, LENGTH]), (2, 0.0)):
                found, where = walk_back(path.pieces, piece, local, *vertices[2], reach)
                assert found in (0, 1)
                s = path.pieces[found, START] + where
                # The vertex to within rounding of metres; seen from it at `bend` degrees off the
                # sphere's normal, which magnifies by 1 / cos(89 deg) = 57.
                assert s == pytest.approx(joints[1], abs=1e-13)


@pytest.mark.parametrize("radius", [0.3, 1.0 / 3.0, 0.34055, 0.5386338, 0.7])
def test_the_paths_very_start_one_module_length_away_is_found(radius):
    rng = np.random.default_rng(4)
    for _ in range(200):
        direction = random_rotation(rng)[0]
        start = rng.normal(size=3)
        path = polyline_path([start, start + radius * direction, start + direction], "start")
        for piece, local in ((0, path.pieces[0, LENGTH]), (1, 0.0)):
            found, where = walk_back(
                path.pieces, piece, local, *(start + radius * direction), path.pieces[0, LENGTH]
            )
            assert found == 0
            assert where == pytest.approx(0.0, abs=1e-15 + 1e-12 * radius)


@pytest.mark.parametrize("angle_deg", [20.0, 60.0, 90.0])
def test_the_joint_of_line_and_arc_one_module_length_away_is_found(angle_deg):
    rng = np.random.default_rng(7)
    for _ in range(100):
        basis = random_rotation(rng)
        path = (
            PathBuilder(start=rng.normal(size=3), direction=basis[0])
            .line(1.0)
            .arc(radius=0.7, angle=math.radians(angle_deg), toward=basis[1])
            .line(0.5)
            .build("joint")
        )
        end = path.pieces[2, START]
        # From the arc's end its beginning is one chord away: 2 r sin(angle / 2).
        chord = 1.4 * math.sin(0.5 * math.radians(angle_deg))
        for piece, local in ((1, path.pieces[1, LENGTH]), (2, 0.0)):
            found, where = walk_back(path.pieces, piece, local, *path.point(end), chord)
            assert path.pieces[found, START] + where == pytest.approx(1.0, abs=1e-13)


@pytest.mark.parametrize("seed", range(6))
def test_nearest_point_is_the_one_that_dense_sampling_finds(seed):
    path = winding_path(seed)
    rng = np.random.default_rng(seed)
    n = 40
    around = path.point(rng.uniform(0.0, path.length, n)) + rng.normal(size=(n, 3)) * 0.4
    low = rng.uniform(0.0, 0.8 * path.length, n)
    high = low + rng.uniform(0.01, 0.5, n) * (path.length - low)
    distance, where = nearest_on_path(path.pieces, around, low, high)
    for i in range(n):
        grid = np.linspace(low[i], high[i], 5001)
        sampled = np.linalg.norm(path.point(grid) - around[i], axis=1).min()
        # A sample lies within half a spacing of the true nearest point.
        assert distance[i] <= sampled + 1e-14
        assert sampled <= distance[i] + 0.5 * (grid[1] - grid[0])
        assert low[i] - 1e-12 <= where[i] <= high[i] + 1e-12
        gap = np.linalg.norm(path.point(where[i]) - around[i])
        assert gap == pytest.approx(distance[i], abs=1e-13)


def test_points_of_the_path_are_their_own_nearest():
    path = winding_path(3)
    s = np.linspace(0.0, path.length, 500)
    distance, _ = nearest_on_path(
        path.pieces, path.point(s), np.zeros(s.size), np.full(s.size, path.length)
    )
    assert distance.max() < 1e-14
