"""Advice on a needle, frame by frame of a recording: what `softaim advise` does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from estimators import Advice, Guidance, guide
from experiments.formats.estimate_rows import AXES
from experiments.formats.needle_file import NeedlePlan
from experiments.formats.recording import Recording
from experiments.pipeline.line import FILTER, Line
from experiments.pipeline.track import each_step


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
    """Write advice.csv to a folder that exists."""
    table(done).to_csv(folder / "advice.csv", index=False, float_format="%.9g")
