"""Consistency of a covariance: squared errors against their chi-square bounds, coverage.

Source: [barshalom2001], section 5.4.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import chi2

from estimators.arrays import Floats


def normalised_error_squared(errors: ArrayLike, covs: ArrayLike) -> Floats:
    """Squared Mahalanobis length of each error: NEES of estimation errors, NIS of innovations; (n,).

    errors (n, d), covs (n, d, d) in the same units. Raises numpy's LinAlgError where a covariance is singular.
    """
    e = np.asarray(errors, dtype=float)
    solved = np.linalg.solve(np.asarray(covs, dtype=float), e[..., None])[..., 0]
    return np.einsum("ni,ni->n", e, solved)


def chi_square_bounds(degrees: int | float, share: float = 0.95) -> tuple[float, float]:
    """Interval of a chi-square variable with this many degrees of freedom at this probability, equal tails."""
    tail = 0.5 * (1.0 - share)
    return float(chi2.ppf(tail, degrees)), float(chi2.ppf(1.0 - tail, degrees))


def mean_bounds(degrees: float, n: int, share: float = 0.95) -> tuple[float, float]:
    """Interval of the mean of n independent chi-square variables at this probability.

    degrees: of freedom of each, or their mean where they differ
    """
    low, high = chi_square_bounds(degrees * n, share)
    return low / n, high / n


def coverage(squared: ArrayLike, degrees: int, share: float = 0.95) -> float:
    """Share of the normalised squared errors, (n,), inside the region that should hold this share of them."""
    return float(np.mean(np.asarray(squared, dtype=float) <= chi2.ppf(share, degrees)))


def anees(squared: ArrayLike, degrees: int) -> float:
    """Average NEES, (n,), by degrees of freedom: 1 is right, above it the covariance is too small. Source: [li2006]."""
    return float(np.mean(np.asarray(squared, dtype=float))) / degrees
