"""Picture of a scene's check: the network as drawn and at rest, names, marks, anchors, target, what marks tell."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import hsv_to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from experiments.arrays import Floats
from experiments.formats.estimate_rows import AXES
from experiments.projects.check import SceneCheck

DRAWN, RESTS, TARGET = "0.6", "#d62728", "#1f6fb4"
MANY = 30
"""More nodes than these have smaller names."""

N_BARS = 20
"""Marks whose share is drawn."""

LEAST_BARS = 6
"""A picture has room for so many, so that one alone is no wall."""

MARGIN = 0.12

HIDES = 0.02
"""A node that is drawn nearer than this to one before it has no name there, by the size of the picture [1]."""

TURNED, RAISED = np.radians(35.0), np.radians(25.0)
"""From where the oblique view of a body in space looks: to the right of z, and from above."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """From where a body is seen: across (2, dim), the axes of the picture; toward (dim,), whom it is seen by."""

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
    return [View(np.eye(3)[:2], np.eye(3)[2], labels), View(oblique, toward, ("obliquely from above [mm]", "[mm]"))]


def write_check_picture(done: SceneCheck, folder: Path) -> None:
    """Draw check.png into a folder that exists."""
    check_figure(done).savefig(folder / "check.png", dpi=130)


def check_figure(done: SceneCheck) -> Figure:
    """The network from the front, in space obliquely, too, and the share of information by mark."""
    views = _views(done.scene.network.dim)
    with mpl.rc_context({"font.size": 9}):
        figure = Figure(figsize=(5.5 * len(views) + 3.5, 5.6), layout="constrained")
        axes = figure.subplots(1, len(views) + 1, width_ratios=[5.5] * len(views) + [3.0])
    for ax, view in zip(axes[:-1], views, strict=True):
        _network(ax, done, view)
    axes[0].set_title(_title(done), loc="left", fontsize=9)
    _shares(axes[-1], done)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    return figure


def _title(done: SceneCheck) -> str:
    worst = int(done.offsets_m.argmax())
    name = done.scene.network.names[worst]
    return f"as drawn and at rest, {1e3 * done.offsets_m[worst]:.1f} mm apart at most ({name})"


def _network(ax: Axes, done: SceneCheck, view: View) -> None:
    scene, network = done.scene, done.scene.network
    at, rest = 1e3 * network.positions @ view.across.T, 1e3 * done.rest @ view.across.T
    ax.add_collection(LineCollection(list(at[network.springs]), colors=DRAWN, linewidths=0.8, label="as drawn"))
    ax.add_collection(
        LineCollection(list(rest[network.springs]), colors=RESTS, linewidths=0.8, linestyles="--", label="at rest")
    )
    fixed = network.fixed
    if fixed.any():
        ax.plot(*at[fixed].T, "s", color="0.25", ms=6, ls="", label="anchors")
    ax.plot(*at[~fixed].T, "o", color="0.45", ms=3, ls="")
    ax.plot(*rest[~fixed].T, ".", color=RESTS, ms=4, ls="")
    for measured, style in ((True, {"mec": "0.2"}), (False, {"mfc": "none", "mew": 1.8})):
        marks = [mark for mark in scene.marks if mark.measured is measured]
        label = "marks" if measured else "marks for scoring only"
        for k, mark in enumerate(marks):
            colour = hsv_to_rgb((mark.hue_deg / 360.0, 0.9, 0.85))
            colours = {"mfc": colour} if measured else {"mec": colour}
            ax.plot(
                *at[network.index(mark.node)], "o", ms=9, ls="", label=label if k == 0 else None, **(style | colours)
            )
    _target(ax, done, at, view)
    _names(ax, done, at, view)
    # both shapes are in the picture, which is as wide as high: a body that sags far is seen to
    both = np.vstack([at, rest])
    middle = 0.5 * (both.min(axis=0) + both.max(axis=0))
    reach = (0.5 + MARGIN) * float(np.ptp(both, axis=0).max())
    ax.set(xlim=(middle[0] - reach, middle[0] + reach), ylim=(middle[1] - reach, middle[1] + reach))
    ax.set(xlabel=view.labels[0], ylabel=view.labels[1], aspect="equal")
    ax.spines[["top", "right"]].set_visible(False)


def _target(ax: Axes, done: SceneCheck, at: Floats, view: View) -> None:
    target = done.scene.target
    offset = 1e3 * np.array(target.offset_m or np.zeros(done.scene.network.dim)) @ view.across.T
    middle = at[done.scene.network.index(target.node)] + offset
    ax.add_patch(Circle((middle[0], middle[1]), 1e3 * target.radius_m, fc=TARGET, ec="none", alpha=0.4))
    ax.plot(*middle, "+", color=TARGET, ms=14, mew=1.5, ls="", label=f"target {target.node}")


def _names(ax: Axes, done: SceneCheck, at: Floats, view: View) -> None:
    network = done.scene.network
    small = network.n_nodes > MANY
    near = HIDES * float(np.ptp(at, axis=0).max())
    named: list[Floats] = []
    for i in np.argsort(-(network.positions @ view.toward), kind="stable"):
        if all(np.linalg.norm(at[i] - place) > near for place in named):
            named.append(at[i])
            ax.annotate(network.names[i], at[i], xytext=(6, 5), textcoords="offset points", fontsize=6 if small else 9)


def _shares(ax: Axes, done: SceneCheck) -> None:
    shown = list(done.shares.items())[:N_BARS][::-1]
    hues = {mark.node: mark.hue_deg for mark in done.scene.marks}
    colours = [hsv_to_rgb((hues[node] / 360.0, 0.6, 0.9)) for node, _ in shown]
    ax.barh([node for node, _ in shown], [100.0 * share for _, share in shown], color=colours, ec="0.3", lw=0.5)
    ax.set_xlabel("share of what a frame tells of the target [%]")
    ax.set_ylim(min(-1.0, len(shown) - LEAST_BARS), len(shown))
    ax.set_title("which marks carry the target", loc="left", fontsize=9)
    ax.spines[["top", "right"]].set_visible(False)
