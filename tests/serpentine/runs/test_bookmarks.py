"""The moments of a run that its replay can jump to."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pips_drake.serpentine.runs.pictures import run_bookmarks, run_phases

MOTION: Any = SimpleNamespace(end=2.0)
#: Out, at the end for two samples, and back; a sample each half second.
TRAVEL = [1.0, 1.5, 2.0, 2.0, 1.5, 1.0]


def make_assessment(
    clearance: list[float], *, travel: list[float] = TRAVEL, witness: bool = True
) -> Any:
    count = len(clearance)
    points = np.zeros((count, 2, 3))
    points[:, 1, 0] = clearance
    data = SimpleNamespace(
        time=0.5 * np.arange(count),
        tip_arc_lengths=np.array(travel),
        clearance=np.array(clearance),
        pairs=tuple(None if c >= 1.0 else ("arm", "wall") for c in clearance),
        witness=points if witness else None,
    )
    return SimpleNamespace(data=data, motion=MOTION, nearest=int(np.argmin(clearance)))


def moments(assessment: Any) -> list[tuple[str, float]]:
    return [(one.label, one.time) for one in run_bookmarks(assessment)]


def test_the_least_clearance_has_its_nearest_points() -> None:
    assessment = make_assessment([1.0, 0.5, 0.1, 0.0394, 0.1, 0.5])
    assert moments(assessment) == [("least clearance 39 mm", 1.5), ("end of path", 1.0)]
    line = run_bookmarks(assessment)[0].line
    assert line is not None
    np.testing.assert_array_equal(line.points, [[0.0, 0.0, 0.0], [0.0394, 0.0, 0.0]])


def test_a_contact_is_a_moment_of_its_own_unless_it_is_the_worst() -> None:
    later = make_assessment([0.5, -0.002, -0.01, 0.1, 0.1, 0.1])
    assert moments(later)[:2] == [("first contact -2 mm", 0.5), ("least clearance -10 mm", 1.0)]
    at_once = make_assessment([0.5, -0.01, 0.1, 0.1, 0.1, 0.1])
    assert moments(at_once) == [("least clearance -10 mm", 0.5), ("end of path", 1.0)]


@pytest.mark.parametrize(("clearance", "witness"), [(1.0, True), (0.5, False)])
def test_without_nearest_points_there_is_no_line_to_jump_to(
    clearance: float, witness: bool
) -> None:
    assessment = make_assessment([clearance] * 6, witness=witness)
    assert moments(assessment) == [("end of path", 1.0)]


@pytest.mark.parametrize(
    ("travel", "phases"),
    [
        (TRAVEL, {"extend": 0.0, "dwell": 1.0, "retract": 1.5}),
        (TRAVEL[:4], {"extend": 0.0, "dwell": 1.0}),
        (TRAVEL[:2], {"extend": 0.0}),
    ],
)
def test_phases_are_those_that_the_run_came_to(
    travel: list[float], phases: dict[str, float]
) -> None:
    assessment = make_assessment([0.5] * len(travel), travel=travel)
    assert run_phases(assessment.data, MOTION) == phases
    assert ("end of path", 1.0) in moments(assessment) or "dwell" not in phases
