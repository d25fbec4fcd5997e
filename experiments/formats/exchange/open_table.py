"""CSV files whose entries may be missing: columns of numbers, NaN where there is none, and of words."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from experiments.arrays import Floats
from experiments.errors import InputError, shown

MISSING = ("", "nan", "NaN")
"""Entries that stand for no number."""


@dataclass(frozen=True, slots=True, eq=False)
class OpenTable:
    """Columns of a CSV file.

    columns: their names, in order
    numbers: by column, (n_rows,), NaN where there is none, and where it is infinite; words: by column, n_rows
    first_row: of the data, as an editor counts lines
    """

    path: Path
    columns: tuple[str, ...]
    numbers: dict[str, Floats]
    words: dict[str, list[str]]
    n_rows: int
    first_row: int

    def check(self, column: str, good: NDArray[np.bool_], expected: str) -> None:
        """Raise InputError for the first row that is not good, (n_rows,)."""
        if not good.all():
            row = int(np.argmin(good))
            found = self.words[column][row] if column in self.words else f"{self.numbers[column][row]:.15g}"
            place = f"{self.path}: row {row + self.first_row}: {column}"
            raise InputError.at(place, expected, shown(found) if column in self.words else found)


def open_table(
    path: Path, header: Sequence[str], rows: Sequence[Sequence[str]], words: Collection[str], *, first_row: int = 2
) -> OpenTable:
    """The table of these rows, each as long as the header, whose names differ; all columns but `words` are numbers.

    Raises InputError that names row and column.
    """
    columns = dict(zip(header, zip(*rows, strict=True) if rows else [()] * len(header), strict=True))
    return OpenTable(
        path,
        tuple(header),
        {name: _numbers(path, name, entries, first_row) for name, entries in columns.items() if name not in words},
        {name: list(entries) for name, entries in columns.items() if name in words},
        len(rows),
        first_row,
    )


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
