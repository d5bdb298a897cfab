"""Renews what docs/remote_manipulator.md has from the code: the diagram of the phases.

    python docs/make_remote_manipulator.py [RUN]

RUN is the folder of a run of dock_payload, whose pictures the page shows. A test compares the
diagram with what this writes.
"""

import shutil
import sys
from pathlib import Path

from pips_drake.remote_manipulator.phase_diagram import phase_diagram

DOCS = Path(__file__).resolve().parent
PAGE = DOCS / "remote_manipulator.md"
START, END = (
    "<!-- phases: made by `python docs/make_remote_manipulator.py` -->\n",
    "<!-- end of phases -->\n",
)
#: Pictures of a run, and what they are called here.
PICTURES = {
    "phases.png": "remote_manipulator_phases.png",
    "timeline.png": "remote_manipulator_timeline.png",
    "stations.png": "remote_manipulator_stations.png",
}


def with_diagram(page: str) -> str:
    """The page with the diagram that the code has."""
    before, rest = page.split(START)
    _, after = rest.split(END)
    return f"{before}{START}```mermaid\n{phase_diagram()}```\n{END}{after}"


def main() -> None:
    PAGE.write_text(with_diagram(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    for run in sys.argv[1:2]:
        for name, copy in PICTURES.items():
            shutil.copyfile(Path(run) / "figures" / name, DOCS / "images" / copy)


if __name__ == "__main__":
    main()
