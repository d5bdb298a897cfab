"""Tensions of a cable robot: the report's example, optimality conditions, HiGHS, QP solvers."""

from __future__ import annotations

import importlib
import itertools

import numpy as np
import pytest
from scipy.optimize import linprog, nnls

from pips_drake.cable_robot.kinematics import cable_vectors, make_poses
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.statics import (
    characteristic_length,
    distribute_tensions,
    general_solution,
    structure_matrix,
    total_wrench,
)
from pips_drake.cable_robot.tension_methods import METHODS
from pips_drake.errors import InputError

from .robots import box_robot, planar_example
from .test_kinematics import some_poses

LOW, HIGH = 20.0, 500.0


def crossed_box() -> CableRobot:
    return box_robot(crossed=True, seed=3)


def robot_of(cables: int, *, seed: int = 0) -> CableRobot:
    rng = np.random.default_rng(seed)
    anchors, attachments = rng.uniform(-4, 4, (cables, 3)), rng.uniform(-0.4, 0.4, (cables, 3))
    return CableRobot(name="random", anchors=anchors, attachments=attachments, mass=20.0)


def concurrent_robot() -> CableRobot:
    """Level, its cables all point at one point: no moment about it can be had."""
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    anchors, attachments = signs * [4, 3, 2], signs * [0.4, 0.3, 0.2]
    return CableRobot(name="concurrent", anchors=anchors, attachments=attachments, mass=20.0)


def highs(A, w, objective, *, low, high, rows=0.0):
    """A linear program of T and one more number s: rows T + s within the bounds, A T + w = 0."""
    cables = A.shape[1]
    eye, one = np.eye(cables), np.ones((cables, 1))
    above = [np.hstack([-eye, rows * one]), np.hstack([eye, rows * one])]
    sides = [np.full(cables, -low), np.full(cables, high)]
    if rows == 0.0:
        above, sides = [*above, np.hstack([eye, -one])], [*sides, np.zeros(cables)]
    kept = np.isfinite(np.concatenate(sides))
    return linprog(
        objective,
        A_ub=np.vstack(above)[kept],
        b_ub=np.concatenate(sides)[kept],
        A_eq=np.hstack([A, np.zeros((len(A), 1))]),
        b_eq=-w,
        bounds=(None, None),
    )


def largest_slack(A, w, low, high):
    found = highs(A, w, np.append(np.zeros(A.shape[1]), -1.0), low=low, high=high, rows=1.0)
    return np.inf if found.status in (3, 4) else -found.fun


def test_the_structure_matrix_is_the_wrench_of_pulls():
    robot, poses = crossed_box(), some_poses(20)
    tensions = np.random.default_rng(2).uniform(0.0, 100.0, (20, 8))
    vectors, arms = cable_vectors(robot, poses)
    pulls = tensions[..., None] * vectors / np.linalg.norm(vectors, axis=2, keepdims=True)
    expected = np.hstack([pulls.sum(axis=1), np.cross(arms, pulls).sum(axis=1)])
    found = (structure_matrix(robot, poses) @ tensions[..., None])[..., 0]
    np.testing.assert_allclose(found, expected, atol=1e-11)  # roundings of hundreds of N


@pytest.mark.parametrize("cables", [6, 7, 8, 12])
def test_the_general_solution_is_the_pseudoinverses_and_an_orthonormal_null_space(cables):
    robot, poses = robot_of(cables), some_poses(20, seed=1)
    solution, A = general_solution(robot, poses), structure_matrix(robot, poses)
    # Conditions are a thousand or so: twelve digits are left.
    for pose in range(20):
        expected = -np.linalg.pinv(A[pose]) @ total_wrench(robot, poses)[pose]
        np.testing.assert_allclose(solution.shortest[pose], expected, rtol=1e-9, atol=1e-9)
        N = solution.null_space(pose)
        assert N.shape == (cables, cables - 6)
        np.testing.assert_allclose(N.T @ N, np.eye(cables - 6), atol=1e-13)
        assert np.abs(A[pose] @ N).max(initial=0.0) < 1e-13
    assert solution.residual.max() < 1e-11


