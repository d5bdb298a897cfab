"""The snake: its step solves what it says, its energy falls, nails hold, and it rests mid-gap."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import block_diag
from scipy.optimize import minimize

from pips_drake.errors import InputError
from pips_drake.planning import snake_motion
from pips_drake.planning.potential_field import Repulsion
from pips_drake.planning.snake import (
    SnakeSettings,
    curvatures,
    keep_spacing,
    link_curvature_limit,
    make_snake,
    move_goal,
    nail,
)
from pips_drake.planning.snake_motion import settle

SETTINGS = SnakeSettings(tension=2.0, bending_stiffness=0.05, spacing=0.1)
COARSE = SnakeSettings(spacing=0.37 * (1.0 + 1e-12))
REPULSION = Repulsion(strength=0.02, reach=0.4, clamp=0.02)
INNER, OUTER = 1.8, 2.286


def gap(points):
    """Distances to two cylinders around x, and their gradients."""
    r = np.hypot(points[:, 1], points[:, 2])
    outward = np.zeros_like(points)
    outward[:, 1:] = points[:, 1:] / r[:, None]
    return np.stack([r - INNER, OUTER - r], axis=-1), np.stack([outward, -outward], axis=1)


def ball(points):
    """Distance to a sphere of radius 0.3 at (1, 0.05, 0)."""
    way = points - [1.0, 0.05, 0.0]
    r = np.linalg.norm(way, axis=-1)
    return (r - 0.3)[:, None], (way / r[:, None])[:, None, :]


def free(points):
    return np.full((len(points), 1), 10.0), np.zeros((len(points), 1, 3))


def around(turn=2.4, length=6.0, out=0.06, count=40):
    """A path that hugs the inner cylinder."""
    angle = np.linspace(0.0, turn, count)
    r = INNER + out
    x = np.linspace(0.0, length, count)
    return np.stack([x, r * np.cos(angle), r * np.sin(angle)], axis=-1)


def crooked(rng, count=12):
    path = rng.normal(0.0, 0.3, (count, 3))
    path[:, 0] += np.linspace(0.0, 3.0, count)
    return path


def whole_energy(flat, snake, field):
    """Written from the module's equations with whole-array differences."""
    v, h = flat.reshape(-1, 3), snake.settings.spacing
    alpha = 0.5 * (snake.tension[1:] + snake.tension[:-1])
    first = (alpha[:, None] * np.diff(v, axis=0) ** 2).sum() / (2.0 * h)
    second = np.diff(v, n=2, axis=0) ** 2
    bending = (snake.bending_stiffness[1:-1, None] * second).sum() / (2.0 * h**3)
    distance, _ = field(v)
    return first + bending + h * REPULSION.energy(distance).sum()


def test_the_force_of_the_field_is_the_numeric_gradient_of_its_energy():
    rng = np.random.default_rng(3)
    points = make_snake(around(), SETTINGS).points
    points = points + rng.normal(0.0, 0.02, points.shape)
    distance, gradient = gap(points)
    force = np.einsum("ij,ijk->ik", REPULSION.push(distance), gradient)
    step = 1e-6
    for axis in range(3):
        shift = np.eye(3)[axis] * step
        up, down = (REPULSION.energy(gap(points + s)[0]).sum(-1) for s in (shift, -shift))
        assert_allclose(force[:, axis], -(up - down) / (2.0 * step), rtol=1e-5, atol=1e-5)


def test_a_step_solves_the_banded_equations_that_a_dense_solver_solves():
    rng = np.random.default_rng(5)
    for count, nails in ((7, []), (30, [4, 5, 17]), (3, []), (4, [])):
        start = make_snake([[0.0, 0.0, 0.0], [0.37 * (count - 1), 0.0, 0.0]], COARSE)
        points = rng.normal(size=(count, 3))
        alpha, beta = rng.uniform(0.1, 2.0, count), rng.uniform(0.0, 1.0, count)
        nailed = start.nailed.copy()
        nailed[nails] = True
        snake = replace(start, points=points, nailed=nailed, tension=alpha, bending_stiffness=beta)
        root, force = rng.normal(size=(count, 3, 3)), rng.normal(size=(count, 3))
        blocks = root @ root.transpose(0, 2, 1)
        felt = snake_motion._Felt(np.zeros((count, 1)), force, blocks, 0.0)
        h, gain = 0.37, 0.3
        one = np.diff(np.eye(count), axis=0)
        two = np.diff(np.eye(count), n=2, axis=0)
        K = one.T @ np.diag(0.5 * (alpha[1:] + alpha[:-1]) / h**2) @ one
        K += two.T @ np.diag(beta[1:-1] / h**4) @ two
        G = block_diag(*(blocks + gain * np.eye(3)))
        left, right = np.kron(K, np.eye(3)) + G, G @ points.ravel() + force.ravel()
        fixed = np.repeat(nailed, 3)
        left[fixed] = np.eye(3 * count)[fixed]
        right[fixed] = points.ravel()[fixed]
        expected = np.linalg.solve(left, right).reshape(-1, 3)
        found = snake_motion._implicit_step(snake, felt, gain)
        # Condition numbers are below 1e4.
        assert_allclose(found, expected, rtol=0, atol=1e-11)
        assert_array_equal(found[nailed], points[nailed])


