"""Plots of a track: path of the target, error, sigma, and consistency of the covariance.

Colours: the truth in black, ours in blue, the paper's open loop in orange, everywhere. A picture's limits are those of
the body (`limits.py`); estimates that leave it are marked at its edge.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from matplotlib.ticker import LogLocator, NullFormatter
from numpy.typing import NDArray
from scipy.stats import chi2

from estimators import chi_square_bounds
from experiments.arrays import Floats
from experiments.formats.estimate_rows import AXES
from experiments.pipeline.line import FILTER, OPEN_LOOP
from experiments.pipeline.track import Track, table
from experiments.plots.limits import FAR, N_DRAWN, body_box, body_size, highest, mark_beyond, thinned, widened, within

TRUE, OURS, PAPERS = "black", "#1f6fb4", "#e07b16"
N_ELLIPSES = 40
N_BINS = 8
LEAST_SHOWN, MOST_SHOWN = 1e-2, 1e4
"""Of NEES and NIS: four decades above the bounds no frame is consistent, however much larger the value."""

AROUND = 0.5
"""Margin around the body that a picture may show, by its size."""


def write_track_plots(done: Track, folder: Path) -> list[Path]:
    """Draw path.png, error.png, sigma.png and consistency.png into a folder that exists; the files written.

    Where the truth is not known the pictures that need it are left out.
    """
    pictures = {"path.png": path_figure(done)}
    if np.isfinite(done.truth).all(axis=1).any():
        pictures |= {"error.png": error_figure(done), "sigma.png": sigma_figure(done)}
    pictures["consistency.png"] = consistency_figure(done)
    for name, figure in pictures.items():
        figure.savefig(folder / name, dpi=110)
    return [folder / name for name in pictures]


def _figure(width: float, height: float, **grid: object) -> tuple[Figure, NDArray[np.object_]]:
    # Figures made without pyplot: no global state, nothing to close
    with mpl.rc_context({"font.size": 9}):
        figure = Figure(figsize=(width, height), layout="constrained")
        axes = figure.subplots(squeeze=False, **grid)  # type: ignore[call-overload]
    for ax in axes.ravel():
        ax.spines[["top", "right"]].set_visible(False)
    return figure, axes


def path_figure(done: Track) -> Figure:
    """Paths of the hidden target over a frame of the film, with 2-sigma ellipses of ours."""
    figure, axes = _figure(11, 5.5, ncols=2)
    estimates = done.estimates(FILTER)
    means = 1e3 * np.array([e.mean[:2] for e in estimates])
    papers = 1e3 * np.array([e.mean[:2] for e in done.estimates(OPEN_LOOP)])
    truth = 1e3 * done.truth[:, :2]
    known = truth[np.isfinite(truth).all(axis=1)]
    whole, close = axes[0]
    body = 1e3 * body_box(done)[:, :2]
    around = widened(body, AROUND)
    if not _film(done, whole):
        _network(done, whole)
        _limit(whole, np.vstack([body, within(means, around), within(papers, around)]), 0.05)
    errors = np.linalg.norm(means - truth, axis=1)
    usual = ~(errors > FAR * np.nanmedian(errors)) if len(known) else np.full(len(means), True)
    near = np.vstack([within(means[usual], around), known])
    middle, reach = _middle_and_reach(near if len(near) else body)
    close.set_aspect("equal")
    close.set(xlim=(middle[0] - reach, middle[0] + reach), ylim=(middle[1] - reach, middle[1] + reach))
    shown = slice(None, None, -(-len(means) // N_DRAWN))
    for ax, thick in ((whole, 0.8), (close, 1.2)):
        ax.plot(*papers[shown].T, color=PAPERS, lw=thick * 0.8, alpha=0.7, label="paper's open loop")
        ax.plot(*means[shown].T, color=OURS, lw=thick, label="filter")
        if len(known):
            ax.plot(*truth[shown].T, color=TRUE, lw=thick, ls=(0, (4, 2)), label="truth")
        _mark_outside(ax, means)
        ax.set(xlabel="x [mm]", ylabel="y [mm]")
    target = done.recording.scene.target.node
    whole.set_title(f"target {target} in the scene")
    chosen = np.linspace(0, len(means) - 1, min(N_ELLIPSES, len(means))).astype(int)
    covs = {k: 1e6 * cov[:2, :2] for k in chosen if (cov := estimates[k].cov) is not None}
    drawn = [k for k, cov in covs.items() if _fits(cov, reach)]
    for k in drawn:
        close.add_patch(ellipse(means[k], covs[k], 2.0, ec=OURS, fc="none", lw=0.8, zorder=3))
    larger = f"\n{len(covs) - len(drawn)} more are larger than the picture" if len(drawn) < len(covs) else ""
    close.set_title(f"close up, 2-sigma ellipses of {len(drawn)} frames{larger}")
    figure.legend(*close.get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False)
    return figure


def _film(done: Track, ax: Axes) -> bool:
    """Draw the first frame of the film around the network; False where there is none, or the camera is not square."""
    cameras = done.recording.scene.cameras
    ax.set_aspect("equal")
    if not cameras or done.recording.marks is not None:
        return False
    camera = cameras[0]
    if not np.allclose(camera.plane_to_px[[0, 1, 2, 2], [1, 0, 0, 1]], 0.0):
        return False
    with done.recording.open_frames() as frames:
        image = next(iter(frames)).image[..., ::-1]
    width, height = camera.size_px
    (left, top), (right, bottom) = camera.to_plane(np.array([[-0.5, -0.5], [width - 0.5, height - 0.5]])) * 1e3
    ax.imshow(image, extent=(left, right, bottom, top), origin="upper")
    nodes = 1e3 * done.recording.scene.network.positions
    (west, low), (east, high) = widened(np.array([nodes.min(axis=0), nodes.max(axis=0)]), AROUND)
    ax.set(xlim=(max(west, left), min(east, right)), ylim=(max(low, bottom), min(high, top)))
    return True


def _network(done: Track, ax: Axes) -> None:
    network = done.recording.scene.network
    x = 1e3 * network.positions[:, :2]
    ax.add_collection(LineCollection(list(x[network.springs]), colors="0.75", linewidths=1))
    ax.plot(*x.T, "o", color="0.5", ms=4)


def _limit(ax: Axes, points: Floats, margin: float) -> None:
    (left, low), (right, high) = widened(np.array([points.min(axis=0), points.max(axis=0)]), margin)
    ax.set(xlim=(left, right), ylim=(low, high))


def _middle_and_reach(points: Floats) -> tuple[Floats, float]:
    """Middle of the points (n, 2) [mm], and half of what a square picture of them shows [mm]."""
    return 0.5 * (points.min(axis=0) + points.max(axis=0)), 0.65 * max(1.0, float(np.ptp(points, axis=0).max()))


def _mark_outside(ax: Axes, points: Floats) -> None:
    """Crosses on the edge of a picture where a path (n, 2) leaves it."""
    box = np.array([ax.get_xlim(), ax.get_ylim()]).T
    outside = points[((points < box[0]) | (points > box[1])).any(axis=1)]
    if len(outside):
        edge = np.clip(outside[:: -(-len(outside) // N_DRAWN)], *widened(box, -0.01))
        label = f"filter outside: {len(outside)} of {len(points)} frames"
        ax.plot(*edge.T, "x", color=OURS, ms=4, label=label)


def _fits(cov: Floats, reach: float) -> bool:
    """Whether the 2-sigma ellipse of a covariance (2, 2) is finite and no larger than a picture of this reach."""
    return bool(np.isfinite(cov).all() and 2.0 * np.sqrt(np.linalg.eigvalsh(cov)[-1].clip(0.0)) <= 2.0 * reach)


def ellipse(mean: Floats, cov: Floats, sigmas: float, **style: object) -> Ellipse:
    """The ellipse of so many standard deviations of a Gaussian in the plane, mean (2,), cov (2, 2)."""
    values, vectors = np.linalg.eigh(cov)
    angle = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
    across = 2.0 * sigmas * np.sqrt(values.clip(0.0))  # a singular one's least is rounding, of either sign
    return Ellipse((mean[0], mean[1]), across[1], across[0], angle=angle, **style)


def error_figure(done: Track) -> Figure:
    """Error of each axis over time within its 1, 2 and 3-sigma envelope."""
    dim = done.recording.scene.network.dim
    figure, axes = _figure(11, 2.4 * dim, nrows=dim, sharex=True)
    ours, size = table(done, FILTER), 1e3 * body_size(done)
    errors = 1e3 * (np.array([e.mean for e in done.estimates(FILTER)]) - done.truth)
    papers = 1e3 * (np.array([e.mean for e in done.estimates(OPEN_LOOP)]) - done.truth)
    times = done.times_s
    for a, ax in enumerate(axes[:, 0]):
        sigma = np.sqrt(ours[AXES[a] * 2].to_numpy())
        top = highest(size, 3.0 * sigma, errors[:, a], papers[:, a])
        ax.set_ylim(-top, top)
        at, spread = thinned(times, np.minimum(sigma, top))
        for k in (3, 2, 1):
            label = "1, 2, 3 sigma" if k == 2 else None
            ax.fill_between(at, -k * spread, k * spread, color=OURS, alpha=0.15, lw=0, label=label)
        ax.plot(*thinned(times, papers[:, a]), color=PAPERS, lw=0.6, alpha=0.8, label="paper's open loop")
        ax.plot(*thinned(times, errors[:, a]), color=OURS, lw=0.9, label="filter")
        beyond = mark_beyond(ax, times, errors[:, a], OURS)
        if beyond:
            ax.set_title(f"filter beyond the picture in {beyond} of {len(times)} frames", loc="right", fontsize=8)
        ax.axhline(0.0, color=TRUE, lw=0.5)
        ax.set_ylabel(f"{AXES[a]} error [mm]")
        _span(ax, times)
    axes[0, 0].set_title("error of the hidden target and the filter's sigma", loc="left")
    axes[-1, 0].set_xlabel("time [s]")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    return figure


def sigma_figure(done: Track) -> Figure:
    """Root mean square error against predicted sigma, binned: on the diagonal a sigma is a sigma."""
    figure, axes = _figure(5.5, 5)
    ax = axes[0, 0]
    dim = done.recording.scene.network.dim
    ours = table(done, FILTER)
    sigma = np.sqrt(sum(ours[AXES[a] * 2] for a in range(dim)) / dim).to_numpy()
    error = (ours["err_mm"] / np.sqrt(dim)).to_numpy()
    known = np.isfinite(error) & np.isfinite(sigma) & (sigma > 0.0)
    sigma, error = sigma[known], error[known]
    if not known.any():
        ax.text(0.5, 0.5, "not known", transform=ax.transAxes, ha="center")
        return figure
    edges = np.unique(np.quantile(sigma, np.linspace(0.0, 1.0, N_BINS + 1)))
    bins = np.clip(np.searchsorted(edges, sigma, side="right") - 1, 0, len(edges) - 2) if len(edges) > 1 else None
    groups = [np.flatnonzero(bins == b) for b in range(len(edges) - 1)] if bins is not None else [np.arange(len(sigma))]
    groups = [group for group in groups if len(group)]
    predicted = np.array([np.sqrt((sigma[g] ** 2).mean()) for g in groups])
    found = np.maximum([np.sqrt((error[g] ** 2).mean()) for g in groups], 1e-3 * predicted)
    ax.loglog(sigma, np.maximum(error, 1e-3 * sigma.min()), ".", color="0.8", ms=2, label="single frames")
    low, high = 0.7 * min(predicted.min(), found.min()), 1.4 * max(predicted.max(), found.max())
    line = np.array([low, high])
    ax.plot(line, line, color=TRUE, lw=0.8, label="a sigma is a sigma")
    ax.fill_between(line, line / 1.5, line * 1.5, color="0.5", alpha=0.15, lw=0, label="within a factor 1.5")
    ax.plot(predicted, found, "o-", color=OURS, label=f"RMS of {len(groups)} equal bins")
    ax.set(xlim=(low, high), ylim=(low, high), xlabel="predicted sigma [mm, per axis]", ylabel="error [mm, per axis]")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 1e3 * low else (1.0,)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
    ax.set_aspect("equal")
    ax.set_title("error against predicted sigma")
    ax.legend(loc="upper left")
    return figure


def consistency_figure(done: Track) -> Figure:
    """NEES and NIS over time against the bounds that hold 95 % of a consistent filter's."""
    ours = table(done, FILTER)
    dim = done.recording.scene.network.dim
    figure, axes = _figure(11, 4.8, nrows=2, sharex=True)
    degrees = dim * ours["marks_used"].to_numpy()
    for ax, key, freedom in ((axes[0, 0], "nees", np.full(len(ours), dim)), (axes[1, 0], "nis", degrees)):
        values = np.maximum(ours[key].to_numpy(), LEAST_SHOWN)
        known = ~np.isnan(values)
        if not known.any():
            ax.text(0.5, 0.5, "not known", transform=ax.transAxes, ha="center")
            continue
        bounds = {n: chi_square_bounds(max(int(n), 1)) for n in np.unique(freedom)}
        low, high = np.array([bounds[n] for n in freedom]).T
        inside = float(np.mean(values[known] <= chi2.ppf(0.95, np.maximum(freedom[known], 1))))
        ax.semilogy(done.times_s[known], values[known], ".", color=OURS, ms=3 if len(values) < N_DRAWN else 1)
        ax.fill_between(done.times_s, low, high, color=OURS, alpha=0.15, lw=0, step="mid")
        mean, right = ours[key].to_numpy()[known].mean(), freedom[known].mean()
        ax.set(ylabel=key.upper(), ylim=(0.8 * LEAST_SHOWN, min(ax.get_ylim()[1], MOST_SHOWN)))
        beyond = mark_beyond(ax, done.times_s, values, OURS)
        average = f"{mean:.2f}" if mean < MOST_SHOWN else f"{mean:.1e}"
        ax.set_title(
            f"{key.upper()}: mean {average} where {right:.2g} is right; {100 * inside:.1f} % in the 95 % region"
            + (f"; {beyond} frames beyond the picture" if beyond else "")
        )
    axes[1, 0].set_xlabel("time [s]")
    _span(axes[1, 0], done.times_s)
    return figure


def _span(ax: Axes, times_s: Floats) -> None:
    """Show from the first time to the last; one alone spans nothing and is left to matplotlib."""
    if len(times_s) > 1:
        ax.set_xlim(times_s[0], times_s[-1])
