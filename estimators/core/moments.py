"""Moments of several Gaussian hypotheses: mixing, prediction and mapping."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimators.arrays import Floats
from estimators.core.protocols import Transition


def mixed(weights: Floats, means: Floats, covs: Floats | Sequence[Floats]) -> tuple[Floats, Floats]:
    """Mean (n,) and covariance (n, n) of a mixture of k Gaussians with these weights, means (k, n) and covariances."""
    mean = weights @ means
    apart = means - mean
    return mean, np.tensordot(weights, np.asarray(covs), 1) + (apart.T * weights) @ apart


def moved(covs: Floats | Sequence[Floats], matrix: Floats) -> Floats:
    """Covariances T P T' for each of k covariances P (n, n).

    To save time, trailing states that only decay are scaled, and trailing zero columns of other rows are skipped.
    """
    T, fading = matrix, matrix.diagonal()
    acting = T != 0.0
    np.fill_diagonal(acting, False)
    r = int(np.flatnonzero(acting.any(axis=1)).max(initial=-1)) + 1
    c = max(r, int(np.flatnonzero(acting.any(axis=0)).max(initial=-1)) + 1)
    rows, fading, faded = T[:r, :c], fading[r:], np.outer(fading[r:], fading[r:])
    found = np.empty((len(covs), *matrix.shape))
    for P, after in zip(covs, found, strict=True):
        half = rows @ P[:c]
        corner = 0.5 * (half[:, :c] @ rows.T)
        np.add(corner, corner.T, out=after[:r, :r])
        np.multiply(half[:, r:], fading, out=after[:r, r:])
        after[r:, :r] = after[:r, r:].T
        np.multiply(P[r:, r:], faded, out=after[r:, r:])
    return found


def mixed_each(shares: Floats, means: Floats, centres: Floats, covs: Floats) -> Floats:
    """Covariances of k mixtures of l Gaussians, (k, n, n).

    shares (l, k): share of each Gaussian in each mixture; centres (k, n): means of the mixtures
    """
    out = (shares.T @ covs.reshape(len(covs), -1)).reshape(-1, *covs.shape[1:])
    for k, share in enumerate(shares.T):
        if np.count_nonzero(share) > 1:
            apart = np.sqrt(share[:, None]) * (means - centres[k])
            out[k] += apart.T @ apart
    return np.asarray(out)


def add_noise(covs: Floats, transition: Transition, variances: Floats) -> None:
    """Add process noise, with a variance for each source, (k, n_sources), to covariances (k, n, n)."""
    n_noises, m, _ = transition.noises.shape
    covs[:, :m, :m] += (variances[:, :n_noises] @ transition.noises.reshape(n_noises, m * m)).reshape(-1, m, m)
    if transition.spread is not None:
        covs[:, : len(transition.spread), : len(transition.spread)] += transition.spread
    if len(transition.independent):
        np.einsum("kii->ki", covs)[:] += variances[:, n_noises:] @ transition.independent


def of_each(matrices: Floats, vectors: Floats) -> Floats:
    """Product of each matrix (k, m, n), or of a single one, with each vector (k, n)."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """Hypotheses before a transition over dt [s].

    means (l, n), covs l times (n, n), weights (l,): of the hypotheses not omitted; shares (l, k): their shares in each
    mode after dt; chain (k, k): mode probabilities after dt given the mode before; kick (n,): effect of a known force
    """

    means: Floats
    covs: Sequence[Floats]
    weights: Floats
    shares: Floats
    chain: Floats
    dt: float
    kick: Floats | float

    def born(self, weights: Floats) -> Floats:
        """Probability (k,) of a change into each mode within dt from the other modes, which have weights (k,)."""
        return np.asarray(weights @ self.chain - weights * self.chain.diagonal())

    def mean(self, mode: int) -> Floats:
        """Mean of a mode, (n,)."""
        return np.asarray(self.shares[:, mode] @ self.means)

    def cov(self, mode: int) -> Floats:
        """Covariance of a mode, (n, n)."""
        return self.times(mode, np.eye(self.means.shape[1]))

    def times(self, mode: int, columns: Floats) -> Floats:
        """Covariance of a mode times columns, (n,) or (n, any)."""
        shares, apart = self.shares[:, mode], self.means - self.mean(mode)
        found = (apart.T * shares) @ (apart @ columns)
        for share, P in zip(shares, self.covs, strict=True):
            if share:
                found += share * (P @ columns)
        return np.asarray(found)


@dataclass(frozen=True, slots=True, eq=False)
class Move:
    """Moments of the mixture before and after a prediction, (n,) and (n, n), and the transition's matrix (n, n)."""

    mean_before: Floats
    cov_before: Floats
    matrix: Floats
    mean: Floats
    cov: Floats
