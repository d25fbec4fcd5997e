"""Plot of the target's path. A flat path is coloured by time. In space there are views, and coordinates over time."""

from __future__ import annotations

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from estimators import TargetEstimate
from experiments.arrays import Floats
from experiments.formats.scene.outside import outside_of
from experiments.pipeline.line import FILTER, OPEN_LOOP
from experiments.pipeline.scores.fit import MISSED
from experiments.pipeline.track import Track
from experiments.plain import counted
from experiments.plots.series import (
    AROUND,
    FAR,
    N_DRAWN,
    body_box,
    body_size,
    draw_motion,
    means_mm,
    outside,
    widened,
    within,
)
from experiments.plots.space import N_FACES, TARGET_KEYS, View, close_up, draw_body, draw_target, keys, two_views
from experiments.plots.style import (
    HALO,
    OURS,
    PAGE_MM,
    PAPERS,
    SMALL_PT,
    TIME_MAP,
    TRUE,
    ellipse,
    grid_figure,
    legend_below,
    new_figure,
    span,
    styled,
)

N_ELLIPSES = 40
MOST_NAMES = 30
"""Largest number of nodes that are all labelled; in a larger network only target and measured marks have labels."""

VIEW_MM, CLOSE_MM, ROOM_MM = 60.0, 28.0, 48.0
"""Widths in print for a body in space [mm]: of a view, of a close-up, and of the square that the view's axes fill."""

FAINT = 0.3
"""Opacity of an ellipse for a frame whose estimate is not based on consistent marks."""

OURS_IN_TIME = colormaps[TIME_MAP](0.35)
"""Colour of the filter's path in a legend; the path itself is coloured by time."""


@styled
def path_figure(done: Track) -> Figure:
    """Path of the hidden target on a frame of the film, and a close-up with the filter's 2-sigma ellipses.

    In space the figure shows the target's coordinates over time, and two views of the body, each with a close-up.
    """
    return _in_plane(done) if done.recording.scene.network.dim == 2 else _in_space(done)


def _in_plane(done: Track) -> Figure:
    figure, [[whole, close]] = grid_figure(PAGE_MM, 82.0, ncols=2)
    _whole(done, whole)
    whole.set_title(f"target {done.recording.scene.target.node} in the scene")
    n_drawn, n_larger = _close(done, close)
    larger = f"; {n_larger} more are larger" if n_larger else ""
    close.set_title(f"close up\n2-sigma ellipses of {counted(n_drawn, 'frame')}{larger}")
    for ax in (whole, close):
        ax.set(xlabel="x [mm]", ylabel="y [mm]")
    figure.colorbar(close.collections[0], cax=close.inset_axes((1.03, 0.0, 0.035, 1.0)), label="time [s]")
    legend_below(figure, close, 4, _ellipse_keys(done))
    return figure


def _in_space(done: Track) -> Figure:
    scene = done.recording.scene
    figure = new_figure(PAGE_MM, 125.0)
    grid = figure.add_gridspec(6, 3, width_ratios=(75.0, VIEW_MM, CLOSE_MM))
    over_time = [figure.add_subplot(grid[2 * a : 2 * a + 2, 0]) for a in range(3)]
    for a, ax in enumerate(over_time):
        ax.sharex(over_time[-1])
        draw_motion(done, ax, a)
        ax.tick_params(labelbottom=a == len(over_time) - 1)
    over_time[0].set_title(f"target {scene.target.node}")
    over_time[-1].set_xlabel("time [s]")
    span(over_time[-1], done.times_s)
    last = _last(done)
    views, outline = two_views(scene), outside_of(scene, N_FACES)
    for k, view in enumerate(views):
        whole, close = (figure.add_subplot(grid[3 * k : 3 * k + 3, column]) for column in (1, 2))
        draw_body(whole, view, scene, outline, ROOM_MM)
        _near_target(done, close, view, last)
        if last is not None:
            for ax in (whole, close):
                draw_target(ax, view, last.mean, scene.target.radius_m, last.cov)
        if k == 0:
            whole.set_title("from two sides, as drawn")
            close.set_title("path" if last is None else f"path; lesion at {last.time_s:.1f} s")
    legend_below(figure, over_time[0], 5, keys(scene, outline, views) | (TARGET_KEYS if last is not None else {}))
    return figure


