"""Scenarios by name: which machine a file is for, loading, and running.

From Python, what `pips simulate trajectory_4` does:

    >>> from pips_drake.scenarios import load_scenario, simulate
    >>> verdict = simulate(load_scenario("trajectory_4"), out="out/trajectory_4")
    >>> verdict.passed, verdict.summary["clearance_sampled_min_m"]
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pips_drake.config import load_plain, load_yaml
from pips_drake.errors import InputError, UnknownNameError
from pips_drake.scene.packages import find_scenario_file, scenarios_directory
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.twin.verdict import Verdict

if TYPE_CHECKING:
    from pydrake.geometry import Meshcat


def _simulate_serpentine(*args: Any, **kwargs: Any) -> Verdict:
    # Imported when used: Drake's simulation modules take a second to load.
    from pips_drake.serpentine.runs.simulate import simulate as run

    return run(*args, **kwargs)


@dataclass(frozen=True)
class Machine:
    """A machine that scenarios can be written for: its schema, and what simulates it."""

    schema: type
    simulate: Callable[..., Verdict]


MACHINES = {"serpentine": Machine(SerpentineScenario, _simulate_serpentine)}


@dataclass(frozen=True, kw_only=True)
class LoadedScenario:
    """A scenario with its name, and the folder where its relative file names start."""

    name: str
    machine: str
    config: Any
    folder: Path


def load_scenario(name: str, overrides: Mapping[str, str] | None = None) -> LoadedScenario:
    """The scenario of a shipped name or of a file.

    Args:
        overrides: dotted field names to texts, such as `{"motion.dwell_s": "2"}`.

    Raises:
        InputError: no such scenario, an unknown key, or a value that is not allowed.
    """
    file = find_scenario_file(name)
    machine = _machine_of(file)
    config: Any = load_yaml(MACHINES[machine].schema, file, overrides=dict(overrides or {}))
    return LoadedScenario(name=file.stem, machine=machine, config=config, folder=file.parent)


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
        meshcat=meshcat,
    )


def scenario_descriptions() -> dict[str, str]:
    """The shipped scenarios' names and one-line descriptions."""
    files = sorted(scenarios_directory().glob("*.yaml"))
    return {file.stem: str(load_plain(file).get("description", "")) for file in files}


def _machine_of(file: Path) -> str:
    machine = load_plain(file).get("machine")
    if machine is None:
        raise InputError(f"{file}: no key 'machine'; must be one of {', '.join(sorted(MACHINES))}")
    if not isinstance(machine, str) or machine not in MACHINES:
        raise InputError(f"{file}: {UnknownNameError('machine', str(machine), list(MACHINES))}")
    return machine
