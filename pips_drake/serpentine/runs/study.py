"""Design studies of serpentine arms: what a case is, and what is computed of it."""

from __future__ import annotations

import hashlib
import re
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.lcm import DrakeLcm

from pips_drake.config import dump_yaml, load_yaml, read_text, validate
from pips_drake.errors import InputError, NotFollowableError, UnknownNameError
from pips_drake.scene.packages import (
    find_arm_file,
    find_path_file,
    find_scene_file,
    list_names,
    models_directory,
)
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import load_arm, make_arm
from pips_drake.serpentine.arm_file import ArmFile
from pips_drake.serpentine.arm_variants import set_path_travel, vary_arm
from pips_drake.serpentine.mounting import mounting_gravity
from pips_drake.serpentine.path_file import PathFile
from pips_drake.serpentine.plan import Plan, make_plan
from pips_drake.serpentine.runs import margins
from pips_drake.serpentine.runs.assessment import Assessment
from pips_drake.serpentine.runs.check import check
from pips_drake.serpentine.runs.run import run_station
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.statics import sag
from pips_drake.serpentine.station import load_setup
from pips_drake.serpentine.tolerances import half_widths
from pips_drake.twin.study.cases import Case
from pips_drake.twin.study.study_file import StudyFile, StudyKind
from pips_drake.twin.summary import versions
from pips_drake.units import DEGREE

Array = NDArray[np.float64]

#: What the table says of each case, and of which columns the figure has a panel: title, unit and
#: factor.
COLUMNS: dict[str, tuple[str, str, float] | None] = {
    "verdict": None,
    "followed_share": ("Part of the path that can be followed", "%", 100.0),
    "tip_travel_m": None,
    "path_deviation_max_m": ("Centre line to path, at most", "mm", 1e3),
    "iterations_max": ("Iterations to 1e-9 in, at most", "", 1.0),
    "clearance_sampled_min_m": None,
    "clearance_certified_min_m": ("Clearance to the scene, proved", "mm", 1e3),
    "clearance_certified_min_with_errors_m": None,
    "self_clearance_sampled_min_m": None,
    "joint_margin_min_rad": ("Hinges' limits, left at least", "deg", 1.0 / DEGREE),
    "rail_margin_min_m": None,
    "actuator_force_max_fraction": ("Actuator force, at most", "% of limit", 100.0),
    "drive_effort_max_fraction": None,
    "drive_speed_max_fraction": ("Drive speed, at most", "% of limit", 100.0),
    "sag_max_m": ("Tip's sag without compensation", "mm", 1e3),
    "motion_duration_constant_s": None,
    "motion_duration_fastest_s": ("Way out, as fast as drives can", "s", 1.0),
    # Of simulated cases alone.
    "tip_error_max_m": None,
    "spine_error_max_m": ("Simulated spine to plan, at most", "mm", 1e3),
    "failures": None,
}
#: A simulated case asks for other panels than a planned one.
_PANELS_PLANNED = (
    "followed_share",
    "path_deviation_max_m",
    "iterations_max",
    "clearance_certified_min_m",
    "joint_margin_min_rad",
    "actuator_force_max_fraction",
    "sag_max_m",
    "motion_duration_fastest_s",
)
_PANELS_SIMULATED = (
    "spine_error_max_m",
    "path_deviation_max_m",
    "actuator_force_max_fraction",
    "sag_max_m",
)
#: Names in a case's folder.
_ARM_NAME, _SCENARIO_NAME = "arm.yaml", "scenario.yaml"
_WORK = f"{__name__}:run_case"


def panels(study: StudyFile) -> dict[str, tuple[str, str, float]]:
    """The figure's panels by column: title, unit and factor."""
    names = _PANELS_SIMULATED if study.simulate else _PANELS_PLANNED
    found = {name: COLUMNS[name] for name in names}
    return {name: panel for name, panel in found.items() if panel is not None}


