"""Advice on a needle for each frame of a recording: what `softaim advise` does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from estimators import (
    AbortWatch,
    Advice,
    Breathing,
    GaussianMixture,
    Guidance,
    Status,
    TargetEstimate,
    TargetPath,
    TissueFilter,
    breathing_ahead,
    breathing_track,
    either_path,
    guide,
    hit_probability,
    path_near_rest,
    path_reach_s,
    path_tables,
)
from estimators.process.target import target_map
from experiments.arrays import Floats
from experiments.formats.estimate_rows import AXES
from experiments.formats.needle_file import NeedlePlan
from experiments.formats.outputs import table_text
from experiments.formats.recording import Recording
from experiments.formats.scene.scene import Scene
from experiments.pipeline.integrity import IntegrityMonitor
from experiments.pipeline.line import FILTER, Line, Watcher
from experiments.pipeline.track import each_frame

if TYPE_CHECKING:
    import pandas as pd

SURE_M = 1e-9
"""Standard deviation used for a known position [m]; numerical: a zero covariance has no inverse."""


SETTLED_S = 0.5
"""The breathing model ignores estimates for this duration [s] after tracking starts; choice: early errors are large."""


class BreathingPath:
    """Model of the target's breathing motion, fitted to the filter's estimates."""

    def __init__(self, dim: int) -> None:
        self.model, self._from_s = Breathing(dim), np.inf

    def learn(self, tissue: TissueFilter, estimate: TargetEstimate) -> None:
        """Update the model with the filter's estimate at the newest frame."""
        if estimate.status is not Status.TRACKING or estimate.cov is None:
            return
        self._from_s = min(self._from_s, estimate.time_s + SETTLED_S)
        if estimate.time_s >= self._from_s:
            self.model.update(estimate.time_s, *breathing_track(tissue, estimate.mean))

    def mixed(self, tissue: TissueFilter, path: TargetPath) -> TargetPath:
        """Mixture of `path` and the path that the breathing model predicts; if no breathing is detected, `path`."""
        if self.model.breath() is None:
            return path
        breath = TargetPath(path.times_s, *breathing_ahead(self.model, tissue, path.times_s))
        return either_path(breath, path, self.model.holds(path.times_s))


@dataclass(frozen=True, slots=True, eq=False)
class Advised:
    """Advice for a recording; times_s: times of the frames with advice [s]; guidance: the advice for each of them."""

    recording: Recording
    plan: NeedlePlan
    times_s: tuple[float, ...]
    guidance: tuple[Guidance, ...]

    def counts(self) -> dict[str, int]:
        """Number of frames with each advice."""
        names = [str(one.advice) for one in self.guidance]
        return {str(advice): names.count(str(advice)) for advice in Advice}


def advise(
    recording: Recording,
    plan: NeedlePlan,
    advance: Callable[[float], None] = lambda _share: None,
    *,
    watch: Watcher | None = None,
    every_s: float = 0.0,
) -> Advised:
    """Run the filter through all frames of a recording, and give advice on the needle, which does not move.

    watch: called with the frame, its `Step` and the advice, for each frame with advice
    every_s: least interval between two pieces of advice [s]; if it is 0, every frame has advice
    Raises InputError, SourceError.
    """
    line = Line(recording.scene, baseline=False, fixes=recording.fixes, explain=watch is not None)
    n_frames = len(recording.exposures_s)
    times, guidance, due_s, watched = [], [], -np.inf, AbortWatch()
    tables = path_tables(line.filter, path_reach_s(line.filter, plan.insertion, plan.needle, plan.settings))
    integrity = IntegrityMonitor(recording.scene, line.filter)
    push = plan.push_on(recording.scene.network, recording.scene.target.point)
    breath = BreathingPath(recording.scene.network.dim)

    def path_at(times_s: Floats) -> TargetPath:
        path = breath.mixed(line.filter, path_near_rest(tables, line.filter, times_s))
        return push.pushed(path.widened(integrity.unstated), plan.insertion)

    asked = partial(guide, needle=plan.needle, settings=plan.settings, path_at=path_at)
    for k, (frame, step) in enumerate(each_frame(line, recording)):
        estimate = step.estimates[FILTER]
        fault = integrity.take(estimate, line.used(step))
        breath.learn(line.filter, estimate)
        if estimate.time_s >= due_s:
            times.append(estimate.time_s)
            none = None if fault is None else Guidance(Advice.NO_GUIDANCE, fault)
            found = none or asked(line.filter, estimate, plan.insertion, plan.lesion)
            guidance.append(watched.checked(found, plan.insertion, plan.settings, estimate.time_s))
            due_s = estimate.time_s + every_s
            if watch is not None:
                watch.take(frame, line, step, guidance[-1])
        advance((k + 1) / n_frames)
    return Advised(recording, plan, tuple(times), tuple(guidance))


