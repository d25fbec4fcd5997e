"""Moments of several Gaussian hypotheses: mixture, prediction, products with a matrix."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Floats
from estimators.core.kernels import mixed_rows, move
from estimators.core.protocols import Transition


def mixed(weights: Floats, means: Floats, covs: Floats | Sequence[Floats]) -> tuple[Floats, Floats]:
    """Mean (n,) and covariance (n, n) of a mixture of k Gaussians: weights (k,), means (k, n), covs (k, n, n)."""
    mean = weights @ means
    apart = means - mean
    cov = weights @ np.reshape(covs, (len(weights), -1))
    return mean, cov.reshape(covs[0].shape) + (apart.T * weights) @ apart


def moved(covs: Floats | Sequence[Floats], matrix: Floats) -> Floats:
    """Covariance `T P T'` for each of k covariances P, (k, n, n). T is the given matrix, (n, n)."""
    acting, found = matrix != 0.0, np.empty((len(covs), *matrix.shape))
    np.fill_diagonal(acting, False)
    r = int(np.flatnonzero(acting.any(axis=1)).max(initial=-1)) + 1
    c = max(r, int(np.flatnonzero(acting.any(axis=0)).max(initial=-1)) + 1)
    rows, fading = matrix[:r, :c].copy(), matrix.diagonal().copy()
    for P, after in zip(covs, found, strict=True):
        move(np.ascontiguousarray(P), rows, fading, after)
    return found


def add_noise(covs: Floats, transition: Transition, variances: Floats) -> None:
    """Add process noise to the covariance of each mode, (k, n, n). The sources have `variances` (k, n_sources)."""
    n_noises, m, _ = transition.noises.shape
    covs[:, :m, :m] += (variances[:, :n_noises] @ transition.noises.reshape(n_noises, m * m)).reshape(-1, m, m)
    if transition.spread is not None:
        covs[:, : len(transition.spread), : len(transition.spread)] += transition.spread
    if len(transition.independent):
        np.einsum("kii->ki", covs)[:] += variances[:, n_noises:] @ transition.independent


def of_each(matrices: Floats, vectors: Floats) -> Floats:
    """Products of matrices (k, m, n), or of one matrix (m, n), with vectors (k, n)."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """Hypotheses before a transition. After the transition, each of the k modes is a mixture of these hypotheses.

    means, covs, weights: mean (n,), covariance (n, n) and weight of each of the l hypotheses with positive weight
    shares: weight of each hypothesis in the mixture of each mode, (l, k)
    chain: transition probabilities between the modes, (k, k)
    dt: time step [s]
    kick: shift of the state by a known force, (n,)
    """

    means: Floats
    covs: Sequence[Floats]
    weights: Floats
    shares: Floats
    chain: Floats
    dt: float
    kick: Floats | float

    def born(self, weights: Floats) -> Floats:
        """Probability of a change from other modes into each mode, (k,). weights: probability of each mode, (k,)."""
        return np.asarray(weights @ self.chain - weights * self.chain.diagonal())

    def mean(self, mode: int) -> Floats:
        """Mean of the mixture of hypotheses for a mode, (n,)."""
        return np.asarray(self.shares[:, mode] @ self.means)

    def cov(self, mode: int) -> Floats:
        """Covariance of the mixture of hypotheses for a mode, (n, n)."""
        return self.times(mode, np.eye(self.means.shape[1]))

    def times(self, mode: int, columns: Floats) -> Floats:
        """Product of the covariance `cov(mode)` with `columns`, (n,) or (n, any). The result has the same shape."""
        shares, apart = self.shares[:, mode], self.means - self.mean(mode)
        found = (apart.T * shares) @ (apart @ columns)
        for share, P in zip(shares, self.covs, strict=True):
            if share:
                found += share * (P @ columns)
        return np.asarray(found)


@dataclass(frozen=True, slots=True, eq=False)
class Predicted:
    """Covariances of k modes after a transition, computed on demand.

    shares, apart, covs, variances, noises: as in `mixed_rows`, with the unit matrix for H. `covs` includes the noise of
        sources that are equal in all modes, and `variances` and `noises` are of the other sources
    added: variance of additional noise in each state, (k, n); the noise of different states is independent
    """

    shares: Floats
    apart: Floats
    covs: Floats
    variances: Floats
    noises: Floats
    added: Floats

    @classmethod
    def of(cls, before: Prior, means: Floats, transition: Transition, variances: Floats, added: Floats) -> Predicted:
        """Covariances after a transition of `before.means` to `means` (l, n). added (n,): variances of other noise."""
        shares, (n, m, _) = before.shares, transition.noises.shape
        apart = np.sqrt(shares)[:, :, None] * (means[:, None] - shares.T @ means)
        covs = moved(before.covs, transition.matrix)
        differ = np.ptp(variances[:, :n], axis=0) > 0.0
        # noise that is equal in all modes is added to each hypothesis, because the shares of a mode sum to 1
        covs[:, :m, :m] += np.tensordot(variances[0, :n][~differ], transition.noises[~differ], 1)
        if transition.spread is not None:
            covs[:, : len(transition.spread), : len(transition.spread)] += transition.spread
        each = np.tile(added, (len(variances), 1))
        if len(transition.independent):
            each += variances[:, n:] @ transition.independent
        return cls(shares, apart, covs, np.compress(differ, variances[:, :n], axis=1), transition.noises[differ], each)

    def each(self, modes: NDArray[np.int64]) -> Floats:
        """Covariances of the given modes, (k, n, n); zeros for all other modes."""
        found = mixed_rows(modes, self.shares, self.apart, self.apart, self.covs, self.variances, self.noises)
        np.einsum("kii->ki", found)[modes] += self.added[modes]
        return np.asarray(found)

    def times(self, H: Floats) -> Floats:
        """The products `H P`, (k, m, n), of a matrix H (m, n) with the covariance P of each mode."""
        seen = np.flatnonzero(H.any(axis=0))
        own, modes = seen[seen < self.noises.shape[1]], np.arange(len(self.added))
        covs, noises = H[:, seen] @ self.covs[:, seen], H[:, own] @ self.noises[:, own]
        found = mixed_rows(modes, self.shares, self.apart @ H.T, self.apart, covs, self.variances, noises)
        first = int(self.added.any(axis=0).argmax())
        found[:, :, first:] += H[:, first:] * self.added[:, None, first:]
        return np.asarray(found)


@dataclass(frozen=True, slots=True, eq=False)
class Move:
    """A prediction: transition matrix (n, n), mean (n,) and covariance (n, n) of the mixture before and after."""

    mean_before: Floats
    cov_before: Floats
    matrix: Floats
    mean: Floats
    cov: Floats
