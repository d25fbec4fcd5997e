"""Plot of advice on a needle: probability of a hit with its threshold, the needle's miss, and reasons of the advice."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.lines import Line2D

from estimators import Advice
from experiments.arrays import Floats
from experiments.formats.scene.outside import outside_of
from experiments.pipeline.advise import Advised, table
from experiments.plain import counted
from experiments.plots.series import draw_bands, highest, mark_beyond, spans_of, thinned
from experiments.plots.space import (
    N_FACES,
    NEEDLE_KEYS,
    TARGET_KEYS,
    close_up,
    draw_body,
    draw_needle,
    draw_target,
    keys,
    two_views,
)
from experiments.plots.style import (
    BLACK,
    GREEN,
    GREY,
    ORANGE,
    PAGE_MM,
    PURPLE,
    SKY,
    SMALL_PT,
    VERMILLION,
    legend_below,
    new_figure,
    span,
    styled,
)

if TYPE_CHECKING:
    import pandas as pd

COLOURS = {
    Advice.GO: GREEN,
    Advice.WAIT: ORANGE,
    Advice.REALIGN: PURPLE,
    Advice.ABORT: VERMILLION,
    Advice.NO_GUIDANCE: GREY,
}
LANE_MM = 6.5
"""Height in print of the row of one reason [mm]: a line of text, and bars below it."""

MOST_CHANGES = 40
"""If the advice changes more often than this, the plot has no lines at the changes: the lines would merge."""

SAME, STEADY = 0.01, 0.2
"""Probabilities look the same in the plot if they differ by at most SAME [1]. A miss counts as constant if its range is
at most STEADY [lesion radii]."""

VIEW_MM, CLOSE_MM, ROOM_MM = 56.0, 26.0, 48.0
"""Widths in print for a body in space [mm]: of a view, of a close-up, and of the square that the view's axes fill."""

OBSERVED = "observed: share of needles with random errors of tip and push that hit the true target"
"""Legend entry of the observed hit rate."""

NUMBER = re.compile(r"\d+(?:\.\d+)?")


@styled
def advice_figure(done: Advised) -> Figure:
    """The probability of a hit over time, the needle's miss, and a row of bars for each reason of the advice.

    If the miss is constant, it is stated as text. For a body in space, the figure also shows the needle from two sides.
    """
    rows, reasons = table(done), reasons_of(done)
    lateral_mm = rows["lateral_mm"].to_numpy(dtype=np.float64)
    known_mm = lateral_mm[np.isfinite(lateral_mm)]
    missed = len(known_mm) > 0 and float(np.ptp(known_mm)) > STEADY * 1e3 * done.plan.lesion.radius_m
    parts = [46.0, *([26.0] if missed else []), LANE_MM * len(reasons)]
    in_space = done.recording.scene.network.dim == 3
    heights = [*parts, *([VIEW_MM] if in_space else [])]
    figure = new_figure(PAGE_MM, 20.0 + sum(heights) + 5.0 * in_space)
    grid = figure.add_gridspec(len(heights), 1, height_ratios=heights)
    over_time = [figure.add_subplot(grid[k]) for k in range(len(parts))]
    for ax in over_time[:-1]:
        ax.sharex(over_time[-1])
        ax.tick_params(labelbottom=False)
        draw_bands(ax, np.array(done.times_s), [one.advice for one in done.guidance], COLOURS)
    _probabilities(done, over_time[0], rows)
    shown: dict[str, Artist] = {}
    if missed:
        edge = _misses(done, over_time[1], lateral_mm)
        shown[str(edge.get_label())] = edge
    elif len(known_mm):
        over_time[0].set_title(f"lateral miss {known_mm.min():.1f} to {known_mm.max():.1f} mm")
    _reasons(done, over_time[-1], reasons)
    over_time[-1].set_xlabel("time [s]")
    span(over_time[-1], np.array(done.times_s))
    if in_space:
        shown |= _in_space(done, figure, grid[-1])
    legend_below(figure, over_time[0], 3, shown)
    return figure


