"""`pips follow` and `pips check`: what can be said of a path without simulating it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pips_drake.errors import InputError
from pips_drake.serpentine.anchoring import anchor_path
from pips_drake.serpentine.arm import SerpentineArm, load_arm
from pips_drake.serpentine.drives import drive_efforts, drive_limits, levers
from pips_drake.serpentine.follow_the_leader import FollowTheLeader
from pips_drake.serpentine.path_file import load_path
from pips_drake.serpentine.plan import Plan, make_plan, tip_samples
from pips_drake.serpentine.runs import figures, path_figures
from pips_drake.serpentine.scenario import check_solver
from pips_drake.twin.output_folder import output_folder
from pips_drake.twin.recording import Series, write_csv
from pips_drake.twin.summary import versions, write_summary
from pips_drake.twin.verdict import Verdict
from pips_drake.units import DEGREE, INCH

Array = NDArray[np.float64]

_INDEX = "tip_arc_length_m"


def follow(
    path: str,
    *,
    arm: str = "prototype",
    step_in: float | None = None,
    tolerance_in: float = 1e-9,
    max_iterations: int = 50,
    out: Path,
    force: bool = False,
) -> Verdict:
    """Solves follow-the-leader along a path and writes joints, lengths, figures and a summary.

    Args:
        path: a shipped path or a file; a table is followed as printed, corners and all.
        arm: a shipped arm or a file.
        step_in: spacing of the tip along the path, in; the path's own points without it.
        tolerance_in: spine error at which the iteration stops, in; above 1e-9 the report's mode.
        max_iterations: a tip position.
        out: the folder to write; it appears whole or not at all.
        force: replace an earlier result there.

    Raises:
        InputError: the arm, the path or a number cannot be used; nothing is written.
    """
    if step_in is not None and not (np.isfinite(step_in) and step_in > 0.0):
        raise InputError(f"step_in = {step_in} in; must be > 0 and finite")
    check_solver(tolerance_in, max_iterations)
    the_arm = load_arm(arm)
    the_path, rail_shift = anchor_path(the_arm, load_path(path))
    solver = FollowTheLeader(the_arm, tolerance=tolerance_in * INCH, max_iterations=max_iterations)
    tips = the_path.marks if step_in is None else tip_samples(the_path, step_in * INCH)
    plan = make_plan(the_arm, the_path, tip_arc_lengths=tips, solver=solver)
    summary: dict[str, Any] = {
        "verdict": "fail" if plan.failures else "pass",
        "failures": plan.failures,
    }
    summary |= {"versions": versions(), "rail_shift_m": rail_shift} | plan_numbers(plan)
    with output_folder(out, force=force) as folder:
        _write_tables(folder, plan)
        (folder / "figures").mkdir()
        write_plan_figures(folder / "figures", plan)
        write_summary(folder / "summary.json", summary)
    return Verdict(failures=plan.failures, summary=summary, folder=out)


def plan_numbers(plan: Plan) -> dict[str, Any]:
    """The numbers of a plan for `summary.json`."""
    arm, path, solution = plan.arm, plan.path, plan.solution
    numbers: dict[str, Any] = {
        "arm": arm.name,
        "path": path.name,
        "path_version": path.version,
        "path_length_m": path.length,
        "tip_travel_m": path.travel,
        "tip_positions": len(solution.tip_arc_lengths),
        "tip_positions_solved": int(solution.solved.sum()),
        "tolerance_m": plan.solver.tolerance,
    }
    if not solution.solved.any():
        return numbers
    margins = plan.joint_margins[solution.solved]
    hinges, slides = margins[:, ~arm.is_prismatic], margins[:, arm.is_prismatic]
    return numbers | {
        "iterations_max": solution.iterations.max(),
        "spine_error_max_m": solution.spine_error[solution.solved].max(),
        "path_deviation_max_m": np.nanmax(plan.centre_line_deviation),
        "joint_margin_min_rad": hinges.min(),
        "rail_margin_min_m": slides.min(),
    }


def write_plan_figures(folder: Path, plan: Plan) -> None:
    """Joints and iterations after FTL-95 D.3 and D.4, and the path with four postures.

    Of a path that cannot be followed, the last one also shows where the first failure is, and a
    fourth one what is around it.
    """
    arm, path, solution = plan.arm, plan.path, plan.solution
    travel = figures.tip_travel(solution.tip_arc_lengths, path.home_arc_length)
    figures.joint_values_figure(folder / "joints.png", arm, travel, plan.joints)
    figures.iterations_figure(
        folder / "iterations.png",
        travel,
        solution.spine_error,
        solution.iterations,
        tolerance=plan.solver.tolerance,
    )
    solved, postures = np.flatnonzero(solution.solved), {}
    if solved.size:
        stages = solved[np.linspace(0, solved.size - 1, 4).round().astype(int)]
        names = ("home", "one third", "two thirds", "end")
        postures = {name: plan.joints[i] for name, i in zip(names, stages, strict=True)}
    failing_tip = failing_posture = None
    if plan.first_failing_tip is not None:
        failing_tip = path.point(plan.first_failing_tip)
        # NaN, which is not drawn, where there is no posture at all.
        failing_posture = FollowTheLeader(arm).solve(path, plan.first_failing_tip).joints[0]
        near = plan.first_failing_tip + np.linspace(-2.0, 2.0, 801)
        path_figures.failure_figure(
            folder / "failure.png",
            arm,
            path.point(np.clip(near, 0.0, path.length)),
            failing_tip,
            failing_posture,
            plan.failures,
            table_points=path.point(path.marks),
        )
    path_figures.path_figure(
        folder / "path.png",
        arm,
        path.point(np.linspace(0.0, path.length, 400)),
        postures,
        table_points=path.point(path.marks),
        failing_tip=failing_tip,
        failing_posture=failing_posture,
    )


def drive_numbers(plan: Plan, holding_efforts: Array, tip_speed: float) -> dict[str, Any]:
    """What the drives would need: force against gravity, and speed at a tip speed (m/s)."""
    arm, solved = plan.arm, plan.solution.solved
    joints = plan.joints[solved]
    _, _, speed_limit, effort_limit = drive_limits(arm)
    efforts = np.abs(drive_efforts(arm, joints, holding_efforts)) / effort_limit
    speeds = np.abs(levers(arm, joints) * plan.rates[solved]) * tip_speed / speed_limit
    first = arm.first_actuated_joint
    return {
        "actuator_force_max_fraction": efforts[:, first:].max(),
        "drive_effort_max_fraction": efforts.max(),
        "drive_speed_max_fraction": speeds.max(),
    }


def _write_tables(folder: Path, plan: Plan) -> None:
    arm, solution = plan.arm, plan.solution
    count = np.column_stack([solution.iterations, solution.spine_error])
    index = solution.tip_arc_lengths
    tables: dict[str, tuple[Array, tuple[str, ...]]] = {
        "joints": (
            np.hstack([plan.joints, count]),
            (*arm.joint_columns, "iterations", "spine_error_m"),
        ),
        "spine_points": (
            solution.spine_points.reshape(len(index), -1),
            tuple(f"{axis}{j}_m" for j in arm.spine_indices for axis in "xyz"),
        ),
        "actuators": (plan.drive_lengths, tuple(f"{name}_m" for name in arm.actuator_names)),
    }
    for name, (values, columns) in tables.items():
        series = Series(time=index, values=values, columns=columns)
        write_csv(series, folder / f"{name}.csv", index=_INDEX)
    units = np.where(arm.is_prismatic, INCH, DEGREE)
    in_deg = Series(
        time=index / INCH,
        values=np.hstack([plan.joints / units, count / [1.0, INCH]]),
        columns=(*_report_columns(arm), "iterations", "spine_error_in"),
    )
    write_csv(in_deg, folder / "joints_in_deg.csv", index="tip_arc_length_in")


def _report_columns(arm: SerpentineArm) -> tuple[str, ...]:
    """Joint names with the report's units: `d1_in`, `theta2_deg`, ..."""
    return tuple(
        f"{name}_in" if prismatic else f"{name}_deg"
        for name, prismatic in zip(arm.joint_names, arm.is_prismatic, strict=True)
    )
