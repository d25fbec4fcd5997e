"""Test which constants a recording determines. The other constants keep their given values and uncertainty.

If several results are equally good, their mean square distance from the best one is added to the posterior variance.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimators.arrays import Floats
from estimators.identification.residuals import within_prior
from estimators.identification.search import Optimum

MAX_VARIANCE_LEFT = 0.5
"""A combination of constants is undetermined if its posterior variance exceeds this share of its prior variance;
choice: above 0.5, the recording contains less information on the combination than the prior does."""

LEAST_PART = 0.05
"""A constant keeps its given value if the determined combinations contain less than this share of it [1]; choice.
Share: squared length of the constant's projected unit vector, 0.05 if only the sum of 20 constants is determined."""

ALIKE = 0.1
"""Largest difference between the log posteriors of equally good results, divided by the number of independent
innovations [1]; choice: the mean squares of the normalised innovations then differ by less than 0.2."""


def left_open(ends: Sequence[Optimum], best: Optimum) -> Floats:
    """Mean of `d d'` over all equally good results, (n, n); d is the difference of theta from the best result."""
    n_innovations, times = float(best.found.dof.sum()), best.times
    ways = [one.theta - best.theta for one in ends if best.at(times) - one.at(times) <= ALIKE * n_innovations / times]
    return np.mean([np.outer(way, way) for way in ways], axis=0)


def keeping_undetermined(theta: Floats, cov: Floats) -> tuple[Floats, Floats, int]:
    """Reset the undetermined part of the constants theta, (n,), to the given constants, for which theta is 0.

    cov: covariance of theta, (n, n); theta and cov are in prior standard deviations
    Hardly determined constants, see `LEAST_PART`, become 0. The other constants become the most probable ones, given
    these zeros. Then undetermined combinations of the other constants become 0. Let d be the change of theta. Returns
    the new theta, the covariance `cov + d d'`, limited by `within_prior`, and the number of limited directions.
    """
    kept = (_determined(cov) ** 2).sum(axis=1) < LEAST_PART
    rest, at = ~kept, np.zeros_like(theta)
    gain = cov[np.ix_(rest, kept)] @ np.linalg.inv(cov[np.ix_(kept, kept)])
    known = _determined(cov[np.ix_(rest, rest)] - gain @ cov[np.ix_(kept, rest)])
    at[rest] = known @ (known.T @ (theta[rest] - gain @ theta[kept]))
    given_up = theta - at
    wide, n_limited = within_prior(cov + np.outer(given_up, given_up), at)
    return at, wide, n_limited


def _determined(cov: Floats) -> Floats:
    """Eigenvectors of cov, (n, n), as columns, (n, n_determined). Their eigenvalues are at most `MAX_VARIANCE_LEFT`."""
    left, directions = np.linalg.eigh(cov)
    return np.asarray(directions[:, left <= MAX_VARIANCE_LEFT])
