"""Progress bars and tables on a terminal."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

FIRST_S = 10.0
"""Time of the first progress line of a run that is not on a terminal, doubled for each further one [s]: log files need
few lines; chosen."""

COMPILES = "a first run compiles"
"""Text while a stage has hardly begun: kernels compile in its first steps."""

BEGUN = 0.01
"""Share done of a stage below which it may still compile: the first few frames of hundreds; a choice."""

WAITS_S = 3.0
"""Time after which the bar shows that text [s]: a choice."""

Stage = Callable[[str], Callable[[float], None]]


@contextmanager
def progress() -> Iterator[Stage]:
    """Progress of a run, on standard error: stage(name) returns a function of the share done.

    A bar on a terminal, occasional lines elsewhere.
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
    """Print a line to standard error, at once."""
    print(line, file=sys.stderr, flush=True)


@contextmanager
def progress_lines(first_s: float = FIRST_S, say: Callable[[str], None] = to_stderr) -> Iterator[Stage]:
    """As `progress`, with lines after this time [s], after twice this time, and so on, even while the work stalls."""
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


def print_table(table: object) -> None:
    """Print a rich table to standard output."""
    from rich.console import Console

    # a unit in brackets is no markup
    Console(width=None if sys.stdout.isatty() else 110, markup=False).print(table)


def print_lines(lines: Sequence[tuple[str, str]]) -> None:
    """Print sentences to standard output, each beside its subject."""
    from rich.console import Console
    from rich.table import Table

    table = Table.grid(padding=(0, 2))
    for subject, sentence in lines:
        table.add_row(subject, sentence)
    Console(width=None if sys.stdout.isatty() else 110, highlight=False, markup=False).print(table)
