"""Follow-the-leader reproduces FTL-95's results and says truly why a path cannot be followed."""

from __future__ import annotations

import itertools
import math
import re

import numpy as np
import pytest

from pips_drake.errors import InputError, NotFollowableError
from pips_drake.serpentine.follow_the_leader import (
    REPORT_TOLERANCE,
    FollowTheLeader,
    intersect_sphere_segment,
)
from pips_drake.serpentine.kinematics import centre_line, spine_points
from pips_drake.serpentine.path_file import load_path
from pips_drake.serpentine.path_geometry import START
from pips_drake.serpentine.solver import (
    BASE_OUT_OF_REACH,
    CONVERGED,
    NOT_CONVERGED,
    OFF_PATH,
)
from pips_drake.serpentine.tip_path import PathBuilder, TipPath, polyline_path

INCH = 0.0254
DEGREE = math.pi / 180.0
TABLES = ["trajectory_1", "trajectory_2", "trajectory_3", "trajectory_4"]

# FACTS: trajectory 4's end, converged, in and deg.
END_JOINTS = [113.194525, -89.999611, -0.000397, 0.000275, 0.000130]
END_JOINTS += [-3.769614, 3.995988, -24.858013, 24.576912, -28.245154, 22.297129]
END_JOINTS += [-0.533363, 25.228922, 19.622858, 24.476946, 17.327377, 17.290909, 0.0]


@pytest.fixture(scope="module")
def ftl(arm) -> FollowTheLeader:
    return FollowTheLeader(arm)


# The report's results


def test_the_reports_tolerance_gives_the_reports_iterations_and_error(arm):
    path = load_path("trajectory_4")
    solution = FollowTheLeader(arm, tolerance=REPORT_TOLERANCE).solve(path, path.marks)
    assert solution.iterations.tolist() == [2] + [1] * 12
    # Printed digits: half a unit of the last.
    assert solution.spine_error.max() / INCH == pytest.approx(0.0676, abs=5e-5)
    assert solution.first_spine_error[0] / INCH == pytest.approx(0.5406, abs=5e-5)
    assert np.all(solution.solved)


def test_the_first_error_at_home_is_half_the_sum_of_table_a2s_delta_q(arm):
    path = load_path("trajectory_4")
    solution = FollowTheLeader(arm, tolerance=REPORT_TOLERANCE).solve(path, path.marks[:1])
    shortest, longest = arm.module_length_range
    # Every module is straight at home to the base's 4e-4 deg, so all errors add up at the tip.
    expected = 0.5 * np.sum(longest - shortest)
    assert solution.first_spine_error[0] == pytest.approx(expected, abs=1e-9)


def test_at_the_tables_home_the_joints_are_those_that_facts_states(ftl):
    path = load_path("trajectory_4")
    q = ftl.solve(path, path.home_arc_length).joints[0]
    # Printed to nine decimals; the solver stops below 1e-9 in.
    assert q[0] / INCH == pytest.approx(24.900033963, abs=1e-9)
    assert q[1] / DEGREE == pytest.approx(-89.999611194, abs=1e-9)


def test_trajectory_4s_end_joints_are_those_that_facts_states(ftl):
    path = load_path("trajectory_4")
    q = ftl.solve(path, path.length).joints[0]
    found = np.append(q[0] / INCH, q[1:] / DEGREE)
    np.testing.assert_allclose(found, END_JOINTS, rtol=0, atol=5.1e-7)


@pytest.mark.parametrize("name", TABLES)
def test_every_table_point_converges_within_six_iterations(ftl, name):
    path = load_path(name)
    solution = ftl.solve(path, path.marks)
    assert np.all(solution.status == CONVERGED)
    assert solution.spine_error.max() <= 1e-9 * INCH
    assert solution.iterations.max() <= 6


@pytest.mark.parametrize("name", TABLES)
def test_every_trajectory_stays_within_the_limits(ftl, arm, name):
    path = load_path(name)
    solution = ftl.solve(path, path.samples(0.25 * INCH))
    assert np.all(solution.solved)
    assert np.all(solution.joints > arm.joint_lower)
    assert np.all(solution.joints < arm.joint_upper)


