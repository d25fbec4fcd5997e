"""Use of several cores for one estimation. Other processes start only if the estimation takes long enough."""

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
"""If a call of the map function takes WORTH_S [s], later calls use all cores; choice: processes start within 2 s."""

NEEDED = "estimators"
"""Processes that are started in advance import this package first; its import takes most of their starting time."""


def _shared_out(pool: ProcessPoolExecutor, function: Callable[[Any], Any], items: Iterable[Any]) -> Iterator[Any]:
    """The results in the order of the items. The pool takes items from the front, this process from the back.

    If a process of the pool is killed, this process computes the missing results.
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
    """Yields a map function. It uses only this process until one call takes WORTH_S; later calls use all cores.

    n_cores: number of cores; by default all
    ahead: if True, the other processes start now, and all calls use all cores
    Functions and arguments of the map function must be picklable.
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
