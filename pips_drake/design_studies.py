"""Design studies by name: `pips study offsets`.

From Python:

    >>> from pips_drake.design_studies import study
    >>> rows = study("offsets", out="out/study_offsets", jobs=2).rows
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pips_drake.config import dump_yaml, load_plain, load_yaml, require
from pips_drake.errors import InputError
from pips_drake.scenarios import MACHINES, machine_of
from pips_drake.scene.packages import find_file, find_study_file, list_names
from pips_drake.twin.output_folder import SUMMARY_NAME, write_whole
from pips_drake.twin.study.figure import study_figure
from pips_drake.twin.study.probability import CONFIDENCE, pass_probability
from pips_drake.twin.study.run import run_cases
from pips_drake.twin.study.store import open_store
from pips_drake.twin.study.study_file import StudyFile
from pips_drake.twin.study.table import table_rows, write_table
from pips_drake.twin.study.workers import Cluster, Processes, Workers
from pips_drake.twin.summary import versions, write_summary


@dataclass(frozen=True, kw_only=True)
class StudyResult:
    """A finished study.

    Attributes:
        rows: of its table, by case.
        summary: what `summary.json` holds.
        folder: where the results are.
    """

    rows: Sequence[Mapping[str, Any]]
    summary: Mapping[str, Any]
    folder: Path


def study(
    name: str,
    *,
    out: str | Path,
    jobs: int | None = None,
    cluster: str | None = None,
    force: bool = False,
) -> StudyResult:
    """Computes every case of a study and writes its table and figure.

    A study that was stopped goes on where it was: cases that are done are not computed again unless
    what they compute has changed. Failures are rows of the table.

    Args:
        name: a shipped study, or a file.
        out: the folder, also of the finished cases of a study that was stopped.
        jobs: processes; as many as there are processors by default.
        cluster: address of a Dask scheduler, whose workers compute instead.
        force: start anew where there are results.

    Raises:
        InputError: something cannot be used; nothing is computed.
    """
    jobs = available_processors() if jobs is None else jobs
    require(1 <= jobs <= 4096, "--jobs", jobs, "1 .. 4096")
    file = find_study_file(name)
    config = load_yaml(StudyFile, file)
    # The study's own folder holds its scenarios, as a scenario's holds its arms.
    scenario_file = find_file("scenario", config.scenario, inside=file.parent)
    machine = machine_of(scenario_file)
    studies = MACHINES[machine].studies
    if studies is None:
        raise InputError(
            f"{file}: scenario {config.scenario} is of machine {machine}, of which "
            "there are no studies"
        )
    kind = studies()
    cases = kind.make_cases(config, scenario_file)
    workers: Workers = Processes(jobs=min(jobs, len(cases)), limit_s=config.case_limit_s)
    if cluster is not None:
        workers = Cluster(address=cluster)
    out, start = Path(out), time.perf_counter()
    with open_store(out, name=file.stem, force=force) as store:
        outcomes = run_cases(cases, store=store, workers=workers, name=file.stem)
        rows = table_rows(cases, outcomes, kind.columns(config))
        write_table(out / "study.csv", rows)
        fields = [vary.field for vary in config.vary]
        if fields:
            study_figure(
                out / "study.png",
                rows,
                x=fields[0],
                # In a list, the other fields change together with the first.
                others=fields[1:] if config.combine == "grid" else (),
                columns=kind.panels(config),
                title=f"Study '{file.stem}' of {scenario_file.stem}",
            )
            margins = {}
        else:
            margins = {"margins": margins_of(rows, kind.tightest)}
        write_whole(out / "study.yaml", dump_yaml(config))
        states = [outcome.status for outcome in outcomes.values()]
        summary = {
            "study": file.stem,
            "scenario": scenario_file.stem,
            "varied": fields,
            "cases": len(cases),
            "cases_by_status": {word: states.count(word) for word in ("done", "failed", "died")},
            "cases_computed_s": sum(outcome.wall_s for outcome in outcomes.values()),
            "wall_s": time.perf_counter() - start,
            "versions": versions(),
        } | margins
        write_summary(out / SUMMARY_NAME, summary)  # last: the study is whole
    return StudyResult(rows=rows, summary=summary, folder=out)


def margins_of(rows: Sequence[Mapping[str, Any]], tightest: str) -> dict[str, Any]:
    """What the rows of a study of tolerances say: the probability of passing, the tightest case.

    A case that could not be computed has not passed.

    Args:
        tightest: the number that says how tight a case was.
    """
    drawn = [row for row in rows if row["kind"] == "draw"]
    passed = sum(row["verdict"] == "pass" for row in drawn)
    share, low, high = pass_probability(passed, len(drawn))
    known = [row for row in rows if row[tightest] is not None]
    least = min(known, key=lambda row: row[tightest], default=None)
    return {
        "draws": len(drawn),
        "passed": passed,
        "probability": share,
        "probability_interval": [low, high],
        "confidence": CONFIDENCE,
        "nominal": dict(next(row for row in rows if row["kind"] == "nominal")),
        "tightest": None if least is None else dict(least),
    }


def study_descriptions() -> dict[str, str]:
    """The shipped studies' names and one-line descriptions."""
    names = list_names("study")
    return {name: str(load_plain(find_study_file(name)).get("description", "")) for name in names}


def available_processors() -> int:
    """How many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
