"""Writes what a run did: series as CSV, and figures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.drives import drive_columns, effort_columns
from pips_drake.serpentine.runs import figures
from pips_drake.serpentine.runs.assessment import Assessment
from pips_drake.serpentine.runs.certified import (
    CertifiedMotion,
    certified_clearance,
)
from pips_drake.twin.recording import Series, write_csv
from pips_drake.twin.run_figures import clearance_figure, tracking_figure

Array = NDArray[np.float64]


def write_series(folder: Path, assessment: Assessment) -> None:
    arm, data = assessment.arm, assessment.data
    tip = [
        data.tip_arc_lengths,
        assessment.spine_errors[:, -1],
        assessment.spine_errors.max(axis=1),
    ]
    tip_columns = ["tip_arc_length_m", "tip_error_m", "spine_error_m"]
    if assessment.deviation is not None:
        tip.append(assessment.deviation)
        tip_columns.append("path_deviation_m")
    clearance = np.column_stack([data.clearance, data.self_clearance])
    for name, values, columns in (
        ("joints", data.joints, arm.joint_columns),
        ("joints_commanded", data.commanded_joints, arm.joint_columns),
        (
            "actuators",
            np.hstack([assessment.drive_coordinates, assessment.drive_efforts]),
            drive_columns(arm) + effort_columns(arm),
        ),
        ("clearance", clearance, ("clearance_m", "self_clearance_m")),
        ("tip", np.column_stack(tip), tuple(tip_columns)),
    ):
        series = Series(time=data.time, values=values, columns=columns)
        write_csv(series, folder / f"{name}.csv")


def write_gaps(folder: Path, arm: SerpentineArm, time: Array, gaps: Array) -> None:
    """How far the legs' loops stood open."""
    columns = tuple(f"{name}_gap_m" for name in arm.actuator_names)
    write_csv(Series(time=time, values=gaps, columns=columns), folder / "loop_gaps.csv")


def write_run_figures(
    folder: Path,
    assessment: Assessment,
    sagging: Assessment | None,
    certified: CertifiedMotion | None,
) -> None:
    pictures = folder / "figures"
    pictures.mkdir(exist_ok=True)
    arm, data, first = assessment.arm, assessment.data, assessment.arm.first_actuated_joint
    figures.actuators_figure(
        pictures / "actuators.png",
        arm,
        figures.time_axis(data.time),
        assessment.drive_coordinates[:, first:],
        assessment.drive_efforts[:, first:],
    )
    clearance_figure(
        pictures / "clearance.png",
        data.time,
        data.clearance,
        pair=data.pairs[assessment.nearest] or (),
        threshold=assessment.checks.clearance_min_mm * 1e-3,
        max_distance=assessment.clearance_range,
        own_distance=data.self_clearance,
        certified=certified_clearance(certified),
    )
    uncompensated = None
    if sagging is not None:
        errors = sagging.spine_errors
        uncompensated = (sagging.data.time, errors.max(axis=1), errors[:, -1])
    tracking_figure(
        pictures / "tracking.png",
        data.time,
        assessment.spine_errors.max(axis=1),
        assessment.spine_errors[:, -1],
        uncompensated=uncompensated,
        limit=assessment.checks.tracking_error_max_mm * 1e-3,
    )
