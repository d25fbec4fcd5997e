"""What the priors of identification are worth: constants and noise levels of a small chain, found from recordings.

    python -m experiments.studies.settings.sensitivity --out DIR --only identification

Two masses in a row between two anchors, marks to 1 mm, 15 frames/s, the near mass poked. The model given has other
constants, drawn from the priors' defaults. What was found is judged by another recording of the same chain in which the
far mass's mark is not used. The seeds are no published study's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from unittest.mock import patch

import numpy as np

from dynamics import KINDS, MassSpringNetwork, build_network, parameters, rest_shape, scale_parameters
from estimators import (
    IdentificationResult,
    IdentificationSettings,
    TissueFilter,
    coverage,
    identify_constants,
    normalised_error_squared,
    tune_noise,
)
from estimators.identification.constants import PRIOR_SD
from estimators.identification.noise_levels import PRIOR_LOG_SD, log_likelihood, with_scaled_noise
from experiments.arrays import Floats
from experiments.studies.estimation import identification
from experiments.studies.estimation.trials import Frames

SEEDS = (851, 852)
LONG_S, SHORT_S = 4.0, 3.0
"""Length of recordings for constants and for noise levels [s]."""

NEAR, FAR = "near", "far"
FRAMES_PER_S = 15

OTHERS = tuple(kind for kind in KINDS if kind not in ("stiffness", "rest_length"))


@dataclass(frozen=True, slots=True)
class Identification:
    """Settings and prior standard deviations of identification.

    kept: share of the target's variance by uncertain constants that the kept directions explain [1]; choice
    stiffness_sd, rest_length_sd, other_sd: of the logarithm of a constant, by kind [1]; choice
    level_log_sd: of the logarithm of a noise level [1]; choice
    """

    kept: float = IdentificationSettings().kept
    stiffness_sd: float = PRIOR_SD["stiffness"]
    rest_length_sd: float = PRIOR_SD["rest_length"]
    other_sd: float = PRIOR_SD[OTHERS[0]]
    level_log_sd: float = float(PRIOR_LOG_SD)

    @property
    def prior_sd(self) -> dict[str, float]:
        """By kind, in the order of `PRIOR_SD`."""
        own = {"stiffness": self.stiffness_sd, "rest_length": self.rest_length_sd}
        return {kind: own.get(kind, self.other_sd) for kind in PRIOR_SD}


@cache
def chain() -> MassSpringNetwork:
    """Two masses in a row between two anchors, hung aslant, at rest."""
    drawn = build_network(
        ("A", NEAR, FAR, "B"),
        [[0.0, 0.0], [0.1, -0.02], [0.2, -0.03], [0.3, 0.0]],
        [("A", NEAR), (NEAR, FAR), (FAR, "B")],
        stiffness=60.0,
        damping=0.3,
        masses=0.2,
        drag=[0.0, 0.3, 0.3, 0.0],
        fixed=("A", "B"),
        gravity=[0.0, -9.81],
        rest_lengths=0.09,
    )
    return replace(drawn, positions=rest_shape(drawn))


@cache
def recorded(seed: int, duration_s: float) -> tuple[Frames, Floats]:
    """Frames with both marks, and where the far mass was [m], (n_frames, 2)."""
    frames, places = identification.recorded(chain(), (NEAR,), seed, duration_s, FRAMES_PER_S)
    return frames, places[:, 1]


def identified(choices: Identification, seed: int, duration_s: float) -> tuple[IdentificationResult, Floats]:
    """What is found from wrong constants, and its error, (n,), in logarithms."""
    network = chain()
    which = parameters(network, tuple(PRIOR_SD))
    change = np.array([PRIOR_SD[one.kind] for one in which]) * np.random.default_rng([seed, 1]).normal(size=len(which))
    wrong = scale_parameters(network, which, change)
    frames, _ = recorded(seed, duration_s)
    search = IdentificationSettings(kept=choices.kept)
    found = identify_constants(wrong, frames, (NEAR,), FAR, prior_sd=choices.prior_sd, search=search)
    return found, found.change + change


def _unseen(found: IdentificationResult, seed: int, duration_s: float) -> tuple[Floats, Floats]:
    """Errors of the far mass [m], (n, 2), and NEES, (n,), on another recording, its mark not used."""
    tissue = TissueFilter(found.network, FAR, (NEAR,), uncertainty=found.uncertainty)
    errors, covs = [], []
    for (time_s, marks), place in zip(*recorded(seed + 50, duration_s), strict=True):
        tissue.predict(time_s)
        estimate = tissue.update([mark for mark in marks if mark.node != FAR])
        errors.append(estimate.mean - place)
        covs.append(estimate.cov)
    return np.array(errors), normalised_error_squared(np.array(errors), np.array(covs))


@cache
def _levels(level_log_sd: float, seed: int, duration_s: float) -> tuple[float, float]:
    """Log likelihood a frame of another recording by the noise levels found, and their mean standard error."""
    network = chain()
    with patch("estimators.identification.noise_levels.PRIOR_LOG_SD", level_log_sd):
        tuned = tune_noise(network, recorded(seed, duration_s)[0], (NEAR,), FAR)
    others = with_scaled_noise(recorded(seed + 50, duration_s)[0], tuned.marks)
    score = log_likelihood(TissueFilter(network, FAR, (NEAR,), tuned.settings), others)
    return score / len(others), float(tuned.log_sd.mean())


def identification_figures(
    choices: Identification,
    seeds: Sequence[int] = SEEDS,
    durations_s: tuple[float, float] = (LONG_S, SHORT_S),
) -> dict[str, float]:
    """Error and coverage of constants found, what they are worth for the target, and noise levels found.

    stiffness_error, rest_length_error: rms, in logarithms; covered: share of the constants within 1.96 standard errors
    target_mm, target_coverage: rms error of the far mass and coverage of its 95 % region on another recording
    directions: kept of the uncertainty, mean number
    level_score: log likelihood a frame of another recording by the noise levels found; level_sd: their standard error
    """
    long_s, short_s = durations_s
    results = [identified(choices, seed, long_s) for seed in seeds]
    kinds = np.array([one.kind for one in results[0][0].parameters])
    errors = np.array([error for _, error in results])
    within = [np.abs(error) < 1.96 * found.sd for found, error in results]
    unseen = [_unseen(found, seed, long_s) for (found, _), seed in zip(results, seeds, strict=True)]
    levels = np.array([_levels(choices.level_log_sd, seed, short_s) for seed in seeds])
    return {
        "stiffness_error": float(np.sqrt(np.mean(errors[:, kinds == "stiffness"] ** 2))),
        "rest_length_error": float(np.sqrt(np.mean(errors[:, kinds == "rest_length"] ** 2))),
        "covered": float(np.mean(within)),
        "target_mm": 1e3 * float(np.sqrt(np.mean(np.concatenate([(e**2).sum(axis=1) for e, _ in unseen])))),
        "target_coverage": coverage(np.concatenate([nees for _, nees in unseen]), 2),
        "directions": float(np.mean([len(found.uncertainty.directions) for found, _ in results])),
        "level_score": float(levels[:, 0].mean()),
        "level_sd": float(levels[:, 1].mean()),
    }
