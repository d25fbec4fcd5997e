"""Picture of a scene's check: the network as drawn and at rest, names, marks, anchors, target, what marks tell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import hsv_to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from experiments.arrays import Floats
from experiments.formats.estimate_rows import AXES
from experiments.plots.style import BLUE, GREY, HALO, PAGE_MM, SMALL_PT, VERMILLION, grid_figure, legend_below, styled
from experiments.projects.check import SceneCheck

MANY = 30
"""Most nodes of a body whose unmarked nodes are labelled: more labels would be illegible."""

N_BARS = 20
"""Most marks whose share is drawn."""

LEAST_BARS = 6
"""Least number of bars for which the axis has room, so that a single bar is not too wide."""

MARGIN = 0.12

HIDES = 0.02
"""Least distance of a labelled node from the labelled ones before it, by the size of the plot [1]."""

TURNED, RAISED = np.radians(35.0), np.radians(25.0)
"""Direction of the oblique view of a body in space: to the right of z, and from above."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A viewing direction: across (2, dim), the axes of the plot; toward (dim,), towards the viewer."""

    across: Floats
    toward: Floats
    labels: tuple[str, str]


def _views(dim: int) -> list[View]:
    labels = (f"{AXES[0]} [mm]", f"{AXES[1]} [mm]")
    if dim == 2:
        return [View(np.eye(2), np.zeros(2), labels)]
    right = np.array([np.cos(TURNED), 0.0, -np.sin(TURNED)])
    toward = np.array([np.sin(TURNED) * np.cos(RAISED), np.sin(RAISED), np.cos(TURNED) * np.cos(RAISED)])
    oblique = np.stack([right, np.cross(toward, right)])
    return [View(np.eye(3)[:2], np.eye(3)[2], labels), View(oblique, toward, ("obliquely from above [mm]", "up [mm]"))]


@styled
def check_figure(done: SceneCheck) -> Figure:
    """The network from the front, in space also obliquely, and the share of information by mark."""
    views = _views(done.scene.network.dim)
    widths = [3.0] * len(views) + [1.6]
    figure, axes = grid_figure(PAGE_MM, 75.0 if len(views) > 1 else 105.0, ncols=len(widths), width_ratios=widths)
    *bodies, shares = axes[0]
    for ax, view in zip(bodies, views, strict=True):
        _network(ax, done, view)
    bodies[0].set_title(_title(done))
    _shares(shares, done)
    legend_below(figure, bodies[0], 7)
    return figure


def _title(done: SceneCheck) -> str:
    worst = int(done.offsets_m.argmax())
    name = done.scene.network.names[worst]
    return f"as drawn and at rest, largest difference {1e3 * done.offsets_m[worst]:.1f} mm ({name})"


def _network(ax: Axes, done: SceneCheck, view: View) -> None:
    scene, network = done.scene, done.scene.network
    at, rest = 1e3 * network.positions @ view.across.T, 1e3 * done.rest @ view.across.T
    ax.add_collection(LineCollection(list(at[network.springs]), colors=GREY, linewidths=0.8, label="as drawn"))
    ax.add_collection(
        LineCollection(list(rest[network.springs]), colors=VERMILLION, linewidths=0.8, linestyles="--", label="at rest")
    )
    fixed = network.fixed
    if fixed.any():
        ax.plot(*at[fixed].T, "s", color="0.25", ms=4, ls="", label="anchors")
    ax.plot(*at[~fixed].T, "o", color="0.45", ms=2, ls="")
    ax.plot(*rest[~fixed].T, ".", color=VERMILLION, ms=2.5, ls="")
    for measured, style in ((True, {"mec": "0.2", "mew": 0.6}), (False, {"mfc": "none", "mew": 1.3})):
        marks = [mark for mark in scene.marks if mark.measured is measured]
        label = "marks" if measured else "marks for scoring only"
        for k, mark in enumerate(marks):
            colour = hsv_to_rgb((mark.hue_deg / 360.0, 0.9, 0.85))
            (line,) = ax.plot(*at[network.index(mark.node)], "o", ms=5.5, ls="", label=label if k == 0 else None)
            line.set(**style, **({"mfc": colour} if measured else {"mec": colour}))
    _target(ax, done, at, view)
    _names(ax, done, at, view)
    # both shapes are in the plot, with equal scales: a large sag is visible
    both = np.vstack([at, rest])
    middle = 0.5 * (both.min(axis=0) + both.max(axis=0))
    reach = (0.5 + MARGIN) * float(np.ptp(both, axis=0).max())
    ax.set(xlim=(middle[0] - reach, middle[0] + reach), ylim=(middle[1] - reach, middle[1] + reach))
    ax.set(xlabel=view.labels[0], ylabel=view.labels[1], aspect="equal")


def _target(ax: Axes, done: SceneCheck, at: Floats, view: View) -> None:
    target = done.scene.target
    offset = 1e3 * np.array(target.offset_m or np.zeros(done.scene.network.dim)) @ view.across.T
    middle = at[done.scene.network.index(target.node)] + offset
    ax.add_patch(Circle((middle[0], middle[1]), 1e3 * target.radius_m, fc=BLUE, ec="none", alpha=0.4))
    ax.plot(*middle, "+", color=BLUE, ms=9, mew=1.0, ls="", label=f"target {target.node}")


def _names(ax: Axes, done: SceneCheck, at: Floats, view: View) -> None:
    network = done.scene.network
    marked = {mark.node for mark in done.scene.marks}
    near = HIDES * float(np.ptp(at, axis=0).max())
    named: list[Floats] = []
    for i in np.argsort(-(network.positions @ view.toward), kind="stable"):
        if all(np.linalg.norm(at[i] - place) > near for place in named):
            named.append(at[i])
            if network.n_nodes <= MANY or network.names[i] in marked:
                words = ax.annotate(network.names[i], at[i], xytext=(3, 3), textcoords="offset points")
                words.set(fontsize=SMALL_PT, path_effects=HALO)


def _shares(ax: Axes, done: SceneCheck) -> None:
    shown = list(done.shares.items())[:N_BARS][::-1]
    hues = {mark.node: mark.hue_deg for mark in done.scene.marks}
    colours = [hsv_to_rgb((hues[node] / 360.0, 0.6, 0.9)) for node, _ in shown]
    ax.barh([node for node, _ in shown], [100.0 * share for _, share in shown], color=colours, ec="0.3", lw=0.4)
    ax.set_xlabel("share of information [%]")
    ax.set_ylim(min(-1.0, len(shown) - LEAST_BARS), len(shown))
    ax.set_title("information by mark")
