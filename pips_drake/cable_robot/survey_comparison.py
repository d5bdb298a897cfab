"""Two surveys of the same panels, before and after a mission: what is new, and what has grown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pips_drake.cable_robot.defect_map import Finding, match
from pips_drake.config import require

#: A defect has grown if its longest extent is larger by more than both, m and a share of it: two
#: measurements of the same one differ by less.
GROWTH, GROWTH_SHARE = 0.003, 0.15

Pair = tuple[Finding, Finding]


@dataclass(frozen=True, eq=False)
class SurveyComparison:
    """The findings of two surveys, each in one list.

    Attributes:
        new: only in the later one.
        gone: only in the earlier one.
        grown, unchanged: in both, (earlier, later).
    """

    new: list[Finding]
    gone: list[Finding]
    grown: list[Pair]
    unchanged: list[Pair]


def compare_surveys(
    before: Sequence[Finding],
    after: Sequence[Finding],
    *,
    radius: float,
    growth: float = GROWTH,
    growth_share: float = GROWTH_SHARE,
) -> SurveyComparison:
    """Which findings of two surveys are the same, and which have grown.

    Args:
        radius: how far apart the same defect may be in the two maps, m: the sum of both maps'
            predicted errors.
        growth, growth_share: by which a longest extent must be larger, m and a share of it.
    """
    require(radius > 0.0, "radius to match findings in", f"{radius:g} m", "> 0")
    pairs: list[Pair] = []
    for panel in dict.fromkeys(f.panel for f in before):
        old = [f for f in before if f.panel == panel]
        late = [f for f in after if f.panel == panel]
        places = [(f.u, f.v) for f in old], [(f.u, f.v) for f in late]
        pairs += [(old[i], late[k]) for i, k in match(*places, radius)]
    grown = [
        (old, late)
        for old, late in pairs
        if late.size_m > old.size_m + max(growth, growth_share * old.size_m)
    ]
    changed = {old.name for old, _ in grown}
    first, second = {old.name for old, _ in pairs}, {late.name for _, late in pairs}
    return SurveyComparison(
        new=[f for f in after if f.name not in second],
        gone=[f for f in before if f.name not in first],
        grown=grown,
        unchanged=[pair for pair in pairs if pair[0].name not in changed],
    )