def test_the_fixed_point_contracts_by_about_a_hundred_a_step(arm):
    path = load_path("trajectory_4")
    errors = []
    for limit in (1, 2, 3, 4):
        solution = FollowTheLeader(arm, max_iterations=limit, tolerance=1e-14).solve(
            path, path.marks[1:]
        )
        errors.append(solution.spine_error.max())
    ratios = np.array(errors[:-1]) / errors[1:]
    assert np.all(ratios > 30.0)


# Spine points lie on the path; the arm between them does not


@pytest.mark.parametrize("name", [*TABLES, "trajectory_1_arcs", "trajectory_4_arcs"])
def test_forward_kinematics_finds_the_spine_on_the_path(ftl, arm, name):
    path = load_path(name)
    solution = FollowTheLeader(arm, tolerance=1e-13).solve(path, path.samples(1.0 * INCH))
    assert np.all(solution.solved)
    reached = spine_points(arm, solution.joints)
    distance, _ = path.nearest(reached.reshape(-1, 3), 0.0, path.length)
    assert distance.max() < 1e-12
    # At the default tolerance: 1e-9 in.
    reached = spine_points(arm, ftl.solve(path, path.samples(1.0 * INCH)).joints)
    distance, _ = path.nearest(reached.reshape(-1, 3), 0.0, path.length)
    assert distance.max() < 1e-9 * INCH


def test_the_centre_line_leaves_trajectory_4_by_about_1_4_inches(ftl, arm):
    path = load_path("trajectory_4")
    solution = ftl.solve(path, path.samples(0.5 * INCH))
    corners = centre_line(arm, solution.joints)
    # From spine point 4 (corner 1) on, each link sampled every fortieth.
    fractions = np.linspace(0.0, 1.0, 41)[:, None, None, None]
    links = corners[:, 1:-1] + fractions * (corners[:, 2:] - corners[:, 1:-1])
    distance, _ = path.nearest(links.reshape(-1, 3), 0.0, path.length)
    # FACTS says "about 1.4 in".
    assert 1.35 < distance.max() / INCH < 1.45


# What changes nothing, and what mirrors


def test_retraction_is_the_reversed_array(ftl):
    path = load_path("trajectory_4")
    s = path.samples(0.5 * INCH)
    out, back = ftl.solve(path, s), ftl.solve(path, s[::-1])
    np.testing.assert_array_equal(back.joints[::-1], out.joints)
    np.testing.assert_array_equal(back.iterations[::-1], out.iterations)


def test_a_coarse_retraction_is_another_array(arm):
    """The report's mode carries module lengths over, so it depends on where it came from."""
    ftl, path = FollowTheLeader(arm, tolerance=REPORT_TOLERANCE), load_path("trajectory_4")
    out, back = ftl.solve(path, path.marks), ftl.solve(path, path.marks[::-1])
    gap = np.abs(back.joints[::-1] - out.joints)[:, 1:].max()
    assert 1e-4 < gap < 0.05


def test_the_converged_answer_does_not_depend_on_where_it_started(ftl, arm):
    path = load_path("trajectory_4")
    together = ftl.solve(path, path.samples(2.0 * INCH))
    for start in (arm.module_length_range[0], arm.module_length_range[1]):
        for s, expected in zip(together.tip_arc_lengths[::7], together.joints[::7], strict=True):
            q, arcs, status, _, error = ftl.solve_one(path, s, start.copy())
            assert status == CONVERGED
            assert error <= ftl.tolerance
            assert arcs[-1] == s
            # Both errors are below 2.5e-11 m; over modules of 0.32 m, some 1e-10 rad, adding up.
            np.testing.assert_allclose(q, expected, rtol=0, atol=1e-9)


