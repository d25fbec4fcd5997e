"""The filter: one Gaussian for each mode, mixed as interacting multiple models, and one iterated update."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, expm

from estimators.arrays import Floats
from estimators.core.discrepancy import LevelPosterior
from estimators.core.protocols import Observation, ProcessModel, Transition

DISCREPANCY = "discrepancy"
"""Name of the part of a state whose variance is the square of the level."""

LEAST_SHARE = 1e-3
"""Share of a mode below which another is not mixed into it: it would only be widened by what the marks refute [1];
choice."""

LINEARISATIONS = 10
"""Of a transition and of an observation in a frame, at most: a stiff, thin body that turns needs many; numerical."""

CURVED = 0.1
"""Standard deviations of an observation by which it may differ from its linearisation [1]; numerical."""

AT_A_TIME = 2**15
"""Entries of covariances that stay in the cache; numerical."""

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
    y, S : (k, m), (k, m, m)
        Innovation and its covariance.
    H, PH : (1, m, n) or (k, m, n), (k, n, m)
        Derivative of the observation by the state, once where it is the same for all hypotheses, and P H'.
    root, white : (k, m, m), (k, m)
        Inverse of the lower Cholesky factor of S, and that times the innovation.
    log_det : (k,)
        Logarithm of the determinant of S.
    """

    y: Floats
    S: Floats
    H: Floats
    PH: Floats
    root: Floats
    white: Floats
    log_det: Floats

    @property
    def nis(self) -> Floats:
        """Normalised innovation squared, (k,)."""
        return np.asarray((self.white**2).sum(axis=1))


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
        The hypotheses; `covs` is overwritten by each step.
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
        self._mixed = np.empty_like(covs)
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
        covs = self._mixed
        np.matmul(shares.T, self.covs.reshape(len(covs), -1), out=covs.reshape(len(covs), -1))
        for some in _several(covs):
            apart = np.sqrt(shares.T[some, :, None]) * (self.means - means[some, None])
            covs[some] += apart.swapaxes(1, 2) @ apart
        if self.level is not None:
            self.level.forget(dt)
        self.weights, self._before, self._dt = weights, _Prior(means, covs, dt), dt
        self._move(self._before, weights @ means)

    def _move(self, before: _Prior, reference: Floats, error: Floats | None = None) -> None:
        found = self.process.linearize(reference, before.dt)
        self.means = found.mean + (before.means - reference) @ found.matrix.T
        _propagate(before.covs, found, self.process.variances(self._level), self.covs)
        if error is not None:
            self.covs += np.outer(error, error)
        self._transition, self._reference = found, reference

    @property
    def _level(self) -> float:
        return 1.0 if self.level is None else self.level.level

    def innovations(self, observations: Sequence[Observation], points: Floats | None = None) -> Innovations:
        """Of each hypothesis, linearised at these states, (k, n), its mean where there are none."""
        value, R = _together(observations)
        points = self.means if points is None else points
        linear = [[one.linearize(point) for one in observations] for point in points]
        derivatives = [[matrix for _, matrix in row] for row in linear]
        if all(one is first for row in derivatives for one, first in zip(row, derivatives[0], strict=True)):
            del derivatives[1:]
        H = np.array([row[0] if len(row) == 1 else np.vstack(row) for row in derivatives])
        predicted = np.array([np.concatenate([place for place, _ in row]) for row in linear])
        y = value - predicted - _of_each(H, self.means - points)
        PH = self.covs @ H.swapaxes(1, 2)
        S = H @ PH + R
        factors = np.linalg.cholesky(S)
        root = np.linalg.inv(factors)
        log_det = 2.0 * np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1)
        return Innovations(y, S, H, PH, root, _of_each(root, y), log_det)

    def update(self, observations: Sequence[Observation]) -> float:
        """Take in all that was observed at this time; the least normalised innovation squared of any hypothesis."""
        off, found = np.inf, self.innovations(observations)
        for _ in range(LINEARISATIONS - 1):
            off = self._relinearised(found, off)
            if off <= 1.0:
                break
            found = self.innovations(observations)
        for _ in range(LINEARISATIONS):
            gains = found.PH @ found.root.swapaxes(1, 2)
            means = self.means + _of_each(gains, found.white)
            if self._is_linear(observations, found, means):
                break
            found = self.innovations(observations, means)
        nis = found.nis
        if self.level is not None:
            self._weigh_levels(self.level, observations, found)
        logs = np.log(self.weights + 1e-300) - 0.5 * (nis + found.log_det + len(found.y[0]) * np.log(2.0 * np.pi))
        self.log_likelihood = float(np.logaddexp.reduce(logs))
        for some in _several(self.covs):
            self.covs[some] -= gains[some] @ gains[some].swapaxes(1, 2)
        self.means, self.weights = means, np.exp(logs - self.log_likelihood)
        self._before = None
        return float(nis.min())

    def _relinearised(self, found: Innovations, previous: float) -> float:
        """Error of the linearised transition at the smoothed mean of the hypotheses, by the tolerance.

        Where it is more than 1 the transition is linearised again there, and half-way there where the error is more
        than the previous one: a damped Gauss-Newton step. The error itself counts as process noise.
        """
        before, transition = self._before, self._transition
        if before is None or transition is None or not np.isfinite(self.process.tolerance).any():
            return 0.0
        logs = np.log(self.weights + 1e-300) - 0.5 * (found.nis + found.log_det)
        weights = np.exp(logs - logs.max())
        weights /= weights.sum()
        solved = _of_each(found.root.swapaxes(1, 2), found.white)
        back = _of_each(found.H.swapaxes(1, 2), solved) @ transition.matrix
        smoothed = weights @ (before.means + _of_each(before.covs, back))
        linear = transition.mean + transition.matrix @ (smoothed - self._reference)
        moved = self.process.moved(smoothed, before.dt)
        off = float((np.abs(moved - linear) / self.process.tolerance).max())
        if not np.isfinite(moved).all() or off <= 1.0:
            return 0.0
        self._move(before, smoothed if off <= previous else 0.5 * (self._reference + smoothed), moved - linear)
        return off

    def _is_linear(self, observations: Sequence[Observation], found: Innovations, means: Floats) -> bool:
        """Whether the observations at the updated means are as their linearisation says."""
        best = int(np.argmax(self.weights))
        value, R = _together(observations)
        there = np.concatenate([one.linearize(means[best])[0] for one in observations])
        linear = value - found.y[best] + found.H[best % len(found.H)] @ (means[best] - self.means[best])
        return bool(np.all(np.abs(there - linear) <= CURVED * np.sqrt(R.diagonal())))

    def _weigh_levels(self, level: LevelPosterior, observations: Sequence[Observation], found: Innovations) -> None:
        """By the hypothesis that is most probable now."""
        best = int(np.argmax(np.log(self.weights + 1e-300) - 0.5 * (found.nis + found.log_det)))
        own = found.H[best % len(found.H)][:, self.process.parts[DISCREPANCY]]
        names: list[str] = []
        blocks: list[slice] = []
        start = 0
        for one in observations:
            names += one.names
            blocks += [slice(block.start + start, block.stop + start) for block in one.blocks]
            start += len(one.value)
        fresh = self.process.fresh(self._dt) * (own @ own.T)
        level.update(found.y[best], found.S[best], fresh, self._groups(names, blocks))


