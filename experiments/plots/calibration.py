"""Plot of a calibration: residuals of the corners in the picture, and the rms residual of each picture."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.plots.style import HALO, OURS, PAGE_MM, SMALL_PT, grid_figure, saved, styled
from vision import Calibration

MOST_ARROWS, MOST_NAMES = 2000, 30


def calibration_picture(calibration: Calibration, form: str) -> bytes:
    """The plot as the content of a file: png, pdf or svg."""
    return saved(calibration_figure(calibration), form)


@styled
def calibration_figure(calibration: Calibration) -> Figure:
    """Arrows, enlarged, from expected to detected corners, and a bar chart of the rms residual of each picture."""
    figure, [[area, bars]] = grid_figure(PAGE_MM, 78.0, ncols=2, width_ratios=(1.5, 1))
    _residuals(calibration, area)
    _bars(calibration, bars)
    return figure


def _residuals(calibration: Calibration, ax: Axes) -> None:
    seen, residuals = np.concatenate(calibration.seen_px), np.concatenate(calibration.residuals_px)
    some = np.linspace(0, len(seen) - 1, min(MOST_ARROWS, len(seen))).astype(int)
    width, height = calibration.size_px
    rms = calibration.reprojection_rms_px
    # an arrow of the rms residual is a fortieth of the picture's width long
    per_px = width / 40 / rms if rms > 0 else 1.0
    arrows = ax.quiver(
        *seen[some].T, *residuals[some].T, angles="xy", scale_units="xy", scale=1 / per_px, width=0.0015, color=OURS
    )
    key = float(f"{2 * rms:.1g}") if rms > 0 else 1.0
    ax.quiverkey(
        arrows, 0.3, 0.02, key, f"{key:g} px", labelpos="E", coordinates="figure", fontproperties={"size": SMALL_PT}
    )
    u0, v0 = calibration.matrix[:2, 2].tolist()
    ax.plot(u0, v0, "+", color="black", ms=6)
    near = (u0, v0)
    ax.annotate("principal point", near, (4, 4), textcoords="offset points", fontsize=SMALL_PT, path_effects=HALO)
    ax.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xlabel="u [px]", ylabel="v [px]", aspect="equal")
    some_of = "" if len(some) == len(seen) else f"; {len(some)} of {len(seen)}"
    ax.set_title(f"{calibration.name}: detected minus expected corners, {per_px:.0f} times enlarged{some_of}")


def _bars(calibration: Calibration, ax: Axes) -> None:
    each = calibration.rms_px_each
    n = len(each)
    ax.bar(np.arange(n), each, color=OURS, width=0.75)
    ax.axhline(calibration.reprojection_rms_px, color="black", lw=1, ls=(0, (4, 2)))
    every = -(-n // MOST_NAMES)
    ax.set_xticks(np.arange(0, n, every), calibration.images_used[::every], rotation=90, fontsize=SMALL_PT)
    ax.set(ylabel="rms residual [px]", xlim=(-0.7, n - 0.3))
    ax.set_title(
        f"rms of each picture; dashed: all, {calibration.reprojection_rms_px:.3f} px\n"
        f"left out: {len(calibration.images_left_out)} pictures"
    )