def make_cases(study: StudyFile, scenario_file: Path) -> list[Case]:
    """The cases of a study, complete: a case needs no file but shipped ones and its own scene's.

    Raises:
        InputError: a field that there is not, or a value that is not allowed in any case. A value
            that only some combinations do not allow makes those cases fail.
    """
    depends = {name: text for name, text in versions().items() if name != "platform"}
    rows: list[tuple[dict[str, Any], dict[str, Any]]]
    if study.tolerances:
        scenario = load_yaml(
            SerpentineScenario, scenario_file, overrides=_scenario_fields(study.set)
        )
        arm = load_arm(find_arm_file(scenario.arm, inside=scenario_file.parent))
        half_widths(arm, study.tolerances)  # refuses what means nothing
        common = _task(study, scenario_file, {})
        tasks = margins.margin_tasks(scenario, study.tolerances, draws=study.draws, seed=study.seed)
        rows = [
            ({"kind": task["kind"], "draw": task["draw"]}, common | {"margins": task})
            for task in tasks
        ]
    else:
        rows = [(values, _task(study, scenario_file, values)) for values in study.combinations()]
    return [
        Case(number=number, values=values, task=task, work=_WORK, versions=depends)
        for number, (values, task) in enumerate(rows, start=1)
    ]


def _task(study: StudyFile, scenario_file: Path, values: Mapping[str, Any]) -> dict[str, Any]:
    """What one case needs to know."""
    folder = scenario_file.parent
    # All changes of a case: of the scenario's fields, and of what it names.
    changes = study.set | {name: _text(value) for name, value in values.items()}
    scenario = load_yaml(SerpentineScenario, scenario_file, overrides=_scenario_fields(changes))
    # A film is no result of a study, and the last joint is judged without the camera's share.
    scenario.camera.enabled = False
    arm = load_yaml(ArmFile, find_arm_file(scenario.arm, inside=folder))
    if scenario.joints:
        raise InputError(f"{scenario_file}: joints are given; a study varies an arm on a path")
    path_file = find_path_file(scenario.path, inside=folder)
    path_text = read_text(path_file)
    for name, text in changes.items():
        if name.startswith("arm."):
            arm = vary_arm(arm, name, _number(name, text))
        elif name.startswith("path."):
            path_text = _vary_path(path_file, name, _number(name, text))
    scene_file = None
    if scenario.scene:
        scene_file = find_scene_file(scenario.scene, inside=folder).resolve()
    scenario.arm, scenario.path = _ARM_NAME, path_file.name
    own = scene_file is not None and scenario.scene not in list_names("scene")
    return {
        "scenario": dump_yaml(scenario),
        "arm": dump_yaml(arm),
        "path": path_text,
        "path_name": path_file.name,
        "scene_file": str(scene_file) if own else None,
        "scene_content": None if scene_file is None else _digest(scene_file),
        "simulate": study.simulate,
    }


def _scenario_fields(changes: Mapping[str, str]) -> dict[str, str]:
    """Those changes that are fields of the scenario, and not of the arm or path that it names."""
    return {name: text for name, text in changes.items() if not name.startswith(("arm.", "path."))}


def run_case(task: Mapping[str, Any]) -> dict[str, Any]:
    """Plans and checks, or simulates, one case; returns numbers by `COLUMNS`' names.

    Raises:
        InputError: the case cannot be computed: its arm or path is impossible.
    """
    with tempfile.TemporaryDirectory(prefix="pips_study_") as name:
        folder = Path(name)
        for file, key in ((_ARM_NAME, "arm"), (task["path_name"], "path")):
            (folder / file).write_text(task[key], encoding="utf-8")
        (folder / _SCENARIO_NAME).write_text(task["scenario"], encoding="utf-8")
        try:
            return _run(task, folder)
        except InputError as error:
            # The folder is gone when somebody reads this.
            raise InputError(str(error).replace(f"{folder}/", "")) from None


