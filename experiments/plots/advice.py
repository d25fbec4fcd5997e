"""Plot of advice on a needle: probability of a hit against its threshold, miss, and the reasons of the advice."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from estimators import Advice
from experiments.pipeline.advise import Advised, table
from experiments.plain import counted
from experiments.plots.bands import draw_bands, spans_of
from experiments.plots.limits import highest, mark_beyond, thinned
from experiments.plots.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PAGE_MM,
    PURPLE,
    SMALL_PT,
    VERMILLION,
    legend_below,
    new_figure,
    span,
    styled,
    write_picture,
)

COLOURS = {
    Advice.GO: GREEN,
    Advice.WAIT: ORANGE,
    Advice.REALIGN: PURPLE,
    Advice.ABORT: VERMILLION,
    Advice.NO_GUIDANCE: GREY,
}
LANE_MM = 6.5
"""Printed height of a lane [mm]: a reason's text above its bars."""

MOST_CHANGES = 40
"""Most changes of advice drawn as lines: more would merge."""

NUMBER = re.compile(r"\d+(?:\.\d+)?")


def write_advice_plot(done: Advised, folder: Path, vector: str | None = None) -> None:
    """Draw advice.png into an existing folder; vector: "pdf" or "svg" for a vector file beside it."""
    write_picture(advice_figure(done), folder / "advice.png", vector)


@styled
def advice_figure(done: Advised) -> Figure:
    """The probability of a hit over time, the needle's miss, and a lane for each reason of the advice."""
    rows, reasons = table(done), reasons_of(done)
    parts = (46.0, 26.0, LANE_MM * len(reasons)) if rows["lateral_mm"].notna().any() else (46.0, LANE_MM * len(reasons))
    figure = new_figure(PAGE_MM, 20.0 + sum(parts))
    above, *others = figure.subplots(nrows=len(parts), sharex=True, height_ratios=parts)
    for ax in (above, *others[:-1]):
        draw_bands(ax, np.array(done.times_s), [one.advice for one in done.guidance], COLOURS)
    _probabilities(done, above)
    if len(others) > 1:
        _misses(done, others[0])
    _reasons(done, others[-1], reasons)
    others[-1].set_xlabel("time [s]")
    span(others[-1], np.array(done.times_s))
    legend_below(figure, above, 4)
    return figure


def _probabilities(done: Advised, ax: Axes) -> None:
    rows, go = table(done), done.plan.settings.go
    times = rows["time_s"].to_numpy()
    ax.plot(times, rows["p_turned"], color="0.35", lw=0.7, ls=":", label="after turning to the aim")
    ax.plot(times, rows["p_best"], color=BLUE, lw=0.7, label="insertion at the best later time")
    ax.plot(times, rows["p_hit"], color=BLACK, lw=1.0, label="inserted now")
    if "observed" in rows:
        ax.plot(times, rows["observed"], color=VERMILLION, lw=0.6, ls=(0, (4, 2)), label="observed, insertion now")
    ax.axhline(go, color=BLACK, lw=0.6, ls=(0, (6, 3)), label=f"threshold of GO, {go:g}")
    ax.set(ylim=(0.0, 1.02), ylabel="probability of a hit [–]")


def _misses(done: Advised, ax: Axes) -> None:
    rows = table(done)
    times, lateral = rows["time_s"].to_numpy(), rows["lateral_mm"].to_numpy()
    size = np.ptp(done.recording.scene.network.positions, axis=0)
    least = 2e3 * done.recording.scene.target.radius_m
    ax.set_ylim(0.0, max(least, highest(1e3 * float(np.linalg.norm(size)), lateral)))
    ax.plot(*thinned(times, lateral), color=BLACK, lw=0.9)
    beyond = mark_beyond(ax, times, lateral, BLACK)
    ax.set_ylabel("lateral miss [mm]")
    if beyond:
        ax.set_title(f"outside the plot in {beyond} of {counted(len(times), 'frame')}", loc="right")


def _reasons(done: Advised, ax: Axes, reasons: Sequence[tuple[Advice, str, Sequence[bool]]]) -> None:
    """A lane for each reason: its text, and bars where it applied; a tick at each change of advice."""
    times = np.array(done.times_s)
    for lane, (advice, words, held) in enumerate(reasons):
        ax.broken_barh(spans_of(times, held), (lane + 0.52, 0.42), facecolors=COLOURS[advice], lw=0)
        name = str(advice).replace("_", " ")
        label = f"{name}: {words} ({counted(sum(held), 'frame')})"
        across = ax.get_yaxis_transform()
        paper = {"fc": "white", "ec": "none", "pad": 0.2}
        ax.text(0.004, lane + 0.45, label, fontsize=SMALL_PT, va="bottom", zorder=4, transform=across, bbox=paper)
    changes = [
        0.5 * (a + b)
        for a, b, before, after in zip(times, times[1:], done.guidance, done.guidance[1:], strict=False)
        if before.advice is not after.advice
    ]
    if 0 < len(changes) <= MOST_CHANGES:
        ax.vlines(changes, 0.0, len(reasons), color=BLACK, lw=0.4, ls=":")
    ax.set(ylim=(len(reasons), 0.0), yticks=[])
    ax.spines["left"].set_visible(False)
    ax.set_title(f"reasons of the advice; changes: {len(changes)}")


def reasons_of(done: Advised) -> list[tuple[Advice, str, list[bool]]]:
    """The kinds of reasons in the order of the advice: advice, text, and the frames of each.

    Reasons that differ only in numbers are one kind, with the range of each number.
    """
    kinds: dict[tuple[Advice, str], list[int]] = {}
    for k, one in enumerate(done.guidance):
        kinds.setdefault((one.advice, NUMBER.sub("#", one.reason)), []).append(k)
    order = {advice: rank for rank, advice in enumerate(COLOURS)}
    found = sorted(kinds.items(), key=lambda item: (order[item[0][0]], item[1][0]))
    held = {kind: np.isin(np.arange(len(done.guidance)), frames).tolist() for kind, frames in found}
    return [(kind[0], _with_ranges([done.guidance[k].reason for k in frames]), held[kind]) for kind, frames in found]


def _with_ranges(reasons: Sequence[str]) -> str:
    """Reasons of one kind as one text, with ranges of numbers."""
    columns = iter(zip(*(NUMBER.findall(reason) for reason in reasons), strict=True))

    def ranged(_match: re.Match[str]) -> str:
        numbers = sorted(set(next(columns)), key=float)
        return numbers[0] if len(numbers) == 1 else f"{numbers[0]} to {numbers[-1]}"

    return NUMBER.sub(ranged, reasons[0])
