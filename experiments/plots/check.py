"""Plot of a scene's check: the network with marks, anchors and target, and each mark's share of the information."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import hsv_to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon

from experiments.arrays import Floats
from experiments.formats.scene.outside import outside_of
from experiments.plots.space import N_FACES, TARGET_KEYS, draw_body, draw_springs, draw_target, keys, two_views
from experiments.plots.style import BLUE, GREY, HALO, PAGE_MM, SMALL_PT, VERMILLION, grid_figure, legend_below, styled
from experiments.projects.check import SceneCheck

MANY = 30
"""Largest number of nodes that are all labelled; in a larger network only nodes with marks are labelled."""

N_BARS = 20
"""Largest number of marks whose share of information is drawn."""

LEAST_BARS = 6
"""If there are fewer bars than this, the axis keeps room for this number of bars, so that the bars are not too wide."""

MARGIN = 0.12

SAME_MM = 0.05
"""If each node at rest is within this distance of its position in the scene [mm], the plot omits the shape at rest."""

VIEW_MM = 62.0
"""Width of a view of a body in space in print [mm]."""


@styled
def check_figure(done: SceneCheck) -> Figure:
    """The body as the scene states it and at rest, and bars for the marks' shares of information on the target."""
    return _in_plane(done) if done.scene.network.dim == 2 else _in_space(done)


def _in_plane(done: SceneCheck) -> Figure:
    figure, [[body, shares]] = grid_figure(PAGE_MM, 105.0, ncols=2, width_ratios=(3.0, 1.6))
    _network(body, done)
    body.set_title(_title(done))
    _shares(shares, done)
    legend_below(figure, body, 7)
    return figure


def _in_space(done: SceneCheck) -> Figure:
    scene, network = done.scene, done.scene.network
    figure, [[*bodies, shares]] = grid_figure(PAGE_MM, 82.0, ncols=3, width_ratios=(VIEW_MM, VIEW_MM, 30.0))
    views, outline = two_views(scene), outside_of(scene, N_FACES)
    target = done.rest[network.index(scene.target.node)] + np.array(scene.target.offset_m or np.zeros(3))
    shown = keys(scene, outline, views) | {"lesion": TARGET_KEYS["lesion"]}
    for ax, view in zip(bodies, views, strict=True):
        draw_body(ax, view, scene, outline, VIEW_MM, done.rest)
        draw_target(ax, view, target, scene.target.radius_m, None)
        if _moves(done):
            draw_springs(ax, view, done.rest, network.springs, VERMILLION)
            shown["springs at rest"] = Line2D([], [], color=VERMILLION, lw=0.8)
    bodies[0].set_title(_title(done))
    _shares(shares, done)
    legend_below(figure, (), 5, shown)
    return figure


def _moves(done: SceneCheck) -> bool:
    return bool(1e3 * done.offsets_m.max() > SAME_MM)


def _title(done: SceneCheck) -> str:
    if not _moves(done):
        return "rests as drawn"
    worst = int(done.offsets_m.argmax())
    name = done.scene.network.names[worst]
    return f"as drawn and at rest, largest difference {1e3 * done.offsets_m[worst]:.1f} mm ({name})"


def _network(ax: Axes, done: SceneCheck) -> None:
    scene, network = done.scene, done.scene.network
    at, rest = 1e3 * network.positions, 1e3 * done.rest
    ax.add_collection(LineCollection(list(at[network.springs]), colors=GREY, linewidths=0.8, label="as drawn"))
    if _moves(done):
        lines = LineCollection(list(rest[network.springs]), colors=VERMILLION, lw=0.8, ls="--", label="at rest")
        ax.add_collection(lines)
        ax.plot(*rest[~network.fixed].T, ".", color=VERMILLION, ms=2.5, ls="")
    fixed = network.fixed
    if fixed.any():
        ax.plot(*at[fixed].T, "s", color="0.25", ms=4, ls="", label="anchors")
    ax.plot(*at[~fixed].T, "o", color="0.45", ms=2, ls="")
    for measured, style in ((True, {"mec": "0.2", "mew": 0.6}), (False, {"mfc": "none", "mew": 1.3})):
        marks = [mark for mark in scene.marks if mark.measured is measured]
        label = "marks" if measured else "marks for scoring only"
        for k, mark in enumerate(marks):
            colour = hsv_to_rgb((mark.hue_deg / 360.0, 0.9, 0.85))
            (line,) = ax.plot(*at[network.index(mark.node)], "o", ms=5.5, ls="", label=label if k == 0 else None)
            line.set(**style, **({"mfc": colour} if measured else {"mec": colour}))
    _target(ax, done, at)
    _names(ax, done, at)
    # the plot contains all positions at equal scales, so that a large sag is visible
    both = np.vstack([at, rest])
    if scene.cameras and (view := scene.cameras[0].view_m) is not None:
        ax.add_patch(Polygon(1e3 * view, fc="none", ec="0.6", lw=0.8, ls=":", label="edge of the picture"))
        both = np.vstack([both, 1e3 * view])
    middle = 0.5 * (both.min(axis=0) + both.max(axis=0))
    reach = (0.5 + MARGIN) * float(np.ptp(both, axis=0).max())
    ax.set(xlim=(middle[0] - reach, middle[0] + reach), ylim=(middle[1] - reach, middle[1] + reach))
    ax.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")


def _target(ax: Axes, done: SceneCheck, at: Floats) -> None:
    target = done.scene.target
    offset = 1e3 * np.array(target.offset_m or np.zeros(2))
    middle = at[done.scene.network.index(target.node)] + offset
    ax.add_patch(Circle((middle[0], middle[1]), 1e3 * target.radius_m, fc=BLUE, ec="none", alpha=0.4))
    ax.plot(*middle, "+", color=BLUE, ms=9, mew=1.0, ls="", label=f"target {target.node}")


def _names(ax: Axes, done: SceneCheck, at: Floats) -> None:
    network = done.scene.network
    marked = {mark.node for mark in done.scene.marks}
    for name, place in zip(network.names, at, strict=True):
        if network.n_nodes <= MANY or name in marked:
            words = ax.annotate(name, place, xytext=(3, 3), textcoords="offset points")
            words.set(fontsize=SMALL_PT, path_effects=HALO)


def _shares(ax: Axes, done: SceneCheck) -> None:
    shown = list(done.shares.items())[:N_BARS][::-1]
    hues = {mark.node: mark.hue_deg for mark in done.scene.marks}
    colours = [hsv_to_rgb((hues[node] / 360.0, 0.6, 0.9)) for node, _ in shown]
    ax.barh([node for node, _ in shown], [100.0 * share for _, share in shown], color=colours, ec="0.3", lw=0.4)
    ax.set_xlabel("share of information [%]")
    ax.set_ylim(min(-1.0, len(shown) - LEAST_BARS), len(shown))
    omitted = f"\nlargest {N_BARS} of {len(done.shares)}" if len(done.shares) > N_BARS else ""
    ax.set_title(f"information by mark{omitted}")
