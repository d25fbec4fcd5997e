"""CSV files with missing entries: columns of numbers, where missing entries are NaN, and columns of text."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from experiments.arrays import Floats
from experiments.errors import InputError, shown
from experiments.formats.tables import Table

MISSING = ("", "nan", "NaN")
"""Entries that represent a missing number."""


def open_table(
    path: Path, header: Sequence[str], rows: Sequence[Sequence[str]], words: Collection[str], *, first_row: int = 2
) -> Table:
    """The table of these rows, each as long as the header; all columns except `words` are numbers.

    Missing and infinite numbers are NaN. Raises InputError with row and column.
    """
    columns = dict(zip(header, zip(*rows, strict=True) if rows else [()] * len(header), strict=True))
    numbers = {n: numbers_of(path, n, entries, first_row) for n, entries in columns.items() if n not in words}
    for values in numbers.values():
        values[np.isinf(values)] = np.nan
    texts = {name: list(entries) for name, entries in columns.items() if name in words}
    return Table(path, numbers, texts, len(rows), first_row)


def check_columns(path: Path, header: Sequence[str], needed: Sequence[str]) -> None:
    """Raise InputError unless each needed column is there, and no column is repeated."""
    for column in dict.fromkeys([*needed, *header]):
        if header.count(column) != 1:
            found = f"{header.count(column) or 'none'} in {shown(','.join(header))}"
            raise InputError.at(f"{path}: row 1", f"one column {column}", found)


def numbers_of(path: Path, column: str, entries: Sequence[str], first_row: int = 2) -> Floats:
    """Entries of a column as numbers, (n_rows,), NaN for missing ones; InputError names row and column."""
    values = np.full(len(entries), np.nan)
    for k, entry in enumerate(entries):
        if entry not in MISSING:
            try:
                values[k] = float(entry)
            except ValueError:
                raise InputError.at(f"{path}: row {k + first_row}: {column}", "a number", shown(entry)) from None
    return values
