"""Plots of the covariance's consistency: errors, NEES, NIS, and errors of marks that the filter did not use."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from estimators import chi_square_bounds
from estimators.consistency.whiteness import effective_count
from experiments.arrays import Floats
from experiments.formats.estimate_rows import AXES
from experiments.pipeline.line import FILTER
from experiments.pipeline.scores.fit import Withheld, fit_of
from experiments.pipeline.track import Track, table
from experiments.plain import counted
from experiments.plots.series import N_DRAWN, STATUS_COLOURS, draw_bands, mark_beyond
from experiments.plots.style import COLUMN_MM, OURS, PAGE_MM, SMALL_PT, TRUE, grid_figure, legend_below, span, styled

N_BINS = 8
SPARED = 0.05
"""Largest share of frames that may lie beyond one end of an axis; the plot states the number of frames outside."""

NARROW = 3.0
"""Largest ratio [1] of an axis's limits at which the ticks are linear; there would be too few logarithmic ticks."""

LEAST_SHOWN, MOST_SHOWN = 1e-4, 1e4
"""Bounds of a plot of NEES or NIS [1]; they are about four decades outside the bounds for a consistent filter."""


def _errors_and_sigmas(done: Track) -> tuple[Floats, Floats, Floats]:
    """Errors per axis [mm], standard deviations [mm] and NEES of the frames that have an error and a covariance."""
    ours, dim = table(done, FILTER), done.recording.scene.network.dim
    sigma = np.sqrt(sum(ours[AXES[a] * 2] for a in range(dim)) / dim).to_numpy()
    error = (ours["err_mm"] / np.sqrt(dim)).to_numpy()
    known = np.isfinite(error) & np.isfinite(sigma) & (sigma > 0.0)
    return error[known], sigma[known], ours["nees"].to_numpy()[known]


@styled
def sigma_figure(done: Track) -> Figure | None:
    """Plot of the observed error against the predicted standard deviation, by groups of frames.

    None without errors or covariances. If the covariance is consistent, 95 % of the groups lie in the band. Errors are
    correlated in time. Therefore the band's width uses the effective number of independent errors in a group.
    """
    error, sigma, nees = _errors_and_sigmas(done)
    if not len(error):
        return None
    figure, axes = grid_figure(COLUMN_MM, COLUMN_MM + 12.0)
    ax, dim = axes[0, 0], done.recording.scene.network.dim
    groups = grouped(sigma)
    predicted = np.array([np.sqrt((sigma[g] ** 2).mean()) for g in groups])
    found = np.maximum([np.sqrt((error[g] ** 2).mean()) for g in groups], 1e-3 * predicted)
    worth = effective_count(nees) / len(nees) * len(sigma) / len(groups) if np.isfinite(nees).all() else 1.0
    least, most = np.sqrt(np.array(chi_square_bounds(dim * worth)) / (dim * worth))
    low, high = np.quantile(sigma, [0.5 * SPARED, 1.0 - 0.5 * SPARED])
    low, high = min(0.9 * predicted.min(), low), max(1.1 * predicted.max(), high)
    bottom = min(0.7 * low, 0.7 * found.min(), float(np.quantile(error, SPARED)))
    top = max(1.4 * high, 1.4 * found.max(), float(np.quantile(error, 1.0 - SPARED)))
    n_out = int(((error < bottom) | (error > top) | (sigma < low) | (sigma > high)).sum())
    note = f" ({n_out} of {len(error)} outside)" if n_out else ""
    ax.loglog(sigma, error, ".", color="0.75", ms=1.5, mew=0.0, label=f"single frames{note}", zorder=1)
    line = np.array([low, high])
    band = "95 % of groups if consistent"
    ax.fill_between(line, least * line, most * line, color="0.5", alpha=0.2, lw=0, label=band, zorder=0)
    ax.plot(line, line, color=TRUE, lw=0.6, label="observed = predicted", zorder=2)
    ax.plot(predicted, found, "o-", color=OURS, label=f"rms of {len(groups)} groups", zorder=3)
    ax.set(xlim=(low, high), ylim=(bottom, top))
    ax.set(xlabel="predicted standard deviation of an axis [mm]", ylabel="observed rms error of an axis [mm]")
    for axis, ratio in ((ax.xaxis, high / low), (ax.yaxis, top / bottom)):
        decades = LogLocator(subs=(1.0, 2.0, 5.0) if ratio < 1e3 else (1.0,))
        axis.set_major_locator(decades if ratio > NARROW else MaxNLocator(5))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
    legend_below(figure, ax, 2)
    return figure


