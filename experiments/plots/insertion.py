"""Pictures of insertions: how often each policy hits, by how much it misses, and whether probabilities came true."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.simulation.insert import Trials, calibrated, figures
from experiments.simulation.policies import POLICIES

COLOURS = dict(zip(POLICIES, ("#9a9a9a", "#e07b16", "#9ecae1", "#1f6fb4", "#2e8b57"), strict=True))
N_LEAST = 5
"""Tenths with fewer insertions are not drawn."""


def write_insertion_plots(done: Trials, folder: Path) -> None:
    """Draw hits.png, misses.png and reliability.png into a folder that exists."""
    for name, drawn in (("hits", hits_figure), ("misses", misses_figure), ("reliability", reliability_figure)):
        drawn(done).savefig(folder / f"{name}.png", dpi=110)


def _axes(title: str, size: tuple[float, float] = (7.0, 4.2)) -> tuple[Figure, Axes]:
    with mpl.rc_context({"font.size": 10}):
        figure = Figure(figsize=size, layout="constrained")
        ax = figure.subplots()
    ax.spines[["top", "right"]].set_visible(False)
    ax.set_title(title, fontsize=11)
    return figure, ax


def hits_figure(done: Trials) -> Figure:
    """The hit rate of each policy with its 95 % interval."""
    figure, ax = _axes(f"hits in a lesion of {1e3 * done.case.plan.lesion.radius_m:g} mm radius, {len(done.runs)} runs")
    for k, policy in enumerate(POLICIES):
        of = figures(done.of(policy))
        rate, low, high = (100.0 * float(of[key] or 0.0) for key in ("hit_rate", "hit_rate_low", "hit_rate_high"))
        ax.bar(k, rate, color=COLOURS[policy], width=0.65)
        ax.errorbar(k, rate, [[rate - low], [high - rate]], color="black", capsize=4, lw=1.2)
        ax.text(k, high + 1.5, f"{rate:.1f} %", ha="center", va="bottom")
    ax.set_xticks(range(len(POLICIES)), POLICIES)
    ax.set(ylim=(0.0, 112.0), ylabel="hits [%]")
    ax.set_yticks(range(0, 101, 20))
    return figure


def misses_figure(done: Trials) -> Figure:
    """Which part of the runs came how near: needles that never arrived count as beyond every distance."""
    figure, ax = _axes("distance from the tip to the true target at arrival")
    for policy in POLICIES:
        of = done.of(policy)
        missed = np.sort([1e3 * one.miss_m for one in of if one.miss_m is not None])
        share = 100.0 * np.arange(1, len(missed) + 1) / len(of)
        ax.step(np.r_[0.0, missed], np.r_[0.0, share], where="post", color=COLOURS[policy], lw=1.6, label=policy)
    ax.axvline(1e3 * done.case.plan.lesion.radius_m, color="black", lw=0.8, ls="--")
    ax.set(xlim=(0.0, 20.0), ylim=(0.0, 101.0), xlabel="distance [mm]", ylabel="runs that came as near [%]")
    ax.legend(loc="lower right", frameon=False)
    return figure


def reliability_figure(done: Trials) -> Figure:
    """Hit rates against predicted probabilities, tenth by tenth, with 99 % intervals."""
    figure, ax = _axes("probabilities of filter-ahead at the commitment against hits", (5.5, 5.4))
    ax.plot([0, 1], [0, 1], color="0.6", lw=1.0)
    for row in calibrated(done):
        if row.mean is None or row.n < N_LEAST:
            continue
        rate = row.hits / row.n
        colour = "#1f6fb4" if row.inside else "#c0392b"
        spread = [[rate - row.least], [row.most - rate]]
        ax.errorbar(row.mean, rate, spread, fmt="o", color=colour, capsize=3, lw=1.2, ms=5)
        ax.annotate(str(row.n), (row.mean, row.most), (0, 3), textcoords="offset points", ha="center", fontsize=8)
    ax.set(xlim=(0.0, 1.0), ylim=(0.0, 1.1), xlabel="predicted probability of a hit", ylabel="hit rate")
    ax.set_yticks(np.linspace(0.0, 1.0, 6))
    ax.set_aspect("equal")
    return figure
