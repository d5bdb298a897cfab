"""One case of a study: what to compute, what came of it, and the computing itself."""

from __future__ import annotations

import hashlib
import importlib
import json
import math
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from pips_drake.errors import PipsError

#: What becomes of a case: computed, or no numbers because it failed, or its process died.
DONE, FAILED, DIED = "done", "failed", "died"

# A process computes one case at a time, however many threads a cluster's worker has: cases are
# whole runs, which share compiled code and Drake's objects.
_ONE_AT_A_TIME = threading.Lock()


@dataclass(frozen=True, kw_only=True)
class Case:
    """What one case computes; plain data, so that it can go to another machine.

    Attributes:
        number: counts the study's cases from 1.
        values: what is varied, for the table.
        task: all that the work needs: JSON's types.
        work: `module:function`, which takes the task and returns numbers and words by name. It must
            be importable wherever the case is computed.
        versions: of what a result depends on.
    """

    number: int
    values: Mapping[str, Any]
    task: Mapping[str, Any]
    work: str
    versions: Mapping[str, str] = field(default_factory=dict)

    @property
    def key(self) -> str:
        """Equal for two cases if and only if they compute the same."""
        parts = [self.task, self.work, self.versions]
        text = json.dumps(parts, sort_keys=True, allow_nan=False)
        return hashlib.sha256(text.encode()).hexdigest()


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What came of a case.

    Attributes:
        status: `done`, `failed` (an exception) or `died` (its process ended).
        reason: why there are no numbers; empty if there are.
        numbers: what the work returned, JSON's types; None for what is no finite number.
        wall_s: how long it took.
    """

    status: str
    reason: str = ""
    numbers: Mapping[str, Any] = field(default_factory=dict)
    wall_s: float = 0.0

    def as_plain(self) -> dict[str, Any]:
        """As JSON's types."""
        return asdict(self)


def compute(work: str, task: Mapping[str, Any]) -> Outcome:
    """Computes a case wherever this runs; an exception becomes a failed outcome."""
    with _ONE_AT_A_TIME:
        start = time.perf_counter()
        try:
            numbers = _plain(_find(work)(task))
        except PipsError as error:
            return _failed(str(error), start)
        except Exception as error:  # whatever one case does, the others go on
            return _failed(f"{type(error).__name__}: {error}", start)
        return Outcome(status=DONE, numbers=numbers, wall_s=time.perf_counter() - start)


def _failed(reason: str, start: float) -> Outcome:
    line = " ".join(reason.split())
    return Outcome(status=FAILED, reason=line, wall_s=time.perf_counter() - start)


def _find(work: str) -> Callable[[Mapping[str, Any]], Mapping[str, Any]]:
    module, _, name = work.partition(":")
    function: Callable[[Mapping[str, Any]], Mapping[str, Any]] = getattr(
        importlib.import_module(module), name
    )
    return function


def _plain(numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Numbers as JSON's types; None for NaN and infinity."""
    plain = {}
    for name, value in numbers.items():
        if isinstance(value, np.generic):
            value = value.item()
        if isinstance(value, float) and not math.isfinite(value):
            value = None
        if not (value is None or isinstance(value, bool | int | float | str)):
            raise TypeError(f"{name} is a {type(value).__name__}; must be a number or a word")
        plain[name] = value
    return plain