def _run(task: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    scenario = load_yaml(SerpentineScenario, folder / _SCENARIO_NAME)
    arm = load_yaml(ArmFile, folder / _ARM_NAME)
    validate(arm)
    make_arm(arm)
    if "margins" in task:
        scene = Path(task["scene_file"]) if task["scene_file"] else None
        return margins.run_margin_case(scenario, arm, folder, scene, task["margins"])
    scene_file = Path(task["scene_file"]) if task["scene_file"] else None
    setup = load_setup(scenario, folder=folder, scene_file=scene_file)
    plan = make_plan(setup.arm, setup.path)
    numbers = _plan_numbers(scenario, plan)
    if not task["simulate"]:
        verdict = check(scenario, name="case", folder=folder, scene_file=scene_file)
        failures = list(verdict.failures)
        found = dict(verdict.summary)
    elif not plan.followable:
        failures, found = list(plan.failures), {}
    else:
        run = run_station(scenario, setup, lcm=DrakeLcm("memq://"))
        assessment = Assessment.of(scenario, setup, run.data)
        failures, found = assessment.failures(), assessment.summary()
    numbers |= {name: found[name] for name in COLUMNS if name in found}
    # Beyond its reach, a monitor says no more than that.
    if not found.get("clearance_in_range", True):
        numbers["clearance_sampled_min_m"] = None
    if not task["simulate"]:
        numbers.pop("spine_error_max_m", None)  # the solver's, not the simulation's
    return numbers | {
        "verdict": "fail" if failures else "pass",
        "failures": "; ".join(failures),
    }


def _plan_numbers(scenario: SerpentineScenario, plan: Plan) -> dict[str, Any]:
    """How far the path can be followed, and how far the tip would sag."""
    path, solved = plan.path, plan.solution.solved
    if not solved.any():
        raise NotFollowableError(plan.failures[0])
    followed = 1.0
    if plan.first_failing_tip is not None:
        followed = (plan.first_failing_tip - path.home_arc_length) / path.travel
    joints = plan.joints[solved]
    give = sag(plan.arm, joints, mounting_gravity(scenario.mounting))
    there = kinematics.spine_points(plan.arm, joints - give)[:, -1]
    fallen = np.linalg.norm(there - kinematics.spine_points(plan.arm, joints)[:, -1], axis=-1)
    return {
        "tip_travel_m": path.travel,
        "followed_share": followed,
        "sag_max_m": fallen.max(),
    }


def _text(value: float | str) -> str:
    """A value as `pips simulate --set` would be given it."""
    return f"{value:.15g}" if isinstance(value, float | int) else value


def _number(field: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{field} = '{text}'; must be a number") from None


def _vary_path(file: Path, field: str, value: float) -> str:
    """The text of a path file with one variation."""
    if field != "path.travel_in":
        raise UnknownNameError("variation", field, ["path.travel_in"])
    if file.suffix == ".csv":
        raise InputError(f"{field}: {file.name} is a table; must be a path of lines and arcs")
    return dump_yaml(set_path_travel(load_yaml(PathFile, file), value))


def _digest(scene_file: Path) -> str:
    """Of a scene's file and of every file that it and those name."""
    seen: dict[Path, str] = {}
    waiting = [scene_file]
    while waiting:
        file = waiting.pop()
        if file in seen or not file.is_file():
            continue
        data = file.read_bytes()
        seen[file] = hashlib.sha256(data).hexdigest()
        text = data.decode("utf-8", errors="ignore")
        for package, name in re.findall(r"(package://pips_drake/)?([\w./-]+\.\w+)", text):
            start = models_directory() if package else file.parent
            waiting.append((start / name).resolve())
    return hashlib.sha256("".join(sorted(seen.values())).encode()).hexdigest()


def columns(study: StudyFile) -> Sequence[str]:
    """The table's columns."""
    return margins.COLUMNS if study.tolerances else tuple(COLUMNS)


STUDY_KIND = StudyKind(
    make_cases=make_cases,
    columns=columns,
    panels=panels,
    tightest="clearance_sampled_min_m",
)
