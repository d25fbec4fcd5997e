"""A study applies one function to many cases. Runs are stored as they finish; an interrupted study can be continued.

The folder of a study has three entries. `runs.parquet` is the table of results, in the order of the cases. Its columns
come from the case, from the result and from the engine (OWN). `failures/` has a file for each failed run. `kept/` has
the results of all runs that were done in this folder, in several files.
"""

from __future__ import annotations

import io
import json
import math
import secrets
import shlex
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from experiments.engine.executor import RunsFailedError, finished
from experiments.engine.runs import Case, Run, Work, importable, key_of, name_of, program
from experiments.engine.workers import Workers
from experiments.extras import require
from experiments.formats.outputs import write_whole

if TYPE_CHECKING:
    import pyarrow as pa

KEPT = "kept"
"""Name of the subfolder of a study's folder with the results of all runs; each of its files is called a part."""

KEEP_S, KEEP_SHARE = 2.0, 0.005
"""The time between two new files in `kept/` is at least KEEP_S [s], and at least KEEP_SHARE [1] times the time since
the start; choice: about a thousand files per day."""


class Parts:
    """Collects results of runs as rows of a table. From time to time it writes them to a new file, called a part.

    rows: rows that are not yet written
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.rows: list[Mapping[str, Any]] = []
        self.began = self.written = time.monotonic()

    def add(self, rows: Sequence[Mapping[str, Any]]) -> None:
        """Add the rows of a run. If the last part is old enough, write all collected rows to a new part."""
        self.rows.extend(rows)
        now = time.monotonic()
        if now - self.written >= max(KEEP_S, KEEP_SHARE * (now - self.began)):
            self.write()

    def write(self) -> None:
        """Write the collected rows, if there are any, to a new file."""
        if self.rows:
            self.folder.mkdir(parents=True, exist_ok=True)
            write_whole(self.folder / f"{secrets.token_hex(8)}.parquet", parquet(table_of(self.rows)))
        self.rows, self.written = [], time.monotonic()


def table_of(rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    """The rows as a table with the columns of all rows; missing values are null."""
    import pyarrow as pa

    columns = dict.fromkeys(name for row in rows for name in row)
    try:
        return pa.table({name: [row.get(name) for row in rows] for name in columns})
    except pa.ArrowException as error:
        raise TypeError(f"results of runs: expected one kind of value in a column: {error}") from error


def parquet(table: pa.Table) -> bytes:
    """The table as the bytes of a Parquet file."""
    import pyarrow.parquet as pq

    buffer = io.BytesIO()
    pq.write_table(table, buffer, compression="zstd")
    return buffer.getvalue()


def read_parts(folder: Path) -> pa.Table | None:
    """The rows of all files in a folder; None if there are no files. Integers in a column of floats become floats."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    parts = [pq.read_table(path) for path in sorted(folder.glob("*.parquet"))]
    return pa.concat_tables(parts, promote_options="permissive") if parts else None


RUNS = "runs.parquet"
FAILURES = "failures"
OWN = ("seconds", "failure", "command", "program", "key")
"""Columns that the engine adds: the run's duration, its failure, the command that repeats the run, the digest of the
program, and the run's key."""


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """The runs of a study.

    table: content of runs.parquet
    n_runs: number of all runs; n_done: number of runs that this call of `run_study` did
    failures: a line for each failed run, with the command that repeats it
    """

    table: pd.DataFrame
    n_runs: int
    n_done: int
    failures: tuple[str, ...]

    def checked(self) -> pd.DataFrame:
        """The table. Raises RunsFailedError if a run failed."""
        if self.failures:
            n = len(self.failures)
            raise RunsFailedError(f"{n} of {self.n_runs} runs failed; the others are kept. First: {self.failures[0]}")
        return self.table