def _in_space(done: Advised, figure: Figure, place: SubplotSpec) -> Mapping[str, Artist]:
    """Draw the needle and the last aim in two views of the body, and in a close-up of each; returns legend entries."""
    scene, plan = done.recording.scene, done.plan
    aimed = next((k for k in reversed(range(len(done.guidance))) if done.guidance[k].aim is not None), None)
    at_rest = scene.network.positions[scene.network.index(scene.target.node)]
    lesion, cov, ahead = at_rest + np.array(scene.target.offset_m or np.zeros(3)), None, None
    if aimed is not None:
        latest = done.guidance[aimed]
        lesion, cov, ahead = latest.aim, latest.cov, latest.depth_m
    spread_m = 0.0 if cov is None else 2.0 * float(np.sqrt(np.linalg.eigvalsh(cov)[-1]))
    reach_m = max(2.0 * plan.lesion.radius_m, min(spread_m, 6.0 * plan.lesion.radius_m))
    views, outline = two_views(scene), outside_of(scene, N_FACES)
    axes = place.subgridspec(1, 4, width_ratios=(VIEW_MM, CLOSE_MM) * 2)
    for k, view in enumerate(views):
        whole, close = (figure.add_subplot(axes[2 * k + column]) for column in (0, 1))
        draw_body(whole, view, scene, outline, ROOM_MM, plan.insertion.entry[None])
        close_up(close, view.seen_mm(lesion), 1.1e3 * reach_m)
        for ax in (whole, close):
            draw_target(ax, view, lesion, plan.lesion.radius_m, cov)
            draw_needle(ax, view, plan.insertion, ahead or 0.0)
        if k == 0:
            when = "lesion as drawn" if aimed is None else f"aim at {done.times_s[aimed]:.1f} s"
            whole.set_title(f"needle; {when}")
    without = {"2-sigma ellipsoid"} if cov is None else set()
    shown = keys(scene, outline, views) | TARGET_KEYS | NEEDLE_KEYS
    if not ahead:
        without.add("its line ahead")
    return {label: handle for label, handle in shown.items() if label not in without}


def _probabilities(done: Advised, ax: Axes, rows: pd.DataFrame) -> None:
    """Draw the hit probability now, at the best time and after a turn; the last two only if they differ from now."""
    times, go = rows["time_s"].to_numpy(), done.plan.settings.go
    if rows["p_hit"].notna().any():
        ax.plot(times, rows["p_hit"], color=BLACK, lw=1.6, label="inserted now")
    if _differ(rows, "p_best"):  # on top and narrower, so that both lines are visible where they coincide
        ax.plot(times, rows["p_best"], color=SKY, lw=0.7, label="insertion at the best later time")
    if _differ(rows, "p_turned"):
        ax.plot(times, rows["p_turned"], color=GREEN, lw=0.9, ls=":", label="after turning to the aim")
    if "observed" in rows and rows["observed"].notna().any():
        ax.plot(times, rows["observed"], color=VERMILLION, lw=0.6, ls=(0, (4, 2)), label=OBSERVED)
    ax.axhline(go, color=BLACK, lw=0.6, ls=(0, (6, 3)), label=f"threshold of GO, {go:g}")
    ax.set(ylim=(0.0, 1.02), ylabel="probability of a hit [–]")


def _differ(rows: pd.DataFrame, column: str) -> bool:
    """Whether the probability in a column differs visibly from that of an immediate insertion, in any frame."""
    return bool(((rows[column] - rows["p_hit"].fillna(0.0)).abs() > SAME).any())


def _misses(done: Advised, ax: Axes, lateral_mm: Floats) -> Line2D:
    """Draw the needle's miss over time, and a line at the lesion's radius; returns this line."""
    times = np.array(done.times_s)
    size = np.ptp(done.recording.scene.network.positions, axis=0)
    radius = 1e3 * done.plan.lesion.radius_m
    ax.set_ylim(0.0, max(1.2 * radius, highest(1e3 * float(np.linalg.norm(size)), lateral_mm)))
    ax.plot(*thinned(times, lateral_mm), color=BLACK, lw=0.9)
    edge = ax.axhline(radius, color=GREY, lw=0.6, ls=(0, (1, 1)), label="radius of the lesion")
    beyond = mark_beyond(ax, times, lateral_mm, BLACK)
    ax.set_ylabel("lateral miss [mm]")
    if beyond:
        ax.set_title(f"outside the plot in {beyond} of {counted(len(times), 'frame')}", loc="right")
    return edge


def _reasons(done: Advised, ax: Axes, reasons: Sequence[tuple[Advice, str, Sequence[bool]]]) -> None:
    """Draw a row for each reason: its text, and bars over its frames. Dotted lines show changes of the advice."""
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
    """Groups of reasons, sorted by advice: the advice, the text, and whether each frame has a reason of the group.

    Reasons that differ only in numbers form a group. The group's text has the range of each number.
    """
    kinds: dict[tuple[Advice, str], list[int]] = {}
    for k, one in enumerate(done.guidance):
        kinds.setdefault((one.advice, NUMBER.sub("#", one.reason)), []).append(k)
    order = {advice: rank for rank, advice in enumerate(COLOURS)}
    found = sorted(kinds.items(), key=lambda item: (order[item[0][0]], item[1][0]))
    held = {kind: np.isin(np.arange(len(done.guidance)), frames).tolist() for kind, frames in found}
    return [(kind[0], _with_ranges([done.guidance[k].reason for k in frames]), held[kind]) for kind, frames in found]


def _with_ranges(reasons: Sequence[str]) -> str:
    """Combine reasons that differ only in numbers into one text; a number that varies becomes a range."""
    columns = iter(zip(*(NUMBER.findall(reason) for reason in reasons), strict=True))

    def ranged(_match: re.Match[str]) -> str:
        numbers = sorted(set(next(columns)), key=float)
        return numbers[0] if len(numbers) == 1 else f"{numbers[0]} to {numbers[-1]}"

    return NUMBER.sub(ranged, reasons[0])
