"""The search: as short as Dijkstra's, clear all the way, and plain about what blocks it."""

from __future__ import annotations

import time

import numpy as np
import pytest
from pydrake.geometry import Box, Sphere
from pydrake.math import RigidTransform
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.transform import Rotation

from pips_drake.errors import InputError
from pips_drake.planning.grid import Grid
from pips_drake.planning.grid_search import NoPathError, find_path, find_path_from_any
from pips_drake.planning.occupancy import Occupancy
from pips_drake.scene.packages import find_scene_file
from pips_drake.scene.signed_distance import (
    PlacedShape,
    SignedDistanceField,
    read_distance_field,
)

from .gap import dense

RADIUS = 0.05


def scattered(rng, count, low, high):
    shapes = []
    for i in range(count):
        rotation = Rotation.random(random_state=rng).as_matrix()
        X_WG = RigidTransform(np.column_stack([rotation, rng.uniform(low, high)]))
        size = rng.uniform(0.1, 0.8, 3)
        shape = Box(*size) if i % 2 else Sphere(0.5 * size[0])
        shapes.append(PlacedShape(f"body_{i}", "", shape, X_WG))
    return SignedDistanceField.of(shapes)


def graph(occupancy):
    """The grid as a sparse matrix: edges between free cells that touch, as long as in the world."""
    grid, free = occupancy.grid, occupancy.free
    cells = np.argwhere(free)
    number = np.full(grid.shape, -1)
    number[free] = np.arange(len(cells))
    centres = grid.centres(cells)
    rows, columns = [], []
    for step in np.ndindex(3, 3, 3):
        near = cells + np.array(step) - 1
        if grid.unfolded:
            near[:, 1] %= grid.shape[1]
        there = ((near >= 0) & (near < grid.shape)).all(axis=1)
        there[there] = free[tuple(near[there].T)]
        other = number[tuple(near[there].T)]
        here = np.flatnonzero(there)
        keep = other != here
        rows.append(here[keep])
        columns.append(other[keep])
    rows, columns = np.concatenate(rows), np.concatenate(columns)
    lengths = np.linalg.norm(centres[rows] - centres[columns], axis=1)
    return csr_array((lengths, (rows, columns)), shape=(len(cells),) * 2), centres


GRIDS = {
    "cartesian": Grid(lower=[0.0, 0.0, 0.0], upper=[2.0, 2.4, 3.0], shape=(30, 24, 36)),
    "thin": Grid(lower=[0.0, 0.0, 0.0], upper=[0.9, 2.4, 3.0], shape=(4, 60, 50)),
    "unfolded": Grid(
        lower=[0.0, -np.pi, 0.9], upper=[3.0, np.pi, 1.5], shape=(40, 60, 10), unfolded=True
    ),
}


@pytest.mark.parametrize("name", GRIDS)
@pytest.mark.parametrize("obstacles", [8, 40])
def test_costs_are_dijkstras_on_random_queries(name, obstacles):
    """60 queries in all; scipy's graph is built from the cells' centres alone."""
    rng = np.random.default_rng(len(name) + obstacles)
    grid = GRIDS[name]
    low, high = ([0, 0, 0], grid.upper) if name != "unfolded" else ([-1.5, -1.5, 0], [1.5, 1.5, 3])
    occupancy = Occupancy.of(scattered(rng, obstacles, low, high), grid, RADIUS)
    matrix, centres = graph(occupancy)
    starts = rng.integers(0, len(centres), 10)
    truth = dijkstra(matrix, indices=starts)
    found = 0
    for start, costs in zip(starts, truth, strict=True):
        goal = rng.integers(0, len(centres))
        if not np.isfinite(costs[goal]):
            with pytest.raises(NoPathError):
                find_path(occupancy, centres[start], centres[goal])
            continue
        path = find_path(occupancy, centres[start], centres[goal])
        assert path.cost == pytest.approx(costs[goal], abs=1e-9)
        assert path.length == pytest.approx(path.cost, abs=1e-9)
        assert occupancy.field.distances(dense(path.points)).min() >= RADIUS - 1e-12
        found += 1
    assert found >= 8


@pytest.mark.parametrize("name", GRIDS)
def test_least_of_many_sources_is_found_with_their_costs(name):
    rng = np.random.default_rng(17)
    grid = GRIDS[name]
    low, high = ([0, 0, 0], grid.upper) if name != "unfolded" else ([-1.5, -1.5, 0], [1.5, 1.5, 3])
    occupancy = Occupancy.of(scattered(rng, 20, low, high), grid, RADIUS)
    matrix, centres = graph(occupancy)
    for _ in range(5):
        starts = rng.integers(0, len(centres), 12)
        costs = rng.uniform(0.0, 2.0, 12)
        goal = rng.integers(0, len(centres))
        totals = costs + dijkstra(matrix, indices=goal)[starts]
        path = find_path_from_any(occupancy, centres[starts], costs, centres[goal])
        assert path.cost == pytest.approx(totals.min(), abs=1e-9)
        assert path.source == int(np.argmin(totals))
        np.testing.assert_array_equal(path.points[0], centres[starts[path.source]])


def test_paths_begin_and_end_where_asked_between_centres():
    occupancy = Occupancy.of(
        scattered(np.random.default_rng(3), 10, [0, 0, 0], [2, 2, 3]), GRIDS["cartesian"], RADIUS
    )
    start, goal = np.array([0.111, 0.222, 0.333]), np.array([1.777, 2.111, 2.777])
    path = find_path(occupancy, start, goal)
    np.testing.assert_array_equal(path.points[[0, -1]], [start, goal])
    assert path.length > path.cost > np.linalg.norm(goal - start) - 0.2
    assert occupancy.field.distances(dense(path.points)).min() >= RADIUS - 1e-5


