"""One pass of the filter through a recording: likelihood of its innovations, and their sensitivity to constants."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynamics import MassSpringNetwork, ParameterUncertainty
from estimators.arrays import Floats
from estimators.filters.unscented import CovarianceError
from estimators.identification.budget import Budget
from estimators.tissue.estimate import MarkMeasurement, Status
from estimators.tissue.filter import TissueFilter
from estimators.tissue.settings import FilterSettings

Frames = Sequence[tuple[float, Sequence[MarkMeasurement]]]

LEAST_WEIGHT = 1e-6
"""Probability of a mode below which its innovations add nothing: rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class Pass:
    """What innovations of a recording contain about errors of the constants, in units of their directions.

    scores: gradient of the log likelihood by each direction, frame by frame, (n_frames, n)
    information: its Fisher information, (n, n); log_likelihood: of all marks, rejected ones as if at the gate
    nis: normalised innovation squared of each frame, (n_frames,); dof: its degrees of freedom, (n_frames,)
    """

    scores: Floats
    information: Floats
    log_likelihood: float
    nis: Floats
    dof: Floats

    @property
    def gradient(self) -> Floats:
        """Of the log likelihood, (n,)."""
        return np.asarray(self.scores.sum(axis=0))


def failed_pass(n: int) -> Pass:
    """Of constants under which the filter has no finite state: of no likelihood, and without information."""
    return Pass(np.zeros((0, n)), np.zeros((n, n)), -np.inf, np.zeros(0), np.zeros(0))


def pass_through(
    network: MassSpringNetwork,
    uncertainty: ParameterUncertainty,
    frames: Frames,
    nodes: tuple[Sequence[str], str],
    settings: FilterSettings,
    budget: Budget,
) -> Pass:
    """The filter through the frames, constants taken as exact, beside the sensitivities to each direction.

    nodes: those that may be poked, and the target. Source: [friedland1969]. Raises OutOfTimeError.
    """
    marked, target = nodes
    try:
        return _passed(TissueFilter(network, target, marked, settings, uncertainty=uncertainty), frames, budget)
    except (CovarianceError, np.linalg.LinAlgError):
        return failed_pass(len(uncertainty.directions))


def _passed(tissue: TissueFilter, frames: Frames, budget: Budget) -> Pass:
    mixture = tissue.mixture
    mixture.considered = False
    n = tissue.model.n_columns
    information, log_likelihood = np.zeros((n, n)), 0.0
    scores, nis, dof = [], [], []
    for time_s, marks in frames:
        budget.check()
        starting = tissue.seen_s is None or tissue.health.status is Status.LOST
        tissue.predict(time_s)
        starting = starting or tissue.health.status is Status.LOST
        used = tissue.update(marks).marks_used
        if starting:
            continue
        log_likelihood += tissue.log_likelihood
        # branches that were made or given up in this frame have no innovations of it
        if not used or len(mixture.filters) != len(mixture.innovation_columns):
            continue
        score, squared = np.zeros(n), 0.0
        for weight, f, T in zip(mixture.mu, mixture.filters, mixture.innovation_columns, strict=True):
            if weight > LEAST_WEIGHT:
                solved = np.linalg.solve(f.S, np.column_stack([T, f.y]))
                information += weight * T.T @ solved[:, :-1]
                score += weight * T.T @ solved[:, -1]
                squared += weight * float(f.y @ solved[:, -1])
        scores.append(score)
        nis.append(squared)
        dof.append(float(len(mixture.filters[0].y)))
    return Pass(np.array(scores).reshape(-1, n), information, log_likelihood, np.array(nis), np.array(dof))
