"""The zoo at a glance: how good the filter is in each cell, and whether its covariance holds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from experiments.studies.zoo.table import BOUNDS, Cell, faults

KEPT, BEYOND = "#2a7f3f", "#b5352c"
SHOWN = (0.03, 100.0)
"""Ratios beyond are drawn at the edge."""


def zoo_figure(cells: Sequence[Cell]) -> Figure:
    """A line a cell: error by that of the better rival, left of 1 the filter wins; share covered; time a frame."""
    figure = Figure(figsize=(12, 1.6 + 0.24 * len(cells)), layout="constrained")
    ratio, covered, cost = figure.subplots(1, 3, sharey=True, width_ratios=[2.2, 1.2, 1.0])
    places = np.arange(len(cells))
    for place, cell in zip(places, cells, strict=True):
        beyond = faults(cell)
        color = BEYOND if "ratio" in beyond else KEPT
        if cell.ratio is None:
            ratio.text(SHOWN[0] * 1.1, place, cell.failure[:60], va="center", fontsize=6, color=BEYOND)
            continue
        ratio.plot([1.0, np.clip(cell.ratio, *SHOWN)], [place, place], color=color, lw=1.0)
        ratio.plot(np.clip(cell.ratio, *SHOWN), place, "o" if cell.failed == 0 else "x", color=color, ms=5)
        if cell.covered is not None:
            color = BEYOND if "covered" in beyond else KEPT
            covered.plot(100 * cell.covered, place, "o", color=color, ms=5)
            low, high = BOUNDS[cell.constants].covered
            covered.plot([100 * low, 100 * high], [place, place], color="0.8", lw=6, solid_capstyle="butt", zorder=0)
        if cell.ms_a_frame is not None:
            cost.plot(cell.ms_a_frame, place, "o", color="0.4", ms=4)
    ratio.axvline(1.0, color="0.5", lw=0.8)
    ratio.set(xscale="log", xlim=SHOWN, xlabel="error by the better of open loop and spline", yticks=places)
    ratio.set_yticklabels([cell.name for cell in cells], fontsize=8)
    for label, cell in zip(ratio.get_yticklabels(), cells, strict=True):
        label.set_color(BEYOND if faults(cell) else KEPT)
    ratio.set_title("left of the line the filter wins", fontsize=9)
    ratio.set_ylim(len(cells) - 0.5, -0.5)
    covered.set(xlim=(-3, 103), xlabel="truth in the 95 % region [%]")
    covered.set_title("grey: what is asked", fontsize=9)
    cost.set(xscale="log", xlabel="ms a frame")
    for axes in (ratio, covered, cost):
        axes.grid(axis="y", lw=0.3)
    figure.suptitle(
        "The zoo of bodies: green within its bound, red beyond, a cross ended early; names in green keep every bound",
        fontsize=10,
    )
    return figure
