"""Paths written for the prototype, followed by an arm with another home."""

import numpy as np
import pytest

from pips_drake.serpentine import kinematics
from pips_drake.serpentine.anchoring import anchor_path
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.path_file import load_path
from pips_drake.serpentine.plan import make_plan
from pips_drake.units import INCH

PATHS = ("trajectory_1_arcs", "trajectory_2", "trajectory_3", "trajectory_4_arcs")


def test_the_prototype_takes_paths_as_they_are():
    path = load_path("trajectory_4")
    anchored, shift = anchor_path(load_arm("prototype"), path)
    assert anchored is path
    assert shift == 0.0


def test_the_concept_arm_begins_at_home_and_the_path_keeps_its_shape():
    arm, path = load_arm("pcr_concept"), load_path("trajectory_4")
    anchored, shift = anchor_path(arm, path)
    home = kinematics.spine_points(arm, arm.joint_home)[0, -1]
    start = anchored.point(anchored.home_arc_length)
    # The table is printed to 0.001 in, and its x stands that far from the arm's base line.
    np.testing.assert_allclose(start, home, atol=0.002 * INCH)
    s = np.linspace(0.0, path.length, 50)
    moved = anchored.point(s) - path.point(s)
    np.testing.assert_allclose(moved, np.tile([0.0, 0.0, -shift], (50, 1)), atol=1e-12)
    # Home tip: 24.9 in of d1 and twelve segments of 13 in; the table's row 2 is at 174.902 in.
    assert shift == pytest.approx((174.902 - 24.9 - 156.0) * INCH, abs=1e-9)


@pytest.mark.parametrize("name", PATHS)
def test_the_concept_arm_follows_the_reports_paths_in_one_iteration(name):
    arm = load_arm("pcr_concept")
    path, _ = anchor_path(arm, load_path(name, smooth=True))
    plan = make_plan(arm, path)
    assert plan.failures == ()
    # Without offsets Q_i = S_{i+1} whatever the angles, so nothing is left to iterate on.
    assert np.all(plan.solution.iterations == 1)


def test_the_concept_arm_has_the_reports_lessons():
    arm = load_arm("pcr_concept")
    assert np.all(arm.segment_offset == 0.0)
    assert np.ptp(arm.segment_length) == 0.0
    travel = arm.joint_upper[0] - arm.joint_lower[0]
    assert travel == pytest.approx(arm.segment_length.sum(), abs=1e-12)