def test_one_point_alone_gives_what_it_gives_among_others(ftl):
    path = load_path("trajectory_4")
    s = path.samples(3.0 * INCH)
    together = ftl.solve(path, s)
    for i in range(0, len(s), 5):
        q, arcs, *_ = ftl.solve_one(path, s[i], ftl.initial_module_lengths)
        np.testing.assert_array_equal(q, together.joints[i])
        np.testing.assert_array_equal(arcs, together.spine_arc_lengths[i])


def test_splitting_segments_changes_nothing(ftl):
    path = load_path("trajectory_4")
    corners = np.vstack([path.point(0.0), path.point(path.marks)])
    parts = [corners[:1]]
    for a, b in itertools.pairwise(corners):
        parts.append(a + np.array([[0.25], [0.5], [0.9], [1.0]]) * (b - a))
    split = polyline_path(np.vstack(parts), "split")
    s = np.linspace(path.home_arc_length, path.length, 200)
    # Vertices of the split path are rounded to 1e-15 m; lengths to them add up to 1e-14.
    np.testing.assert_allclose(
        ftl.solve(split, s).joints, ftl.solve(path, s).joints, rtol=0, atol=1e-11
    )


def test_a_path_moved_along_the_rail_moves_d1_alone(ftl):
    path = load_path("trajectory_4_arcs")
    pieces = path.pieces.copy()
    pieces[:, 5] += 0.1
    moved = TipPath(name="moved", pieces=pieces, home_arc_length=4.0, marks=path.marks)
    s = np.linspace(path.home_arc_length, path.length, 30)
    change = ftl.solve(moved, s).joints - ftl.solve(path, s).joints
    np.testing.assert_allclose(change[:, 0], 0.1, rtol=0, atol=1e-10)
    np.testing.assert_allclose(change[:, 1:], 0.0, atol=1e-9)


@pytest.mark.parametrize("name", ["trajectory_2", "trajectory_4", "trajectory_4_arcs"])
def test_a_mirrored_arm_follows_the_mirrored_path_with_the_same_joints(arm_variant, name):
    drawn, built = arm_variant(), arm_variant(mirrored=True)
    path = load_path(name)
    s = path.samples(1.0 * INCH)
    expected = FollowTheLeader(drawn).solve(path, s)
    found = FollowTheLeader(built).solve(path.mirrored(), s)
    np.testing.assert_array_equal(found.joints, expected.joints)
    np.testing.assert_array_equal(found.spine_points, expected.spine_points * [1.0, -1.0, 1.0])
    reached = spine_points(built, found.joints)
    np.testing.assert_allclose(reached, found.spine_points, rtol=0, atol=1e-9 * INCH)


@pytest.mark.parametrize(
    "change",
    [
        dict(lengths=[20.0, 18.0]),
        dict(lengths=[20.0, 18.0], offsets=[1.0]),
        dict(lengths=[13.0] * 12, offsets=[1.0] * 12),
        dict(lengths=[15.0] * 8, offsets=[0.0] * 8),
        dict(base="gimbal"),
        dict(base="gimbal", lengths=[13.0] * 12, offsets=[1.0] * 12, mirrored=True),
    ],
    ids=lambda change: ", ".join(f"{k} {v}" for k, v in change.items()),
)
def test_other_arms_follow_too(arm_variant, change):
    arm = arm_variant(**change)
    ftl = FollowTheLeader(arm)
    start = 11.25 if change.get("base") == "gimbal" else 16.255
    path = (
        PathBuilder(start=np.array([start, 0.0, 0.0]) * INCH, direction=[0.0, 0.0, 1.0])
        .line(175.0 * INCH)
        .arc(radius=40.0 * INCH, angle=1.0, toward=[1.0, 0.5, 0.0])
        .build("bend")
    )
    solution = ftl.solve(path, path.samples(1.0 * INCH))
    assert np.all(solution.solved)
    assert solution.joints.shape[1] == arm.joints
    assert np.all(solution.joints[:, -1] == 0.0)
    distance, _ = path.nearest(spine_points(arm, solution.joints).reshape(-1, 3), 0.0, path.length)
    assert distance.max() < 1e-9 * INCH
    if not np.any(arm.segment_offset[:-1]):  # without offsets nothing has to be iterated
        assert np.all(solution.iterations == 1)


