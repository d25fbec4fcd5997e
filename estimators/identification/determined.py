"""Test which constants a recording determines. The other constants keep their given values and uncertainty.

The mean square distance of equally good results from the best one is added to the posterior variance of a constant.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimators.arrays import Floats
from estimators.identification.residuals import within_prior
from estimators.identification.search import Optimum

MAX_VARIANCE_LEFT = 0.5
"""Ratio of posterior to prior variance above which a combination of constants is undetermined; choice. Above this
ratio, the recording contains less information on the combination than the prior does."""

LEAST_PART = 0.05
"""A constant keeps its given value if its unit vector, projected on the determined combinations, has a squared length
below this [1]; choice: if only the sum of twenty constants is determined, the squared length is 0.05 for each."""

ALIKE = 0.1
"""Two results are equally good if their log posteriors differ by less than this times the number of independent
innovations; choice: the mean square of the normalised innovations then differs by less than 0.2."""


def left_open(ends: Sequence[Optimum], best: Optimum) -> Floats:
    """Mean of the matrices `d d'` over all equally good results, (n, n); d: theta of a result minus theta of best."""
    n_innovations, times = float(best.found.dof.sum()), best.times
    ways = [one.theta - best.theta for one in ends if best.at(times) - one.at(times) <= ALIKE * n_innovations / times]
    return np.mean([np.outer(way, way) for way in ways], axis=0)


def keeping_undetermined(theta: Floats, cov: Floats) -> tuple[Floats, Floats, int]:
    """Reset undetermined combinations of the constants theta, (n,), to their given value, which is 0.

    cov: covariance of theta, (n, n); theta and cov are in prior standard deviations
    A constant that is hardly determined, see `LEAST_PART`, becomes 0. The other constants take their most probable
    values under this condition, and their undetermined combinations become 0. Returns the new theta, the covariance
    `cov + d d'` for its change d, limited by `within_prior`, and the number of limited directions.
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
    """Eigenvectors of cov, (n, n), with eigenvalues of at most `MAX_VARIANCE_LEFT`, as columns, (n, n_determined)."""
    left, directions = np.linalg.eigh(cov)
    return np.asarray(directions[:, left <= MAX_VARIANCE_LEFT])
