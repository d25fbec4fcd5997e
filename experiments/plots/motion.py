"""Plots of the target's coordinates over time, with bands of predicted standard deviations."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from experiments.arrays import Floats
from experiments.formats.estimate_rows import AXES
from experiments.pipeline.line import FILTER, OPEN_LOOP
from experiments.pipeline.track import Track, table
from experiments.plots.bands import STATUS_COLOURS, draw_bands
from experiments.plots.limits import body_box, mark_beyond, thinned, widened
from experiments.plots.style import OURS, PAPERS, TRUE

AROUND = 0.5
"""Margin of a plot around the body, relative to the body's size."""


def means_mm(done: Track, method: str) -> Floats:
    """Estimates of the target by a method [mm], (n_frames, dim)."""
    return 1e3 * np.array([e.mean for e in done.estimates(method)])


def sigma_mm(done: Track, axis: int) -> Floats:
    """Predicted standard deviations of the filter on an axis [mm], (n_frames,)."""
    return np.sqrt(table(done, FILTER)[AXES[axis] * 2].to_numpy())


def draw_motion(done: Track, ax: Axes, axis: int) -> None:
    """Draw a coordinate of the target: truth, open loop, and the filter with a band of two standard deviations."""
    low, high = usual_range(done, axis)
    ax.set_ylim(low, high)
    truth = 1e3 * done.truth[:, axis]
    ours, papers = means_mm(done, FILTER)[:, axis], means_mm(done, OPEN_LOOP)[:, axis]
    draw_over_time(done, ax, ours, papers, np.minimum(sigma_mm(done, axis), high - low), multiples=(2,))
    if np.isfinite(truth).any():
        ax.plot(*thinned(done.times_s, truth), color=TRUE, lw=0.5, label="truth")
    ax.set_ylabel(f"{AXES[axis]} [mm]")


def usual_range(done: Track, axis: int) -> tuple[float, float]:
    """Limits [mm] of an axis that shows the truth, the filter's path near the body, and the median 3-sigma band."""
    (low, high), places = 1e3 * widened(body_box(done), AROUND)[:, axis], means_mm(done, FILTER)[:, axis]
    truth = 1e3 * done.truth[:, axis]
    near = np.concatenate([places[(places >= low) & (places <= high)], truth[np.isfinite(truth)]])
    if not len(near):
        return float(low), float(high)
    sigmas = sigma_mm(done, axis)
    usual = float(np.median(sigmas[np.isfinite(sigmas)])) if np.isfinite(sigmas).any() else 0.0
    margin = 0.1 * float(np.ptp(near)) + min(3.0 * usual, float(high - low)) + 1e-3
    return float(near.min()) - margin, float(near.max()) + margin


def draw_over_time(
    done: Track, ax: Axes, ours: Floats, papers: Floats, sigma: Floats, *, multiples: tuple[int, ...]
) -> None:
    """Draw a coordinate over time by filter (`ours`) and open loop (`papers`), with bands of multiples of sigma.

    A single band is drawn about the filter's values, several bands are drawn about zero.
    """
    times = done.times_s
    at, spread = thinned(times, sigma)
    about = np.zeros(len(at)) if len(multiples) > 1 else np.interp(at, times, ours)
    label: str | None = f"{', '.join(str(m) for m in reversed(multiples))} predicted standard deviations"
    for k in multiples:
        ax.fill_between(at, about - k * spread, about + k * spread, color=OURS, alpha=0.17, lw=0, label=label)
        label = None  # drawn once for all multiples
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
