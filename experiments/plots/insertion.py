"""Plots of insertions: hit rates and misses of each policy, and predicted against observed hits."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from estimators import ReliabilityBin
from experiments.plots.style import (
    BLACK,
    BLUE,
    COLUMN_MM,
    GREEN,
    GREY,
    ORANGE,
    SKY,
    SMALL_PT,
    VERMILLION,
    grid_figure,
    legend_below,
    styled,
    write_picture,
)
from experiments.simulation.advised import bins
from experiments.simulation.insert import Trials, calibrated, figures
from experiments.simulation.policies import POLICIES

COLOURS = dict(zip(POLICIES, (GREY, ORANGE, SKY, BLUE, GREEN), strict=True))
DASHES = dict(zip(POLICIES, ((0, (1, 1)), (0, (5, 1, 1, 1)), (0, (3, 1)), "solid", "solid"), strict=True))
"""Line styles that, in addition to colours, distinguish lines that cross."""

WIDTHS = dict(zip(POLICIES, (1.1, 1.1, 2.8, 2.0, 0.9), strict=True))
"""Widths of lines [pt]. The last three lines often coincide, so each of them is narrower than the line below it."""

N_LEAST = 5
"""Least number of insertions in a drawn bin; the plot states how many insertions other bins have."""

FARTHEST_MM = 20.0
"""Largest miss that is drawn [mm]; the plot states the number of larger misses."""


def write_insertion_plots(done: Trials, folder: Path, vector: str | None = None) -> None:
    """Draw hits.png, misses.png, reliability.png and advised.png into a folder.

    If all bins of reliability.png or advised.png have fewer than `N_LEAST` insertions, this plot is omitted.
    vector: "pdf" or "svg" for a vector file of each plot
    """
    pictures = {"hits": hits_figure(done), "misses": misses_figure(done)}
    for name, (rows, title) in reliabilities(done).items():
        if any(row.n >= N_LEAST for row in rows):
            pictures[name] = reliability_figure(rows, title)
    for name, figure in pictures.items():
        write_picture(figure, folder / f"{name}.png", vector)


def reliabilities(done: Trials) -> dict[str, tuple[Sequence[ReliabilityBin], str]]:
    """Bins and title of each `reliability_figure`, by the name of its file; see `calibrated` and `bins`."""
    return {
        "reliability": (calibrated(done), "filter-ahead at the commitment, in ten bins"),
        "advised": (bins(done.advised), "advice at any time, in ten bins"),
    }


@styled
def hits_figure(done: Trials) -> Figure:
    """The hit rate of each policy with its 95 % interval."""
    figure, [[ax]] = grid_figure(COLUMN_MM, 58.0)
    ax.set_title(f"hits in a lesion of {1e3 * done.case.plan.lesion.radius_m:g} mm radius, {len(done.runs)} runs")
    for k, policy in enumerate(POLICIES):
        of = figures(done.of(policy))
        rate, low, high = (100.0 * float(of[key] or 0.0) for key in ("hit_rate", "hit_rate_low", "hit_rate_high"))
        ax.bar(k, rate, color=COLOURS[policy], width=0.65)
        label = "95 % interval" if k == 0 else None
        ax.errorbar(k, rate, [[rate - low], [high - rate]], color=BLACK, capsize=3, lw=0.9, label=label)
        ax.text(k, high + 1.5, f"{rate:.1f} %", ha="center", va="bottom", fontsize=SMALL_PT)
    ax.set_xticks(range(len(POLICIES)), POLICIES)
    ax.set(ylim=(0.0, 112.0), xlabel="policy", ylabel="hits [%]")
    ax.set_yticks(range(0, 101, 20))
    legend_below(figure, ax, 1)
    return figure


@styled
def misses_figure(done: Trials) -> Figure:
    """Cumulative distribution of the miss distance, which is infinite for needles that never arrived."""
    figure, [[ax]] = grid_figure(COLUMN_MM, 70.0)
    ax.set_title("distance to the true target at arrival")
    for policy in POLICIES:
        of = done.of(policy)
        missed = np.sort([1e3 * one.miss_m for one in of if one.miss_m is not None])
        share = 100.0 * np.arange(1, len(missed) + 1) / len(of)
        n_out = int((missed > FARTHEST_MM).sum())
        label = policy + (f" ({n_out} farther)" if n_out else "")
        near = missed <= FARTHEST_MM
        x, y = np.r_[0.0, missed[near], FARTHEST_MM], np.r_[0.0, share[near]]
        style = {"color": COLOURS[policy], "ls": DASHES[policy], "lw": WIDTHS[policy]}
        ax.step(x, np.r_[y, y[-1]], where="post", label=label, **style)
    most = max((1e3 * one.miss_m for run in done.runs for one in run if one.miss_m is not None), default=0.0)
    radius = 1e3 * done.case.plan.lesion.radius_m
    ax.axvline(radius, color=BLACK, lw=0.6, ls=(0, (4, 2)), label=f"radius of the lesion, {radius:g} mm")
    ax.set(xlim=(0.0, min(FARTHEST_MM, 1.2 * max(radius, most))), ylim=(0.0, 101.0))
    ax.set(xlabel="distance [mm]", ylabel="runs within this distance [%]")
    legend_below(figure, ax, 2)
    return figure


@styled
def reliability_figure(rows: Sequence[ReliabilityBin], title: str) -> Figure:
    """Plot of the observed hit rate against the predicted hit probability, in ten bins, with 99 % intervals."""
    figure, [[ax]] = grid_figure(COLUMN_MM, COLUMN_MM + 8.0)
    ax.set_title(title)
    ax.plot([0, 1], [0, 1], color="0.6", lw=0.8, label="as predicted")
    left_out, labelled = 0, set()
    for row in rows:
        if row.mean is None or row.n < N_LEAST:
            left_out += row.n
            continue
        rate = row.hits / row.n
        colour, marker = (BLUE, "o") if row.inside else (VERMILLION, "s")
        name = f"99 % interval {'contains' if row.inside else 'excludes'} the prediction"
        spread = [[rate - row.least], [row.most - rate]]
        label = None if name in labelled else name
        labelled.add(name)
        ax.errorbar(
            row.mean, rate, spread, fmt=marker, color=colour, capsize=2, lw=0.9, ms=3.5, label=label, clip_on=False
        )
        above = (row.mean, row.most)
        ax.annotate(str(row.n), above, (0, 2), textcoords="offset points", ha="center", fontsize=SMALL_PT)
    if left_out:
        note = f"{left_out} in bins of fewer than {N_LEAST} left out"
        ax.text(0.98, 0.02, note, ha="right", va="bottom", fontsize=SMALL_PT, transform=ax.transAxes)
    ax.set(xlim=(0.0, 1.0), ylim=(0.0, 1.1), yticks=np.linspace(0.0, 1.0, 6), aspect="equal")
    ax.set(xlabel="predicted probability of a hit [–]", ylabel="observed hit rate [–]")
    legend_below(figure, ax, 1)
    return figure
