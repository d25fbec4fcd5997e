"""CSV files read and written whole, with complaints that name the row and the column.

Rows are counted as an editor counts lines: the header is row 1.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from experiments.errors import InputError, read_text, shown
from experiments.outputs import write_whole

Floats = NDArray[np.float64]
CHUNK_ROWS = 50_000
"""Rows held as text at once; a million rows of text would take ten times the memory of their numbers."""


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Columns of a CSV file: numbers as arrays (n_rows,), all finite; texts as lists of n_rows."""

    path: Path
    numbers: dict[str, Floats]
    texts: dict[str, list[str]]
    n_rows: int

    def place(self, row: int, column: str) -> str:
        """Where the entry of this data row, counted from 0, stands in the file."""
        return f"{self.path}: row {row + 2}: {column}"

    def check(self, column: str, good: NDArray[np.bool_], expected: str) -> None:
        """Raise InputError for the first row that is not good, (n_rows,)."""
        if not good.all():
            row = int(np.argmin(good))
            raise InputError.at(self.place(row, column), expected, shown(self._entry(row, column)))

    def check_order(self, column: str, *, strictly: bool) -> None:
        """Raise InputError for the first row whose number falls behind the row before, or repeats it if strictly."""
        values = self.numbers[column]
        steps = np.diff(values)
        late = np.flatnonzero(steps <= 0 if strictly else steps < 0)
        if len(late):
            row = int(late[0]) + 1
            before, found = shown(float(values[row - 1])), shown(float(values[row]))
            expected = f"more than {before} (the row before)" if strictly else f"{before} (the row before) or more"
            raise InputError.at(self.place(row, column), expected, found)

    def _entry(self, row: int, column: str) -> str | float:
        return float(self.numbers[column][row]) if column in self.numbers else self.texts[column][row]


def read_table(
    path: Path,
    numbers: Sequence[str],
    texts: Sequence[str] = (),
    *,
    refused: Mapping[str, str] | None = None,
) -> Table:
    """The CSV file with exactly these columns, in any order; spaces after commas, empty lines at the end are let be.

    refused: what to say of columns that might be met and are not read, by name

    Raises InputError for anything else; for a number that is not finite too.
    """
    text = read_text(path)
    if not text.strip():
        raise InputError.at(path, f"columns {', '.join([*numbers, *texts])}", "an empty file")
    reader = csv.reader(io.StringIO(text, newline=""), skipinitialspace=True, strict=True)
    rows = _rows(path, reader)
    header = next(rows)
    _check_header(path, header, [*numbers, *texts], refused or {})
    parts: dict[str, list[Floats]] = {column: [np.empty(0)] for column in numbers}
    read_texts: dict[str, list[str]] = {column: [] for column in texts}
    same: dict[str, str] = {}
    n_rows = 0
    while chunk := list(islice(rows, CHUNK_ROWS)):
        columns = dict(zip(header, zip(*chunk, strict=True), strict=True))
        for column in numbers:
            parts[column].append(_numbers(f"{path}: row {{}}: {column}", columns[column], n_rows + 2))
        for column in texts:
            read_texts[column].extend(same.setdefault(entry, entry) for entry in columns[column])
        n_rows += len(chunk)
    return Table(path, {column: np.concatenate(arrays) for column, arrays in parts.items()}, read_texts, n_rows)


def _rows(path: Path, reader: Iterator[list[str]]) -> Iterator[list[str]]:
    """Rows of the file, header first, each as long as the header and on a line of its own."""
    row, width, blank = 0, 0, 0
    while True:
        row += 1
        try:
            entries = next(reader, None)
        except csv.Error as error:
            raise InputError.at(f"{path}: row {row}", "comma-separated values", str(error)) from None
        if entries is None:
            return
        if reader.line_num != row:  # type: ignore[attr-defined]
            raise InputError.at(f"{path}: row {row}", "a row on one line", "a line break in quotes")
        if not any(entries):
            blank = blank or row
            continue
        width = width or len(entries)
        if blank:
            raise InputError.at(f"{path}: row {blank}", f"{width} values", "an empty line")
        if len(entries) != width:
            raise InputError.at(f"{path}: row {row}", f"{width} values", str(len(entries)))
        yield entries


def _check_header(path: Path, header: list[str], columns: list[str], refused: Mapping[str, str]) -> None:
    for column in header:
        if column in refused:
            raise InputError(f"{path}: {column}: {refused[column]}")
    for column in columns:
        if header.count(column) != 1:
            found = "none" if column not in header else str(header.count(column))
            raise InputError.at(f"{path}: row 1", f"one column {column}", f"{found} in {shown(','.join(header))}")
    for column in header:
        if column not in columns:
            raise InputError.at(f"{path}: row 1", f"columns {', '.join(columns)}", f"column {shown(column)} too")


def _numbers(place: str, entries: Sequence[str], first_row: int) -> Floats:
    try:
        values = np.array([float(entry) for entry in entries])
    except ValueError:
        values = None
    # Python reads 1_000 and digits of other scripts as numbers; a file that has them was not meant so
    whole = "".join(entries)
    if values is not None and np.isfinite(values).all() and whole.isascii() and "_" not in whole:
        return values
    for row, entry in enumerate(entries, first_row):
        if not _is_number(entry):
            raise InputError.at(place.format(row), "a finite number", shown(entry) if entry.strip() else "none")
    raise AssertionError(f"{place}: every entry is a number, but not all of them together")


def _is_number(entry: str) -> bool:
    try:
        return bool(np.isfinite(float(entry))) and entry.isascii() and "_" not in entry
    except ValueError:
        return False


def write_table(path: Path, header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Write a CSV file, whole or not at all; raises InputError."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    write_whole(path, text.getvalue())
