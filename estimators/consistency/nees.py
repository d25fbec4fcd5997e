"""Consistency of a covariance: normalised squared errors, their chi-square bounds, and coverage.

Source: [barshalom2001], section 5.4.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import chi2

from estimators.arrays import Floats


def normalised_error_squared(errors: ArrayLike, covs: ArrayLike) -> Floats:
    """Squared Mahalanobis distance of each error, (n,): the NEES of an estimation error, or the NIS of an innovation.

    errors: (n, d); covs: (n, d, d), in the squared unit of the errors
    Raises numpy's LinAlgError if a covariance is not positive definite.
    """
    root = np.linalg.cholesky(np.asarray(covs, dtype=float))
    white = np.linalg.solve(root, np.asarray(errors, dtype=float)[..., None])[..., 0]
    return np.asarray((white**2).sum(axis=-1))


def chi_square_bounds(degrees: int | float, share: float = 0.95) -> tuple[float, float]:
    """Interval with equal tails that contains a chi-square variable with probability `share`.

    degrees: degrees of freedom of the variable
    Raises ValueError if `share` is not between 0 and 1, or if `degrees` is not positive.
    """
    _check(degrees, share)
    tail = 0.5 * (1.0 - share)
    return float(chi2.ppf(tail, degrees)), float(chi2.ppf(1.0 - tail, degrees))


def mean_bounds(degrees: float, n: int, share: float = 0.95) -> tuple[float, float]:
    """Interval that contains the mean of n independent chi-square variables with probability `share`.

    degrees: degrees of freedom of each variable, or their mean if they differ
    """
    low, high = chi_square_bounds(degrees * n, share)
    return low / n, high / n


def coverage(squared: ArrayLike, degrees: int, share: float = 0.95) -> float:
    """Share of the normalised squared errors, (n,), that do not exceed the chi-square quantile at `share`.

    Raises ValueError if `share` is not between 0 and 1, or if `degrees` is not positive.
    """
    _check(degrees, share)
    return float(np.mean(np.asarray(squared, dtype=float) <= chi2.ppf(share, degrees)))


def anees(squared: ArrayLike, degrees: int) -> float:
    """Mean NEES per degree of freedom, from NEES (n,): 1 if consistent, above 1 if overconfident. Source: [li2006]."""
    return float(np.mean(np.asarray(squared, dtype=float))) / degrees


def _check(degrees: float, share: float) -> None:
    """Raise ValueError unless the share is between 0 and 1 and there are degrees of freedom."""
    if not 0.0 < share < 1.0:
        raise ValueError(f"share: expected more than 0 and less than 1, found {share}")
    if not degrees > 0.0:
        raise ValueError(f"degrees: expected more than 0, found {degrees}")
