"""Series over time: limits of the axes, thinned lines, carets at the edge, bands, coordinates of the target.

The body and its measurements give the limits, so that diverging estimates do not stretch the axes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from estimators import Advice, Status
from experiments.arrays import Floats
from experiments.formats.estimate_rows import AXES
from experiments.pipeline.line import FILTER, OPEN_LOOP
from experiments.pipeline.track import Track, table
from experiments.plots.style import BLACK, GREY, OURS, PAPERS, TRUE, VERMILLION

STATUS_COLOURS = {Status.COASTING: GREY, Status.LOST: BLACK, Status.DIVERGED: VERMILLION}
"""Colours of the statuses of frames whose estimate is not based on consistent marks."""

FAINT = 0.25
"""Opacity of a band behind curves."""

K = TypeVar("K", Status, Advice)


def spans_of(times_s: Floats, held: Sequence[bool]) -> list[tuple[float, float]]:
    """Start and length [s] of each block of frames with `held` true; blocks begin and end half-way between frames."""
    if len(times_s) < 2:
        return []
    edges = np.concatenate([times_s[:1], 0.5 * (times_s[1:] + times_s[:-1]), times_s[-1:]])
    during = np.concatenate([[False], np.asarray(held, dtype=bool), [False]])
    starts, ends = np.flatnonzero(during[1:] & ~during[:-1]), np.flatnonzero(~during[1:] & during[:-1])
    return list(zip(edges[starts].tolist(), (edges[ends] - edges[starts]).tolist(), strict=True))


def draw_bands(ax: Axes, times_s: Floats, kinds: Sequence[K], colours: Mapping[K, str]) -> None:
    """Colour each frame's background by its kind, a status or an advice, and label it; some kinds have no colour."""
    for kind, colour in colours.items():
        spans = spans_of(times_s, [one == kind for one in kinds])
        if spans:
            label = str(kind).replace("_", " ")
            whole = ax.get_xaxis_transform()
            ax.broken_barh(spans, (0.0, 1.0), facecolors=colour, alpha=FAINT, lw=0, transform=whole, label=label)


N_DRAWN = 4000
"""Largest number of points of a drawn line: about three points for each pixel of a plot's width."""

N_CARETS = 400
"""Largest number of carets on an edge: more would merge."""

OUTLIERS = 0.01
"""Share [1] of mark positions that count as outliers at either end of each axis; the body's box omits them."""

USUAL, FAR = 0.99, 10.0
"""An axis shows a series up to its quantile `USUAL`, but at most up to the multiple `FAR` of its median."""


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
    """Whether each point, (n, dim), is outside a box; box: lowest and highest corner, (2, dim). False for NaN."""
    return np.asarray(((points < box[0]) | (points > box[1])).any(axis=1))


def widened(box: Floats, share: float) -> Floats:
    """A box, (2, dim), enlarged by a margin that is this share of its longest side."""
    margin = share * float(np.ptp(box, axis=0).max())
    return np.array([box[0] - margin, box[1] + margin])


def highest(most: float, *series: Floats) -> float:
    """Upper limit of an axis for the values of all series that are not outliers, see `USUAL`; it is at most `most`."""
    sizes = [own for values in series if len(own := np.abs(values[np.isfinite(values)]))]
    tops = [min(float(np.quantile(own, USUAL)), FAR * float(np.median(own))) for own in sizes]
    top = 1.2 * max(tops, default=0.0)
    return min(most, top) if top > 0.0 else most


def thinned(times_s: Floats, values: Floats) -> tuple[Floats, Floats]:
    """A series as a line of at most `N_DRAWN` points. In a longer series, blocks of frames keep their extreme values.

    A block without any finite value breaks the line.
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
    """Draw carets on the upper and lower edge of a plot for values beyond it; returns the number of these values."""
    low, high = ax.get_ylim()
    count = 0
    for beyond, edge, marker in ((values > high, 0.985, "^"), (values < low, 0.015, "v")):
        n = int(beyond.sum())
        if n:
            shown = times_s[beyond][:: -(-n // N_CARETS)]
            ax.plot(shown, np.full(len(shown), edge), marker, ms=2.5, color=color, transform=ax.get_xaxis_transform())
        count += n
    return count


AROUND = 0.5
"""Margin of a plot on each side of the body, relative to the longest side of the body's box."""


def means_mm(done: Track, method: str) -> Floats:
    """Estimates of the target by a method [mm], (n_frames, dim)."""
    return 1e3 * np.array([e.mean for e in done.estimates(method)])


def sigma_mm(done: Track, axis: int) -> Floats:
    """Predicted standard deviations of the filter on an axis [mm], (n_frames,)."""
    return np.sqrt(table(done, FILTER)[AXES[axis] * 2].to_numpy())


def draw_motion(done: Track, ax: Axes, axis: int) -> None:
    """Draw one coordinate of the target over time. The filter has a band of two standard deviations."""
    low, high = usual_range(done, axis)
    ax.set_ylim(low, high)
    truth = 1e3 * done.truth[:, axis]
    ours, papers = means_mm(done, FILTER)[:, axis], means_mm(done, OPEN_LOOP)[:, axis]
    draw_over_time(done, ax, ours, papers, np.minimum(sigma_mm(done, axis), high - low), multiples=(2,))
    if np.isfinite(truth).any():
        ax.plot(*thinned(done.times_s, truth), color=TRUE, lw=0.5, label="truth")
    ax.set_ylabel(f"{AXES[axis]} [mm]")


def usual_range(done: Track, axis: int) -> tuple[float, float]:
    """Limits [mm] of an axis that shows the truth and the filter's path near the body, with a margin for sigma."""
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
    """Draw a coordinate over time, with a band for each of the multiples of sigma.

    ours: values of the filter; papers: values of the open loop
    A single band has its centre at `ours`; several bands have it at zero.
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
