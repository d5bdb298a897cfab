"""Measures callables beside each other, and describes what was measured and where."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: What the numbers depend on, as pip calls it.
PACKAGES = ("drake", "numpy", "scipy", "numba", "pin", "mujoco", "scikit-image", "pips-drake")


@dataclass(frozen=True, kw_only=True)
class Line:
    """One comparison.

    Attributes:
        name: short and unique, for JSON and the figure.
        what: what is done.
        ours, peer: each round's measurement, (R,); `peer` is empty where nothing stands beside.
        unit: of both.
        beside: what the peer is.
        more_is_better: whether a larger measurement is faster (a rate), or slower (a time).
        ratio_aim: at least this many times the peer's speed; None for none.
        value_aim: our measurement (a time) at most this; None for none.
        limits: what limits it.
        agreement: how far the two answers are apart, by name with unit.
        parts: what our time is made of, ms by name; empty if not taken apart.
    """

    name: str
    what: str
    ours: Array
    unit: str
    limits: str
    beside: str = ""
    peer: Array = field(default_factory=lambda: np.empty(0))
    more_is_better: bool = False
    ratio_aim: float | None = None
    value_aim: float | None = None
    agreement: Mapping[str, float] = field(default_factory=dict)
    parts: Mapping[str, float] = field(default_factory=dict)

    @property
    def ratios(self) -> Array:
        """Our speed over the peer's, a round each, (R,): neighbours in time suffer alike."""
        if not self.peer.size:
            return np.empty(0)
        ratios: Array = self.ours / self.peer if self.more_is_better else self.peer / self.ours
        return ratios

    @property
    def ratio(self) -> float | None:
        """Median of `ratios`."""
        return float(np.median(self.ratios)) if self.peer.size else None

    @property
    def aims(self) -> dict[str, bool]:
        """Each aim as text, and whether the medians meet it."""
        found = {}
        if self.value_aim is not None:
            name = f"{self.value_aim:g} {self.unit}"
            found[name] = float(np.median(self.ours)) <= self.value_aim
        if self.ratio_aim is not None and self.ratio is not None:
            found[f"{self.ratio_aim:g} times"] = self.ratio >= self.ratio_aim
        return found


def measure_in_turn(
    work: Mapping[str, Callable[[], float]],
    *,
    rounds: int,
    warm_up: int = 1,
    clock: Callable[[], float] = time.thread_time,
) -> dict[str, Array]:
    """Seconds an item of each callable's work, (rounds,), all measured in turn: A B C A B C ...

    Whatever else the machine does then disturbs all of them alike. Every second round goes
    backwards, so that none always follows the same neighbour.

    Args:
        work: callables that return how much they did, in items or units.
        warm_up: rounds that are not counted.
        clock: s; by default this thread's processor time, which other programs do not lengthen. For
            work of several threads or processes `time.perf_counter`.
    """
    times: dict[str, list[float]] = {name: [] for name in work}
    for i in range(-warm_up, rounds):
        names = list(work) if i % 2 == 0 else list(work)[::-1]
        for name in names:
            start = clock()
            items = work[name]()
            seconds = (clock() - start) / items
            if i >= 0:
                times[name].append(seconds)
    return {name: np.array(values) for name, values in times.items()}


def describe_machine() -> dict[str, str]:
    """Date, processor, cores, system and versions."""
    known = {}
    for package in PACKAGES:
        try:
            known[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            known[package] = "not installed"
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "processor": _processor(),
        "cores": str(cores),
        "system": f"{platform.system()} {platform.release().split('-')[0]}, {_distribution()}",
        "python": platform.python_version(),
        **known,
    }


def _processor() -> str:
    """The processor's model name, as the system calls it."""
    table = Path("/proc/cpuinfo")
    if table.exists():
        for line in table.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def _distribution() -> str:
    try:
        return platform.freedesktop_os_release()["PRETTY_NAME"]
    except OSError:
        return platform.platform(terse=True)
