"""Output folders of `softaim track`, read as pandas DataFrames."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from estimators import Status
from experiments.errors import InputError, read_text, shown
from experiments.formats.exchange.results import ESTIMATES, FLAGS
from experiments.formats.tables import Table, read_open
from vision import FilePath

OPEN_LOOP, MARKS, SUMMARY = "estimates.open-loop.csv", "marks.csv", "summary.json"
TIME = "time_s"


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """Output of `softaim track` for a recording. The index of each table is the exposure time `time_s` [s].

    estimates: a row for each frame, columns as in estimates.csv: positions in mm, covariances in mm², NaN for missing
        numbers
    open_loop: estimates of the open-loop simulation of [paper]; None without estimates.open-loop.csv
    marks: a row for each mark, columns as in marks.csv; None without that file
    summary: content of summary.json, by method; empty without that file
    """

    estimates: pd.DataFrame
    open_loop: pd.DataFrame | None
    marks: pd.DataFrame | None
    summary: dict[str, Any]


def read_result(folder: FilePath) -> Result:
    """Read the tables and the summary in an output folder of `softaim track`; raises InputError.

    Folders of `softaim live`, which have no summary, can also be read.
    """
    place = Path(folder)
    if not place.is_dir():
        raise InputError.at(place, f"a folder with {ESTIMATES}", "a file" if place.exists() else "none")
    open_loop, marks, figures = place / OPEN_LOOP, place / MARKS, place / SUMMARY
    return Result(
        _estimates(place / ESTIMATES),
        _estimates(open_loop) if open_loop.exists() else None,
        _frame(*read_open(marks, [TIME, "node", "x_mm", "y_mm"], ["node"])) if marks.exists() else None,
        _figures(figures) if figures.exists() else {},
    )


def _estimates(path: Path) -> pd.DataFrame:
    """A table of estimates with columns of text, booleans, integers and numbers."""
    needed = [TIME, "status", "x_mm", "y_mm", "marks_used", "model_only"]
    table, header = read_open(path, needed, ["status", "model_only"])
    used = table.numbers["marks_used"]
    table.check("status", np.isin(table.texts["status"], list(Status)), f"one of {', '.join(Status)}")
    table.check("model_only", np.isin(table.texts["model_only"], list(FLAGS)), " or ".join(FLAGS))
    table.check("marks_used", np.isfinite(used) & (used == np.round(used)), "a whole number")
    frame = _frame(table, header)
    return frame.assign(model_only=frame["model_only"] == "True").astype({"marks_used": np.int64})


def _frame(table: Table, header: Sequence[str]) -> pd.DataFrame:
    columns = table.texts | table.numbers
    return pd.DataFrame({name: columns[name] for name in header}).set_index(TIME)


def _figures(path: Path) -> dict[str, Any]:
    try:
        found = json.loads(read_text(path))
    except json.JSONDecodeError as error:
        raise InputError.at(f"{path}: line {error.lineno}", "JSON", error.msg) from None
    if not isinstance(found, dict):
        raise InputError.at(path, "a JSON object", shown(found))
    return found
