"""The constants of a network from a calibration recording in which the hidden mark is seen, too.

Gauss-Newton on the filter's innovations: a filter that takes the constants as exact runs beside the sensitivities of
its error to each of them; its innovations y, of covariance S, are then noise and T theta, T their sensitivity to the
constants, theta the errors of these. Source: [friedland1969]. Unknown pokes are states of the filter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynamics import (
    KINDS,
    MassSpringNetwork,
    Parameter,
    ParameterUncertainty,
    independent_uncertainty,
    parameters,
    scale_parameters,
)
from estimators.arrays import Floats
from estimators.tissue.estimate import MarkMeasurement
from estimators.tissue.filter import TissueFilter
from estimators.tissue.settings import FilterSettings

Frames = Sequence[tuple[float, Sequence[MarkMeasurement]]]

PRIOR_SD: Mapping[str, float] = dict.fromkeys(KINDS, 0.5) | {"stiffness": 0.3, "rest_length": 0.05}
"""Prior relative standard deviations of the constants by kind; choice, its cost in docs/settings.md."""

MOST_PASSES = 12
"""Limit of the iteration: Gauss-Newton needs three to five passes."""

CONVERGED = 0.1
"""Tolerance of the iteration in standard errors of a constant: it adds 0.5 % to the error at most."""

SLACK = 1.0
"""Tolerance of the log posterior in the line search: merging modes leaves it uneven by less. At 0 and without limit
the same constants were found in the same number of passes."""


@dataclass(frozen=True, slots=True)
class IdentificationSettings:
    """What is kept of the covariance of identified constants.

    kept: share of the target's variance by uncertain constants that the kept directions explain; choice
    """

    kept: float = 0.995

    def __post_init__(self) -> None:
        if not 0.0 < self.kept <= 1.0:
            raise ValueError(f"identification kept: expected more than 0, at most 1, found {self.kept}")


class IdentificationError(ValueError):
    """A recording from which constants cannot be found; the message gives the reason."""


@dataclass(frozen=True, slots=True, eq=False)
class IdentificationResult:
    """Constants of a network estimated from a calibration recording.

    network: with the constants found
    parameters, change: which, and the log of each by what it was before, (n,)
    cov: covariance of the logs, (n, n); prior_sd: standard deviations of the logs before, (n,)
    uncertainty: the few directions of it that matter for the target
    passes: of the filter through the recording; converged: whether the last moved the constants by less than noise
    """

    network: MassSpringNetwork
    parameters: tuple[Parameter, ...]
    change: Floats
    cov: Floats
    prior_sd: Floats
    uncertainty: ParameterUncertainty
    passes: int
    converged: bool

    @property
    def sd(self) -> Floats:
        """Standard error of the log of each constant, (n,)."""
        return np.sqrt(np.diag(self.cov))

    def identifiable(self) -> tuple[Floats, Floats]:
        """Part of the prior variance left along each direction, worst first, (n,), and the directions, rows (n, n).

        Directions are in the logs of the constants by their prior standard deviations. Where most is left, the
        recording does not identify them: the Fisher information there is below that of the prior.
        """
        left, directions = np.linalg.eigh(self.cov / np.outer(self.prior_sd, self.prior_sd))
        return left[::-1], directions.T[::-1]


@dataclass(frozen=True, slots=True, eq=False)
class _Sum:
    information: Floats
    gradient: Floats
    log_likelihood: float


def identify_constants(
    network: MassSpringNetwork,
    frames: Frames,
    marked: Sequence[str],
    target: str,
    *,
    prior_sd: Mapping[str, float] = PRIOR_SD,
    settings: FilterSettings | None = None,
    kept: IdentificationSettings | None = None,
    advance: Callable[[float], None] = lambda _share: None,
) -> IdentificationResult:
    """Fit the constants of these kinds, relative and on a log scale, with this prior; masses are taken as given.

    frames: (time [s], marks) in order, the target's among the marks; marked: the nodes that may be poked
    `advance` gets the share done. Raises IdentificationError where the target is never seen.
    """
    if not any(mark.node == target for _, marks in frames for mark in marks):
        raise IdentificationError(f"expected the mark of {target} to be seen, found it in none of {len(frames)} frames")
    settings = replace(FilterSettings() if settings is None else settings, test_sigmas=np.inf)
    which = parameters(network, tuple(prior_sd))
    sd = np.array([prior_sd[parameter.kind] for parameter in which])
    prior = independent_uncertainty(which, sd)

    def at(theta: Floats) -> tuple[MassSpringNetwork, _Sum]:
        model = scale_parameters(network, which, sd * theta)
        tissue = TissueFilter(model, target, marked, settings, uncertainty=prior)
        return model, _passed(tissue, frames)

    theta = np.zeros(len(which))
    model, found = at(theta)
    passes, converged, step = 1, False, 1.0
    while passes < MOST_PASSES and not converged:
        advance(passes / (MOST_PASSES + 1))
        H = found.information + np.eye(len(theta))
        move = np.linalg.solve(H, found.gradient - theta)
        error = np.sqrt(np.diag(np.linalg.inv(H)))
        converged = bool(np.abs(move / error).max() < CONVERGED)
        if converged:
            break
        score = found.log_likelihood - 0.5 * theta @ theta
        while True:
            tried = theta + step * move
            model_tried, sum_tried = at(tried)
            passes += 1
            if sum_tried.log_likelihood - 0.5 * tried @ tried >= score - SLACK or passes >= MOST_PASSES:
                break
            step *= 0.5
        theta, model, found, step = tried, model_tried, sum_tried, 1.0
    cov = np.linalg.inv(found.information + np.eye(len(theta))) * np.outer(sd, sd)
    uncertainty = principal_uncertainty(
        model, ParameterUncertainty(which, np.linalg.cholesky(cov).T), frames, marked, target, settings, kept=kept
    )
    advance(1.0)
    return IdentificationResult(
        model, which, sd * theta, np.asarray(cov, dtype=np.float64), sd, uncertainty, passes, converged
    )


def _passed(tissue: TissueFilter, frames: Frames) -> _Sum:
    mixture = tissue.mixture
    mixture.considered = False
    n = tissue.model.n_columns
    information, gradient, log_likelihood = np.zeros((n, n)), np.zeros(n), 0.0
    for time_s, marks in frames:
        started = tissue.seen_s is not None
        tissue.predict(time_s)
        used = tissue.update(marks).marks_used
        if not (started and used):
            continue
        log_likelihood += mixture.log_likelihood
        for weight, f, T in zip(mixture.mu, mixture.filters, mixture.innovation_columns, strict=True):
            if weight > 1e-6:
                solved = np.linalg.solve(f.S, np.column_stack([T, f.y]))
                information += weight * T.T @ solved[:, :-1]
                gradient += weight * T.T @ solved[:, -1]
    return _Sum(information, gradient, log_likelihood)


def principal_uncertainty(
    network: MassSpringNetwork,
    uncertainty: ParameterUncertainty,
    frames: Frames,
    marked: Sequence[str],
    target: str,
    settings: FilterSettings | None = None,
    *,
    kept: IdentificationSettings | None = None,
) -> ParameterUncertainty:
    """The few directions of an uncertainty that explain its effect on the target when the target's mark is not seen.

    The same covariance turned to the axes of the target's variance along the frames; the smallest axes, together below
    1 - `kept` of it, are left out.
    """
    share = (IdentificationSettings() if kept is None else kept).kept
    tissue = TissueFilter(network, target, marked, settings, uncertainty=uncertainty)
    n = tissue.model.n_columns
    effect = np.zeros((n, n))
    for time_s, marks in frames:
        tissue.predict(time_s)
        tissue.update([mark for mark in marks if mark.node != target])
        columns = tissue.target.linear(tissue.mixture.mean_columns)
        effect += columns.T @ columns
    values, axes = np.linalg.eigh(effect)
    values, axes = values[::-1], axes[:, ::-1]
    n_kept = int(np.searchsorted(np.cumsum(values) / values.sum(), share)) + 1
    return ParameterUncertainty(uncertainty.parameters, axes[:, :n_kept].T @ uncertainty.directions)
