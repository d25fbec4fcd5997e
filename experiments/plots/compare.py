"""Plot of a comparison: observed and predicted errors of each method over time.

If the truth is unknown, the distance of a method's estimate from the filter's estimate replaces the observed error.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.arrays import Floats
from experiments.formats.estimate_rows import AXES
from experiments.pipeline.compare import methods_of
from experiments.pipeline.line import FILTER
from experiments.pipeline.track import Track, table
from experiments.plain import counted
from experiments.plots.series import body_size, highest, mark_beyond, thinned
from experiments.plots.style import BLACK, BLUE, PAGE_MM, grid_figure, legend_below, span, styled


@styled
def comparison_figure(done: Track) -> Figure:
    """Observed and predicted rms error of each method over time.

    The predicted error is the root of the covariance's trace. All methods have the same scale. Errors outside the plot
    are marked at its edge and counted. If the truth is unknown, the distance from the filter replaces the error.
    """
    methods = methods_of(done)
    figure, axes = grid_figure(PAGE_MM, 14.0 + 24.0 * len(methods), nrows=len(methods), sharex=True, sharey=True)
    off = {method: _off_mm(done, method) for method in methods}
    predicted = {method: _predicted_mm(done, method) for method in methods}
    top = highest(1e3 * body_size(done), *off.values(), *predicted.values())
    axes[0, 0].set_ylim(0.0, top)
    for ax, method in zip(axes[:, 0], methods, strict=True):
        _method(done, ax, method, off[method], predicted[method])
    axes[-1, 0].set_xlabel("time [s]")
    span(axes[-1, 0], done.times_s)
    # the filter has a predicted error and, if truth is known, an observed one
    fullest = int(np.argmax([len(ax.get_legend_handles_labels()[0]) for ax in axes[:, 0]]))
    shown = methods.index(FILTER) if done.has_truth else fullest
    legend_below(figure, axes[shown, 0], 2)
    return figure


def _off_mm(done: Track, method: str) -> Floats:
    """Error of a method in each frame [mm], (n,). If the truth is unknown: the distance from the filter's estimate."""
    about = done.truth if done.has_truth else np.array([e.mean for e in done.estimates(FILTER)])
    return np.asarray(1e3 * np.linalg.norm(np.array([e.mean for e in done.estimates(method)]) - about, axis=1))


def _predicted_mm(done: Track, method: str) -> Floats:
    """Root mean square error that a method predicts in each frame [mm], (n,); NaN without a prediction."""
    variances = [AXES[a] * 2 for a in range(done.recording.scene.network.dim)]
    return np.sqrt(table(done, method)[variances].sum(axis=1, skipna=False).to_numpy())


def _method(done: Track, ax: Axes, method: str, off: Floats, predicted: Floats) -> None:
    times, what = done.times_s, "error" if done.has_truth else "distance from the filter"
    if np.isfinite(predicted).any():
        at, sigma = thinned(times, predicted)
        ax.fill_between(at, 0.0, sigma, color=BLUE, alpha=0.25, lw=0, label="predicted rms error")
    title = method
    if done.has_truth or method != FILTER:
        ax.plot(*thinned(times, off), color=BLACK, lw=0.7, label=f"observed {what}" if done.has_truth else what)
        if np.isfinite(off).any():
            title += f": mean {what} {off[np.isfinite(off)].mean():.2f} mm"
        beyond = mark_beyond(ax, times, off, BLACK)
        title += f"; outside the plot in {counted(beyond, 'frame')}" if beyond else ""
    ax.set_title(title)
    ax.set_ylabel("[mm]")
