"""Plots of a track: path of the target, error, sigma, and consistency of the covariance.

Colours: the truth in black, ours in blue, the paper's open loop in orange, everywhere.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
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

TRUE, OURS, PAPERS = "black", "#1f6fb4", "#e07b16"
N_ELLIPSES = 40
N_BINS = 8
LEAST_SHOWN = 1e-2


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
    covs = 1e6 * np.array([e.cov[:2, :2] for e in estimates if e.cov is not None])
    papers = 1e3 * np.array([e.mean[:2] for e in done.estimates(OPEN_LOOP)])
    truth = 1e3 * done.truth[:, :2]
    whole, close = axes[0]
    _background(done, whole)
    chosen = np.linspace(0, len(means) - 1, min(N_ELLIPSES, len(means))).astype(int)
    for ax, thick in ((whole, 0.8), (close, 1.2)):
        ax.plot(*papers.T, color=PAPERS, lw=thick * 0.8, alpha=0.7, label="paper's open loop")
        ax.plot(*means.T, color=OURS, lw=thick, label="filter")
        if np.isfinite(truth).any():
            ax.plot(*truth.T, color=TRUE, lw=thick, ls=(0, (4, 2)), label="truth")
        ax.set(xlabel="x [mm]", ylabel="y [mm]")
    for k in chosen:
        close.add_patch(ellipse(means[k], covs[k], 2.0, ec=OURS, fc="none", lw=0.8, zorder=3))
    target = done.recording.scene.target.node
    whole.set_title(f"target {target} in the scene")
    close.set_title(f"close up, 2-sigma ellipses of {len(chosen)} frames")
    close.set_aspect("equal")
    both = np.vstack([means, truth[np.isfinite(truth).all(axis=1)]])
    middle = 0.5 * (both.min(axis=0) + both.max(axis=0))
    reach = 0.65 * max(1.0, float(np.ptp(both, axis=0).max()))
    close.set(xlim=(middle[0] - reach, middle[0] + reach), ylim=(middle[1] - reach, middle[1] + reach))
    close.legend(loc="best", framealpha=0.9)
    return figure


def _background(done: Track, ax: Axes) -> None:
    network, cameras = done.recording.scene.network, done.recording.scene.cameras
    ax.set_aspect("equal")
    if cameras and done.recording.marks is None:
        camera = cameras[0]
        with done.recording.open_frames() as frames:
            image = next(iter(frames)).image[..., ::-1]
        width, height = camera.size_px
        corners = camera.to_plane(np.array([[-0.5, -0.5], [width - 0.5, height - 0.5]])) * 1e3
        squarely = np.allclose(camera.plane_to_px[[0, 1, 2, 2], [1, 0, 0, 1]], 0.0)
        if squarely:
            (left, top), (right, bottom) = corners
            ax.imshow(image, extent=(left, right, bottom, top), origin="upper")
            _around(done, ax, (left, right, bottom, top))
            return
    x = 1e3 * network.positions
    for i, j in network.springs:
        ax.plot(*x[[i, j], :2].T, color="0.75", lw=1)
    ax.plot(*x[:, :2].T, "o", color="0.5", ms=4)


def _around(done: Track, ax: Axes, extent: tuple[float, float, float, float]) -> None:
    """Show the part of a frame in which the network stands, half its size around it."""
    x = 1e3 * done.recording.scene.network.positions[:, :2]
    margin = 0.5 * float(np.ptp(x, axis=0).max())
    (left, low), (right, high) = x.min(axis=0) - margin, x.max(axis=0) + margin
    ax.set(
        xlim=(max(left, extent[0]), min(right, extent[1])),
        ylim=(max(low, extent[2]), min(high, extent[3])),
    )


def ellipse(mean: Floats, cov: Floats, sigmas: float, **style: object) -> Ellipse:
    """The ellipse of so many standard deviations of a Gaussian in the plane, mean (2,), cov (2, 2)."""
    values, vectors = np.linalg.eigh(cov)
    angle = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
    across = 2.0 * sigmas * np.sqrt(values)
    return Ellipse((mean[0], mean[1]), across[1], across[0], angle=angle, **style)


def error_figure(done: Track) -> Figure:
    """Error of each axis over time within its 1, 2 and 3-sigma envelope."""
    dim = done.recording.scene.network.dim
    figure, axes = _figure(11, 2.4 * dim, nrows=dim, sharex=True)
    ours = table(done, FILTER)
    errors = 1e3 * (np.array([e.mean for e in done.estimates(FILTER)]) - done.truth)
    papers = 1e3 * (np.array([e.mean for e in done.estimates(OPEN_LOOP)]) - done.truth)
    times = done.times_s
    for a, ax in enumerate(axes[:, 0]):
        sigma = np.sqrt(ours[AXES[a] * 2].to_numpy())
        for k in (3, 2, 1):
            label = "1, 2, 3 sigma" if k == 2 else None
            ax.fill_between(times, -k * sigma, k * sigma, color=OURS, alpha=0.15, lw=0, label=label)
        ax.plot(times, papers[:, a], color=PAPERS, lw=0.6, alpha=0.8, label="paper's open loop")
        ax.plot(times, errors[:, a], color=OURS, lw=0.9, label="filter")
        ax.axhline(0.0, color=TRUE, lw=0.5)
        ax.set_ylabel(f"{AXES[a]} error [mm]")
        _span(ax, times)
        top = 1.2 * max(np.nanmax(3 * sigma[len(sigma) // 50 :]), np.nanquantile(np.abs(papers[:, a]), 0.99))
        ax.set_ylim(-top, top)
    axes[0, 0].legend(loc="upper right", ncols=3, framealpha=0.9)
    axes[0, 0].set_title("error of the hidden target and the filter's sigma")
    axes[-1, 0].set_xlabel("time [s]")
    return figure


def sigma_figure(done: Track) -> Figure:
    """Root mean square error against predicted sigma, binned: on the diagonal a sigma is a sigma."""
    figure, axes = _figure(5.5, 5)
    ax = axes[0, 0]
    dim = done.recording.scene.network.dim
    ours = table(done, FILTER)
    sigma = np.sqrt(sum(ours[AXES[a] * 2] for a in range(dim)) / dim).to_numpy()
    error = (ours["err_mm"] / np.sqrt(dim)).to_numpy()
    known = np.isfinite(error)
    sigma, error = sigma[known], error[known]
    edges = np.unique(np.quantile(sigma, np.linspace(0.0, 1.0, N_BINS + 1)))
    bins = np.clip(np.searchsorted(edges, sigma, side="right") - 1, 0, len(edges) - 2) if len(edges) > 1 else None
    groups = [np.flatnonzero(bins == b) for b in range(len(edges) - 1)] if bins is not None else [np.arange(len(sigma))]
    groups = [group for group in groups if len(group)]
    predicted = np.array([np.sqrt((sigma[g] ** 2).mean()) for g in groups])
    found = np.array([np.sqrt((error[g] ** 2).mean()) for g in groups])
    ax.loglog(sigma, np.maximum(error, 1e-3 * sigma.min()), ".", color="0.8", ms=2, label="single frames")
    low, high = 0.7 * min(predicted.min(), found.min()), 1.4 * max(predicted.max(), found.max())
    line = np.array([low, high])
    ax.plot(line, line, color=TRUE, lw=0.8, label="a sigma is a sigma")
    ax.fill_between(line, line / 1.5, line * 1.5, color="0.5", alpha=0.15, lw=0, label="within a factor 1.5")
    ax.plot(predicted, found, "o-", color=OURS, label=f"RMS of {len(groups)} equal bins")
    ax.set(xlim=(low, high), ylim=(low, high), xlabel="predicted sigma [mm, per axis]", ylabel="error [mm, per axis]")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
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
        values = ours[key].to_numpy()
        known = np.isfinite(values)
        if not known.any():
            ax.text(0.5, 0.5, "not known", transform=ax.transAxes, ha="center")
            continue
        low, high = np.array([chi_square_bounds(max(int(n), 1)) for n in freedom]).T
        inside = float(np.mean(values[known] <= chi2.ppf(0.95, np.maximum(freedom[known], 1))))
        ax.semilogy(done.times_s[known], np.maximum(values[known], LEAST_SHOWN), ".", color=OURS, ms=3)
        ax.fill_between(done.times_s, low, high, color=OURS, alpha=0.15, lw=0, step="mid")
        mean, right = values[known].mean(), freedom[known].mean()
        ax.set(ylabel=key.upper(), ylim=(0.8 * LEAST_SHOWN, None))
        ax.set_title(
            f"{key.upper()}: mean {mean:.2f} where {right:.2g} is right; {100 * inside:.1f} % in the 95 % region"
        )
    axes[1, 0].set_xlabel("time [s]")
    _span(axes[1, 0], done.times_s)
    return figure


def _span(ax: Axes, times_s: Floats) -> None:
    """Show from the first time to the last; one alone spans nothing and is left to matplotlib."""
    if len(times_s) > 1:
        ax.set_xlim(times_s[0], times_s[-1])
