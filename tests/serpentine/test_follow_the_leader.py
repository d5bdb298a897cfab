"""Follow-the-leader reproduces FTL-95, and what should not matter does not change its joints."""

from __future__ import annotations

import itertools
import math
import re

import numpy as np
import pytest

from pips_drake.errors import InputError
from pips_drake.serpentine.follow_the_leader import REPORT_TOLERANCE, FollowTheLeader
from pips_drake.serpentine.kinematics import centre_line, spine_points
from pips_drake.serpentine.path_file import load_path
from pips_drake.serpentine.solver import CONVERGED
from pips_drake.serpentine.tip_path import PathBuilder, TipPath, polyline_path

INCH = 0.0254
DEGREE = math.pi / 180.0
TABLES = ["trajectory_1", "trajectory_2", "trajectory_3", "trajectory_4"]

# FACTS: trajectory 4's end, converged, in and deg.
END_JOINTS = [113.194525, -89.999611, -0.000397, 0.000275, 0.000130]
END_JOINTS += [-3.769614, 3.995988, -24.858013, 24.576912, -28.245154, 22.297129]
END_JOINTS += [-0.533363, 25.228922, 19.622858, 24.476946, 17.327377, 17.290909, 0.0]


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
            alone = ftl.solve(path, [s], module_lengths=start)
            assert alone.status[0] == CONVERGED
            assert alone.spine_error[0] <= ftl.tolerance
            assert alone.spine_arc_lengths[0, -1] == s
            # Both errors are below 2.5e-11 m; over modules of 0.32 m, some 1e-10 rad, adding up.
            np.testing.assert_allclose(alone.joints[0], expected, rtol=0, atol=1e-9)


def test_one_point_alone_gives_what_it_gives_among_others(ftl):
    path = load_path("trajectory_4")
    s = path.samples(3.0 * INCH)
    together = ftl.solve(path, s)
    for i in range(0, len(s), 5):
        alone = ftl.solve(path, s[i : i + 1])
        np.testing.assert_array_equal(alone.joints[0], together.joints[i])
        np.testing.assert_array_equal(alone.spine_arc_lengths[0], together.spine_arc_lengths[i])


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
