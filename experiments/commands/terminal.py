"""Progress bars and tables on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager


@contextmanager
def progress() -> Iterator[Callable[[str], Callable[[float], None]]]:
    """A progress bar on standard error: stage(name) returns a function of the share done."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (TextColumn("{task.description:<16}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"))
    with Progress(*columns, TimeRemainingColumn(), console=console, disable=not console.is_terminal) as bar:

        def stage(name: str) -> Callable[[float], None]:
            task = bar.add_task(name, total=1.0)
            return lambda share: bar.update(task, completed=share)

        yield stage


def print_table(table: object) -> None:
    """Print a rich table to standard output."""
    from rich.console import Console

    Console(width=None if sys.stdout.isatty() else 110).print(table)


def print_lines(lines: Sequence[tuple[str, str]]) -> None:
    """Print sentences to standard output, each after its subject, wrapped beside it."""
    from rich.console import Console
    from rich.table import Table

    table = Table.grid(padding=(0, 2))
    for subject, sentence in lines:
        table.add_row(subject, sentence)
    Console(width=None if sys.stdout.isatty() else 110, highlight=False, markup=False).print(table)
