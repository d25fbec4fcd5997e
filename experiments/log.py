"""The program's log: what a person is to know goes to standard error, all of it to softaim.log of an output folder."""

from __future__ import annotations

import logging
import sys
import time

LOG = logging.getLogger("softaim")
"""WARNING: what a person is to know. INFO: what was read, chosen and done, and what it took; shown with --verbose."""


class StandardError(logging.Handler):
    """Lines on standard error, `softaim: text`; each replaces a status line on a terminal."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print a record."""
        clear = "\r\x1b[K" if sys.stderr.isatty() else ""
        print(f"{clear}softaim: {record.getMessage()}", file=sys.stderr, flush=True)


class Kept(logging.Handler):
    """Keeps every line with its time (UTC) and level, in order, for a file that is written at the end."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a record."""
        at = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(record.created))
        self.lines.append(f"{at}.{int(record.msecs):03d}Z {record.levelname:<7} {record.getMessage()}")

    def text(self) -> str:
        """The lines as a file has them."""
        return "".join(f"{line}\n" for line in self.lines)


SHOWN = StandardError(logging.WARNING)
LOG.addHandler(SHOWN)
LOG.setLevel(logging.INFO)
LOG.propagate = False
