"""What innovations are left with that the model does not explain, and standard errors that allow for it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from estimators.arrays import Floats
from estimators.identification.filter_pass import Pass

LEVEL = 0.01
"""Probability by which each of the two tests calls the residuals of a right model unexplained; choice, its cost in
docs/settings.md."""

ROUNDING = 1e-9
"""Share by which a variance may exceed that without data by rounding alone; numerical."""


@dataclass(frozen=True, slots=True)
class ResidualTest:
    """The innovations at the constants found, tested; of a right model both ratios are 1, but for sampling.

    size: mean square of the normalised innovations [1]
    inflation: largest ratio of a standard error with model error to one without, over all directions, by the residuals
        alone, see `within_prior` [1]
    n, n_effective: innovations, and how many independent ones would determine the constants as well
    explained: whether neither is larger than sampling makes it
    """

    size: float
    inflation: float
    n: int
    n_effective: float
    explained: bool

    @property
    def noise_ratio(self) -> float:
        """Stated sd of the noise by that of the residuals [1], where sampling does not explain it; else 1.

        Larger than 1: the stated noise is too large.
        """
        small = self.size < chi2.ppf(LEVEL, self.n_effective) / self.n_effective
        return self.size**-0.5 if small else 1.0


def times_counted(found: Pass) -> float:
    """How many times over a composite log likelihood counts what frames tell, at least 1; 1 of any other.

    The largest ratio, over directions, of the long-run covariance of the scores to the information that is claimed, a
    prior of unit variance beside both. By that it is divided, as if so many frames were one. Source: [pauli2011].
    Differs from it: the mean ratio there; one direction may be told by nothing but the model's errors.
    """
    n_frames, n = found.scores.shape
    if not found.composite or n_frames < 3 or not n:
        return 1.0
    inverse = np.linalg.inv(np.linalg.cholesky(found.information + np.eye(n)))
    J = long_run_covariance(found.scores, int(np.sqrt(n_frames))) + np.eye(n)
    return max(1.0, float(np.linalg.eigvalsh(inverse @ J @ inverse.T)[-1]))


def residual_covariance(
    found: Pass, prior_precision: Floats, information: Floats | None = None
) -> tuple[Floats, ResidualTest]:
    """Covariance of constants at the optimum, (n, n), inflated by what the model leaves unexplained, and the test.

    information: of the likelihood, (n, n), where it is not that of the scores
    The sandwich H^-1 (H + excess) H^-1, H the information with the prior's. The excess is what the long-run covariance
    of the scores, with Bartlett's weights, so that correlated innovations count for fewer, has beyond that of white
    innovations. Source: [newey1987]. It is none along directions in which sampling alone may make as much
    [davidson2001]. Of a composite likelihood its information, divided, takes the place of all that.
    """
    H = (found.information if information is None else information) + prior_precision
    n_frames, n = found.scores.shape
    if n_frames < 3 or not n:
        return np.asarray(np.linalg.inv(H), dtype=np.float64), ResidualTest(
            float("nan"), 1.0, n_frames, float(n_frames), explained=True
        )
    if found.composite:
        return _of_composite(found, prior_precision)
    n_lags = int(np.sqrt(n_frames))
    dof = float(found.dof.sum())
    size = float(found.nis.sum()) / dof
    too_large = bool(size > chi2.isf(LEVEL, dof) / dof)
    white = (size if too_large else 1.0) * found.information + prior_precision
    root = np.linalg.cholesky(white)
    inverse = np.linalg.inv(root)
    J = long_run_covariance(found.scores, n_lags) + prior_precision
    ratios, axes = np.linalg.eigh(inverse @ J @ inverse.T)
    # bound of the largest eigenvalue of a sampled identity, of as many samples as Bartlett's weights leave
    samples = 1.5 * n_frames / n_lags
    edge = (1.0 + np.sqrt(n / samples) + np.sqrt(-2.0 * np.log(LEVEL) / samples)) ** 2
    inflated = np.where(ratios > edge, ratios, 1.0)
    excess = (root @ axes * inflated) @ (root @ axes).T - found.information - prior_precision
    around = np.linalg.inv(H)
    cov = around + around @ excess @ around
    worst = float(np.linalg.eigvals(cov @ H).real.max()) if too_large or inflated.max() > 1.0 else 1.0
    test = ResidualTest(size, float(np.sqrt(worst)), int(dof), dof / worst, explained=worst == 1.0)
    return np.asarray(0.5 * (cov + cov.T), dtype=np.float64), test


def within_prior(cov: Floats, theta: Floats) -> tuple[Floats, int]:
    """A covariance of constants found at theta, (n,), no larger than without data, (n, n), and in how many directions.

    cov: in prior standard deviations, (n, n)
    The sandwich grows with the residuals without limit; the error of the constants does not. Of a point to which data
    that tell nothing have led its mean square is B = 1 + theta theta', the prior's and the way there: of each direction
    of [cov, B] the smaller one is kept.
    """
    B = np.eye(len(theta)) + np.outer(theta, theta)
    root = np.linalg.cholesky(B)
    inverse = np.linalg.inv(root)
    ratios, axes = np.linalg.eigh(inverse @ cov @ inverse.T)
    largest = float(ratios.max(initial=0.0))
    if largest <= 1.0 + ROUNDING:
        return cov, 0
    # beside a variance so large one below its rounding is not known: nor is what data tell of that direction
    limited = (ratios > 1.0 + ROUNDING) | (ratios < len(theta) * np.finfo(float).eps * largest)
    turned = root @ axes
    return np.asarray((turned * np.where(limited, 1.0, ratios)) @ turned.T), int(limited.sum())


def _of_composite(found: Pass, prior_precision: Floats) -> tuple[Floats, ResidualTest]:
    times = times_counted(found)
    cov = np.linalg.inv(found.information / times + prior_precision)
    worst = float(np.linalg.eigvals(cov @ (found.information + prior_precision)).real.max())
    dof = float(found.dof.sum())
    size, n_effective = float(found.nis.sum()) / dof, dof / times
    explained = bool(size <= chi2.isf(LEVEL, n_effective) / n_effective)
    return np.asarray(0.5 * (cov + cov.T), dtype=np.float64), ResidualTest(
        size, float(np.sqrt(worst)), int(dof), n_effective, explained
    )


def long_run_covariance(series: Floats, n_lags: int) -> Floats:
    """Covariance of the sum of a series (k, n) that is correlated over up to n_lags steps, (n, n).

    Source: [newey1987], equation (5).
    """
    z = series - series.mean(axis=0)
    total = z.T @ z
    for lag in range(1, n_lags + 1):
        cross = z[lag:].T @ z[:-lag]
        total += (1.0 - lag / (n_lags + 1.0)) * (cross + cross.T)
    return np.asarray(total)
