"""`pips simulate` of a cable robot's scenario: does its task, judges it, writes its folder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from pips_drake.cable_robot.configuration import CableRobotConfig, load_robot
from pips_drake.cable_robot.runs import cable_break, statics, survey, workspace
from pips_drake.cable_robot.runs.task import TaskResult
from pips_drake.cable_robot.scenario import CableRobotScenario
from pips_drake.config import dump_yaml
from pips_drake.errors import InputError
from pips_drake.twin.output_folder import output_folder, write_whole
from pips_drake.twin.sheet import Sheet, write_sheet
from pips_drake.twin.summary import versions, write_summary
from pips_drake.twin.verdict import Verdict

if TYPE_CHECKING:
    from pydrake.geometry import Meshcat

#: What prepares each task: it refuses bad input, and returns what does the work into a folder.
_TASKS: dict[
    str, Callable[[CableRobotScenario, CableRobotConfig], Callable[[Path, str], TaskResult]]
] = {
    "cable_break": cable_break.prepare,
    "statics": statics.prepare,
    "survey": survey.prepare,
    "workspace": workspace.prepare,
}


def simulate(
    scenario: CableRobotScenario,
    *,
    name: str,
    out: Path,
    force: bool = False,
    folder: Path | None = None,
    scene_file: Path | None = None,
    meshcat: Meshcat | None = None,
) -> Verdict:
    """Does a scenario's task and writes its folder.

    Args:
        name: the scenario's name, for the summary and titles.
        out: the folder to write; it appears whole or not at all.
        force: replace an earlier result there.
        folder: where the scenario's relative file names start.
        scene_file: none can be given: what stands there is the machine.
        meshcat: shows tasks that move something.

    Raises:
        InputError: something that the scenario names cannot be used; nothing is written.
    """
    if scene_file is not None:
        raise InputError(f"{name}: machine = {scenario.machine}, which takes no other scene")
    if meshcat is not None:
        raise InputError(f"{name}: task = {scenario.task}, in which nothing moves; no --meshcat")
    config = load_robot(scenario.robot, inside=folder)
    work = _TASKS[scenario.task](scenario, config)
    with output_folder(out, force=force) as partial:
        (partial / "figures").mkdir()
        result = work(partial, name)
        summary: dict[str, object] = {
            "scenario": name,
            "versions": versions(),
            "robot": config.name,
            "task": scenario.task,
            **result.numbers,
            "verdict": "fail" if result.failures else "pass",
            "failures": list(result.failures),
        }
        write_whole(partial / "scenario.yaml", dump_yaml(scenario))
        write_summary(partial / "summary.json", summary)
        sheet = Sheet(
            title=f"{name}: {config.name}",
            passed=not result.failures,
            lead=result.lead,
            failures=result.failures,
            rows=result.rows,
            pictures=result.pictures,
        )
        write_sheet(partial, sheet)
    return Verdict(failures=tuple(result.failures), summary=summary, folder=out)