def push_m(scene: Scene, plan: NeedlePlan) -> Floats:
    """Predicted displacement of the target by the needle at the end of the insertion [m], (dim,)."""
    return plan.push_on(scene.network, scene.target.point).shift(plan.insertion)


def observed_hits(done: Advised) -> Floats:
    """For each frame, the probability that a needle inserted as the advice says hits the true target, (n_frames,).

    The truth was recorded without a needle. Therefore the target's predicted displacement by the needle is added to
    the true position. The probability includes random errors of this displacement and of the needle's tip. It is NaN if
    the advice has no arrival time, or if the true position at that time is not known.
    """
    scene, truth, plan = done.recording.scene, done.recording.truth, done.plan
    found = np.full(len(done.times_s), np.nan)
    node = scene.target.node
    if truth is None or node not in truth.nodes:
        return found
    known = [k for k, one in enumerate(done.guidance) if one.arrival_s is not None and one.depth_m is not None]
    arrivals = np.array([done.guidance[k].arrival_s for k in known], dtype=float)
    _, places = truth.at(arrivals, node)
    places = places + target_map(scene.network, scene.target.point).constant
    pushed = push_m(scene, plan)
    places = places + pushed
    force_sd = plan.forces.planned(scene.network).force_sd
    of_push = SURE_M**2 * np.eye(scene.network.dim) + force_sd**2 * np.outer(pushed, pushed)
    for k, place in zip(known, places, strict=True):
        if not np.isfinite(place).all():
            continue
        axis, depth_m = plan.insertion.axis, plan.insertion.depth_m + float(done.guidance[k].depth_m or 0.0)
        if depth_m < plan.needle.reach_m:  # the target lies behind the needle
            found[k] = 0.0
            continue
        tip = plan.insertion.entry + depth_m * axis
        found[k] = hit_probability(
            GaussianMixture.gaussian(place, of_push),
            GaussianMixture.gaussian(tip, plan.needle.tip_cov(axis, depth_m)),
            axis,
            plan.lesion,
            needle=plan.needle,
        )
    return found


def reliability(done: Advised) -> dict[str, float | int | None]:
    """Mean predicted and mean observed hit probability where truth is known. Keys "go_..." are for the advice GO."""
    observed = observed_hits(done)
    predicted = np.array([np.nan if one.probability is None else one.probability for one in done.guidance])
    known = np.isfinite(predicted) & np.isfinite(observed)
    go = known & np.array([one.advice is Advice.GO for one in done.guidance])
    found: dict[str, float | int | None] = {}
    for name, of in (("", known), ("go_", go)):
        found[f"{name}insertions"] = int(of.sum())
        found[f"{name}predicted"] = float(predicted[of].mean()) if of.any() else None
        found[f"{name}observed"] = float(observed[of].mean()) if of.any() else None
    return found


def header(dim: int) -> list[str]:
    """Names of the columns of advice.csv."""
    aims = [f"aim_{AXES[a]}_mm" for a in range(dim)]
    numbers = ["lateral_mm", "depth_mm", "turn_deg", "p_turned", "best_in_s", "p_best"]
    return ["time_s", "advice", "reason", "arrival_s", "p_hit", *aims, *numbers]


def row(time_s: float, guidance: Guidance, dim: int) -> list[object]:
    """The values of one frame in the order of `header`; None for a missing value."""
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
    """Content of advice.csv in s, mm and degrees, a row per frame with advice; with truth also `observed`."""
    import pandas as pd  # imported here: a live run does not need it and must start at once

    dim = done.recording.scene.network.dim
    rows = [row(time_s, one, dim) for time_s, one in zip(done.times_s, done.guidance, strict=True)]
    frame = pd.DataFrame(rows, columns=header(dim))
    if np.isfinite(observed := observed_hits(done)).any():
        frame["observed"] = observed
    numbers = [column for column in frame.columns if column not in ("advice", "reason")]
    return frame.astype(dict.fromkeys(numbers, float))


def write_advice(done: Advised, folder: Path) -> None:
    """Write advice.csv to an existing folder."""
    (folder / "advice.csv").write_text(table_text(table(done)), encoding="utf-8")