def grouped(sigma: Floats) -> list[np.ndarray]:
    """Indices of frames in groups of increasing `sigma`, (n_frames,); the groups have nearly equal sizes."""
    edges = np.unique(np.quantile(sigma, np.linspace(0.0, 1.0, N_BINS + 1)))
    if len(edges) < 2:
        return [np.arange(len(sigma))]
    bins = np.clip(np.searchsorted(edges, sigma, side="right") - 1, 0, len(edges) - 2)
    return [group for b in range(len(edges) - 1) if len(group := np.flatnonzero(bins == b))]


@styled
def consistency_figure(done: Track) -> Figure | None:
    """NIS and, if the truth is known, NEES over time, with their 95 % bounds; None if both are missing."""
    ours, dim = table(done, FILTER), done.recording.scene.network.dim
    freedom = {"nees": np.full(len(ours), dim), "nis": np.array([e.degrees for e in done.estimates(FILTER)])}
    keys = [key for key in freedom if ours[key].notna().any()]
    if not keys:
        return None
    figure, axes = grid_figure(PAGE_MM, 12.0 + 42.0 * len(keys), nrows=len(keys), sharex=True)
    for ax, key in zip(axes[:, 0], keys, strict=True):
        _against_bounds(done, ax, key, ours[key].to_numpy(), freedom[key])
    axes[-1, 0].set_xlabel("time [s]")
    span(axes[-1, 0], done.times_s)
    legend_below(figure, axes[-1, 0], 4)
    return figure


def _against_bounds(done: Track, ax: Axes, key: str, found: Floats, freedom: np.ndarray) -> None:
    known = ~np.isnan(found)
    bounds = {n: chi_square_bounds(max(int(n), 1)) for n in np.unique(freedom)}
    low, high = np.array([bounds[n] if n else (np.nan, np.nan) for n in freedom]).T
    inside = float(np.mean((low <= found) & (found <= high), where=known))
    ms = 2.0 if len(found) < N_DRAWN else 0.7
    ax.semilogy(done.times_s[known], found[known], ".", color=OURS, ms=ms, mew=0.0, label="a frame", zorder=3)
    label = "95 % of frames if consistent"
    ax.fill_between(done.times_s, low, high, color=OURS, alpha=0.15, lw=0, step="mid", label=label)
    draw_bands(ax, done.times_s, [e.status for e in done.estimates(FILTER)], STATUS_COLOURS)
    shown = found[known & (found > LEAST_SHOWN) & (found < MOST_SHOWN)]
    least = np.quantile(shown, 0.5 * SPARED) if len(shown) else np.nan  # a value near 0 would stretch the axis
    bottom, top = np.nanmin([least, *low]), np.nanmax([*shown, *high])
    ax.set(ylabel=f"{key.upper()} [–]", ylim=(max(0.7 * bottom, LEAST_SHOWN), min(1.4 * top, MOST_SHOWN)))
    beyond = mark_beyond(ax, done.times_s, found, OURS)
    title = f"{key.upper()}: mean {_average(found[known].mean())}, expected {freedom[known].mean():.2g}"
    fit = fit_of(done.estimates(FILTER))
    if key == "nis" and fit is not None:
        title = f"NIS: mean {_average(fit.mean_nis)}, 95 % band of the mean {fit.low:.2f} to {fit.high:.2f}"
    ax.set_title(
        f"{title}; {100 * inside:.1f} % of frames in the shaded band"
        + (f"; {counted(beyond, 'frame')} outside the plot" if beyond else "")
    )


def _average(mean: float) -> str:
    return f"{mean:.2f}" if mean < MOST_SHOWN else f"{mean:.1e}"


@styled
def withheld_figure(withheld: Mapping[str, Withheld]) -> Figure:
    """Bar chart of each mark's rms error divided by the rms error that a filter without this mark predicts.

    Raises ValueError if there are no marks.
    """
    if not withheld:
        raise ValueError("withheld_figure: expected marks that were predicted as if hidden, found none")
    width = COLUMN_MM if len(withheld) <= 8 else PAGE_MM
    figure, axes = grid_figure(width, 60.0)
    ax, ratios = axes[0, 0], [one.ratio for one in withheld.values()]
    ax.bar(range(len(ratios)), ratios, width=0.6, color=OURS, alpha=0.7)
    for k, one in enumerate(withheld.values()):
        above = (k, max(one.ratio, 1.0))
        label = f"{one.mean_error_mm:.2f} mm"
        ax.annotate(label, above, (0, 2), textcoords="offset points", ha="center", fontsize=SMALL_PT)
    ax.axhline(1.0, color=TRUE, lw=0.6, ls=(0, (4, 2)), label="as predicted")
    ax.set_xticks(range(len(ratios)), list(withheld), rotation=90 if len(withheld) > 8 else 0)
    ax.set(ylim=(0.0, 1.2 * max(1.0, *ratios)), xlabel="mark", ylabel="observed / predicted rms error [–]")
    ax.set_title("marks predicted as if hidden; with their mean error")
    legend_below(figure, ax, 1)
    return figure