def test_with_nothing_near_it_becomes_straight_and_evenly_spaced():
    start = make_snake(crooked(np.random.default_rng(7)), SETTINGS)
    done = settle(start, free, REPULSION)
    assert done.stable
    points = done.snake.points
    shares = np.linspace(0.0, 1.0, len(points))[:, None]
    # It rests when steps are below 1e-5 m; slow modes are still somewhat farther away.
    assert_allclose(points, points[0] + shares * (points[-1] - points[0]), rtol=0, atol=1e-3)


@pytest.mark.parametrize("field", [gap, ball])
def test_the_energy_falls_and_ends_where_a_general_minimiser_ends(field):
    path = around() if field is gap else np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    # So wide a band that no point comes or goes, with which the energy would leap.
    settings = SnakeSettings(
        tension=2.0, bending_stiffness=0.05, spacing=0.1, spacing_band=(0.1, 5.0)
    )
    start = make_snake(path, settings)
    done = settle(start, field, REPULSION, tolerance=1e-8)
    assert done.stable
    assert (np.diff(done.energies) <= 1e-11 * done.energies[:-1]).all()
    assert_allclose(done.energies[0], whole_energy(start.points.ravel(), start, field), rtol=1e-12)
    fixed = np.repeat(done.snake.nailed, 3)

    def of_free(x):
        flat = done.snake.points.ravel().copy()
        flat[~fixed] = x
        return whole_energy(flat, done.snake, field)

    there = done.snake.points.ravel()[~fixed]
    found = minimize(of_free, there, method="BFGS", options={"maxiter": 40, "gtol": 1e-7})
    # From where the snake rests, another method finds nothing lower to speak of.
    assert of_free(there) - found.fun < 1e-6 * found.fun


def test_it_rests_with_most_of_the_clearance_that_a_gap_allows():
    """At the ends the given points hold it nearer; so those within the bend are left out."""
    strong = Repulsion(strength=0.1, reach=0.4, clamp=0.02)
    done = settle(make_snake(around(), SETTINGS), gap, strong)
    assert done.stable
    distance = gap(done.snake.points)[0].min(axis=-1)
    inner = (done.snake.arc_lengths > 0.6) & (
        done.snake.arc_lengths[-1] - done.snake.arc_lengths > 0.6
    )
    assert distance[inner].min() > 0.8 * 0.5 * (OUTER - INNER)


def test_nails_and_ends_do_not_move_at_all():
    start = nail(make_snake(around(), SETTINGS), [3.0, 0.9, 1.85])
    nailed = start.points[start.nailed]
    assert len(nailed) == 3
    done = settle(start, gap, REPULSION)
    assert_array_equal(done.snake.points[done.snake.nailed], nailed)


def test_the_operator_pulls_the_nearest_point_as_far_as_tension_gives():
    """A string of tension T, pulled in its middle by F, is a triangle of height F L / (4 T)."""
    settings = SnakeSettings(tension=50.0, bending_stiffness=0.0, spacing=0.1)
    start = make_snake([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]], settings)
    pulls = [([1.0, 0.0, 0.0], [0.0, 4.0, 0.0])]
    done = settle(start, free, REPULSION, pulls=pulls, tolerance=1e-9)
    height = 4.0 * 2.0 / (4.0 * 50.0)
    x = done.snake.points[:, 0]
    expected = height * (1.0 - np.abs(x - 1.0))
    # The floor of the gain only slows steps; what is left is the tolerance over it.
    assert_allclose(done.snake.points[:, 1], expected, rtol=0, atol=1e-5)


@pytest.mark.parametrize(("share", "grows"), [(0.45, True), (0.55, False), (1.0, False)])
def test_a_gain_below_half_of_the_fields_stiffness_is_not_stable(share, grows):
    """The derivation's bound: it overshoots ever farther."""
    stiffness = 400.0
    snake = make_snake([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0]], replace(SETTINGS, tension=0.01))
    n = len(snake.points)
    points = snake.points.copy()
    points[1:-1, 1] = 1e-3 * np.sin(np.arange(1, n - 1) * 2.0)
    snake = replace(snake, points=points, bending_stiffness=np.zeros(n))
    blocks = np.zeros((n, 3, 3))
    blocks[:, 1, 1] = share * stiffness
    for _ in range(60):
        force = np.zeros((n, 3))
        force[:, 1] = -stiffness * snake.points[:, 1]
        felt = snake_motion._Felt(np.zeros((n, 1)), force, blocks, 0.0)
        snake = replace(snake, points=snake_motion._implicit_step(snake, felt, 1e-3))
    assert (np.abs(snake.points[:, 1]).max() > np.abs(points[:, 1]).max()) == grows


