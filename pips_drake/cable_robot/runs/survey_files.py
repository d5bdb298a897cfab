"""What a survey leaves: tables, maps, the problem report, numbers and the verdict."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pips_drake.cable_robot.defect_map import Finding
from pips_drake.cable_robot.defects import Defect
from pips_drake.cable_robot.panels import panel_points
from pips_drake.cable_robot.runs.platform_replay import write_platform_replay
from pips_drake.cable_robot.runs.survey_figures import map_figure, places_figure, recall_figure
from pips_drake.cable_robot.runs.survey_report import plural, write_report
from pips_drake.cable_robot.runs.task import TaskResult
from pips_drake.cable_robot.scenario import CableRobotScenario
from pips_drake.twin.figures import save_figure
from pips_drake.twin.output_folder import write_whole
from pips_drake.twin.recording import Series, write_csv
from pips_drake.twin.replay import Bookmark, LineInSpace
from pips_drake.twin.sheet import SheetPicture, SheetRow

if TYPE_CHECKING:
    from pips_drake.cable_robot.runs.survey import Survey, SurveyRun

_NAMES = ("before", "after")


def write_survey(
    folder: Path, name: str, scenario: CableRobotScenario, run: SurveyRun
) -> TaskResult:
    """Writes tables, figures and `report.html`; returns numbers and failures."""
    pictures = []
    figures = folder / "figures"
    for label, survey in zip(_NAMES, run.surveys, strict=False):
        save_figure(
            map_figure(survey, run.comparison if label == "after" else None, title=_title(label)),
            figures / f"map_{label}.png",
        )
        _write_findings(folder / f"findings_{label}.csv", survey.findings)
        _write_truth(folder / f"truth_{label}.csv", survey)
        _write_views(folder / f"views_{label}.csv", survey)
    last = _NAMES[len(run.surveys) - 1]
    save_figure(places_figure(run), figures / "places.png")
    save_figure(recall_figure(run), figures / "recall.png")
    if run.comparison is not None:
        _write_comparison(folder / "comparison.csv", run)
    for file, caption in (
        (f"map_{last}.png", "the map of the panels, unrolled"),
        ("places.png", "where findings are, less where their defects are"),
        ("recall.png", "found and missed, by size"),
    ):
        pictures.append(SheetPicture(file=figures / file, caption=caption))
    numbers, failures = _numbers(run), _judge(scenario, run)
    _write_replay(folder / "replay.html", name, run)
    write_report(folder / "report.html", name, run, numbers, failures, figures)
    survey = run.surveys[-1]
    lead = (
        f"{plural(len(survey.raster.panels), 'panel')}, {len(survey.raster)} pictures in "
        f"{survey.flight.duration / 60.0:.1f} min: "
        f"{plural(len(survey.findings), 'defect')} on the map"
    )
    return TaskResult(
        numbers=numbers,
        failures=failures,
        lead=lead,
        rows=_rows(scenario, numbers),
        pictures=pictures,
    )


def _write_replay(file: Path, name: str, run: SurveyRun) -> None:
    """The last survey's flight, with a pin for every finding: red where it is new."""
    survey = run.surveys[-1]
    panels = {panel.name: panel for panel in survey.raster.panels}
    new = {f.name for f in run.comparison.new} if run.comparison is not None else set()
    lines = [
        LineInSpace(
            name=f"findings/{finding.name}",
            points=panel_points(panels[finding.panel], [[finding.u, finding.v]] * 2, [0.0, 0.15]),
            color=(0.7, 0.13, 0.13) if finding.name in new else (0.0, 0.447, 0.698),
        )
        for finding in survey.findings
    ]
    sides = [panel.side for panel in survey.raster.panels]
    starts = [int(np.argmax(survey.raster.panel == k)) for k in range(len(panels))]
    write_platform_replay(
        file,
        run.robot,
        survey.flight.time,
        survey.flight.true,
        # Between two pictures the platform moves some half a metre.
        sample_rate=1.0 / float(np.median(np.diff(survey.flight.time))),
        speed=32.0,
        eye=(-14.0, -8.0 * max(sides, key=sides.count), 11.0),
        target=(-1.5, 0.0, -0.5),
        title=f"{name}: the flight, a picture a step",
        note="pins: findings; red: new since the survey before",
        lines=lines,
        bookmarks=[
            Bookmark(label=panel.name.replace("_", " "), time=float(survey.flight.time[start]))
            for panel, start in zip(survey.raster.panels, starts, strict=True)
        ],
    )


def _title(label: str) -> str:
    return {"before": "Survey before the mission", "after": "Survey after the mission"}[label]


