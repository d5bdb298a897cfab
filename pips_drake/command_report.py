"""What the commands print of a verdict, and the exit code that it means."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pips_drake.twin.verdict import Verdict

DONE, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130


def complain(error: object, code: int) -> int:
    """Says what is wrong on one line, whatever stands in the names it quotes."""
    shown = (
        letter if letter.isprintable() else letter.encode("unicode_escape").decode()
        for letter in str(error)
    )
    print("pips: " + "".join(shown), file=sys.stderr)
    return code


#: What is printed of a summary: key, words, factor, unit.
Line = tuple[str, str, float, str]

_PLAN_LINES: tuple[Line, ...] = (
    ("path_deviation_max_m", "centre line to path, at most", 1e3, "mm"),
    ("joint_margin_min_rad", "joint limits, left at least", 57.29577951308232, "deg"),
)
FOLLOW_LINES: tuple[Line, ...] = (
    ("tip_positions", "tip positions", 1, ""),
    ("iterations_max", "iterations, at most", 1, ""),
    ("spine_error_max_m", "spine error, at most", 1 / 0.0254, "in"),
    *_PLAN_LINES,
)
_CLEARANCE_LINES: tuple[Line, ...] = (
    ("clearance_sampled_min_m", "clearance to the scene, sampled least", 1e3, "mm"),
    ("clearance_certified_min_m", "clearance to the scene, proved at least", 1e3, "mm"),
    ("clearance_certified_min_with_errors_m", "as commanded, joints with errors", 1e3, "mm"),
    ("self_clearance_sampled_min_m", "clearance to itself, sampled least", 1e3, "mm"),
    ("self_clearance_certified_min_m", "clearance to itself, proved at least", 1e3, "mm"),
)
_DRIVE_LINES: tuple[Line, ...] = (
    ("actuator_force_max_fraction", "actuator force, at most", 100, "% of its limit"),
    ("drive_speed_max_fraction", "drive speed, at most", 100, "% of its limit"),
)
CHECK_LINES: tuple[Line, ...] = (
    *_CLEARANCE_LINES,
    *_PLAN_LINES,
    *_DRIVE_LINES,
    ("motion_duration_constant_s", "way out at constant speed", 1, "s"),
    ("motion_duration_fastest_s", "way out as fast as the drives can", 1, "s"),
)
PLAN_LINES: tuple[Line, ...] = (
    ("tip_travel_m", "way of the tip", 1, "m"),
    ("scan_reached_share", "pattern, reached", 100, "%"),
    ("coverage_share", "surface, seen", 100, "%"),
    *_CLEARANCE_LINES,
    *_PLAN_LINES,
    *_DRIVE_LINES,
    ("motion_duration_s", "motion", 1, "s"),
    ("planning_wall_s", "planned and proved in", 1, "s"),
)
_CABLE_LINES: tuple[Line, ...] = (
    ("tension_slack_min_N", "room that the bounds leave for tensions", 1, "N"),
    ("rest_clearance_m", "clearance at rest, without the cable", 1e3, "mm"),
    ("volume_usable_m3", "workspace that can be used", 1, "m3"),
    ("position_error_max_m", "position, off by lengths, at most", 1e3, "mm"),
    ("stiffness_softest_N_m", "softest direction", 1e-3, "kN/m"),
    ("moment_borne_min_N_m", "moment borne about every axis", 1, "N m"),
    ("coverage_share", "surface, seen", 100, "%"),
    ("defects_on_map", "defects on the map", 1, ""),
    ("defects_missed", "defects missed", 1, ""),
    ("false_alarms", "false alarms", 1, ""),
    ("map_error_max_m", "off their true places, at most", 1e3, "mm"),
    ("map_error_predicted_m", "which the cables' errors predict", 1e3, "mm"),
    ("survey_duration_s", "a survey takes", 1 / 60.0, "min"),
)
SIMULATE_LINES: tuple[Line, ...] = (
    *_CLEARANCE_LINES,
    ("spine_error_max_m", "spine to plan, at most", 1e3, "mm"),
    *_PLAN_LINES,
    *_DRIVE_LINES,
    ("cycle_time_s", "out, dwell and back", 1, "s"),
    ("palm_error_max_m", "palm to where it was sent, at most", 1e3, "mm"),
    ("torque_fraction_max", "joint torque, at most", 100, "% of its limit"),
    ("penetration_max_m", "pressed into each other, at most", 1e3, "mm"),
    ("inhibits", "motion inhibited, times", 1, ""),
    *_CABLE_LINES,
    ("docking_distance_m", "probe to port when docked", 1e3, "mm"),
    ("docking_angle_rad", "angle when docked", 57.29577951308232, "deg"),
    ("real_time_rate", "simulated", 1, "times real time"),
)


def report(verdict: Verdict, lines: Sequence[Line], *, own_scene: bool = False) -> int:
    """Prints a verdict for a person; returns the exit code."""
    summary = verdict.summary
    print(f"{summary.get('scenario') or summary.get('path', '')}: {verdict.word.upper()}")
    for failure in verdict.failures:
        print(f"  {failure}")
    for key, words, factor, unit in lines:
        if summary.get(key) is not None:
            print(f"  {words:<40}{_shown(summary, key, factor)} {unit}".rstrip())
    if "phases" in summary:
        print(f"  {'phases':<40}{' -> '.join(summary['phases'])}")
    if "comparison" in summary:
        changes = summary["comparison"]
        words = ", ".join(f"{len(changes[key])} {key}" for key in ("new", "grown", "gone"))
        print(f"  {'since the survey before':<40}{words}")
    binding = summary.get("motion_binding_limits_s")
    if binding and lines is CHECK_LINES:
        print(f"  {'held back by':<40}{_shares(binding)}")
    for way in summary.get("alternatives", ()):
        chosen = "taken" if way["choose"] == summary["alternative_chosen"] else "left"
        print(f"  way {way['choose']}, {chosen:<33}{way['length_m']:.4g} m: {way['words']}")
    for note in summary.get("notes", ()):
        print(f"  note: {note}")
    if summary.get("rail_shift_m"):
        inches = summary["rail_shift_m"] / 0.0254
        print(f"  re-anchored: the rail stands {inches:+.2f} in along z0: the path begins home")
    # A run that was held says so among its failures.
    supervised = summary.get("supervisor_mode", "permit") != "permit"
    if summary.get("cycle_completed") is False and not supervised:
        print(f"  (only the first {summary['simulated_s']:g} s of the run)")
    for line in summary.get("scene_placement", ()) if own_scene else ():
        print(f"  {line}")
    for warning in summary.get("scene_warnings", ()):
        print(f"  warning: {warning}")
    if verdict.folder is not None:
        print(f"  written to {verdict.folder}")
    return DONE if verdict.passed else FAILED


def print_margins(margins: Mapping[str, Any]) -> None:
    """The probability that a plan passes under tolerances, and its tightest case."""
    low, high = margins["probability_interval"]
    print(
        f"passes in {margins['passed']} of {margins['draws']} draws: "
        f"{100.0 * margins['probability']:.4g} % (with {100.0 * margins['confidence']:g} % "
        f"confidence between {100.0 * low:.4g} % and {100.0 * high:.4g} %)"
    )
    for words, row in (("nominal", margins["nominal"]), ("tightest case", margins["tightest"])):
        if row is None or row["clearance_sampled_min_m"] is None:
            continue
        print(
            f"  {words:<16}{row['clearance_sampled_min_m'] * 1e3:.4g} mm, "
            f"{row['clearance_min_pair']} (case {row['case']}, {row['kind']})"
        )


def _shares(times: Mapping[str, float]) -> str:
    """The first three of some times, in percent of all."""
    total = sum(times.values())
    shown = [f"{name} ({100.0 * time / total:.0f} %)" for name, time in list(times.items())[:3]]
    return ", ".join(shown + ["..."] * (len(times) > 3))


def _shown(summary: Mapping[str, Any], key: str, factor: float) -> str:
    value = f"{float(summary[key]) * factor:.4g}"
    if key != "clearance_sampled_min_m":
        return value
    if not summary.get("clearance_in_range", True):
        return f"over {value}"
    return value
