"""Workers compute every case once, whatever one of them does to its process."""

from __future__ import annotations

import os
import sys

import pytest

from pips_drake.errors import InputError
from pips_drake.twin.study import workers
from pips_drake.twin.study.cases import Case
from pips_drake.twin.study.workers import Cluster, Processes


def cases_of(work: str, function: str, count: int) -> list[Case]:
    return [
        Case(number=number, values={}, task={"x": number}, work=f"{work}:{function}")
        for number in range(1, count + 1)
    ]


def test_processes_compute_every_case_once_and_are_replaced(work, monkeypatch):
    monkeypatch.setattr(workers, "CASES_A_PROCESS", 2)
    ended = list(Processes(jobs=2).run(cases_of(work, "square", 7)))
    assert sorted(case.number for case, _ in ended) == [1, 2, 3, 4, 5, 6, 7]
    for case, outcome in ended:
        if case.number == 3:
            assert (outcome.status, outcome.reason) == ("failed", "ValueError: three is refused")
        else:
            assert outcome.numbers["square"] == case.number**2
    # Seven cases at four a pair of processes: two pairs at least.
    assert len({outcome.numbers.get("process") for _, outcome in ended} - {None}) >= 2


@pytest.mark.slow
def test_a_case_that_kills_its_process_has_died_and_takes_no_other_along(work):
    ended = {
        case.number: outcome
        for case, outcome in Processes(jobs=2).run(cases_of(work, "fragile", 6))
    }
    assert {number: outcome.status for number, outcome in ended.items()} == {
        1: "done",
        2: "died",
        3: "done",
        4: "done",
        5: "done",
        6: "done",
    }
    assert ended[6].numbers == {"square": 36}


@pytest.mark.slow
def test_a_case_beyond_the_time_limit_has_died(work):
    processes = Processes(jobs=1, limit_s=2.0)
    ended = {case.number: outcome for case, outcome in processes.run(cases_of(work, "endless", 2))}
    assert ended[1].status == "died"
    assert "more than 2 s" in ended[1].reason
    assert ended[2].status == "done"


def test_a_cluster_without_dask_says_what_to_install(work, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"pips-drake\[cluster\]"):
        list(Cluster(address="tcp://127.0.0.1:1").run(cases_of(work, "square", 1)))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # what Dask's own processes and sockets leave behind
def test_a_cluster_computes_the_same_and_survives_a_worker_that_dies(work, monkeypatch):
    import distributed

    cases = [
        *cases_of(work, "square", 6),
        Case(number=7, values={}, task={"x": 2}, work=f"{work}:fragile"),
    ]
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=2, dashboard_address=None, host="127.0.0.1"
    ) as cluster:
        ended = {
            case.number: outcome
            for case, outcome in Cluster(address=cluster.scheduler_address).run(cases)
        }
    assert ended[7].status == "died"
    assert ended[3].reason == "ValueError: three is refused"
    here = {
        outcome.numbers["process"] for outcome in ended.values() if "process" in outcome.numbers
    }
    for number in (1, 2, 4, 5, 6):
        assert ended[number].numbers["square"] == number**2
    assert os.getpid() not in here


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_an_address_without_a_scheduler_is_said_to_have_none(work, monkeypatch):
    monkeypatch.setattr(workers, "PATIENCE", 2.0)
    with pytest.raises(InputError, match=r"no scheduler there"):
        list(Cluster(address="tcp://127.0.0.1:9").run(cases_of(work, "square", 1)))
