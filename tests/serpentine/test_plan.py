"""A plan says where an arm cannot follow, which joint it is, and by how much."""

from __future__ import annotations

import copy
import re
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pips_drake.config import load_yaml
from pips_drake.errors import InputError
from pips_drake.scene.packages import find_arm_file
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import make_arm
from pips_drake.serpentine.arm_file import ArmFile
from pips_drake.serpentine.follow_the_leader import REPORT_TOLERANCE, FollowTheLeader
from pips_drake.serpentine.path_file import load_path
from pips_drake.serpentine.plan import CHECK_STEP, check_start, make_plan
from pips_drake.serpentine.tip_path import polyline_path

INCH = 0.0254
DEGREE = np.pi / 180.0
TABLES = [f"trajectory_{number}" for number in range(1, 5)]


@pytest.fixture(scope="module")
def table():
    return load_path("trajectory_4")


@pytest.fixture(scope="module")
def plan(arm, table):
    return make_plan(arm, table)


def arm_with_row(**rows):
    """The prototype with other limits: joint name to (lower, upper) in the row's unit."""
    config = copy.deepcopy(load_yaml(ArmFile, find_arm_file("prototype")))
    for joint in config.joints:
        if joint.name in rows:
            joint.lower, joint.upper = rows[joint.name]
    return make_arm(config)


def moved_table(*, home_aside_in=0.0, base_aside_in=0.0, home_z_in=174.902):
    """A straight path up the base line, its first two rows moved, in."""
    points = [
        [16.255, base_aside_in, 0.0],
        [16.255, home_aside_in, home_z_in],
        [16.255, home_aside_in, home_z_in + 20.0],
    ]
    return polyline_path(INCH * np.array(points), "moved")


@pytest.mark.parametrize("name", TABLES)
def test_the_arm_can_follow_the_reports_trajectories(arm, name):
    plan = make_plan(arm, load_path(name))
    assert plan.failures == () and plan.followable
    # The solver's own tolerance.
    assert plan.solution.spine_error.max() <= 1e-9 * INCH


def test_by_default_the_tip_is_put_every_quarter_inch_and_at_the_end(plan, table):
    s = plan.solution.tip_arc_lengths
    assert s[0] == table.home_arc_length and s[-1] == table.length
    np.testing.assert_allclose(np.diff(s)[:-1], 0.25 * INCH, rtol=0, atol=1e-14)
    assert 0.0 < s[-1] - s[-2] <= 0.25 * INCH + 1e-12


def test_the_centre_line_leaves_trajectory_4_by_about_1_4_inches(plan, table):
    # FACTS: about 1.4 in.
    assert plan.centre_line_deviation.max() / INCH == pytest.approx(1.4, abs=0.05)


def test_the_centre_lines_deviation_is_that_of_many_points(arm, plan, table):
    # Points 0.5 mm apart on the path, 1 mm apart on the centre line.
    cloud = cKDTree(table.point(np.append(np.arange(0.0, table.length, 5e-4), table.length)))
    for i in np.linspace(0, len(plan.joints) - 1, 12).astype(int):
        corners = kinematics.centre_line(arm, plan.joints[i])[0, 1:]
        fractions = np.linspace(0.0, 1.0, 512)[:, None]
        points = np.concatenate([a + fractions * (b - a) for a, b in pairwise(corners)])
        # The plan looks at points 8 mm apart: between them, with links at up to 0.2 rad to the
        # path, the distance may grow by 0.8 mm. On the straight the cloud adds up to 0.25 mm.
        assert plan.centre_line_deviation[i] == pytest.approx(
            cloud.query(points)[0].max(), abs=1e-3
        )


def test_margins_are_distances_to_the_nearer_limit(arm, plan):
    centre, half = (
        0.5 * (arm.joint_lower + arm.joint_upper),
        0.5 * (arm.joint_upper - arm.joint_lower),
    )
    expected = half - np.abs(plan.joints - centre)
    np.testing.assert_allclose(plan.joint_margins, expected, rtol=0, atol=1e-15)


def test_drive_lengths_are_the_triangles(plan):
    pins = INCH * np.repeat([9.0, 7.5, 6.0, 2.7], [7, 6, 2, 1])
    expected = 2.0 * pins * np.sin(0.25 * np.pi + 0.5 * plan.joints[:, 2:])
    np.testing.assert_allclose(plan.drive_lengths, expected, rtol=0, atol=1e-15)


