"""The filter: one Gaussian for each mode, mixed as interacting multiple models, and one iterated update."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, cho_factor, cho_solve, expm

from estimators.arrays import Floats
from estimators.core.discrepancy import LevelPosterior
from estimators.core.protocols import Observation, ProcessModel, Transition

DISCREPANCY = "discrepancy"
"""Name of the part of a state whose variance is the square of the level."""

LEAST_SHARE = 1e-3
"""Share of a mode below which another is not mixed into it: it would only be widened by what the marks refute [1];
choice."""

LINEARISATIONS = 3
"""Of transition and observation in a frame, at most; numerical."""

CURVED = 0.1
"""Standard deviations of an observation by which it may differ from its linearisation [1]; numerical."""

Groups = Callable[[Sequence[str], Sequence[slice]], Sequence[NDArray[np.int64]]]


@dataclass(frozen=True, slots=True, eq=False)
class _Prior:
    """Hypotheses before a transition: means (k, n), covs (k, n, n), over dt [s]."""

    means: Floats
    covs: Floats
    dt: float


@dataclass(frozen=True, slots=True, eq=False)
class Innovations:
    """What was observed, less what each hypothesis predicted.

    Attributes
    ----------
    y, S, H : (k, m), (k, m, m), (k, m, n)
        Innovation, its covariance, and the derivative of the observation by the state.
    """

    y: Floats
    S: Floats
    H: Floats


class HypothesisFilter:
    """Gaussian hypotheses of a state, one for each mode of the process.

    All of them share one linearisation of the transition, about their mean, and about their smoothed mean where the
    marks show that it was taken in the wrong place: an iterated update through the process. Source: [blom1988] for the
    mixing, [garciafernandez2017] for the iteration.

    Parameters
    ----------
    process : ProcessModel
    level : LevelPosterior, optional
        Of the discrepancy; without one its level is 1.
    groups : callable, optional
        Of names and their blocks of rows: for each name the rows that are withheld with it, (k, dim).

    Attributes
    ----------
    means, covs, weights : (k, n), (k, n, n), (k,)
        The hypotheses.
    log_likelihood : float
        Of the last observations.
    """

    def __init__(
        self, process: ProcessModel, level: LevelPosterior | None = None, groups: Groups | None = None
    ) -> None:
        self.process, self.level, self._groups = process, level, groups or _each
        self._before: _Prior | None = None
        self._transition: Transition | None = None
        self._reference = np.empty(0)
        self.restart()

    def restart(self) -> None:
        """Begin at the prior of the process."""
        mean, covs = self.process.prior(self._level)
        k = len(covs)
        self.means, self.covs, self.weights = np.tile(mean, (k, 1)), covs.copy(), np.full(k, 1.0 / k)
        self._before, self.log_likelihood, self._dt = None, 0.0, 0.0

    @property
    def mean(self) -> Floats:
        """Mean of the mixture, (n,)."""
        return np.asarray(self.weights @ self.means)

    def moments(self, rows: Floats) -> tuple[Floats, Floats]:
        """Mean (d,) and covariance (d, d) of a linear map of the state, (d, n)."""
        means = self.means @ rows.T
        covs = rows @ self.covs @ rows.T
        mean = self.weights @ means
        apart = means - mean
        return mean, np.einsum("k,kij->ij", self.weights, covs + apart[:, :, None] * apart[:, None, :])

    def predict(self, dt: float) -> None:
        """Move all hypotheses by dt [s], more than 0."""
        joint = self.weights[:, None] * expm(self.process.rates * dt)
        weights = joint.sum(axis=0)
        shares = joint / weights
        shares = np.where(shares < LEAST_SHARE, 0.0, shares)
        shares /= shares.sum(axis=0)
        means = shares.T @ self.means
        covs = np.tensordot(shares.T, self.covs, 1)
        for k, mean in enumerate(means):
            apart = self.means - mean
            covs[k] += (apart.T * shares[:, k]) @ apart
        if self.level is not None:
            self.level.forget(dt)
        self.weights, self._before, self._dt = weights, _Prior(means, covs, dt), dt
        self._move(self._before, weights @ means)

    def _move(self, before: _Prior, reference: Floats) -> None:
        found = self.process.linearize(reference, before.dt)
        T, variances = found.matrix, self.process.variances(self._level)
        self.means = found.mean + (before.means - reference) @ T.T
        covs = T @ before.covs @ T.T + np.tensordot(variances, found.noises, 1)
        self.covs = 0.5 * (covs + covs.swapaxes(1, 2))
        self._transition, self._reference = found, reference

    @property
    def _level(self) -> float:
        return 1.0 if self.level is None else self.level.level

    def innovations(self, observations: Sequence[Observation], points: Floats | None = None) -> Innovations:
        """Of each hypothesis, linearised at these states, (k, n), its mean where there are none."""
        R = block_diag(*(one.cov for one in observations))
        value = np.concatenate([one.value for one in observations])
        points = self.means if points is None else points
        y, S, Hs = [], [], []
        for mean, point, P in zip(self.means, points, self.covs, strict=True):
            linear = [one.linearize(point) for one in observations]
            H = np.vstack([matrix for _, matrix in linear])
            y.append(value - np.concatenate([predicted for predicted, _ in linear]) - H @ (mean - point))
            S.append(H @ P @ H.T + R)
            Hs.append(H)
        return Innovations(np.array(y), np.array(S), np.array(Hs))

    def update(self, observations: Sequence[Observation]) -> float:
        """Take in all that was observed at this time; the least normalised innovation squared of any hypothesis."""
        for _ in range(LINEARISATIONS - 1):
            if not self._relinearised(self.innovations(observations)):
                break
        points = None
        for _ in range(LINEARISATIONS):
            found = self.innovations(observations, points)
            factors = [cho_factor(S, lower=True) for S in found.S]
            weighted = [cho_solve(one, y) for one, y in zip(factors, found.y, strict=True)]
            means = np.array(
                [m + P @ (H.T @ w) for m, P, H, w in zip(self.means, self.covs, found.H, weighted, strict=True)]
            )
            if self._is_linear(observations, found, means, points):
                break
            points = means
        nis = np.array([y @ w for y, w in zip(found.y, weighted, strict=True)])
        log_det = np.array([2.0 * np.log(np.diag(one[0])).sum() for one in factors])
        if self.level is not None:
            self._weigh_levels(self.level, observations, found, nis + log_det)
        covs = []
        for P, H, one in zip(self.covs, found.H, factors, strict=True):
            PH = P @ H.T
            updated = P - PH @ cho_solve(one, PH.T)
            covs.append(0.5 * (updated + updated.T))
        logs = np.log(self.weights + 1e-300) - 0.5 * (nis + log_det + len(found.y[0]) * np.log(2.0 * np.pi))
        self.log_likelihood = float(np.logaddexp.reduce(logs))
        self.means, self.covs, self.weights = means, np.array(covs), np.exp(logs - self.log_likelihood)
        self._before = None
        return float(nis.min())

    def _relinearised(self, found: Innovations) -> bool:
        """Whether the transition was linearised again, about the smoothed mean of the hypotheses."""
        before, transition = self._before, self._transition
        if before is None or transition is None or not np.isfinite(self.process.tolerance).any():
            return False
        solved = np.linalg.solve(found.S, found.y[..., None])[..., 0]
        logs = np.log(self.weights + 1e-300) - 0.5 * np.einsum("km,km->k", found.y, solved)
        logs -= 0.5 * np.linalg.slogdet(found.S)[1]
        weights = np.exp(logs - logs.max())
        weights /= weights.sum()
        back = np.einsum("kmn,km->kn", found.H, solved) @ transition.matrix
        smoothed = weights @ (before.means + np.einsum("kij,kj->ki", before.covs, back))
        linear = transition.mean + transition.matrix @ (smoothed - self._reference)
        moved = self.process.moved(smoothed, before.dt)
        if not np.isfinite(moved).all() or np.all(np.abs(moved - linear) <= self.process.tolerance):
            return False
        self._move(before, smoothed)
        return True

    def _is_linear(
        self, observations: Sequence[Observation], found: Innovations, means: Floats, points: Floats | None
    ) -> bool:
        """Whether the observations at the updated means are as their linearisation says."""
        best = int(np.argmax(self.weights))
        there = np.concatenate([one.linearize(means[best])[0] for one in observations])
        value = np.concatenate([one.value for one in observations])
        linear = value - found.y[best] + found.H[best] @ (means[best] - self.means[best])
        sd = np.sqrt(np.concatenate([np.diag(one.cov) for one in observations]))
        return bool(np.all(np.abs(there - linear) <= CURVED * sd))

    def _weigh_levels(
        self, level: LevelPosterior, observations: Sequence[Observation], found: Innovations, misfit: Floats
    ) -> None:
        """By the hypothesis that is most probable now."""
        best = int(np.argmax(np.log(self.weights + 1e-300) - 0.5 * misfit))
        own = found.H[best][:, self.process.parts[DISCREPANCY]]
        names: list[str] = []
        blocks: list[slice] = []
        start = 0
        for one in observations:
            names += one.names
            blocks += [slice(block.start + start, block.stop + start) for block in one.blocks]
            start += len(one.value)
        fresh = self.process.fresh(self._dt) * own @ own.T
        level.update(found.y[best], found.S[best], fresh, self._groups(names, blocks))


def _each(names: Sequence[str], blocks: Sequence[slice]) -> Sequence[NDArray[np.int64]]:
    """Each name is withheld by itself."""
    return [np.arange(block.start, block.stop)[None] for block in blocks]
