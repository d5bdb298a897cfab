"""Draws docs/images/planning.png: what `pips plan reach_behind_payload` finds, in three views.

python docs/make_planning.py
"""

from __future__ import annotations

from pathlib import Path

from pips_drake.planning.runs.motion import plan_motion
from pips_drake.planning.runs.pictures import write_views
from pips_drake.planning.runs.workspace import load_workspace
from pips_drake.scenarios import load_scenario

FILE = Path(__file__).resolve().parent / "images" / "planning.png"


def main() -> None:
    """Plans, and draws."""
    loaded = load_scenario("reach_behind_payload")
    workspace = load_workspace(loaded.config, folder=loaded.folder)
    planned = plan_motion(loaded.config, workspace)
    write_views(FILE, loaded.name, loaded.config, workspace, planned)


if __name__ == "__main__":
    main()
