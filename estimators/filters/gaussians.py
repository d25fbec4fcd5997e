"""Covariances and mixtures of Gaussians."""

from __future__ import annotations

import numpy as np

from estimators.arrays import Floats

FLOOR = 1e-12
"""Least eigenvalue that a repaired covariance has, by its largest; a thousand times rounding."""


def nearest_definite(P: Floats) -> Floats:
    """The covariance (n, n) with eigenvalues below rounding lifted to it.

    Of the correlations, so that units do not matter.
    """
    root = np.sqrt(np.maximum(np.diag(P), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(P / np.outer(root, root))
    lifted = np.maximum(values, FLOOR * max(values[-1], 1.0))
    mended = root[:, None] * ((vectors * lifted) @ vectors.T) * root
    return 0.5 * (mended + mended.T)


def moment_matched(weights: Floats, means: Floats, covs: Floats) -> tuple[Floats, Floats]:
    """Mean (n,) and covariance (n, n) of a Gaussian mixture: weights (k,), means (k, n), covs (k, n, n)."""
    mean = weights @ means
    away = means - mean
    cov = np.einsum("k,kij->ij", weights, covs) + (weights[:, None] * away).T @ away
    return mean, 0.5 * (cov + cov.T)
