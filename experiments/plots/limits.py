"""Limits of plots from the body and its measurements, so that diverging estimates do not stretch the axes.

Values outside a plot are marked at its edge; long recordings are thinned to the number of points that a plot can show.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from experiments.arrays import Floats
from experiments.pipeline.track import Track

N_DRAWN = 4000
"""Largest number of points in a line, about three for each pixel of a plot's width."""

N_CARETS = 400
"""Largest number of carets on an edge: more would merge."""

OUTLIERS = 0.01
"""Share of marks at either end of an axis that may be outliers and are not used for the body's box."""

USUAL, FAR = 0.99, 10.0
"""Quantile of a series up to which an axis shows it, and largest value shown, relative to the series' median [1]."""


def body_box(done: Track) -> Floats:
    """Lowest and highest corner of a box around the network, the marks and the truth [m], (2, dim)."""
    corners = [done.recording.scene.network.positions]
    marks = np.array([mark.position for step in done.steps for mark in step.marks])
    if len(marks):
        corners.append(np.quantile(marks, [OUTLIERS, 1.0 - OUTLIERS], axis=0))
    truth = done.truth[np.isfinite(done.truth).all(axis=1)]
    places = np.vstack([*corners, truth])
    return np.array([places.min(axis=0), places.max(axis=0)])


def body_size(done: Track) -> float:
    """Diagonal of the box of `body_box` [m]: an estimate with a larger error lies outside the body."""
    low, high = body_box(done)
    return float(np.linalg.norm(high - low))


def within(points: Floats, box: Floats) -> Floats:
    """The points, (n, dim), that lie in a box with this lowest and highest corner, (2, dim)."""
    return points[((points >= box[0]) & (points <= box[1])).all(axis=1)]


def outside(points: Floats, box: Floats) -> NDArray[np.bool_]:
    """Whether each point, (n, dim), is outside a box with this lowest and highest corner, (2, dim); False for NaN."""
    return np.asarray(((points < box[0]) | (points > box[1])).any(axis=1))


def widened(box: Floats, share: float) -> Floats:
    """A box, (2, dim), enlarged by a margin that is this share of its longest side."""
    margin = share * float(np.ptp(box, axis=0).max())
    return np.array([box[0] - margin, box[1] + margin])


def highest(most: float, *series: Floats) -> float:
    """Upper limit of an axis, at most `most`, with room for the usual values of each series."""
    sizes = [own for values in series if len(own := np.abs(values[np.isfinite(values)]))]
    tops = [min(float(np.quantile(own, USUAL)), FAR * float(np.median(own))) for own in sizes]
    top = 1.2 * max(tops, default=0.0)
    return min(most, top) if top > 0.0 else most


def thinned(times_s: Floats, values: Floats) -> tuple[Floats, Floats]:
    """A series of n values as a line of at most `N_DRAWN` points: least and largest value of each run of frames.

    A run without any finite value breaks the line.
    """
    if len(values) <= N_DRAWN:
        return times_s, values
    chosen = []
    for run in np.array_split(np.arange(len(values)), N_DRAWN // 2):
        own = values[run]
        least, largest = np.where(np.isnan(own), np.inf, own), np.where(np.isnan(own), -np.inf, own)
        chosen += sorted({run[least.argmin()], run[largest.argmax()]})
    return times_s[chosen], values[chosen]


def mark_beyond(ax: Axes, times_s: Floats, values: Floats, color: str) -> int:
    """Draw carets on the edges of a plot for values above or below it; returns the number of such frames."""
    low, high = ax.get_ylim()
    count = 0
    for beyond, edge, marker in ((values > high, 0.985, "^"), (values < low, 0.015, "v")):
        n = int(beyond.sum())
        if n:
            shown = times_s[beyond][:: -(-n // N_CARETS)]
            ax.plot(shown, np.full(len(shown), edge), marker, ms=2.5, color=color, transform=ax.get_xaxis_transform())
        count += n
    return count
