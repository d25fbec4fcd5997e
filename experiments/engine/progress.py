"""Progress of runs on standard error."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

FIRST_S = 10.0
"""Time until the first progress line [s], if standard error is not a terminal. Further lines follow at 2, 4, 8 … times
this time. Choice: few lines in a log file."""

COMPILES = "a first run compiles"
"""Text that is shown at the start of a stage, because code is compiled in its first steps."""

BEGUN = 0.01
"""Completed share of a stage below which `COMPILES` is shown; choice: a few frames out of hundreds."""

WAITS_S = 3.0
"""Time from the start of a stage until the progress bar shows `COMPILES` [s]; choice."""

Stage = Callable[[str], Callable[[float], None]]


@contextmanager
def progress() -> Iterator[Stage]:
    """Show the progress of a run on standard error: bars on a terminal, otherwise occasional lines.

    Yields a function `stage`: `stage(name)` begins a stage, and returns a function to call with the completed share.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
    from rich.text import Text

    class Compiling(ProgressColumn):
        def render(self, task: Task) -> Text:
            return Text(COMPILES if task.completed < BEGUN and (task.elapsed or 0.0) > WAITS_S else "")

    console = Console(stderr=True)
    if not console.is_terminal:
        with progress_lines() as stage:
            yield stage
        return
    columns = (TextColumn("{task.description:<16}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"))
    with Progress(*columns, TimeRemainingColumn(), Compiling(), console=console) as bar:

        def stage(name: str) -> Callable[[float], None]:
            task = bar.add_task(name, total=1.0)
            return lambda share: bar.update(task, completed=share)

        yield stage


def to_stderr(line: str) -> None:
    """Print a line to standard error without buffering."""
    print(line, file=sys.stderr, flush=True)


@contextmanager
def progress_lines(first_s: float = FIRST_S, say: Callable[[str], None] = to_stderr) -> Iterator[Stage]:
    """Show progress as lines. The first line comes after first_s [s], further lines after 2, 4, 8 … times first_s."""
    over, began = threading.Event(), time.monotonic()
    reached = [("", 0.0)]

    def stage(name: str) -> Callable[[float], None]:
        def done(share: float) -> None:
            reached[0] = name, share

        done(0.0)
        return done

    def watch() -> None:
        next_s = first_s
        while not over.wait(began + next_s - time.monotonic()):
            name, share = reached[0]
            say(f"{name}: {share:.0%} after {next_s:.0f} s{f'; {COMPILES}' if share < BEGUN else ''}")
            next_s *= 2.0

    watching = threading.Thread(target=watch, name="softaim progress", daemon=True)
    watching.start()
    try:
        yield stage
    finally:
        over.set()
        watching.join()
