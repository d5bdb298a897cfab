"""Scenarios by name: which machine a file is for, loading, and running.

From Python, what `pips simulate trajectory_4` does:

    >>> from pips_drake.scenarios import load_scenario, simulate
    >>> verdict = simulate(load_scenario("trajectory_4"), out="out/trajectory_4")
    >>> verdict.passed, verdict.summary["clearance_sampled_min_m"]
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pips_drake.cable_robot.scenario import CableRobotScenario
from pips_drake.config import load_plain, load_yaml
from pips_drake.errors import InputError, UnknownNameError
from pips_drake.planning.scenario import PlannerScenario, with_goal
from pips_drake.remote_manipulator.scenario import RemoteManipulatorScenario
from pips_drake.scene.packages import (
    find_scenario_file,
    find_scene_file,
    list_names,
    scenarios_directory,
)
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.twin.study.study_file import StudyKind
from pips_drake.twin.verdict import Verdict

if TYPE_CHECKING:
    from pydrake.geometry import Meshcat


def _simulate_serpentine(*args: Any, **kwargs: Any) -> Verdict:
    # Imported when used: Drake's simulation modules take a second to load.
    from pips_drake.serpentine.runs.simulate import simulate as run

    return run(*args, **kwargs)


def _serpentine_studies() -> StudyKind:
    from pips_drake.serpentine.runs.study import STUDY_KIND

    return STUDY_KIND


def _plan_goals(*args: Any, **kwargs: Any) -> Verdict:
    from pips_drake.planning.runs.plan import plan as run

    return run(*args, **kwargs)


def _simulate_plan(*args: Any, **kwargs: Any) -> Verdict:
    from pips_drake.planning.runs.simulate import simulate as run

    return run(*args, **kwargs)


def _simulate_task(*args: Any, **kwargs: Any) -> Verdict:
    from pips_drake.remote_manipulator.runs.simulate import simulate as run

    return run(*args, **kwargs)


def _simulate_cable_robot(*args: Any, **kwargs: Any) -> Verdict:
    from pips_drake.cable_robot.runs.simulate import simulate as run

    return run(*args, **kwargs)


@dataclass(frozen=True)
class Machine:
    """A machine that scenarios can be written for.

    Attributes:
        schema: of its scenarios.
        simulate: runs a scenario.
        studies: what can be varied; None if there are no studies of it.
        plan: finds the motion of a scenario that states goals; None if scenarios state motions.
    """

    schema: type
    simulate: Callable[..., Verdict]
    studies: Callable[[], StudyKind] | None = None
    plan: Callable[..., Verdict] | None = None


MACHINES = {
    "cable_robot": Machine(CableRobotScenario, _simulate_cable_robot),
    "planner": Machine(PlannerScenario, _simulate_plan, plan=_plan_goals),
    "remote_manipulator": Machine(RemoteManipulatorScenario, _simulate_task),
    "serpentine": Machine(SerpentineScenario, _simulate_serpentine, studies=_serpentine_studies),
}


@dataclass(frozen=True, kw_only=True)
class LoadedScenario:
    """A scenario with its name, and the folder where its relative file names start.

    Attributes:
        scene_file: stands for the scenario's own scene.
    """

    name: str
    machine: str
    config: Any
    folder: Path
    scene_file: Path | None = None


def load_scenario(
    name: str,
    overrides: Mapping[str, str] | None = None,
    *,
    scene: str | None = None,
    decompose: bool = False,
) -> LoadedScenario:
    """The scenario of a shipped name or of a file.

    Args:
        overrides: dotted field names to texts, such as `{"motion.dwell_s": "2"}`.
        scene: another scene, see `find_own_scene`.
        decompose: split the scene's meshes into convex parts, whatever the scenario says.

    Raises:
        InputError: no such scenario, an unknown key, or a value that is not allowed.
    """
    file = find_scenario_file(name)
    machine = machine_of(file)
    config: Any = load_yaml(MACHINES[machine].schema, file, overrides=dict(overrides or {}))
    scene_file = None
    if scene is not None:
        if not hasattr(config, "scene"):
            raise InputError(f"{file}: machine = {machine}, which takes no other scene")
        config.scene, scene_file = find_own_scene(scene)
        if not config.scene and config.camera.target_body:
            config.camera.enabled, config.camera.target_body = False, ""
    if decompose:
        if not hasattr(config, "decompose_meshes"):
            raise InputError(f"{file}: machine = {machine}, which has no meshes to decompose")
        config.decompose_meshes = True
    return LoadedScenario(
        name=file.stem, machine=machine, config=config, folder=file.parent, scene_file=scene_file
    )


def find_own_scene(scene: str) -> tuple[str, Path | None]:
    """What to call a scene in a scenario, and its file.

    Args:
        scene: a shipped name, a file relative to the current folder, or `none`.

    Raises:
        UnknownNameError: neither a shipped name nor an existing file.
    """
    if scene == "none":
        return "", None
    file = find_scene_file(scene)
    if scene in list_names("scene"):
        return scene, file
    # Results name no folder of the machine that they come from.
    here, there = Path.cwd(), file.absolute()
    inside = there.is_relative_to(here)
    return (there.relative_to(here).as_posix() if inside else file.name), file


def simulate(
    scenario: LoadedScenario,
    *,
    out: str | Path,
    force: bool = False,
    meshcat: Meshcat | None = None,
) -> Verdict:
    """Simulates a scenario and writes its folder; see the machine's own `simulate`."""
    return MACHINES[scenario.machine].simulate(
        scenario.config,
        name=scenario.name,
        out=Path(out),
        force=force,
        folder=scenario.folder,
        scene_file=scenario.scene_file,
        meshcat=meshcat,
    )


def plan(
    scenario: LoadedScenario,
    *,
    out: str | Path,
    force: bool = False,
    goal: Sequence[float] | None = None,
) -> Verdict:
    """Plans the motion of a scenario that states goals, and writes its folder.

    Args:
        goal: instead of the scenario's goals, scan or path: a point in frame 0, (3,) m.

    Raises:
        InputError: it states none, or the goal is not a point.
    """
    run = MACHINES[scenario.machine].plan
    if run is None:
        known = sorted(name for name, machine in MACHINES.items() if machine.plan is not None)
        raise InputError(
            f"{scenario.name}: machine = {scenario.machine}, whose scenarios state their motion; "
            f"must be {' or '.join(known)}"
        )
    config = scenario.config if goal is None else with_goal(scenario.config, goal)
    return run(
        config,
        name=scenario.name,
        out=Path(out),
        force=force,
        folder=scenario.folder,
        scene_file=scenario.scene_file,
    )


def scenario_descriptions(*, goals: bool = False) -> dict[str, str]:
    """The shipped scenarios' names and one-line descriptions.

    Args:
        goals: those alone that state goals (`pips plan`).
    """
    planners = [name for name, machine in MACHINES.items() if machine.plan is not None]
    files = {file.stem: load_plain(file) for file in sorted(scenarios_directory().glob("*.yaml"))}
    return {
        name: str(plain.get("description", ""))
        for name, plain in files.items()
        if not goals or plain.get("machine") in planners
    }


def machine_of(file: Path) -> str:
    """The machine that a scenario's file is for: a key of `MACHINES`.

    Raises:
        InputError: it says none, or one that there is not.
    """
    machine = load_plain(file).get("machine")
    if machine is None:
        raise InputError(f"{file}: no key 'machine'; must be one of {', '.join(sorted(MACHINES))}")
    if not isinstance(machine, str) or machine not in MACHINES:
        raise InputError(f"{file}: {UnknownNameError('machine', str(machine), list(MACHINES))}")
    return machine