# Rates: smooth on the arcs, jumps on the table


def crossing_jumps(ftl: FollowTheLeader, path: TipPath, h: float) -> np.ndarray:
    """Changes (C, joints - 1) of the angles' rates, rad/m, from `h` m before to `h` m after each
    tip position at which a spine point crosses a joint between two pieces."""
    s = path.samples(0.25 * INCH)
    arcs = ftl.solve(path, s).spine_arc_lengths
    jumps = []
    for joint in path.pieces[1:, START]:
        for spine in range(arcs.shape[1]):
            for i in np.flatnonzero((arcs[:-1, spine] < joint) & (arcs[1:, spine] >= joint)):
                low, high = s[i], s[i + 1]
                while high - low > 1e-12:
                    middle = 0.5 * (low + high)
                    at = ftl.solve(path, middle).spine_arc_lengths[0, spine]
                    low, high = (middle, high) if at < joint else (low, middle)
                around = ftl.solve(path, [low - 2 * h, low - h, high + h, high + 2 * h])
                rates = ftl.rates(path, around.joints, around.spine_arc_lengths)
                jumps.append((rates[2] - rates[1])[1:])
                # The same without `rates`: one-sided differences, good to the joints' second
                # derivative (20 rad/m^2) times h and their error (1e-10 rad) over h.
                slopes = np.diff(around.joints, axis=0)[[0, 2], 1:] / h
                np.testing.assert_allclose(
                    slopes[1] - slopes[0], jumps[-1], rtol=0, atol=40.0 * h + 4e-10 / h
                )
    return np.array(jumps)


def test_on_the_arcs_the_rates_do_not_jump(ftl):
    """Bound: the joints' second derivatives, below 20 rad/m^2 on arcs of 28 in (turning 30 deg in
    0.3 m and back takes 2 * 0.5 / 0.3^2 = 12), times the 2 h between the two sides."""
    h = 1e-6
    jumps = crossing_jumps(ftl, load_path("trajectory_4_arcs"), h)
    assert len(jumps) >= 8  # every spine point but those on the base line crosses home
    assert np.abs(jumps).max() < 20.0 * 2.0 * h
    # And it is the distance that makes the difference: a tenth of it, a tenth of the change.
    closer = crossing_jumps(ftl, load_path("trajectory_4_arcs"), 0.1 * h)
    assert np.abs(closer).max() < 20.0 * 0.2 * h


def test_on_the_table_the_rates_jump_at_every_vertex(ftl):
    jumps = np.abs(crossing_jumps(ftl, load_path("trajectory_4"), 1e-6)).max(axis=1)
    jumps *= INCH / DEGREE  # deg per inch of tip travel
    assert np.sum(jumps > 0.2) == len(jumps) == 44
    assert jumps.max() == pytest.approx(2.05, abs=0.01)  # in the fastest-changing angle


# Sphere and segment: the report's four cases


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


# Paths that cannot be followed


