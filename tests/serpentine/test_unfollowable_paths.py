"""Paths that cannot be followed: the solver says truly why, and what fails spoils nothing else."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from pips_drake.errors import NotFollowableError
from pips_drake.serpentine.follow_the_leader import REPORT_TOLERANCE, FollowTheLeader
from pips_drake.serpentine.kinematics import spine_points
from pips_drake.serpentine.path_file import load_path
from pips_drake.serpentine.solver import BASE_OUT_OF_REACH, CONVERGED, NOT_CONVERGED, OFF_PATH
from pips_drake.serpentine.tip_path import PathBuilder, TipPath, polyline_path

INCH = 0.0254
DEGREE = math.pi / 180.0


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
