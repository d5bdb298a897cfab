"""The problem report: one page with maps, every defect with its picture, and what has changed."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pips_drake.twin.output_folder import write_whole

if TYPE_CHECKING:
    from pips_drake.cable_robot.defect_map import Finding
    from pips_drake.cable_robot.runs.survey import Survey, SurveyRun

_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; max-width: 72em; margin: 2em auto; padding: 0 1em;
  color: #222; }
h1 { font-size: 1.5em; } h2 { font-size: 1.2em; margin-top: 2em; }
table { border-collapse: collapse; width: 100%; }
th { text-align: left; font-weight: 600; }
td, th { padding: .25em .9em .25em 0; border-bottom: 1px solid #e5e5e5; vertical-align: middle; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; }
td img { width: 96px; height: 96px; display: block; image-rendering: pixelated; }
img.wide { max-width: 100%; }
.new { color: #B22222; font-weight: 600; } .grown { color: #B36B00; font-weight: 600; }
.fail { color: #B22222; } .muted { color: #666; }
@media print { tr { break-inside: avoid; } }
"""


def write_report(
    file: Path,
    name: str,
    run: SurveyRun,
    numbers: Mapping[str, Any],
    failures: Sequence[str],
    figures: Path,
) -> None:
    """Writes the report as one page with its pictures inside."""
    survey = run.surveys[-1]
    label = "after" if run.after is not None else "before"
    changes = _changes(run)
    order = {"new": 0, "grown": 1}
    findings = sorted(
        survey.findings, key=lambda f: (order.get(changes.get(f.name, ""), 2), -f.size_m)
    )
    parts = [
        f"<h1>Radiator problem report: {html.escape(name)}</h1>",
        _lead(run, numbers[f"survey_{label}"]),
        "".join(f'<p class="fail">{html.escape(text)}</p>' for text in failures),
        "<h2>Map</h2>",
        "<p>Panels unrolled; u runs aft from a panel's forward edge, v along its arc from the "
        "hinge. Port is a mirror image of starboard: v runs up the page on port, down on "
        "starboard, as one sees them from above with the nose on the left.</p>",
        _wide(figures / f"map_{label}.png", "map of the panels"),
        f"<h2>Defects ({len(findings)})</h2>",
        _table(findings, survey, changes, _before(run)),
    ]
    if run.comparison is not None and run.comparison.gone:
        parts += [
            f"<h2>Gone since the survey before ({len(run.comparison.gone)})</h2>",
            _table(run.comparison.gone, run.before, {}, {}, words=", before"),
        ]
    parts += [
        "<h2>How far to trust it</h2>",
        _trust(run),
        _wide(figures / "recall.png", "found and missed by size"),
        _wide(figures / "places.png", "errors of places"),
    ]
    body = "\n".join(parts)
    write_whole(
        file,
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f"<title>Radiator problem report: {html.escape(name)}</title>\n<style>{_STYLE}</style>\n"
        f"</head>\n<body>\n{body}\n</body>\n</html>\n",
    )


def plural(count: int, word: str) -> str:
    """``1 panel``, ``2 panels``."""
    return f"{count} {word}" + "s" * (count != 1)


def _lead(run: SurveyRun, numbers: Mapping[str, Any]) -> str:
    text = (
        f"{plural(len(run.before.raster.panels), 'panel')}, {numbers['pictures']} pictures of "
        f"{run.camera.width} x {run.camera.height} pixels in {numbers['duration_s'] / 60.0:.0f} "
        f"min; {100.0 * numbers['coverage_share']:.2f} % of the surface seen. "
        f"{plural(numbers['findings'], 'defect')} found."
    )
    if run.comparison is not None:
        compared = run.comparison
        text += (
            f" Since the survey before the mission: {len(compared.new)} new, "
            f"{len(compared.grown)} grown, {len(compared.gone)} gone, "
            f"{len(compared.unchanged)} unchanged."
        )
    return f"<p>{html.escape(text)}</p>"


def _changes(run: SurveyRun) -> dict[str, str]:
    if run.comparison is None:
        return {}
    changes = {finding.name: "new" for finding in run.comparison.new}
    changes |= {late.name: "grown" for _, late in run.comparison.grown}
    return changes


def _before(run: SurveyRun) -> dict[str, float]:
    """Sizes in the survey before, m, by the later names."""
    if run.comparison is None:
        return {}
    pairs = [*run.comparison.grown, *run.comparison.unchanged]
    return {late.name: old.size_m for old, late in pairs}


def _table(
    findings: Sequence[Finding],
    survey: Survey,
    changes: Mapping[str, str],
    before: Mapping[str, float],
    words: str = "",
) -> str:
    rows = []
    for finding in findings:
        change = changes.get(finding.name, "")
        size = f"{1e3 * finding.size_m:.1f}" + (" or more" if finding.cut else "")
        was = f"{1e3 * before[finding.name]:.1f}" if finding.name in before else ""
        rows.append(
            f'<tr id="{finding.name}{words.replace(", ", "-")}"><td>'
            f'<img alt="{finding.kind}" '
            f'src="{_data(survey.crops[finding.name])}"></td>'
            f'<td>{finding.name}{words}</td><td class="{change}">{change}</td>'
            f"<td>{finding.kind}</td>"
            f'<td class="number">{finding.u:.3f}</td><td class="number">{finding.v:.3f}</td>'
            f'<td class="number">{size}</td><td class="number">{1e3 * finding.width_m:.1f}</td>'
            f'<td class="number">{was}</td><td class="number">{len(finding.images)}</td></tr>'
        )
    head = (
        "<tr><th></th><th>defect</th><th>change</th><th>looks like</th>"
        '<th class="number">u (m)</th><th class="number">v (m)</th>'
        '<th class="number">length (mm)</th><th class="number">width (mm)</th>'
        '<th class="number">length before (mm)</th><th class="number">pictures</th></tr>'
    )
    return f"<table>\n{head}\n" + "\n".join(rows) + "\n</table>"


def _trust(run: SurveyRun) -> str:
    lines = []
    for words, survey in zip(("before", "after"), run.surveys, strict=False):
        check = survey.check
        lines.append(
            f"Survey {words} the mission, beside the defects that were painted on: "
            f"{len(check.pairs)} of {len(survey.defects)} found, {len(check.false_alarms)} false "
            f"alarms. Places are off by up to {1e3 * check.errors.max(initial=0.0):.1f} mm; the "
            f"cables' length errors explain up to {1e3 * survey.tolerance:.1f} mm. Lengths are off "
            f"by up to {1e3 * np.abs(check.size_errors).max(initial=0.0):.1f} mm."
        )
        for defect in sorted(check.missed, key=lambda d: -d.size_m):
            lines.append(
                f"Missed: {defect.kind} of {1e3 * defect.size_m:.1f} mm (contrast "
                f"{defect.contrast:+.2f}) on {defect.panel}, u {defect.u:.3f} m, "
                f"v {defect.v:.3f} m."
            )
    return "".join(f"<p>{html.escape(line)}</p>" for line in lines)


def _wide(file: Path, words: str) -> str:
    data = base64.b64encode(file.read_bytes()).decode()
    return f'<p><img class="wide" alt="{words}" src="data:image/png;base64,{data}"></p>'


def _data(picture: NDArray[np.uint8]) -> str:
    from PIL import Image

    text = io.BytesIO()
    Image.fromarray(picture).save(text, format="png")
    return "data:image/png;base64," + base64.b64encode(text.getvalue()).decode()
