"""What every test stands on: same numbers in every run, no windows, no stale machine code."""

from __future__ import annotations

import contextlib
import math
import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import IO

# Before anything imports numpy or matplotlib, and inherited by workers and subprocesses. With one
# thread a BLAS adds in one order only; the two workers keep two cores busy anyway.
os.environ["MPLBACKEND"] = "Agg"
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import hypothesis  # noqa: E402
import matplotlib.figure  # noqa: E402
import numpy as np  # noqa: E402
import pytest  # noqa: E402

from pips_drake.scene.rendering import can_render  # noqa: E402

PACKAGE = Path(__file__).resolve().parents[1] / "pips_drake"

# The same examples in every run. No deadline: the first example pays for numba's compilation.
hypothesis.settings.register_profile("pips", derandomize=True, deadline=None)
hypothesis.settings.load_profile("pips")


def pytest_configure(config: pytest.Config) -> None:
    if not hasattr(config, "workerinput"):  # once, in the process that starts the workers
        remove_stale_numba_caches(PACKAGE)


def remove_stale_numba_caches(package: Path) -> None:
    """Deletes numba's caches when a module is newer than the oldest of them.

    numba compares a cache with the file of the cached function alone, so an edit in another file
    whose functions it calls (or whose constants it froze) would go unnoticed.
    """
    caches = [*package.rglob("*.nbi"), *package.rglob("*.nbc")]
    oldest = math.inf
    for file in caches:
        # Another run, started at the same time, may have deleted it.
        with contextlib.suppress(FileNotFoundError):
            oldest = min(oldest, file.stat().st_mtime)
    newest_module = max(file.stat().st_mtime for file in package.rglob("*.py"))
    if newest_module > oldest:
        for file in caches:
            file.unlink(missing_ok=True)


def pytest_runtest_setup(item: pytest.Item) -> None:
    if item.get_closest_marker("render") and not can_render():
        pytest.skip("no EGL to render with; see tools/system_libraries.sh")


#: A picture of one black pixel.
BLANK = bytes.fromhex(
    "89504e470d0a1a0a0000000d49484452000000010000000108000000003a7e9b55"
    "0000000a49444154789c636000000002000148afa4710000000049454e44ae426082"
)


@pytest.fixture
def blank_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are made, and written as one pixel; of a run nothing is rendered.

    Drawing and rendering is most of a short run's time.
    """

    def savefig(_figure: object, file: IO[bytes], **_options: object) -> None:
        file.write(BLANK)

    monkeypatch.setattr(matplotlib.figure.Figure, "savefig", savefig)
    pictures = "pips_drake.serpentine.runs.pictures"
    monkeypatch.setattr(f"{pictures}.render_available", lambda: "not wanted in this test")


class Bracket:
    """An L-shaped prism, of which everything is known in closed form, as .obj and in a scene."""

    #: Its legs along x and y, their thickness, and its height along z, m.
    leg_x, leg_y, thick, height = 0.4, 0.3, 0.1, 0.2
    #: Two boxes, m^3.
    volume = (leg_x * thick + (leg_y - thick) * thick) * height
    #: The bounding box less the corner that the slanting face cuts off, m^3.
    hull_volume = (leg_x * leg_y - 0.5 * (leg_x - thick) * (leg_y - thick)) * height
    #: Of the point on the slanting face that is as far from one leg as from the other, m.
    hull_excess = 1.0 / (1.0 / (leg_x - thick) + 1.0 / (leg_y - thick))
    mesh = "<geometry><mesh><uri>bracket.obj</uri></mesh></geometry>"

    def triangles(self) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (12, 3) m and triangles (20, 3), outward."""
        x, y, t = self.leg_x, self.leg_y, self.thick
        outline = [(0.0, 0.0), (x, 0.0), (x, t), (t, t), (t, y), (0.0, y)]
        vertices = [(*point, z) for z in (0.0, self.height) for point in outline]
        fan = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)]
        faces = [(a, c, b) for a, b, c in fan] + [(a + 6, b + 6, c + 6) for a, b, c in fan]
        for i in range(6):
            j = (i + 1) % 6
            faces += [(i, j, j + 6), (i, j + 6, i + 6)]
        return np.array(vertices), np.array(faces)

    def obj(self) -> str:
        """The text of an .obj file, without normals, as many programs write it."""
        vertices, faces = self.triangles()
        lines = ["v " + " ".join(map(repr, vertex)) for vertex in vertices.tolist()]
        lines += ["f " + " ".join(str(i + 1) for i in face) for face in faces.tolist()]
        return "\n".join(lines) + "\n"

    def write(
        self,
        folder: Path,
        *,
        pose: str = "0 0 0 0 0 0",
        seen: str = mesh,
        collides: str = mesh,
        fixed: bool = False,
    ) -> Path:
        """Writes bracket.obj and bracket.sdf: one link `body`; an empty geometry is left out."""
        (folder / "bracket.obj").write_text(self.obj())
        visual = f"<visual name='v'>{seen}</visual>" if seen else ""
        collision = f"<collision name='c'>{collides}</collision>" if collides else ""
        static = "<static>true</static>" if fixed else ""
        file = folder / "bracket.sdf"
        file.write_text(
            f"<sdf version='1.9'><model name='bracket'>{static}<pose>{pose}</pose>"
            f"<link name='body'>{visual}{collision}</link></model></sdf>"
        )
        return file


@pytest.fixture
def bracket() -> Bracket:
    return Bracket()


class Browser:
    """Chromium without a window, which asks nothing of the network, and starts afresh each time."""

    options = (
        "--headless",
        "--no-sandbox",
        "--no-first-run",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        # Software alone, so that pictures are the same everywhere.
        "--use-gl=angle",
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
        "--virtual-time-budget=10000",
        "--enable-logging=stderr",
        "--v=0",
    )

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._opened = 0

    def open(self, address: str, *options: str) -> tuple[str, list[str]]:
        """Opens a page for ten seconds of its own time.

        Returns:
            What chromium prints, and the lines of the page's console. Their severity is lost:
            chromium logs all of them as INFO.
        """
        self._opened += 1
        profile = self._folder / f"profile_{self._opened}"
        command = ["chromium", *self.options, f"--user-data-dir={profile}", *options, address]
        done = subprocess.run(command, capture_output=True, text=True, timeout=100, check=True)
        return done.stdout, re.findall(r"^\[[^]]*:CONSOLE[^]]*\] *(.*)$", done.stderr, re.MULTILINE)


@pytest.fixture
def browser(tmp_path: Path) -> Browser:
    if shutil.which("chromium") is None:
        pytest.skip("no chromium to open the page with; see tools/browser.sh")
    return Browser(tmp_path)
