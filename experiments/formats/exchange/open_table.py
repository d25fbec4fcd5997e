"""CSV files with missing entries: columns of numbers, NaN for missing ones, and of text."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from experiments.arrays import Floats
from experiments.errors import InputError, shown
from experiments.formats.tables import Table

MISSING = ("", "nan", "NaN")
"""Entries that mean a missing number."""


def open_table(
    path: Path, header: Sequence[str], rows: Sequence[Sequence[str]], words: Collection[str], *, first_row: int = 2
) -> Table:
    """The table of these rows, each as long as the header, with unique names; all columns except `words` are numbers.

    Missing and infinite numbers are NaN. Raises InputError with row and column.
    """
    columns = dict(zip(header, zip(*rows, strict=True) if rows else [()] * len(header), strict=True))
    numbers = {name: _numbers(path, name, entries, first_row) for name, entries in columns.items() if name not in words}
    texts = {name: list(entries) for name, entries in columns.items() if name in words}
    return Table(path, numbers, texts, len(rows), first_row)


def _numbers(path: Path, column: str, entries: Sequence[str], first_row: int) -> Floats:
    values = np.full(len(entries), np.nan)
    for k, entry in enumerate(entries):
        if entry not in MISSING:
            try:
                values[k] = float(entry)
            except ValueError:
                raise InputError.at(f"{path}: row {k + first_row}: {column}", "a number", shown(entry)) from None
    values[np.isinf(values)] = np.nan
    return values
