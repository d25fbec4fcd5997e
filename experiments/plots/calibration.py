"""The picture of a calibration: residuals over the picture's area, and how well each picture fits."""

from __future__ import annotations

import io

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vision import Calibration

OURS = "#1f6fb4"
LABEL = {"fc": "white", "ec": "none", "alpha": 0.8, "pad": 1.0}
MOST_ARROWS, MOST_NAMES = 2000, 30


def calibration_png(calibration: Calibration) -> bytes:
    """A PNG picture: arrows from corners expected to corners seen, enlarged, beside bars of rms picture by picture."""
    with mpl.rc_context({"font.size": 9}):
        figure = Figure(figsize=(12, 5), layout="constrained")
        area, bars = figure.subplots(ncols=2, width_ratios=(1.5, 1))
        _residuals(calibration, area)
        _bars(calibration, bars)
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=110)
    return content.getvalue()


def _residuals(calibration: Calibration, ax: Axes) -> None:
    seen, residuals = np.concatenate(calibration.seen_px), np.concatenate(calibration.residuals_px)
    some = np.linspace(0, len(seen) - 1, min(MOST_ARROWS, len(seen))).astype(int)
    width, height = calibration.size_px
    rms = calibration.reprojection_rms_px
    # a residual of the size of the rms is drawn a fortieth of the picture long
    per_px = width / 40 / rms if rms > 0 else 1.0
    arrows = ax.quiver(
        *seen[some].T, *residuals[some].T, angles="xy", scale_units="xy", scale=1 / per_px, width=0.0015, color=OURS
    )
    key = float(f"{2 * rms:.1g}") if rms > 0 else 1.0
    ax.quiverkey(arrows, 0.88, 0.03, key, f"{key:g} px", labelpos="E", coordinates="axes")
    u0, v0 = calibration.matrix[:2, 2].tolist()
    ax.plot(u0, v0, "+", color="black", ms=10)
    ax.annotate("principal point", (u0, v0), (6, 6), textcoords="offset points", fontsize=8, bbox=LABEL)
    ax.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xlabel="u [px]", ylabel="v [px]", aspect="equal")
    ax.set_title(f"{calibration.name}: corners seen minus expected, {per_px:.0f} times enlarged", loc="left")


def _bars(calibration: Calibration, ax: Axes) -> None:
    each = calibration.rms_px_each
    n = len(each)
    ax.bar(np.arange(n), each, color=OURS, width=0.75)
    ax.axhline(calibration.reprojection_rms_px, color="black", lw=1, ls=(0, (4, 2)))
    every = -(-n // MOST_NAMES)
    ax.set_xticks(np.arange(0, n, every), calibration.images_used[::every], rotation=90, fontsize=8)
    ax.set(ylabel="rms [px]", xlim=(-0.7, n - 0.3))
    ax.set_title(
        f"rms of each picture; dashed: all, {calibration.reprojection_rms_px:.3f} px;"
        f" left out: {len(calibration.images_left_out)}",
        loc="left",
    )
    ax.spines[["top", "right"]].set_visible(False)
