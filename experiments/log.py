"""The program's log. Warnings go to standard error, and all messages to softaim.log in an output folder."""

from __future__ import annotations

import logging
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from queue import Full, Queue

LOG = logging.getLogger("softaim")
"""Logger. Level WARNING: messages for people. Level INFO: inputs, choices, actions, times; shown with --verbose."""


MOST_WAITING = 1000
"""Largest number of lines that wait for standard error; further lines are only in softaim.log; choice."""

LAST_S = 0.5
"""Longest time that `StandardError.unwaited` waits at its end for the last lines to be written [s]; choice."""


class StandardError(logging.Handler):
    """Writes messages to standard error as lines `softaim: text`."""

    def __init__(self, level: int) -> None:
        super().__init__(level)
        self._waiting: Queue[str | None] | None = None

    def emit(self, record: logging.LogRecord) -> None:
        """Print a record."""
        self.say(f"softaim: {record.getMessage()}")

    def say(self, line: str) -> None:
        """Print a line."""
        waiting = self._waiting
        if waiting is None:
            _write(line)
            return
        with suppress(Full):
            waiting.put_nowait(line)

    @contextmanager
    def unwaited(self) -> Iterator[None]:
        """In a `with` block, write lines in a thread, so that the program does not wait for a slow reader."""
        waiting: Queue[str | None] = Queue(MOST_WAITING)

        def work() -> None:
            while (line := waiting.get()) is not None:
                _write(line)

        thread = threading.Thread(target=work, name="standard error", daemon=True)
        thread.start()
        self._waiting = waiting
        try:
            yield
        finally:
            self._waiting = None
            with suppress(Full):
                waiting.put_nowait(None)
            thread.join(LAST_S)


def _write(line: str) -> None:
    if sys.stderr is None:  # the program was started without standard error
        return
    with suppress(OSError, ValueError):  # the reader of standard error has gone
        clear = "\r\x1b[K" if sys.stderr.isatty() else ""
        print(f"{clear}{line}", file=sys.stderr, flush=True)


class Kept(logging.Handler):
    """Stores every message with its time (UTC) and level, for a file that is written at the end."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Store a record."""
        at = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(record.created))
        self.lines.append(f"{at}.{int(record.msecs):03d}Z {record.levelname:<7} {record.getMessage()}")

    def text(self) -> str:
        """The stored lines as the content of a file."""
        return "".join(f"{line}\n" for line in self.lines)


SHOWN = StandardError(logging.WARNING)
LOG.addHandler(SHOWN)
LOG.setLevel(logging.INFO)
LOG.propagate = False
