"""The summary sheet of a run: what an engineer attaches to a mail."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pips_drake.remote_manipulator.runs.data import millimetres
from pips_drake.remote_manipulator.scenario import CheckConfig
from pips_drake.twin.sheet import Sheet, SheetPicture, SheetRow, write_sheet
from pips_drake.units import DEGREE

_PICTURES = (
    ("phases.png", "the arm in each phase"),
    ("timeline.png", "phases, flags and clearance"),
    ("docking.png", "the way into the port"),
    ("joints.png", "joints"),
    ("stations.png", "all camera stations, in the middle of the run"),
)


def write_run_sheet(
    folder: Path, summary: Mapping[str, Any], failures: Sequence[str], checks: CheckConfig
) -> None:
    """Writes `summary.png` and `summary.html` into a run's folder, from what is there.

    Args:
        summary: of a run that was given up it has no numbers.
    """
    if "phases" not in summary:
        title = str(summary["scenario"])
        nothing = Sheet(title=title, passed=False, lead="", failures=failures, rows=[], pictures=[])
        write_sheet(folder, nothing)
        return
    pictures = [
        SheetPicture(file=folder / "figures" / name, caption=caption)
        for name, caption in _PICTURES
        if (folder / "figures" / name).is_file()
    ]
    phases = " → ".join(phase.replace("_", " ") for phase in summary["phases"])
    sheet = Sheet(
        title=f"{summary['scenario']}: payload of {summary['payload_mass_kg']:.0f} kg",
        passed=not failures,
        lead=f"{phases}, in {summary['simulated_s']:.0f} s",
        failures=failures,
        rows=_rows(summary, checks),
        pictures=pictures[:3],
    )
    write_sheet(folder, sheet)


def _rows(summary: Mapping[str, Any], checks: CheckConfig) -> list[SheetRow]:
    least = 1e3 * summary["clearance_sampled_min_m"]
    over = "" if summary["clearance_in_range"] else "over "
    asked = checks.clearance_min_mm > 0.0
    inhibits = summary["inhibits"]
    depth, error = (1e3 * summary[key] for key in ("penetration_max_m", "palm_error_max_m"))
    allowed_inhibits = f"{checks.inhibits_min} .. {checks.inhibits_max}"
    rows = [
        SheetRow(
            label="clearance of arm and payload",
            value=f"{over}{millimetres(1e-3 * least)}",
            allowed=f">= {checks.clearance_min_mm:g} mm" if asked else "",
            good=least >= checks.clearance_min_mm if asked else None,
        ),
        SheetRow(
            label="deepest contact",
            value=f"{depth:.2f} mm",
            allowed=f"<= {checks.penetration_max_mm:g} mm",
            good=depth <= checks.penetration_max_mm,
        ),
        SheetRow(
            label="motion inhibited",
            value=f"{inhibits} times",
            allowed=allowed_inhibits,
            good=checks.inhibits_min <= inhibits <= checks.inhibits_max,
        ),
        SheetRow(
            label="palm to where it was sent",
            value=f"{error:.0f} mm",
            allowed=f"<= {checks.tracking_error_max_mm:g} mm",
            good=error <= checks.tracking_error_max_mm,
        ),
        SheetRow(
            label=f"torque, most at {summary['torque_fraction_max_joint']}",
            value=f"{100.0 * summary['torque_fraction_max']:.0f} %",
            allowed="of its limit",
        ),
        SheetRow(
            label=f"joint limits, least left at {summary['joint_margin_min_joint']}",
            value=f"{summary['joint_margin_min_rad'] / DEGREE:.1f} deg",
        ),
        SheetRow(label="weld's slip", value=f"{1e3 * summary['weld_slip_max_m']:.2g} mm"),
    ]
    if "docking_distance_m" in summary:
        rows += [
            SheetRow(
                label="probe to port when docked",
                value=f"{1e3 * summary['docking_distance_m']:.1f} mm",
            ),
            SheetRow(
                label="angle when docked",
                value=f"{summary['docking_angle_rad'] / DEGREE:.2f} deg",
            ),
        ]
    return rows