def test_rates_are_the_slopes_of_the_joints(arm):
    path = load_path("trajectory_4_arcs")
    s, step = path.samples(3.0 * INCH)[1:-1], 1e-4
    plan = make_plan(arm, path, tip_arc_lengths=s)
    solver = FollowTheLeader(arm)
    slopes = (solver.solve(path, s + step).joints - solver.solve(path, s - step).joints) / 2e-4
    # Second derivatives (below 20 rad/m^2) jump where a spine point passes from line to arc: half
    # the step of that; elsewhere step^2.
    np.testing.assert_allclose(plan.rates, slopes, rtol=0, atol=20.0 * 0.5 * step)


SENTENCE = re.compile(
    r"joint (?P<name>\w+) leaves its limits (?P<lower>\S+) \.\. (?P<upper>\S+) (?P<unit>\w+): "
    r"first with the tip at (?P<first>\S+) m of path '(?P<path>\w+)' \((?P<place>.*)\) in, worst "
    r"(?P<value>\S+) \w+ at (?P<worst>\S+) m, (?P<beyond>\S+) \w+ too far"
)


def test_a_broken_limit_names_the_joint_the_places_and_the_amount(table):
    arm = arm_with_row(theta8=(-20.0, 20.0))
    plan = make_plan(arm, table)
    assert not plan.followable
    (sentence,) = plan.failures
    found = SENTENCE.fullmatch(sentence)
    assert found, sentence
    assert found["name"] == "theta8" and found["path"] == "trajectory_4"
    assert (found["lower"], found["upper"], found["unit"]) == ("-20.000", "20.000", "deg")
    # Independent of the plan's own sweep: the solver, ten times as fine.
    s = np.append(np.arange(table.home_arc_length, table.length, 0.1 * CHECK_STEP), table.length)
    theta8 = FollowTheLeader(arm).solve(table, s).joints[:, 7] / DEGREE
    first, worst = s[np.argmax(np.abs(theta8) > 20.0)], np.argmax(np.abs(theta8))
    assert float(found["first"]) == pytest.approx(first, abs=CHECK_STEP + 1e-4)
    assert float(found["worst"]) == pytest.approx(s[worst], abs=CHECK_STEP + 1e-4)
    # Up to 1.7 deg an inch (DESIGN), so within 0.5 deg between samples a quarter inch apart.
    assert float(found["value"]) == pytest.approx(theta8[worst], abs=0.5)
    assert float(found["beyond"]) == pytest.approx(abs(float(found["value"])) - 20.0, abs=1.1e-3)
    place = [float(value) for value in found["place"].split(",")]
    np.testing.assert_allclose(place, table.point(float(found["first"])) / INCH, atol=5e-3)


def test_a_limit_of_the_rail_is_told_in_inches(table):
    # FACTS: at trajectory 4's end d1 = 113.194525 in.
    plan = make_plan(arm_with_row(d1=(24.9, 110.0)), table)
    (sentence,) = plan.failures
    found = SENTENCE.fullmatch(sentence)
    assert found and (found["name"], found["unit"]) == ("d1", "in")
    assert (found["value"], found["beyond"]) == ("113.195", "3.195")
    assert float(found["worst"]) == pytest.approx(table.length, abs=5e-5)


def test_every_joint_that_leaves_its_limits_has_its_sentence(table):
    plan = make_plan(arm_with_row(theta8=(-20.0, 20.0), theta13=(-10.0, 10.0)), table)
    found = [SENTENCE.fullmatch(text) for text in plan.failures]
    # In the order in which the tip meets them: the outer joint bends first.
    assert [match["name"] for match in found] == ["theta13", "theta8"]
    assert plan.first_failing_tip == pytest.approx(float(found[0]["first"]), abs=5e-5)


def test_a_peak_between_coarse_points_is_found(arm, table):
    # Between table rows joints peak higher than at them: a limit between the two peaks.
    solver = FollowTheLeader(arm)
    at_rows = np.abs(solver.solve(table, table.marks).joints).max(axis=0) / DEGREE
    between = np.abs(solver.solve(table, table.samples(CHECK_STEP)).joints).max(axis=0) / DEGREE
    j = 3 + int(np.argmax((between - at_rows)[3:]))
    assert between[j] - at_rows[j] > 0.2
    limit = 0.5 * (between[j] + at_rows[j])
    narrow = arm_with_row(**{f"theta{j + 1}": (-limit, limit)})
    plan = make_plan(narrow, table, tip_arc_lengths=table.marks)
    assert plan.joint_margins[:, j].min() > 0.0
    assert len(plan.failures) == 1 and f"joint theta{j + 1} leaves" in plan.failures[0]


