"""`summary.json`: the verdict and the numbers behind it."""

from __future__ import annotations

import json
import math
import platform
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from pips_drake.twin.output_folder import write_whole

# What a reader wants first, and what differs from run to run, last.
_FIRST = ("scenario", "arm", "path", "verdict", "failures")
_LAST = ("simulated_s", "wall_s", "real_time_rate", "versions")


def versions() -> dict[str, str]:
    """Versions of what a result depends on."""
    return {
        "pips_drake": _version("pips-drake"),
        "drake": _version("drake"),
        "python": platform.python_version(),
        "numpy": _version("numpy"),
        "scipy": _version("scipy"),
        "numba": _version("numba"),
        "platform": platform.platform(),
    }


def write_summary(file: Path, summary: Mapping[str, Any]) -> None:
    """Writes a summary as JSON, whole or not at all.

    Verdict and failures come first, then the other keys by name, then times and versions; nested
    mappings keep their order. NumPy's numbers and arrays become plain ones, and what JSON has no
    number for (NaN, infinity) becomes null. A `Path` is written relative to the current directory,
    or by its name alone when it lies elsewhere: results name no folder of the machine they come
    from.

    Raises:
        TypeError: a value of another kind, which is a bug of the caller.
    """
    names = [name for name in _FIRST if name in summary]
    names += sorted(name for name in summary if name not in (*_FIRST, *_LAST))
    names += [name for name in _LAST if name in summary]
    plain = {name: _plain(summary[name], where=name) for name in names}
    write_whole(file, json.dumps(plain, indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def read_summary(file: Path) -> dict[str, Any]:
    """What `write_summary` wrote."""
    summary: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return summary


def _plain(value: Any, *, where: str) -> Any:
    """The value as JSON's own types."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Path):
        return _shown(value)
    if isinstance(value, Mapping):
        return {str(key): _plain(item, where=f"{where}.{key}") for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item, where=f"{where}[{index}]") for index, item in enumerate(value)]
    raise TypeError(f"summary's {where} is a {type(value).__name__}, which JSON has no form for")


def _shown(path: Path) -> str:
    if not path.is_absolute():
        return path.as_posix()
    here = Path.cwd()
    return path.relative_to(here).as_posix() if path.is_relative_to(here) else path.name


def _version(distribution: str) -> str:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:  # built from source
        return "unknown"
