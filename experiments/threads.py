"""One thread for each library that would start more: at some twenty states, on parts of a picture, they only wait.

How a process begins that helps another, and a thread for what is read or drawn while something else is worked out.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from queue import Queue
from typing import TypeVar

Item = TypeVar("Item")

AHEAD = 4
"""Items that wait for who takes them, at most: for pictures of 640x480 some 4 MB; chosen."""

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
"""Environment of a process that works by itself, or of one of as many workers as there are cores."""


def one_thread_each() -> None:
    """Set these variables where the user has not; of use before NumPy and OpenCV are loaded."""
    for name, n_threads in ONE_THREAD.items():
        os.environ.setdefault(name, str(n_threads))


def begin_helper() -> None:
    """Begin a process that helps another: one thread each; Ctrl-C is for the other, which ends this one."""
    one_thread_each()
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def ahead(items: Iterable[Item]) -> Iterator[Iterator[Item]]:
    """The same items in the same order, each made by a thread while an earlier one is at work.

    What making one raises is raised where that one would come. At the end the thread is over, taken or not.
    """
    made: Queue[tuple[bool, Item | BaseException | None]] = Queue(AHEAD)
    wanted = True

    def make() -> None:
        try:
            for item in items:
                if not wanted:
                    return
                made.put((True, item))
            made.put((False, None))
        except BaseException as fault:
            made.put((False, fault))

    def taken() -> Iterator[Item]:
        while (one := made.get())[0]:
            yield one[1]  # type: ignore[misc]
        if one[1] is not None:
            raise one[1]  # type: ignore[misc]

    thread = threading.Thread(target=make, name="ahead", daemon=True)
    thread.start()
    try:
        yield taken()
    finally:
        wanted = False
        while thread.is_alive():
            while not made.empty():
                made.get()
            thread.join(0.01)
