"""Which constants a recording determines: the others keep the values given, and the uncertainty of these.

The variance of a constant is that of the posterior, and what the search leaves open: how far apart ends of equal
likelihood are, and how far a search has gone that did not come to an end.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimators.arrays import Floats
from estimators.identification.residuals import within_prior
from estimators.identification.search import Optimum

MAX_VARIANCE_LEFT = 0.5
"""Part of the prior variance left to a combination of constants above which it is undetermined: the recording says
less of it than was known before; chosen."""

LEAST_PART = 0.05
"""Part of a constant's axis that lies in what is determined, below which it keeps its value; chosen: of twenty equal
constants of which a recording determines the sum each has as much."""

ALIKE = 0.1
"""Log posterior of an innovation by which one end may lie below another and explain a recording as well: a model whose
innovations are a fifth larger, or smaller, than stated is off by as much; chosen."""


def left_open(ends: Sequence[Optimum], best: Optimum) -> Floats:
    """Mean square of the way from the best end to all that explain the recording as well, (n, n), in prior units."""
    n_innovations, times = float(best.found.dof.sum()), best.times
    ways = [one.theta - best.theta for one in ends if best.at(times) - one.at(times) <= ALIKE * n_innovations / times]
    return np.mean([np.outer(way, way) for way in ways], axis=0)


def keeping_undetermined(theta: Floats, cov: Floats) -> tuple[Floats, Floats, int]:
    """Constants found, (n,), but as given, at 0, along all that is not determined; their covariance (n, n).

    In prior standard deviations; see `within_prior`. A constant that has next to no part in any determined combination
    is kept itself; the others are the most probable ones where what is kept is as given. What was given up is in the
    covariance. Last, in how many directions the prior limits that.
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
    """The combinations that a covariance in prior standard deviations leaves determined, columns (n, n_determined)."""
    left, directions = np.linalg.eigh(cov)
    return np.asarray(directions[:, left <= MAX_VARIANCE_LEFT])
