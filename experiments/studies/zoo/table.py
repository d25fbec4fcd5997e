"""Figures of each cell of the zoo, required bounds, and tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import gmean

from experiments.formats.page import markdown_table
from experiments.studies.zoo.case import Case


@dataclass(frozen=True, slots=True)
class Cell:
    """Figures of a body with one scale and one kind of constants over its seeds; errors are means over runs [mm].

    runs, failed: number of runs, and of runs that ended early or did not start; failure: why the first of them failed
    ratio: the filter's error divided by the smaller error of open loop and spline; None without estimates
    covered: coverage of the 95 % region; nees: mean NEES per dimension
    non_finite, wrong_tracking, repairs: sums over runs, see `hidden_scores`; ms_a_frame: mean time per frame [ms]
    """

    name: str
    constants: str
    runs: int
    failed: int
    failure: str
    filter_mm: float | None
    open_loop_mm: float | None
    spline_mm: float | None
    ratio: float | None
    covered: float | None
    nees: float | None
    non_finite: int
    wrong_tracking: int
    repairs: int
    ms_a_frame: float | None


@dataclass(frozen=True, slots=True)
class Bounds:
    """Required bounds: on the geometric mean of ratios, on the largest ratio, and on the coverage (least, largest)."""

    mean_ratio: float
    worst_ratio: float
    covered: tuple[float, float]


GOOD = Bounds(0.7, 1.05, (0.90, 0.99))
BOUNDS = {"true": GOOD, "identified": GOOD, "wrong": Bounds(0.9, 1.15, (0.85, 1.0))}


UNDECIDED = ("chain2", "chain3")
"""Bodies whose marks do not determine the hidden nodes; their coverage has no upper bound."""


def cells_of(table: pd.DataFrame) -> list[Cell]:
    """Figures of each cell; table: a row for each run with its case, its figures, and its failure."""
    by_name: dict[str, list[Mapping[str, Any]]] = {}
    for row in table.to_dict("records"):
        record = {
            str(key): None if isinstance(value, float) and np.isnan(value) else value for key, value in row.items()
        }
        by_name.setdefault(Case.from_json(record).cell, []).append(record)
    return [_cell(name, runs) for name, runs in by_name.items()]


def _cell(name: str, runs: Sequence[Mapping[str, Any]]) -> Cell:
    failures = [reason for run in runs if (reason := run.get("failure") or run.get("ended"))]
    done = [run for run in runs if run.get("frames_done")]

    def mean(key: str, factor: float = 1.0) -> float | None:
        values = [value for run in done if (value := run.get(key)) is not None]
        return factor * float(np.mean(values)) if values and len(values) == len(done) else None

    filter_mm, loop_mm, spline_mm = (mean(key, 1e3) for key in ("error_m", "open_loop_m", "spline_m"))
    references = [mm for mm in (loop_mm, spline_mm) if mm is not None]
    return Cell(
        name=name,
        constants=runs[0]["constants"],
        runs=len(runs),
        failed=len(failures),
        failure=failures[0] if failures else "",
        filter_mm=filter_mm,
        open_loop_mm=loop_mm,
        spline_mm=spline_mm,
        ratio=None if filter_mm is None or not references else filter_mm / min(references),
        covered=mean("covered"),
        nees=mean("nees"),
        **{key: int(sum(run[key] for run in done)) for key in ("non_finite", "wrong_tracking", "repairs")},
        ms_a_frame=mean("ms_a_frame"),
    )


def faults(cell: Cell) -> list[str]:
    """Names of the bounds that the cell violates."""
    bounds = BOUNDS[cell.constants]
    low, high = bounds.covered[0], 1.0 if cell.name.startswith(UNDECIDED) else bounds.covered[1]
    found = [] if cell.failed == 0 else [f"{cell.failed} of {cell.runs} failed"]
    if cell.ratio is None or not cell.ratio <= bounds.worst_ratio:
        found.append("ratio")
    if cell.covered is None or not low <= cell.covered <= high:
        found.append("covered")
    if cell.non_finite:
        found.append("non-finite")
    if cell.wrong_tracking:
        found.append("tracking")
    return found


def summary(cells: Sequence[Cell]) -> str:
    """List in Markdown: for each kind of constants the number of cells within all bounds, and the ratios."""
    lines = []
    ordered = sorted(cells, key=lambda cell: list(BOUNDS).index(cell.constants))
    for constants, group in groupby(ordered, key=lambda cell: cell.constants):
        own = list(group)
        rated = [(cell.ratio, cell.name) for cell in own if cell.ratio is not None and np.isfinite(cell.ratio)]
        kept = sum(not faults(cell) for cell in own)
        bounds = BOUNDS[constants]
        text = f"{constants} constants: {kept} of {len(own)} cells within all bounds"
        if rated:
            worst, name = max(rated)
            text += (
                f"; ratio: geometric mean {gmean([ratio for ratio, _ in rated]):.2f} (bound {bounds.mean_ratio}),"
                f" worst {worst:.2f} (bound {bounds.worst_ratio}), {name}"
            )
        lines.append(f"- {text}\n")
    return "".join(lines)


HEAD = ["cell", "runs", "filter [mm]", "open loop [mm]", "spline [mm]", "ratio", "coverage [%]", "NEES", "non-finite"]
HEAD += ["wrong tracking", "repairs", "ms per frame", "bounds exceeded"]


def markdown(cells: Sequence[Cell]) -> str:
    """The table, and the summary below it."""
    rows = []
    for cell in cells:
        shown = (_number(cell.filter_mm), _number(cell.open_loop_mm), _number(cell.spline_mm), _number(cell.ratio, 2))
        covered = _percent(cell.covered)
        counts = (str(cell.non_finite), str(cell.wrong_tracking), str(cell.repairs), _number(cell.ms_a_frame))
        fault = ", ".join(faults(cell)) + (f" ({cell.failure})" if cell.failure else "")
        rows.append((cell.name, str(cell.runs), *shown, covered, _number(cell.nees, 2), *counts, fault))
    return f"{markdown_table(HEAD, rows)}\n{summary(cells)}"


PAGE_HEAD = ["body", "filter [mm]", "ratio", "coverage [%]", "scaled: largest ratio", "coverage [%]"]


def page_tables(cells: Sequence[Cell]) -> str:
    """The table of docs/zoo.md with a row for each body, and the summary below it."""
    bodies: dict[str, tuple[dict[str, Cell], list[Cell]]] = {}
    for cell in cells:
        body, kind = cell.name.split(", ")
        usual, scaled = bodies.setdefault(body, ({}, []))
        if kind == cell.constants:
            usual[kind] = cell
        else:
            scaled.append(cell)
    rows = []
    for body, (usual, scaled) in bodies.items():
        own = [usual[kind] for kind in BOUNDS if kind in usual]
        ratios = [cell.ratio for cell in scaled if cell.ratio is not None]
        shares = [cell.covered for cell in scaled if cell.covered is not None]
        columns = (
            [_number(cell.filter_mm) for cell in own],
            [_number(cell.ratio, 2) for cell in own],
            [_percent(cell.covered) for cell in own],
            [f"{max(ratios):.2f}"] if ratios else [],
            [f"{_percent(min(shares))} to {_percent(max(shares))}"] if shares else [],
        )
        rows.append((body, *(", ".join(column) for column in columns)))
    return f"{markdown_table(PAGE_HEAD, rows)}\n{summary(cells)}"


def _percent(share: float | None) -> str:
    return "" if share is None else f"{100 * share:.1f}"


def _number(value: float | None, digits: int = 3) -> str:
    return "" if value is None else f"{value:.{digits}g}" if value < 1e4 else f"{value:.1e}"
