"""Dense landmarks of breathing lungs: deep landmarks are estimated from marks near the surface.

    python -m experiments.studies.dense_lungs FOLDER --out DIR    # --page writes the table to docs/zoo.md

FOLDER has a table for each person with the columns `landmark,x0_mm,y0_mm,z0_mm,x1_mm,y1_mm,z1_mm`: first positions at
the end of inhaling, then positions at the end of exhaling. The page uses data of [fu2019], which are not part of the
repository. DIR gets summary.json, rows.csv and table.md. Latest figures: docs/zoo.md.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from estimators import coverage, normalised_error_squared
from experiments.errors import InputError
from experiments.formats.outputs import output_folder, write_whole
from experiments.formats.page import markdown_table
from experiments.studies.dense_lungs.methods import METHODS, SCATTER_M, WHERE, Lung, Task, read_lungs
from experiments.studies.grid import command, grid, publish, runs_of, study_options
from experiments.studies.lungs import STRAND_N

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


def table_of(runs: pd.DataFrame) -> pd.DataFrame:
    """A row for each method with each place of the marks and each number of marks.

    mae_mm: mean error [mm], NaN if the method failed in a lung
    coverage95: coverage of the 95 % region, NaN also for methods without a covariance; n: number of hidden landmarks
    """
    rows = []
    for (where, marks, method), own in runs.groupby(["where", "marks", "method"], sort=False):
        covered = np.nan if own["nees"].isna().any() else coverage(own["nees"].to_numpy(), 3)
        figures = {"mae_mm": own["error_mm"].mean(skipna=False), "coverage95": covered, "n": len(own)}
        rows.append({"where": where, "marks": int(marks), "method": method, **figures})
    return pd.DataFrame(rows)


def nested(table: pd.DataFrame) -> list[dict[str, Any]]:
    """The table for summary.json: a row for each place and number of marks, with the figures of all methods."""
    rows = []
    for (where, marks), own in table.groupby(["where", "marks"], sort=False):
        figures = own.set_index("method")[["mae_mm", "coverage95", "n"]].to_json(orient="index", double_precision=15)
        rows.append({"where": where, "marks": int(marks), "methods": json.loads(figures)})
    return rows


def markdown(table: pd.DataFrame) -> str:
    """The table of docs/zoo.md."""
    heads = ("marks per lung", *(f"{word} [mm]" for word in WORDS.values()), "filter covered", "field covered")
    entries = []
    for (where, marks), own in table.groupby(["where", "marks"], sort=False):
        found = own.set_index("method")
        errors = [_number(found["mae_mm"][name], "{:.2f}") for name in WORDS]
        covered = [_number(found["coverage95"][name], "{:.1%}") for name in ("filter", "field")]
        entries.append((f"{marks}, {where}", *errors, *covered))
    return markdown_table(heads, entries)


def _number(value: float, form: str) -> str:
    return "" if np.isnan(value) else form.format(value)


def run(job: tuple[Lung, str, int, float]) -> pd.DataFrame:
    """Run all methods; job: lung, place of the marks (one of `WHERE`), number of marks, `Task.strand_n` [N].

    Returns a row for each method and each hidden landmark: the error, the NEES, and if the method failed, the reason.
    Methods without a covariance have no NEES.
    """
    lung, where, n, strand_n = job
    task = Task(lung, lung.marks(n, where), strand_n)
    truth = lung.exhaled[lung.hidden]
    parts = []
    for name, method in METHODS.items():
        part = {"method": np.full(len(truth), name), "error_mm": np.nan, "nees": np.nan, "failure": ""}
        try:
            found = method(task)
            part["error_mm"] = 1e3 * np.linalg.norm(found.means - truth, axis=1)
            if found.covs is not None:  # the true position has an error, too
                read = found.covs + SCATTER_M**2 * np.eye(3)
                part["nees"] = normalised_error_squared(found.means - truth, read)
        except Exception as error:  # any exception that a method raises is a result of the study
            part["failure"] = f"{type(error).__name__}: {error}"
        parts.append(pd.DataFrame(part))
    return pd.concat(parts).assign(lung=lung.name, where=where, marks=n)


@command
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study on a folder of tables, and write the results; returns 1 if a method failed."""
    parser = study_options(__doc__, out=False, page="zoo.md")
    parser.add_argument("folder", type=Path, help="folder of landmark tables, one for each person")
    parser.add_argument("--out", type=Path, required=True, help="output folder, new or empty")
    parser.add_argument("--stiffness-factor", type=float, default=1.0, help="factor on all stiffnesses: %(default)s")
    given = parser.parse_args(arguments)
    factor = given.stiffness_factor
    if not 0.0 < factor < np.inf:
        raise InputError.at("--stiffness-factor", "a finite number above 0", f"{factor:g}")
    with output_folder(given.out, inputs=[given.folder]) as folder:
        lungs = read_lungs(given.folder)
        cases = grid(where=WHERE, marks=COUNTS, lung=lungs)
        jobs = [(case["lung"], case["where"], case["marks"], factor * STRAND_N) for case in cases]
        runs = pd.concat(runs_of(run, jobs, given))
        table = table_of(runs)
        page = markdown(table)
        content = {"stiffness_factor": factor, "lungs": [lung.name for lung in lungs], "rows": nested(table)}
        write_whole(folder / "summary.json", json.dumps(content, indent=2) + "\n")
        write_whole(folder / "rows.csv", table.to_csv(index=False))
        write_whole(folder / "table.md", page)
    publish(given, page, {"dense lungs table": page})
    failed = runs[runs["failure"] != ""][["lung", "marks", "where", "method", "failure"]].drop_duplicates()
    for lung, marks, where, method, why in failed.itertuples(index=False):
        sys.stderr.write(f"{lung}, {marks} marks, {where}: {method}: {why}\n")
    return 1 if len(failed) else 0


if __name__ == "__main__":
    sys.exit(main())
