"""Execution of runs, in this process or by the workers of Dask.

Runs are sent to workers in batches. A batch ends after BATCH_S; its remaining runs are sent again. If workers die
during a batch, its runs are repeated one by one after all other runs. If workers die again, the repeated run failed.
"""

from __future__ import annotations

import math
import pickle
import queue
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from experiments.engine.runs import Run, Work, importable, last_line, module_of, perform
from experiments.engine.workers import NO_WORKER_S, Workers, connected
from experiments.errors import InputError

if TYPE_CHECKING:
    from distributed import Client, Future

BATCH_S = 1.0
"""Time after which a worker starts no further run of a batch [s]; choice: sending and returning a batch takes 10 ms."""

AHEAD = 2
"""Number of batches that the scheduler has for each worker: the worker processes one, the other one waits."""

COUNTED_EACH_S = 2.0
"""Interval at which the workers of a cluster are counted [s]."""

DIED = "KilledWorker: the worker processes of this run died in all tries, out of memory or by a fault of its code"


class RunsFailedError(Exception):
    """Error for failed runs of a study; the message has the number of failed runs and the first failure."""


def finished(work: Work, jobs: Sequence[Any], workers: Workers) -> Iterator[Run]:
    """Outcomes of the jobs as they finish. If other processes do jobs, jobs and results must be picklable."""
    if workers.own_process:
        for index, job in enumerate(jobs):
            yield perform(work, index, job)
    elif jobs:
        shared = importable(work)
        with connected(workers, module_of(shared)) as client:
            yield from _Sending(shared, jobs, client, local=workers.scheduler is None).runs()


def results(
    work: Work, jobs: Sequence[Any], workers: Workers, advance: Callable[[float], None] = lambda _share: None
) -> list[Any]:
    """The result of each job, in the order of the jobs. If jobs failed, raises RunsFailedError after the last job."""
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


def _perform_batch(work: Work, indices: Sequence[int], jobs: Sequence[object]) -> list[Run]:
    """Do the runs of a batch, and pickle the results. After BATCH_S no further run is started."""
    began = time.perf_counter()
    runs = []
    for index, job in zip(indices, jobs, strict=True):
        run = perform(work, index, job)
        try:
            runs.append(replace(run, result=pickle.dumps(run.result)))
        except Exception as fault:
            runs.append(Run(index, run.seconds, failure=last_line(fault)))
        if time.perf_counter() - began > BATCH_S:
            break
    return runs


class _Sending:
    """Sends jobs to workers, and receives the outcomes.

    local: whether the workers are on this machine; if so, the study ends after NO_WORKER_S without a worker
    """

    def __init__(self, work: Work, jobs: Sequence[Any], client: Client, *, local: bool) -> None:
        self.work, self.jobs, self.client, self.local = work, jobs, client, local
        self.waiting, self.alone = deque(range(len(jobs))), deque[int]()
        self.sent: dict[Future, list[int]] = {}
        self.arriving: queue.SimpleQueue[Future] = queue.SimpleQueue()
        self.run_s = math.inf  # mean time of a run in the last batch
        self.n_threads, self.counted, self.had_workers = 1, -math.inf, time.monotonic()

    def runs(self) -> Iterator[Run]:
        """Outcomes of the jobs, as the batches arrive."""
        while self.waiting or self.alone or self.sent:
            self.count_workers()
            while self.waiting and len(self.sent) < AHEAD * self.n_threads:
                n_left = math.ceil(len(self.waiting) / (AHEAD * self.n_threads))
                n = max(1, min(n_left, round(BATCH_S / self.run_s) if self.run_s > 0.0 else n_left))
                self.send([self.waiting.popleft() for _ in range(n)])
            singly = not self.sent
            if singly:
                self.send([self.alone.popleft()])
            future = self.arrival()
            yield from self.arrived(future, self.sent.pop(future), singly=singly)

    def arrival(self) -> Future:
        """The next batch that a worker returns."""
        while True:
            try:
                return self.arriving.get(timeout=COUNTED_EACH_S)
            except queue.Empty:
                self.count_workers()

    def count_workers(self) -> None:
        """Update the number of workers. Raises InputError after NO_WORKER_S without a local worker."""
        now = time.monotonic()
        if now - self.counted <= COUNTED_EACH_S:
            return
        n_threads = sum(self.client.nthreads().values())
        self.n_threads, self.counted = max(1, n_threads), now
        if n_threads:
            self.had_workers = now
        elif self.local and now - self.had_workers > NO_WORKER_S:
            raise InputError.at("--processes", "worker processes that start", f"none for {NO_WORKER_S:g} s")

    def send(self, indices: list[int]) -> None:
        """Send a batch."""
        jobs = [self.jobs[index] for index in indices]
        future = self.client.submit(_perform_batch, self.work, indices, jobs, pure=False)
        self.sent[future] = indices
        future.add_done_callback(self.arriving.put)

    def arrived(self, future: Future, indices: list[int], *, singly: bool) -> list[Run]:
        """Outcomes of the runs of a returned batch. Runs that the worker did not start are queued again."""
        from distributed import CancelledError, KilledWorker

        try:
            runs: list[Run] = future.result()
        except KilledWorker:
            if singly:
                return [Run(indices[0], math.nan, failure=DIED)]
            self.alone.extend(indices)
            return []
        except (CancelledError, OSError) as fault:
            raise InputError.at(
                "--scheduler", "a scheduler until the last run", f"{last_line(fault)}; run again to continue"
            ) from fault
        except Exception as fault:  # for example, the worker lacks a module
            return [Run(index, math.nan, failure=last_line(fault)) for index in indices]
        self.waiting.extendleft(reversed(indices[len(runs) :]))
        self.run_s = sum(run.seconds for run in runs) / len(runs)
        return [replace(run, result=None if run.failure else pickle.loads(run.result)) for run in runs]