def _numbers(run: SurveyRun) -> dict[str, Any]:
    numbers: dict[str, Any] = {
        "clearance_sampled_min_m": run.clearance,
        "clearance_min_pair": run.clearance_kind,
        "millimetres_per_pixel": 1e3 / run.camera.focal_length,
    }
    for label, survey in zip(_NAMES, run.surveys, strict=False):
        check, flight = survey.check, survey.flight
        off = np.linalg.norm(flight.true.position - flight.estimated.position, axis=1)
        numbers[f"survey_{label}"] = {
            "pictures": len(survey.raster),
            "duration_s": flight.duration,
            "coverage_share": float(np.mean(list(survey.coverage.values()))),
            "coverage_by_panel": survey.coverage,
            "defects": len(survey.defects),
            "findings": len(survey.findings),
            "missed": len(check.missed),
            "missed_names": [_place(d) for d in check.missed],
            "false_alarms": len(check.false_alarms),
            "by_size": [
                {
                    "from_mm": 1e3 * c.low,
                    "to_mm": 1e3 * c.high,
                    "defects": c.defects,
                    "found": c.found,
                    "false_alarms": c.false_alarms,
                }
                for c in check.classes
            ],
            "map_error_max_m": float(check.errors.max(initial=0.0)),
            "map_error_predicted_m": survey.tolerance,
            "size_error_max_m": float(np.abs(check.size_errors).max(initial=0.0)),
            "pose_error_max_m": float(off.max()),
            "tension_min_N": float(flight.tensions.min()),
            "tension_max_N": float(flight.tensions.max()),
            "views_held": int(flight.held.sum()),
            "views_with_a_slack_cable": int(np.any(flight.tensions <= 0.0, axis=1).sum()),
        }
    last = numbers[f"survey_{_NAMES[len(run.surveys) - 1]}"]
    for key in ("coverage_share", "map_error_max_m", "map_error_predicted_m", "false_alarms"):
        numbers[key] = last[key]
    numbers["defects_on_map"], numbers["defects_missed"] = last["findings"], last["missed"]
    numbers["survey_duration_s"] = last["duration_s"]
    if run.comparison is not None:
        compared = run.comparison
        numbers["comparison"] = {
            "new": [f.name for f in compared.new],
            "grown": [late.name for _, late in compared.grown],
            "gone": [f.name for f in compared.gone],
            "unchanged": len(compared.unchanged),
        }
    return numbers


def _judge(scenario: CableRobotScenario, run: SurveyRun) -> list[str]:
    checks = scenario.checks
    failures = []
    for label, survey in zip(_NAMES, run.surveys, strict=False):
        where = f"survey {label} the mission"
        share = 100.0 * float(np.mean(list(survey.coverage.values())))
        if share < checks.coverage_min_percent:
            failures.append(
                f"{where}: {share:.2f} % of the panels were seen; must be "
                f">= {checks.coverage_min_percent:g} %"
            )
        missed = survey.check.missed_from(1e-3 * checks.found_from_mm)
        if missed:
            failures.append(
                f"{where}: missed {len(missed)} of at least {checks.found_from_mm:g} mm, the "
                f"largest a {max(missed, key=lambda d: d.size_m).kind} of "
                f"{1e3 * max(d.size_m for d in missed):.1f} mm"
            )
        alarms = len(survey.check.false_alarms)
        if alarms > checks.false_alarms_max:
            failures.append(f"{where}: {alarms} false alarms; must be <= {checks.false_alarms_max}")
        if not survey.flight.held.all():
            count = int(np.count_nonzero(~survey.flight.held))
            failures.append(f"{where}: at {count} views the cables do not hold the platform")
    if 1e3 * run.clearance < checks.clearance_min_mm:
        failures.append(
            f"{run.clearance_kind}: {1e3 * run.clearance:.0f} mm; must be "
            f">= {checks.clearance_min_mm:g} mm"
        )
    return failures


