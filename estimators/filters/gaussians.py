"""Covariances and mixtures of Gaussians."""

from __future__ import annotations

import numpy as np

from estimators.arrays import Floats

FLOOR = 1e-12
"""Least eigenvalue that a repaired covariance has, by its largest; a thousand times rounding."""

OF_TWO = 0.5
"""Variance of the mean of two that err alike and independently, by that of each [1]."""


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


def inflated_each(
    weights: Floats, beliefs: tuple[Floats, Floats, Floats], factor: float
) -> tuple[Floats, Floats, Floats]:
    """Several beliefs as in `corrected_each`, weights (k,), with the mixture's covariance times a factor [1]."""
    xs, Ps, columns = beliefs
    mean = weights @ xs
    return mean + np.sqrt(factor) * (xs - mean), factor * Ps, np.sqrt(factor) * columns


def evened_each(
    weights: Floats, beliefs: tuple[Floats, Floats, Floats], H: Floats, share: float
) -> tuple[Floats, Floats, Floats]:
    """Several beliefs as in `corrected_each`, weights (k,), with the mixture's covariance at H x, H (m, n), more even.

    Its eigenvalues go to their mean by a share, 0 to 1, so that their sum stays: errors of H x are stretched along the
    eigenvectors, and those of x follow by regression.
    """
    if share <= 0.0:
        return beliefs
    xs, Ps, columns = beliefs
    mean = weights @ xs
    away, HP, HC = xs - mean, H @ Ps, H @ columns
    of_modes = HP.swapaxes(1, 2) + columns @ HC.swapaxes(1, 2) + away[:, :, None] * (away @ H.T)[:, None]
    across = np.einsum("k,kia->ia", weights, of_modes)
    values, vectors = np.linalg.eigh(H @ across)
    values = np.maximum(values, FLOOR * values[-1])
    stretched = np.sqrt(1.0 - share + share * values.mean() / values) - 1.0
    W = across @ (vectors * (stretched / values)) @ vectors.T
    moved = HP.swapaxes(1, 2) @ W.T
    evened = Ps + moved + moved.swapaxes(1, 2) + W @ (HP @ H.T) @ W.T
    return xs + away @ H.T @ W.T, evened, columns + W @ HC


def pooled_each(beliefs: tuple[Floats, Floats, Floats], ahead: Floats, share: float) -> tuple[Floats, Floats, Floats]:
    """Several beliefs as in `corrected_each`, each pooled with an opinion that is ahead (n,) of it, by this share [1].

    The mean of both, and their spread beside the covariance, as of a mixture; a linear opinion pool [stone1961].
    """
    xs, Ps, columns = beliefs
    return xs + share * ahead, Ps + share * (1.0 - share) * np.outer(ahead, ahead), columns


def corrected_each(
    beliefs: tuple[Floats, Floats, Floats], z: Floats, H: Floats, R: Floats, *, trust: float = 1.0
) -> tuple[Floats, Floats, Floats]:
    """Several beliefs after z = H x + noise, z (m,), H (m, n), R (m, m).

    beliefs, given and returned: means (k, n), covariances (k, n, n), and columns (k, n, r) of considered errors of unit
    variance, which enter the gain and are no part of the covariances
    trust: the gain is that of covariances so many times smaller [1]; those returned are of the errors that it leaves.
        At z they are no larger, by their traces, than what it leaves of errors so many times smaller, or than half of
        z's own, whichever is the more: what the mean of two leaves that err alike
    """
    if not len(z):
        return beliefs
    xs, Ps, columns = beliefs
    HP, C = H @ Ps, H @ columns
    S = HP @ H.T + R
    K = np.linalg.solve(S + C @ C.swapaxes(1, 2) + (trust - 1.0) * R, HP + C @ columns.swapaxes(1, 2)).swapaxes(1, 2)
    beside = K @ (0.5 * S @ K.swapaxes(1, 2) - HP)  # Joseph's form: (1 - K H) P (1 - K H)' + K R K', less P
    ahead = xs + np.einsum("kni,ki->kn", K, z - xs @ H.T)
    left, of_columns = Ps + (beside + beside.swapaxes(1, 2)), columns - K @ C
    at_z = np.trace(H @ left @ H.T, axis1=1, axis2=2) + ((H @ of_columns) ** 2).sum(axis=(1, 2))
    most = np.maximum(np.trace(H @ K @ R, axis1=1, axis2=2), OF_TWO * np.trace(R))
    kept = most / np.maximum(at_z, most)
    return ahead, kept[:, None, None] * left, np.sqrt(kept)[:, None, None] * of_columns