def _each(names: Sequence[str], blocks: Sequence[slice]) -> Sequence[NDArray[np.int64]]:
    """Each name is withheld by itself."""
    return [np.arange(block.start, block.stop)[None] for block in blocks]


def _together(observations: Sequence[Observation]) -> tuple[Floats, Floats]:
    """Values one after the other, (m,), and the covariance of their errors, (m, m)."""
    if len(observations) == 1:
        return observations[0].value, observations[0].cov
    return np.concatenate([one.value for one in observations]), block_diag(*(one.cov for one in observations))


def _several(covs: Floats) -> list[slice]:
    """Slices of so many covariances (k, n, n) as are worked on at a time."""
    step = max(1, AT_A_TIME // covs[0].size)
    return [slice(k, k + step) for k in range(0, len(covs), step)]


def _propagate(before: Floats, transition: Transition, variances: Floats, after: Floats) -> None:
    """Write T P T' and the noise of sources of variances (k, n_sources) into `after`, for each P before, (k, n, n).

    Last states that only fade, each by itself, are not multiplied out, nor are last columns of zeros in the others.
    """
    T, (n_noises, m, _) = transition.matrix, transition.noises.shape
    noises, fading = transition.noises.reshape(n_noises, -1), T.diagonal()
    acting = T != 0.0
    np.fill_diagonal(acting, False)
    r = int(np.flatnonzero(acting.any(axis=1)).max(initial=-1)) + 1
    c = max(r, int(np.flatnonzero(acting.any(axis=0)).max(initial=-1)) + 1)
    rows, fading, faded = T[:r, :c], fading[r:], np.outer(fading[r:], fading[r:])
    for some in _several(before):
        P, moved = before[some], after[some]
        half = rows @ P[:, :c]
        corner = 0.5 * (half[:, :, :c] @ rows.T)
        np.add(corner, corner.swapaxes(1, 2), out=moved[:, :r, :r])
        np.multiply(half[:, :, r:], fading, out=moved[:, :r, r:])
        moved[:, r:, :r] = moved[:, :r, r:].swapaxes(1, 2)
        np.multiply(P[:, r:, r:], faded, out=moved[:, r:, r:])
        moved[:, :m, :m] += (variances[some, :n_noises] @ noises).reshape(-1, m, m)
    if len(transition.independent):
        np.einsum("kii->ki", after)[:] += variances[:, n_noises:] @ transition.independent


def _of_each(matrices: Floats, vectors: Floats) -> Floats:
    """Each matrix (k, m, n), or the one, times each vector (k, n)."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])
