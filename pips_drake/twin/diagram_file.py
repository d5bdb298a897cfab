"""A diagram as a picture of its systems and wires."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

from pydrake.systems.framework import Diagram

from pips_drake.twin.output_folder import write_whole


def write_diagram(folder: Path, diagram: Diagram) -> None:
    """`diagram.dot`, and `diagram.svg` where Graphviz is installed."""
    dot = folder / "diagram.dot"
    write_whole(dot, diagram.GetGraphvizString(max_depth=2))
    renderer = shutil.which("dot")
    if renderer is not None:
        subprocess.run(
            [renderer, "-Tsvg", str(dot), "-o", str(folder / "diagram.svg")],
            check=False,
            capture_output=True,
            timeout=60,
        )
