"""The style of all plots: sizes in print, fonts, colours for the colour-blind, and files.

A figure is as wide as a column or a page in print; its text is legible at that size. Colours are Okabe and Ito's
[wong2011]; a path in time is coloured by viridis, which is perceptually uniform.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from pathlib import Path
from types import MappingProxyType
from typing import Any, ParamSpec, TypeVar

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from experiments.arrays import Floats

COLUMN_MM, PAGE_MM = 85.0, 170.0
"""Width of a column and of a page of print [mm]."""

DPI = 300
"""Resolution of PNG files [px/inch]: journals require it for halftones."""

TEXT_PT, SMALL_PT = 7.0, 6.0
"""Font sizes [pt]: of titles and axes; of ticks, legends and notes. 6 pt is the least that is legible in print."""

BLACK, ORANGE, SKY, GREEN = "#000000", "#e69f00", "#56b4e9", "#009e73"
BLUE, VERMILLION, PURPLE, GREY = "#0072b2", "#d55e00", "#cc79a7", "#999999"

TRUE, OURS, PAPERS = BLACK, BLUE, ORANGE
"""Colours in all plots: of the truth, of the filter, and of the open loop, which is the paper's method."""

TIME_MAP = "viridis"

HALO = [withStroke(linewidth=1.4, foreground="white")]
"""White outline of words over lines."""

STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": TEXT_PT,
    "axes.titlesize": TEXT_PT,
    "axes.titlelocation": "left",
    "axes.titlepad": 4.0,
    "axes.labelsize": TEXT_PT,
    "axes.labelpad": 2.0,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.labelsize": SMALL_PT,
    "ytick.labelsize": SMALL_PT,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
    "legend.fontsize": SMALL_PT,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "legend.columnspacing": 1.4,
    "lines.linewidth": 0.9,
    "lines.markersize": 3.0,
    "figure.titlesize": TEXT_PT,
    "image.cmap": TIME_MAP,
    "pdf.fonttype": 42,  # text stays text, which other programs can edit
    "svg.hashsalt": "softaim",  # fixed names of elements, so that the same plot gives the same file
}

UNDATED = {"png": {}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}
"""Metadata of files by format: no date, so that the same plot gives the same file."""

P = ParamSpec("P")
Drawn = TypeVar("Drawn", bound=Figure | None)


def styled(draw: Callable[P, Drawn]) -> Callable[P, Drawn]:
    """Decorator of functions that draw a figure: it sets the style of this module."""

    @wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> Drawn:
        with mpl.rc_context(STYLE):
            return draw(*args, **kwargs)

    return drawn


def new_figure(width_mm: float, height_mm: float) -> Figure:
    """An empty figure of this size in print; it is made without pyplot, so that there is no global state."""
    return Figure(figsize=(width_mm / 25.4, height_mm / 25.4), layout="constrained")


def grid_figure(width_mm: float, height_mm: float, **grid: Any) -> tuple[Figure, NDArray[np.object_]]:
    """A figure with a grid of axes, (n_rows, n_columns); grid: arguments of `Figure.subplots`."""
    figure = new_figure(width_mm, height_mm)
    return figure, figure.subplots(squeeze=False, **grid)


def span(ax: Axes, times_s: Floats) -> None:
    """Limit the time axis to the first and the last time [s]; for a single time matplotlib chooses the limits."""
    if len(times_s) > 1:
        ax.set_xlim(times_s[0], times_s[-1])


def legend_below(
    figure: Figure, of: Axes | Sequence[Axes], n_columns: int, more: Mapping[str, Artist] = MappingProxyType({})
) -> None:
    """Draw the legend of the axes `of` below all plots, where it covers no data; more: further entries by label."""
    entries = [ax.get_legend_handles_labels() for ax in ((of,) if isinstance(of, Axes) else of)]
    handles = [*(one for handles, _ in entries for one in handles), *more.values()]
    labels = [*(one for _, labels in entries for one in labels), *more]
    figure.legend(handles, labels, loc="outside lower center", ncols=n_columns)


def ellipse(mean: Floats, cov: Floats, sigmas: float, **style: object) -> Ellipse:
    """The ellipse of a Gaussian in the plane, mean (2,), cov (2, 2); sigmas: its semi-axes in standard deviations."""
    values, vectors = np.linalg.eigh(cov)
    angle = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
    across = 2.0 * sigmas * np.sqrt(values.clip(0.0))  # a zero eigenvalue may be rounded below zero
    return Ellipse((mean[0], mean[1]), across[1], across[0], angle=angle, **style)


def saved(figure: Figure, form: str) -> bytes:
    """A figure as the content of a file: png, pdf or svg."""
    content = io.BytesIO()
    with mpl.rc_context(STYLE):
        figure.savefig(content, format=form, dpi=DPI, metadata=UNDATED[form])
    return content.getvalue()


def write_picture(figure: Figure, path: Path, vector: str | None = None) -> list[Path]:
    """Write a PNG file and optionally a vector file ("pdf" or "svg") beside it; returns the files written."""
    forms = {path: "png"} | ({path.with_suffix(f".{vector}"): vector} if vector else {})
    for one, form in forms.items():
        one.write_bytes(saved(figure, form))
    return list(forms)
