"""Ctrl-C while compiled code is called, and SIGTERM."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def as_interrupts() -> Iterator[None]:
    """Whatever an interrupt becomes in here is raised as KeyboardInterrupt.

    One that comes while a kernel is called comes back as SystemError, "returned a result with an exception set", which
    arose from it.
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
    """SIGTERM, by which scripts and service managers end a program, acts in here as Ctrl-C does."""
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread can hear it
        return

    def end(_number: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
