"""Tests whether innovations are white, as expected if the filter's model is right."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import chi2

from estimators.arrays import Floats


def autocorrelation(series: ArrayLike, n_lags: int) -> Floats:
    """Autocorrelation matrices of a series (n, m) at lags of 1 to n_lags steps, (n_lags, m, m).

    If the series is white, each entry is normal with mean 0 and a standard deviation of nearly 1 / sqrt(n).
    Raises ValueError unless 1 <= n_lags < n.
    """
    z = _standardised(series, n_lags)
    n = len(z)
    return np.array([z[lag:].T @ z[:-lag] / n for lag in range(1, n_lags + 1)])


def portmanteau(series: ArrayLike, n_lags: int) -> float:
    """P-value of the hypothesis that a series (n, m) is white, from its autocorrelations at lags 1 to n_lags.

    For one coordinate this is the test of Ljung and Box [ljung1978]. For several coordinates it is Hosking's test
    [hosking1980], whose result does not depend on scale or rotation of the coordinates.
    Raises ValueError unless 1 <= n_lags < n.
    """
    z = _standardised(series, n_lags)
    n, m = z.shape
    inverse = np.linalg.inv(z.T @ z / n)
    total = 0.0
    for lag in range(1, n_lags + 1):
        C = z[lag:].T @ z[:-lag] / n
        total += float(np.trace(C.T @ inverse @ C @ inverse)) / (n - lag)
    return float(chi2.sf(n**2 * total, m * m * n_lags))


def effective_count(series: ArrayLike) -> float:
    """Effective sample size of a stationary series (n,): number of independent values with an equally accurate mean.

    Autocovariances of adjacent lags are summed in pairs, until a pair's sum is not positive (initial positive sequence
    of [geyer1992], section 3.3). The result lies between 1 and n; for a constant series it is 1.
    """
    x = np.asarray(series, dtype=float)
    n, away = len(x), x - x.mean()
    variance = float(away @ away)
    if n < 2 or variance <= 0.0:
        return 1.0
    total = -1.0
    for lag in range(0, n - 1, 2):
        pair = float(away[lag:] @ away[: n - lag] + away[lag + 1 :] @ away[: n - lag - 1]) / variance
        if pair <= 0.0:
            break
        total += 2.0 * pair
    return float(np.clip(n / total, 1.0, n)) if total > 0.0 else float(n)


def _standardised(series: ArrayLike, n_lags: int) -> Floats:
    z = np.asarray(series, dtype=float)
    z = z[:, None] if z.ndim == 1 else z
    if not 1 <= n_lags < len(z):
        raise ValueError(f"n_lags: expected 1 to {len(z) - 1}, found {n_lags}")
    # the mean is not subtracted: innovations have mean zero, so a biased series is not white
    return np.asarray(z / np.sqrt((z**2).mean(axis=0)))
