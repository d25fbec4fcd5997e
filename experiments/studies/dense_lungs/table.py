"""The table of dense lungs: mean errors of each method in each row, shares covered, and their picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from estimators import coverage
from experiments.arrays import Floats
from experiments.plots.style import BLACK, GREEN, GREY, OURS, PAGE_MM, PAPERS, PURPLE, grid_figure, legend_below, styled
from experiments.studies.dense_lungs.data import WHERE
from experiments.studies.grid import markdown_table

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
"""Methods in words."""

COLORS = {"filter": OURS, "thin_plate": BLACK, "linear": GREEN, "field": PURPLE, "open_loop": PAPERS}
"""Colours of the lines in the picture."""

BOUNDS = (0.90, 0.98)
"""Bounds for the share covered in a row of the filter [1]."""


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """One lung with this number of marks: by method errors [m], (n_hidden,), and NEES if a covariance is stated."""

    lung: str
    where: str
    marks: int
    errors: Mapping[str, Floats]
    nees: Mapping[str, Floats]
    failures: Mapping[str, str]


def summary(runs: Sequence[Run]) -> list[dict[str, Any]]:
    """A table for each row of marks: by method `mae_mm`, `coverage95` or None, `n`; None for a method that failed."""
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
    """One line for each row and method."""
    return pd.DataFrame(
        [
            {"where": row["where"], "marks": row["marks"], "method": name, **figures}
            for row in rows
            for name, figures in row["methods"].items()
        ]
    )


def markdown(rows: Sequence[Mapping[str, Any]]) -> str:
    """The table of a page."""
    heads = ("marks a lung", *(f"{word} [mm]" for word in WORDS.values()), "filter covered", "field covered")
    entries = []
    for row in rows:
        found = row["methods"]
        errors = [_number(found[name]["mae_mm"], "{:.2f}") for name in WORDS]
        covered = [_number(found[name]["coverage95"], "{:.1%}") for name in ("filter", "field")]
        entries.append((f"{row['marks']}, {row['where']}", *errors, *covered))
    return markdown_table(heads, entries)


def _number(value: float | None, form: str) -> str:
    return "" if value is None else form.format(value)


@styled
def picture(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Errors by number of marks, all round and on the front; below them the share covered."""
    figure, axes = grid_figure(PAGE_MM, 90.0, nrows=2, ncols=2, sharex=True, sharey="row", height_ratios=[2.0, 1.0])
    for column, where in enumerate(WHERE):
        own = [row for row in rows if row["where"] == where]
        error, covered = axes[:, column]
        for name, color in COLORS.items():
            figures = [row["methods"][name] for row in own]
            style = {"color": color, "marker": "o", "label": WORDS[name], "ls": "--" if name == "open_loop" else "-"}
            error.plot(COUNTS, [_or_nan(one["mae_mm"]) for one in figures], **style)
            shares = [100 * _or_nan(one["coverage95"]) for one in figures]
            if np.isfinite(shares).any():
                covered.plot(COUNTS, shares, **style)
        covered.axhspan(100 * BOUNDS[0], 100 * BOUNDS[1], color="0.9", zorder=0)
        error.set(
            xscale="log", title={"all": "marks all round", "front": "marks on one half, y above the median"}[where]
        )
        covered.set(xlabel="marks a lung", xticks=COUNTS, xticklabels=[str(n) for n in COUNTS], ylim=(80, 100))
        covered.minorticks_off()
        error.minorticks_off()
        for ax in (error, covered):
            ax.grid(axis="y", lw=0.3, color=GREY)
    axes[0, 0].set(ylabel="mean error [mm]", ylim=(0.0, None))
    axes[1, 0].set(ylabel="covered [%]")
    legend_below(figure, axes[0, 0], len(COLORS))
    return figure


def _or_nan(value: float | None) -> float:
    return float("nan") if value is None else value
