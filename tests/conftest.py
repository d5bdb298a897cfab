"""What every test stands on: same numbers in every run, no windows, no stale machine code."""

from __future__ import annotations

import os
from pathlib import Path

# Before anything imports numpy or matplotlib, and inherited by workers and subprocesses. With one
# thread a BLAS adds in one order only; the two workers keep two cores busy anyway.
os.environ["MPLBACKEND"] = "Agg"
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import hypothesis  # noqa: E402
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
    if not caches:
        return
    newest_module = max(file.stat().st_mtime for file in package.rglob("*.py"))
    if newest_module > min(file.stat().st_mtime for file in caches):
        for file in caches:
            file.unlink(missing_ok=True)


def pytest_runtest_setup(item: pytest.Item) -> None:
    if item.get_closest_marker("render") and not can_render():
        pytest.skip("no EGL to render with; see tools/system_libraries.sh")
