"""The pictures of a track: path of the target, error or motion over time, and consistency of the covariance.

The limits are those of the body (`limits.py`); estimates outside are marked at the edge and counted.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.arrays import Floats
from experiments.formats.estimate_rows import AXES
from experiments.pipeline.line import FILTER, OPEN_LOOP
from experiments.pipeline.track import Track, table
from experiments.plots.bands import STATUS_COLOURS, draw_bands
from experiments.plots.consistency import consistency_figure, has_innovations, has_sigmas, sigma_figure, withheld_figure
from experiments.plots.limits import body_box, body_size, highest, mark_beyond, thinned, widened
from experiments.plots.path import AROUND, path_figure
from experiments.plots.style import OURS, PAGE_MM, PAPERS, TRUE, grid_figure, legend_below, span, styled, write_picture

ERROR_TITLE, MOTION_TITLE = "error of the hidden target", "the hidden target"


def write_track_plots(
    done: Track, folder: Path, vector: str | None = None, *, advance: Callable[[float], None] = lambda _share: None
) -> list[Path]:
    """Draw the plots of a track into an existing folder; returns the files written.

    path.png; with truth error.png and sigma.png, without it motion.png in their place; consistency.png where marks were
    taken in; withheld.png where marks were predicted as if hidden. vector: "pdf" or "svg" for a vector file beside
    each; advance: is called with the share done
    """
    pictures = {"path": path_figure(done)}
    if done.has_truth:
        pictures["error"] = error_figure(done)
        if has_sigmas(done):
            pictures["sigma"] = sigma_figure(done)
    else:
        pictures["motion"] = motion_figure(done)
    if has_innovations(done):
        pictures["consistency"] = consistency_figure(done)
    if done.withheld:
        pictures["withheld"] = withheld_figure(done.withheld)
    written: list[Path] = []
    for k, (name, figure) in enumerate(pictures.items(), start=1):
        written += write_picture(figure, folder / f"{name}.png", vector)
        advance(k / len(pictures))
    return written


@styled
def error_figure(done: Track) -> Figure:
    """Error of each axis over time within its 1, 2 and 3-sigma envelope."""
    size = 1e3 * body_size(done)
    errors, papers = (_means_mm(done, method) - 1e3 * done.truth for method in (FILTER, OPEN_LOOP))
    figure, axes = _an_axis_each(done)
    for a, ax in enumerate(axes):
        sigma = _sigma_mm(done, a)
        top = highest(size, 3.0 * sigma, errors[:, a], papers[:, a])
        ax.set_ylim(-top, top)
        _over_time(done, ax, errors[:, a], papers[:, a], np.minimum(sigma, top), multiples=(3, 2, 1))
        ax.axhline(0.0, color=TRUE, lw=0.4)
        ax.set_ylabel(f"{AXES[a]} error [mm]")
    axes[0].set_title(ERROR_TITLE)
    legend_below(figure, axes[0], 6)
    return figure


@styled
def motion_figure(done: Track) -> Figure:
    """The target on each axis over time: the filter with a band of two sigma, and the open loop."""
    means, papers = _means_mm(done, FILTER), _means_mm(done, OPEN_LOOP)
    figure, axes = _an_axis_each(done)
    for a, ax in enumerate(axes):
        sigma = _sigma_mm(done, a)
        low, high = _usual_range(done, a)
        ax.set_ylim(low, high)
        _over_time(done, ax, means[:, a], papers[:, a], np.minimum(sigma, high - low), multiples=(2,))
        ax.set_ylabel(f"{AXES[a]} [mm]")
    axes[0].set_title(MOTION_TITLE)
    legend_below(figure, axes[0], 6)
    return figure


def _an_axis_each(done: Track) -> tuple[Figure, list[Axes]]:
    dim = done.recording.scene.network.dim
    figure, grid = grid_figure(PAGE_MM, 12.0 + 40.0 * dim, nrows=dim, sharex=True)
    grid[-1, 0].set_xlabel("time [s]")
    span(grid[-1, 0], done.times_s)
    return figure, list(grid[:, 0])


def _usual_range(done: Track, axis: int) -> tuple[float, float]:
    """Limits [mm] of an axis that shows the filter's path near the body, and its usual sigmas."""
    (low, high), places = 1e3 * widened(body_box(done), AROUND)[:, axis], _means_mm(done, FILTER)[:, axis]
    near = places[(places >= low) & (places <= high)]
    if not len(near):
        return float(low), float(high)
    sigmas = _sigma_mm(done, axis)
    usual = float(np.median(sigmas[np.isfinite(sigmas)])) if np.isfinite(sigmas).any() else 0.0
    margin = 0.1 * float(np.ptp(near)) + min(3.0 * usual, float(high - low)) + 1e-3
    return float(near.min()) - margin, float(near.max()) + margin


def _means_mm(done: Track, method: str) -> Floats:
    return 1e3 * np.array([e.mean for e in done.estimates(method)])


def _sigma_mm(done: Track, axis: int) -> Floats:
    return np.sqrt(table(done, FILTER)[AXES[axis] * 2].to_numpy())


def _over_time(
    done: Track, ax: Axes, ours: Floats, papers: Floats, sigma: Floats, *, multiples: tuple[int, ...]
) -> None:
    """A coordinate of the filter and the open loop, with bands of multiples of sigma about the filter's."""
    times = done.times_s
    at, spread = thinned(times, sigma)
    about = np.zeros(len(at)) if len(multiples) > 1 else np.interp(at, times, ours)
    label: str | None = f"{', '.join(str(m) for m in reversed(multiples))} predicted standard deviations"
    for k in multiples:
        ax.fill_between(at, about - k * spread, about + k * spread, color=OURS, alpha=0.17, lw=0, label=label)
        label = None  # once for all
    draw_bands(ax, times, [e.status for e in done.estimates(FILTER)], STATUS_COLOURS)
    ax.plot(*thinned(times, papers), color=PAPERS, lw=0.5, alpha=0.8, label="paper's open loop")
    ax.plot(*thinned(times, ours), color=OURS, lw=0.8, label="filter")
    gone = {
        name: n
        for name, values, colour in (("filter", ours, OURS), ("open loop", papers, PAPERS))
        if (n := mark_beyond(ax, times, values, colour))
    }
    if gone:
        text = ", ".join(f"{name} {n}" for name, n in gone.items())
        ax.set_title(f"outside the plot: {text} of {len(times)} frames", loc="right")
