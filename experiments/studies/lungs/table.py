"""The table of the lungs: mean errors at the end of exhaling and in all phases, and shares covered."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd
from matplotlib.figure import Figure

from estimators import coverage
from experiments.plots.style import GREY, OURS, PAGE_MM, VERMILLION, grid_figure, legend_below, styled
from experiments.studies.lungs.estimate import SEEN, Inner

HEAD = (
    "seen of each lung",
    "nothing done [mm]",
    "thin-plate spline [mm]",
    "filter [mm]",
    "covered",
    "spline, all phases [mm]",
    "filter, all phases [mm]",
    "covered, all phases",
)


def markdown(errors: pd.DataFrame, found: Sequence[Inner]) -> str:
    """The table of `errors_table`, and below it the lungs that the filter could not do."""
    rows = [HEAD, ("---", *("---:" for _ in HEAD[1:]))]
    for seen in SEEN:
        own = errors[errors["seen"] == seen]
        last = own[own["phase"] == own["phase"].max()]
        rows.append(
            (
                seen,
                _mean(last, "nothing_mm"),
                _mean(last, "spline_mm"),
                _mean(last, "filter_mm"),
                _covered(last),
                _mean(own, "spline_mm"),
                _mean(own, "filter_mm"),
                _covered(own),
            )
        )
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    reasons: dict[str, list[str]] = {}
    for one in found:
        if one.failure:
            reasons.setdefault(one.failure, []).append(f"{one.lung} ({one.seen})")
    lines += ["", *(f"- filter, {len(own)} of {len(found)} runs: {reason}" for reason, own in reasons.items())]
    return "\n".join(lines).rstrip() + "\n"


def _complete(table: pd.DataFrame, column: str) -> bool:
    return column in table and bool(table[column].notna().all())


def _mean(table: pd.DataFrame, column: str) -> str:
    """Mean of the column; nothing where any of it is missing, for other landmarks would be another table."""
    return f"{table[column].mean():.2f}" if _complete(table, column) else ""


def _covered(table: pd.DataFrame) -> str:
    return f"{100 * coverage(table['nees'].to_numpy(), 3):.1f} %" if _complete(table, "nees") else ""


@styled
def lungs_figure(errors: pd.DataFrame) -> Figure:
    """Mean error of the inner landmarks through the breath, a panel for each number of seen ones."""
    figure, grid = grid_figure(PAGE_MM, 62.0, ncols=len(SEEN), sharey=True)
    lines = {"nothing_mm": ("nothing done", GREY, "s"), "spline_mm": ("thin-plate spline", VERMILLION, "^")}
    lines |= {"filter_mm": ("filter", OURS, "o")}
    for axes, seen in zip(grid[0], SEEN, strict=True):
        own = errors[errors["seen"] == seen]
        for column, (label, color, mark) in lines.items():
            if _complete(own, column):
                means = own.groupby("phase")[column].mean()
                axes.plot([0, *means.index], [0.0, *means], mark, ls="-", color=color, label=label)
        axes.set(title=f"seen of each lung: {seen}", xlabel="phase, 0 inhaled, last exhaled [–]")
        axes.grid(lw=0.3)
    figure.axes[0].set_ylabel("mean error of landmarks inside [mm]")
    legend_below(figure, figure.axes[0], 3)
    return figure