def box_around(centre, half, thick=0.05):
    """Six plates, closed."""
    plates = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            size = np.full(3, 2.0 * half + 2.0 * thick)
            size[axis] = thick
            at = np.array(centre, dtype=float)
            at[axis] += side * (half + 0.5 * thick)
            plates.append(PlacedShape("cage", f"{axis}{side:+.0f}", Box(*size), RigidTransform(at)))
    return plates


def test_no_way_says_how_near_it_gets_and_what_is_in_the_way():
    field = SignedDistanceField.of(
        [
            *box_around([1.4, 1.2, 1.5], 0.3),
            PlacedShape("far", "ball", Sphere(0.1), RigidTransform([0.3, 2.0, 2.5])),
        ]
    )
    occupancy = Occupancy.of(field, GRIDS["cartesian"], RADIUS)
    goal = [1.4, 1.2, 1.5]
    with pytest.raises(NoPathError, match=r"no way to the goal \(1.4, 1.2, 1.5\) m") as caught:
        find_path(occupancy, [0.2, 0.3, 0.2], goal)
    error = caught.value
    assert {name.split()[0] for name in error.blockers} == {"cage"}
    # Outside the nearest plate's grown face, within two cells of it.
    assert 0.3 + 0.05 + RADIUS <= error.distance < 0.3 + 0.05 + RADIUS + 0.2
    assert error.distance == pytest.approx(np.linalg.norm(error.nearest - goal))
    assert "in the way: cage" in str(error)
    with pytest.raises(NoPathError, match="in the way: cage"):
        find_path(occupancy, goal, [0.2, 0.3, 0.2])


def test_a_gap_that_only_a_finer_grid_passes_is_not_blamed_on_an_obstacle():
    """A slot of 0.14 m for an arm of 0.1 m, with cells of 0.1 m."""
    walls = [
        PlacedShape("wall", f"{side:+}", Box(2.0, 0.1, 3.0), RigidTransform([side * 1.07, 0, 1.5]))
        for side in (-1, 1)
    ]
    field = SignedDistanceField.of(walls)
    ends = [0.0, -0.7, 1.5], [0.0, 0.7, 1.5]
    limits = {"lower": [-0.5, -1.0, 0.0], "upper": [0.5, 1.0, 3.0]}
    coarse = Occupancy.of(field, Grid(shape=(11, 20, 30), **limits), RADIUS)
    with pytest.raises(NoPathError, match=r"no obstacle, but .* a gap too narrow for the grid's"):
        find_path(coarse, *ends)
    fine = Occupancy.of(field, Grid(shape=(51, 100, 150), **limits), RADIUS)
    assert find_path(fine, *ends).length == pytest.approx(1.4, rel=0.03)


@pytest.mark.parametrize(
    ("start", "goal", "words"),
    [
        ([0.2, 0.2, 0.2], [1.0, 1.0, 1.0], r"goal \(1, 1, 1\) m is 0.5 m inside ball \(b\); must"),
        ([1.0, 1.0, 1.52], [0.2, 0.2, 0.2], r"start .* is 0.02 m from ball \(b\); must be 0.05 m"),
        ([0.2, 0.2, 0.2], [0.2, 0.2, 3.5], r"goal \(0.2, 0.2, 3.5\) m is outside the workspace"),
        ([0.2, np.nan, 0.2], [0.2, 0.2, 0.2], r"point = \[0.2, nan, 0.2\] m; must be three fin"),
        ([0.2, 0.2, 0.2], [np.inf, 0.2, 0.2], r"goal = \[inf, 0.2, 0.2\] m; must be three finite"),
    ],
)
def test_points_where_the_arm_cannot_be_are_refused(start, goal, words):
    ball = PlacedShape("ball", "b", Sphere(0.5), RigidTransform([1.0, 1.0, 1.0]))
    occupancy = Occupancy.of(SignedDistanceField.of([ball]), GRIDS["cartesian"], RADIUS)
    with pytest.raises(InputError, match=words):
        find_path(occupancy, start, goal)


@pytest.mark.slow
def test_cargo_bay_of_400_by_120_by_120_cells_is_searched_in_time():
    """Of the processor's time, the least of five: other work on the machine does not count."""
    field = read_distance_field(
        find_scene_file("cargo_bay"), placed_frames={"frame_0": RigidTransform([1.621, 0, -4.695])}
    )
    grid = Grid(lower=[-2.29, -2.29, 0.0], upper=[2.29, 2.29, 18.288], shape=(120, 120, 400))
    port, behind = [2.03, 0.0, 0.3], [-2.04, 0.0, 12.0]

    def least_time(ask):
        times = []
        for _ in range(6):  # the first may compile
            begin = time.process_time()
            ask()
            times.append(time.process_time() - begin)
        return min(times[1:])

    occupancy = Occupancy.of(field, grid, 0.1)
    assert least_time(lambda: find_path(occupancy, port, behind)) < 0.2
    dam = PlacedShape("dam", "", Box(5.0, 5.0, 0.2), RigidTransform([0.0, 0.0, 10.0]))
    blocked = Occupancy.of(field.with_shapes([dam]), grid, 0.1)

    def ask_in_vain():
        with pytest.raises(NoPathError, match="in the way: dam"):
            find_path(blocked, port, behind)

    assert least_time(ask_in_vain) < 2.0
