"""Plot of a plan: the tissue, obstacles, the best path and the needle's push on the target.

The best path is blue, the next best are pale blue, rejected paths and obstacles vermillion, the lesion purple.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from itertools import combinations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle
from matplotlib.transforms import Bbox
from scipy.spatial import ConvexHull
from scipy.stats import chi2

from dynamics import rest_shape
from estimators import Obstacle
from experiments.arrays import Floats
from experiments.formats.estimate_rows import AXES
from experiments.formats.scene.outside import outside_of
from experiments.pipeline.plan import Planned, next_best
from experiments.plots.space import FLAT, N_FACES, View, draw_body, keys, scale_bar, two_views
from experiments.plots.style import (
    BLUE,
    PAGE_MM,
    PURPLE,
    SKY,
    SMALL_PT,
    TEXT_PT,
    VERMILLION,
    ellipse,
    legend_below,
    new_figure,
    styled,
)

BEST, NEXT, FORBIDDEN, LESION = BLUE, SKY, VERMILLION, PURPLE
FILLS = {"rib": "#e9e2cf", "vessel": "#d98880", "other": "#c9c9c9"}
TISSUE, SKIN = "#f8ece4", "#b98b6b"
ROUND = float(np.sqrt(chi2.ppf(0.95, 2)))
"""Semi-axis of the 95 % ellipse of a Gaussian in the plane, in standard deviations."""

ROOM_MM = 76.0
"""Side in print of the square that the axes of a body in space fill [mm]."""


def _xy(place: Floats) -> tuple[float, float]:
    return float(place[0]), float(place[1])


@styled
def plan_figure(done: Planned) -> Figure:
    """The tissue with needle paths, a close-up of the lesion and a table of paths. In space there are two views."""
    return _in_plane(done) if done.scene.network.dim == 2 else _in_space(done)


def _in_plane(done: Planned) -> Figure:
    figure = new_figure(PAGE_MM, 105.0)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.55, 1.0), height_ratios=(1.0, 1.0))
    whole, close = figure.add_subplot(grid[:, 0]), figure.add_subplot(grid[0, 1])
    for ax in (whole, close):
        ax.set_aspect("equal")
        ax.set(xlabel="x [mm]", ylabel="y [mm]")
    chosen = next_best(done.plan)
    _tissue(done, whole)
    _sides(done, FLAT, whole, close, chosen)
    _frame(done, whole)
    whole.set_title(f"Needle paths to {done.scene.target.node}", fontweight="bold")
    legend_below(figure, (whole, close), 4)
    _words(done, figure.add_subplot(grid[1, 1]), chosen)
    return figure


def _in_space(done: Planned) -> Figure:
    scene, chosen = done.scene, next_best(done.plan)
    figure = new_figure(PAGE_MM, 152.0)
    rows = figure.add_gridspec(2, 1, height_ratios=(1.6, 1.0))
    above, below = rows[0].subgridspec(1, 2), rows[1].subgridspec(1, 3, width_ratios=(1.0, 1.0, 2.0))
    wholes = [figure.add_subplot(above[k]) for k in range(2)]
    *closes, words = (figure.add_subplot(below[k]) for k in range(3))
    views, outline = two_views(scene), outside_of(scene, N_FACES)
    for view, whole, close in zip(views, wholes, closes, strict=True):
        draw_body(whole, view, scene, outline, ROOM_MM, done.plan.entries, done.plan.tips)
        box = np.array([done.task.skin.start, done.task.skin.end])
        corners = np.unique([[box[k, axis] for axis, k in enumerate(ends)] for ends in np.ndindex(2, 2, 2)], axis=0)
        edges = [pair for pair in combinations(corners, 2) if np.count_nonzero(pair[0] != pair[1]) == 1]
        lines = view.seen_mm(np.array(edges)) if edges else np.empty((0, 2, 2))
        whole.add_collection(LineCollection(list(lines), colors=SKIN, lw=1.2, label="entry allowed"), autolim=False)
        limits = whole.axis()
        _sides(done, view, whole, close, chosen)
        whole.axis(limits)
        close.set(aspect="equal", xticks=[], yticks=[])
        if close is not closes[0]:
            close.set_title("")
        close.spines[:].set(visible=True, color="0.6")
        scale_bar(close, float(np.ptp(close.get_xlim())))
    wholes[0].set_title(f"Needle paths to {scene.target.node}, from two sides", fontweight="bold")
    entries = [ax.get_legend_handles_labels() for ax in (wholes[0], closes[0])]
    shown = {label: handle for handles, labels in entries for handle, label in zip(handles, labels, strict=True)}
    shown |= keys(scene, outline, views)
    legend_below(figure, (), 4, shown)
    _words(done, words, chosen)
    return figure


def _sides(done: Planned, view: View, whole: Axes, close: Axes, chosen: list[int]) -> None:
    """Draw paths, obstacles and the lesion from one side: the whole body and a close-up."""
    _paths(done, view, whole, chosen)
    for ax in (whole, close):
        for one, kind in zip(done.task.obstacles, done.task.kinds, strict=True):
            _obstacle(ax, view, one, FILLS[kind], _path_x(done, view, chosen) if ax is whole else None)
        _lesion(done, view, ax, chosen, close=ax is close)


def _tissue(done: Planned, ax: Axes) -> None:
    network = done.scene.network
    x = 1e3 * rest_shape(network)[:, :2]
    if np.linalg.matrix_rank(x - x.mean(axis=0)) == 2:
        hull = x[ConvexHull(x).vertices]
        ax.add_patch(Polygon(hull, fc=TISSUE, ec=SKIN, lw=1.2, zorder=0, label="tissue at rest"))
    ax.add_collection(LineCollection(list(x[network.springs]), colors="0.82", linewidths=0.8, zorder=1))
    fixed = network.fixed
    ax.plot(*x[~fixed].T, "o", color="0.55", ms=4, ls="none", zorder=2)
    ax.plot(*x[fixed].T, "s", color="0.35", ms=4, ls="none", zorder=2)
    for name, place in zip(network.names, x, strict=True):
        if name != done.scene.target.node:
            ax.annotate(name, _xy(place), (4, 4), textcoords="offset points", color="0.35", fontsize=SMALL_PT, zorder=2)
    ends = 1e3 * np.array([done.task.skin.start[:2], done.task.skin.end[:2]])
    ax.plot(*ends.T, color=SKIN, lw=5, alpha=0.55, solid_capstyle="round", zorder=1, label="entry allowed")


def _obstacle(ax: Axes, view: View, one: Obstacle, fill: str, path_x: Callable[[float], float] | None) -> None:
    ends = view.seen_mm(np.array([one.start, one.end]))
    outline = _capsule(ends, 1e3 * one.radius_m)
    if one.margin_m > 0.0:
        margin = _capsule(ends, 1e3 * (one.radius_m + one.margin_m))
        ax.add_patch(Polygon(margin, fc="none", ec=FORBIDDEN, lw=0.9, ls=(0, (3, 2)), zorder=4))
    ax.add_patch(Polygon(outline, fc=fill, ec="0.35", lw=1.0, zorder=4))
    if path_x is not None:
        middle, reach = ends.mean(axis=0), 1e3 * (one.radius_m + one.margin_m)
        right = middle[0] >= path_x(middle[1])
        side = max(ends[:, 0]) + reach if right else min(ends[:, 0]) - reach
        at = float(side), float(middle[1])
        beside, ha = (5, "left") if right else (-5, "right")
        paper = {"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.85}
        words = ax.annotate(one.name, at, (beside, 0), textcoords="offset points", va="center", bbox=paper)
        words.set(ha=ha, fontsize=SMALL_PT, zorder=7)


def _path_x(done: Planned, view: View, chosen: list[int]) -> Callable[[float], float]:
    """Function from height to horizontal position in the view [mm], of the best path; without paths, of the lesion."""
    found = done.plan
    tip, entry = (
        view.seen_mm(np.stack([found.tips[chosen[0]], found.entries[chosen[0]]])) if chosen else np.zeros((2, 2))
    )
    if abs(entry[1] - tip[1]) < 1e-3:
        middle = float(view.seen_mm(done.lesion.mean)[0])
        return lambda _height: middle
    return lambda height: float(tip[0] + (height - tip[1]) * (entry[0] - tip[0]) / (entry[1] - tip[1]))


def _capsule(ends: Floats, radius: float) -> Floats:
    """The outline, (n, 2), of a capsule in the plane whose axis has these ends, (2, 2)."""
    start, end = ends
    along = end - start
    turn = np.arctan2(along[1], along[0])
    half = np.linspace(-np.pi / 2, np.pi / 2, 40)
    caps = [
        place + radius * np.stack([np.cos(half + turn + add), np.sin(half + turn + add)], axis=1)
        for place, add in ((end, 0.0), (start, np.pi))
    ]
    return np.vstack(caps)


def _paths(done: Planned, view: View, ax: Axes, chosen: list[int]) -> None:
    """Draw the path of highest hit probability from each entry; the best and the next best paths have thicker lines."""
    found, n_aims = done.plan, done.task.n_aims
    shown = [
        min(range(i, i + n_aims), key=lambda k: (bool(found.reasons[k]), -found.hits[k]))
        for i in range(0, len(found.hits), n_aims)
    ]
    labelled = set()
    for k in shown[:: max(1, len(shown) // 50)]:
        bad = bool(found.reasons[k])
        label = "forbidden" if bad else "possible"
        color, alpha = (FORBIDDEN, 0.28) if bad else (NEXT, 0.35)
        ends = view.seen_mm(np.array([found.entries[k], found.tips[k]]))
        ax.plot(*ends.T, lw=0.8, zorder=3, color=color, alpha=alpha, label=None if label in labelled else label)
        labelled.add(label)
    for rank, k in reversed(list(enumerate(chosen))):
        ends = view.seen_mm(np.array([found.entries[k], found.tips[k]]))
        best = rank == 0
        name = "best path" if best else ("next best" if rank == 1 else None)
        color, width = (BEST, 2.8) if best else (NEXT, 1.8)
        ax.plot(*ends.T, solid_capstyle="round", label=name, color=color, lw=width, zorder=6 if best else 5)
        if best and view is FLAT:
            above = ends[0] - ends[1]
            offset = _xy(14.0 * (above / max(1e-9, float(np.linalg.norm(above)))) + [0.0, 4.0])
            depth, arrow = f"{1e3 * found.lengths[k]:.0f} mm deep", {"arrowstyle": "-|>", "color": BEST, "lw": 1.5}
            text = f"enter at ({_place(found.entries[k])}) mm\n{depth}\nhit {found.hits[k]:.0%}"
            paper = {"boxstyle": "round,pad=0.25", "fc": "white", "ec": BEST, "alpha": 0.95}
            words = ax.annotate(text, _xy(ends[0]), offset, textcoords="offset points", arrowprops=arrow, bbox=paper)
            words.set(ha="center", va="bottom", color=BEST, fontweight="bold", fontsize=SMALL_PT, zorder=8)


def _lesion(done: Planned, view: View, ax: Axes, chosen: list[int], *, close: bool) -> None:
    lesion, found = done.lesion, done.plan
    mean, radius = view.seen_mm(lesion.mean), 1e3 * lesion.radius_m
    label = "lesion at arrival" if close else "lesion and its 95 % region"
    if not chosen:
        alone = "lesion" if close else label
        ax.add_patch(Circle(_xy(mean), radius, fc=LESION, ec=LESION, alpha=0.55, zorder=6, label=alone))
        ax.add_patch(ellipse(mean, view.seen_cov_mm2(lesion.cov), ROUND, fc="none", ec=LESION, lw=1.4, zorder=6))
    else:
        k = chosen[0]
        there = view.seen_mm(found.means[k])
        forces = done.task.needle.force_sd**2 * np.outer(found.pushed[k], found.pushed[k])
        region = view.seen_cov_mm2(lesion.cov + forces)
        centre = "95 % region of its centre" if close else None
        before = "lesion before insertion" if close else None
        ax.add_patch(Circle(_xy(mean), radius, fc="none", ec=LESION, ls=(0, (2, 2)), lw=1.2, zorder=6, label=before))
        ax.add_patch(Circle(_xy(there), radius, fc=LESION, ec=LESION, alpha=0.5, zorder=6, label=label))
        ax.add_patch(ellipse(there, region, ROUND, fc="none", ec=LESION, lw=1.4, zorder=6, label=centre))
        if close:
            _aimed(done, view, ax, k)
    if close:
        _close_up(done, view, ax, chosen)


def _aimed(done: Planned, view: View, ax: Axes, k: int) -> None:
    found = done.plan
    mean, there = view.seen_mm(np.stack([done.lesion.mean, found.means[k]]))
    ends = view.seen_mm(np.array([found.entries[k], found.tips[k]]))
    ax.plot(*ends.T, color=BEST, lw=2.8, zorder=5)
    ax.plot(*ends[1], marker="o", ms=5, mfc="white", mec=BEST, mew=1.8, zorder=8)
    arrow = {"arrowstyle": "-|>", "color": "black", "lw": 1.6, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", _xy(there), _xy(mean), zorder=9, arrowprops=arrow)


def _close_up(done: Planned, view: View, ax: Axes, chosen: list[int]) -> None:
    lesion, found = done.lesion, done.plan
    places, cov, title = [view.seen_mm(lesion.mean)], lesion.cov, "at the lesion: no path is allowed"
    if chosen:
        k = chosen[0]
        places.append(view.seen_mm(found.means[k]))
        cov = found.covs[k]
        title = f"at the lesion, pushed by {1e3 * float(np.linalg.norm(found.pushed[k])):.1f} mm (arrow)"
    widest = 1e3 * ROUND * np.sqrt(float(np.linalg.eigvalsh(cov)[-1]))
    middle = np.mean(places, axis=0)
    reach = 1.15 * (max(1e3 * lesion.radius_m, widest) + 0.5 * float(np.linalg.norm(np.ptp(places, axis=0))))
    ax.set(xlim=(middle[0] - 1.9 * reach, middle[0] + 1.9 * reach), ylim=(middle[1] - 1.5 * reach, middle[1] + reach))
    ax.set_title(title)


def _frame(done: Planned, ax: Axes) -> None:
    """Limit the axes to entries, lesion and obstacles; an inset shows the place of this section in the tissue."""
    found, network = done.plan, done.scene.network
    ends = [place for one in done.task.obstacles for place in (one.start[:2], one.end[:2])]
    x = 1e3 * np.vstack([found.entries[:, :2], found.tips[:, :2], *(end[None] for end in ends)])
    room = 0.25 * float(np.ptp(x, axis=0).max())
    low = x.min(axis=0) - np.array([0.6, 1.5]) * room
    high = x.max(axis=0) + np.array([0.6, 1.1]) * room
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    corner = ax.inset_axes((0.77, 0.01, 0.22, 0.22), zorder=9)
    nodes = 1e3 * rest_shape(network)[:, :2]
    if np.linalg.matrix_rank(nodes - nodes.mean(axis=0)) == 2:
        corner.add_patch(Polygon(nodes[ConvexHull(nodes).vertices], fc=TISSUE, ec=SKIN, lw=1.0))
    corner.plot(*nodes.T, ".", color="0.55", ms=3)
    corner.add_patch(Rectangle(_xy(low), *(high - low), fc="none", ec="0.2", lw=0.9))
    corner.set(xticks=[], yticks=[], aspect="equal", xmargin=0.12, ymargin=0.12)
    corner.set_title("in the tissue", fontsize=SMALL_PT, pad=2)
    corner.autoscale_view()


def _words(done: Planned, ax: Axes, chosen: list[int]) -> None:
    found = done.plan
    ax.axis("off")
    n, allowed = len(found.hits), int(found.allowed.sum())
    head, color = "No path is allowed", FORBIDDEN
    if chosen:
        head, color = f"Best path: hit probability {found.hits[chosen[0]]:.0%}", BEST
    ax.text(0.0, 1.0, head, fontsize=TEXT_PT, fontweight="bold", color=color, va="top", transform=ax.transAxes)
    lines = [f"{allowed} of {n} paths allowed; target estimate: {done.estimate}"]
    lines += [f"    {count} against {one}" for one, count in _rejections(done)]
    text = "\n".join(lines[:6])
    ax.text(0.0, 0.89, text, va="top", transform=ax.transAxes, color="0.25", linespacing=1.2, fontsize=SMALL_PT)
    if chosen:
        rows = [
            [
                "best" if rank == 0 else f"{rank + 1}",
                _place(found.entries[k]),
                f"{1e3 * found.lengths[k]:.0f}",
                f"{np.degrees(found.angles[k]):.0f}°",
                f"{found.hits[k]:.0%}",
                "–" if not np.isfinite(found.clearance[k]) else f"{1e3 * found.clearance[k]:.1f}",
            ]
            for rank, k in enumerate(chosen)
        ]
        heads = ["mm", f"entry {', '.join(AXES[: done.scene.network.dim])}", "depth", "angle", "hit", "room"]
        shown = ax.table(
            rows, colLabels=heads, bbox=Bbox.from_bounds(0.0, 0.0, 1.0, 0.43), cellLoc="center", edges="horizontal"
        )
        shown.auto_set_font_size(False)
        shown.set_fontsize(SMALL_PT)
        for column in range(len(heads)):
            shown[1, column].get_text().set_color(BEST)
            shown[1, column].get_text().set_fontweight("bold")


def _place(entry: Floats) -> str:
    return ", ".join(f"{1e3 * x:.0f}" for x in entry)


def _rejections(done: Planned) -> list[tuple[str, int]]:
    counts = Counter(reason for reasons in done.plan.reasons for reason in reasons)
    words = {"too long": "the longest depth", "too steep": "the angle to the skin", "outside the entry": "the entry"}
    return [(words.get(name, name), n) for name, n in counts.most_common()]
