"""Who computes a study's cases: processes of this machine, or a Dask cluster's workers."""

from __future__ import annotations

import contextlib
import faulthandler
import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import connection
from pathlib import Path
from typing import Any, Protocol

from pips_drake.errors import InputError, PipsError
from pips_drake.twin.study.cases import DIED, FAILED, Case, Outcome, compute

#: Processes are replaced after this many cases each: diagrams that hold Python systems are never
#: freed in Drake 1.51. (Python's own `max_tasks_per_child` can hang: CPython issue 115634.)
CASES_A_PROCESS = 16
#: How long to wait for a cluster's scheduler, s.
PATIENCE = 20.0


class Workers(Protocol):
    """Computes cases; yields each with what came of it, in whatever order they end."""

    def run(self, cases: Sequence[Case]) -> Iterator[tuple[Case, Outcome]]:
        """Nothing that a case does ends the iteration; leaving it early stops what still runs."""
        ...


@dataclass(frozen=True, kw_only=True)
class Processes:
    """Processes of this machine.

    A case whose process dies (by a signal, out of memory, or at the time limit) is computed once
    more alone, because others that were in flight die with the pool; then it counts as died.

    Attributes:
        jobs: how many at a time.
        limit_s: a case that takes longer is ended; 0 for no limit.
    """

    jobs: int
    limit_s: float = 0.0

    def run(self, cases: Sequence[Case]) -> Iterator[tuple[Case, Outcome]]:
        """See `Workers.run`."""
        waiting, suspects = deque(cases), deque[Case]()
        while waiting or suspects:
            alone = bool(suspects)
            source = suspects if alone else waiting
            jobs = 1 if alone else self.jobs
            yield from self._run_pool(source, jobs, suspects)

    def _run_pool(
        self, source: deque[Case], jobs: int, suspects: deque[Case]
    ) -> Iterator[tuple[Case, Outcome]]:
        """Computes cases until there are none, the processes are old, or one of them dies.

        Whoever may have killed it is put among the suspects, or is yielded as died if it was alone.
        """
        pool = ProcessPoolExecutor(
            max_workers=jobs,
            mp_context=multiprocessing.get_context("spawn"),  # numba and Drake have threads
            initializer=_start_process,
        )
        left = jobs * CASES_A_PROCESS
        flying: dict[Future[Outcome], Case] = {}
        try:
            while (source and left) or flying:
                # No more than there are processes: whoever flies when the pool breaks is suspect.
                while source and left and len(flying) < jobs:
                    left -= 1
                    case = source.popleft()
                    future = pool.submit(_compute_within, case.work, case.task, self.limit_s)
                    flying[future] = case
                ended, _ = wait(flying, return_when=FIRST_COMPLETED)
                for future in sorted(ended, key=lambda future: flying[future].number):
                    case = flying[future]
                    outcome = future.result()  # BrokenProcessPool
                    del flying[future]
                    yield case, outcome
        except BrokenProcessPool:
            whole = [f for f in flying if f.done() and f.exception() is None]
            for future in whole:
                yield flying.pop(future), future.result()
            lost = sorted(flying.values(), key=lambda case: case.number)
            flying.clear()
            if jobs == 1:
                for case in lost:
                    yield case, self._died()
            else:
                suspects.extend(lost)
        finally:
            _end(pool, at_once=bool(flying))

    def _died(self) -> Outcome:
        limit = f", or it took more than {self.limit_s:g} s" if self.limit_s else ""
        return Outcome(status=DIED, reason=f"its process ended (killed or crashed{limit})")


@dataclass(frozen=True, kw_only=True)
class Cluster:
    """The workers of a Dask cluster (extra `cluster`), on as many machines as it has.

    As with processes, cases on a worker that dies are computed once more, one by one. Every worker
    needs the same pips_drake. A worker computes one case at a time, so one thread each
    is enough; with a nanny and `--lifetime` they are replaced now and then.

    Attributes:
        address: of the scheduler, such as tcp://host:8786.
    """

    address: str

    def run(self, cases: Sequence[Case]) -> Iterator[tuple[Case, Outcome]]:
        """See `Workers.run`."""
        try:
            from distributed import Client, as_completed
        except ImportError:
            raise InputError(
                "--cluster needs Dask: pip install 'pips-drake[cluster]' here and on every worker"
            ) from None
        try:
            client = Client(self.address, timeout=PATIENCE)
        except (OSError, ValueError, TypeError) as error:
            raise InputError(f"--cluster {self.address}: no scheduler there ({error})") from None
        with client:
            suspects = []
            flying = {_submit(client, case): case for case in cases}
            try:
                for future in as_completed(list(flying)):
                    case, outcome = flying.pop(future), _outcome_of(future, self.address)
                    future.release()
                    if outcome.status == DIED:  # or one beside it
                        suspects.append(case)
                    else:
                        yield case, outcome
                for case in suspects:
                    future = _submit(client, case, again=True)
                    flying[future] = case
                    yield flying.pop(future), _outcome_of(future, self.address)
            finally:
                with contextlib.suppress(Exception):  # a cluster that is gone has nothing to cancel
                    client.cancel(list(flying))


def _submit(client: Any, case: Case, *, again: bool = False) -> Any:
    key = f"{case.number}-{case.key}" + "-again" * again
    return client.submit(compute, case.work, dict(case.task), key=key, pure=False)


def _outcome_of(future: Any, address: str) -> Outcome:
    """The outcome of a case that has ended, or that has to be computed again.

    A worker that dies takes along what others had finished on it, even between the word that a case
    has ended and the asking for its outcome. So whatever a case's state is now is waited out.
    """
    from distributed import CancelledError, KilledWorker

    try:
        outcome: Outcome = future.result()
    except CancelledError:
        raise PipsError(
            f"the cluster at {address} was lost; finished cases are kept, and the same command "
            "goes on"
        ) from None
    except KilledWorker:
        return Outcome(status=DIED, reason="the cluster's workers that took it ended")
    except Exception as error:  # one that cannot even import the work
        return Outcome(status=FAILED, reason=f"{type(error).__name__}: {error}")
    return outcome


def _start_process() -> None:
    """In each process: leaves Ctrl-C to the parent, and ends when the parent is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ["TQDM_DISABLE"] = "1"  # the study has a bar of its own
    parent = multiprocessing.parent_process()
    if parent is None:
        return
    sentinel = parent.sentinel

    def end_with_parent() -> None:
        # A pool's processes hold both ends of its pipes, so a killed parent would never be noticed.
        connection.wait([sentinel])
        os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()


def _compute_within(work: str, task: Mapping[str, Any], limit_s: float) -> Outcome:
    """`compute`, in a process that ends at the limit: from a thread in C, whatever Python does."""
    if limit_s <= 0.0:
        return compute(work, task)
    with Path(os.devnull).open("w") as nowhere:
        faulthandler.dump_traceback_later(limit_s, exit=True, file=nowhere)
        try:
            return compute(work, task)
        finally:
            faulthandler.cancel_dump_traceback_later()


def _end(pool: ProcessPoolExecutor, *, at_once: bool) -> None:
    """Ends a pool, and at once with whatever its processes compute, if that is not waited for."""
    if at_once:
        for process in list((pool._processes or {}).values()):
            with contextlib.suppress(OSError, ValueError, AttributeError):
                process.terminate()
    pool.shutdown(wait=True, cancel_futures=True)