def run_study(
    work: Work,
    cases: Sequence[Case],
    folder: str | Path,
    workers: Workers,
    advance: Callable[[float], None] = lambda _share: None,
) -> Study:
    """Do each run that has no successful result in the folder, and write the folder's table.

    work: function of a case; it returns a row of the table as a mapping, or a list of rows
        with numbers, texts, booleans and lists of numbers
    cases: mappings of JSON types, no two of them equal; their top-level numbers and texts become columns
    advance: called with the completed share

    Raises InputError for a missing extra or scheduler, and ValueError for two equal cases.
    """
    require("studies", "cluster")
    folder = Path(folder)
    shared = importable(work)
    keys = [key_of(shared, case) for case in cases]
    if len(set(keys)) < len(keys):
        again = next(case for k, case in enumerate(cases) if keys[k] in keys[:k])
        raise ValueError(f"cases: expected different ones, found {again} twice")
    known = read_parts(folder / KEPT)
    kept = [] if known is None else zip(*_columns(known, "key", "failure"), strict=True)
    done = {key for key, failure in kept if failure is None}
    left = [k for k, key in enumerate(keys) if key not in done]
    parts, source = Parts(folder / KEPT), program()
    n_done = len(keys) - len(left)
    advance(n_done / max(1, len(keys)))
    try:
        for run in finished(partial(rows_of, work=shared), [cases[k] for k in left], workers):
            k = left[run.index]
            command = _noted(run, cases[k], keys[k], folder, name_of(shared))
            own = {"seconds": None if math.isnan(run.seconds) else run.seconds, "failure": run.failure}
            own |= {"command": command, "program": source, "key": keys[k]}
            parts.add([{**columns_of(cases[k]), **row, **own} for row in run.result or [{}]])
            n_done += 1
            advance(n_done / len(keys))
    finally:
        parts.write()
    table = _in_order(read_parts(folder / KEPT), keys)
    write_whole(folder / RUNS, parquet(table))
    frame = table.to_pandas()
    if len(frame) and set(frame.get("program", [""])) != {source}:
        sys.stderr.write(f"{folder}: it has runs of another state of the program; use a new folder\n")
    failed = frame[frame["failure"].notna()] if len(frame) else frame
    lines = [f"{row.failure}; repeat: {row.command}" for row in failed.itertuples()]
    return Study(frame, len(keys), len(left), tuple(lines))


def rows_of(case: Case, work: Work) -> list[dict[str, Any]]:
    """The rows of a run. Raises ValueError if there are none, or if a column's name is a key of the case or in OWN."""
    result = work(case)
    rows = [dict(row) for row in ([result] if isinstance(result, Mapping) else result)]
    if not rows:
        raise ValueError("result: expected one or more rows, found none")
    taken = {*columns_of(case), *OWN}
    for name in (name for row in rows for name in row):
        if name in taken:
            raise ValueError(f"result: expected columns other than the case's keys, found {name}")
    return rows


def columns_of(case: Case) -> dict[str, Any]:
    """The top-level numbers and texts of a case."""
    return {name: value for name, value in case.items() if isinstance(value, str | int | float)}


def _columns(table: pa.Table, *names: str) -> list[list[Any]]:
    return [table.column(name).to_pylist() for name in names]


def _noted(run: Run, case: Case, key: str, folder: Path, name: str) -> str | None:
    """Write a failed run's record, and return the command that repeats the run. After a success, delete the record."""
    path = folder / FAILURES / f"{key}.json"
    if run.failure is None:
        path.unlink(missing_ok=True)
        return None
    path.parent.mkdir(parents=True, exist_ok=True)
    record = {"work": name, "case": case, "failure": run.failure, "trace": run.trace.splitlines()}
    write_whole(path, json.dumps(record, indent=1, ensure_ascii=False) + "\n")
    return f"python -m experiments.engine {shlex.quote(str(path))}"


def _in_order(kept: pa.Table | None, keys: Sequence[str]) -> pa.Table:
    """The rows of the runs with these keys, in the order of the keys.

    If a run was done several times, only one of its results is used: a successful one if possible.
    The rows of a run must be contiguous.
    """
    if kept is None:
        return table_of([])
    rows: dict[str, list[int]] = {}
    good: set[str] = set()
    before = None
    for place, (key, failure) in enumerate(zip(*_columns(kept, "key", "failure"), strict=True)):
        if key == before and (failure is None) == (key in good) and failure is None:
            rows[key].append(place)
        elif key not in good:
            rows[key] = [place]
            if failure is None:
                good.add(key)
        before = key
    table = kept.take([place for key in keys for place in rows.get(key, [])])
    names = [name for name in table.column_names if name not in OWN]
    return table.select([*names, *(name for name in OWN if name in table.column_names)])