def test_points_are_inserted_and_deleted_only_outside_the_band():
    start = make_snake([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], SETTINGS)
    assert keep_spacing(start) is start
    longer = move_goal(start, [1.04, 0.0, 0.0])
    assert keep_spacing(longer) is longer
    longer = move_goal(start, [1.35, 0.0, 0.0])
    spaced = keep_spacing(longer)
    assert spaced.spacings.max() <= 0.15
    for point in longer.points:  # what was there still is
        assert np.linalg.norm(spaced.points - point, axis=-1).min() == 0.0
    shorter = start.points.copy()
    shorter[1:-1, 0] *= 0.4
    shorter = keep_spacing(replace(start, points=shorter, nailed=start.nailed))
    assert shorter.spacings.min() >= 0.05
    assert shorter.spacings.max() <= 0.15


def test_a_nailed_point_is_never_deleted():
    start = make_snake([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], SETTINGS)
    nailed = nail(start, [0.31, 0.0, 0.0])
    points = nailed.points.copy()
    points[4] = points[3] + [0.001, 0.0, 0.0]
    points[2] = points[3] - [0.001, 0.0, 0.0]
    spaced = keep_spacing(replace(nailed, points=points))
    k = np.flatnonzero(spaced.nailed)
    assert_array_equal(spaced.points[k[1]], [0.31, 0.0, 0.0])


def test_weights_along_the_path_make_parts_of_it_stiffer():
    """With all the bending stiffness in one half, the other half takes the bend."""
    path = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]]
    settings = SnakeSettings(tension=0.5, bending_stiffness=0.05, spacing=0.05)
    start = nail(make_snake(path, settings, bending_stiffness=[5.0, 5.0, 0.01, 0.01]), path[1])
    done = settle(start, free, REPULSION)
    bends = curvatures(done.snake.points)
    half = len(bends) // 2
    assert bends[half + 3 :].max() > 3.0 * bends[: half - 3].max()


def test_curvature_of_a_circle_and_of_links_on_it():
    angle = np.linspace(0.0, 2.0, 60)
    circle = 0.7 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=-1)
    # Turn over chord exceeds 1 / R by (step)^2 / 24.
    assert_allclose(curvatures(circle), 1.0 / 0.7, rtol=1e-4)
    # Links of chord length between those points turn by the step at each joint.
    step = angle[1] - angle[0]
    chord = 2.0 * 0.7 * math.sin(0.5 * step)
    assert link_curvature_limit(chord, step) == pytest.approx(1.0 / 0.7, rel=1e-12)


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ([[0.0, 0.0, 0.0]], r"shape \(1, 3\); must be \(2 or more, 3\)"),
        ([[0.0, 0.0], [1.0, 0.0]], r"shape \(2, 2\)"),
        ([[0.0, 0.0, 0.0], [math.nan, 0.0, 0.0]], "must be of finite numbers"),
        ([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]], "start and goal must differ"),
    ],
)
def test_paths_that_are_none_are_refused(path, words):
    with pytest.raises(InputError, match=words):
        make_snake(path, SETTINGS)


@pytest.mark.parametrize(
    "wrong",
    [
        {"tension": 0.0},
        {"bending_stiffness": -1.0},
        {"spacing": math.nan},
        {"spacing_band": (0.6, 1.1)},
    ],
)
def test_settings_that_mean_nothing_are_refused(wrong):
    with pytest.raises(InputError, match="snake "):
        SnakeSettings(**wrong)


def test_weights_nails_and_goals_that_mean_nothing_are_refused():
    start = make_snake(around(), SETTINGS)
    with pytest.raises(InputError, match="tension; must be finite and 0 or more"):
        make_snake(around(), SETTINGS, tension=[1.0, -1.0])
    with pytest.raises(InputError, match="must be three finite numbers"):
        nail(start, [math.nan, 0.0, 0.0])
    with pytest.raises(InputError, match="nearest to an end"):
        nail(start, start.points[0])
    with pytest.raises(InputError, match="must be three finite numbers"):
        move_goal(start, [1.0, 2.0])


def test_nails_nearer_to_each_other_than_the_band_do_not_keep_it_from_resting():
    snake = make_snake([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], SETTINGS)
    nailed = snake.nailed.copy()
    nailed[[4, 5]] = True
    points = snake.points.copy()
    points[5] = points[4] + np.array([0.02, 0.0, 0.0])
    snake = replace(snake, points=points, nailed=nailed)
    spaced = keep_spacing(snake)
    assert keep_spacing(spaced) is spaced
    assert settle(snake, free, REPULSION, max_steps=50).stable
