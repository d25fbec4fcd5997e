"""Results of runs as they finish: in this process, or by Dask, with dead workers replaced.

Runs whose workers die are repeated at the end, one at a time; a run whose worker dies again has failed.
"""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import islice
from typing import TYPE_CHECKING, Any

from experiments.engine.runs import Run, Work, importable, last_line, perform
from experiments.engine.workers import NO_WORKER_S, Workers, connected
from experiments.errors import InputError

if TYPE_CHECKING:
    from distributed import Client, Future

AHEAD = 2
"""Number of runs sent for each worker: it does one while the next one waits."""

DIED = "KilledWorker: the worker processes of this run died in all tries, out of memory or by a fault of its code"


class RunsFailedError(Exception):
    """Error for failed runs of a study; the message counts them and has the first failure."""


def finished(work: Work, jobs: Sequence[Any], workers: Workers) -> Iterator[Run]:
    """Outcomes of the jobs as they finish; jobs and results for other processes must be picklable."""
    if workers.own_process:
        for index, job in enumerate(jobs):
            yield perform(work, index, job)
    elif jobs:
        with connected(workers) as client:
            yield from _sent(importable(work), jobs, client)


def results(
    work: Work, jobs: Sequence[Any], workers: Workers, advance: Callable[[float], None] = lambda _share: None
) -> list[Any]:
    """The result of each job, in the order of the jobs. Raises RunsFailedError at the end if any failed."""
    runs: dict[int, Run] = {}
    for run in finished(work, jobs, workers):
        runs[run.index] = run
        advance(len(runs) / len(jobs))
    failed = [run for run in runs.values() if run.failure is not None]
    if failed:
        first = min(failed, key=lambda run: run.index)
        raise RunsFailedError(
            f"{len(failed)} of {len(jobs)} runs failed, first {jobs[first.index]}: {first.failure}\n{first.trace}"
        )
    return [runs[index].result for index in range(len(jobs))]


def _pickled(work: Work, index: int, job: object) -> Run:
    """The outcome of a job, with a pickled result."""
    run = perform(work, index, job)
    try:
        return replace(run, result=pickle.dumps(run.result))
    except Exception as fault:
        return Run(index, run.seconds, failure=last_line(fault))


def _sent(work: Work, jobs: Sequence[Any], client: Client) -> Iterator[Run]:
    """Outcomes of the jobs as they arrive from the workers."""
    from distributed import KilledWorker, as_completed

    indices: dict[Future, int] = {}
    sent, waiting = as_completed(), iter(range(len(jobs)))

    def send(index: int) -> Future:
        future = client.submit(_pickled, work, index, jobs[index], pure=False)
        indices[future] = index
        return future

    def send_more() -> None:
        n_more = AHEAD * max(1, sum(client.nthreads().values())) - len(indices)
        for index in islice(waiting, max(0, n_more)):
            sent.add(send(index))

    alone = []
    send_more()
    for future in sent:
        try:
            yield _outcome(future, indices[future])
        except KilledWorker:
            alone.append(indices[future])
        del indices[future]
        send_more()
    for index in alone:
        try:
            yield _outcome(send(index), index)
        except KilledWorker:
            yield Run(index, math.nan, failure=DIED)


def _outcome(future: Future, index: int) -> Run:
    """The outcome of a run that was sent. Raises InputError if no scheduler or worker answers, KilledWorker."""
    from distributed import CancelledError, KilledWorker
    from distributed.scheduler import NoWorkerError

    try:
        run: Run = future.result()
    except KilledWorker:
        raise
    except NoWorkerError as fault:
        raise InputError.at("--processes", "worker processes that start", f"none for {NO_WORKER_S:g} s") from fault
    except (CancelledError, OSError) as fault:
        expected = "a scheduler until the last run"
        raise InputError.at("--scheduler", expected, f"{last_line(fault)}; run again to continue") from fault
    except Exception as fault:  # for example, the worker lacks a module
        return Run(index, math.nan, failure=last_line(fault))
    return replace(run, result=None if run.failure else pickle.loads(run.result))
