"""Output of a live run that neither delays nor ends the loop: tables and a status line."""

from __future__ import annotations

import csv
import shutil
import sys
import threading
import time
from collections.abc import Sequence
from io import TextIOWrapper
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from experiments.errors import InputError
from experiments.log import LOG

A_LINE_S = 1.0
"""Least interval between status lines if standard output is not a terminal [s]; choice."""

LAST_S = 0.5
"""Timeout for writing the last status line [s]; choice."""


class LiveTable:
    """A CSV table that grows row by row; each row is immediately written to the file.

    also: other tables that get the same rows; fault: the reason why the table can no longer be written, or None
    """

    def __init__(self, path: Path, header: Sequence[str]) -> None:
        self.path, self._header = path, header
        self.fault: InputError | None = None
        self.also: list[LiveTable] = []
        self._file: TextIOWrapper | None = None

    def begin(self) -> None:
        """Create the file at the first call; before this call, an older file of the same name is kept."""
        if self._file is None and self.fault is None:
            try:
                self._file = self.path.open("w", encoding="utf-8", newline="")
                self._add(self._header)
            except OSError as error:
                self._failed(error)

    def write(self, row: Sequence[Any]) -> None:
        """Add a row. If this fails, report it, and omit this row and all later rows."""
        self.begin()
        if self.fault is None:
            try:
                self._add(row)
            except OSError as error:
                self._failed(error)
        for other in self.also:
            other.write(row)

    def copied(self, path: Path) -> LiveTable:
        """Another table, at `path`, that gets all later rows."""
        self.also.append(LiveTable(path, self._header))
        return self.also[-1]

    def _add(self, row: Sequence[Any]) -> None:
        assert self._file is not None
        csv.writer(self._file).writerow(row)
        self._file.flush()

    def _failed(self, error: OSError) -> None:
        self.fault = InputError.refused(self.path, "a table that can be written", error)
        LOG.warning("%s; the run continues without it", self.fault)

    def close(self) -> None:
        """Close the table's file."""
        if self._file is not None:
            try:
                self._file.close()
            except OSError as error:  # closing writes the remaining rows
                self.fault = self.fault or InputError.refused(self.path, "a table that can be written", error)


class StatusLine:
    """Status line on standard output. A terminal updates the line; other output gets a new line about once a second.

    A thread writes the newest text, so that the loop never waits for a blocked or closed reader.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = sys.stdout if stream is None else stream
        # None: the program has no standard output
        self._terminal = self._stream is not None and self._stream.isatty()
        self._text: str | None = None
        self._ended = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._work, name="status line", daemon=True)

    def __enter__(self) -> StatusLine:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._thread.join(LAST_S)

    def show(self, text: str) -> None:
        """Show this text as soon as possible, in place of any text that still waits."""
        with self._changed:
            self._text = text
            self._changed.notify()

    def _work(self) -> None:
        if self._stream is None:
            return
        last_s = -np.inf
        try:
            while True:
                with self._changed:
                    self._changed.wait_for(lambda: self._ended or self._text is not None)
                    text, self._text = self._text, None
                    if text is None:
                        break
                if self._terminal:
                    self._stream.write(f"\r{text[: shutil.get_terminal_size().columns - 1]}\x1b[K")
                elif time.monotonic() - last_s >= A_LINE_S:
                    last_s = time.monotonic()
                    self._stream.write(f"{text}\n")
                self._stream.flush()
            if self._terminal:
                self._stream.write("\n")
                self._stream.flush()
        except (OSError, ValueError):
            return  # the reader of standard output has gone


FINEST_MS, LONGEST_MS, A_DECADE = 1e-3, 1e6, 200
"""Least and largest latency in the histogram [ms], and number of bins per factor of ten (1.2 % per bin); numerical."""


class Latencies:
    """Histogram of latencies from exposure to estimate; its memory does not grow."""

    def __init__(self) -> None:
        self._counts = np.zeros(int(A_DECADE * np.log10(LONGEST_MS / FINEST_MS)) + 1, dtype=np.int64)
        self.worst_ms = 0.0

    def add(self, latency_ms: float) -> None:
        """Count a latency."""
        self.worst_ms = max(self.worst_ms, latency_ms)
        place = A_DECADE * np.log10(max(latency_ms, FINEST_MS) / FINEST_MS)
        self._counts[min(int(place + 0.5), len(self._counts) - 1)] += 1

    def quantile_ms(self, share: float) -> float:
        """Quantile of the latencies [ms], accurate to 1.2 %; 0 if there are no latencies."""
        if not self._counts.any():
            return 0.0
        of = int(np.searchsorted(np.cumsum(self._counts), share * self._counts.sum()))
        return min(float(FINEST_MS * 10.0 ** (of / A_DECADE)), self.worst_ms)
