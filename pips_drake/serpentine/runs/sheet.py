"""The summary sheet of a serpentine run: what an engineer attaches to a mail."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pips_drake.serpentine.scenario import CheckConfig
from pips_drake.twin.sheet import Sheet, SheetPicture, SheetRow, write_sheet
from pips_drake.units import DEGREE

#: Pictures of a run's folder, best first, and what they show; those that exist are used.
_PICTURES = (
    ("least_clearance.png", "the tightest moment"),
    ("scene.png", "scene and path"),
    ("clearance.png", "clearance over the run"),
    ("path.png", "path and postures"),
    ("tracking.png", "simulated spine against the plan"),
    ("joints.png", "joints"),
)
#: A sheet has room for few of a supervisor's decisions.
MOST_DECISIONS = 4


def write_run_sheet(
    folder: Path, summary: Mapping[str, Any], failures: Sequence[str], checks: CheckConfig
) -> None:
    """Writes `summary.png` and `summary.html` into a run's folder, from what is there."""
    files = [(folder / "figures" / name, caption) for name, caption in _PICTURES]
    pictures = [
        SheetPicture(file=file, caption=_caption(caption, summary))
        for file, caption in files
        if file.is_file()
    ]
    motion = f"on path {summary['path']}" if "path" in summary else "with its joints given"
    title = f"{summary['scenario']}: arm {summary['arm']} {motion}"
    sheet = Sheet(
        title=title,
        passed=not failures,
        lead=_lead(summary),
        failures=failures,
        rows=_rows(summary, checks),
        pictures=pictures[:3],
    )
    write_sheet(folder, sheet)


def _lead(summary: Mapping[str, Any]) -> str:
    parts = [f"tip travel {summary['tip_travel_m']:.2f} m"]
    if "cycle_time_s" in summary:
        way = "out, dwell and back" if summary.get("cycle_returns", True) else "out"
        parts.append(f"{way} in {summary['cycle_time_s']:.0f} s")
    if summary.get("supervisor_mode", "permit") != "permit":
        words = {"hold": "held", "retract": "held and taken back", "stop": "stopped"}
        parts.append(f"{words[summary['supervisor_mode']]} by the supervisor")
    elif summary.get("cycle_completed") is False:
        parts.append(f"only the first {summary['simulated_s']:g} s simulated")
    if "cycle_time_s" not in summary:
        parts.append("not simulated: the plan failed")
    return ", ".join(parts)


def _caption(caption: str, summary: Mapping[str, Any]) -> str:
    if caption != "the tightest moment" or not summary.get("clearance_min_pair"):
        return caption
    robot, other = summary["clearance_min_pair"]
    least, when = summary["clearance_sampled_min_m"], summary["clearance_min_time_s"]
    return f"{caption}: {least * 1e3:.0f} mm, {robot} to {other}, at {when:.1f} s"


def _rows(summary: Mapping[str, Any], checks: CheckConfig) -> list[SheetRow]:
    """Rows for the numbers that the summary has."""
    rows = []

    def add(key: str, label: str, factor: float, unit: str, low: float | None, high: float | None,
            note: str = "") -> None:  # fmt: skip
        if summary.get(key) is None:
            return
        value = float(summary[key]) * factor
        good = None
        allowed = ""
        if low is not None:
            good, allowed = value >= low, f">= {low:g} {unit}"
        if high is not None:
            good, allowed = value <= high, f"<= {high:g} {unit}"
        rows.append(
            SheetRow(label=label, value=f"{value:.3g} {unit}{note}", allowed=allowed, good=good)
        )

    clear = summary.get("clearance_in_range", True)
    least = checks.clearance_min_mm
    add("clearance_sampled_min_m", f"clearance to the scene{'' if clear else ', over'}", 1e3, "mm",
        least, None)  # fmt: skip
    proved = "the same, proved at every instant"
    add("clearance_certified_min_m", proved, 1e3, "mm", least, None)
    add("clearance_certified_min_with_errors_m", "as commanded, if the joints are off", 1e3, "mm",
        None, None)  # fmt: skip
    own = checks.self_clearance_min_mm
    add("self_clearance_sampled_min_m", "clearance to itself and its rail", 1e3, "mm", own, None)
    add("self_clearance_certified_min_m", proved, 1e3, "mm", own, None)
    track = checks.tracking_error_max_mm
    add("tip_error_max_m", "tip to plan", 1e3, "mm", None, track)
    if "tip_error_max_m" in summary:
        add("spine_error_max_m", "spine to plan", 1e3, "mm", None, track)
    uncompensated = "spine to plan, sag not compensated"
    add("spine_error_max_uncompensated_m", uncompensated, 1e3, "mm", None, None)
    add("path_deviation_max_m", "centre line to path", 1e3, "mm", None, None)
    overrun = -checks.joint_overrun_max_deg
    joint = summary.get("joint_margin_min_joint")
    add("joint_margin_min_rad", f"joint limits, left{f' ({joint})' if joint else ''}", 1 / DEGREE,
        "deg", overrun, None)  # fmt: skip
    add("actuator_stroke_margin_min_m", "actuator strokes, left", 1e3, "mm", 0.0, None)
    force, speed = 100.0 * checks.force_fraction_max, 100.0 * checks.speed_fraction_max
    drive = summary.get("drive_effort_max_drive")
    add("drive_effort_max_fraction", f"drive force{f' ({drive})' if drive else ''}", 100.0, "%",
        None, force)  # fmt: skip
    add("drive_speed_max_fraction", "drive speed", 100.0, "%", None, speed)
    decisions = summary.get("supervisor_decisions", [])
    for decision in decisions[:MOST_DECISIONS]:
        cause = "" if decision["cause"] == "none" else f" ({decision['cause'].replace('_', ' ')})"
        label, what = f"supervisor at {decision['time_s']:.1f} s", f"{decision['to']}{cause}"
        rows.append(SheetRow(label=label, value=what, good=decision["to"] == "permit"))
    if len(decisions) > MOST_DECISIONS:
        rows.append(SheetRow(label="supervisor", value=f"{len(decisions)} decisions", good=False))
    add("seen_fraction", "payload's surface seen", 100.0, "%", None, None)
    return rows
