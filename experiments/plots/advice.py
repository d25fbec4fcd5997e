"""Plot of advice on a needle: probability of a hit and lateral miss over time, on bands of what was advised."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from estimators import Advice
from experiments.pipeline.advise import Advised, table
from experiments.plots.limits import highest, mark_beyond, thinned

COLOURS = {
    Advice.GO: "#4caf6d",
    Advice.WAIT: "#f2c14e",
    Advice.REALIGN: "#8e7cc3",
    Advice.NO_GUIDANCE: "#9a9a9a",
}


def write_advice_plot(done: Advised, folder: Path) -> None:
    """Draw advice.png into a folder that exists."""
    advice_figure(done).savefig(folder / "advice.png", dpi=110)


def advice_figure(done: Advised) -> Figure:
    """The probability of a hit over time, and the needle's miss, on bands of what was advised."""
    rows = table(done)
    with mpl.rc_context({"font.size": 9}):
        figure = Figure(figsize=(11, 5.5), layout="constrained")
        above, below = figure.subplots(nrows=2, sharex=True, height_ratios=(3, 2))
    for ax in (above, below):
        ax.spines[["top", "right"]].set_visible(False)
        _bands(ax, done)
    times = rows["time_s"].to_numpy()
    above.plot(times, rows["p_turned"], color="0.35", lw=0.9, ls=":", label="if turned to the aim")
    above.plot(times, rows["p_best"], color="#1f6fb4", lw=0.9, label="at the best moment ahead")
    above.plot(times, rows["p_hit"], color="black", lw=1.3, label="inserted now")
    above.axhline(done.plan.settings.go, color="black", lw=0.6, ls="--")
    above.set(ylim=(0.0, 1.02), ylabel="probability of a hit")
    above.set_title("advice on the needle")
    lateral, size = rows["lateral_mm"].to_numpy(), np.ptp(done.recording.scene.network.positions, axis=0)
    below.set(ylabel="lateral miss [mm]", xlabel="time [s]")
    below.set_ylim(0.0, highest(1e3 * float(np.linalg.norm(size)), lateral))
    below.plot(*thinned(times, lateral), color="black", lw=1.1)
    mark_beyond(below, times, lateral, "black")
    bands = [Patch(color=colour, alpha=0.45, label=_words(advice)) for advice, colour in COLOURS.items()]
    lines, _ = above.get_legend_handles_labels()
    figure.legend(handles=[*lines, *bands], loc="outside lower center", ncols=7, frameon=False)
    return figure


def _words(advice: Advice) -> str:
    return str(advice).replace("_", " ")


def _bands(ax: Axes, done: Advised) -> None:
    """Colour the time of each frame, half-way to its neighbours, by its advice."""
    times = np.array(done.times_s)
    if len(times) < 2:
        return
    middles = 0.5 * (times[1:] + times[:-1])
    edges = np.concatenate([times[:1], middles, times[-1:]])
    advised = [one.advice for one in done.guidance]
    for advice, colour in COLOURS.items():
        during = np.concatenate([[False], [one is advice for one in advised], [False]])
        starts, ends = np.flatnonzero(during[1:] & ~during[:-1]), np.flatnonzero(~during[1:] & during[:-1])
        spans = list(zip(edges[starts], edges[ends] - edges[starts], strict=True))
        whole = ax.get_xaxis_transform()
        ax.broken_barh(spans, (0.0, 1.0), facecolors=colour, alpha=0.45, lw=0, transform=whole)
    ax.set_xlim(times[0], times[-1])
