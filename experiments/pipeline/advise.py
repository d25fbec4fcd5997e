"""Advice on a needle, frame by frame of a recording: what `softaim advise` does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from estimators import Advice, Guidance, guide
from experiments.formats.estimate_rows import AXES
from experiments.formats.needle_file import NeedlePlan
from experiments.formats.recording import Recording
from experiments.pipeline.line import FILTER, Line
from experiments.pipeline.track import each_step

COLOURS = {
    Advice.GO: "#4caf6d",
    Advice.WAIT: "#f2c14e",
    Advice.REALIGN: "#8e7cc3",
    Advice.NO_GUIDANCE: "#9a9a9a",
}


@dataclass(frozen=True, slots=True, eq=False)
class Advised:
    """What was advised at each frame of a recording: the frames' times [s] and the guidance at each."""

    recording: Recording
    plan: NeedlePlan
    times_s: tuple[float, ...]
    guidance: tuple[Guidance, ...]

    def counts(self) -> dict[str, int]:
        """How many frames had which advice."""
        names = [str(one.advice) for one in self.guidance]
        return {str(advice): names.count(str(advice)) for advice in Advice}


def advise(recording: Recording, plan: NeedlePlan, advance: Callable[[float], None] = lambda _share: None) -> Advised:
    """Run the filter through every frame and ask for advice at each, the needle where the plan has it.

    Raises InputError, SourceError.
    """
    line = Line(recording.scene, baseline=False, fixes=recording.fixes)
    n_frames = len(recording.exposures_s)
    times, guidance = [], []
    for k, step in enumerate(each_step(line, recording)):
        estimate = step.estimates[FILTER]
        times.append(estimate.time_s)
        guidance.append(
            guide(line.filter, estimate, plan.insertion, plan.lesion, needle=plan.needle, settings=plan.settings)
        )
        advance((k + 1) / n_frames)
    return Advised(recording, plan, tuple(times), tuple(guidance))


def header(dim: int) -> list[str]:
    """Names of the columns of advice.csv."""
    aims = [f"aim_{AXES[a]}_mm" for a in range(dim)]
    numbers = ["lateral_mm", "depth_mm", "turn_deg", "p_turned", "best_in_s", "p_best"]
    return ["time_s", "advice", "reason", "arrival_s", "p_hit", *aims, *numbers]


def row(time_s: float, guidance: Guidance, dim: int) -> list[object]:
    """The values of one frame under `header`, None where there is none."""
    aims = [None] * dim if guidance.aim is None else [float(1e3 * x) for x in guidance.aim]
    return [
        time_s,
        str(guidance.advice),
        guidance.reason,
        guidance.arrival_s,
        guidance.probability,
        *aims,
        None if guidance.lateral_m is None else 1e3 * guidance.lateral_m,
        None if guidance.depth_m is None else 1e3 * guidance.depth_m,
        None if guidance.turn_rad is None else float(np.degrees(guidance.turn_rad)),
        guidance.turned_probability,
        guidance.best_in_s,
        guidance.best_probability,
    ]


def table(done: Advised) -> pd.DataFrame:
    """advice.csv: a row for each frame; seconds, mm, degrees; empty where there is no value."""
    dim = done.recording.scene.network.dim
    rows = [row(time_s, one, dim) for time_s, one in zip(done.times_s, done.guidance, strict=True)]
    frame = pd.DataFrame(rows, columns=header(dim))
    numbers = [column for column in frame.columns if column not in ("advice", "reason")]
    return frame.astype(dict.fromkeys(numbers, float))


def write_advice(done: Advised, folder: Path) -> None:
    """Write advice.csv and advice.png to a folder that exists."""
    table(done).to_csv(folder / "advice.csv", index=False, float_format="%.9g")
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
    times = rows["time_s"]
    above.plot(times, rows["p_turned"], color="0.35", lw=0.9, ls=":", label="if turned to the aim")
    above.plot(times, rows["p_best"], color="#1f6fb4", lw=0.9, label="at the best moment ahead")
    above.plot(times, rows["p_hit"], color="black", lw=1.3, label="inserted now")
    above.axhline(done.plan.settings.go, color="black", lw=0.6, ls="--")
    above.set(ylim=(0.0, 1.02), ylabel="probability of a hit")
    above.set_title("advice on the needle")
    below.plot(times, rows["lateral_mm"], color="black", lw=1.1)
    below.set(ylabel="lateral miss [mm]", xlabel="time [s]")
    below.set_ylim(bottom=0.0)
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
    start = 0
    for k in range(1, len(times) + 1):
        if k == len(times) or done.guidance[k].advice is not done.guidance[start].advice:
            colour = COLOURS[done.guidance[start].advice]
            ax.axvspan(edges[start], edges[k], color=colour, alpha=0.45, lw=0)
            start = k
    ax.set_xlim(times[0], times[-1])
