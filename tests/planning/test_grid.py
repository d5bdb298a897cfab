"""Grids: coordinates there and back, costs as lengths in the world, cells free as defined."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.geometry import Box, Cylinder, Sphere
from pydrake.math import RigidTransform
from scipy.ndimage import binary_erosion
from scipy.spatial.transform import Rotation

from pips_drake.errors import InputError
from pips_drake.planning.grid import STEPS, Grid
from pips_drake.planning.occupancy import BLOCKED, INNER, Occupancy
from pips_drake.scene.packages import find_scene_file
from pips_drake.scene.signed_distance import (
    PlacedShape,
    SignedDistanceField,
    read_distance_field,
)

R, P = Rotation.from_euler("xyz", [0.3, -0.7, 1.1]).as_matrix(), np.array([1.0, -2.0, 0.5])


def cartesian(**changes):
    numbers = {"lower": [-1.0, -2.0, 0.0], "upper": [1.0, 1.5, 4.0], "shape": (20, 25, 33)}
    return Grid(**(numbers | {"rotation": R, "origin": P} | changes))


def unfolded(**changes):
    numbers = {"lower": [-2.0, -np.pi, 0.4], "upper": [3.0, np.pi, 1.5], "shape": (30, 40, 11)}
    return Grid(**(numbers | {"unfolded": True, "rotation": R, "origin": P} | changes))


@pytest.mark.parametrize(
    "grid", [cartesian(), unfolded(), unfolded(lower=[-2.0, 1.0, 0.4], upper=[3.0, 5.0, 1.5])]
)
def test_coordinates_go_to_the_world_and_back(grid):
    rng = np.random.default_rng(1)
    q = rng.uniform(grid.lower, grid.upper, (200, 3))
    np.testing.assert_allclose(grid.from_world(grid.to_world(q)), q, atol=1e-12)
    cells = rng.integers(0, grid.shape, (200, 3))
    np.testing.assert_array_equal(grid.cells(grid.centres(cells)), cells)


def test_unfolded_coordinates_are_along_around_and_out():
    grid = Grid(lower=[0, 0, 1], upper=[1, 1, 2], shape=(2, 2, 2), unfolded=True, origin=[9, 0, 0])
    world = grid.to_world([[5.0, np.pi / 2.0, 3.0]])
    np.testing.assert_allclose(world, [[9.0, 3.0, 5.0]], atol=1e-15)


@pytest.mark.parametrize("grid", [cartesian(), unfolded()])
def test_step_costs_are_distances_between_centres(grid):
    rng = np.random.default_rng(2)
    for cell in rng.integers(1, np.array(grid.shape) - 1, (40, 3)):
        lengths = np.linalg.norm(grid.centres(cell + STEPS) - grid.centres([cell]), axis=1)
        np.testing.assert_allclose(grid.step_costs[cell[2]], lengths, rtol=1e-12)
        assert lengths.max() <= grid.longest_step * (1.0 + 1e-12)
        bound = np.linalg.norm(STEPS * grid.least_lengths, axis=1)
        assert (bound <= lengths * (1.0 + 1e-12)).all()


def random_field(rng, count=60):
    shapes = []
    for i in range(count):
        rotation = Rotation.random(random_state=rng).as_matrix()
        X_WG = RigidTransform(np.column_stack([rotation, P + rng.uniform(-2.0, 3.0, 3)]))
        a, b, c = rng.uniform(0.1, 0.6, 3)
        shape = (Box(a, b, c), Cylinder(a, b), Sphere(0.5 * a))[i % 3]
        shapes.append(PlacedShape(f"body_{i}", "", shape, X_WG))
    return SignedDistanceField.of(shapes)


@pytest.mark.parametrize("grid", [cartesian(), unfolded()])
def test_cells_are_free_where_every_step_from_them_keeps_the_radius(grid):
    field = random_field(np.random.default_rng(3))
    occupancy = Occupancy.of(field, grid, 0.15)
    every = np.stack(np.meshgrid(*map(np.arange, grid.shape), indexing="ij"), axis=-1)
    distances = field.distances(grid.centres(every.reshape(-1, 3))).reshape(grid.shape)
    expected = distances >= np.hypot(0.15, 0.5 * grid.longest_step)
    assert 0.1 < expected.mean() < 0.95
    np.testing.assert_array_equal(occupancy.free, expected)
    # Between free neighbours, at closely spaced points.
    rng = np.random.default_rng(4)
    cells = every[expected]
    a = cells[rng.integers(0, len(cells), 20000)]
    b = a + STEPS[rng.integers(0, 26, len(a))]
    inside = ((b >= 0) & (b < grid.shape)).all(axis=1)
    a, b = a[inside], b[inside]
    both = occupancy.free[tuple(b.T)]
    a, b = grid.centres(a[both]), grid.centres(b[both])
    least = min(field.distances(a + t * (b - a)).min() for t in np.linspace(0.0, 1.0, 11))
    assert least >= 0.15 - 1e-12


@pytest.mark.parametrize(
    "grid", [cartesian(), unfolded(), unfolded(lower=[-2.0, 1.0, 0.4], upper=[3.0, 5.0, 1.5])]
)
def test_obstacles_that_come_move_and_go_leave_the_same_cells_as_looking_at_all(grid):
    rng = np.random.default_rng(7)
    field = random_field(rng, 30)
    occupancy = Occupancy.of(field, grid, 0.1)
    changed = 0
    for i in range(25):
        before = occupancy.padded
        field = occupancy.field.without_body(str(rng.choice(occupancy.field.bodies)))
        new = random_field(rng, 1).shapes[0]
        X_WG = RigidTransform(
            new.X_WG.rotation(), grid.to_world([rng.uniform(grid.lower, grid.upper)])[0]
        )
        if rng.random() < 0.8:
            field = field.with_shapes([PlacedShape(f"new_{i}", "", new.shape, X_WG)])
        occupancy = occupancy.updated(field)
        np.testing.assert_array_equal(occupancy.padded, Occupancy.of(field, grid, 0.1).padded)
        changed += not np.array_equal(before, occupancy.padded)
    assert changed > 5
    assert occupancy.updated(field).field is field


def test_inner_cells_are_those_among_free_ones_alone():
    occupancy = Occupancy.of(random_field(np.random.default_rng(8)), cartesian(), 0.1)
    free = occupancy.padded != BLOCKED
    expected = binary_erosion(free, np.ones((3, 3, 3)))
    assert 0.05 < expected.mean() < 0.9
    np.testing.assert_array_equal(occupancy.padded == INNER, expected)


def test_cells_of_the_cargo_bay_are_those_that_distances_say():
    field = read_distance_field(find_scene_file("cargo_bay"))
    grid = Grid(
        lower=[-2.29, -2.29, -0.2],
        upper=[2.29, 2.29, 18.4],
        shape=(60, 60, 100),
        origin=[-1.621, 0.0, 4.695],
    )
    free = Occupancy.of(field, grid, 0.1).free
    rng = np.random.default_rng(5)
    cells = rng.integers(0, grid.shape, (20000, 3))
    expected = field.distances(grid.centres(cells)) >= np.hypot(0.1, 0.5 * grid.longest_step)
    np.testing.assert_array_equal(free[tuple(cells.T)], expected)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"lower": [0.0, np.nan, 0.0]}, r"grid lower = \[0.0, nan, 0.0\]; must be three finite"),
        ({"upper": [1.0, -3.0, 4.0]}, "every upper limit must be above"),
        ({"shape": (10, 0, 10)}, r"grid of \(10, 0, 10\) cells; must be three numbers of 1 or"),
        ({"shape": (10000, 10000, 10)}, "100000000 cells at most"),
    ],
)
def test_limits_and_shapes_that_are_no_grid_are_refused(changes, words):
    with pytest.raises(InputError, match=words):
        cartesian(**changes)


def test_unfolded_grids_turn_once_at_most_and_stay_off_the_axis():
    with pytest.raises(InputError, match=r"around = 6.5 rad; must be a whole turn at most"):
        unfolded(lower=[0.0, 0.0, 1.0], upper=[1.0, 6.5, 2.0])
    with pytest.raises(InputError, match=r"grid out from 0.0 m; must be > 0"):
        unfolded(lower=[0.0, 0.0, 0.0], upper=[1.0, 1.0, 2.0])
    assert unfolded().periodic
    assert not unfolded(lower=[0.0, 0.0, 1.0], upper=[1.0, 6.0, 2.0]).periodic


def test_an_arm_without_a_radius_is_refused():
    with pytest.raises(InputError, match=r"arm's radius = 0.0 m; must be > 0"):
        Occupancy.of(random_field(np.random.default_rng(6)), cartesian(), 0.0)
