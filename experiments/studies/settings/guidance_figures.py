"""What the settings of advice and breathing are worth: advised insertions replayed on simulated phantoms.

The poked and the breathing phantom, marks found to 1 mm, frames and marks missing now and then. The filter runs once a
seed; the advice on its estimates is replayed for each variant. An insertion goes straight at the commanded speed; its
tip and the target's true motion decide on a hit. The seeds are no published study's.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np

from dynamics import HIDDEN, OUTER, four_mass_phantom
from estimators import (
    Advice,
    AdviceSettings,
    Breathing,
    BreathingSettings,
    Guidance,
    Hit,
    Insertion,
    Lesion,
    Needle,
    Status,
    TargetEstimate,
    TargetPath,
    TissueFilter,
    advise,
    either_path,
    fast_prediction_tables,
    health_fault,
    path_times,
    predict_fast,
    reliability_bins,
)
from experiments.arrays import Floats
from experiments.studies.estimation.trials import Trial, seen

SEEDS = (801, 802)
DURATIONS_S: Mapping[str, float] = {"poked": 12.0, "breathing": 20.0}
LONGEST_S = 6.0
"""The path is predicted so far ahead [s]: twice the horizon, and the way."""

EVERY = 3
"""Advice is asked for at each so many frames; estimates of two frames in a row hardly differ."""

NEEDLE, LESION = Needle(hit=Hit.TIP), Lesion.ball(4e-3, 2)
ABOVE_M, SPEED_M_S = 0.03, 0.1
PHASE_S = 0.5
"""The breath is predicted so far ahead [s], the way of a needle of this speed and some delay."""


@dataclass(frozen=True, slots=True)
class GuidanceSettings:
    """The settings whose worth is measured here."""

    advice: AdviceSettings = field(default_factory=AdviceSettings)
    breathing: BreathingSettings = field(default_factory=BreathingSettings)


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """The filter at one time: its last estimate, when a mark was last used, and the target's path from its tables.

    new: whether a frame came at this time
    """

    now_s: float
    estimate: TargetEstimate
    seen_s: float | None
    path: TargetPath
    new: bool


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """A seeded run of the filter: its moments, and where the target was [m], (n, 2), at times_s [s], (n,)."""

    moments: tuple[Moment, ...]
    times_s: Floats
    truth: Floats

    def target(self, times_s: Floats) -> Floats:
        """Where the target was at these times [m], (k, 2)."""
        return np.stack([np.interp(times_s, self.times_s, self.truth[:, a]) for a in range(2)], axis=-1)


@cache
def filtered(scenario: str, seed: int, duration_s: float) -> Run:
    """The filter on a run: every third second 0.4 s without marks, every fourth 0.25 s without frames."""
    trial = Trial(scenario, seed, duration_s=duration_s, mark_sd_m=1e-3, lost=0.05)
    with tempfile.TemporaryDirectory() as folder:
        frames, truth = seen(trial, Path(folder), np.random.default_rng(seed))
    tissue = TissueFilter(four_mass_phantom(), HIDDEN, OUTER)
    tables = fast_prediction_tables(tissue, LONGEST_S)
    moments: list[Moment] = []
    for k, (time_s, marks) in enumerate(frames):
        if moments and time_s % 4.0 > 3.75:
            last = moments[-1]
            moments.append(Moment(time_s, last.estimate, last.seen_s, last.path, new=False))
            continue
        tissue.predict(time_s)
        estimate = tissue.update([] if k and time_s % 3.0 > 2.6 else marks)
        path = TargetPath(*predict_fast(tables, tissue))
        moments.append(Moment(time_s, estimate, tissue.seen_s, path, new=True))
    return Run(tuple(moments), np.array([t for t, _ in frames]), truth)


def guided(run: Run, settings: GuidanceSettings, insertion: Insertion) -> Iterator[tuple[Moment, Breathing, Guidance]]:
    """The advice at each moment that is asked about, by the breath where there is one."""
    breathing = Breathing(2, settings.breathing)
    for k, moment in enumerate(run.moments):
        estimate = moment.estimate
        if moment.new and moment.now_s > 0.5 and estimate.status is Status.TRACKING and estimate.cov is not None:
            breathing.update(moment.now_s, estimate.mean, estimate.cov)
        if k % EVERY:
            continue
        fault = health_fault(estimate, moment.now_s, moment.seen_s, settings.advice)
        if fault is not None:
            yield moment, breathing, Guidance(Advice.NO_GUIDANCE, fault)
            continue
        needed = path_times(estimate, insertion, NEEDLE, settings.advice, moment.now_s)
        n = min(int(np.searchsorted(moment.path.times_s, needed[-1])) + 1, len(moment.path.times_s))
        times = moment.path.times_s[:n]
        path = TargetPath(times, moment.path.means[:n], moment.path.covs[:n])
        if breathing.breath() is not None:
            path = either_path(TargetPath(times, *breathing.predict(times)), path, breathing.holds(times))
        found = advise(path, insertion, LESION, needle=NEEDLE, settings=settings.advice, now_s=moment.now_s)
        yield moment, breathing, found


def guidance_figures(
    settings: GuidanceSettings, seeds: Sequence[int] = SEEDS, durations_s: Mapping[str, float] = DURATIONS_S
) -> dict[str, float]:
    """Hit rate of insertions begun on GO, share of GO, and how well probabilities and breaths come true.

    calibration_error: mean distance of predicted probabilities from the rate of hits, over tenths of them
    breathing_error_mm, breathing_nees: of the breath's prediction PHASE_S ahead, NEES by its degrees of freedom
    breathing_share: of the moments of breathing runs at which there is a breath
    """
    go: list[bool] = []
    asked, predicted, hits = 0, [], []
    errors, nees, breaths, n_breathing = [], [], 0, 0
    place = four_mass_phantom().positions[four_mass_phantom().index(HIDDEN)]
    insertion = Insertion(place + np.array([0.0, ABOVE_M]), np.array([0.0, -1.0]), SPEED_M_S)
    for seed in seeds:
        for scenario, duration_s in durations_s.items():
            run, rng = filtered(scenario, seed, duration_s), np.random.default_rng(seed)
            for moment, breathing, found in guided(run, settings, insertion):
                asked += 1
                noise = rng.standard_normal(2)
                if scenario == "breathing":
                    n_breathing += 1
                    ahead = np.array([moment.now_s + PHASE_S])
                    if ahead[0] <= run.times_s[-1] and breathing.breath() is not None:
                        breaths += 1
                        means, covs = breathing.predict(ahead)
                        error = (run.target(ahead) - means)[0]
                        errors.append(float(np.linalg.norm(error)))
                        nees.append(0.5 * float(error @ np.linalg.solve(covs[0], error)))
                if found.probability is None or found.depth_m is None or found.arrival_s is None:
                    continue
                if found.arrival_s > run.times_s[-1]:
                    continue
                spread = np.linalg.cholesky(NEEDLE.tip_cov(insertion.axis, found.depth_m))
                tip = insertion.entry + found.depth_m * insertion.axis + spread @ noise
                hit = bool(LESION.contains(tip - run.target(np.array([found.arrival_s])))[0])
                predicted.append(min(found.probability, 1.0))
                hits.append(hit)
                if found.advice is Advice.GO:
                    go.append(hit)
    bins = [one for one in reliability_bins(predicted, hits) if one.mean is not None]
    return {
        "go_hit_rate": float(np.mean(go)) if go else 0.0,
        "go_share": len(go) / asked,
        "calibration_error": sum(one.n * abs((one.mean or 0.0) - one.hits / one.n) for one in bins) / max(len(hits), 1),
        "breathing_error_mm": 1e3 * float(np.mean(errors)) if errors else 0.0,
        "breathing_nees": float(np.mean(nees)) if nees else 0.0,
        "breathing_share": breaths / max(n_breathing, 1),
    }
