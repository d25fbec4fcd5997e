"""Plot of a comparison: the error of each method over time under the sigma that it predicts."""

from __future__ import annotations

from itertools import cycle
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from experiments.formats.estimate_rows import AXES
from experiments.pipeline.compare import method_names, methods_of
from experiments.pipeline.track import Track, table
from experiments.plots.limits import body_size, highest, mark_beyond, thinned

COLOURS = ("#e07b16", "#1f6fb4", "#8c564b", "#9467bd", "#2ca02c", "#d62728", "#17a2b8")


def write_comparison_plot(done: Track, folder: Path) -> None:
    """Draw compare.png into a folder that exists."""
    comparison_figure(done).savefig(folder / "compare.png", dpi=110)


def comparison_figure(done: Track) -> Figure:
    """Error of each method over time under what it predicted: the root of the trace of its covariance.

    All have one scale, of which a method that fails may leave the picture, marked at its edge.
    """
    with mpl.rc_context({"font.size": 9}):
        methods = methods_of(done)
        figure = Figure(figsize=(11, 1.6 * len(methods)), layout="constrained")
        axes = figure.subplots(len(methods), sharex=True, sharey=True)
    traces = [AXES[a] * 2 for a in range(done.recording.scene.network.dim)]
    colours = dict(zip(method_names(), cycle(COLOURS), strict=False))
    rows = {method: table(done, method) for method in methods}
    errors = {method: rows[method]["err_mm"].to_numpy() for method in methods}
    predicted = {method: np.sqrt(rows[method][traces].sum(axis=1, skipna=False).to_numpy()) for method in methods}
    times = done.times_s
    axes[0].set_ylim(0.0, highest(1e3 * body_size(done), *errors.values(), *predicted.values()))
    for ax, method in zip(axes, methods, strict=True):
        colour = colours[method]
        at, sigma = thinned(times, predicted[method])
        ax.fill_between(at, 0.0, sigma, color=colour, alpha=0.25, lw=0, label="predicted sigma")
        ax.plot(*thinned(times, errors[method]), color=colour, lw=0.9, label="error")
        mean = rows[method]["err_mm"].mean()
        title = method if np.isnan(mean) else f"{method}: mean error {mean:.2f} mm"
        beyond = mark_beyond(ax, times, errors[method], colour)
        ax.set_title(title + (f"; beyond the picture in {beyond} frames" if beyond else ""), loc="left")
        ax.set(ylabel="[mm]", xlim=(times[0], times[-1]))
        ax.spines[["top", "right"]].set_visible(False)
    axes[-1].set_xlabel("time [s]")
    figure.legend(*axes[1].get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False)
    return figure