def test_the_planar_example_exactly_with_its_two_misprints():
    """CABLE-96, section 3.2: forces too small by sqrt(5), and half of the moment row."""
    robot, home = planar_example(), make_poses([[0.0, 0.0, 0.0]])
    root = 5**0.5
    A = structure_matrix(robot, home)[0]
    np.testing.assert_allclose(A[:2] * root, [[1, 2, -1, -2], [2, -1, -2, 1]], rtol=1e-15)
    np.testing.assert_allclose(A[2] * root, [2, 2, 2, 2], rtol=1e-15)  # printed: 1, 1, 1, 1
    solution = general_solution(robot, home)
    np.testing.assert_allclose(
        solution.shortest[0], [1 / root, -0.5 / root, -1 / root, 0.5 / root], atol=1e-15
    )
    np.testing.assert_allclose(solution.shortest[0], [0.4472, -0.2236, -0.4472, 0.2236], atol=5e-5)
    null_vector = solution.null_space(0)[:, 0]
    np.testing.assert_allclose(null_vector / null_vector[0], [1, -1, 1, -1], rtol=1e-14)

    printed = np.array([0.2, -0.1, -0.2, 0.1])
    np.testing.assert_allclose(solution.shortest[0] / printed, np.full(4, root), rtol=1e-14)
    # The printed forces bear 0.447 N of the weight of 1 N.
    np.testing.assert_allclose(A @ printed, [0.0, 1 / root, 0.0], atol=1e-15)
    np.testing.assert_allclose(A @ solution.shortest[0], [0.0, 1.0, 0.0], atol=1e-15)

    for method in ("least_norm", "least_infinity"):
        found = distribute_tensions(robot, home, method)
        assert not found.feasible[0]
        # T2 + T3 = -1.5 / sqrt(5) whatever alpha is.
        np.testing.assert_allclose(found.slack, [-0.75 / root], rtol=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_tensions_balance_keep_their_bounds_and_exist_where_highs_finds_some(method):
    robot, poses = crossed_box(), some_poses(60, seed=7)
    found = distribute_tensions(robot, poses, method, tension_min=LOW, tension_max=HIGH)
    A, w = structure_matrix(robot, poses), total_wrench(robot, poses)
    slacks = [largest_slack(A[k], w[k], LOW, HIGH) for k in range(60)]
    np.testing.assert_allclose(found.slack, slacks, rtol=1e-9, atol=1e-7)  # HiGHS keeps 1e-7
    assert 5 < np.count_nonzero(found.feasible) < 55
    if method == "closed_form":  # may give up, never be wrong
        assert not np.any(found.feasible & (found.slack < 0.0))
    else:
        np.testing.assert_array_equal(found.feasible, np.array(slacks) >= 0.0)
    inside = found.tensions[found.feasible]
    assert inside.min() > LOW - 1e-6
    assert inside.max() < HIGH + 1e-6
    assert found.residual.max() < 1e-8
    left = (A @ found.tensions[..., None])[..., 0] + w
    assert np.abs(left).max() < 1e-8 * np.linalg.norm(w[0])


@pytest.mark.parametrize("cables", [7, 8, 10])
def test_the_least_norm_has_multipliers_that_prove_it(cables):
    robot, poses = robot_of(cables, seed=1), some_poses(1000, seed=8)
    found = distribute_tensions(robot, poses, "least_norm", tension_min=5.0, tension_max=300.0)
    solution, proved = general_solution(robot, poses), 0
    for pose in np.flatnonzero(found.feasible)[:20]:
        T, N = found.tensions[pose], solution.null_space(pose)
        at_low, at_high = T < 5.0 + 1e-6, T > 300.0 - 1e-6
        # T = sum of (multiplier >= 0) x (normal, towards the inside) and forces of A's rows.
        inwards = np.hstack([N[at_low].T, -N[at_high].T])
        _, missed = nnls(inwards, N.T @ T) if inwards.size else (0, np.linalg.norm(N.T @ T))
        assert missed < 1e-8 * np.linalg.norm(T)
        proved += 1
    assert proved > 0


def test_the_least_infinity_norm_is_highss():
    robot, poses = crossed_box(), some_poses(60, seed=9)
    found = distribute_tensions(robot, poses, "least_infinity", tension_min=LOW, tension_max=HIGH)
    A, w = structure_matrix(robot, poses), total_wrench(robot, poses)
    for pose in np.flatnonzero(found.feasible):
        objective = np.append(np.zeros(8), 1.0)
        best = highs(A[pose], w[pose], objective, low=LOW, high=HIGH)
        assert found.tensions[pose].max() == pytest.approx(best.fun, rel=1e-9)


def test_the_least_infinity_norm_may_be_the_lower_bound_itself():
    """Opposite cables, no load: all at 5 N."""
    anchors = np.array([[2.0, 0, 0], [-2, 0, 0], [0, 2, 0], [0, -2, 0]])
    robot, home = planar_example(anchors=anchors, attachments=anchors / 4), make_poses([[0, 0, 0]])
    lifted = -total_wrench(robot, home)
    found = distribute_tensions(robot, home, "least_infinity", wrench=lifted, tension_min=5.0)
    np.testing.assert_allclose(found.tensions, [[5.0] * 4], rtol=1e-9)
    assert found.feasible[0]


def test_the_closed_form_is_potts_and_fixes_cables_at_their_bounds():
    robot, poses = crossed_box(), some_poses(1500, seed=10)
    found = distribute_tensions(robot, poses, "closed_form", tension_min=LOW, tension_max=HIGH)
    A, w = structure_matrix(robot, poses), total_wrench(robot, poses)
    middle = np.full((1500, 8), 0.5 * (LOW + HIGH))
    left = w + (A @ middle[..., None])[..., 0]
    first = middle - (np.linalg.pinv(A) @ left[..., None])[..., 0]
    fits = np.all((first >= LOW) & (first <= HIGH), axis=1)
    assert np.count_nonzero(fits) > 20
    assert np.all(found.feasible[fits])
    np.testing.assert_allclose(found.tensions[fits], first[fits], rtol=1e-9)
    mended = found.feasible & ~fits
    assert np.count_nonzero(mended) > 20
    # A cable is at a bound once one was fixed.
    ends = np.minimum(found.tensions - LOW, HIGH - found.tensions)[mended].min(axis=1)
    np.testing.assert_allclose(ends, 0.0, atol=1e-7)


def test_the_closed_form_says_where_it_gives_up():
    """Fixing the worst cable is no search; wide bounds, far from the mean, show it."""
    robot, poses = robot_of(10), some_poses(500, seed=10)
    found = distribute_tensions(robot, poses, "closed_form", tension_max=1e5)
    gave_up = ~found.feasible & (found.slack > 0.0)
    assert 0 < np.count_nonzero(gave_up) < np.count_nonzero(found.feasible)
    outside = np.minimum(found.tensions, 1e5 - found.tensions)[gave_up].min(axis=1)
    assert np.all(outside < 0.0)


def test_the_analytic_centre_is_where_the_logarithms_gradient_ends():
    robot, poses = crossed_box(), some_poses(200, seed=11)
    found = distribute_tensions(robot, poses, tension_min=LOW, tension_max=HIGH)
    solution, T = general_solution(robot, poses), found.tensions
    for pose in np.flatnonzero(found.slack > 1e-3):
        slopes = 1.0 / (T[pose] - LOW) - 1.0 / (HIGH - T[pose])
        # Newton's decrement ends below 1e-9; slopes are some 1 / slack each.
        assert np.abs(solution.null_space(pose).T @ slopes).max() < 1e-7 * np.abs(slopes).max()
    assert np.all(T[found.feasible] > LOW)


def test_along_a_path_the_centre_is_smooth_and_the_least_norm_has_kinks():
    robot = crossed_box()

    def kink(method, steps):
        s = np.linspace(-1.0, 1.0, steps + 1)[:, None]
        poses = make_poses(s * [1.2, 0.3, 0.2])
        found = distribute_tensions(robot, poses, method, tension_min=LOW, tension_max=2000.0)
        assert np.all(found.feasible)
        return np.abs(np.diff(found.tensions, n=2, axis=0)).max()

    # Second differences of a smooth function shrink as the square of the step, those at a kink as
    # the step.
    assert kink("analytic_center", 400) / kink("analytic_center", 800) == pytest.approx(4, rel=0.05)
    assert kink("least_norm", 400) / kink("least_norm", 800) < 3.0


def test_a_wrench_that_no_tensions_balance_is_infeasible_by_infinity():
    robot, poses = concurrent_robot(), make_poses([[0.0, 0.0, 0.2], [0.5, 0.0, 0.0]])
    solution = general_solution(robot, poses)
    np.testing.assert_array_equal(solution.rank, [3, 3])
    found = distribute_tensions(robot, poses, tension_min=LOW, tension_max=HIGH)
    # The weight acts through the cables' common point where the platform is below or above it.
    np.testing.assert_array_equal(found.feasible, [True, False])
    assert found.residual[0] < 1e-12
    assert found.residual[1] > 0.01
    assert found.slack[1] == -np.inf
    other = distribute_tensions(robot, poses, wrench=[0, 0, 0, 0, 0, 1.0], tension_max=HIGH)
    assert not np.any(other.feasible)


def test_without_an_upper_bound_slack_is_infinite_where_cables_pull_against_each_other():
    robot, poses = crossed_box(), some_poses(60, seed=12)
    found = distribute_tensions(robot, poses, "least_norm", tension_min=LOW)
    A, w = structure_matrix(robot, poses), total_wrench(robot, poses)
    slacks = [largest_slack(A[k], w[k], LOW, np.inf) for k in range(60)]
    np.testing.assert_allclose(found.slack, slacks, rtol=1e-9, atol=1e-7)
    assert 0 < np.count_nonzero(np.isinf(found.slack)) < 60


@pytest.mark.parametrize("method", ["least_norm", "least_infinity"])
def test_a_wrench_adds_to_the_weight(method):
    robot, poses = crossed_box(), some_poses(5)
    lifted = -total_wrench(robot, poses)
    found = distribute_tensions(robot, poses, method, wrench=lifted)
    np.testing.assert_allclose(found.tensions, 0.0, atol=1e-9)
    assert np.all(found.feasible)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"method": "least_nrom"}, "did you mean 'least_norm'"),
        ({"method": "closed_form"}, "tension_max = inf N; must be finite for closed_form"),
        ({"tension_min": 9.0, "tension_max": 5.0}, "tension bounds = 9 .. 5 N; must be rising"),
        ({"tension_min": -1.0, "tension_max": 5.0}, "tension bounds = -1 .. 5 N"),
        ({"tension_min": np.nan, "tension_max": 5.0}, "tension bounds = nan .. 5 N"),
        ({"wrench": [1.0, 2.0], "tension_max": 5.0}, r"wrench of shape \(2,\); must be \(6,\) or"),
        ({"wrench": [np.nan] * 6, "tension_max": 5.0}, "finite, N and N m"),
    ],
)
def test_bad_arguments_are_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        distribute_tensions(crossed_box(), some_poses(2), **arguments)


