"""Test which constants a recording determines; the others keep their given values and uncertainty.

The variance of a constant is the posterior variance plus the ambiguity of the search: the distance between results of
equal likelihood, and the last step of a search that did not finish.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimators.arrays import Floats
from estimators.identification.residuals import within_prior
from estimators.identification.search import Optimum

MAX_VARIANCE_LEFT = 0.5
"""Share of the prior variance of a combination of constants above which it is undetermined: the recording has less
information on it than the prior; choice."""

LEAST_PART = 0.05
"""Share of a constant's axis in the determined combinations below which the constant keeps its value; choice: the share
of each of twenty equal constants whose sum is determined."""

ALIKE = 0.1
"""Difference of log posterior per innovation below which two results explain a recording equally well; choice: that of
a model whose innovations are a fifth larger or smaller than stated."""


def left_open(ends: Sequence[Optimum], best: Optimum) -> Floats:
    """Mean square distance from the best result to all that fit the recording equally well, (n, n), in prior units."""
    n_innovations, times = float(best.found.dof.sum()), best.times
    ways = [one.theta - best.theta for one in ends if best.at(times) - one.at(times) <= ALIKE * n_innovations / times]
    return np.mean([np.outer(way, way) for way in ways], axis=0)


def keeping_undetermined(theta: Floats, cov: Floats) -> tuple[Floats, Floats, int]:
    """Estimated constants, (n,), with undetermined combinations at their given value 0; their covariance (n, n).

    Both are in prior standard deviations; see `within_prior`. A constant with almost no share in any determined
    combination keeps its value; the others are the most probable ones under that condition. The covariance includes the
    omitted part. The last result is the number of directions in which the prior limits the covariance.
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
    """The combinations that a covariance in prior standard deviations determines, columns (n, n_determined)."""
    left, directions = np.linalg.eigh(cov)
    return np.asarray(directions[:, left <= MAX_VARIANCE_LEFT])
