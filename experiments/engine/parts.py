"""Storage of rows in several Parquet files while a study runs; if it is killed, only the last seconds are lost."""

from __future__ import annotations

import io
import secrets
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.formats.outputs import write_whole

if TYPE_CHECKING:
    import pyarrow as pa

KEPT = "kept"
"""Name of the subfolder of a study's folder in which these files, the parts, are stored."""

KEEP_S, KEEP_SHARE = 2.0, 0.005
"""Least time between the writing of two parts [s]; least ratio of this time to the time since the start [1]; choice:
about a thousand parts per day."""


class Parts:
    """Collects rows and writes them as parts.

    rows: rows not yet written; began, written: time of the start, time at which the last part was written [s]
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.rows: list[Mapping[str, Any]] = []
        self.began = self.written = time.monotonic()

    def add(self, rows: Sequence[Mapping[str, Any]]) -> None:
        """Add the rows of a run; write them if the last part is old enough."""
        self.rows.extend(rows)
        now = time.monotonic()
        if now - self.written >= max(KEEP_S, KEEP_SHARE * (now - self.began)):
            self.write()

    def write(self) -> None:
        """Write the waiting rows, if there are any."""
        if self.rows:
            self.folder.mkdir(parents=True, exist_ok=True)
            write_whole(self.folder / f"{secrets.token_hex(8)}.parquet", parquet(table_of(self.rows)))
        self.rows, self.written = [], time.monotonic()


def table_of(rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    """Rows as a table; columns are in the order in which they first appear, missing values are null."""
    import pyarrow as pa

    columns = dict.fromkeys(name for row in rows for name in row)
    try:
        return pa.table({name: [row.get(name) for row in rows] for name in columns})
    except pa.ArrowException as error:
        raise TypeError(f"results of runs: expected one kind of value in a column: {error}") from error


def parquet(table: pa.Table) -> bytes:
    """The content of a Parquet file."""
    import pyarrow.parquet as pq

    buffer = io.BytesIO()
    pq.write_table(table, buffer, compression="zstd")
    return buffer.getvalue()


def read_parts(folder: Path) -> pa.Table | None:
    """The rows of all parts; None if there are no parts. Columns of integers become floats if any part has floats."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    parts = [pq.read_table(path) for path in sorted(folder.glob("*.parquet"))]
    return pa.concat_tables(parts, promote_options="permissive") if parts else None
