"""Zoo of bodies: accuracy of the filter, with the same settings, on bodies with different physics.

    python -m experiments.studies.zoo --out FOLDER                       # all bodies, seeds 1000 to 1019
    python -m experiments.studies.zoo --seeds 2 --first-seed 0 --bodies chain2,sheet --out FOLDER
    python -m experiments.studies.zoo --quick --out FOLDER               # three bodies, at most one second each

Runs use all cores or `--scheduler ADDRESS`. FOLDER gets runs/runs.parquet, runs.csv, cells.csv and table.md. The
extra `dev` installs MuJoCo, which computes the true motions. Latest figures: docs/zoo.md.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import gmean

from experiments.formats.outputs import write_whole
from experiments.formats.page import markdown_table
from experiments.simulation.bodies.zoo import BODIES
from experiments.studies.grid import chosen, command, kept_runs, publish, seeds_of, study_options
from experiments.studies.zoo.case import REPORT_SEEDS, Case, cases, quick_cases
from experiments.studies.zoo.run import record_of


@dataclass(frozen=True, slots=True)
class Bounds:
    """Largest permitted geometric mean of ratios, largest ratio of a row, and least and largest coverage of a row."""

    mean_ratio: float
    worst_ratio: float
    covered: tuple[float, float]


GOOD = Bounds(0.7, 1.05, (0.90, 0.99))
BOUNDS = {"true": GOOD, "identified": GOOD, "wrong": Bounds(0.9, 1.15, (0.85, 1.0))}


UNDECIDED = ("chain2", "chain3")
"""Bodies whose marks do not determine the hidden nodes; their coverage has no upper bound."""


FIGURES = ["error_m", "open_loop_m", "spline_m", "covered", "nees", "ms_a_frame"]
COUNTS = ["non_finite", "wrong_tracking", "repairs"]
"""A row of the results has the sums of these columns over its runs, and the means of the columns `FIGURES`."""


def cells_of(table: pd.DataFrame) -> pd.DataFrame:
    """A row for each body with one scale and one kind of constants; table: a row for each run, see `run.run`.

    runs: number of runs; failed: number of runs that ended early or did not start; failure: reason of the first failure
    filter_mm, open_loop_mm, spline_mm: mean errors over runs [mm]; NaN, like all means, if a run lacks the value
    ratio: the filter's error divided by the smaller error of open loop and spline
    covered: coverage of the 95 % region; nees: mean NEES per dimension; ms_a_frame: mean time per frame [ms]
    non_finite, wrong_tracking: sums over runs, see `hidden_scores`; repairs: number of numerical repairs in all runs
    """
    runs = table.reindex(columns=dict.fromkeys([*table, "failure", "ended", "frames_done", *FIGURES, *COUNTS]))
    reasons = runs[["failure", "ended"]].itertuples(index=False)
    runs["reason"] = [next((one for one in row if isinstance(one, str) and one), "") for row in reasons]
    runs["name"] = [Case.from_json(row).cell for row in table.to_dict("records")]
    cells = []
    for name, own in runs.groupby("name", sort=False):
        done, failed = own[own["frames_done"] > 0], own["reason"][own["reason"] != ""]
        means = done[FIGURES].astype(float).mean(skipna=False)
        filter_mm, open_loop_mm, spline_mm = 1e3 * means[:3]
        cells.append(
            {
                "name": name,
                "constants": own["constants"].iloc[0],
                "runs": len(own),
                "failed": len(failed),
                "failure": failed.iloc[0] if len(failed) else "",
                "filter_mm": filter_mm,
                "open_loop_mm": open_loop_mm,
                "spline_mm": spline_mm,
                "ratio": filter_mm / np.fmin(open_loop_mm, spline_mm),
                "covered": means["covered"],
                "nees": means["nees"],
                **done[COUNTS].sum().astype(int),
                "ms_a_frame": means["ms_a_frame"],
            }
        )
    return pd.DataFrame(cells)


def faults(cell: Any) -> list[str]:
    """Names of the bounds that a row of `cells_of` violates."""
    bounds = BOUNDS[cell.constants]
    low, high = bounds.covered[0], 1.0 if cell.name.startswith(UNDECIDED) else bounds.covered[1]
    found = [] if cell.failed == 0 else [f"{cell.failed} of {cell.runs} failed"]
    violated = {
        "ratio": not cell.ratio <= bounds.worst_ratio,
        "covered": not low <= cell.covered <= high,
        "non-finite": cell.non_finite > 0,
        "tracking": cell.wrong_tracking > 0,
    }
    return found + [name for name, is_so in violated.items() if is_so]


def summary(cells: pd.DataFrame) -> str:
    """A line in Markdown for each kind of constants: number of rows within `BOUNDS`, mean and largest `ratio`."""
    lines = []
    for constants, bounds in BOUNDS.items():
        own = cells[cells["constants"] == constants]
        if own.empty:
            continue
        kept = sum(not faults(cell) for cell in own.itertuples())
        text = f"{constants} constants: {kept} of {len(own)} cells within all bounds"
        rated = own.set_index("name")["ratio"]
        rated = rated[np.isfinite(rated)]
        if len(rated):
            text += (
                f"; ratio: geometric mean {gmean(rated):.2f} (bound {bounds.mean_ratio}),"
                f" worst {rated.max():.2f} (bound {bounds.worst_ratio}), {rated.idxmax()}"
            )
        lines.append(f"- {text}\n")
    return "".join(lines)


HEAD = ["cell", "runs", "filter [mm]", "open loop [mm]", "spline [mm]", "ratio", "coverage [%]", "NEES", "non-finite"]
HEAD += ["wrong tracking", "repairs", "ms per frame", "bounds exceeded"]


def markdown(cells: pd.DataFrame) -> str:
    """The table in Markdown, and the `summary` below it."""
    rows = []
    for cell in cells.itertuples():
        shown = (_number(cell.filter_mm), _number(cell.open_loop_mm), _number(cell.spline_mm), _number(cell.ratio, 2))
        counts = (str(cell.non_finite), str(cell.wrong_tracking), str(cell.repairs), _number(cell.ms_a_frame))
        fault = ", ".join(faults(cell)) + (f" ({cell.failure})" if cell.failure else "")
        rows.append((cell.name, str(cell.runs), *shown, _percent(cell.covered), _number(cell.nees, 2), *counts, fault))
    return f"{markdown_table(HEAD, rows)}\n{summary(cells)}"


PAGE_HEAD = ["body", "filter [mm]", "ratio", "coverage [%]", "scaled: largest ratio", "coverage [%]"]


def page_tables(cells: pd.DataFrame) -> str:
    """The table of docs/zoo.md with a row for each body, and the geometric means of the ratios below it."""
    body, kind = cells["name"].str.split(", ", expand=True).to_numpy().T
    rows = []
    for name, own in cells.groupby(body, sort=False):
        is_usual = kind[own.index] == own["constants"]
        usual, scaled = own[is_usual].set_index("constants"), own[~is_usual]
        usual = usual.loc[[one for one in BOUNDS if one in usual.index]]
        columns = (
            map(_number, usual["filter_mm"]),
            (_number(ratio, 2) for ratio in usual["ratio"]),
            map(_percent, usual["covered"]),
            [f"{scaled['ratio'].max():.2f}"] if scaled["ratio"].notna().any() else [],
            [f"{_percent(scaled['covered'].min())} to {_percent(scaled['covered'].max())}"]
            if scaled["covered"].notna().any()
            else [],
        )
        rows.append((str(name), *(", ".join(column) for column in columns)))
    ratios = cells[np.isfinite(cells["ratio"])].groupby("constants", sort=False)["ratio"]
    means = ", ".join(f"{kind} {gmean(own):.2f}" for kind, own in ratios)
    return f"{markdown_table(PAGE_HEAD, rows)}\nGeometric means of the ratios, by constants: {means}.\n"


def _percent(share: float) -> str:
    return "" if np.isnan(share) else f"{100 * share:.1f}"


def _number(value: float, digits: int = 3) -> str:
    return "" if np.isnan(value) else f"{value:.{digits}g}" if value < 1e4 else f"{value:.1e}"


@command
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the cases that the arguments choose; returns 1 if some of them failed."""
    parser = study_options(__doc__, page="zoo.md", seeds=(len(REPORT_SEEDS), REPORT_SEEDS[0]))
    parser.add_argument("--quick", action="store_true", help="run only a few seconds of three bodies")
    parser.add_argument("--bodies", default=",".join(BODIES), help="names of bodies, separated by commas")
    given = parser.parse_args(arguments)
    bodies = chosen("--bodies", given.bodies.split(","), BODIES)
    tables = [asdict(case) for case in (quick_cases() if given.quick else cases(bodies, seeds_of(given)))]
    done = kept_runs(record_of, tables, given.out / "runs", given)
    found = cells_of(done.table)
    write_whole(given.out / "runs.csv", done.table.to_csv(index=False))
    write_whole(given.out / "cells.csv", found.to_csv(index=False))
    publish(given, markdown(found), {"zoo table": page_tables(found)}, given.out / "table.md")
    for failure in done.failures:
        sys.stderr.write(f"{failure}\n")
    return 1 if done.failures else 0


if __name__ == "__main__":
    sys.exit(main())