def _rows(scenario: CableRobotScenario, numbers: dict[str, Any]) -> list[SheetRow]:
    checks = scenario.checks
    rows = []
    for label in _NAMES:
        found = numbers.get(f"survey_{label}")
        if found is None:
            continue
        share, alarms = 100.0 * found["coverage_share"], found["false_alarms"]
        large = [c for c in found["by_size"] if c["from_mm"] >= checks.found_from_mm - 1e-9]
        there, seen = sum(c["defects"] for c in large), sum(c["found"] for c in large)
        error, most = 1e3 * found["map_error_max_m"], 1e3 * found["map_error_predicted_m"]
        rows += [
            SheetRow(label=f"{label}: panels seen", value=f"{share:.2f} %",
                     allowed=f">= {checks.coverage_min_percent:g} %",
                     good=share >= checks.coverage_min_percent),
            SheetRow(label=f"{label}: found from {checks.found_from_mm:g} mm on",
                     value=f"{seen} of {there}", allowed="all", good=seen == there),
            SheetRow(label=f"{label}: false alarms", value=f"{alarms}",
                     allowed=f"<= {checks.false_alarms_max}",
                     good=alarms <= checks.false_alarms_max),
            SheetRow(label=f"{label}: off the true place, at most", value=f"{error:.1f} mm",
                     allowed=f"<= {most:.1f} mm, predicted", good=error <= most),
        ]  # fmt: skip
    least = 1e3 * numbers["clearance_sampled_min_m"]
    rows.append(
        SheetRow(label=numbers["clearance_min_pair"], value=f"{least:.0f} mm",
                 allowed=f">= {checks.clearance_min_mm:g} mm",
                 good=least >= checks.clearance_min_mm)
    )  # fmt: skip
    if "comparison" in numbers:
        compared = numbers["comparison"]
        words = ", ".join(f"{len(compared[key])} {key}" for key in ("new", "grown", "gone"))
        rows.append(SheetRow(label="since before", value=words))
    return rows


def _place(defect: Defect) -> str:
    return (
        f"{defect.kind} of {1e3 * defect.size_m:.1f} mm on {defect.panel} at u {defect.u:.3f} m, "
        f"v {defect.v:.3f} m"
    )


def _table(file: Path, header: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    write_whole(file, text.getvalue())


_FINDING = ("name", "panel", "u_m", "v_m", "kind", "size_mm", "width_mm", "contrast", "pictures",
            "whole", "spread_mm")  # fmt: skip


def _finding_row(finding: Finding) -> list[object]:
    return [
        finding.name,
        finding.panel,
        f"{finding.u:.4f}",
        f"{finding.v:.4f}",
        finding.kind,
        f"{1e3 * finding.size_m:.2f}",
        f"{1e3 * finding.width_m:.2f}",
        f"{finding.contrast:.3f}",
        len(finding.images),
        int(not finding.cut),
        f"{1e3 * finding.spread:.2f}",
    ]


def _write_findings(file: Path, findings: Sequence[Finding]) -> None:
    _table(file, _FINDING, [_finding_row(finding) for finding in findings])


def _write_truth(file: Path, survey: Survey) -> None:
    found = {id(defect): finding for finding, defect in survey.check.pairs}
    rows = []
    for defect in survey.defects:
        finding = found.get(id(defect))
        off = ("", "")
        if finding is not None:
            off = (f"{1e3 * (finding.u - defect.u):.2f}", f"{1e3 * (finding.v - defect.v):.2f}")
        rows.append([
            defect.panel, f"{defect.u:.4f}", f"{defect.v:.4f}", defect.kind,
            f"{1e3 * defect.size_m:.2f}", "" if finding is None else finding.name, *off,
        ])  # fmt: skip
    _table(
        file, ("panel", "u_m", "v_m", "kind", "size_mm", "found_as", "off_u_mm", "off_v_mm"), rows
    )


def _write_views(file: Path, survey: Survey) -> None:
    flight = survey.flight
    values = np.column_stack(
        [
            survey.raster.panel,
            survey.raster.uv,
            np.degrees(survey.raster.tilt),
            flight.wanted.position,
            flight.true.position,
            flight.estimated.position,
            flight.tensions,
        ]
    )
    columns = (
        "panel", "u_m", "v_m", "tilt_deg",
        *(f"{which}_{axis}_m" for which in ("wanted", "true", "estimated") for axis in "xyz"),
        *(f"tension_{k + 1}_N" for k in range(flight.tensions.shape[1])),
    )  # fmt: skip
    write_csv(Series(time=flight.time, values=values, columns=columns), file)


def _write_comparison(file: Path, run: SurveyRun) -> None:
    compared = run.comparison
    assert compared is not None
    rows: list[list[object]] = []
    for word, findings in (("new", compared.new), ("gone", compared.gone)):
        rows += [[word, *_finding_row(finding), ""] for finding in findings]
    for word, pairs in (("grown", compared.grown), ("unchanged", compared.unchanged)):
        rows += [[word, *_finding_row(late), f"{1e3 * old.size_m:.2f}"] for old, late in pairs]
    _table(file, ("change", *_FINDING, "size_before_mm"), rows)