def test_the_characteristic_length_is_the_farthest_attachments():
    assert characteristic_length(planar_example()) == 1.0
    anchors = [[2, 2, 0], [2, -2, 0], [-2, -2, 0]]
    point = planar_example(anchors=anchors, attachments=[[0, 0, 0]] * 3)
    assert characteristic_length(point) == 1.0


def by_clarabel(A, w, low, high):
    from pydrake.solvers import ClarabelSolver, MathematicalProgram

    program = MathematicalProgram()
    T = program.NewContinuousVariables(A.shape[1])
    program.AddQuadraticCost(np.eye(A.shape[1]), np.zeros(A.shape[1]), T)
    program.AddLinearEqualityConstraint(A, -w, T)
    program.AddBoundingBoxConstraint(low, high, T)
    result = ClarabelSolver().Solve(program)
    return result.GetSolution(T) if result.is_success() else None


def by_daqp(A, w, low, high):
    cables = A.shape[1]
    bounds = (np.append(np.full(cables, edge), -w) for edge in (high, low))
    senses = np.append(np.zeros(cables), np.full(len(w), 5)).astype(np.int32)  # 5: an equation
    daqp = importlib.import_module("daqp")
    x, _, flag, _ = daqp.solve(np.eye(cables), np.zeros(cables), A.copy(), *bounds, senses)
    return x if flag > 0 else None


