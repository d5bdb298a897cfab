"""Runs a study: what is not computed yet, with a bar, each result kept as it comes."""

from __future__ import annotations

from collections.abc import Sequence

from tqdm import tqdm

from pips_drake.twin.study.cases import DONE, Case, Outcome
from pips_drake.twin.study.store import ResultStore
from pips_drake.twin.study.workers import Workers


def run_cases(
    cases: Sequence[Case], *, store: ResultStore, workers: Workers, name: str
) -> dict[int, Outcome]:
    """What came of every case, by number: kept from an earlier run, or computed now.

    Stopping it at any moment loses no more than the cases in flight.

    Args:
        name: for the bar, which shows on a terminal.
    """
    store.keep_only(cases)
    outcomes = {}
    for case in cases:
        kept = store.read(case)
        if kept is not None:
            outcomes[case.number] = kept
    waiting = [case for case in cases if case.number not in outcomes]
    failed = sum(outcome.status != DONE for outcome in outcomes.values())
    if waiting:
        with tqdm(
            total=len(cases), initial=len(outcomes), desc=name, unit="case", disable=None
        ) as bar:
            for case, outcome in workers.run(waiting):
                store.write(case, outcome)
                outcomes[case.number] = outcome
                failed += outcome.status != DONE
                bar.set_postfix_str(f"{failed} failed" if failed else "")
                bar.update()
    return outcomes
