"""What the constants of fast prediction and of considered calibration are worth; no setting of a program changes them.

    python -m experiments.studies.settings.sensitivity --out DIR --only "constants of prediction"

The target's path by `predict_fast`, up to one second ahead on the poked phantom, against the truth and against
`TissueFilter.predict_path`; and the filter with a camera's calibration error as in `experiments.studies.calibration`.
The seeds are no published study's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import numpy as np

from dynamics import HIDDEN, OUTER, four_mass_phantom
from estimators import TissueFilter, coverage, fast_prediction_tables, normalised_error_squared, predict_fast
from estimators.filters.mixture import ADDED_SHARE
from estimators.tissue.fast_prediction import SPEEDS_M_S, SPREAD
from estimators.tissue.filter import Snapshot
from experiments.arrays import Floats
from experiments.studies.calibration import CONSIDERED, TURNED, WHOLE, figures, run
from experiments.studies.estimation.trials import Trial, seen

SEEDS = (811, 812)
DURATION_S = 6.0
FRAMES_PER_S = 30
EVERY, AHEAD = 15, 30
"""A path is predicted at each so many frames, so many frames ahead."""

CALIBRATION = ((WHOLE, "quiet", 0.001), (TURNED, "quiet", 0.002))


@dataclass(frozen=True, slots=True)
class PredictionConstants:
    """Constants at the head of `estimators.tissue.fast_prediction` and `estimators.filters.mixture`.

    spread: weight of the velocities' variance beside their squared mean in the typical speed of friction [1]; choice
    n_speeds: speeds of the tables, evenly by their logarithm from 10 to 320 mm/s, beside 0 [1]; choice
    added_share: share of the variance of common errors that gains add as independent [1]; choice
    """

    spread: float = SPREAD
    n_speeds: int = len(SPEEDS_M_S) - 1
    added_share: float = ADDED_SHARE

    @property
    def speeds_m_s(self) -> tuple[float, ...]:
        """Of the tables [m/s]."""
        return (0.0, *np.geomspace(SPEEDS_M_S[1], SPEEDS_M_S[-1], self.n_speeds).tolist())


@dataclass(frozen=True, slots=True, eq=False)
class Ahead:
    """The filter at one time; in the AHEAD frames after it the true target and what `predict_path` gave."""

    state: Snapshot
    truth: Floats
    means: Floats
    covs: Floats


@cache
def _filtered(seeds: tuple[int, ...], duration_s: float) -> tuple[TissueFilter, tuple[Ahead, ...]]:
    tissue = TissueFilter(four_mass_phantom(), HIDDEN, OUTER)
    moments = []
    for seed in seeds:
        own = TissueFilter(four_mass_phantom(), HIDDEN, OUTER)
        with TemporaryDirectory() as folder:
            trial = Trial("poked", seed, duration_s=duration_s, mark_sd_m=1e-3)
            frames, truth = seen(trial, Path(folder), np.random.default_rng(seed))
        for k, (time_s, marks) in enumerate(frames):
            own.predict(time_s)
            own.update(marks)
            if k % EVERY == EVERY - 1 and k + AHEAD < len(frames):
                times = time_s + np.arange(1, AHEAD + 1) / FRAMES_PER_S
                moments.append(Ahead(own.snapshot(), truth[k + 1 : k + AHEAD + 1], *own.predict_path(times)))
    return tissue, tuple(moments)


def prediction_figures(
    constants: PredictionConstants,
    seeds: Sequence[int] = SEEDS,
    duration_s: float = DURATION_S,
    calibrations: Sequence[tuple[str, str, float]] = CALIBRATION,
) -> dict[str, float]:
    """How well paths are predicted fast, and the target's error and coverage with a calibration error.

    ahead_mm, ahead_coverage, ahead_nees: rms error, coverage of the 95 % region and NEES by `predict_fast`
    sigma_ratio: its sigma by that of `predict_path`, mean; calibrated_mm, calibrated_nees: with a calibration error
    """
    tissue, moments = _filtered(tuple(seeds), duration_s)
    errors, covs, ratios = [], [], []
    with (
        patch("estimators.tissue.fast_prediction.SPREAD", constants.spread),
        patch("estimators.tissue.fast_prediction.SPEEDS_M_S", constants.speeds_m_s),
    ):
        tables = fast_prediction_tables(tissue, AHEAD / FRAMES_PER_S)
        for one in moments:
            tissue.restore(one.state)
            times, means, fast = predict_fast(tables, tissue)
            for j in range(5, AHEAD, 6):
                i = int(np.abs(times - times[0] - (j + 1) / FRAMES_PER_S).argmin())
                errors.append(means[i] - one.truth[j])
                covs.append(fast[i])
                ratios.append(np.sqrt(np.trace(fast[i]) / np.trace(one.covs[j])))
    error = np.array(errors)
    nees = normalised_error_squared(error, np.array(covs))
    with TemporaryDirectory() as folder, patch("estimators.filters.mixture.ADDED_SHARE", constants.added_share):
        runs = [run(seed, case, Path(folder), 3.0, filters=(CONSIDERED,)) for seed in seeds for case in calibrations]
    calibrated = figures(runs, CONSIDERED)
    return {
        "ahead_mm": 1e3 * float(np.sqrt((error**2).sum(axis=1).mean())),
        "ahead_coverage": coverage(nees, 2),
        "ahead_nees": float(nees.mean()),
        "sigma_ratio": float(np.mean(ratios)),
        "calibrated_mm": calibrated["error_mm"],
        "calibrated_nees": calibrated["mean_nees"],
    }
