"""The typed study file: which scenario, and what of it is varied."""
# Annotations must be real types here: pydrake's YAML reader does not resolve strings.

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from pips_drake.config import require
from pips_drake.twin.study.cases import Case

#: What `combine` may say.
COMBINATIONS = ("grid", "list")
#: More cases would take days.
MOST_CASES = 100_000


@dataclasses.dataclass
class VaryConfig:
    """A field and the values that it takes: numbers, or words."""

    # A field of the scenario (motion.tip_speed_mm_per_s), or a change of what it names
    # (arm.offset_scale), see the machine's document.
    field: str = ""
    values: list[float] = dataclasses.field(default_factory=list)
    words: list[str] = dataclasses.field(default_factory=list)

    def validate(self) -> None:
        require(self.field != "", "field", "''", "a dotted field")
        one = bool(self.values) != bool(self.words)
        require(one, f"vary {self.field}", "both or none", "either 'values' or 'words'")
        known = self.choices
        require(len(set(known)) == len(known), f"vary {self.field}", known, "without repetition")

    @property
    def choices(self) -> list[float | str]:
        """The values, numbers or words."""
        return [*self.values, *self.words]


@dataclasses.dataclass
class StudyFile:
    """A study. File: `studies/*.yaml`."""

    # One line that `pips list` shows.
    description: str = ""
    # A shipped name, or a file inside the study's own folder.
    scenario: str = ""
    # grid: every combination of the values, the last field fastest. list: the first values of all
    # fields, the second ones, and so on.
    combine: str = "grid"
    # Simulate each case; otherwise it is only planned and checked, which takes seconds.
    simulate: bool = False
    # What all cases change, by field, as text.
    set: dict[str, str] = dataclasses.field(default_factory=dict)
    # What is varied: a study of a design.
    vary: list[VaryConfig] = dataclasses.field(default_factory=list)
    # Or, for the probability that the plan passes although arm and payload are not quite what it
    # believes: by name, how far each error goes either way (the machine's document has the names).
    tolerances: dict[str, float] = dataclasses.field(default_factory=dict)
    # How many sets of errors are drawn, and what they are drawn from.
    draws: int = 200
    seed: int = 1
    # A case that takes longer is ended, and counts as died, s. On a cluster there is no limit.
    case_limit_s: float = 3600.0

    def validate(self) -> None:
        require(self.scenario != "", "scenario", "''", "a shipped scenario or a file")
        known = " or ".join(COMBINATIONS)
        require(self.combine in COMBINATIONS, "combine", self.combine, known)
        one = bool(self.vary) != bool(self.tolerances)
        require(one, "vary, tolerances", "both or none", "either a list of fields or tolerances")
        require(1 <= self.draws <= MOST_CASES, "draws", self.draws, f"1 .. {MOST_CASES}")
        require(self.seed >= 0, "seed", self.seed, ">= 0")
        fields = [vary.field for vary in self.vary]
        require(len(set(fields)) == len(fields), "vary", fields, "without repeated fields")
        for name in fields:
            require(name not in self.set, f"set.{name}", self.set.get(name), "not varied as well")
        lengths = [len(vary.choices) for vary in self.vary]
        if self.combine == "list" and lengths:
            require(len(set(lengths)) == 1, "vary", lengths, "lists of one length with 'list'")
        else:
            cases = 1
            for length in lengths:
                cases *= max(length, 1)
            require(cases <= MOST_CASES, "number of cases", cases, f"<= {MOST_CASES}")
        limit = self.case_limit_s
        require(limit >= 0.0, "case_limit_s", limit, ">= 0 (0 for none)")

    def combinations(self) -> list[dict[str, Any]]:
        """What each case varies, by field, in order."""
        choices = [vary.choices for vary in self.vary]
        rows = zip(*choices, strict=True) if self.combine == "list" else itertools.product(*choices)
        fields = [vary.field for vary in self.vary]
        return [dict(zip(fields, row, strict=True)) for row in rows]


@dataclasses.dataclass(frozen=True, kw_only=True)
class StudyKind:
    """What a machine adds to studies of its scenarios.

    Attributes:
        make_cases: of a study and its scenario's file.
        columns: of the study's table, between status and reason.
        panels: of the figure: title, unit and factor by column.
        tightest: of a study of tolerances: the rows' number that says how tight a case was.
    """

    make_cases: Callable[[StudyFile, Path], list[Case]]
    columns: Callable[[StudyFile], Sequence[str]]
    panels: Callable[[StudyFile], dict[str, tuple[str, str, float]]]
    tightest: str
