"""`pips simulate` of a remote manipulator scenario: runs it, judges it, writes its folder."""

from __future__ import annotations

from pathlib import Path

from pydrake.geometry import Meshcat

from pips_drake.config import dump_yaml
from pips_drake.errors import InputError
from pips_drake.remote_manipulator.runs.data import Event, find_events
from pips_drake.remote_manipulator.runs.figures import (
    docking_figure,
    joints_figure,
    timeline_figure,
)
from pips_drake.remote_manipulator.runs.judgement import judge, judged_frames, summarize
from pips_drake.remote_manipulator.runs.operators import make_operator
from pips_drake.remote_manipulator.runs.pictures import write_pictures, write_run_replay
from pips_drake.remote_manipulator.runs.run import Run, load_setup, make_station, run_station
from pips_drake.remote_manipulator.runs.run_files import (
    station_letters,
    write_events,
    write_series,
)
from pips_drake.remote_manipulator.runs.sheet import write_run_sheet
from pips_drake.remote_manipulator.scenario import DAY, RemoteManipulatorScenario
from pips_drake.twin.diagram_file import write_diagram
from pips_drake.twin.output_folder import output_folder, write_whole
from pips_drake.twin.simulation import DivergedError
from pips_drake.twin.summary import versions, write_summary
from pips_drake.twin.verdict import Verdict


def simulate(
    scenario: RemoteManipulatorScenario,
    *,
    name: str,
    out: Path,
    force: bool = False,
    folder: Path | None = None,
    scene_file: Path | None = None,
    meshcat: Meshcat | None = None,
) -> Verdict:
    """Runs and judges a scenario, and writes its folder.

    Args:
        name: the scenario's name, for the summary and titles.
        out: the folder to write; it appears whole or not at all.
        force: replace an earlier result there.
        folder: where the scenario's relative file names start.
        scene_file: none can be given: what stands there is the machine.
        meshcat: shows the run while it goes on, and is what a `meshcat` operator works with.

    Raises:
        InputError: something that the scenario names cannot be used; nothing is written.
    """
    if scene_file is not None:
        raise InputError(f"{name}: machine = {scenario.machine}, which takes no other scene")
    setup = load_setup(scenario, folder=folder)
    operator = make_operator(scenario, setup, folder=folder, meshcat=meshcat)
    station = make_station(setup, operator.system, camera=scenario.station)
    duration = scenario.duration_s or DAY
    with output_folder(out, force=force) as partial:
        summary: dict[str, object] = {"scenario": name, "versions": versions()}
        try:
            run = run_station(
                station, duration=duration, meshcat=meshcat, real_time=operator.real_time
            )
        except DivergedError as error:
            failures = [f"the run was given up: {error}"]
        else:
            whole = scenario.duration_s <= 0.0
            numbers = summarize(run, setup.config, scenario.checks, whole=whole)
            failures = judge(scenario, numbers)
            events = all_events(run)
            numbers |= {
                "events": [f"{e.time:.2f} s, {e.kind}: {e.text}" for e in events],
                "stations": station_letters(run.data),
            }
            summary |= numbers
            _write_files(partial, name, scenario, run, events, summary)
        summary |= {"verdict": "fail" if failures else "pass", "failures": failures}
        write_whole(partial / "scenario.yaml", dump_yaml(scenario))
        write_summary(partial / "summary.json", summary)
        write_run_sheet(partial, summary, failures, scenario.checks)
    return Verdict(failures=tuple(failures), summary=summary, folder=out)


def all_events(run: Run) -> list[Event]:
    """What the program decided and what the welds did, in order."""
    welds = [
        Event(
            time=event.time,
            kind="attachment",
            text=f"{event.action} {event.name}".strip(),
        )
        for event in run.attachments
    ]
    return sorted([*find_events(run.data), *welds], key=lambda event: event.time)


def _write_files(
    folder: Path,
    name: str,
    scenario: RemoteManipulatorScenario,
    run: Run,
    events: list[Event],
    summary: dict[str, object],
) -> None:
    data, config = run.data, run.station.machine.config
    figures = folder / "figures"
    figures.mkdir()
    write_series(folder, data, config)
    write_events(folder, events)
    judged = judged_frames(data, config, scenario.checks)
    timeline_figure(figures / "timeline.png", data, judged)
    joints_figure(figures / "joints.png", data, config)
    docking_figure(figures / "docking.png", data, config)
    missing = write_pictures(folder, run, config, scenario.video)
    if missing is not None:
        summary["renderings_missing"] = missing
    title = f"{name}: {config.name}"
    write_run_replay(folder / "replay.html", run, title=title, events=events)
    write_diagram(folder, run.diagram)
