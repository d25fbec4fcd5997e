"""One thread for each library that would start more: at some twenty states, on parts of a picture, they only wait.

And how a process begins that helps another.
"""

from __future__ import annotations

import os
import signal

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
