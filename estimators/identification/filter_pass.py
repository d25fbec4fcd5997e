"""One pass of the filter through a recording: predictions of the hidden marks, and their sensitivity to constants.

The filter uses only the marks of the marked nodes. The hidden marks, which are the marks of all other nodes including
the target, are compared with their predictions. If the filter used all marks, a wrong prior of the forces would cause
wrong constants.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynamics import MassSpringNetwork, ParameterUncertainty
from estimators.arrays import Floats
from estimators.core.discrepancy import Discrepancy
from estimators.core.track import TissueFilter
from estimators.filters.unscented import CovarianceError
from estimators.identification.budget import Budget
from estimators.tissue.estimate import MarkMeasurement
from estimators.tissue.settings import FilterSettings

Frames = Sequence[tuple[float, Sequence[MarkMeasurement]]]

LEVEL = 0.003
"""Discrepancy of the model if `FilterSettings.discrepancy` is None [1]; choice. A discrepancy that is estimated from
the marks would be too large here, because wrong constants increase it."""

SMALL = 1e-3
"""Factor by which the standard deviations of the constants are multiplied in the filter [1]; numerical. Then the gains
of the filter are practically those for exact constants."""


@dataclass(frozen=True, slots=True, eq=False)
class Pass:
    """Log likelihood of the hidden marks, and its derivatives along n directions in the space of the constants.

    The log likelihood is composite: it is a sum over frames, although frames are not independent.

    scores: derivatives of each frame's log likelihood along the directions, (n_frames, n)
    information: Fisher information, (n, n); log_likelihood: log likelihood of all frames
    nis: normalised innovation squared of each frame, without outliers, (n_frames,)
    dof: expected number of inlying coordinates of each frame, the degrees of freedom of nis, (n_frames,)
    n_hidden, n_outliers: number of hidden marks, and expected number of outliers among them
    effect: sum of `T' T` over the frames [m²], (n, n); columns of T: derivatives of the target's error along directions
    target_error_m: median distance between the predicted target and its mark [m]; None if the target has no mark
    """

    scores: Floats
    information: Floats
    log_likelihood: float
    nis: Floats
    dof: Floats
    effect: Floats
    target_error_m: float | None = None
    n_hidden: int = 0
    n_outliers: float = 0.0

    @property
    def gradient(self) -> Floats:
        """Gradient of the log likelihood, (n,)."""
        return np.asarray(self.scores.sum(axis=0))


def failed_pass(n: int) -> Pass:
    """Result of a pass in which the filter fails numerically: likelihood zero and no information on n directions."""
    none = np.zeros((n, n))
    return Pass(np.zeros((0, n)), none, -np.inf, np.zeros(0), np.zeros(0), none)


def pass_through(
    network: MassSpringNetwork,
    uncertainty: ParameterUncertainty,
    frames: Frames,
    nodes: tuple[Sequence[str], str],
    settings: FilterSettings,
    budget: Budget,
) -> Pass:
    """Run the filter through the frames as if the constants were exact.

    nodes: marked nodes, and the target. Raises OutOfTimeError.
    The derivative of the error of a state x with respect to a constant c is `cov(x, c) / var(c)` [friedland1969].
    """
    marked, target = nodes
    taken = frozenset(marked) - {target}
    level = LEVEL if settings.discrepancy is None else settings.discrepancy
    exact = replace(settings, discrepancy=level, test_sigmas=np.inf)
    small = ParameterUncertainty(uncertainty.parameters, SMALL * uncertainty.directions)
    n, log_likelihood, n_hidden, n_outliers = len(small.directions), 0.0, 0, 0.0
    information, effect = np.zeros((n, n)), np.zeros((n, n))
    scores, nis, dof, errors = list[Floats](), list[float](), list[float](), list[float]()
    try:
        field = Discrepancy.of(exact, solid=network.continuum is not None)
        prior = replace(field, noises=field.noises[:1])  # a larger noise of marks would explain wrong constants
        tissue = TissueFilter(network, target, marked, exact, uncertainty=small, discrepancy=prior)
        own = tissue.process.parts.get("constants", slice(0, 0))
        at_target = tissue.rows_of(tissue.target)
        for time_s, marks in frames:
            budget.check()
            tissue.predict(time_s)
            estimate = tissue.update([mark for mark in marks if mark.node in taken])
            if tissue.seen_s is None:
                continue
            T = at_target @ np.tensordot(tissue.filter.weights, tissue.filter.covs[:, :, own], 1) / SMALL
            effect += T.T @ T
            hidden = [mark for mark in marks if mark.node not in taken]
            errors += [float(np.linalg.norm(estimate.mean - mark.position)) for mark in hidden if mark.node == target]
            if not hidden:
                continue
            found = tissue.filter.innovations([tissue.places(hidden)])
            total = float(np.logaddexp.reduce(found.logs))
            weights, Ts = np.exp(found.logs - total), found.root @ found.HP[:, :, own] / SMALL
            log_likelihood += total - 0.5 * found.y.shape[1] * float(np.log(2.0 * np.pi))
            information += np.einsum("k,kmi,kmj->ij", weights, Ts, Ts)
            scores.append(np.einsum("k,kmi,km->i", weights, Ts, found.white))
            nis.append(float(weights @ found.nis))
            outlying = float(weights @ found.outlying.sum(axis=1))
            dof.append(found.y.shape[1] - network.dim * outlying)
            n_hidden, n_outliers = n_hidden + len(hidden), n_outliers + outlying
    except (CovarianceError, np.linalg.LinAlgError):
        return failed_pass(n)
    if not np.isfinite(log_likelihood):
        return failed_pass(n)
    median = float(np.median(errors)) if errors else None
    of_frames = np.array(scores).reshape(len(scores), n)
    return Pass(
        of_frames, information, log_likelihood, np.array(nis), np.array(dof), effect, median, n_hidden, n_outliers
    )
