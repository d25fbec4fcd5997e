"""Reading of CSV files, with errors that name row and column, and writing of complete files.

Rows are counted like lines in an editor: the header is row 1.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from experiments.arrays import Floats
from experiments.errors import InputError, read_text, shown
from experiments.formats.outputs import write_whole

CHUNK_ROWS = 50_000
"""Number of rows that are held as text at a time; text takes ten times the memory of the numbers."""


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Columns of a CSV file.

    numbers: columns of numbers, (n_rows,), with NaN for missing numbers
    texts: columns of texts
    first_row: line number of the first data row in the file
    """

    path: Path
    numbers: dict[str, Floats]
    texts: dict[str, list[str]]
    n_rows: int
    first_row: int = 2

    def place(self, row: int, column: str) -> str:
        """Position of an entry in the file, for a message; row: index of the data row."""
        return f"{self.path}: row {row + self.first_row}: {column}"

    def check(self, column: str, good: NDArray[np.bool_], expected: str) -> None:
        """Raise InputError for the first row for which `good`, (n_rows,), is false."""
        if not good.all():
            row = int(np.argmin(good))
            own = self.numbers.get(column)
            entry = shown(self.texts[column][row]) if own is None else _number_text(own[row])
            raise InputError.at(self.place(row, column), expected, entry)

    def check_each(self, column: str, expected: Floats) -> None:
        """Raise InputError for the first row whose number differs from the number in `expected`, (n_rows,)."""
        good = self.numbers[column] == expected
        if not good.all():
            self.check(column, good, _number_text(expected[np.argmin(good)]))

    def check_order(self, column: str, *, strictly: bool, groups: NDArray[np.int64] | None = None) -> None:
        """Raise InputError for the first number that is less than the number in the row before.

        strictly: whether equal numbers are faults, too
        groups: group of each row, (n_rows,); if stated, each row is compared with the row before in its group
        """
        groups = np.zeros(self.n_rows, dtype=np.int64) if groups is None else groups
        order = np.argsort(groups, kind="stable")
        values = self.numbers[column]
        steps = np.diff(values[order])
        late = np.flatnonzero((np.diff(groups[order]) == 0) & (steps <= 0 if strictly else steps < 0))
        if len(late):
            pair = late[np.argmin(order[late + 1])]
            before, row = int(order[pair]), int(order[pair + 1])
            least = f"{_number_text(values[before])} ({'the row before' if before == row - 1 else f'row {before + 2}'})"
            expected = f"more than {least}" if strictly else f"{least} or more"
            raise InputError.at(self.place(row, column), expected, _number_text(values[row]))


def read_table(
    path: Path,
    numbers: Sequence[str],
    texts: Sequence[str] = (),
    *,
    rejected: Mapping[str, str] | None = None,
    torn: bool = False,
) -> Table:
    """Read a CSV file with exactly these columns, in any order; raises InputError.

    Numbers must be finite. Spaces after commas and empty last lines are permitted.
    rejected: by column name, the error message for a column that files often have but that cannot be used
    torn: whether to omit an incomplete last line; a program that is killed may leave such a line
    """
    rows = read_rows(path, f"columns {', '.join([*numbers, *texts])}", torn=torn)
    header = next(rows)
    _check_header(path, header, [*numbers, *texts], rejected or {})
    parts: dict[str, list[Floats]] = {column: [np.empty(0)] for column in numbers}
    read_texts: dict[str, list[str]] = {column: [] for column in texts}
    same: dict[str, str] = {}
    n_rows = 0
    while chunk := list(islice(rows, CHUNK_ROWS)):
        columns = dict(zip(header, zip(*chunk, strict=True), strict=True))
        values = {column: _numbers(columns[column]) for column in numbers}
        faults = [(int(np.argmin(good)), c) for c in numbers if not (good := np.isfinite(values[c])).all()]
        if faults:
            row, column = min(faults, key=lambda fault: fault[0])
            entry = columns[column][row]
            found = shown(entry) if entry.strip() else "none"
            raise InputError.at(f"{path}: row {n_rows + row + 2}: {column}", "a finite number", found)
        for column in numbers:
            parts[column].append(values[column])
        for column in texts:
            read_texts[column].extend(same.setdefault(entry, entry) for entry in columns[column])
        n_rows += len(chunk)
    return Table(path, {column: np.concatenate(arrays) for column, arrays in parts.items()}, read_texts, n_rows)


