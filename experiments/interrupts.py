"""Handling of Ctrl-C during compiled code, and of SIGTERM."""

from __future__ import annotations

import _thread
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

AGAIN_S = 0.01
"""Time after which an ignored interrupt is raised again [s]; choice: the callback that ignored it has returned."""


@contextmanager
def as_interrupts() -> Iterator[None]:
    """Raise KeyboardInterrupt after every Ctrl-C in a `with` block.

    Ctrl-C during a compiled kernel raises SystemError, "returned a result with an exception set". The cause of this
    error is a KeyboardInterrupt. During a callback from C, as in the compiler, Python reports and ignores the
    KeyboardInterrupt. Then it is raised again after `AGAIN_S`.
    """
    before, later = sys.unraisablehook, list[threading.Timer]()

    def ignored(fault: sys.UnraisableHookArgs) -> None:
        if issubclass(fault.exc_type, KeyboardInterrupt | SystemError) and _is_interrupt(fault.exc_value):
            later.append(threading.Timer(AGAIN_S, _thread.interrupt_main))
            later[-1].start()
        else:
            before(fault)

    sys.unraisablehook = ignored
    try:
        yield
        for timer in later:
            timer.join()
    except SystemError as fault:
        if _is_interrupt(fault):
            raise KeyboardInterrupt from fault
        raise
    finally:
        sys.unraisablehook = before
        for timer in later:
            timer.cancel()


def _is_interrupt(fault: BaseException | None) -> bool:
    """Whether an exception is a KeyboardInterrupt or was caused by one."""
    while fault is not None and not isinstance(fault, KeyboardInterrupt):
        fault = fault.__cause__ or fault.__context__
    return fault is not None


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