def by_quadprog(A, w, low, high):
    eye = np.eye(A.shape[1])
    sides = np.concatenate([-w, np.full(len(eye), low), np.full(len(eye), -high)])
    quadprog = importlib.import_module("quadprog")
    try:
        normals = np.vstack([A, eye, -eye]).T.copy()
        return quadprog.solve_qp(eye, np.zeros(len(eye)), normals, sides, len(w))[0]
    except ValueError:  # "constraints are inconsistent, no solution"
        return None


@pytest.mark.slow
@pytest.mark.parametrize("peer", [by_clarabel, by_daqp, by_quadprog])
def test_the_least_norm_is_that_of_general_solvers(peer):
    if peer is not by_clarabel:
        pytest.importorskip(peer.__name__.removeprefix("by_"))
    for robot in (crossed_box(), robot_of(10, seed=2)):
        poses = some_poses(300, seed=13)
        found = distribute_tensions(robot, poses, "least_norm", tension_min=LOW, tension_max=HIGH)
        A, w = structure_matrix(robot, poses), total_wrench(robot, poses)
        for pose in range(300):
            expected = peer(A[pose], w[pose], LOW, HIGH)
            assert found.feasible[pose] == (expected is not None)
            if expected is not None:  # Clarabel's, measured: 2e-7 N; DAQP keeps bounds to 1e-6
                np.testing.assert_allclose(found.tensions[pose], expected, atol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("cables", [6, 7, 8, 9, 12, 16])
@pytest.mark.parametrize("bounds", [(0.0, np.inf), (5.0, 200.0), (0.0, 1e5)])
def test_every_method_finds_tensions_wherever_there_are_some(cables, bounds):
    robot, poses = robot_of(cables, seed=1), some_poses(5000, seed=14)
    low, high = bounds
    scale = 1e-10 * np.maximum(high if np.isfinite(high) else 0.0, 20.0 * 9.81)
    for method in METHODS:
        if not np.isfinite(high) and method in ("closed_form", "analytic_center"):
            continue
        found = distribute_tensions(robot, poses, method, tension_min=low, tension_max=high)
        assert found.residual.max() < 1e-8
        inside = found.tensions[found.feasible]
        sizes = np.maximum(1.0, np.abs(inside).max(axis=1, initial=0.0))
        missed = np.maximum(low - inside, inside - high).max(axis=1, initial=-np.inf)
        assert np.all(missed < 1e-6 + 1e-9 * sizes)
        if method == "closed_form":
            assert not np.any(found.feasible & (found.slack < -scale))
        else:
            np.testing.assert_array_equal(found.feasible, found.slack >= -scale)


@pytest.mark.slow
def test_slacks_of_two_thousand_poses_are_highss():
    robot, poses = crossed_box(), some_poses(2000, seed=15)
    found = distribute_tensions(robot, poses, tension_min=LOW, tension_max=HIGH)
    A, w = structure_matrix(robot, poses), total_wrench(robot, poses)
    slacks = np.array([largest_slack(A[k], w[k], LOW, HIGH) for k in range(2000)])
    np.testing.assert_allclose(found.slack, slacks, rtol=1e-9, atol=1e-7)
    np.testing.assert_array_equal(found.feasible, slacks >= 0.0)
