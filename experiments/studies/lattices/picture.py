"""Slices of the lattices, and their Young's modulus along six directions by each method."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from experiments.plots.style import (
    BLACK,
    GREY,
    OURS,
    PAGE_MM,
    PAPERS,
    PURPLE,
    VERMILLION,
    legend_below,
    new_figure,
    styled,
)
from experiments.studies.lattices.boxes import AXES, MATERIAL, PLANES, SIDE_M, lattice_by_seed
from experiments.studies.lattices.table import WORDS, YOUNG

SHOWN_SEED = 1000
"""Seed of the drawn lattices."""

COLORS = ("0.75", OURS, VERMILLION)
"""Colours of springs by tissue: first the surrounding tissue."""

PLACES = {"lobules": 0.35, "fibres": 0.375}
"""Position of the drawn plane along y by structure, relative to the side; 0.5 for others."""

STYLES: dict[str, dict[str, Any]] = {
    "van_gelder": {"color": PAPERS, "marker": "s"},
    "lloyd": {"color": PURPLE, "marker": "D"},
    "fitted": {"color": OURS, "marker": "o"},
}


@styled
def picture(means: pd.DataFrame, cells: int) -> Figure:
    """A column of plots for each structure: above, springs in a plane perpendicular to y; below, moduli."""
    figure = new_figure(PAGE_MM, 95.0)
    kinds = list(means.index.unique("structure"))
    axes = figure.subplots(2, len(kinds), squeeze=False, height_ratios=[1.0, 1.1])
    for (slice_, moduli), kind in zip(axes.T, kinds, strict=True):
        _draw_slice(slice_, kind, cells)
        slice_.set_title(kind)
        _draw_moduli(moduli, 1e-3 * means.loc[kind][YOUNG])
    axes[0, 0].set(ylabel="z [mm]")
    axes[1, 0].set(ylabel="Young's modulus [kPa]")
    legend_below(figure, axes[1, 0], 1 + len(STYLES))
    return figure


def _draw_slice(ax: Axes, kind: str, cells: int) -> None:
    """Draw the springs near the plane; springs in the structure's tissues have wider lines."""
    lattice, tissues = lattice_by_seed(kind, SHOWN_SEED, cells)
    ends = 1e3 * lattice.mesh.nodes[lattice.springs]
    near = (np.abs(ends[:, :, 1] - 1e3 * PLACES.get(kind, 0.5) * SIDE_M) < 600.0 * SIDE_M / cells).all(axis=1)
    region = np.zeros(len(lattice.springs), dtype=int)
    for k in range(1, len(tissues)):
        region[lattice.edges[lattice.mesh.regions == k]] = k
    for k, color in enumerate(COLORS[: len(tissues)]):
        own = near & (region == k)
        ax.add_collection(
            LineCollection(list(ends[own][:, :, [0, 2]]), colors=color, linewidths=0.4 if k == 0 else 0.8)
        )
    side = 1e3 * SIDE_M
    ax.set(xlim=(-0.5, side + 0.5), ylim=(-0.5, side + 0.5), aspect="equal", xlabel="x [mm]", xticks=(0, 12, 24))
    ax.set(yticks=(0, 12, 24))


def _draw_moduli(ax: Axes, young_kpa: pd.DataFrame) -> None:
    places = np.arange(len(YOUNG))
    ax.hlines(young_kpa.loc[MATERIAL], places - 0.4, places + 0.4, color=BLACK, lw=1.2, label="material")
    for k, (name, style) in enumerate(STYLES.items()):
        ax.plot(places + 0.2 * (k - 1), young_kpa.loc[name], ls="none", ms=2.5, label=WORDS[name], **style)
    highest = young_kpa.loc[[MATERIAL, *STYLES]].to_numpy().max()
    ax.set(xticks=places, xticklabels=AXES + PLANES, ylim=(0.0, 1.08 * highest), xlabel="along")
    ax.grid(axis="y", lw=0.3, color=GREY)
