"""The plots of a track: path of the target, error or motion over time, and consistency of the covariance.

The body's size limits the axes (`series.py`). Estimates outside the axes are marked at the edge and counted.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.formats.estimate_rows import AXES
from experiments.pipeline.line import FILTER, OPEN_LOOP
from experiments.pipeline.track import Track
from experiments.plots.consistency import consistency_figure, sigma_figure, withheld_figure
from experiments.plots.path import path_figure
from experiments.plots.series import body_size, draw_motion, draw_over_time, highest, means_mm, sigma_mm
from experiments.plots.style import PAGE_MM, TRUE, grid_figure, legend_below, span, styled, write_picture

ERROR_TITLE, MOTION_TITLE = "error of the hidden target", "the hidden target"


def write_track_plots(
    done: Track, folder: Path, vector: str | None = None, *, advance: Callable[[float], None] = lambda _share: None
) -> list[Path]:
    """Draw the plots of a track into an existing folder; returns the files written.

    path.png is always drawn. If the truth is known, there are error.png and sigma.png; otherwise a flat scene has
    motion.png. If the filter used marks, there is consistency.png. If the track has predictions of withheld marks,
    there is withheld.png.
    vector: "pdf" or "svg" for a vector file of each plot; advance: called with the share of plots that are drawn
    """
    pictures: dict[str, Figure | None] = {"path": path_figure(done)}
    if done.has_truth:
        pictures |= {"error": error_figure(done), "sigma": sigma_figure(done)}
    elif done.recording.scene.network.dim == 2:
        pictures["motion"] = motion_figure(done)
    pictures["consistency"] = consistency_figure(done)
    if done.withheld:
        pictures["withheld"] = withheld_figure(done.withheld)
    written: list[Path] = []
    for k, (name, figure) in enumerate(pictures.items(), start=1):
        written += [] if figure is None else write_picture(figure, folder / f"{name}.png", vector)
        advance(k / len(pictures))
    return written


@styled
def error_figure(done: Track) -> Figure:
    """Error on each axis over time, with bands of 1, 2 and 3 predicted standard deviations."""
    size = 1e3 * body_size(done)
    errors, papers = (means_mm(done, method) - 1e3 * done.truth for method in (FILTER, OPEN_LOOP))
    figure, axes = _an_axis_each(done)
    for a, ax in enumerate(axes):
        sigma = sigma_mm(done, a)
        top = highest(size, 3.0 * sigma, errors[:, a], papers[:, a])
        ax.set_ylim(-top, top)
        draw_over_time(done, ax, errors[:, a], papers[:, a], np.minimum(sigma, top), multiples=(3, 2, 1))
        ax.axhline(0.0, color=TRUE, lw=0.4)
        ax.set_ylabel(f"{AXES[a]} error [mm]")
    axes[0].set_title(ERROR_TITLE)
    legend_below(figure, axes[0], 6)
    return figure


@styled
def motion_figure(done: Track) -> Figure:
    """The target on each axis over time: the filter with a band of two sigma, and the open loop."""
    figure, axes = _an_axis_each(done)
    for a, ax in enumerate(axes):
        draw_motion(done, ax, a)
    axes[0].set_title(MOTION_TITLE)
    legend_below(figure, axes[0], 6)
    return figure


def _an_axis_each(done: Track) -> tuple[Figure, list[Axes]]:
    dim = done.recording.scene.network.dim
    figure, grid = grid_figure(PAGE_MM, 12.0 + 40.0 * dim, nrows=dim, sharex=True)
    grid[-1, 0].set_xlabel("time [s]")
    span(grid[-1, 0], done.times_s)
    return figure, list(grid[:, 0])
