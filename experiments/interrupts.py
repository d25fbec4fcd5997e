"""Handling of Ctrl-C during compiled code, and of SIGTERM."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def as_interrupts() -> Iterator[None]:
    """Raise KeyboardInterrupt after every Ctrl-C in a `with` block.

    Ctrl-C during a compiled kernel raises SystemError, "returned a result with an exception set". The cause of this
    error is a KeyboardInterrupt.
    """
    try:
        yield
    except SystemError as fault:
        arose: BaseException | None = fault
        while arose is not None:
            if isinstance(arose, KeyboardInterrupt):
                raise KeyboardInterrupt from fault
            arose = arose.__cause__ or arose.__context__
        raise


@contextmanager
def terminations() -> Iterator[None]:
    """Treat SIGTERM in a `with` block like Ctrl-C. Scripts and service managers end programs with SIGTERM."""
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread can receive it
        return

    def end(_number: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
