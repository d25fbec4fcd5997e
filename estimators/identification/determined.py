"""Test which constants a recording determines; the others keep their given values and uncertainty.

The variance of a constant is the posterior variance plus the ambiguity of the search. This ambiguity is the mean square
distance between results of equal likelihood, plus the square of the last step if the search did not finish.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimators.arrays import Floats
from estimators.identification.residuals import within_prior
from estimators.identification.search import Optimum

MAX_VARIANCE_LEFT = 0.5
"""Ratio of posterior to prior variance above which a combination of constants is undetermined: the recording has less
information on it than the prior; choice."""

LEAST_PART = 0.05
"""Squared projection of a constant's axis on the determined combinations below which the constant keeps its value;
choice: if only the sum of twenty equal constants is determined, it is 0.05 for each of them."""

ALIKE = 0.1
"""Difference of log posterior per innovation below which two results explain a recording equally well; choice: the
difference for a model whose innovations are a fifth larger or smaller than stated."""


def left_open(ends: Sequence[Optimum], best: Optimum) -> Floats:
    """Mean square distance of equally good results from the best one, (n, n), in prior standard deviations."""
    n_innovations, times = float(best.found.dof.sum()), best.times
    ways = [one.theta - best.theta for one in ends if best.at(times) - one.at(times) <= ALIKE * n_innovations / times]
    return np.mean([np.outer(way, way) for way in ways], axis=0)


def keeping_undetermined(theta: Floats, cov: Floats) -> tuple[Floats, Floats, int]:
    """Estimated constants, (n,), of which undetermined combinations keep the given value 0; their covariance, (n, n).

    Both are in prior standard deviations. A constant of which almost nothing is determined keeps its given value; the
    others take their most probable values under this condition. The covariance includes the squared change of theta.
    The third result is the number of directions in which the prior limits the covariance, see `within_prior`.
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
    """The determined combinations, columns (n, n_determined); cov: covariance in prior standard deviations, (n, n)."""
    left, directions = np.linalg.eigh(cov)
    return np.asarray(directions[:, left <= MAX_VARIANCE_LEFT])