def test_a_path_with_no_solution_says_where_and_keeps_the_rest(arm):
    # A right angle that no module can go around: 30 deg a hinge over a foot is too little.
    corner = polyline_path(
        INCH * np.array([[16.255, 0, 0], [16.255, 0, 174.902], [16.255, 0, 190], [100.0, 0, 190]]),
        "corner",
    )
    plan = make_plan(arm, corner)
    assert not plan.followable
    assert any("joint theta" in text for text in plan.failures)
    short = polyline_path(
        INCH * np.array([[16.255, 0, 60], [16.255, 0, 174.902], [16.255, 0, 190]]), "short"
    )
    plan = make_plan(arm, short)
    solved = plan.solution.solved
    assert not solved.all()
    s = plan.solution.tip_arc_lengths[np.argmin(solved)]
    assert plan.failures[0].startswith(f"tip at {s:.4f} m of path 'short'")
    assert np.all(np.isnan(plan.centre_line_deviation[~solved]))


def test_reports_mode_is_judged_with_its_own_joints_and_the_converged_sweep(arm, table):
    solver = FollowTheLeader(arm, tolerance=REPORT_TOLERANCE)
    plan = make_plan(arm, table, tip_arc_lengths=table.marks, solver=solver)
    assert plan.followable
    # FACTS: 2, 1, 1, ... iterations, largest error 0.0676 in.
    assert plan.solution.iterations.tolist() == [2] + [1] * (table.marks.size - 1)
    assert plan.solution.spine_error.max() / INCH == pytest.approx(0.0676, abs=5e-5)


def test_limits_are_judged_by_converged_joints_however_coarse_the_solver(table):
    narrow = arm_with_row(theta8=(-20.0, 20.0))
    coarse = FollowTheLeader(narrow, tolerance=REPORT_TOLERANCE)
    plan = make_plan(narrow, table, solver=coarse)
    assert plan.failures == make_plan(narrow, table).failures
    # The coarse joints are others, by more than the sentence's last digit.
    s = plan.solution.tip_arc_lengths
    converged = FollowTheLeader(narrow).solve(table, s).joints[:, 7]
    assert np.abs(plan.joints[:, 7] - converged).max() > 0.001 * DEGREE


@pytest.mark.parametrize("aside", [0.04, -0.04])
def test_row_2_may_stand_off_the_base_line_by_0_04_in(arm, aside):
    check_start(arm, moved_table(home_aside_in=aside))


@pytest.mark.parametrize("aside", [0.06, -0.06])
def test_row_2_may_not_stand_off_the_base_line_by_0_06_in(arm, aside):
    message = (
        r"path 'moved': row 2 is 0\.060 in off the base line of arm 'prototype' \(through "
        r"\(16\.255, 0\.000, 174\.902\) in along \(0\.000, 0\.000, 1\.000\)\); "
        r"must be within 0\.05 in"
    )
    with pytest.raises(InputError, match=message):
        make_plan(arm, moved_table(home_aside_in=aside))


def test_row_1_may_not_stand_off_the_base_line(arm):
    with pytest.raises(InputError, match=r"path 'moved': row 1 is 0\.100 in off the base line"):
        make_plan(arm, moved_table(base_aside_in=0.1))


@pytest.mark.parametrize(
    ("home_z_in", "d1", "need"), [(173.902, "23.900", "+1.000"), (275.0, "124.998", "-100.098")]
)
def test_a_home_that_asks_for_d1_out_of_limits_is_refused(arm, home_z_in, d1, need):
    message = re.escape(f"needs d1 = {d1} in; must be 24.900 .. 114.500 in, so move it {need} ..")
    with pytest.raises(InputError, match=message):
        make_plan(arm, moved_table(home_z_in=home_z_in))


def test_a_home_within_the_tables_rounding_of_a_limit_is_accepted(arm):
    assert make_plan(arm, moved_table(home_z_in=174.902 - 0.0009)).followable
    with pytest.raises(InputError, match="needs d1"):
        make_plan(arm, moved_table(home_z_in=174.902 - 0.0012))


def test_a_path_that_ends_at_home_is_refused(arm):
    ends = polyline_path(INCH * np.array([[16.255, 0, 0], [16.255, 0, 174.902]]), "ends")
    with pytest.raises(InputError, match="path 'ends': ends at the home tip; must have a point"):
        make_plan(arm, ends)