def _last(done: Track) -> TargetEstimate | None:
    """The last estimate whose mean is near the body and whose ellipsoid is smaller than the body, or None."""
    box, size = widened(body_box(done), AROUND), body_size(done)
    near = [e for e in done.estimates(FILTER) if e.cov is not None and not outside(e.mean[None], box)[0]]
    return next((e for e in reversed(near) if e.cov is not None and _fits(e.cov, 0.5 * size)), None)


def _near_target(done: Track, ax: Axes, view: View, last: TargetEstimate | None) -> None:
    """Draw the paths of the truth and of the filter near the body, seen from one side."""
    means = within(np.array([e.mean for e in done.estimates(FILTER)]), widened(body_box(done), AROUND))
    truth = done.truth[np.isfinite(done.truth).all(axis=1)]
    paths = {OURS: view.seen_mm(means), TRUE: view.seen_mm(truth)}
    drawn = np.vstack([*paths.values(), *([] if last is None else [view.seen_mm(last.mean)[None]])])
    radius_mm = 1e3 * done.recording.scene.target.radius_m
    if len(drawn):
        low, high = drawn.min(axis=0), drawn.max(axis=0)
        close_up(ax, 0.5 * (low + high), 0.55 * float((high - low).max()) + 1.1 * radius_mm)
    for colour, path in paths.items():
        ax.plot(*path[:: -(-len(path) // N_DRAWN) or 1].T, color=colour, lw=0.5, zorder=4)


def _whole(done: Track, ax: Axes) -> None:
    """Draw the network or a frame of the film, and the paths."""
    means, papers = means_mm(done, FILTER), means_mm(done, OPEN_LOOP)
    ax.set_aspect("equal")
    filmed = _film(done, ax)
    if not filmed:
        body = 1e3 * body_box(done)
        around = widened(body, AROUND)
        points = np.vstack([body, within(means, around), within(papers, around)])
        (left, low), (right, high) = widened(np.array([points.min(axis=0), points.max(axis=0)]), 0.08)
        ax.set(xlim=(left, right), ylim=(low, high))
    _network(done, ax, lines=not filmed)
    _paths(done, ax, thick=0.7)


def _close(done: Track, ax: Axes) -> tuple[int, int]:
    """Draw a close-up of the paths with ellipses; returns how many are drawn, and how many are omitted as too large."""
    means, truth = means_mm(done, FILTER), 1e3 * done.truth
    known = truth[np.isfinite(truth).all(axis=1)]
    body = 1e3 * body_box(done)
    errors = np.linalg.norm(means - truth, axis=1)
    usual = ~(errors > FAR * np.nanmedian(errors)) if len(known) else np.full(len(means), True)
    near = np.vstack([within(means[usual], widened(body, AROUND)), known])
    points = near if len(near) else body
    middle, reach = 0.5 * (points.min(axis=0) + points.max(axis=0)), 0.6 * max(1.0, float(np.ptp(points, axis=0).max()))
    ax.set_aspect("equal")
    ax.set(xlim=(middle[0] - reach, middle[0] + reach), ylim=(middle[1] - reach, middle[1] + reach))
    _paths(done, ax, thick=1.0)
    return _ellipses(done, ax, reach)


def _paths(done: Track, ax: Axes, thick: float) -> None:
    """Draw the paths of filter, truth and open loop. Estimates outside are counted; those of the filter are marked."""
    means, papers, times = means_mm(done, FILTER), means_mm(done, OPEN_LOOP), done.times_s
    truth = 1e3 * done.truth
    shown = slice(None, None, -(-len(means) // N_DRAWN))
    box = np.array([ax.get_xlim(), ax.get_ylim()]).T
    n_gone, n = int(outside(papers, box).sum()), len(papers)
    gone = f" (outside: {n_gone} of {n} frames)" if n_gone else ""
    points = means[shown]
    path = LineCollection(
        list(np.stack([points[:-1], points[1:]], axis=1)), cmap=TIME_MAP, norm=_of_time(done), lw=thick, zorder=3
    )
    path.set_array(times[shown][:-1])
    ax.add_collection(path, autolim=False)
    ax.plot([], [], color=OURS_IN_TIME, lw=1.2, label="filter, coloured by time")
    ax.plot(*papers[shown].T, color=PAPERS, lw=0.5 * thick, alpha=0.5, zorder=1.5, label=f"paper's open loop{gone}")
    if np.isfinite(truth).any():
        ax.plot(*truth[shown].T, color=TRUE, lw=0.5 * thick, zorder=2.5, label="truth")
    away = means[outside(means, box)]
    if len(away):
        edge = np.clip(away[:: -(-len(away) // N_DRAWN)], *widened(box, -0.01))
        label = f"filter outside: {len(away)} of {len(means)} frames"
        ax.plot(*edge.T, "x", color=OURS, ms=3, mew=0.6, zorder=4, label=label)


def _of_time(done: Track) -> Normalize:
    return Normalize(float(done.times_s[0]), max(float(done.times_s[-1]), float(done.times_s[0]) + 1e-9))


def _ellipse_keys(done: Track) -> dict[str, Line2D]:
    """Legend entries by label: an ellipse, and a faint ellipse if any frame has one."""
    opacities = {"2-sigma ellipse": 0.9}
    if any(e.status in MISSED for e in done.estimates(FILTER)):
        opacities["coasting, lost or diverged"] = FAINT
    return {
        label: Line2D([], [], marker="o", ls="none", mfc="none", mec=OURS_IN_TIME, mew=0.6, ms=5, alpha=alpha)
        for label, alpha in opacities.items()
    }


def _ellipses(done: Track, ax: Axes, reach: float) -> tuple[int, int]:
    """Draw 2-sigma ellipses of some frames, see `FAINT`; returns how many are drawn, and omitted as too large."""
    estimates, norm, colours = done.estimates(FILTER), _of_time(done), colormaps[TIME_MAP]
    chosen = np.linspace(0, len(estimates) - 1, min(N_ELLIPSES, len(estimates))).astype(int)
    covs = {k: 1e6 * cov for k in chosen if (cov := estimates[k].cov) is not None}
    drawn = [k for k, cov in covs.items() if _fits(cov, reach)]
    for k in drawn:
        alpha, colour = FAINT if estimates[k].status in MISSED else 0.9, colours(norm(estimates[k].time_s))
        mean_mm = 1e3 * estimates[k].mean
        ax.add_patch(ellipse(mean_mm, covs[k], 2.0, ec=colour, fc="none", lw=0.6, alpha=alpha, zorder=3))
    return len(drawn), len(covs) - len(drawn)


def _film(done: Track, ax: Axes) -> bool:
    """Draw the film's first frame around the network; False without a film, or if its axes are not the plot's."""
    cameras = done.recording.scene.cameras
    if not cameras or done.recording.marks is not None:
        return False
    camera = cameras[0]
    if not np.allclose(camera.plane_to_px[[0, 1, 2, 2], [1, 0, 0, 1]], 0.0):
        return False
    with done.recording.open_frames() as frames:
        image = next(iter(frames)).image[..., ::-1]
    width, height = camera.size_px
    (left, top), (right, bottom) = camera.to_plane(np.array([[-0.5, -0.5], [width - 0.5, height - 0.5]])) * 1e3
    ax.imshow(image, extent=(left, right, bottom, top), origin="upper", alpha=0.7)
    nodes = 1e3 * done.recording.scene.network.positions
    (west, low), (east, high) = widened(np.array([nodes.min(axis=0), nodes.max(axis=0)]), AROUND)
    ax.set(xlim=(max(west, left), min(east, right)), ylim=(max(low, bottom), min(high, top)))
    return True


def _network(done: Track, ax: Axes, *, lines: bool) -> None:
    """Draw the names of the nodes at their positions in the scene; if `lines` is true, also draw springs and nodes."""
    scene = done.recording.scene
    network = scene.network
    x = 1e3 * network.positions
    if lines:
        ax.add_collection(LineCollection(list(x[network.springs]), colors="0.8", linewidths=0.5), autolim=False)
        ax.plot(*x[~network.fixed].T, "o", color="0.5", ms=2.5, zorder=1.2)
        ax.plot(*x[network.fixed].T, "s", color="0.3", ms=2.5, zorder=1.2)
    meant = {*scene.measured_nodes, scene.target.node}
    for name, place in zip(network.names, x, strict=True):
        if name in meant or len(x) <= MOST_NAMES:
            target = name == scene.target.node
            words = ax.annotate(name, place, (3, -8) if target else (3, 3), textcoords="offset points", zorder=5)
            words.set(fontsize=SMALL_PT, color=OURS if target else "0.25", path_effects=HALO, annotation_clip=True)


def _fits(cov: Floats, reach: float) -> bool:
    """Whether a covariance, (dim, dim), is finite and its 2-sigma ellipsoid has semi-axes of at most `2 * reach`."""
    return bool(np.isfinite(cov).all() and 2.0 * np.sqrt(np.linalg.eigvalsh(cov)[-1].clip(0.0)) <= 2.0 * reach)
