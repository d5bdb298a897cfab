"""`pips simulate` of a scenario that states goals: what is planned is run by the twin."""

from __future__ import annotations

import tempfile
from pathlib import Path

from pydrake.geometry import Meshcat

from pips_drake.planning.runs.motion import plan_motion
from pips_drake.planning.runs.pictures import make_panel
from pips_drake.planning.runs.plan import plan, write_motion
from pips_drake.planning.runs.workspace import load_workspace
from pips_drake.planning.scenario import PlannerScenario
from pips_drake.serpentine.runs.simulate import simulate as simulate_run
from pips_drake.twin.verdict import Verdict


def simulate(
    scenario: PlannerScenario,
    *,
    name: str,
    out: Path,
    force: bool = False,
    folder: Path | None = None,
    scene_file: Path | None = None,
    meshcat: Meshcat | None = None,
) -> Verdict:
    """Plans a scenario's motion, simulates it, and writes the run's folder.

    Where there is no motion to simulate, the folder is the plan's, which says why.

    Args:
        name: the scenario's name, for the summary and titles.
        out: the folder to write; it appears whole or not at all.
        force: replace an earlier result there.
        folder: where the scenario's relative file names start.
        scene_file: stands for the scenario's scene.
        meshcat: shows the run while it goes on.

    Raises:
        InputError: something that the scenario names cannot be used; nothing is written.
    """
    workspace = load_workspace(scenario, folder=folder, scene_file=scene_file)
    planned = plan_motion(scenario, workspace, folder=folder)
    if planned.failures:
        return plan(scenario, name=name, out=out, force=force, folder=folder, scene_file=scene_file)
    with tempfile.TemporaryDirectory() as temporary:
        there = Path(temporary)
        run, files = write_motion(there, scenario, workspace, planned, folder=folder)
        return simulate_run(
            run,
            name=name,
            out=out,
            force=force,
            folder=there,
            meshcat=meshcat,
            panel=make_panel(scenario, workspace, planned),
            **files,
        )
