"""The compiled core: spheres fit a path, module angles undo Eq 3.3, rates are derivatives."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pips_drake.serpentine.follow_the_leader import FollowTheLeader
from pips_drake.serpentine.path_file import load_path
from pips_drake.serpentine.path_geometry import find_piece
from pips_drake.serpentine.solver import LANES, module_length
from pips_drake.serpentine.spine_fit import fit_spines, place_tips
from pips_drake.serpentine.tip_path import PathBuilder, TipPath

INCH = 0.0254


def test_a_module_is_the_third_side_of_its_triangle():
    assert module_length(3.0, 4.0, math.pi / 2) == 5.0
    assert module_length(1.0, 2.0, 0.0) == 3.0
    assert module_length(1.0, 2.0, math.pi) == pytest.approx(1.0, abs=1e-15)
    assert module_length(0.0, 2.0, 1.234) == 2.0


def fit(path, s_tips, lengths):
    """Spine points (N, M + 1, 3) m, their arc lengths and the missing modules, of N lanes."""
    lanes, modules = len(s_tips), lengths.shape[1]
    spine, arcs = np.full((modules + 1, 3, lanes), np.nan), np.empty((modules + 1, lanes))
    tip_piece, piece, missing = np.empty((3, lanes), dtype=np.int64)
    place_tips(path.pieces, s_tips, spine, arcs, tip_piece)
    running = np.full(lanes, True)
    fit_spines(path.pieces, tip_piece, lengths.T.copy(), running, spine, arcs, piece, missing)
    return spine.transpose(2, 0, 1), arcs.T, missing


@pytest.mark.parametrize("modules", [1, 7, 11])
@pytest.mark.parametrize("name", ["trajectory_4", "trajectory_4_arcs"])
def test_fitted_spine_points_lie_on_the_path_one_module_length_apart(modules, name):
    path = load_path(name)
    rng = np.random.default_rng(modules)
    s_tips = rng.uniform(path.home_arc_length, path.length, 20)
    lengths = rng.uniform(0.25, 0.4, (20, modules))
    spine, arcs, missing = fit(path, s_tips, lengths)
    np.testing.assert_array_equal(missing, -1)
    for lane in range(20):
        np.testing.assert_allclose(path.point(arcs[lane]), spine[lane], rtol=0, atol=1e-14)
    steps = np.linalg.norm(np.diff(spine, axis=1), axis=2)
    # Rounding of coordinates up to 5 m.
    np.testing.assert_allclose(steps, lengths, rtol=0, atol=1e-14)
    assert np.all(np.diff(arcs, axis=1) > 0.0)
    np.testing.assert_array_equal(arcs[:, -1], s_tips)


def test_a_path_too_short_names_the_module_that_finds_nothing():
    path = (PathBuilder(start=[0, 0, 0], direction=[0, 0, 1]).line(1.0)).build("short")
    # From the tip at 1 m: 0.3 m modules end at 0.7, 0.4, 0.1; the fourth (index 0) does not.
    _, arcs, missing = fit(path, np.array([1.0, 0.5, 1.0]), np.full((3, 4), 0.3))
    np.testing.assert_array_equal(missing, [0, 2, 0])
    # One lane's end does not end the others.
    np.testing.assert_array_equal(arcs[0, 1:], arcs[2, 1:])


@pytest.mark.parametrize("count", [1, 2, LANES - 1, LANES, LANES + 1, 3 * LANES + 5])
def test_a_posture_does_not_depend_on_which_others_are_solved_beside_it(count, arm):
    path = load_path("trajectory_4")
    # Some have no solution, others take two to six iterations.
    s_tips = np.random.default_rng(count).uniform(3.5, path.length, count)
    solver = FollowTheLeader(arm)
    together = solver.solve(path, s_tips)
    for i, s in enumerate(s_tips):
        alone = solver.solve(path, [s])
        assert together.status[i] == alone.status[0]
        assert together.iterations[i] == alone.iterations[0]
        np.testing.assert_array_equal(together.joints[i], alone.joints[0])
        np.testing.assert_array_equal(together.spine_points[i], alone.spine_points[0])
        np.testing.assert_array_equal(together.spine_arc_lengths[i], alone.spine_arc_lengths[0])
        np.testing.assert_array_equal(together.module_lengths[i], alone.module_lengths[0])
        assert together.spine_error[i] == alone.spine_error[0]


def gentle_path() -> TipPath:
    """Lines and wide arcs in several planes, straight for the first 4.45 m."""
    return (
        PathBuilder(start=[16.255 * INCH, 0.0, 0.0], direction=[0.0, 0.0, 1.0])
        .line(174.902 * INCH)
        .arc(radius=0.9, angle=0.6, toward=[1.0, 0.4, 0.0])
        .line(0.2)
        .arc(radius=1.2, angle=0.7, toward=[-1.0, 0.3, 0.2])
        .build("gentle")
    )


@pytest.mark.parametrize(
    "change",
    [
        {},
        dict(mirrored=True),
        dict(base="gimbal"),
        dict(lengths=[20.0, 18.0]),
        dict(lengths=[13.0] * 12, offsets=[1.0] * 12),
        dict(lengths=[15.0] * 8, offsets=[0.0] * 8),
    ],
    ids=lambda change: ", ".join(f"{k} {v}" for k, v in change.items()) or "prototype",
)
def test_rates_are_the_derivatives_of_the_joints(arm_variant, change):
    arm = arm_variant(**change)
    ftl = FollowTheLeader(arm, tolerance=1e-13)
    path = gentle_path()
    if arm.base.kind != 0:  # the gimbal's base line runs above its rail, a0 away
        path = shifted(path, arm.base.offset - path.point(0.0)[0])
    s = np.linspace(path.home_arc_length + 0.001, path.length - 0.001, 60)
    h = 1e-5
    crossing = crosses(ftl, path, s, h)
    assert crossing.sum() < 5
    here, ahead, behind = (ftl.solve(path, s + shift) for shift in (0.0, h, -h))
    assert np.all(here.solved)
    slope = (ahead.joints - behind.joints) / (2.0 * h)
    rates = ftl.rates(path, here.joints, here.spine_arc_lengths)
    # The iteration leaves 1e-13 m: over lengths of 0.3 m and h, 3e-8 rad/m; h^2 f''' is smaller.
    np.testing.assert_allclose(rates[~crossing], slope[~crossing], rtol=0, atol=3e-7)
    # Where a spine point crosses from line to arc the second derivative jumps by up to 10 rad/m^2.
    np.testing.assert_allclose(rates, slope, rtol=0, atol=10.0 * h)


def test_rates_are_the_derivatives_of_the_joints_on_trajectory_4s_arcs(arm):
    ftl, path = FollowTheLeader(arm, tolerance=1e-13), load_path("trajectory_4_arcs")
    s = np.linspace(path.home_arc_length + 0.002, path.length - 0.001, 400)
    h = 1e-5
    crossing = crosses(ftl, path, s, h)
    here, ahead, behind = (ftl.solve(path, s + shift) for shift in (0.0, h, -h))
    slope = (ahead.joints - behind.joints) / (2.0 * h)
    rates = ftl.rates(path, here.joints, here.spine_arc_lengths)
    np.testing.assert_allclose(rates[~crossing], slope[~crossing], rtol=0, atol=3e-7)


def test_rates_of_postures_that_did_not_solve_are_nan(arm):
    ftl, path = FollowTheLeader(arm), load_path("trajectory_4_arcs")
    solution = ftl.solve(path, [1.0, path.length])
    rates = ftl.rates(path, solution.joints, solution.spine_arc_lengths)
    assert np.all(np.isnan(rates[0]))
    assert np.all(np.isfinite(rates[1]))


def shifted(path: TipPath, x: float) -> TipPath:
    pieces = path.pieces.copy()
    pieces[:, 3] += x
    return TipPath(
        name=path.name,
        pieces=pieces,
        home_arc_length=path.home_arc_length,
        marks=path.marks,
    )


def crosses(ftl: FollowTheLeader, path: TipPath, s: np.ndarray, h: float) -> np.ndarray:
    """Tip positions (N,) within `h` of which a spine point goes from one piece to the next."""
    pieces = [
        np.vectorize(lambda at: find_piece(path.pieces, at))(solution.spine_arc_lengths)
        for solution in (ftl.solve(path, s - 2 * h), ftl.solve(path, s + 2 * h))
    ]
    return np.any(pieces[0] != pieces[1], axis=1)
