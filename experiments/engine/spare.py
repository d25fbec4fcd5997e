"""Use of other cores for the passes of one estimation; processes on other cores start only if that saves time."""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from experiments.threads import begin_helper

Shared = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]
"""Type of a map function, such as the `map` of a pool of processes."""

WORTH_S = 4.0
"""Time of a map in this process [s] after which further maps use other processes, which start in two seconds."""


NEEDED = "estimators"
"""Package that a process imports when it starts in advance: this import takes most of two seconds."""


def _shared_out(pool: ProcessPoolExecutor, function: Callable[[Any], Any], items: Iterable[Any]) -> Iterator[Any]:
    """The results in the order of the items; the pool begins with the first item, this process with the last.

    This process does the unfinished work of a killed process.
    """
    asked: list[tuple[Any, Future[Any] | None]] = []
    for item in items:
        try:
            asked.append((item, pool.submit(function, item)))
        except BrokenProcessPool:
            asked.append((item, None))
    own: list[Any] = []
    while asked and ((answer := asked[-1][1]) is None or answer.cancel()):
        own.append(function(asked.pop()[0]))
    for item, answer in asked:
        try:
            found = function(item) if answer is None else answer.result()
        except BrokenProcessPool:
            found = function(item)
        yield found
    yield from reversed(own)


@contextmanager
def spare_cores(n_cores: int | None = None, *, ahead: bool = False) -> Iterator[Shared]:
    """A map that runs in this process; after a call that took `WORTH_S`, also in one process for each other core.

    n_cores: number of cores, by default all. Functions and arguments must be picklable.
    ahead: whether to start these processes now, so that they already take part in the first call
    """
    n = os.cpu_count() or 1 if n_cores is None else n_cores
    pool: ProcessPoolExecutor | None = None
    longest_s = 0.0

    def begun() -> ProcessPoolExecutor:
        return ProcessPoolExecutor(n - 1, multiprocessing.get_context("spawn"), begin_helper)

    def shared(function: Callable[[Any], Any], items: Iterable[Any]) -> Iterable[Any]:
        nonlocal pool, longest_s
        if pool is None and (n < 2 or longest_s < WORTH_S):
            start = time.perf_counter()
            found = [function(item) for item in items]
            longest_s = max(longest_s, time.perf_counter() - start)
            return found
        if pool is None:
            pool = begun()
        return _shared_out(pool, function, items)

    try:
        if ahead and n > 1:
            pool = begun()
            for _ in range(n - 1):
                pool.submit(import_module, NEEDED)
        yield shared
    finally:
        if pool is not None:
            pool.shutdown(cancel_futures=True)
