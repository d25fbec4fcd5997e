"""Test of the size of innovations, and standard errors that account for correlated innovations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from estimators.arrays import Floats
from estimators.identification.filter_pass import Pass

LEVEL = 0.01
"""Significance level of the test whether sampling error alone explains the residuals; choice."""

MOST_OUTLIERS = 0.01
"""Largest share of outliers among the hidden marks of a model that explains them [1]; choice."""

ROUNDING = 1e-9
"""Because of rounding errors, a variance may exceed the prior variance by this relative amount; numerical."""


@dataclass(frozen=True, slots=True)
class ResidualTest:
    """Test of the innovations of the marks that the filter did not use, with the estimated constants.

    size: mean square of the normalised innovations without outliers [1]; expected to be 1 if the model is right
    inflation: largest ratio of a standard error to the one for independent frames, of all combinations of constants [1]
    n: number of innovations; n_effective: number of independent innovations that would contain as much information
    explained: whether sampling error alone explains the size, and at most few marks are outliers
    n_outliers: expected number of outliers among the hidden marks
    """

    size: float
    inflation: float
    n: int
    n_effective: float
    explained: bool
    n_outliers: float = 0.0


def times_counted(found: Pass) -> float:
    """Factor by which a composite log likelihood overstates the information of the frames, at least 1.

    The factor is the largest eigenvalue of `(I + 1)⁻¹ (J + 1)`: `J` is the long-run covariance of the scores, `I` the
    Fisher information, and the unit matrix `1` the information of the prior. [pauli2011] takes the mean eigenvalue, but
    the information along one direction may be due to errors of the model alone.
    """
    n_frames, n = found.scores.shape
    if n_frames < 3 or not n:
        return 1.0
    inverse = np.linalg.inv(np.linalg.cholesky(found.information + np.eye(n)))
    J = long_run_covariance(found.scores, int(np.sqrt(n_frames))) + np.eye(n)
    return max(1.0, float(np.linalg.eigvalsh(inverse @ J @ inverse.T)[-1]))


def residual_covariance(found: Pass) -> tuple[Floats, ResidualTest]:
    """Covariance of the constants in prior standard deviations at the optimum, (n, n), and the test of the residuals.

    The inverse covariance is the Fisher information, divided by `times_counted`, plus a unit matrix for the prior.
    """
    prior_precision = np.eye(len(found.information))
    times = times_counted(found)
    cov = np.asarray(np.linalg.inv(found.information / times + prior_precision), dtype=np.float64)
    dof = float(found.dof.sum())
    if dof < 1.0:
        return cov, ResidualTest(float("nan"), 1.0, 0, 0.0, not found.n_outliers, found.n_outliers)
    worst = float(np.linalg.eigvals(cov @ (found.information + prior_precision)).real.max())
    size, n_effective = float(found.nis.sum()) / dof, dof / times
    is_small = size <= chi2.isf(LEVEL, n_effective) / n_effective
    explained = bool(is_small and found.n_outliers <= MOST_OUTLIERS * found.n_hidden)
    test = ResidualTest(size, float(np.sqrt(worst)), round(dof), n_effective, explained, found.n_outliers)
    return np.asarray(0.5 * (cov + cov.T), dtype=np.float64), test


def within_prior(cov: Floats, theta: Floats) -> tuple[Floats, int]:
    """Limit a covariance by the prior. Returns the limited covariance, (n, n), and the number of limited directions.

    theta, cov: estimated constants, (n,), and their covariance, (n, n), in prior standard deviations
    If the recording contained no information, the constants would differ from theta with the mean square
    `B = 1 + theta theta'`. Generalised eigenvectors diagonalise cov and `B`. Along each, the smaller variance is kept.
    """
    B = np.eye(len(theta)) + np.outer(theta, theta)
    root = np.linalg.cholesky(B)
    inverse = np.linalg.inv(root)
    ratios, axes = np.linalg.eigh(inverse @ cov @ inverse.T)
    largest = float(ratios.max(initial=0.0))
    if largest <= 1.0 + ROUNDING:
        return cov, 0
    # a variance below the rounding error of a much larger one is unknown, and the prior replaces it
    limited = (ratios > 1.0 + ROUNDING) | (ratios < len(theta) * np.finfo(float).eps * largest)
    turned = root @ axes
    return np.asarray((turned * np.where(limited, 1.0, ratios)) @ turned.T), int(limited.sum())


def long_run_covariance(series: Floats, n_lags: int) -> Floats:
    """Covariance of the sum of k vectors, (n, n). Vectors that are more than n_lags steps apart count as uncorrelated.

    series: the vectors, (k, n). Source: [newey1987], equation (5).
    """
    z = series - series.mean(axis=0)
    total = z.T @ z
    for lag in range(1, n_lags + 1):
        cross = z[lag:].T @ z[:-lag]
        total += (1.0 - lag / (n_lags + 1.0)) * (cross + cross.T)
    return np.asarray(total)