def numbers(text: str) -> list[float]:
    return [float(word) for word in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", text)]


def test_a_path_that_starts_too_near_says_which_module_lacks_how_much(ftl, arm):
    # 100 in of path hold four modules (12.76 + 13.41 + 2 * 17.21 = 60.6, + 17.51 = 78.1, + 21.21 =
    # 99.3 in): the seventh from the tip, module 1, finds 100 - 99.3 in where it needs 21.2.
    path = polyline_path(np.array([[16.255, 0, 74.902], [16.255, 0, 174.902]]) * INCH, "stub")
    solution = ftl.solve(path, path.length)
    assert solution.status[0] == OFF_PATH
    assert np.all(np.isnan(solution.joints))
    text = ftl.explain(path, solution, 0)
    left = 100.0 - np.sum(arm.average_module_length[1:]) / INCH
    needed = arm.average_module_length[0] / INCH
    assert "tip at 2.5400 m of path 'stub' (16.255, 0.000, 174.902) in" in text
    assert "spine point 6" in text
    assert "module 1" in text
    assert f"needs {needed:.3f} in" in text
    assert f"start is {left:.3f} in away" in text
    assert f"{needed - left:.3f} in too near" in text


@pytest.mark.parametrize("more", np.linspace(-0.1, 0.54, 9))
def test_a_path_that_is_short_by_a_hair_still_gets_a_true_sentence(ftl, arm, more):
    """Straight modules are up to 0.09 in longer than the average that the iteration starts from,
    and 0.5406 in longer together, so the path may run out in a later iteration than the first:
    what module 1 then needed is not its average."""
    total = np.sum(arm.average_module_length) + more * INCH
    home = np.array([16.255 * INCH, 0.0, 174.902 * INCH])
    path = polyline_path(np.array([home - [0.0, 0.0, total], home]), "hair")
    solution = ftl.solve(path, path.length)
    assert solution.status[0] == OFF_PATH
    text = ftl.explain(path, solution, 0)
    needed, start, lacking = (
        float(re.search(pattern, text).group(1))
        for pattern in (r"needs ([\d.]+) in", r"start is ([\d.]+) in", r"([\d.]+) in too near")
    )
    assert start < needed
    assert lacking == pytest.approx(needed - start, abs=1.1e-3)  # three decimals each
    assert lacking > 0.0


def test_a_path_too_far_aside_names_the_bases_joint_and_by_how_much(ftl, arm):
    shift = 20.0
    path = polyline_path(np.array([[16.255, shift, 0], [16.255, shift, 174.902]]) * INCH, "aside")
    solution = ftl.solve(path, path.length)
    assert solution.status[0] == BASE_OUT_OF_REACH
    text = ftl.explain(path, solution, 0)
    assert "spine point 4" in text
    assert "sine for theta3" in text
    # y = d2 + K d3 - K S1 sin(theta3).
    k = math.sqrt(0.5)
    sine = abs((-5.005 + k * 7.078 - shift) / (k * 20.035))
    assert numbers(text)[-1] == pytest.approx(sine - 1.0, rel=1e-3)


def test_a_path_too_far_from_the_rail_names_the_crane(ftl):
    path = polyline_path(np.array([[60.0, 0, 0], [60.0, 0, 174.902]]) * INCH, "far")
    solution = ftl.solve(path, path.length)
    assert solution.status[0] == BASE_OUT_OF_REACH
    text = ftl.explain(path, solution, 0)
    assert "cosine for theta2" in text
    # x = a0 + the hypotenuse of a2 + S1 cos(theta3) and K (S1 sin(theta3) + d3), times a cosine.
    k = math.sqrt(0.5)
    sine3 = (-5.005 + k * 7.078) / (k * 20.035)
    reach = math.hypot(8.908 + 20.035 * math.sqrt(1 - sine3**2), k * (20.035 * sine3 + 7.078))
    assert numbers(text)[-1] == pytest.approx((60.0 - 11.25) / reach - 1.0, rel=1e-3)


def u_turn(radius_in: float) -> TipPath:
    return (
        PathBuilder(start=np.array([16.255, 0.0, 0.0]) * INCH, direction=[0.0, 0.0, 1.0])
        .line(174.902 * INCH)
        .arc(radius=radius_in * INCH, angle=math.pi, toward=[1.0, 0.0, 0.0])
        .line(40.0 * INCH)
        .build("u-turn")
    )


@pytest.mark.parametrize("radius_in", [0.5, 2.0, 5.0])
def test_a_u_turn_too_tight_is_no_solution_within_limits(ftl, arm, radius_in):
    """Solved or not, nothing is passed off as followable: angles are far beyond 30 deg where it
    solves, and the sentence about what does not solve agrees with the solution's own numbers."""
    path = u_turn(radius_in)
    solution = ftl.solve(path, path.samples(0.5 * INCH))
    solved = solution.joints[solution.solved]
    bent = np.abs(solved[:, 3:]).max()
    assert bent > 80.0 * DEGREE
    reached = spine_points(arm, solved)
    gap = np.abs(reached - solution.spine_points[solution.solved]).max()
    assert gap < 1e-9 * INCH
    for i in np.flatnonzero(~solution.solved):
        assert solution.status[i] == NOT_CONVERGED
        text = ftl.explain(path, solution, int(i))
        assert f"{solution.spine_error[i] / INCH:.3g} in after 50 iterations" in text
        assert "must be <= 1e-09 in" in text
        real = np.linalg.norm(
            spine_points(arm, solution.joints[i])[0] - solution.spine_points[i], axis=1
        ).max()
        assert real == pytest.approx(solution.spine_error[i], rel=1e-6)


def test_the_iteration_limit_keeps_the_last_joints_and_error(arm):
    path = load_path("trajectory_4")
    ftl = FollowTheLeader(arm, max_iterations=2)
    solution = ftl.solve(path, path.length)
    assert solution.status[0] == NOT_CONVERGED
    assert solution.iterations[0] == 2
    error = np.linalg.norm(
        spine_points(arm, solution.joints)[0] - solution.spine_points[0], axis=1
    ).max()
    assert solution.spine_error[0] == pytest.approx(error, abs=1e-14)
    assert "after 2 iterations" in ftl.explain(path, solution, 0)


def test_d1_beyond_its_limit_is_a_solution_that_the_limits_refuse(ftl, arm):
    """The solver knows no limits: it says what the joints would have to be."""
    path = polyline_path(np.array([[16.255, 0, 0], [16.255, 0, 300.0]]) * INCH, "long")
    solution = ftl.solve(path, path.length)
    assert solution.status[0] == CONVERGED
    # Straight on: d1 grows with the tip from 24.9 in at 174.902 in.
    assert solution.joints[0, 0] / INCH == pytest.approx(24.9 + 300.0 - 174.902, abs=1e-4)
    assert solution.joints[0, 0] > arm.joint_upper[0]
    with pytest.raises(NotFollowableError, match="it has a solution"):
        ftl.explain(path, solution, 0)


def test_a_failed_point_does_not_spoil_the_next(ftl, arm):
    path = load_path("trajectory_4")
    for solver in (ftl, FollowTheLeader(arm, tolerance=REPORT_TOLERANCE)):
        alone = solver.solve(path, [path.length])
        after = solver.solve(path, [1.0, path.length])
        assert after.status[0] == OFF_PATH
        np.testing.assert_array_equal(after.joints[1], alone.joints[0])


def test_a_point_that_fails_in_a_later_iteration_does_not_spoil_the_next(arm):
    """In the report's mode its updated module lengths would carry over."""
    total = np.sum(arm.average_module_length)
    start = 174.902 * INCH - total
    path = polyline_path(
        [[16.255 * INCH, 0.0, start], [16.255 * INCH, 0.0, start + total + 10.0 * INCH]], "line"
    )
    ftl = FollowTheLeader(arm, tolerance=REPORT_TOLERANCE)
    short = total + 0.3 * INCH  # long enough for average modules, not for straight ones
    solution = ftl.solve(path, [short, path.length])
    assert solution.status.tolist() == [OFF_PATH, CONVERGED]
    # Fresh lengths need two iterations on a straight line, carried ones a single one.
    assert solution.iterations.tolist() == [2, 2]
    np.testing.assert_array_equal(solution.joints[1], ftl.solve(path, path.length).joints[0])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (dict(tolerance=0.0), "tolerance = 0.0 m; must be > 0"),
        (dict(tolerance=math.nan), "tolerance = nan m"),
        (dict(tolerance=math.inf), "tolerance = inf m"),
        (dict(max_iterations=0), "max_iterations = 0; must be 1 or more"),
    ],
)
def test_bad_options_are_refused(arm, options, words):
    with pytest.raises(InputError, match=re.escape(words)):
        FollowTheLeader(arm, **options)
