"""Figures of an arm: one panel a module, the worst actuator named, nothing cut off or covered."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import matplotlib.figure
import numpy as np
import pytest

from pips_drake.serpentine.arm import SerpentineArm, load_arm
from pips_drake.serpentine.follow_the_leader import REPORT_TOLERANCE, FollowTheLeader, Solution
from pips_drake.serpentine.path_file import load_path
from pips_drake.serpentine.runs import figures, path_figures
from pips_drake.serpentine.tip_path import TipPath
from pips_drake.units import INCH

from ...figure_layout import check_layout

NOWHERE = Path("a.png")


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[mpl.figure.Figure]:
    """The figures instead of files."""
    found: list[mpl.figure.Figure] = []
    for module in (figures, path_figures):
        monkeypatch.setattr(module, "save_figure", lambda figure, file: found.append(figure))
    return found


@pytest.fixture(scope="module")
def arm() -> SerpentineArm:
    return load_arm("prototype")


@pytest.fixture(scope="module")
def path() -> TipPath:
    return load_path("trajectory_4")


@pytest.fixture(scope="module")
def solution(arm: SerpentineArm, path: TipPath) -> Solution:
    return FollowTheLeader(arm, tolerance=REPORT_TOLERANCE).solve(path, path.marks)


@pytest.fixture(scope="module")
def travel(path: TipPath) -> figures.XAxis:
    return figures.tip_travel(path.marks, path.home_arc_length)


def test_joint_values_have_a_panel_a_module(
    drawn: list[mpl.figure.Figure], arm: SerpentineArm, solution: Solution, travel: figures.XAxis
) -> None:
    figures.joint_values_figure(NOWHERE, arm, travel, solution.joints)
    said = check_layout(drawn[0])
    assert len(drawn[0].axes) == 2 + arm.modules
    for name in ("d₁", "θ₂ + 90°", "θ₁₇", "module 7", "tip travel (in)", "tip travel (m)"):
        assert name in said
    assert "θ₁₈" not in said, "the last joint does not move"
    line = drawn[0].axes[-1].get_lines()[0]
    np.testing.assert_allclose(line.get_ydata(), np.degrees(solution.joints[:, -3]))


def test_joints_without_solution_leave_a_gap(
    drawn: list[mpl.figure.Figure], arm: SerpentineArm, solution: Solution
) -> None:
    joints = solution.joints.copy()
    joints[5:] = np.nan
    time = np.arange(len(joints), dtype=np.float64)
    figures.joint_values_figure(NOWHERE, arm, figures.time_axis(time), joints)
    figures.joint_values_figure(NOWHERE, arm, figures.time_axis(time), np.full_like(joints, np.nan))
    assert "time (s)" in check_layout(drawn[0])
    check_layout(drawn[1])


def test_iterations_name_the_largest_error_and_the_tolerance(
    drawn: list[mpl.figure.Figure], solution: Solution, travel: figures.XAxis
) -> None:
    figures.iterations_figure(
        NOWHERE,
        travel,
        solution.spine_error,
        solution.iterations,
        tolerance=REPORT_TOLERANCE,
    )
    said = check_layout(drawn[0])
    assert "largest 0.0676 in" in said  # FTL-95, Appendix D.4
    assert "tolerance 0.1 in" in said
    assert "total 14 at 13 tip points" in said


def test_iterations_stand_unsolved_points(
    drawn: list[mpl.figure.Figure], travel: figures.XAxis
) -> None:
    error = np.full(travel.values.shape, np.nan)
    figures.iterations_figure(NOWHERE, travel, error, np.zeros(13, dtype=int), tolerance=1e-10)
    error[:3] = [np.inf, 0.0, 1e-12]
    figures.iterations_figure(NOWHERE, travel, error, np.zeros(13, dtype=int), tolerance=1e-10)
    check_layout(drawn[0])
    check_layout(drawn[1])


def test_actuators_name_the_worst(
    drawn: list[mpl.figure.Figure], arm: SerpentineArm, solution: Solution, travel: figures.XAxis
) -> None:
    lengths = arm.linkage.length(solution.joints[:, arm.first_actuated_joint :])
    forces = np.zeros(lengths.shape)
    worst = arm.actuator_names.index("L8")
    forces[4, worst] = -0.48 * arm.linkage.force_limit[worst]
    figures.actuators_figure(NOWHERE, arm, travel, lengths, forces)
    figures.actuators_figure(NOWHERE, arm, travel, lengths)
    said = check_layout(drawn[0])
    assert "largest force 48% of its limit (L8)" in said
    groups = len(np.unique(arm.linkage.force_limit))
    assert len(drawn[0].axes) == 2 * groups
    assert len(drawn[1].axes) == groups
    assert "least stroke left" in check_layout(drawn[1])


def test_the_path_stands_in_views_of_one_scale(
    drawn: list[mpl.figure.Figure], arm: SerpentineArm, path: TipPath, solution: Solution
) -> None:
    path_figures.path_figure(
        NOWHERE,
        arm,
        path.point(np.linspace(0.0, path.length, 300)),
        {
            "home": solution.joints[0],
            "end": solution.joints[-1],
            "none": solution.joints[0] * np.nan,
        },
        table_points=path.point(path.marks),
        title="Trajectory 4",
    )
    said = check_layout(drawn[0])
    for word in ("x0 (in)", "y0 (in)", "z0 (in)", "home", "end", "table points"):
        assert word in said
    assert "none" not in said
    inches = []
    for axes in drawn[0].axes:
        size = axes.get_window_extent().size
        inches += [size[0] / np.ptp(axes.get_xlim()), size[1] / np.ptp(axes.get_ylim())]
    np.testing.assert_allclose(inches, inches[0], rtol=1e-3)


def test_travel_is_counted_from_home_in_inches() -> None:
    axis = figures.tip_travel(np.array([1.0, 1.0 + INCH]), 1.0)
    np.testing.assert_allclose(axis.values, [0.0, 1.0], atol=1e-12)
    assert axis.second == ("tip travel (m)", INCH)


def test_a_path_aside_is_seen_from_above_too_and_shows_where_it_fails(
    drawn: list[mpl.figure.Figure], arm: SerpentineArm
) -> None:
    """FTL-95's trajectory 1 lies in the plane of y and z: two views would show a line."""
    aside = load_path("trajectory_1")
    tip = aside.point(5.0)
    path_figures.path_figure(
        NOWHERE,
        arm,
        aside.point(np.linspace(0.0, aside.length, 300)),
        {"home": arm.joint_home},
        failing_tip=tip,
        failing_posture=arm.joint_home * np.nan,  # no posture: the tip alone is shown
    )
    said = check_layout(drawn[0])
    assert "seen along x0" in said
    assert "cannot be followed from this tip on" in said
    assert path_figures.FAILING not in said
    scales = []
    for axes, (across, up) in zip(drawn[0].axes, ((2, 0), (1, 0), (2, 1)), strict=True):
        (mark,) = (line for line in axes.lines if line.get_marker() == "X")
        np.testing.assert_allclose(mark.get_xydata()[0], tip[[across, up]] / INCH, rtol=1e-12)
        size = axes.get_window_extent().size
        scales += [size[0] / np.ptp(axes.get_xlim()), size[1] / np.ptp(axes.get_ylim())]
    np.testing.assert_allclose(scales, scales[0], rtol=1e-3)


def test_the_first_failure_stands_in_the_middle_with_what_is_wrong(
    drawn: list[mpl.figure.Figure], arm: SerpentineArm, path: TipPath
) -> None:
    tip = path.point(path.length)
    sentences = [f"joint theta{j} leaves its limits " + "and so on " * 20 for j in range(3, 9)]
    path_figures.failure_figure(
        NOWHERE,
        arm,
        path.point(np.linspace(path.length - 1.0, path.length, 50)),
        tip,
        arm.joint_home,
        sentences,
    )
    said = check_layout(drawn[0])
    assert "joint theta5 leaves" in said and "theta6" not in said
    assert "(and 3 more, in summary.json)" in said
    for axes, (across, up) in zip(drawn[0].axes, ((2, 0), (1, 0), (2, 1)), strict=True):
        middle = [np.mean(axes.get_xlim()), np.mean(axes.get_ylim())]
        np.testing.assert_allclose(middle, tip[[across, up]] / INCH, rtol=1e-12)
