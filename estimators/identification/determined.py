"""Test which constants a recording determines; the others keep their given values and uncertainty.

The variance of a constant is the posterior variance plus the ambiguity of the search. The ambiguity is the mean square
distance between results of equal likelihood. If the search did not finish, the square of its last step is added.
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
"""If the squared projection of a constant's axis on the determined combinations is below this, the constant keeps its
value; choice: if only the sum of twenty equal constants is determined, the projection is 0.05 for each constant."""

ALIKE = 0.1
"""If the log posteriors of two results differ by less than this per innovation, they explain a recording equally well;
choice: the difference for a model whose innovations are a fifth larger or smaller than stated."""


def left_open(ends: Sequence[Optimum], best: Optimum) -> Floats:
    """Mean square distance between the best result and equally good ones, (n, n), in prior standard deviations."""
    n_innovations, times = float(best.found.dof.sum()), best.times
    ways = [one.theta - best.theta for one in ends if best.at(times) - one.at(times) <= ALIKE * n_innovations / times]
    return np.mean([np.outer(way, way) for way in ways], axis=0)


def keeping_undetermined(theta: Floats, cov: Floats) -> tuple[Floats, Floats, int]:
    """Constants theta (n,) and their covariance (n, n) after undetermined combinations are reset to the given value 0.

    Both are in prior standard deviations. A constant of which almost nothing is determined keeps its given value. The
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
    """Determined combinations of constants as columns (n, n_determined); cov (n, n): in prior standard deviations."""
    left, directions = np.linalg.eigh(cov)
    return np.asarray(directions[:, left <= MAX_VARIANCE_LEFT])
