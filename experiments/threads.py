"""Threads: each library uses one thread, because arrays are small; `ahead` computes items in another thread."""

from __future__ import annotations

import os
import signal
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from multiprocessing.process import BaseProcess

Item = TypeVar("Item")

AHEAD = 4
"""Largest number of items that `ahead` computes in advance; choice: about 4 MB for pictures of 640x480."""

ONE_THREAD = dict.fromkeys(
    (
        "OPENBLAS_NUM_THREADS",
        "OMP_NUM_THREADS",
        "MKL_NUM_THREADS",
        "NUMBA_NUM_THREADS",
        "VECLIB_MAXIMUM_THREADS",
        "OPENCV_FOR_THREADS_NUM",
    ),
    1,
)
"""Environment variables that limit each library to one thread."""


def one_thread_each() -> None:
    """Set the environment variables of ONE_THREAD that the user has not set. Call this before NumPy is imported."""
    for name, n_threads in ONE_THREAD.items():
        os.environ.setdefault(name, str(n_threads))


def start_helper(process: BaseProcess) -> None:
    """Start a helper process with blocked Ctrl-C, which could otherwise interrupt it before `begin_helper`."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        process.start()
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        process.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def begin_helper(*, connected: bool = False) -> None:
    """Set up a helper process: one thread for each library, and no reaction to Ctrl-C.

    connected: whether the process ends with its connection to the run. Then it ignores SIGTERM, too: service managers
        send SIGTERM to all processes of a run at once, but the run itself ends these helpers in order.
    """
    one_thread_each()
    for ignored in (signal.SIGINT, signal.SIGTERM) if connected else (signal.SIGINT,):
        signal.signal(ignored, signal.SIG_IGN)


@contextmanager
def ahead(items: Iterable[Item]) -> Iterator[Iterator[Item]]:
    """The given items in order; a thread computes each item while the caller processes earlier ones.

    If the computation of an item fails, the exception is raised when the caller takes this item.
    """
    end: Any = object()
    coming, thread = iter(items), ThreadPoolExecutor(1, "ahead")
    made = deque(thread.submit(next, coming, end) for _ in range(AHEAD))

    def taken() -> Iterator[Item]:
        while (item := made.popleft().result()) is not end:
            made.append(thread.submit(next, coming, end))
            yield item

    try:
        yield taken()
    finally:
        thread.shutdown(cancel_futures=True)
