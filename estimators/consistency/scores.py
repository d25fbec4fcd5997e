"""Proper scores and probability integral transform of Gaussian predictions. They test mean and covariance together.

Source: [gneiting2007].
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import norm

from estimators.arrays import Floats


def crps_normal(means: ArrayLike, sds: ArrayLike, truths: ArrayLike) -> Floats:
    """Continuous ranked probability score of normal predictions, in the unit of the prediction; lower is better.

    means, sds, truths and the scores have the same shape (...). Source: [gneiting2007], equation (21).
    """
    mean, sd = np.asarray(means, dtype=float), np.asarray(sds, dtype=float)
    z = (np.asarray(truths, dtype=float) - mean) / sd
    return np.asarray(sd * (z * (2.0 * norm.cdf(z) - 1.0) + 2.0 * norm.pdf(z) - 1.0 / np.sqrt(np.pi)))


def energy_score(
    means: ArrayLike, covs: ArrayLike, truths: ArrayLike, rng: np.random.Generator, n_draws: int = 1000
) -> Floats:
    """Energy score of Gaussian predictions of points, (n,), in the points' unit; lower is better.

    The score is `E ‖X - truth‖ - E ‖X - X'‖ / 2` with random draws X, X'. In one dimension, it estimates `crps_normal`.
    means, truths: (n, d); covs: (n, d, d). Source: [gneiting2007], equation (22).
    Raises numpy's LinAlgError for an invalid covariance, and ValueError for less than two draws.
    """
    if n_draws < 2:
        raise ValueError(f"n_draws: expected 2 or more, found {n_draws}")
    mean, truth = np.asarray(means, dtype=float), np.asarray(truths, dtype=float)
    roots = np.linalg.cholesky(np.asarray(covs, dtype=float))
    drawn = np.einsum("nij,kj->nki", roots, rng.standard_normal((n_draws, mean.shape[1])))
    distance = np.linalg.norm(drawn - (truth - mean)[:, None], axis=2).mean(axis=1)
    # pairs of each draw and the next draw, which are independent
    apart = np.linalg.norm(drawn - np.roll(drawn, 1, axis=1), axis=2).mean(axis=1)
    return np.asarray(distance - 0.5 * apart)


def pit_normal(means: ArrayLike, sds: ArrayLike, truths: ArrayLike) -> Floats:
    """Probability integral transform of normal predictions: uniform on (0, 1) if the model is right."""
    z = (np.asarray(truths, dtype=float) - np.asarray(means, dtype=float)) / np.asarray(sds, dtype=float)
    return np.asarray(norm.cdf(z))