def read_open(path: Path, needed: Sequence[str], words: Collection[str]) -> tuple[Table, list[str]]:
    """The table in a file of results, and the names of its columns in order; raises InputError.

    An incomplete last line, as after a killed run, is omitted.
    needed: columns that must exist, among them time_s
    words: columns of text; all other columns are numbers, NaN if missing
    """
    header, *rows = read_rows(path, f"columns {', '.join(needed)}", torn=True)
    for column in dict.fromkeys([*needed, *header]):
        _check_once(path, header, column)
    table = open_table(path, header, rows, words)
    table.check("time_s", np.isfinite(table.numbers["time_s"]), "a finite number")
    return table, header


def open_table(
    path: Path, header: Sequence[str], rows: Sequence[Sequence[str]], words: Collection[str], *, first_row: int = 2
) -> Table:
    """The table of rows that are as long as the header. Columns in `words` are texts, all others are numbers.

    Missing numbers are NaN. Raises InputError with row and column if an entry is not a number.
    """
    columns = dict(zip(header, zip(*rows, strict=True) if rows else [()] * len(header), strict=True))
    numbers = {name: _numbers(entries) for name, entries in columns.items() if name not in words}
    for column, values in numbers.items():
        for row in np.flatnonzero(np.isnan(values)):
            if (entry := columns[column][row]).lower() not in ("", "nan"):
                raise InputError.at(f"{path}: row {row + first_row}: {column}", "a number", shown(entry))
    texts = {name: list(entries) for name, entries in columns.items() if name in words}
    return Table(path, numbers, texts, len(rows), first_row)


def read_rows(path: Path, expected: str, *, torn: bool = False) -> Iterator[list[str]]:
    """The header of a CSV file, then its rows, each with as many entries as the header; raises InputError.

    expected: what the message for an empty file expects; torn: as in `read_table`
    """
    text = read_text(path)
    if torn:
        text = text[: text.rfind("\n") + 1]
    reader = csv.reader(io.StringIO(text, newline=""), skipinitialspace=True, strict=True)
    row, width, blank = 0, 0, 0
    while True:
        row += 1
        try:
            entries = next(reader, None)
        except csv.Error as error:
            raise InputError.at(f"{path}: row {row}", "comma-separated values", str(error)) from None
        if entries is None:
            if not width:
                raise InputError.at(path, expected, "an empty file")
            return
        if reader.line_num != row:
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


def _check_header(path: Path, header: list[str], columns: list[str], rejected: Mapping[str, str]) -> None:
    for column in header:
        if column in rejected:
            raise InputError(f"{path}: {column}: {rejected[column]}")
    for column in columns:
        _check_once(path, header, column)
    for column in header:
        if column not in columns:
            raise InputError.at(f"{path}: row 1", f"only columns {', '.join(columns)}", f"also {shown(column)}")


def _check_once(path: Path, header: Sequence[str], column: str) -> None:
    if header.count(column) != 1:
        found = f"{header.count(column) or 'none'} in {shown(','.join(header))}"
        raise InputError.at(f"{path}: row 1", f"one column {column}", found)


def _numbers(entries: Sequence[str]) -> Floats:
    """The entries as numbers; NaN for an entry that is not a number."""

    def number(entry: str) -> float:
        # Python also reads 1_000 and digits of other scripts as numbers; here they are errors
        try:
            return float(entry) if entry.isascii() and "_" not in entry else np.nan
        except ValueError:
            return np.nan

    return np.array([number(entry) for entry in entries], dtype=float)


def _number_text(value: float) -> str:
    """A number in its shortest form: 3 and not 3.0."""
    return str(int(value)) if abs(value) < 1e15 and value == int(value) else repr(float(value))


def write_table(path: Path, header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Write a CSV file, completely or not at all; raises InputError."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    write_whole(path, text.getvalue())
