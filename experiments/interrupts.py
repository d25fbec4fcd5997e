"""Ctrl-C while compiled code is called."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


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
