"""Table of the dense lungs: mean error and coverage of each method for each place and number of marks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from estimators import coverage
from experiments.arrays import Floats
from experiments.formats.page import markdown_table
from experiments.studies.dense_lungs.data import WHERE

COUNTS = (10, 20, 40, 80)
"""Numbers of marks per lung."""

WORDS = {
    "filter": "filter",
    "thin_plate": "thin-plate spline",
    "linear": "linear radial basis",
    "field": "Matern field",
    "open_loop": "open loop",
    "none": "no motion",
}
"""Descriptions of the methods, by name."""


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """Results for a lung and a set of marks, by method.

    errors: errors of hidden landmarks [m], (n_hidden,); nees: NEES of methods with a covariance, (n_hidden,)
    failures: reasons of methods that failed
    """

    lung: str
    where: str
    marks: int
    errors: Mapping[str, Floats]
    nees: Mapping[str, Floats]
    failures: Mapping[str, str]


def summary(runs: Sequence[Run]) -> list[dict[str, Any]]:
    """A row for each place and number of marks, with figures by method; missing figures are None."""
    rows = []
    for where in WHERE:
        for marks in COUNTS:
            own = [run for run in runs if (run.where, run.marks) == (where, marks)]
            rows.append({"where": where, "marks": marks, "methods": {name: _figures(own, name) for name in WORDS}})
    return rows


def _figures(runs: Sequence[Run], method: str) -> dict[str, Any]:
    n = sum(len(next(iter(run.errors.values()))) for run in runs)
    if any(method in run.failures for run in runs):
        return {"mae_mm": None, "coverage95": None, "n": n}
    errors = np.concatenate([run.errors[method] for run in runs])
    nees = [run.nees[method] for run in runs if method in run.nees]
    covered = coverage(np.concatenate(nees), 3) if nees else None
    return {"mae_mm": 1e3 * float(errors.mean()), "coverage95": covered, "n": n}


def flat(rows: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """Table with a line for each row and method."""
    return pd.DataFrame(
        [
            {"where": row["where"], "marks": row["marks"], "method": name, **figures}
            for row in rows
            for name, figures in row["methods"].items()
        ]
    )


def markdown(rows: Sequence[Mapping[str, Any]]) -> str:
    """The table of docs/zoo.md."""
    heads = ("marks per lung", *(f"{word} [mm]" for word in WORDS.values()), "filter covered", "field covered")
    entries = []
    for row in rows:
        found = row["methods"]
        errors = [_number(found[name]["mae_mm"], "{:.2f}") for name in WORDS]
        covered = [_number(found[name]["coverage95"], "{:.1%}") for name in ("filter", "field")]
        entries.append((f"{row['marks']}, {row['where']}", *errors, *covered))
    return markdown_table(heads, entries)


def _number(value: float | None, form: str) -> str:
    return "" if value is None else form.format(value)
