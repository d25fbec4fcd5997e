"""CSV files with missing entries: columns of numbers, where missing entries are NaN, and columns of text."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from experiments.arrays import Floats
from experiments.errors import InputError, shown
from experiments.formats.tables import Table, read_rows

MISSING = ("", "nan", "NaN")
"""Entries that represent a missing number."""


def open_table(
    path: Path, header: Sequence[str], rows: Sequence[Sequence[str]], words: Collection[str], *, first_row: int = 2
) -> Table:
    """The table of these rows, each as long as the header; all columns except `words` are numbers, NaN if missing.

    Raises InputError with row and column.
    """
    columns = dict(zip(header, zip(*rows, strict=True) if rows else [()] * len(header), strict=True))
    numbers = {n: _numbers(path, n, entries, first_row) for n, entries in columns.items() if n not in words}
    texts = {name: list(entries) for name, entries in columns.items() if name in words}
    return Table(path, numbers, texts, len(rows), first_row)


def read_open(path: Path, needed: Sequence[str], words: Collection[str]) -> tuple[Table, list[str]]:
    """The table of a run's results in a file, and the names of its columns in order; raises InputError.

    needed: columns that must exist, time_s included. An incomplete last line, as after a killed run, is omitted.
    """
    header, *rows = read_rows(path, f"columns {', '.join(needed)}", torn=True)
    for column in dict.fromkeys([*needed, *header]):
        if header.count(column) != 1:
            found = f"{header.count(column) or 'none'} in {shown(','.join(header))}"
            raise InputError.at(f"{path}: row 1", f"one column {column}", found)
    table = open_table(path, header, rows, words)
    table.check("time_s", np.isfinite(table.numbers["time_s"]), "a finite number")
    return table, header


def _numbers(path: Path, column: str, entries: Sequence[str], first_row: int) -> Floats:
    values = np.full(len(entries), np.nan)
    for k, entry in enumerate(entries):
        if entry not in MISSING:
            try:
                values[k] = float(entry)
            except ValueError:
                raise InputError.at(f"{path}: row {k + first_row}: {column}", "a number", shown(entry)) from None
    return values
