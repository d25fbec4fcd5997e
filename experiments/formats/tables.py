"""Reading of CSV files, with errors that name row and column, and writing of complete files.

Rows are counted like lines in an editor: the header is row 1.
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

from experiments.arrays import Floats
from experiments.errors import InputError, read_text, shown
from experiments.formats.outputs import write_whole

CHUNK_ROWS = 50_000
"""Number of rows that are held as text at a time; text takes ten times the memory of the numbers."""


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Columns of a CSV file.

    numbers: arrays, (n_rows,); only a table of `open_table` may have NaN; texts: lists of n_rows texts
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
    rejected: error messages, by name, for columns that files often have but that cannot be used
    torn: whether to omit an incomplete last line, as the writing program may have been killed
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
        for column in numbers:
            values = _numbers(columns[column])
            if values is None:
                raise _first_fault(path, chunk, header, numbers, n_rows + 2)
            parts[column].append(values)
        for column in texts:
            read_texts[column].extend(same.setdefault(entry, entry) for entry in columns[column])
        n_rows += len(chunk)
    return Table(path, {column: np.concatenate(arrays) for column, arrays in parts.items()}, read_texts, n_rows)


def read_rows(path: Path, expected: str, *, torn: bool = False) -> Iterator[list[str]]:
    """The header of a CSV file, then its rows, each with as many entries as the header; raises InputError.

    expected: text for the message on an empty file; torn: as in `read_table`
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
        if header.count(column) != 1:
            found = "none" if column not in header else str(header.count(column))
            raise InputError.at(f"{path}: row 1", f"one column {column}", f"{found} in {shown(','.join(header))}")
    for column in header:
        if column not in columns:
            raise InputError.at(f"{path}: row 1", f"only columns {', '.join(columns)}", f"also {shown(column)}")


def _numbers(entries: Sequence[str]) -> Floats | None:
    """The entries as numbers; None if any entry is not a finite number."""
    # Python also reads 1_000 and digits of other scripts as numbers; here they are errors
    whole = "".join(entries)
    if not whole.isascii() or "_" in whole:
        return None
    try:
        values = np.array([float(entry) for entry in entries])
    except ValueError:
        return None
    return values if np.isfinite(values).all() else None


def _number_text(value: float) -> str:
    """A number in its shortest form: 3 and not 3.0."""
    return str(int(value)) if abs(value) < 1e15 and value == int(value) else repr(float(value))


def _first_fault(
    path: Path, rows: list[list[str]], header: list[str], numbers: Sequence[str], first_row: int
) -> InputError:
    places = [(header.index(column), column) for column in numbers]
    row, column, entry = next(
        (row, column, entries[place])
        for row, entries in enumerate(rows, first_row)
        for place, column in places
        if _numbers([entries[place]]) is None
    )
    return InputError.at(f"{path}: row {row}: {column}", "a finite number", shown(entry) if entry.strip() else "none")


def write_table(path: Path, header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Write a CSV file, completely or not at all; raises InputError."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    write_whole(path, text.getvalue())
