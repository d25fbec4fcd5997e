"""Test which constants a recording determines. The other constants keep their given values and uncertainty.

The variance of a constant is the posterior variance plus the mean square distance between equally good results of the
search.
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
"""A constant keeps its given value if the squared projection of its unit vector on the determined combinations of
constants is below this [1]; choice: if only the sum of twenty constants is determined, each projection is 0.05."""

ALIKE = 0.1
"""Two results of a search are equally good if their log posteriors differ by less than this per innovation; choice: a
change of the mean square of the normalised innovations by a fifth causes this difference."""


def left_open(ends: Sequence[Optimum], best: Optimum) -> Floats:
    """Mean of d d', (n, n), with d the difference of an equally good result from the best, in prior sds."""
    n_innovations, times = float(best.found.dof.sum()), best.times
    ways = [one.theta - best.theta for one in ends if best.at(times) - one.at(times) <= ALIKE * n_innovations / times]
    return np.mean([np.outer(way, way) for way in ways], axis=0)


def keeping_undetermined(theta: Floats, cov: Floats) -> tuple[Floats, Floats, int]:
    """Reset undetermined combinations of the constants theta, (n,), to their given value, which is 0.

    cov: covariance of theta, (n, n); theta and cov are in prior standard deviations
    A constant of which almost nothing is determined becomes 0. The other constants then take their most probable
    values. Returns the new theta, the covariance plus the squared change of theta, and the number of directions in
    which the prior limits this covariance, see `within_prior`.
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
    """Determined combinations of constants as columns (n, n_determined); cov (n, n): in prior standard deviations."""
    left, directions = np.linalg.eigh(cov)
    return np.asarray(directions[:, left <= MAX_VARIANCE_LEFT])
