"""Overview of the zoo: accuracy of the filter in each cell, and coverage."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from experiments.plots.style import GREEN, GREY, PAGE_MM, SMALL_PT, VERMILLION, new_figure, styled
from experiments.studies.zoo.table import BOUNDS, Cell, faults

KEPT, BEYOND = GREEN, VERMILLION
KEPT_MARK, BEYOND_MARK, FAILED_MARK = "o", "D", "x"
"""Markers in addition to the colours, for prints without colour."""

SHOWN = (0.03, 100.0)
"""Range of the drawn ratios; others are drawn at the edge."""


@styled
def zoo_figure(cells: Sequence[Cell]) -> Figure:
    """A line for each cell: ratio of the error to that of the better reference; share covered; time per frame."""
    figure = new_figure(PAGE_MM, 26.0 + 4.0 * len(cells))
    ratio, covered, cost = figure.subplots(1, 3, sharey=True, width_ratios=[2.2, 1.2, 1.0])
    places = np.arange(len(cells))
    for place, cell in zip(places, cells, strict=True):
        beyond = faults(cell)
        color = BEYOND if "ratio" in beyond else KEPT
        if cell.ratio is None:
            ratio.text(SHOWN[0] * 1.1, place, cell.failure[:60], va="center", fontsize=SMALL_PT, color=BEYOND)
            continue
        ratio.plot([1.0, np.clip(cell.ratio, *SHOWN)], [place, place], color=color, lw=1.0)
        mark = BEYOND_MARK if "ratio" in beyond else KEPT_MARK
        ratio.plot(np.clip(cell.ratio, *SHOWN), place, mark if cell.failed == 0 else FAILED_MARK, color=color, ms=3)
        if cell.covered is not None:
            mark, color = (BEYOND_MARK, BEYOND) if "covered" in beyond else (KEPT_MARK, KEPT)
            covered.plot(100 * cell.covered, place, mark, color=color, ms=3)
            low, high = BOUNDS[cell.constants].covered
            covered.plot([100 * low, 100 * high], [place, place], color="0.85", lw=3.5, solid_capstyle="butt", zorder=0)
        if cell.ms_a_frame is not None:
            cost.plot(cell.ms_a_frame, place, "o", color=GREY, ms=2.5)
    ratio.axvline(1.0, color="0.5", lw=0.8)
    ratio.set(xscale="log", xlim=SHOWN, xlabel="error / better of open loop and spline [–]", yticks=places)
    ratio.set_yticklabels([cell.name for cell in cells], fontsize=SMALL_PT)
    for label, cell in zip(ratio.get_yticklabels(), cells, strict=True):
        label.set_color(BEYOND if faults(cell) else KEPT)
    ratio.set_title("left of the line the filter is better")
    ratio.set_ylim(len(cells) - 0.5, -0.5)
    covered.set(xlim=(-3, 103), xlabel="truth in the 95 % region [%]")
    covered.set_title("grey: the bound")
    cost.set(xscale="log", xlabel="time a frame [ms]")
    for axes in (ratio, covered, cost):
        axes.grid(axis="y", lw=0.3)
    figure.suptitle("discs: within the bound; diamonds: beyond; crosses: ended early; names in green keep every bound")
    return figure
